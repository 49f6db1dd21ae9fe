//! An image as the event camera uses it: levels, motion, depth, and the bounds of levels and of
//! motion in each tile.

use rayon::prelude::*;

use sensor_core::vector_lanes::{LaneWork, Lanes, in_lanes};
use sensor_spec::{DvsMode, DvsSpec};

use super::images::{EventImages, float};
use super::lanes::{larger, ln, smaller};
use super::stage::EVENTS;
use super::tiles::{Range, TILE_PX, TileBox, numbers_of_tile, tiles_of};

/// A rendered image with its motion.
#[derive(Debug)]
pub(super) struct LevelImage {
    pub size_px: [usize; 2],
    /// The values that thresholds are compared with, and a row and a number of zeros behind them,
    /// so that every pixel has neighbours to the right and below.
    pub level: Vec<f32>,
    /// Motion since the previous firing, pixels.
    pub flow: Vec<[f32; 2]>,
    /// Metres; +∞ is the sky.
    pub depth: Vec<f32>,
    /// Darkest and brightest level of each tile.
    bounds: Vec<(f32, f32)>,
    /// Bounding box of the motions of each tile.
    pub motions: Vec<Range>,
}

impl LevelImage {
    /// An image of this size; [`LevelImage::read`] fills it.
    pub fn blank(size_px: [usize; 2]) -> LevelImage {
        let [width, height] = size_px;
        let n = width * height;
        let tiles = tiles_of(size_px);
        LevelImage {
            size_px,
            level: vec![0.0; n + width + 1],
            flow: vec![[0.0; 2]; n],
            depth: vec![0.0; n],
            bounds: vec![(0.0, 0.0); tiles[0] * tiles[1]],
            motions: vec![Range::EMPTY; tiles[0] * tiles[1]],
        }
    }

    /// Reads the images that the GPU rendered.
    pub fn read(&mut self, images: &EventImages<'_>, spec: &DvsSpec) {
        let [width, height] = self.size_px;
        let n_tiles = width.div_ceil(TILE_PX);
        let rows = self.level[..width * height]
            .par_chunks_mut(TILE_PX * width)
            .zip(self.flow.par_chunks_mut(TILE_PX * width))
            .zip(self.depth.par_chunks_mut(TILE_PX * width))
            .zip(self.bounds.par_chunks_mut(n_tiles))
            .zip(self.motions.par_chunks_mut(n_tiles));
        rows.enumerate().for_each_init(
            || EVENTS.span(),
            |_span, (ty, ((((level, flow), depth), bounds), motions))| {
                in_lanes(TileRow {
                    first: ty * TILE_PX,
                    images,
                    spec,
                    width,
                    level,
                    flow,
                    depth,
                    bounds,
                    motions,
                });
            },
        );
    }

    /// Bilinear level at several positions, each clamped to the image.
    #[inline(always)]
    pub fn levels_at<L: Lanes>(&self, at: [L; 2]) -> L {
        let [width, height] = self.size_px;
        let clamped = |at: L, size: usize| {
            at.sub(L::splat(0.5))
                .max(L::splat(0.0))
                .min(L::splat((size - 1) as f32))
        };
        let (x, y) = (clamped(at[0], width), clamped(at[1], height));
        let (x0, y0) = (x.whole(), y.whole());
        let (fx, fy) = (x.sub(x0), y.sub(y0));
        let places = L::places(x0, y0, width as u32);
        let [a, b] = L::pairs(&self.level, &places);
        let [c, d] = L::pairs(&self.level[width..], &places);
        let (upper, lower) = (a.add(b.sub(a).mul(fx)), c.add(d.sub(c).mul(fx)));
        upper.add(lower.sub(upper).mul(fy))
    }

    /// Bilinear level at a position (pixel centres at halves); `None` outside.
    #[inline(always)]
    pub fn level_at(&self, x_px: f32, y_px: f32) -> Option<f32> {
        let [width, height] = self.size_px;
        if !((x_px >= 0.0) & (y_px >= 0.0) & (x_px <= width as f32) & (y_px <= height as f32)) {
            return None;
        }
        let x = smaller(larger(x_px - 0.5, 0.0), (width - 1) as f32);
        let y = smaller(larger(y_px - 0.5, 0.0), (height - 1) as f32);
        // Through i32: a conversion to usize costs a branch for numbers beyond 2⁶³.
        let (x0, y0) = (x as i32, y as i32);
        let (fx, fy) = (x - x0 as f32, y - y0 as f32);
        let at = y0 as usize * width + x0 as usize;
        let [a, b] = *self.level[at..].first_chunk()?;
        let [c, d] = *self.level[at + width..].first_chunk()?;
        let (upper, lower) = (a + (b - a) * fx, c + (d - c) * fx);
        Some(upper + (lower - upper) * fy)
    }

    /// Index of the pixel at a position; `None` outside.
    #[inline(always)]
    pub fn index_at(&self, x_px: f32, y_px: f32) -> Option<usize> {
        let [width, height] = self.size_px;
        let inside = (x_px >= 0.0) & (y_px >= 0.0) & (x_px < width as f32) & (y_px < height as f32);
        // Through i32: a conversion to usize costs a branch for numbers beyond 2⁶³.
        inside.then(|| (y_px as i32 as usize) * width + x_px as i32 as usize)
    }

    /// Darkest and brightest level that samples in a rectangle may have, which is given by its least
    /// and greatest corner and clamped to the image.
    pub fn bounds_within(&self, [least, greatest]: [[f32; 2]; 2]) -> (f32, f32) {
        let tiles = tiles_of(self.size_px);
        // One pixel more on each side: bilinear samples reach over the rim.
        let reach = [least.map(|x| x - 1.0), greatest.map(|x| x + 1.0)];
        let mut bounds = (f32::INFINITY, f32::NEG_INFINITY);
        for row in TileBox::around(tiles, reach).rows(tiles) {
            for (low, high) in &self.bounds[row] {
                bounds = (smaller(*low, bounds.0), larger(*high, bounds.1));
            }
        }
        bounds
    }
}

/// A row of tiles to be read.
struct TileRow<'a> {
    /// Its first row of pixels.
    first: usize,
    images: &'a EventImages<'a>,
    spec: &'a DvsSpec,
    width: usize,
    level: &'a mut [f32],
    flow: &'a mut [[f32; 2]],
    depth: &'a mut [f32],
    bounds: &'a mut [(f32, f32)],
    motions: &'a mut [Range],
}

impl LaneWork for TileRow<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let TileRow {
            first,
            images,
            width,
            ..
        } = self;
        for (i, level) in self.level.chunks_exact_mut(width).enumerate() {
            to_levels(images.luminance.row(first + i), level, self.spec);
        }
        if self.spec.mode != DvsMode::Motion {
            return;
        }
        for (i, flow) in self.flow.chunks_exact_mut(width).enumerate() {
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(flow);
            bytes.copy_from_slice(images.flow.row(first + i));
        }
        for (i, depth) in self.depth.chunks_exact_mut(width).enumerate() {
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(depth);
            bytes.copy_from_slice(images.depth.row(first + i));
        }
        for (tx, bounds) in self.bounds.iter_mut().enumerate() {
            *bounds = numbers_of_tile::<L>(self.level, width, tx);
        }
        for (tx, range) in self.motions.iter_mut().enumerate() {
            *range = Range::of_tile::<L>(self.flow, width, tx);
        }
    }
}

/// A row of luminance to levels.
#[inline(always)]
fn to_levels(luminance: &[u8], level: &mut [f32], spec: &DvsSpec) {
    // CARLA compares 8-bit colours, which are gamma-encoded.
    match (spec.mode, spec.use_log) {
        (DvsMode::Motion, true) => convert(luminance, level, |x| ln(x + spec.log_eps)),
        (DvsMode::Motion, false) => convert(luminance, level, |x| 255.0 * x),
        (DvsMode::TwoFrame, true) => convert(luminance, level, |x| ln(encoded(x) + spec.log_eps)),
        (DvsMode::TwoFrame, false) => convert(luminance, level, |x| 255.0 * encoded(x)),
    }
}

#[inline(always)]
fn convert(luminance: &[u8], level: &mut [f32], of: impl Fn(f32) -> f32) {
    match bytemuck::try_cast_slice::<u8, f32>(luminance) {
        Ok(luminance) => level
            .iter_mut()
            .zip(luminance)
            .for_each(|(level, x)| *level = of(*x)),
        // Rows that do not lie at multiples of four bytes.
        Err(_) => level
            .iter_mut()
            .zip(luminance.chunks_exact(4))
            .for_each(|(level, bytes)| *level = of(float(bytes))),
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
