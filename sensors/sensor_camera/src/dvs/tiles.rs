//! Squares of pixels over which motion and brightness are bounded.

use sensor_core::vector::{VectorWork, vectorised};

use super::lanes::{LANES, larger, smaller};

/// Side of a tile, which is also the number of pixels that are followed together.
pub(super) const TILE_PX: usize = LANES;

/// Tiles across and down.
pub(super) fn tiles_of([width, height]: [usize; 2]) -> [usize; 2] {
    [width.div_ceil(TILE_PX), height.div_ceil(TILE_PX)]
}

/// Least and greatest number at each of the `N` places of a tile's rows, for the tiles of row `ty`.
/// There are `N / 8` numbers per pixel.
pub(super) fn row_ranges<const N: usize>(
    numbers: &[f32],
    [width, height]: [usize; 2],
    ty: usize,
) -> Vec<([f32; N], [f32; N])> {
    let row = width * (N / TILE_PX);
    let rows = ty * TILE_PX..(ty * TILE_PX + TILE_PX).min(height);
    let mut ranges = vec![([f32::INFINITY; N], [f32::NEG_INFINITY; N]); width.div_ceil(TILE_PX)];
    for y in rows {
        vectorised(RowRanges {
            numbers: &numbers[y * row..(y + 1) * row],
            ranges: &mut ranges,
        });
    }
    ranges
}

struct RowRanges<'a, const N: usize> {
    numbers: &'a [f32],
    ranges: &'a mut [([f32; N], [f32; N])],
}

impl<const N: usize> VectorWork for RowRanges<'_, N> {
    type Out = ();

    #[inline(always)]
    fn run(self) {
        for (numbers, (low, high)) in self.numbers.chunks(N).zip(self.ranges) {
            if numbers.len() == N {
                for i in 0..N {
                    low[i] = smaller(numbers[i], low[i]);
                    high[i] = larger(numbers[i], high[i]);
                }
            } else {
                for (i, number) in numbers.iter().enumerate() {
                    low[i] = smaller(*number, low[i]);
                    high[i] = larger(*number, high[i]);
                }
            }
        }
    }
}

/// Bounding box of motions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Range {
    pub low: [f32; 2],
    pub high: [f32; 2],
}

impl Range {
    /// From the result of [`row_ranges`] for a tile's motions.
    pub fn of((low, high): &([f32; 16], [f32; 16])) -> Range {
        let fold = |numbers: &[f32; 16], axis: usize, pick: fn(f32, f32) -> f32| {
            numbers
                .iter()
                .skip(axis)
                .step_by(2)
                .copied()
                .reduce(pick)
                .unwrap_or(0.0)
        };
        Range {
            low: [0, 1].map(|axis| fold(low, axis, smaller)),
            high: [0, 1].map(|axis| fold(high, axis, larger)),
        }
    }

    /// Bounding box of both.
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
