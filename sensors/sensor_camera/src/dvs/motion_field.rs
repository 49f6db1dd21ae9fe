//! The motion field of a window: how points move from its first image to its last.

use rayon::prelude::*;

use sensor_core::vector_lanes::{LaneWork, Lanes, in_lanes};

use super::beginnings::{begun, may_begin, scatter};
use super::lanes::{larger, smaller};
use super::level_image::LevelImage;
use super::tiles::{Range, TILE_PX, tiles_of};

/// Motion of the surfaces that may pass a pixel during the window, pixels per window.
#[derive(Clone, Copy, Debug)]
pub(super) enum Path {
    /// Nothing moves here.
    Still,
    /// One surface: the motion of what is here at the beginning and at the end; in between it
    /// changes evenly.
    Smooth { begin: [f32; 2], end: [f32; 2] },
    /// Several surfaces, of which the nearest is seen.
    Several(Passers),
}

/// Motions of surfaces that may pass a pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Passers {
    motions: [[f32; 2]; 3],
    /// Squares of the distances within which motions are the same surface's.
    tolerances2: [f32; 3],
    n: usize,
}

impl Passers {
    /// Of up to three motions that differ.
    fn of(all: [[f32; 2]; 3]) -> Passers {
        let mut passers = Passers {
            motions: [all[0]; 3],
            tolerances2: [tolerance2(all[0]); 3],
            n: 0,
        };
        for m in all {
            let known = &passers.motions[..passers.n];
            if !known
                .iter()
                .any(|known| is_within(m, *known, tolerance2(*known)))
            {
                passers.motions[passers.n] = m;
                passers.tolerances2[passers.n] = tolerance2(m);
                passers.n += 1;
            }
        }
        passers
    }

    /// The speed of the fastest, pixels per window.
    pub fn fastest_px(&self) -> f32 {
        let motions = self.motions[..self.n].iter();
        motions.map(|m| norm2(*m)).fold(0.0, f32::max).sqrt()
    }
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

/// Square of the distance from a motion within which others are the same surface's: half a pixel
/// and a tenth of the speed.
#[inline(always)]
fn tolerance2(m: [f32; 2]) -> f32 {
    let tolerance = 0.5 + 0.1 * norm2(m).sqrt();
    tolerance * tolerance
}

/// Whether the square of the distance of two motions is at most this.
#[inline(always)]
fn is_within(a: [f32; 2], b: [f32; 2], distance2: f32) -> bool {
    norm2([a[0] - b[0], a[1] - b[1]]) <= distance2
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
    /// Motion of the surface that was at a pixel at the beginning. Only tiles where somebody asks
    /// for it are filled.
    before: &'p [[f32; 2]],
    /// Fastest motion that passes each tile.
    passing: Vec<[f32; 2]>,
    /// Kind of motion of each tile.
    tile_motions: Vec<TileMotion>,
    /// Bounding box of the motions at the beginning and at the end in each tile that is not slow.
    ranges: Vec<Range>,
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
        let mut passing = vec![[0.0; 2]; tiles[0] * tiles[1]];
        spread(now, tiles, &mut passing);
        let kind = |tile: usize, range: &Range| tile_motion(range, passing[tile], step_px);
        if now.motions.iter().all(|range| range.fastest2() < 0.25) {
            // Nothing leaves its pixel; this is usual at a thousand firings per second.
            let tile_motions = now.motions.iter().enumerate();
            return MotionField {
                size_px,
                tiles,
                now: &now.flow,
                before: &now.flow,
                tile_motions: tile_motions
                    .map(|(tile, range)| kind(tile, range))
                    .collect(),
                ranges: now.motions.clone(),
                passing,
            };
        }
        let mut ranges = may_begin(previous, now, ratio, tiles);
        let mut tile_motions: Vec<TileMotion> = ranges
            .iter()
            .enumerate()
            .map(|(tile, range)| kind(tile, range))
            .collect();
        let asked = asked(tiles, &tile_motions, &ranges, &passing);
        let MotionMemory { before, nearest_m } = memory;
        before.resize(now.flow.len(), [0.0; 2]);
        nearest_m.resize(now.flow.len(), f32::INFINITY);
        scatter([previous, now], ratio, &asked, before, nearest_m);
        // What may begin there was an estimate; these are the motions.
        tile_motions
            .par_chunks_mut(tiles[0])
            .zip(ranges.par_chunks_mut(tiles[0]))
            .zip(before.par_chunks(TILE_PX * size_px[0]))
            .enumerate()
            .for_each(|(ty, ((tile_motions, ranges), before))| {
                in_lanes(Sharpened {
                    first: ty * tiles[0],
                    width: size_px[0],
                    now: &now.motions,
                    before,
                    kind: &kind,
                    tile_motions,
                    ranges,
                })
            });
        MotionField {
            size_px,
            tiles,
            now: &now.flow,
            before,
            passing,
            tile_motions,
            ranges,
        }
    }

    /// Bounding box of everything that the paths of a tile's pixels touch, in the image at the
    /// beginning and in the image at the end.
    #[inline(always)]
    pub fn reach(&self, tx: usize, ty: usize) -> [[[f32; 2]; 2]; 2] {
        let tile = ty * self.tiles[0] + tx;
        let range = self.ranges[tile].with(&Range::of(self.passing[tile]));
        let begin = [(tx * TILE_PX) as f32, (ty * TILE_PX) as f32];
        let end = begin.map(|begin| begin + TILE_PX as f32);
        let (low, high) = (
            range.low.map(|m| smaller(m, 0.0)),
            range.high.map(|m| larger(m, 0.0)),
        );
        let moved = |by: [[f32; 2]; 2]| {
            [0, 1].map(|corner: usize| {
                [0, 1].map(|axis: usize| [begin, end][corner][axis] + by[corner][axis])
            })
        };
        [
            moved([high.map(|m| -m), low.map(|m| -m)]),
            moved([low, high]),
        ]
    }

    /// Kind of motion of a tile.
    #[inline(always)]
    pub fn tile_motion(&self, tx: usize, ty: usize) -> TileMotion {
        self.tile_motions[ty * self.tiles[0] + tx]
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
        Path::Several(Passers::of([end, begin, passing]))
    }

    /// Level of a pixel that several surfaces pass, when `share` of the window has passed.
    #[inline(always)]
    pub fn level(
        &self,
        previous: &LevelImage,
        now: &LevelImage,
        passers: &Passers,
        [x, y]: [usize; 2],
        share: f32,
    ) -> f32 {
        let at = [x as f32 + 0.5, y as f32 + 0.5];
        let ahead = |m: [f32; 2]| [at[0] + m[0] * (1.0 - share), at[1] + m[1] * (1.0 - share)];
        let behind = |m: [f32; 2]| [at[0] - m[0] * share, at[1] - m[1] * share];
        // The nearest surface that has this motion and is here at this time hides the others.
        let (mut chosen, mut nearest_m) = (None, f32::INFINITY);
        for k in 0..passers.n {
            let m = passers.motions[k];
            let [px, py] = ahead(m);
            if let Some(i) = now.index_at(px, py)
                && now.depth[i] <= nearest_m
                && is_within(now.flow[i], m, passers.tolerances2[k])
            {
                (nearest_m, chosen) = (now.depth[i], Some(k));
            }
        }
        let i = y * self.size_px[0] + x;
        let (before, after) = match chosen {
            Some(k) => {
                let m = passers.motions[k];
                let ([ax, ay], [bx, by]) = (ahead(m), behind(m));
                let was_seen = previous
                    .index_at(bx, by)
                    .is_some_and(|i| is_within(self.before[i], m, passers.tolerances2[k]));
                let before = was_seen.then(|| previous.level_at(bx, by)).flatten();
                (before, now.level_at(ax, ay))
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

/// Kind of motion from the bounding box of the motions in a tile and the motion that passes it.
fn tile_motion(range: &Range, passing: [f32; 2], step_px: f32) -> TileMotion {
    let all = Range::of(passing).with(range);
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

/// The tiles of which somebody asks for motions at the beginning: those that are not slow, and those
/// that the pixels of mixed ones lead back to.
fn asked(
    tiles: [usize; 2],
    tile_motions: &[TileMotion],
    ranges: &[Range],
    passing: &[[f32; 2]],
) -> Vec<bool> {
    let mut asked: Vec<bool> = tile_motions
        .iter()
        .map(|motion| *motion != TileMotion::Slow)
        .collect();
    for (tile, _) in tile_motions
        .iter()
        .enumerate()
        .filter(|(_, motion)| **motion == TileMotion::Mixed)
    {
        let still = Range::of([0.0; 2]);
        let all = ranges[tile].with(&Range::of(passing[tile])).with(&still);
        let at = [tile % tiles[0], tile / tiles[0]];
        for row in begun(tiles, at, &all).rows(tiles) {
            asked[row].fill(true);
        }
    }
    asked
}

/// Motions of a row of tiles that are known pixel by pixel.
struct Sharpened<'a, F> {
    /// Index of the row's first tile.
    first: usize,
    width: usize,
    now: &'a [Range],
    before: &'a [[f32; 2]],
    kind: &'a F,
    tile_motions: &'a mut [TileMotion],
    ranges: &'a mut [Range],
}

impl<F: Fn(usize, &Range) -> TileMotion> LaneWork for Sharpened<'_, F> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        for (tx, (motion, range)) in self.tile_motions.iter_mut().zip(self.ranges).enumerate() {
            if *motion == TileMotion::Slow {
                continue;
            }
            let tile = self.first + tx;
            *range = Range::of_tile::<L>(self.before, self.width, tx).with(&self.now[tile]);
            *motion = (self.kind)(tile, range);
        }
    }
}

/// Gives each tile the fastest motion that passes it. Only tiles with a discontinuity in their
/// motion send one out, because a surface that passes a pixel without being there at the beginning
/// or the end has an edge.
fn spread(now: &LevelImage, tiles: [usize; 2], passing: &mut [[f32; 2]]) {
    let [width, height] = now.size_px;
    let ranges = &now.motions;
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
