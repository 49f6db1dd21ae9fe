//! Frames as pictures for people: every modality as colours, contact sheets, PNG and JPEG files.

use std::path::Path;

use anyhow::Context as _;
use schema_frames::{DvsEvent, Modality};

/// Quality of JPEG files: no visible blocks, even round the flat areas of labels.
const JPEG_QUALITY: u8 = 90;

/// Red, green, blue, row by row.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Width and height.
    pub size_px: [usize; 2],
    /// `width × height` pixels.
    pub rgb: Vec<[u8; 3]>,
}

fn float(bytes: &[u8]) -> f32 {
    f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
}

/// An IEEE half, little-endian.
pub fn half(bytes: &[u8]) -> f32 {
    let bits = u16::from_le_bytes([bytes[0], bytes[1]]);
    let (exponent, mantissa) = ((bits >> 10 & 31) as i32, (bits & 1023) as f32);
    let magnitude = if exponent == 0 {
        mantissa * 2f32.powi(-24)
    } else {
        (1.0 + mantissa / 1024.0) * 2f32.powi(exponent - 15)
    };
    if bits >> 15 == 1 {
        -magnitude
    } else {
        magnitude
    }
}

/// Red at angle 0, then yellow, green, cyan, blue, magenta.
fn hue(turn: f32, value: f32) -> [u8; 3] {
    [0.0, 1.0 / 3.0, 2.0 / 3.0].map(|at: f32| {
        let away = ((turn - at + 0.5).rem_euclid(1.0) - 0.5).abs() * 6.0;
        ((2.0 - away).clamp(0.0, 1.0) * value * 255.0) as u8
    })
}

impl Picture {
    /// A frame of `modality` as a picture for people.
    pub fn of(modality: Modality, size_px: [usize; 2], payload: &[u8]) -> Picture {
        let rgb = match modality {
            Modality::Rgb => payload
                .chunks_exact(4)
                .map(|p| [p[2], p[1], p[0]])
                .collect(),
            Modality::Depth => payload
                .chunks_exact(4)
                .map(|p| [(255.0 / (1.0 + 0.06 * float(p))) as u8; 3])
                .collect(),
            Modality::Semantic => payload
                .iter()
                .map(|class| {
                    schema_types::Class(*class)
                        .info()
                        .map_or([0; 3], |info| info.rgb)
                })
                .collect(),
            Modality::Instance => {
                let id = |p: &[u8]| u32::from_le_bytes([p[0], p[1], p[2], p[3]]);
                // Ids of scenery have the highest bit set, so the lower bits choose the colour.
                let share = |id: u32, step: f32| ((id & 0xffff) as f32 * step).fract();
                let colour = |id: u32| {
                    if id == 0 {
                        [0; 3]
                    } else {
                        hue(share(id, 0.618_034), 0.45 + 0.5 * share(id, 0.37))
                    }
                };
                payload.chunks_exact(4).map(|p| colour(id(p))).collect()
            }
            Modality::Flow => {
                let colour = |x: f32, y: f32| {
                    hue(
                        y.atan2(x) / std::f32::consts::TAU,
                        (x.hypot(y) / 12.0).min(1.0).sqrt(),
                    )
                };
                payload
                    .chunks_exact(8)
                    .map(|p| colour(float(p), float(&p[4..])))
                    .collect()
            }
            Modality::Normals => {
                let byte = |p: &[u8]| (half(p) * 127.0 + 128.0) as u8;
                payload
                    .chunks_exact(8)
                    .map(|p| [byte(p), byte(&p[2..]), byte(&p[4..])])
                    .collect()
            }
            _ => {
                let mut rgb = vec![[16; 3]; size_px[0] * size_px[1]];
                for event in payload.chunks_exact(size_of::<DvsEvent>()) {
                    let event: DvsEvent = bytemuck::pod_read_unaligned(event);
                    rgb[event.y_px as usize * size_px[0] + event.x_px as usize] =
                        if event.polarity == 1 {
                            [90, 160, 255]
                        } else {
                            [255, 90, 70]
                        };
                }
                rgb
            }
        };
        Picture { size_px, rgb }
    }

    /// Mean of blocks of `n` × `n` pixels.
    pub fn shrunk(&self, n: usize) -> Picture {
        let size_px = self.size_px.map(|side| side / n);
        let mean = |i: usize| {
            let (x, y) = (i % size_px[0] * n, i / size_px[0] * n);
            std::array::from_fn(|c| {
                let sum: usize = (0..n * n)
                    .map(|k| self.rgb[(y + k / n) * self.size_px[0] + x + k % n][c] as usize)
                    .sum();
                (sum / (n * n)) as u8
            })
        };
        Picture {
            size_px,
            rgb: (0..size_px[0] * size_px[1]).map(mean).collect(),
        }
    }

    /// Pictures of one size side by side, `n_across` in a row, with a rim of two pixels.
    pub fn sheet(tiles: &[Picture], n_across: usize) -> Picture {
        const RIM: usize = 2;
        let [width, height] = tiles[0].size_px;
        let size_px = [
            n_across * (width + RIM) - RIM,
            tiles.len().div_ceil(n_across) * (height + RIM) - RIM,
        ];
        let mut rgb = vec![[255; 3]; size_px[0] * size_px[1]];
        for (i, tile) in tiles.iter().enumerate() {
            let (x0, y0) = (i % n_across * (width + RIM), i / n_across * (height + RIM));
            for y in 0..height {
                let begin = (y0 + y) * size_px[0] + x0;
                rgb[begin..begin + width].copy_from_slice(&tile.rgb[y * width..(y + 1) * width]);
            }
        }
        Picture { size_px, rgb }
    }

    /// Writes a PNG file with all colours.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, path: &Path) -> anyhow::Result<()> {
        let text = || format!("cannot write {}", path.display());
        let file = std::fs::File::create(path).with_context(text)?;
        let mut encoder = png::Encoder::new(
            std::io::BufWriter::new(file),
            self.size_px[0] as u32,
            self.size_px[1] as u32,
        );
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_compression(png::Compression::High);
        encoder
            .write_header()
            .and_then(|mut writer| writer.write_image_data(self.rgb.as_flattened()))
            .with_context(text)
    }

    /// Writes a JPEG file: all colours, no bands, a fifth of the size of a PNG of streets.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_jpeg(&self, path: &Path) -> anyhow::Result<()> {
        let text = || format!("cannot write {}", path.display());
        let file = std::io::BufWriter::new(std::fs::File::create(path).with_context(text)?);
        let [width, height] = self.size_px.map(|side| side as u32);
        let mut encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(file, JPEG_QUALITY);
        encoder
            .encode(
                self.rgb.as_flattened(),
                width,
                height,
                image::ExtendedColorType::Rgb8,
            )
            .with_context(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The written file is read back with the decoder of the same crate.
    #[test]
    fn a_jpeg_keeps_a_smooth_ramp_without_bands() {
        let folder = std::env::temp_dir().join(format!("gantry-sheet-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("ramp.jpg");
        let rgb: Vec<[u8; 3]> = (0..256 * 16)
            .map(|i| [(i % 256) as u8, 128, 255 - (i % 256) as u8])
            .collect();
        Picture {
            size_px: [256, 16],
            rgb: rgb.clone(),
        }
        .write_jpeg(&path)
        .unwrap();
        let read = image::open(&path).unwrap().to_rgb8();
        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(read.dimensions(), (256, 16));
        for (wanted, found) in rgb.iter().zip(read.pixels()) {
            assert!(
                (0..3).all(|c| wanted[c].abs_diff(found.0[c]) <= 6),
                "{wanted:?} became {found:?}"
            );
        }
    }

    #[test]
    fn halves_are_read() {
        for (bits, x) in [(0x3c00u16, 1.0), (0xbc00, -1.0), (0x3800, 0.5), (0, 0.0)] {
            assert_eq!(half(&bits.to_le_bytes()), x);
        }
    }
}
