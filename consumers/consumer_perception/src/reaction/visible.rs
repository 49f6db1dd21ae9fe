//! What of an object a camera shows: its pixels by label, and which of them light falls on.

/// What an image shows of one object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Shown {
    /// Pixels with its label.
    pub pixels: u32,
    /// Those of them that can be made out: they or a pixel beside them are bright enough.
    pub visible: u32,
    /// Rectangle round the visible ones: first column and row, column and row behind the last; all
    /// zero if there are none.
    pub bounds: [u32; 4],
}

/// What a tight image of labels, `width` pixels a row, shows of the object `id`. `bgra` is the
/// colour image of the same camera and tick; a pixel is bright enough if its luma is `min_luma` or
/// more. Without a colour image every pixel can be made out.
///
/// A dark object before a bright wall is visible by its outline, so the pixels beside one count as
/// well; in darkness all round nothing can be seen of it, though its label is there.
pub fn shown(ids: &[u32], width: u32, id: u32, bgra: Option<&[u8]>, min_luma: u8) -> Shown {
    let columns = width as usize;
    if columns == 0 {
        return Shown::default();
    }
    let rows = ids.len() / columns;
    let bright = |row: usize, column: usize| {
        bgra.is_none_or(|bgra| {
            let at = (row * columns + column) * 4;
            bgra.get(at..at + 3)
                .is_some_and(|pixel| luma([pixel[2], pixel[1], pixel[0]]) >= f32::from(min_luma))
        })
    };
    let mut shown = Shown::default();
    for row in 0..rows {
        let line = &ids[row * columns..(row + 1) * columns];
        for (column, _) in line.iter().enumerate().filter(|(_, found)| **found == id) {
            shown.pixels += 1;
            let around = (row.saturating_sub(1)..=(row + 1).min(rows - 1)).any(|row| {
                (column.saturating_sub(1)..=(column + 1).min(columns - 1))
                    .any(|column| bright(row, column))
            });
            if !around {
                continue;
            }
            let (x, y) = (column as u32, row as u32);
            if shown.visible == 0 {
                shown.bounds = [x, y, x + 1, y + 1];
            }
            shown.visible += 1;
            let [left, top, right, bottom] = &mut shown.bounds;
            (*left, *top) = ((*left).min(x), (*top).min(y));
            (*right, *bottom) = ((*right).max(x + 1), (*bottom).max(y + 1));
        }
    }
    shown
}

/// Brightness of a pixel as it is displayed, 0 to 255: the luma of ITU-R BT.709.
fn luma([r, g, b]: [u8; 3]) -> f32 {
    0.2126 * f32::from(r) + 0.7152 * f32::from(g) + 0.0722 * f32::from(b)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Five columns, three rows; the object 7 has three pixels.
    const IDS: [u32; 15] = [0, 0, 0, 0, 0, 0, 7, 7, 0, 0, 0, 0, 7, 0, 0];

    fn grey(lit: &[usize]) -> Vec<u8> {
        let at = |pixel: usize| if lit.contains(&pixel) { 200 } else { 3 };
        (0..15)
            .flat_map(|pixel| [at(pixel), at(pixel), at(pixel), 255])
            .collect()
    }

    #[test]
    fn without_a_colour_image_every_labelled_pixel_is_visible() {
        let expected = Shown {
            pixels: 3,
            visible: 3,
            bounds: [1, 1, 3, 3],
        };
        assert_eq!(shown(&IDS, 5, 7, None, 16), expected);
        assert_eq!(shown(&IDS, 5, 8, None, 16), Shown::default());
    }

    #[test]
    fn in_the_dark_there_are_labels_and_nothing_to_see() {
        let seen = shown(&IDS, 5, 7, Some(&grey(&[])), 16);
        assert_eq!((seen.pixels, seen.visible, seen.bounds), (3, 0, [0; 4]));
        // A light far from it changes nothing.
        assert_eq!(shown(&IDS, 5, 7, Some(&grey(&[4])), 16).visible, 0);
    }

    #[test]
    fn a_dark_pixel_beside_a_bright_one_shows_as_an_outline() {
        // The pixel in the last row's fourth column touches two of the object's.
        let seen = shown(&IDS, 5, 7, Some(&grey(&[13])), 16);
        assert_eq!(
            (seen.pixels, seen.visible, seen.bounds),
            (3, 2, [2, 1, 3, 3])
        );
        // One of its own pixels is lit: all three touch it.
        assert_eq!(shown(&IDS, 5, 7, Some(&grey(&[7])), 16).visible, 3);
    }
}
