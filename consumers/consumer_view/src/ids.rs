//! What an image of object ids holds: a colour for each object, and the box of its pixels.

use consumer_forms::palette::ObjectColours;

/// Fewest pixels of an object that gets a box: fewer are a bumper behind a tree.
const MIN_PIXELS: u32 = 24;

/// The pixels of one object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Extent {
    /// Id of the object.
    pub(crate) id: u32,
    /// Its first column and row.
    pub(crate) min_px: [u32; 2],
    /// The column and row after its last.
    pub(crate) max_px: [u32; 2],
    /// How many pixels it has.
    pub(crate) n_pixels: u32,
}

/// An image of ids, read once.
#[derive(Debug, Default)]
pub(crate) struct Ids {
    /// Numbers of the colours of [`Ids::palette`].
    pub(crate) numbers: Vec<u8>,
    /// Colours of the objects.
    pub(crate) palette: ObjectColours,
    /// Objects in the order in which they were met, without the background.
    pub(crate) extents: Vec<Extent>,
}

impl Ids {
    /// Reads `u32` ids, tightly packed. With more objects than colours some share one.
    pub(crate) fn read(size_px: [u32; 2], ids: &[u8]) -> Ids {
        let width = size_px[0] as usize;
        let mut found = Ids {
            numbers: vec![0; ids.len() / 4],
            palette: ObjectColours::default(),
            extents: Vec::new(),
        };
        let mut known: Vec<(u32, u8, usize)> = Vec::new();
        let rows = ids.chunks_exact((width * 4).max(1));
        let rows = rows.zip(found.numbers.chunks_exact_mut(width.max(1)));
        for (y, (row, numbers)) in rows.enumerate() {
            let mut x = 0;
            while x < width {
                let id = id_at(row, x);
                let first = x;
                while x < width && id_at(row, x) == id {
                    x += 1;
                }
                if id == 0 {
                    continue;
                }
                // Objects are met again soon: the list moves them to its front.
                let at = match known.iter().position(|(known, ..)| *known == id) {
                    Some(0) => 0,
                    Some(at) => {
                        known[..=at].rotate_right(1);
                        0
                    }
                    None => {
                        let number = found.palette.number_of(id);
                        known.insert(0, (id, number, found.extents.len()));
                        found.extents.push(Extent {
                            id,
                            min_px: [u32::MAX; 2],
                            max_px: [0; 2],
                            n_pixels: 0,
                        });
                        0
                    }
                };
                let (_, number, extent) = known[at];
                numbers[first..x].fill(number);
                let extent = &mut found.extents[extent];
                extent.min_px[0] = extent.min_px[0].min(first as u32);
                extent.min_px[1] = extent.min_px[1].min(y as u32);
                extent.max_px[0] = extent.max_px[0].max(x as u32);
                extent.max_px[1] = y as u32 + 1;
                extent.n_pixels += (x - first) as u32;
            }
        }
        found
    }

    /// Objects that are seen well enough for a box.
    pub(crate) fn visible(&self) -> impl Iterator<Item = &Extent> {
        let all = self.extents.iter();
        all.filter(|extent| extent.n_pixels >= MIN_PIXELS)
    }
}

fn id_at(row: &[u8], x: usize) -> u32 {
    let bytes = &row[x * 4..x * 4 + 4];
    u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use consumer_forms::palette;

    fn bytes(ids: &[u32]) -> Vec<u8> {
        ids.iter().flat_map(|id| id.to_le_bytes()).collect()
    }

    #[test]
    fn each_object_has_its_colour_and_the_box_of_its_pixels() {
        #[rustfmt::skip]
        let found = Ids::read([4, 3], &bytes(&[
            0, 7, 7, 9,
            0, 0, 7, 9,
            7, 0, 0, 0,
        ]));
        let colours: Vec<[u8; 3]> = found
            .numbers
            .iter()
            .map(|n| found.palette.colours()[*n as usize])
            .collect();
        let expected = [0, 7, 7, 9, 0, 0, 7, 9, 7, 0, 0, 0].map(palette::object);
        assert_eq!(colours, expected);
        let extent = |id, min_px, max_px, n_pixels| Extent {
            id,
            min_px,
            max_px,
            n_pixels,
        };
        let expected = [extent(7, [0, 0], [3, 3], 4), extent(9, [3, 0], [4, 2], 2)];
        assert_eq!(found.extents, expected);
        assert_eq!(found.visible().count(), 0);
    }
}
