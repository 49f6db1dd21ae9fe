//! Squares of pixels over which motion and brightness are bounded.

use sensor_core::vector_lanes::Lanes;

use super::lanes::{LANES, larger, smaller};

/// Side of a tile, which is also the number of pixels that are followed together.
pub(super) const TILE_PX: usize = LANES;

/// Tiles across and down.
pub(super) fn tiles_of([width, height]: [usize; 2]) -> [usize; 2] {
    [width.div_ceil(TILE_PX), height.div_ceil(TILE_PX)]
}

/// Least and greatest of the numbers of the pixels of tile `tx`; `rows` are rows of `width` numbers.
#[inline(always)]
pub(super) fn numbers_of_tile<L: Lanes>(rows: &[f32], width: usize, tx: usize) -> (f32, f32) {
    let begin = tx * TILE_PX;
    let (mut low, mut high) = (L::splat(f32::INFINITY), L::splat(f32::NEG_INFINITY));
    if begin + TILE_PX <= width {
        for row in rows.chunks_exact(width) {
            let numbers = L::load(row[begin..].first_chunk().expect("a whole tile"));
            (low, high) = (numbers.min(low), numbers.max(high));
        }
        return (low.smallest(), high.largest());
    }
    let all = rows.chunks_exact(width).flat_map(|row| &row[begin..]);
    all.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), number| {
        (smaller(*number, low), larger(*number, high))
    })
}

/// Bounding box of motions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Range {
    pub low: [f32; 2],
    pub high: [f32; 2],
}

impl Range {
    /// That of no motion at all.
    pub const EMPTY: Range = Range {
        low: [f32::INFINITY; 2],
        high: [f32::NEG_INFINITY; 2],
    };

    /// Of one motion.
    pub fn of(motion: [f32; 2]) -> Range {
        Range {
            low: motion,
            high: motion,
        }
    }

    /// Of the motions of the pixels of tile `tx`; `rows` are rows of `width` motions.
    #[inline(always)]
    pub fn of_tile<L: Lanes>(rows: &[[f32; 2]], width: usize, tx: usize) -> Range {
        let begin = tx * TILE_PX;
        if begin + TILE_PX > width {
            let all = rows.chunks_exact(width).flat_map(|row| &row[begin..]);
            return all.fold(Range::EMPTY, |range, motion| {
                range.with(&Range::of(*motion))
            });
        }
        let (mut low, mut high) = (
            [L::splat(f32::INFINITY); 2],
            [L::splat(f32::NEG_INFINITY); 2],
        );
        for row in rows.chunks_exact(width) {
            let motions = row[begin..].first_chunk().expect("a whole tile");
            let motions = L::unzip(motions);
            for axis in 0..2 {
                low[axis] = motions[axis].min(low[axis]);
                high[axis] = motions[axis].max(high[axis]);
            }
        }
        Range {
            low: [low[0].smallest(), low[1].smallest()],
            high: [high[0].largest(), high[1].largest()],
        }
    }

    /// Bounding box of both.
    #[inline(always)]
    pub fn with(&self, other: &Range) -> Range {
        Range {
            low: [0, 1].map(|axis| smaller(self.low[axis], other.low[axis])),
            high: [0, 1].map(|axis| larger(self.high[axis], other.high[axis])),
        }
    }

    /// Square of an upper bound of their lengths.
    pub fn fastest2(&self) -> f32 {
        let far = [0, 1].map(|axis: usize| larger(-self.low[axis], self.high[axis]));
        far[0] * far[0] + far[1] * far[1]
    }

    /// A lower bound of their lengths.
    pub fn slowest(&self) -> f32 {
        let near = [0, 1].map(|axis: usize| larger(larger(self.low[axis], -self.high[axis]), 0.0));
        (near[0] * near[0] + near[1] * near[1]).sqrt()
    }

    /// An upper bound of the distance between two of them.
    pub fn spread(&self) -> f32 {
        let side = [0, 1].map(|axis: usize| self.high[axis] - self.low[axis]);
        (side[0] * side[0] + side[1] * side[1]).sqrt()
    }
}

/// Tiles that a rectangle of the image touches.
#[derive(Clone, Copy, Debug)]
pub(super) struct TileBox {
    pub x: [usize; 2],
    pub y: [usize; 2],
}

impl TileBox {
    /// Of the rectangle from `least` to `greatest` (pixels), clamped to the image.
    #[inline(always)]
    pub fn around(tiles: [usize; 2], [least, greatest]: [[f32; 2]; 2]) -> TileBox {
        let tile = |position: f32, axis: usize| {
            ((position.clamp(0.0, 1e6) * (1.0 / TILE_PX as f32)) as i32 as usize)
                .min(tiles[axis] - 1)
        };
        TileBox {
            x: [tile(least[0], 0), tile(greatest[0], 0)],
            y: [tile(least[1], 1), tile(greatest[1], 1)],
        }
    }

    /// Indices of its tiles, row by row.
    #[inline(always)]
    pub fn rows(self, tiles: [usize; 2]) -> impl Iterator<Item = std::ops::Range<usize>> {
        (self.y[0]..=self.y[1]).map(move |y| y * tiles[0] + self.x[0]..y * tiles[0] + self.x[1] + 1)
    }
}
