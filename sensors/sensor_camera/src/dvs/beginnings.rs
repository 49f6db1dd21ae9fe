//! Motions at the beginning of a window: those of the surfaces that left a pixel of its first image.

use rayon::prelude::*;
use sensor_core::vector_lanes::{LaneWork, Lanes, in_lanes};

use super::lanes::LANES;
use super::level_image::LevelImage;
use super::stage::EVENTS;
use super::tiles::{Range, TILE_PX, TileBox, tiles_of};

/// Bounding boxes that hold, for each tile, its motions at the end and at the beginning, without
/// looking at pixels: what ends in a tile began in those that its motions lead back to, and where
/// nothing began, motions are those of the last window.
pub(super) fn may_begin(
    previous: &LevelImage,
    now: &LevelImage,
    ratio: f32,
    tiles: [usize; 2],
) -> Vec<Range> {
    let scaled = |range: &Range| {
        let (low, high) = (range.low.map(|m| m * ratio), range.high.map(|m| m * ratio));
        Range { low, high }
    };
    let mut ranges: Vec<Range> = now
        .motions
        .iter()
        .zip(&previous.motions)
        .map(|(now, previous)| now.with(&scaled(previous)))
        .collect();
    for ty in 0..tiles[1] {
        for tx in 0..tiles[0] {
            let range = &now.motions[ty * tiles[0] + tx];
            for row in begun(tiles, [tx, ty], range).rows(tiles) {
                ranges[row]
                    .iter_mut()
                    .for_each(|all| *all = all.with(range));
            }
        }
    }
    ranges
}

/// The tiles in which pixels of a tile with these motions may have been at the beginning.
#[inline(always)]
pub(super) fn begun(tiles: [usize; 2], [tx, ty]: [usize; 2], range: &Range) -> TileBox {
    let least = [(tx * TILE_PX) as f32, (ty * TILE_PX) as f32];
    TileBox::around(
        tiles,
        [
            [0, 1].map(|axis: usize| least[axis] - range.high[axis]),
            [0, 1].map(|axis: usize| least[axis] + TILE_PX as f32 - range.low[axis]),
        ],
    )
}

/// Gives each pixel of the first image, in the tiles that are asked for, the motion of the surface
/// that left it; the nearest surface wins. Pixels that no surface left move on as before.
///
/// Bands of rows are filled in parallel. Each band looks at the rows that can have reached it, in
/// the order of the image, so the result does not depend on the number of bands.
pub(super) fn scatter(
    [previous, now]: [&LevelImage; 2],
    ratio: f32,
    asked: &[bool],
    before: &mut [[f32; 2]],
    nearest_m: &mut [f32],
) {
    let [width, height] = now.size_px;
    let tiles = tiles_of(now.size_px);
    // Rows of tiles that each row of tiles leads back to.
    let reaches: Vec<[usize; 2]> = (0..tiles[1])
        .map(|ty| {
            let ranges = &now.motions[ty * tiles[0]..(ty + 1) * tiles[0]];
            let range = ranges
                .iter()
                .fold(Range::EMPTY, |all, range| all.with(range));
            begun(tiles, [0, ty], &range).y
        })
        .collect();
    // Tiles that lead back to a tile that is asked for.
    let leads: Vec<bool> = (0..tiles[0] * tiles[1])
        .into_par_iter()
        .with_min_len(tiles[0])
        .map(|tile| {
            let at = [tile % tiles[0], tile / tiles[0]];
            let mut rows = begun(tiles, at, &now.motions[tile]).rows(tiles);
            rows.any(|row| asked[row].contains(&true))
        })
        .collect();
    let band_tiles = tiles[1].div_ceil(rayon::current_num_threads().max(1));
    let band_px = band_tiles * TILE_PX * width;
    let bands = before
        .par_chunks_mut(band_px)
        .zip(nearest_m.par_chunks_mut(band_px));
    bands.enumerate().for_each(|(band, (before, nearest_m))| {
        let _span = EVENTS.span();
        let first = band * band_tiles;
        in_lanes(Band {
            images: [previous, now],
            ratio,
            rows: first..(first + band_tiles).min(tiles[1]),
            n_rows: height,
            asked,
            leads: &leads,
            reaches: &reaches,
            before,
            nearest_m,
        });
    });
}

/// Rows of tiles of the first image that get their motions.
struct Band<'a> {
    images: [&'a LevelImage; 2],
    ratio: f32,
    /// Its rows of tiles.
    rows: std::ops::Range<usize>,
    /// Rows of pixels of the image.
    n_rows: usize,
    asked: &'a [bool],
    leads: &'a [bool],
    reaches: &'a [[usize; 2]],
    before: &'a mut [[f32; 2]],
    nearest_m: &'a mut [f32],
}

impl LaneWork for Band<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(mut self) {
        self.begin();
        for ty in 0..self.reaches.len() {
            let [top, bottom] = self.reaches[ty];
            if bottom >= self.rows.start && top < self.rows.end {
                for y in ty * TILE_PX..(ty * TILE_PX + TILE_PX).min(self.n_rows) {
                    self.row::<L>(ty, y);
                }
            }
        }
    }
}

impl Band<'_> {
    /// The tiles that are asked for move on as before.
    #[inline(always)]
    fn begin(&mut self) {
        let width = self.images[0].size_px[0];
        let n_tiles = width.div_ceil(TILE_PX);
        let first = self.rows.start * TILE_PX;
        for (i, (before, nearest_m)) in self
            .before
            .chunks_exact_mut(width)
            .zip(self.nearest_m.chunks_exact_mut(width))
            .enumerate()
        {
            let y = first + i;
            let asked = &self.asked[y / TILE_PX * n_tiles..][..n_tiles];
            let flow = &self.images[0].flow[y * width..(y + 1) * width];
            let tiles = before
                .chunks_mut(TILE_PX)
                .zip(nearest_m.chunks_mut(TILE_PX))
                .zip(flow.chunks(TILE_PX));
            for (_, ((before, nearest_m), flow)) in
                asked.iter().zip(tiles).filter(|(asked, _)| **asked)
            {
                for (before, flow) in before.iter_mut().zip(flow) {
                    *before = flow.map(|f| f * self.ratio);
                }
                nearest_m.fill(f32::INFINITY);
            }
        }
    }

    /// Follows the pixels of row `y` back.
    #[inline(always)]
    fn row<L: Lanes>(&mut self, ty: usize, y: usize) {
        let now = self.images[1];
        let width = now.size_px[0];
        let n_tiles = width.div_ceil(TILE_PX);
        let flows = &now.flow[y * width..(y + 1) * width];
        let depths = &now.depth[y * width..(y + 1) * width];
        let first = self.rows.start * TILE_PX * width;
        let (right, bottom) = (
            L::splat(now.size_px[0] as f32),
            L::splat(now.size_px[1] as f32),
        );
        let zero = L::splat(0.0);
        let steps = L::load(&std::array::from_fn(|lane| lane as f32 + 0.5));
        for tx in (0..n_tiles).filter(|tx| self.leads[ty * n_tiles + tx]) {
            let x = tx * TILE_PX;
            let n = LANES.min(width - x);
            let mut flow = [[0.0; 2]; LANES];
            flow[..n].copy_from_slice(&flows[x..x + n]);
            let [fx, fy] = L::unzip(&flow);
            // One addition: x + ½ is exact.
            let px = L::splat(x as f32).add(steps).sub(fx);
            let py = L::splat(y as f32 + 0.5).sub(fy);
            let inside = L::and(
                L::and(zero.le(px), px.lt(right)),
                L::and(zero.le(py), py.lt(bottom)),
            );
            let from = L::places(px.whole(), py.whole(), width as u32);
            let mut lanes = L::bits(inside) & ((1 << n) - 1);
            while lanes != 0 {
                let lane = lanes.trailing_zeros() as usize;
                lanes &= lanes - 1;
                let Some(nearest_m) = (from[lane] as usize)
                    .checked_sub(first)
                    .and_then(|from| self.nearest_m.get_mut(from))
                else {
                    continue;
                };
                let depth_m = depths[x + lane];
                if depth_m <= *nearest_m {
                    *nearest_m = depth_m;
                    self.before[from[lane] as usize - first] = flow[lane];
                }
            }
        }
    }
}
