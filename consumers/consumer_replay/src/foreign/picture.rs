//! Images of other programs as ours: four bytes of blue, green, red and alpha, or metres.

use std::io::Cursor;

use consumer_forms::ros2::read as ros2;
use foxglove::messages as fox;
use schema_frames::Modality;

use super::error::ForeignError;

/// Most pixels of an image that is decoded.
const MAX_PIXELS: u64 = 64 << 20;

/// An image as another program has it.
#[derive(Debug)]
pub struct Picture {
    pub frame_id: String,
    pub width: u32,
    pub height: u32,
    pub encoding: String,
    /// Bytes from one row to the next.
    pub step: u32,
    pub data: Vec<u8>,
}

impl Picture {
    pub fn of_foxglove(image: fox::RawImage) -> Picture {
        Picture {
            frame_id: image.frame_id,
            width: image.width,
            height: image.height,
            encoding: image.encoding,
            step: image.step,
            data: image.data.to_vec(),
        }
    }

    pub fn of_ros2(image: ros2::Image) -> Picture {
        Picture {
            frame_id: image.frame_id,
            width: image.width,
            height: image.height,
            encoding: image.encoding,
            step: image.step,
            data: image.data,
        }
    }

    /// What its pixels are.
    pub fn modality(&self) -> Result<Modality, ForeignError> {
        match self.encoding.as_str() {
            "32FC1" | "16UC1" => Ok(Modality::Depth),
            "rgb8" | "bgr8" | "8UC3" | "rgba8" | "bgra8" | "8UC4" | "mono8" | "8UC1" | "mono16" => {
                Ok(Modality::Rgb)
            }
            other => Err(ForeignError::Pixels(other.to_owned())),
        }
    }

    /// Writes it as pixels of `modality`.
    pub fn write(&self, modality: Modality, out: &mut Vec<u8>) -> Result<(), ForeignError> {
        if self.modality()? != modality {
            return Err(ForeignError::PixelsChanged(self.encoding.clone()));
        }
        let pixel_bytes = match self.encoding.as_str() {
            "mono8" | "8UC1" => 1,
            "mono16" | "16UC1" => 2,
            "rgb8" | "bgr8" | "8UC3" => 3,
            _ => 4,
        };
        let (width, height) = (self.width as usize, self.height as usize);
        let row_bytes = width.saturating_mul(pixel_bytes);
        let step = (self.step as usize).max(row_bytes);
        let n_pixels = u64::from(self.width).saturating_mul(u64::from(self.height));
        let needed = height.saturating_sub(1).saturating_mul(step);
        if n_pixels > MAX_PIXELS || self.data.len() < needed.saturating_add(row_bytes) {
            return Err(ForeignError::Size {
                n_bytes: self.data.len(),
                width: self.width,
                height: self.height,
            });
        }
        if row_bytes == 0 {
            return Ok(());
        }
        for row in self.data.chunks(step).take(self.height as usize) {
            let pixels = row[..row_bytes].chunks_exact(pixel_bytes);
            match self.encoding.as_str() {
                "mono8" | "8UC1" => out.extend(pixels.flat_map(|p| [p[0], p[0], p[0], 255])),
                // The high byte of a little-endian number.
                "mono16" => out.extend(pixels.flat_map(|p| [p[1], p[1], p[1], 255])),
                "rgb8" => out.extend(pixels.flat_map(|p| [p[2], p[1], p[0], 255])),
                "bgr8" | "8UC3" => out.extend(pixels.flat_map(|p| [p[0], p[1], p[2], 255])),
                "rgba8" => out.extend(pixels.flat_map(|p| [p[2], p[1], p[0], p[3]])),
                "16UC1" => out.extend(pixels.flat_map(|p| {
                    // Millimetres; 0 is "nothing measured".
                    let metres = match u16::from_le_bytes([p[0], p[1]]) {
                        0 => f32::INFINITY,
                        mm => f32::from(mm) / 1000.0,
                    };
                    metres.to_le_bytes()
                })),
                _ => out.extend_from_slice(&row[..row_bytes]),
            }
        }
        Ok(())
    }
}

/// Decodes a PNG or JPEG file; returns its width and height.
pub fn decode(coded: &[u8], out: &mut Vec<u8>) -> Result<[u32; 2], ForeignError> {
    if coded.starts_with(b"\x89PNG") {
        return decode_png(coded, out);
    }
    if !coded.starts_with(&[0xff, 0xd8]) {
        return Err(ForeignError::Coding);
    }
    let mut reader = image::ImageReader::with_format(Cursor::new(coded), image::ImageFormat::Jpeg);
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(MAX_PIXELS * 4);
    reader.limits(limits);
    let image = reader.decode().map_err(ForeignError::Jpeg)?;
    let pixels = image.to_rgb8();
    out.extend(pixels.pixels().flat_map(|p| [p.0[2], p.0[1], p.0[0], 255]));
    Ok([pixels.width(), pixels.height()])
}

fn decode_png(coded: &[u8], out: &mut Vec<u8>) -> Result<[u32; 2], ForeignError> {
    let limits = png::Limits {
        bytes: (MAX_PIXELS as usize).saturating_mul(4),
    };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(coded), limits);
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(ForeignError::Png)?;
    let room = reader.output_buffer_size().unwrap_or(usize::MAX);
    if room as u64 > MAX_PIXELS * 4 {
        return Err(ForeignError::PngSize(room));
    }
    let mut pixels = vec![0; room];
    let frame = reader.next_frame(&mut pixels).map_err(ForeignError::Png)?;
    let pixels = &pixels[..frame.buffer_size()];
    match frame.color_type {
        png::ColorType::Grayscale => out.extend(pixels.iter().flat_map(|p| [*p, *p, *p, 255])),
        png::ColorType::GrayscaleAlpha => {
            out.extend(
                pixels
                    .chunks_exact(2)
                    .flat_map(|p| [p[0], p[0], p[0], p[1]]),
            );
        }
        png::ColorType::Rgba => {
            out.extend(
                pixels
                    .chunks_exact(4)
                    .flat_map(|p| [p[2], p[1], p[0], p[3]]),
            );
        }
        _ => out.extend(pixels.chunks_exact(3).flat_map(|p| [p[2], p[1], p[0], 255])),
    }
    Ok([frame.width, frame.height])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(encoding: &str, width: u32, height: u32, step: u32, data: &[u8]) -> Picture {
        Picture {
            frame_id: String::new(),
            width,
            height,
            encoding: encoding.into(),
            step,
            data: data.to_vec(),
        }
    }

    #[test]
    fn pixels_become_blue_green_red_alpha_or_metres() {
        let written = |of: Picture| {
            let mut out = Vec::new();
            of.write(of.modality().unwrap(), &mut out).unwrap();
            out
        };
        assert_eq!(
            written(picture("rgb8", 1, 2, 4, &[1, 2, 3, 9, 4, 5, 6])),
            [3, 2, 1, 255, 6, 5, 4, 255]
        );
        assert_eq!(
            written(picture("bgra8", 1, 1, 4, &[1, 2, 3, 4])),
            [1, 2, 3, 4]
        );
        assert_eq!(
            written(picture("mono8", 2, 1, 2, &[7, 8])),
            [7, 7, 7, 255, 8, 8, 8, 255]
        );
        let metres = written(picture("16UC1", 2, 1, 4, &[0xdc, 5, 0, 0]));
        assert_eq!(metres[..4], 1.5f32.to_le_bytes());
        assert_eq!(metres[4..], f32::INFINITY.to_le_bytes());
        assert!(picture("bayer_rggb8", 1, 1, 1, &[0]).modality().is_err());
        let mut out = Vec::new();
        let short = picture("rgb8", 1000, 1000, 3000, &[0; 10]);
        assert!(
            short
                .write(Modality::Rgb, &mut out)
                .unwrap_err()
                .to_string()
                .contains("1000 × 1000")
        );
        let huge = picture("mono8", u32::MAX, u32::MAX, u32::MAX, &[0; 10]);
        assert!(huge.write(Modality::Rgb, &mut out).is_err());
    }

    #[test]
    fn png_and_jpeg_are_decoded_and_others_are_not() {
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, 2, 1);
        encoder.set_color(png::ColorType::Rgb);
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(&[10, 20, 30, 40, 50, 60]).unwrap();
        writer.finish().unwrap();
        let mut out = Vec::new();
        assert_eq!(decode(&file, &mut out).unwrap(), [2, 1]);
        assert_eq!(out, [30, 20, 10, 255, 60, 50, 40, 255]);
        let mut jpeg = Vec::new();
        let grey = image::RgbImage::from_pixel(8, 8, image::Rgb([100, 100, 100]));
        grey.write_to(&mut Cursor::new(&mut jpeg), image::ImageFormat::Jpeg)
            .unwrap();
        out.clear();
        assert_eq!(decode(&jpeg, &mut out).unwrap(), [8, 8]);
        assert!(out.chunks(4).all(|p| p[0].abs_diff(100) < 3 && p[3] == 255));
        for bad in [&file[..20], &jpeg[..20], b"RIFF", b""] {
            assert!(decode(bad, &mut out).is_err());
        }
    }
}
