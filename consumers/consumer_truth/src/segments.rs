//! Segments: the pixels of one id, or of one id and class, in an instance image.

use std::collections::BTreeMap;

/// The pixels that show one object, or one class of its parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Segment {
    /// Object id: an actor's, or with bit 31 that of an object of the map.
    pub id: u32,
    /// Class of these pixels; `None` if there is no semantic image.
    pub class: Option<u8>,
    /// Number of pixels.
    pub n_pixels: u64,
    /// Smallest rectangle round them: first column, first row, column behind the last, row behind
    /// the last.
    pub bounds: [u32; 4],
}

/// All segments of an image by id and class, without the background. With a semantic image, pixels
/// of one id that have several classes (a motorcycle and its rider) are segments of their own.
/// Images are tight, `width` pixels a row.
pub fn segments(instance: &[u32], semantic: Option<&[u8]>, width: u32) -> Vec<Segment> {
    let mut found: BTreeMap<(u32, Option<u8>), Segment> = BTreeMap::new();
    for (row, ids) in instance.chunks_exact(width as usize).enumerate() {
        let start = row * width as usize;
        let class_at = |column: usize| semantic.map(|classes| classes[start + column]);
        let mut from = 0;
        while from < ids.len() {
            let (id, class) = (ids[from], class_at(from));
            let mut to = from + 1;
            while to < ids.len() && ids[to] == id && class_at(to) == class {
                to += 1;
            }
            if id != 0 {
                let row = row as u32;
                let segment = found.entry((id, class)).or_insert(Segment {
                    id,
                    class,
                    n_pixels: 0,
                    bounds: [u32::MAX, row, 0, row + 1],
                });
                segment.n_pixels += (to - from) as u64;
                segment.bounds[0] = segment.bounds[0].min(from as u32);
                segment.bounds[2] = segment.bounds[2].max(to as u32);
                segment.bounds[3] = row + 1;
            }
            from = to;
        }
    }
    found.into_values().collect()
}

/// Segments of all classes of one id joined: pixels and rectangle by id.
pub fn by_id(segments: &[Segment]) -> BTreeMap<u32, (u64, [u32; 4])> {
    let mut joined: BTreeMap<u32, (u64, [u32; 4])> = BTreeMap::new();
    for segment in segments {
        let (n_pixels, bounds) = joined.entry(segment.id).or_insert((0, segment.bounds));
        *n_pixels += segment.n_pixels;
        let b = segment.bounds;
        *bounds = [
            bounds[0].min(b[0]),
            bounds[1].min(b[1]),
            bounds[2].max(b[2]),
            bounds[3].max(b[3]),
        ];
    }
    joined
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_id_with_two_classes_is_two_segments_and_one_object() {
        let ids = [0, 7, 7, 0, 0, 7, 7, 9, 0, 0, 7, 9];
        let classes = [11, 18, 13, 11, 11, 18, 18, 14, 11, 11, 18, 14];
        let found = segments(&ids, Some(&classes), 4);
        let expected = |id, class, n_pixels, bounds| Segment {
            id,
            class: Some(class),
            n_pixels,
            bounds,
        };
        assert_eq!(
            found,
            [
                expected(7, 13, 1, [2, 0, 3, 1]),
                expected(7, 18, 4, [1, 0, 3, 3]),
                expected(9, 14, 2, [3, 1, 4, 3]),
            ]
        );
        assert_eq!(by_id(&found)[&7], (5, [1, 0, 3, 3]));
        assert_eq!(segments(&ids, None, 4).len(), 2);
    }
}
