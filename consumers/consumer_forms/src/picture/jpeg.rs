//! Colour as JPEG, with chroma of every two by two pixels.

use jpeg_encoder::{ColorType, Encoder, SamplingFactor};

use super::error::PictureError;

/// Order of a pixel's bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pixels {
    /// Blue, green, red, and a byte that is not looked at.
    Bgra,
    /// Red, green, blue.
    Rgb,
}

/// Largest side of a JPEG, pixels.
const MAX_SIDE_PX: u32 = 65_535;

/// The picture of tightly packed `pixels` at a `quality` of 1 to 100.
///
/// # Errors
/// [`PictureError::JpegSize`], [`PictureError::Jpeg`] if the size is not that of the pixels.
pub fn jpeg(
    size_px: [u32; 2],
    order: Pixels,
    pixels: &[u8],
    quality: u8,
) -> Result<Vec<u8>, PictureError> {
    let [width, height] = size_px;
    if size_px.iter().any(|side| !(1..=MAX_SIDE_PX).contains(side)) {
        return Err(PictureError::JpegSize {
            size_px,
            most: MAX_SIDE_PX,
        });
    }
    let mut file = Vec::with_capacity(pixels.len() / 16 + 1024);
    let mut encoder = Encoder::new(&mut file, quality);
    encoder.set_sampling_factor(SamplingFactor::F_2_2);
    let order = match order {
        Pixels::Bgra => ColorType::Bgra,
        Pixels::Rgb => ColorType::Rgb,
    };
    encoder.encode(pixels, width as u16, height as u16, order)?;
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_decoder_sees_the_same_colours() {
        let size = [83u32, 47];
        let rgb: Vec<u8> = (0..size[1])
            .flat_map(|y| (0..size[0]).flat_map(move |x| [(x * 3) as u8, (y * 5) as u8, 128]))
            .collect();
        let bgra: Vec<u8> = rgb
            .chunks_exact(3)
            .flat_map(|p| [p[2], p[1], p[0], 9])
            .collect();
        for (order, pixels) in [(Pixels::Rgb, &rgb), (Pixels::Bgra, &bgra)] {
            let file = jpeg(size, order, pixels, 90).unwrap();
            let seen = image::load_from_memory(&file).unwrap().to_rgb8();
            assert_eq!([seen.width(), seen.height()], size);
            let worst = seen.iter().zip(&rgb).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(worst.unwrap() < 16, "{order:?}: {worst:?}");
        }
    }

    #[test]
    fn a_wrong_size_is_refused() {
        let refused = |size, n| {
            let error = jpeg(size, Pixels::Rgb, &vec![0; n], 80).unwrap_err();
            error.to_string()
        };
        assert!(refused([0, 4], 0).contains("not 0 × 4"));
        assert!(refused([70_000, 1], 210_000).contains("70000"));
        assert!(!refused([4, 4], 47).is_empty());
    }
}
