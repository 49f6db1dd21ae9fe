//! Glyphs of eight by eight dots, as runs of dots.

use font8x8::legacy::{
    BASIC_LEGACY, BLOCK_LEGACY, BOX_LEGACY, GREEK_LEGACY, HIRAGANA_LEGACY, LATIN_LEGACY,
};

/// Dots along a side of a glyph.
pub(super) const GLYPH_PX: u32 = 8;

/// What stands for letters without a glyph.
const UNKNOWN: [u8; 8] = [0x7e, 0x42, 0x42, 0x42, 0x42, 0x42, 0x7e, 0];

/// Dots beside one another in a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Run {
    pub row: u32,
    pub column: u32,
    pub n: u32,
}

/// The dots of a letter.
pub(super) fn runs(letter: char) -> impl Iterator<Item = Run> {
    let rows = glyph(letter);
    (0..GLYPH_PX).flat_map(move |row| {
        let dots = rows[row as usize];
        let is_set = move |column: u32| column < GLYPH_PX && dots >> column & 1 == 1;
        let begins = move |column: &u32| is_set(*column) && (*column == 0 || !is_set(column - 1));
        (0..GLYPH_PX).filter(begins).map(move |column| Run {
            row,
            column,
            n: (column..GLYPH_PX).take_while(|c| is_set(*c)).count() as u32,
        })
    })
}

/// Rows from the top; the lowest bit is the leftmost dot.
fn glyph(letter: char) -> [u8; 8] {
    let pages: [(u32, &[[u8; 8]]); 6] = [
        (0x0000, &BASIC_LEGACY),
        (0x00a0, &LATIN_LEGACY),
        (0x0390, &GREEK_LEGACY),
        (0x2500, &BOX_LEGACY),
        (0x2580, &BLOCK_LEGACY),
        (0x3040, &HIRAGANA_LEGACY),
    ];
    let place = |(first, glyphs): &(u32, &[[u8; 8]])| {
        glyphs
            .get(u32::from(letter).checked_sub(*first)? as usize)
            .copied()
    };
    pages.iter().find_map(place).unwrap_or(UNKNOWN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_the_dots_of_the_glyph() {
        for letter in ['A', '#', 'é', 'Ω', '─', 'あ', '車'] {
            let mut rows = [0u8; 8];
            for run in runs(letter) {
                assert!(run.n > 0 && run.column + run.n <= GLYPH_PX);
                for column in run.column..run.column + run.n {
                    rows[run.row as usize] |= 1 << column;
                }
            }
            assert_eq!(rows, glyph(letter), "{letter}");
        }
        assert_eq!(glyph('車'), UNKNOWN);
        assert_ne!(glyph('é'), UNKNOWN);
        assert_eq!(runs(' ').count(), 0);
    }
}
