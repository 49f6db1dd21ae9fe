//! A picture as the event camera follows it: levels, motion, depth, and how bright each tile is at
//! most and at least.

use rayon::prelude::*;

use sensor_core::vector::{VectorWork, vectorised};
use sensor_spec::{DvsMode, DvsSpec};

use super::block::{LANES, Lanes};
use super::tiles::{TILE_PX, row_ranges, tiles_of};
use super::{EventImages, float};

/// A rendered picture with its motion.
#[derive(Debug)]
pub(super) struct Picture {
    pub size_px: [usize; 2],
    /// What thresholds are compared with.
    pub level: Vec<f32>,
    /// `level` of each pixel and its neighbours to the right, below, and both (rims repeat): what a
    /// bilinear sample needs, in one load.
    pub quads: Vec<[f32; 4]>,
    /// Motion since the previous firing, pixels.
    pub flow: Vec<[f32; 2]>,
    /// Metres; +∞ is the sky.
    pub depth: Vec<f32>,
    /// Bounds of the levels.
    pub bounds: Bounds,
}

impl Picture {
    /// A picture of this size; [`Picture::read`] fills it.
    pub fn blank(size_px: [usize; 2]) -> Picture {
        let n = size_px[0] * size_px[1];
        Picture {
            size_px,
            level: vec![0.0; n],
            quads: vec![[0.0; 4]; n],
            flow: vec![[0.0; 2]; n],
            depth: vec![0.0; n],
            bounds: Bounds::blank(size_px),
        }
    }

    /// Takes over what the GPU left.
    pub fn read(&mut self, images: &EventImages<'_>, spec: &DvsSpec) {
        let width = self.size_px[0];
        let with_motion = spec.mode == DvsMode::Motion;
        let picture = &mut *self;
        let rows = picture
            .level
            .par_chunks_mut(width)
            .zip(picture.flow.par_chunks_mut(width))
            .zip(picture.depth.par_chunks_mut(width));
        rows.enumerate().for_each(|(y, ((level, flow), depth))| {
            vectorised(LevelsOf {
                luminance: images.luminance.row(y),
                level,
                spec,
            });
            if with_motion {
                for (flow, bytes) in flow.iter_mut().zip(images.flow.row(y).chunks_exact(8)) {
                    *flow = [float(&bytes[..4]), float(&bytes[4..])];
                }
                for (depth, bytes) in depth.iter_mut().zip(images.depth.row(y).chunks_exact(4)) {
                    *depth = float(bytes);
                }
            }
        });
        if with_motion {
            self.fill_quads();
            self.bounds.fill(&self.level, self.size_px);
        }
    }

    fn fill_quads(&mut self) {
        let [width, height] = self.size_px;
        let log = &self.level;
        self.quads
            .par_chunks_mut(width)
            .enumerate()
            .for_each(|(y, quads)| {
                let below = (y + 1).min(height - 1);
                let (upper, lower) = (
                    &log[y * width..(y + 1) * width],
                    &log[below * width..(below + 1) * width],
                );
                for ((quad, upper), lower) in
                    quads.iter_mut().zip(upper.windows(2)).zip(lower.windows(2))
                {
                    *quad = [upper[0], upper[1], lower[0], lower[1]];
                }
                quads[width - 1] = [
                    upper[width - 1],
                    upper[width - 1],
                    lower[width - 1],
                    lower[width - 1],
                ];
            });
    }

    /// Bilinear brightness at several positions, each moved into the image if it is outside.
    #[inline(always)]
    pub fn levels_at(&self, at: &[Lanes; 2]) -> Lanes {
        let [width, height] = self.size_px;
        let (right, bottom, stride) = ((width - 1) as f32, (height - 1) as f32, width as i32);
        let (mut idx, mut fx, mut fy) = ([0_i32; LANES], [0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            let (x, y) = (
                smaller(larger(at[0][lane] - 0.5, 0.0), right),
                smaller(larger(at[1][lane] - 0.5, 0.0), bottom),
            );
            let (x0, y0) = (floor(x), floor(y));
            (fx[lane], fy[lane]) = (x - x0, y - y0);
            idx[lane] = integer(y0).wrapping_mul(stride).wrapping_add(integer(x0));
        }
        let quads: [[f32; 4]; LANES] =
            std::array::from_fn(|lane| self.quads[idx[lane] as u32 as usize]);
        std::array::from_fn(|lane| {
            let [a, b, c, d] = quads[lane];
            let (upper, lower) = (a + (b - a) * fx[lane], c + (d - c) * fx[lane]);
            upper + (lower - upper) * fy[lane]
        })
    }

    /// Bilinear brightness at a position (pixel centres at halves); `None` outside.
    pub fn level_at(&self, x_px: f32, y_px: f32) -> Option<f32> {
        let [width, height] = self.size_px;
        if !(x_px >= 0.0 && y_px >= 0.0 && x_px <= width as f32 && y_px <= height as f32) {
            return None;
        }
        let (x, y) = (
            (x_px - 0.5).max(0.0).min((width - 1) as f32),
            (y_px - 0.5).max(0.0).min((height - 1) as f32),
        );
        // Through i32: a conversion to usize costs a branch for numbers beyond 2⁶³.
        let (x0, y0) = (x as i32, y as i32);
        let (fx, fy) = (x - x0 as f32, y - y0 as f32);
        let (x0, y0) = (x0 as usize, y0 as usize);
        let (x1, y1) = ((x0 + 1).min(width - 1), (y0 + 1).min(height - 1));
        let row = |y: usize| {
            let row = &self.level[y * width..(y + 1) * width];
            row[x0] + (row[x1] - row[x0]) * fx
        };
        let (low, high) = (row(y0), row(y1));
        Some(low + (high - low) * fy)
    }

    /// Index of the pixel at a position; `None` outside.
    #[inline(always)]
    pub fn index_at(&self, x_px: f32, y_px: f32) -> Option<usize> {
        let [width, height] = self.size_px;
        let inside = (x_px >= 0.0) & (y_px >= 0.0) & (x_px < width as f32) & (y_px < height as f32);
        // Through i32: a conversion to usize costs a branch for numbers beyond 2⁶³.
        inside.then(|| (y_px as i32 as usize) * width + x_px as i32 as usize)
    }
}

/// A row of luminance to levels.
struct LevelsOf<'a> {
    luminance: &'a [u8],
    level: &'a mut [f32],
    spec: &'a DvsSpec,
}

impl VectorWork for LevelsOf<'_> {
    type Out = ();

    #[inline(always)]
    fn run(self) {
        let LevelsOf {
            luminance,
            level,
            spec,
        } = self;
        let rows = level.iter_mut().zip(luminance.chunks_exact(4));
        // CARLA's model looks at the picture's 8-bit colours, which are encoded for the eye.
        match (spec.mode, spec.use_log) {
            (DvsMode::Motion, true) => {
                rows.for_each(|(level, bytes)| *level = ln(float(bytes) + spec.log_eps))
            }
            (DvsMode::Motion, false) => {
                rows.for_each(|(level, bytes)| *level = 255.0 * float(bytes))
            }
            (DvsMode::TwoFrame, true) => {
                rows.for_each(|(level, bytes)| *level = ln(encoded(float(bytes)) + spec.log_eps))
            }
            (DvsMode::TwoFrame, false) => {
                rows.for_each(|(level, bytes)| *level = 255.0 * encoded(float(bytes)))
            }
        }
    }
}

/// sRGB's encoding of a linear value, 0 to 1.
fn encoded(linear: f32) -> f32 {
    let linear = linear.clamp(0.0, 1.0);
    if linear <= 0.003_130_8 {
        12.92 * linear
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    }
}

/// Natural logarithm of a positive finite number, to 2e-7 of it or of 1, in arithmetic that every
/// processor has for several numbers at once.
///
/// The mantissa m in √½..√2 by ln m = 2 artanh((m − 1) / (m + 1)), of which seven terms are more
/// than `f32` holds.
#[inline(always)]
pub(super) fn ln(x: f32) -> f32 {
    const SQRT_HALF: i32 = 0x3f35_04f3;
    let bits = x.to_bits() as i32;
    let exponent = (bits - SQRT_HALF) >> 23;
    let m = f32::from_bits((bits - (exponent << 23)) as u32);
    let s = (m - 1.0) / (m + 1.0);
    let s2 = s * s;
    let series = 1.0 + s2 * (1.0 / 3.0 + s2 * (1.0 / 5.0 + s2 * (1.0 / 7.0 + s2 * (1.0 / 9.0))));
    exponent as f32 * std::f32::consts::LN_2 + 2.0 * s * series
}

/// Numbers from 0 to 2²² have their whole part in the last bits after adding this.
const WHOLE: f32 = 8_388_608.0;

/// Whole part of a number from 0 to 2²², in arithmetic that every processor has for several numbers
/// at once (unlike conversions).
#[inline(always)]
fn floor(x: f32) -> f32 {
    let nearest = (x + WHOLE) - WHOLE;
    if nearest > x { nearest - 1.0 } else { nearest }
}

/// A whole number from 0 to 2²² as an integer.
#[inline(always)]
fn integer(whole: f32) -> i32 {
    ((whole + WHOLE).to_bits() & 0x7f_ffff) as i32
}

/// As `f32::max` without its care for NaN, which costs as much again; a NaN in `a` gives `b`.
#[inline(always)]
pub(super) fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// As [`larger`], for the smaller one.
#[inline(always)]
pub(super) fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Darkest and brightest level of each tile.
#[derive(Debug)]
pub(super) struct Bounds {
    tiles: [usize; 2],
    range: Vec<(f32, f32)>,
}

impl Bounds {
    fn blank(size_px: [usize; 2]) -> Bounds {
        let tiles = tiles_of(size_px);
        Bounds {
            tiles,
            range: vec![(0.0, 0.0); tiles[0] * tiles[1]],
        }
    }

    fn fill(&mut self, level: &[f32], size_px: [usize; 2]) {
        let tiles = self.tiles;
        self.range
            .par_chunks_mut(tiles[0])
            .enumerate()
            .for_each(|(ty, ranges)| {
                let found = row_ranges::<8>(level, size_px, ty);
                for (range, (low, high)) in ranges.iter_mut().zip(found) {
                    *range = (
                        low.into_iter().reduce(smaller).unwrap_or(0.0),
                        high.into_iter().reduce(larger).unwrap_or(0.0),
                    );
                }
            });
    }

    /// Bounds over the tiles of a rectangle given by its least and greatest corner (clamped to the
    /// image).
    #[inline(always)]
    pub fn within(&self, [least, greatest]: [[f32; 2]; 2]) -> (f32, f32) {
        let tile = |position: f32, axis: usize| {
            ((position.clamp(0.0, 1e6) * (1.0 / TILE_PX as f32)) as i32 as usize)
                .min(self.tiles[axis] - 1)
        };
        // One pixel more on each side: bilinear samples reach over the rim.
        let (x0, x1) = (tile(least[0] - 1.0, 0), tile(greatest[0] + 1.0, 0));
        let (y0, y1) = (tile(least[1] - 1.0, 1), tile(greatest[1] + 1.0, 1));
        let mut bounds = (f32::INFINITY, f32::NEG_INFINITY);
        for y in y0..=y1 {
            for (low, high) in &self.range[y * self.tiles[0] + x0..=y * self.tiles[0] + x1] {
                bounds = (smaller(*low, bounds.0), larger(*high, bounds.1));
            }
        }
        bounds
    }
}
