//! The motion field of a window: how points move from its first image to its last.

use rayon::prelude::*;

use super::lanes::{larger, smaller};
use super::level_image::LevelImage;
use super::tiles::{Range, TILE_PX, row_ranges, tiles_of};

/// Motion of the surfaces that may pass a pixel during the window, pixels per window.
#[derive(Clone, Copy, Debug)]
pub(super) enum Path {
    /// Nothing moves here.
    Still,
    /// One surface: the motion of what is here at the beginning and at the end; in between it
    /// changes evenly.
    Smooth { begin: [f32; 2], end: [f32; 2] },
    /// Several surfaces, of which the nearest is seen.
    Several { motions: [[f32; 2]; 3], n: usize },
}

#[inline(always)]
pub(super) fn norm2(m: [f32; 2]) -> f32 {
    m[0] * m[0] + m[1] * m[1]
}

/// Whether two motions may be those of one surface seen in perspective: half a pixel and a third of
/// the speed apart at most.
#[inline(always)]
fn smooth(a: [f32; 2], b: [f32; 2]) -> bool {
    let tolerance = 0.5 + 0.35 * larger(norm2(a), norm2(b)).sqrt();
    norm2([a[0] - b[0], a[1] - b[1]]) <= tolerance * tolerance
}

/// Whether two motions are the same surface's: half a pixel and a tenth of the speed apart at most.
fn alike(a: [f32; 2], b: [f32; 2]) -> bool {
    let tolerance = 0.5 + 0.1 * norm2(b).sqrt();
    norm2([a[0] - b[0], a[1] - b[1]]) <= tolerance * tolerance
}

/// Kind of motion in and through a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TileMotion {
    /// Everything moves less than a step, so the two images suffice.
    Slow,
    /// One surface passes all its pixels.
    Smooth,
    /// Anything else: each pixel is examined on its own.
    Mixed,
}

/// Allocations of a motion field, reused from window to window.
#[derive(Debug, Default)]
pub(super) struct MotionMemory {
    before: Vec<[f32; 2]>,
    nearest_m: Vec<f32>,
}

/// Motion field of a window.
#[derive(Debug)]
pub(super) struct MotionField<'p> {
    size_px: [usize; 2],
    tiles: [usize; 2],
    /// Motion of the surface that is at a pixel at the end.
    now: &'p [[f32; 2]],
    /// Motion of the surface that was at a pixel at the beginning.
    before: &'p [[f32; 2]],
    /// Fastest motion that passes each tile.
    passing: Vec<[f32; 2]>,
    /// Kind of motion of each tile.
    tile_motions: Vec<TileMotion>,
}

impl<'p> MotionField<'p> {
    /// Computes the field from the flow at the end. `ratio` is this window's length over the
    /// previous one's; it scales the motion of surfaces that are hidden at the end.
    pub fn between(
        previous: &LevelImage,
        now: &'p LevelImage,
        ratio: f32,
        step_px: f32,
        memory: &'p mut MotionMemory,
    ) -> MotionField<'p> {
        let size_px = now.size_px;
        let tiles = tiles_of(size_px);
        let MotionMemory { before, nearest_m } = memory;
        before.resize(now.flow.len(), [0.0; 2]);
        let mut passing = vec![[0.0; 2]; tiles[0] * tiles[1]];
        let now_ranges = motion_ranges(&now.flow, size_px);
        if now_ranges.iter().all(|range| range.fastest2() < 0.25) {
            // Nothing leaves its pixel; this is usual at a thousand firings per second.
            before.copy_from_slice(&now.flow);
        } else {
            before
                .par_iter_mut()
                .zip(&previous.flow)
                .for_each(|(before, flow)| *before = flow.map(|f| f * ratio));
            scatter(now, before, nearest_m);
        }
        spread(now, tiles, &now_ranges, &mut passing);
        let before_ranges = motion_ranges(before, size_px);
        let tile_motion = |tile: usize| {
            tile_motion(
                &now_ranges[tile].with(&before_ranges[tile]),
                passing[tile],
                step_px,
            )
        };
        let tile_motions = (0..tiles[0] * tiles[1]).map(tile_motion).collect();
        MotionField {
            size_px,
            tiles,
            now: &now.flow,
            before,
            passing,
            tile_motions,
        }
    }

    /// Kind of motion of the eight pixels from `(x, y)` on; x is a multiple of eight.
    #[inline(always)]
    pub fn tile_motion(&self, x: usize, y: usize) -> TileMotion {
        self.tile_motions[y / TILE_PX * self.tiles[0] + x / TILE_PX]
    }

    /// Motions at the beginning and at the end of `n` pixels from `(x, y)` on.
    #[inline(always)]
    pub fn of_block(&self, x: usize, y: usize, n: usize) -> [&[[f32; 2]]; 2] {
        let i = y * self.size_px[0] + x;
        [&self.before[i..i + n], &self.now[i..i + n]]
    }

    #[inline(always)]
    pub fn path(&self, x: usize, y: usize) -> Path {
        let i = y * self.size_px[0] + x;
        let (begin, end) = (self.before[i], self.now[i]);
        let passing = self.passing[y / TILE_PX * self.tiles[0] + x / TILE_PX];
        if smooth(begin, end)
            && (passing == [0.0; 2] || smooth(passing, begin) || smooth(passing, end))
        {
            return if begin == [0.0; 2] && end == [0.0; 2] {
                Path::Still
            } else {
                Path::Smooth { begin, end }
            };
        }
        let (mut motions, mut n) = ([end; 3], 1);
        for other in [begin, passing] {
            if !motions[..n].iter().any(|known| alike(other, *known)) {
                motions[n] = other;
                n += 1;
            }
        }
        Path::Several { motions, n }
    }

    /// Level of a pixel that several surfaces pass, when `share` of the window has passed.
    pub fn level(
        &self,
        previous: &LevelImage,
        now: &LevelImage,
        motions: &[[f32; 2]],
        x: usize,
        y: usize,
        share: f32,
    ) -> f32 {
        let at = [x as f32 + 0.5, y as f32 + 0.5];
        let ahead = |m: [f32; 2]| [at[0] + m[0] * (1.0 - share), at[1] + m[1] * (1.0 - share)];
        let behind = |m: [f32; 2]| [at[0] - m[0] * share, at[1] - m[1] * share];
        // The nearest surface that has this motion and is here at this time hides the others.
        let (mut chosen, mut nearest_m) = (None, f32::INFINITY);
        for m in motions {
            let [px, py] = ahead(*m);
            if let Some(i) = now
                .index_at(px, py)
                .filter(|i| now.depth[*i] <= nearest_m && alike(now.flow[*i], *m))
            {
                (nearest_m, chosen) = (now.depth[i], Some(*m));
            }
        }
        let i = y * self.size_px[0] + x;
        let (before, after) = match chosen {
            Some(m) => {
                let ([ax, ay], [bx, by]) = (ahead(m), behind(m));
                let seen_before = previous
                    .index_at(bx, by)
                    .is_some_and(|i| alike(self.before[i], m));
                (
                    if seen_before {
                        previous.level_at(bx, by)
                    } else {
                        None
                    },
                    now.level_at(ax, ay),
                )
            }
            // The surface is hidden at the end: take the one that was here at the beginning, moving
            // on as before.
            None => {
                let [bx, by] = behind(self.before[i]);
                (previous.level_at(bx, by), None)
            }
        };
        match (before, after) {
            (Some(before), Some(after)) => before + (after - before) * share,
            (Some(level), None) | (None, Some(level)) => level,
            (None, None) => previous.level[i] + (now.level[i] - previous.level[i]) * share,
        }
    }
}

/// Bounding boxes of the motions of each tile.
fn motion_ranges(field: &[[f32; 2]], size_px: [usize; 2]) -> Vec<Range> {
    let tiles = tiles_of(size_px);
    let of_row = |ty: usize| {
        row_ranges::<16>(bytemuck::cast_slice(field), size_px, ty)
            .iter()
            .map(Range::of)
            .collect::<Vec<_>>()
    };
    (0..tiles[1])
        .into_par_iter()
        .flat_map_iter(of_row)
        .collect()
}

/// Kind of motion from the bounding box of the motions in a tile and the motion that passes it.
fn tile_motion(range: &Range, passing: [f32; 2], step_px: f32) -> TileMotion {
    let all = Range {
        low: passing,
        high: passing,
    }
    .with(range);
    let all = if passing == [0.0; 2] { range } else { &all };
    if all.fastest2() < step_px * step_px {
        TileMotion::Slow
    } else if all.spread() <= 0.5 + 0.35 * all.slowest() {
        // This implies that `smooth` holds for any two of them.
        TileMotion::Smooth
    } else {
        TileMotion::Mixed
    }
}

/// Gives each pixel of the first image the motion of the surface that left it; the nearest surface
/// wins.
///
/// Bands of rows are filled in parallel. Each band looks at the rows that can have reached it, in
/// the order of the image, so the result does not depend on the number of bands.
fn scatter(now: &LevelImage, before: &mut [[f32; 2]], nearest_m: &mut Vec<f32>) {
    let width = now.size_px[0];
    let reach_of = |row: &[[f32; 2]]| {
        let zero = ([0.0_f32; 2], [0.0_f32; 2]);
        row.iter().fold(zero, |(low, high), flow| {
            (
                [0, 1].map(|axis| smaller(flow[axis], low[axis])),
                [0, 1].map(|axis| larger(flow[axis], high[axis])),
            )
        })
    };
    let reaches: Vec<([f32; 2], [f32; 2])> = now.flow.par_chunks(width).map(reach_of).collect();
    nearest_m.clear();
    nearest_m.resize(before.len(), f32::INFINITY);
    let n_rows = before.len() / width;
    let band_rows = n_rows
        .div_ceil(rayon::current_num_threads().max(1))
        .max(TILE_PX);
    let bands = before
        .par_chunks_mut(band_rows * width)
        .zip(nearest_m.par_chunks_mut(band_rows * width));
    bands.enumerate().for_each(|(band, (before, nearest_m))| {
        let first = band * band_rows;
        let rows = first..first + before.len() / width;
        for (y, (low, high)) in reaches.iter().enumerate() {
            // Points in row y at the end were between these rows at the beginning.
            let (top, bottom) = (y as f32 - high[1], y as f32 + 1.0 - low[1]);
            if bottom < rows.start as f32 || top > rows.end as f32 {
                continue;
            }
            for x in 0..width {
                let i = y * width + x;
                let (flow, depth_m) = (now.flow[i], now.depth[i]);
                let Some(from) = now.index_at(x as f32 + 0.5 - flow[0], y as f32 + 0.5 - flow[1])
                else {
                    continue;
                };
                let Some(from) = from
                    .checked_sub(first * width)
                    .filter(|from| *from < before.len())
                else {
                    continue;
                };
                if depth_m <= nearest_m[from] {
                    nearest_m[from] = depth_m;
                    before[from] = flow;
                }
            }
        }
    });
}

/// Gives each tile the fastest motion that passes it. Only tiles with a discontinuity in their
/// motion send one out, because a surface that passes a pixel without being there at the beginning
/// or the end has an edge.
fn spread(now: &LevelImage, tiles: [usize; 2], ranges: &[Range], passing: &mut [[f32; 2]]) {
    let [width, height] = now.size_px;
    let fastest_of = |tile: usize| {
        let (tx, ty) = (tile % tiles[0] * TILE_PX, tile / tiles[0] * TILE_PX);
        // The neighbours to the left and above are included, because their last pixels are examined
        // below.
        let (left, above) = ((tx > 0) as usize, if ty > 0 { tiles[0] } else { 0 });
        let about = [tile - left, tile - above, tile - left - above]
            .iter()
            .fold(ranges[tile], |about, other| about.with(&ranges[*other]));
        if about.spread() <= 0.5 + 0.35 * about.slowest() {
            return [0.0; 2];
        }
        let (mut fastest, mut slowest) = ([0.0; 2], [f32::INFINITY; 2]);
        // One pixel more to the left and above, because a discontinuity may lie between two tiles.
        for y in ty.saturating_sub(1)..(ty + TILE_PX).min(height) {
            for flow in
                &now.flow[y * width + tx.saturating_sub(1)..y * width + (tx + TILE_PX).min(width)]
            {
                if norm2(*flow) > norm2(fastest) {
                    fastest = *flow;
                }
                if norm2(*flow) < norm2(slowest) {
                    slowest = *flow;
                }
            }
        }
        if smooth(fastest, slowest) {
            [0.0; 2]
        } else {
            fastest
        }
    };
    let fastest: Vec<[f32; 2]> = (0..tiles[0] * tiles[1])
        .into_par_iter()
        .map(fastest_of)
        .collect();
    for (tile, m) in fastest.iter().enumerate().filter(|(_, m)| norm2(**m) > 0.0) {
        let (tx, ty) = (tile % tiles[0], tile / tiles[0]);
        let back = m.map(|m| (m / TILE_PX as f32).clamp(-1e4, 1e4));
        let n_steps = back[0].abs().max(back[1].abs()).ceil() as i32 + 1;
        for step in 0..=n_steps {
            let share = step as f32 / n_steps as f32;
            let (x, y) = (
                (tx as f32 - back[0] * share).round(),
                (ty as f32 - back[1] * share).round(),
            );
            if x >= 0.0 && y >= 0.0 && x < tiles[0] as f32 && y < tiles[1] as f32 {
                let passed = &mut passing[y as usize * tiles[0] + x as usize];
                if norm2(*m) > norm2(*passed) {
                    *passed = *m;
                }
            }
        }
    }
}
