//! Distances as PNG of 16 bits: whole centimetres, and from 10 m on fewer of them, as the step grows
//! with the distance.

use png::{BitDepth, ColorType, Compression, Encoder, Filter};

use super::error::PictureError;

/// Numbers a metre has.
pub const PER_METRE: f32 = 100.0;
/// Greatest distance that has a number, metres; farther ones are shown there.
pub const FARTHEST_M: f32 = 655.0;
/// Bits of the mantissa that are kept: a step is 1/512 to 1/1024 of the distance.
const KEPT_BITS: u32 = 9;

/// Half of a step at `distance_m`, metres: what rounding can change it by.
pub fn rounding_m(distance_m: f32) -> f32 {
    0.5 / PER_METRE + distance_m / (1 << (KEPT_BITS + 1)) as f32
}

/// The picture of `f32` distances, metres, little-endian, rows `stride` bytes apart. What is not
/// finite or above zero becomes 0, "no distance".
///
/// # Errors
/// [`PictureError::Distances`] if the size is none or beyond the payload.
pub fn depth(size_px: [u32; 2], stride: usize, payload: &[u8]) -> Result<Vec<u8>, PictureError> {
    let [width, height] = size_px.map(|side| side as usize);
    let n_bytes = height.saturating_sub(1) as u64 * stride as u64 + width as u64 * 4;
    if width == 0 || height == 0 || stride < width * 4 || (payload.len() as u64) < n_bytes {
        return Err(PictureError::Distances {
            n_bytes: payload.len(),
            size_px,
        });
    }
    let mut numbers = vec![0u8; width * height * 2];
    for (row, numbers) in numbers.chunks_exact_mut(width * 2).enumerate() {
        let bytes = &payload[row * stride..][..width * 4];
        for (number, bytes) in numbers.chunks_exact_mut(2).zip(bytes.chunks_exact(4)) {
            let distance_m = f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
            number.copy_from_slice(&number_of(distance_m).to_be_bytes());
        }
    }
    let mut file = Vec::with_capacity(numbers.len() / 4 + 1024);
    let mut encoder = Encoder::new(&mut file, size_px[0], size_px[1]);
    encoder.set_color(ColorType::Grayscale);
    encoder.set_depth(BitDepth::Sixteen);
    encoder.set_compression(Compression::Fastest);
    // Along a row of the road the distance is the same, along a column of a wall, too: this filter
    // guesses from both.
    encoder.set_filter(Filter::Paeth);
    encoder
        .write_header()
        .and_then(|mut writer| writer.write_image_data(&numbers))?;
    Ok(file)
}

/// Zero for "no distance", else rounded centimetres, at least one.
fn number_of(distance_m: f32) -> u16 {
    let dropped = f32::MANTISSA_DIGITS - 1 - KEPT_BITS;
    let half = 1u32 << (dropped - 1);
    let rounded = f32::from_bits(distance_m.to_bits().wrapping_add(half) & !(2 * half - 1));
    let number = (rounded.clamp(0.0, FARTHEST_M) * PER_METRE + 0.5).max(1.0) as u16;
    // A comparison is false for what is no number.
    if distance_m > 0.0 && distance_m < f32::INFINITY {
        number
    } else {
        0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decoded(file: &[u8]) -> Vec<u16> {
        let picture = image::load_from_memory_with_format(file, image::ImageFormat::Png);
        picture.unwrap().to_luma16().into_raw()
    }

    #[test]
    fn another_decoder_sees_the_distances_but_for_rounding() {
        let mut random = fastrand::Rng::with_seed(9);
        let (width, height) = (77usize, 40usize);
        let mut distances = Vec::new();
        for _ in 0..width * height {
            distances.push(match random.u8(..8) {
                0 => f32::INFINITY,
                1 => f32::NAN,
                2 => -1.0,
                3 => 0.02 + random.f32() * 600.0,
                // Runs of like ones, as in a picture.
                _ => distances.last().copied().unwrap_or(4.0),
            });
        }
        let stride = width * 4 + 12;
        let mut payload = Vec::new();
        for row in distances.chunks_exact(width) {
            payload.extend(row.iter().flat_map(|m| m.to_le_bytes()));
            payload.extend([1; 12]);
        }
        let seen = decoded(&depth([width as u32, height as u32], stride, &payload).unwrap());
        for (seen, was) in seen.iter().zip(&distances) {
            match was.is_finite() && *was > 0.0 {
                true => {
                    let allowed = rounding_m(*was) * 1.001 + 1e-4;
                    let seen_m = *seen as f32 / PER_METRE;
                    assert!((seen_m - was).abs() <= allowed, "{was} became {seen_m}");
                }
                false => assert_eq!(*seen, 0, "{was}"),
            }
        }
    }

    #[test]
    fn near_and_far_ends_keep_their_place() {
        let numbers = [0.001f32, 1e9, f32::MAX, 0.0, 1.0].map(number_of);
        assert_eq!(numbers, [1, 65_500, 65_500, 0, 100]);
    }

    #[test]
    fn a_wrong_size_is_refused() {
        assert!(depth([0, 4], 0, &[]).is_err());
        assert!(
            depth([4, 4], 16, &[0; 63])
                .unwrap_err()
                .to_string()
                .contains("63 bytes")
        );
        assert!(depth([4, 4], 15, &[0; 64]).is_err());
    }
}
