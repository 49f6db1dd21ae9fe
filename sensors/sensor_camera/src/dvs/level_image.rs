//! An image as the event camera uses it: levels, motion, depth, and the darkest and brightest level
//! of each tile.

use rayon::prelude::*;

use sensor_core::vector::{VectorWork, vectorised};
use sensor_spec::{DvsMode, DvsSpec};

use super::images::{EventImages, float};
use super::lanes::{LANES, Lanes, floor, integer, larger, ln, smaller};
use super::tiles::{TILE_PX, row_ranges, tiles_of};

/// A rendered image with its motion.
#[derive(Debug)]
pub(super) struct LevelImage {
    pub size_px: [usize; 2],
    /// The values that thresholds are compared with.
    pub level: Vec<f32>,
    /// `level` of each pixel and of its neighbours to the right, below, and both (edges repeat):
    /// all that a bilinear sample needs, in one load.
    pub quads: Vec<[f32; 4]>,
    /// Motion since the previous firing, pixels.
    pub flow: Vec<[f32; 2]>,
    /// Metres; +∞ is the sky.
    pub depth: Vec<f32>,
    /// Bounds of the levels.
    pub bounds: Bounds,
}

impl LevelImage {
    /// An image of this size; [`LevelImage::read`] fills it.
    pub fn blank(size_px: [usize; 2]) -> LevelImage {
        let n = size_px[0] * size_px[1];
        LevelImage {
            size_px,
            level: vec![0.0; n],
            quads: vec![[0.0; 4]; n],
            flow: vec![[0.0; 2]; n],
            depth: vec![0.0; n],
            bounds: Bounds::blank(size_px),
        }
    }

    /// Reads the images that the GPU rendered.
    pub fn read(&mut self, images: &EventImages<'_>, spec: &DvsSpec) {
        let width = self.size_px[0];
        let with_motion = spec.mode == DvsMode::Motion;
        let image = &mut *self;
        let rows = image
            .level
            .par_chunks_mut(width)
            .zip(image.flow.par_chunks_mut(width))
            .zip(image.depth.par_chunks_mut(width));
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

    /// Bilinear level at several positions, each clamped to the image.
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

    /// Bilinear level at a position (pixel centres at halves); `None` outside.
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
        // CARLA's model uses the image's 8-bit colours, which are gamma-encoded.
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
