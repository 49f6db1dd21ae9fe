//! Pictures of at most 256 colours as PNG, without loss: classes, objects, events.

use png::{BitDepth, ColorType, Compression, Encoder, Filter};

use super::error::PictureError;

/// The PNG of a picture whose pixels are numbers of colours, tightly packed. Numbers beyond the
/// list of colours are refused by readers, so there must be none.
///
/// # Errors
/// [`PictureError::Palette`] for no colours or too many, [`PictureError::Png`] if the size is not
/// that of the pixels.
pub fn indexed(
    size_px: [u32; 2],
    colours: &[[u8; 3]],
    numbers: &[u8],
) -> Result<Vec<u8>, PictureError> {
    file(size_px, colours, numbers, &[])
}

/// As [`indexed`], but pixels with the first colour are clear.
///
/// # Errors
/// As [`indexed`].
pub fn overlay(
    size_px: [u32; 2],
    colours: &[[u8; 3]],
    numbers: &[u8],
) -> Result<Vec<u8>, PictureError> {
    file(size_px, colours, numbers, &[0])
}

/// `opacities` are those of the first colours; the others hide what is below.
fn file(
    size_px: [u32; 2],
    colours: &[[u8; 3]],
    numbers: &[u8],
    opacities: &[u8],
) -> Result<Vec<u8>, PictureError> {
    if colours.is_empty() || colours.len() > 256 {
        return Err(PictureError::Palette(colours.len()));
    }
    let mut file = Vec::with_capacity(numbers.len() / 16 + 1024);
    let mut encoder = Encoder::new(&mut file, size_px[0], size_px[1]);
    encoder.set_color(ColorType::Indexed);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_palette(colours.concat());
    if !opacities.is_empty() {
        encoder.set_trns(opacities.to_vec());
    }
    encoder.set_compression(Compression::Fastest);
    // Rows are like those above them: what is left is mostly zeros.
    encoder.set_filter(Filter::Up);
    encoder
        .write_header()
        .and_then(|mut writer| writer.write_image_data(numbers))?;
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_decoder_sees_every_pixel() {
        let mut random = fastrand::Rng::with_seed(5);
        let colours: Vec<[u8; 3]> = (0..7).map(|i| [i * 30, 255 - i, i]).collect();
        let numbers: Vec<u8> = (0..61 * 33).map(|_| random.u8(..7)).collect();
        let file = indexed([61, 33], &colours, &numbers).unwrap();
        let seen = image::load_from_memory_with_format(&file, image::ImageFormat::Png);
        let expected = numbers.iter().flat_map(|n| colours[*n as usize]);
        assert!(seen.unwrap().to_rgb8().iter().copied().eq(expected));
    }

    #[test]
    fn an_overlay_is_clear_where_it_says_nothing() {
        let file = overlay([3, 1], &[[9; 3], [1, 2, 3]], &[0, 1, 0]).unwrap();
        let seen = image::load_from_memory(&file).unwrap().to_rgba8();
        let alpha: Vec<u8> = seen.pixels().map(|pixel| pixel[3]).collect();
        assert_eq!(
            (alpha, &seen.as_raw()[4..7]),
            (vec![0, 255, 0], &[1, 2, 3][..])
        );
    }

    #[test]
    fn what_is_no_picture_is_refused() {
        let no_colours = indexed([1, 1], &[], &[0]).unwrap_err();
        assert!(no_colours.to_string().contains("not 0"));
        assert!(indexed([2, 2], &[[0; 3]], &[0]).is_err());
        assert!(indexed([0, 0], &[[0; 3]], &[]).is_err());
    }
}
