//! Images in another size.

use crate::screen::Picture;

/// The largest size with the shape of `of` that fits into `into`, and where its corner is, so that
/// it lies in the middle.
pub(super) fn fit(of: [u32; 2], into: [u32; 2]) -> ([u32; 2], [u32; 2]) {
    let [w, h] = of.map(|side| u64::from(side.max(1)));
    let [room_w, room_h] = into.map(u64::from);
    let size = if room_w * h <= room_h * w {
        [room_w, (room_w * h / w).max(1)]
    } else {
        [(room_h * w / h).max(1), room_h]
    };
    let size = [size[0].min(room_w), size[1].min(room_h)];
    let corner = [(room_w - size[0]) / 2, (room_h - size[1]) / 2];
    (size.map(|side| side as u32), corner.map(|side| side as u32))
}

/// The image in another size: each pixel is the mean of those that it covers, or the nearest where
/// it covers less than one. Rows lie without gaps; `None` if the image's bytes are too few.
pub(super) fn scaled(picture: &Picture<'_>, size: [u32; 2]) -> Option<Vec<[u8; 4]>> {
    let spans = |from: u32, to: u32| -> Vec<[usize; 2]> {
        let at = |i: u64| (i * u64::from(from) / u64::from(to)) as usize;
        (0..u64::from(to))
            .map(|i| [at(i), at(i + 1).max(at(i) + 1)])
            .collect()
    };
    let columns = spans(picture.width_px, size[0]);
    let mut pixels = Vec::with_capacity(size[0] as usize * size[1] as usize);
    for [top, bottom] in spans(picture.height_px, size[1]) {
        let rows: Vec<&[[u8; 4]]> = (top..bottom)
            .map(|y| picture.row(y as u32))
            .collect::<Option<_>>()?;
        for [left, right] in &columns {
            let mut sum = [0u32; 3];
            for pixel in rows.iter().flat_map(|row| &row[*left..*right]) {
                (0..3).for_each(|i| sum[i] += u32::from(pixel[i]));
            }
            let n = (rows.len() * (right - left)) as u32;
            let [b, g, r] = sum.map(|sum| ((sum + n / 2) / n) as u8);
            pixels.push([b, g, r, 255]);
        }
    }
    Some(pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_keeps_its_shape_in_the_middle() {
        assert_eq!(fit([1280, 720], [640, 480]), ([640, 360], [0, 60]));
        assert_eq!(fit([1280, 720], [1000, 360]), ([640, 360], [180, 0]));
        assert_eq!(fit([4096, 16], [10, 10]), ([10, 1], [0, 4]));
    }

    #[test]
    fn smaller_pixels_are_means_and_larger_ones_the_nearest() {
        let bytes: Vec<u8> = (0..8u8).flat_map(|i| [i * 10, 0, 100, 255]).collect();
        let picture = Picture {
            width_px: 4,
            height_px: 2,
            stride_bytes: 16,
            bgra: &bytes,
        };
        let small = scaled(&picture, [2, 1]).unwrap();
        assert_eq!(small, [[25, 0, 100, 255], [45, 0, 100, 255]]);
        let large = scaled(&picture, [8, 2]).unwrap();
        assert_eq!(
            large[..4],
            [
                [0, 0, 100, 255],
                [0, 0, 100, 255],
                [10, 0, 100, 255],
                [10, 0, 100, 255]
            ]
        );
        let torn = Picture {
            bgra: &bytes[..20],
            ..picture
        };
        assert_eq!(scaled(&torn, [2, 1]), None);
    }
}
