//! Two pictures and how their points move from one to the other.

use rayon::prelude::*;

use super::DvsImages;
use super::block::{LANES, Lanes};

/// A rendered picture with its motion.
#[derive(Debug)]
pub(super) struct Picture {
    pub size_px: [usize; 2],
    /// ln(luminance + eps).
    pub log: Vec<f32>,
    /// `log` of each pixel and its neighbours to the right, below, and both (rims repeat): what a bilinear sample needs, in one load.
    pub quads: Vec<[f32; 4]>,
    /// Motion since the previous firing, pixels.
    pub flow: Vec<[f32; 2]>,
    /// Metres; +∞ is the sky.
    pub depth: Vec<f32>,
}

impl Picture {
    /// A picture of this size; [`Picture::read`] fills it.
    pub fn blank(size_px: [usize; 2]) -> Picture {
        let n = size_px[0] * size_px[1];
        Picture { size_px, log: vec![0.0; n], quads: vec![[0.0; 4]; n], flow: vec![[0.0; 2]; n], depth: vec![0.0; n] }
    }

    /// Takes over what the GPU left.
    pub fn read(&mut self, images: &DvsImages, log_eps: f32) {
        let width = self.size_px[0];
        let picture = &mut *self;
        let rows = picture.log.par_chunks_mut(width).zip(picture.flow.par_chunks_mut(width)).zip(picture.depth.par_chunks_mut(width));
        rows.enumerate().for_each(|(y, ((log, flow), depth))| {
            for (log, bytes) in log.iter_mut().zip(images.luminance.row(y).chunks_exact(4)) {
                *log = (float(bytes) + log_eps).ln();
            }
            for (flow, bytes) in flow.iter_mut().zip(images.flow.row(y).chunks_exact(8)) {
                *flow = [float(&bytes[..4]), float(&bytes[4..])];
            }
            for (depth, bytes) in depth.iter_mut().zip(images.depth.row(y).chunks_exact(4)) {
                *depth = float(bytes);
            }
        });
        self.fill_quads();
    }

    fn fill_quads(&mut self) {
        let [width, height] = self.size_px;
        let log = &self.log;
        self.quads.par_chunks_mut(width).enumerate().for_each(|(y, quads)| {
            let below = (y + 1).min(height - 1);
            let (upper, lower) = (&log[y * width..(y + 1) * width], &log[below * width..(below + 1) * width]);
            for ((quad, upper), lower) in quads.iter_mut().zip(upper.windows(2)).zip(lower.windows(2)) {
                *quad = [upper[0], upper[1], lower[0], lower[1]];
            }
            quads[width - 1] = [upper[width - 1], upper[width - 1], lower[width - 1], lower[width - 1]];
        });
    }

    /// Bilinear brightness at several positions, each moved into the image if it is outside.
    #[inline(always)]
    pub fn logs_at(&self, at: &[Lanes; 2]) -> Lanes {
        let [width, height] = self.size_px;
        let (right, bottom, stride) = ((width - 1) as f32, (height - 1) as f32, width as i32);
        let (mut idx, mut fx, mut fy) = ([0_i32; LANES], [0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            let (x, y) = (smaller(larger(at[0][lane] - 0.5, 0.0), right), smaller(larger(at[1][lane] - 0.5, 0.0), bottom));
            let (x0, y0) = (floor(x), floor(y));
            (fx[lane], fy[lane]) = (x - x0, y - y0);
            idx[lane] = integer(y0).wrapping_mul(stride).wrapping_add(integer(x0));
        }
        let quads: [[f32; 4]; LANES] = std::array::from_fn(|lane| self.quads[idx[lane] as u32 as usize]);
        std::array::from_fn(|lane| {
            let [a, b, c, d] = quads[lane];
            let (upper, lower) = (a + (b - a) * fx[lane], c + (d - c) * fx[lane]);
            upper + (lower - upper) * fy[lane]
        })
    }

    /// Bilinear brightness at a position (pixel centres at halves); `None` outside.
    pub fn log_at(&self, x_px: f32, y_px: f32) -> Option<f32> {
        let [width, height] = self.size_px;
        if !(x_px >= 0.0 && y_px >= 0.0 && x_px <= width as f32 && y_px <= height as f32) {
            return None;
        }
        let (x, y) = ((x_px - 0.5).max(0.0).min((width - 1) as f32), (y_px - 0.5).max(0.0).min((height - 1) as f32));
        // Through i32: a conversion to usize costs a branch for numbers beyond 2⁶³.
        let (x0, y0) = (x as i32, y as i32);
        let (fx, fy) = (x - x0 as f32, y - y0 as f32);
        let (x0, y0) = (x0 as usize, y0 as usize);
        let (x1, y1) = ((x0 + 1).min(width - 1), (y0 + 1).min(height - 1));
        let row = |y: usize| {
            let row = &self.log[y * width..(y + 1) * width];
            row[x0] + (row[x1] - row[x0]) * fx
        };
        let (low, high) = (row(y0), row(y1));
        Some(low + (high - low) * fy)
    }

    /// Index of the pixel at a position; `None` outside.
    fn index_at(&self, x_px: f32, y_px: f32) -> Option<usize> {
        let [width, height] = self.size_px;
        let inside = x_px >= 0.0 && y_px >= 0.0 && x_px < width as f32 && y_px < height as f32;
        inside.then(|| y_px as usize * width + x_px as usize)
    }
}

/// Numbers from 0 to 2²² have their whole part in the last bits after adding this.
const WHOLE: f32 = 8_388_608.0;

/// Whole part of a number from 0 to 2²², in arithmetic that every processor has for several numbers at once (unlike conversions).
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

fn float(bytes: &[u8]) -> f32 {
    f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
}

/// Side of the tiles over which motion and brightness are bounded.
const TILE_PX: usize = 8;

/// Darkest and brightest level of each tile and its neighbouring pixels.
#[derive(Debug)]
pub(super) struct Bounds {
    tiles: [usize; 2],
    range: Vec<(f32, f32)>,
}

impl Bounds {
    pub fn of(picture: &Picture) -> Bounds {
        let [width, height] = picture.size_px;
        let tiles = [width.div_ceil(TILE_PX), height.div_ceil(TILE_PX)];
        let range_of = |tile: usize| {
            let (tx, ty) = (tile % tiles[0] * TILE_PX, tile / tiles[0] * TILE_PX);
            // One pixel more on each side: bilinear samples reach over the rim.
            let (x0, x1) = (tx.saturating_sub(1), (tx + TILE_PX + 1).min(width));
            let (y0, y1) = (ty.saturating_sub(1), (ty + TILE_PX + 1).min(height));
            let pixels = (y0..y1).flat_map(|y| &picture.log[y * width + x0..y * width + x1]);
            pixels.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), log| (low.min(*log), high.max(*log)))
        };
        Bounds { tiles, range: (0..tiles[0] * tiles[1]).into_par_iter().map(range_of).collect() }
    }

    /// Bounds over the tiles of a rectangle given by its least and greatest corner (clamped to the image).
    pub fn within(&self, [least, greatest]: [[f32; 2]; 2]) -> (f32, f32) {
        let tile =
            |position: f32, axis: usize| ((position.clamp(0.0, 1e6) * (1.0 / TILE_PX as f32)) as i32 as usize).min(self.tiles[axis] - 1);
        let (x0, x1) = (tile(least[0], 0), tile(greatest[0], 0));
        let (y0, y1) = (tile(least[1], 1), tile(greatest[1], 1));
        let mut bounds = (f32::INFINITY, f32::NEG_INFINITY);
        for y in y0..=y1 {
            for (low, high) in &self.range[y * self.tiles[0] + x0..=y * self.tiles[0] + x1] {
                bounds = (smaller(*low, bounds.0), larger(*high, bounds.1));
            }
        }
        bounds
    }
}

/// How what may pass a pixel moves during the window, pixels per window.
#[derive(Clone, Copy, Debug)]
pub(super) enum Path {
    /// Nothing moves here.
    Still,
    /// One surface: the motion of what is here at the beginning and at the end; in between it changes evenly.
    Smooth { begin: [f32; 2], end: [f32; 2] },
    /// Several surfaces, of which the nearest is seen.
    Several { motions: [[f32; 2]; 3], n: usize },
}

pub(super) fn norm2(m: [f32; 2]) -> f32 {
    m[0] * m[0] + m[1] * m[1]
}

/// Whether two motions may be those of one surface seen in perspective: half a pixel and a third of the speed apart at most.
fn smooth(a: [f32; 2], b: [f32; 2]) -> bool {
    let tolerance = 0.5 + 0.35 * norm2(a).max(norm2(b)).sqrt();
    norm2([a[0] - b[0], a[1] - b[1]]) <= tolerance * tolerance
}

/// Whether two motions are the same surface's: half a pixel and a tenth of the speed apart at most.
fn alike(a: [f32; 2], b: [f32; 2]) -> bool {
    let tolerance = 0.5 + 0.1 * norm2(b).sqrt();
    norm2([a[0] - b[0], a[1] - b[1]]) <= tolerance * tolerance
}

/// Motion field of a window.
#[derive(Debug)]
pub(super) struct Motion<'p> {
    size_px: [usize; 2],
    tiles: [usize; 2],
    /// Of what is at a pixel at the end.
    now: &'p [[f32; 2]],
    /// Of what was at a pixel at the beginning.
    before: Vec<[f32; 2]>,
    /// Fastest of what passes a tile.
    passing: Vec<[f32; 2]>,
}

impl<'p> Motion<'p> {
    /// From the flow at the end; `ratio` is this window's length over the previous one's, for what is hidden at the end.
    pub fn between(previous: &Picture, now: &'p Picture, ratio: f32) -> Motion<'p> {
        let [width, height] = now.size_px;
        let tiles = [width.div_ceil(TILE_PX), height.div_ceil(TILE_PX)];
        let moves = now.flow.par_iter().any(|flow| *flow != [0.0; 2]);
        let mut before: Vec<[f32; 2]> = previous.flow.par_iter().map(|flow| flow.map(|f| f * ratio)).collect();
        let mut passing = vec![[0.0; 2]; tiles[0] * tiles[1]];
        if moves {
            scatter(now, &mut before);
            spread(now, tiles, &mut passing);
        } else {
            before.copy_from_slice(&now.flow);
        }
        Motion { size_px: now.size_px, tiles, now: &now.flow, before, passing }
    }

    pub fn path(&self, x: usize, y: usize) -> Path {
        let i = y * self.size_px[0] + x;
        let (begin, end) = (self.before[i], self.now[i]);
        let passing = self.passing[y / TILE_PX * self.tiles[0] + x / TILE_PX];
        if smooth(begin, end) && (passing == [0.0; 2] || smooth(passing, begin) || smooth(passing, end)) {
            return if begin == [0.0; 2] && end == [0.0; 2] { Path::Still } else { Path::Smooth { begin, end } };
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

    /// Brightness at a pixel that several surfaces pass, when `share` of the window has passed.
    pub fn level(&self, previous: &Picture, now: &Picture, motions: &[[f32; 2]], x: usize, y: usize, share: f32) -> f32 {
        let at = [x as f32 + 0.5, y as f32 + 0.5];
        let ahead = |m: [f32; 2]| [at[0] + m[0] * (1.0 - share), at[1] + m[1] * (1.0 - share)];
        let behind = |m: [f32; 2]| [at[0] - m[0] * share, at[1] - m[1] * share];
        // The nearest surface that really moves like this and is here now hides the others.
        let (mut chosen, mut nearest_m) = (None, f32::INFINITY);
        for m in motions {
            let [px, py] = ahead(*m);
            if let Some(i) = now.index_at(px, py).filter(|i| now.depth[*i] <= nearest_m && alike(now.flow[*i], *m)) {
                (nearest_m, chosen) = (now.depth[i], Some(*m));
            }
        }
        let i = y * self.size_px[0] + x;
        let (before, after) = match chosen {
            Some(m) => {
                let ([ax, ay], [bx, by]) = (ahead(m), behind(m));
                let seen_before = previous.index_at(bx, by).is_some_and(|i| alike(self.before[i], m));
                (if seen_before { previous.log_at(bx, by) } else { None }, now.log_at(ax, ay))
            }
            // Hidden at the end: what was here at the beginning, moving on as it did.
            None => {
                let [bx, by] = behind(self.before[i]);
                (previous.log_at(bx, by), None)
            }
        };
        match (before, after) {
            (Some(before), Some(after)) => before + (after - before) * share,
            (Some(level), None) | (None, Some(level)) => level,
            (None, None) => previous.log[i] + (now.log[i] - previous.log[i]) * share,
        }
    }
}

/// Gives each pixel of the beginning the motion of what left it, nearest first.
///
/// Bands of rows are filled side by side; each looks only at rows from which something can have come, in the order of the image,
/// so that the outcome does not depend on the number of bands.
fn scatter(now: &Picture, before: &mut [[f32; 2]]) {
    let width = now.size_px[0];
    let reach_of = |row: &[[f32; 2]]| {
        let zero = ([0.0_f32; 2], [0.0_f32; 2]);
        row.iter().fold(zero, |(low, high), flow| {
            ([0, 1].map(|axis| smaller(flow[axis], low[axis])), [0, 1].map(|axis| larger(flow[axis], high[axis])))
        })
    };
    let reaches: Vec<([f32; 2], [f32; 2])> = now.flow.par_chunks(width).map(reach_of).collect();
    // Nothing leaves its pixel: what a camera at a thousand frames a second sees.
    if reaches.iter().all(|(low, high)| low.iter().all(|m| *m > -0.5) && high.iter().all(|m| *m < 0.5)) {
        before.copy_from_slice(&now.flow);
        return;
    }
    let n_rows = before.len() / width;
    let band_rows = n_rows.div_ceil(rayon::current_num_threads().max(1)).max(TILE_PX);
    before.par_chunks_mut(band_rows * width).enumerate().for_each(|(band, before)| {
        let first = band * band_rows;
        let rows = first..first + before.len() / width;
        let mut nearest_m = vec![f32::INFINITY; before.len()];
        for (y, (low, high)) in reaches.iter().enumerate() {
            // What is in row y now was between these rows at the beginning.
            let (top, bottom) = (y as f32 - high[1], y as f32 + 1.0 - low[1]);
            if bottom < rows.start as f32 || top > rows.end as f32 {
                continue;
            }
            for x in 0..width {
                let i = y * width + x;
                let (flow, depth_m) = (now.flow[i], now.depth[i]);
                let Some(from) = now.index_at(x as f32 + 0.5 - flow[0], y as f32 + 0.5 - flow[1]) else { continue };
                let Some(from) = from.checked_sub(first * width).filter(|from| *from < before.len()) else { continue };
                if depth_m <= nearest_m[from] {
                    nearest_m[from] = depth_m;
                    before[from] = flow;
                }
            }
        }
    });
}

/// Gives each tile the fastest motion among those that pass it on their way. Only tiles with a jump in their motion send one out:
/// what passes a pixel without being there at the beginning or the end has rims.
fn spread(now: &Picture, tiles: [usize; 2], passing: &mut [[f32; 2]]) {
    let [width, height] = now.size_px;
    let fastest_of = |tile: usize| {
        let (tx, ty) = (tile % tiles[0] * TILE_PX, tile / tiles[0] * TILE_PX);
        let (mut fastest, mut slowest) = ([0.0; 2], [f32::INFINITY; 2]);
        // One pixel more to the left and above: a jump may lie between two tiles.
        for y in ty.saturating_sub(1)..(ty + TILE_PX).min(height) {
            for flow in &now.flow[y * width + tx.saturating_sub(1)..y * width + (tx + TILE_PX).min(width)] {
                if norm2(*flow) > norm2(fastest) {
                    fastest = *flow;
                }
                if norm2(*flow) < norm2(slowest) {
                    slowest = *flow;
                }
            }
        }
        if smooth(fastest, slowest) { [0.0; 2] } else { fastest }
    };
    let fastest: Vec<[f32; 2]> = (0..tiles[0] * tiles[1]).into_par_iter().map(fastest_of).collect();
    for (tile, m) in fastest.iter().enumerate().filter(|(_, m)| norm2(**m) > 0.0) {
        let (tx, ty) = (tile % tiles[0], tile / tiles[0]);
        let back = m.map(|m| (m / TILE_PX as f32).clamp(-1e4, 1e4));
        let n_steps = back[0].abs().max(back[1].abs()).ceil() as i32 + 1;
        for step in 0..=n_steps {
            let share = step as f32 / n_steps as f32;
            let (x, y) = ((tx as f32 - back[0] * share).round(), (ty as f32 - back[1] * share).round());
            if x >= 0.0 && y >= 0.0 && x < tiles[0] as f32 && y < tiles[1] as f32 {
                let passed = &mut passing[y as usize * tiles[0] + x as usize];
                if norm2(*m) > norm2(*passed) {
                    *passed = *m;
                }
            }
        }
    }
}
