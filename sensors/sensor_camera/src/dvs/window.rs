//! The time between two firings, one row of tiles after another.

use schema_frames::DvsEvent;
use sensor_core::vector_lanes::{LaneWork, Lanes};
use sensor_spec::DvsSpec;

use super::block::{Block, BlockPixels};
use super::chance::Chance;
use super::crossing::Crossing;
use super::images::{EventImages, word};
use super::lanes::LANES;
use super::level_image::LevelImage;
use super::motion_field::{MotionField, Passers, Path, TileMotion};
use super::tiles::TILE_PX;

/// Limit of steps in one window; with faster motion, steps exceed `substep_px`.
const MAX_STEPS: usize = 256;
/// Steps that are tested at once: with fewer, looking at tiles costs more than it saves (bench
/// measure_views).
const STRETCH_STEPS: usize = 24;

/// The time between two firings.
pub(super) struct Window<'w> {
    pub previous: &'w LevelImage,
    pub now: &'w LevelImage,
    /// `None`: every level is interpolated linearly.
    pub motion: Option<&'w MotionField<'w>>,
    pub spec: &'w DvsSpec,
    /// Factor of both thresholds per pixel; empty without mismatch.
    pub mismatch: &'w [f32],
    pub chance: &'w Chance,
    /// Count of windows before this one.
    pub number: u64,
    pub nanos: u32,
    /// How much every reference sinks in the window.
    pub leak: f32,
}

/// One row of tiles of a window.
pub(super) struct TileRow<'w> {
    pub window: &'w Window<'w>,
    pub ty: usize,
    /// Level at the last event, per pixel.
    pub references: &'w mut [f32],
    /// Rest of the refractory period, per pixel; empty without such a period.
    pub silent_nanos: &'w mut [u32],
    pub images: &'w EventImages<'w>,
    /// Its rows' events; earlier contents are replaced.
    pub events: &'w mut [Vec<DvsEvent>],
}

/// Neighbouring pixels and their state.
struct Pixels<'p> {
    x: usize,
    y: usize,
    references: &'p mut [f32],
    silent_nanos: &'p mut [u32],
    /// Stands in for a refractory period where there is none.
    none: u32,
}

impl LaneWork for TileRow<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let (window, images, ty) = (self.window, self.images, self.ty);
        let width = window.now.size_px[0];
        let mut bounds = vec![None; width.div_ceil(TILE_PX)];
        let mut silent_rows = self.silent_nanos.chunks_mut(width);
        let rows = self.references.chunks_mut(width).zip(self.events);
        for (i, (references, events)) in rows.enumerate() {
            let y = ty * TILE_PX + i;
            let (ids, classes) = (images.instance.row(y), images.class.row(y));
            let silent_nanos = silent_rows.next().unwrap_or(&mut []);
            events.clear();
            for (tx, references) in references.chunks_mut(LANES).enumerate() {
                let x = tx * LANES;
                let silent_nanos = if silent_nanos.is_empty() {
                    &mut [][..]
                } else {
                    &mut silent_nanos[x..x + references.len()]
                };
                let mut pixels = Pixels {
                    x,
                    y,
                    references,
                    silent_nanos,
                    none: 0,
                };
                let bounds = &mut bounds[tx];
                window.follow_pixels::<L>(&mut pixels, bounds, &mut |lane, nanos, polarity| {
                    let x = x + lane;
                    events.push(DvsEvent {
                        nanos_in_window: nanos,
                        x_px: x as u16,
                        y_px: y as u16,
                        object_id: word(&ids[4 * x..]),
                        polarity,
                        class: classes[x],
                        reserved: 0,
                    });
                });
            }
        }
    }
}

/// Darkest and brightest level on all paths of a tile, found when it is first asked for.
type TileBounds = Option<(f32, f32)>;

impl Window<'_> {
    /// Follows up to [`LANES`] neighbouring pixels and calls `event(lane, nanos_in_window,
    /// polarity)` for each crossing.
    #[inline(always)]
    fn follow_pixels<L: Lanes>(
        &self,
        pixels: &mut Pixels<'_>,
        bounds: &mut TileBounds,
        event: &mut impl FnMut(usize, u32, u8),
    ) {
        let (x, y) = (pixels.x, pixels.y);
        let row = y * self.now.size_px[0];
        let n = pixels.references.len();
        let begin = &self.previous.level[row + x..row + x + n];
        let end = &self.now.level[row + x..row + x + n];
        let motion = self
            .motion
            .map(|motion| (motion, motion.tile_motion(x / TILE_PX, y / TILE_PX)));
        match motion {
            None | Some((_, TileMotion::Slow)) => self.follow_still::<L>(pixels, begin, end, event),
            Some((motion, kind)) => {
                let bounds =
                    *bounds.get_or_insert_with(|| self.bounds_of(motion, x / TILE_PX, y / TILE_PX));
                let mut block = BlockPixels::unset();
                let any = if kind == TileMotion::Smooth {
                    self.set_smooth::<L>(motion, pixels, [begin, end], &mut block);
                    true
                } else {
                    self.set_mixed(motion, pixels, [begin, end], bounds, &mut block, event)
                };
                if any {
                    let block = Block::<L>::new(x, y, &block, self.now.size_px);
                    self.follow_smooth(block, pixels, bounds, event);
                }
            }
        }
        for silent_nanos in pixels.silent_nanos.iter_mut() {
            *silent_nanos = silent_nanos.saturating_sub(self.nanos);
        }
        if self.leak > 0.0 {
            pixels
                .references
                .iter_mut()
                .for_each(|reference| *reference -= self.leak);
        }
    }

    /// Darkest and brightest level on all paths of a tile.
    #[inline(never)]
    fn bounds_of(&self, motion: &MotionField<'_>, tx: usize, ty: usize) -> (f32, f32) {
        let [behind, ahead] = motion.reach(tx, ty);
        let before = self.previous.bounds_within(behind);
        let after = self.now.bounds_within(ahead);
        (before.0.min(after.0), before.1.max(after.1))
    }

    /// Pixels whose level is interpolated linearly between the images.
    #[inline(always)]
    fn follow_still<L: Lanes>(
        &self,
        pixels: &mut Pixels<'_>,
        begin: &[f32],
        end: &[f32],
        event: &mut impl FnMut(usize, u32, u8),
    ) {
        let n = pixels.references.len();
        let mut lanes = (1_u32 << n) - 1;
        // Fast path for most pixels of most images: nothing happens. Thresholds that vary are
        // checked one by one.
        if let (Some(end), Some(begin), Some(references)) = (
            end.first_chunk(),
            begin.first_chunk(),
            pixels.references.first_chunk(),
        ) && !self.is_uneven()
        {
            let (begin, references) = (L::load(begin), L::load(references));
            let after = L::load(end).add(L::splat(self.leak));
            let (up, down) = (self.spec.positive_threshold, self.spec.negative_threshold);
            let change = after.sub(references);
            let is_moved = L::or(L::splat(up).le(change), change.le(L::splat(-down)));
            if L::bits(is_moved) == 0 {
                return;
            }
            // As `Crossing::follow` decides.
            let rises = begin.lt(after);
            let (high, low) = (references.add(L::splat(up)), references.sub(L::splat(down)));
            let beyond = L::or(
                L::and(rises, high.le(after)),
                L::and(after.le(begin), after.le(low)),
            );
            lanes = L::bits(beyond);
        }
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let mut crossing = self.crossing(pixels, lane);
            let after = end[lane] + self.leak;
            crossing.follow(begin[lane], after, 0, self.nanos, &mut |nanos, polarity| {
                event(lane, nanos, polarity)
            });
        }
    }

    /// Sets the pixels of a tile that one surface passes.
    #[inline(always)]
    fn set_smooth<L: Lanes>(
        &self,
        motion: &MotionField<'_>,
        pixels: &mut Pixels<'_>,
        [begin, end]: [&[f32]; 2],
        block: &mut BlockPixels,
    ) {
        let n = pixels.references.len();
        let motions = motion.of_block(pixels.x, pixels.y, n);
        if let (Some(begin), Some(end), Some(references)) = (
            begin.first_chunk(),
            end.first_chunk(),
            pixels.references.first_chunk(),
        ) && let (Some(from), Some(to)) = (motions[0].first_chunk(), motions[1].first_chunk())
            && !self.is_uneven()
        {
            let references = L::load(references);
            let low = references.sub(L::splat(self.spec.negative_threshold));
            let high = references.add(L::splat(self.spec.positive_threshold));
            let end = L::load(end).add(L::splat(self.leak));
            *block = BlockPixels {
                motions: [*from, *to],
                levels: [*begin, end.store()],
                limits: [low.store(), high.store()],
            };
            return;
        }
        for lane in 0..n {
            let limits = self.crossing(pixels, lane).limits();
            let levels = [begin[lane], end[lane] + self.leak];
            block.set(lane, [motions[0][lane], motions[1][lane]], levels, limits);
        }
    }

    /// Sets the pixels of a tile that one surface passes, and follows those that several pass;
    /// says whether any was set.
    #[inline(never)]
    fn set_mixed(
        &self,
        motion: &MotionField<'_>,
        pixels: &mut Pixels<'_>,
        [begin, end]: [&[f32]; 2],
        bounds: (f32, f32),
        block: &mut BlockPixels,
        event: &mut impl FnMut(usize, u32, u8),
    ) -> bool {
        let mut any = false;
        for lane in 0..pixels.references.len() {
            let levels = [begin[lane], end[lane] + self.leak];
            let at = [pixels.x + lane, pixels.y];
            let mut crossing = self.crossing(pixels, lane);
            let [low, high] = crossing.limits();
            if bounds.0 > low && bounds.1 + self.leak < high {
                continue;
            }
            let event = &mut |nanos, polarity| event(lane, nanos, polarity);
            match motion.path(at[0], at[1]) {
                Path::Still => crossing.follow(levels[0], levels[1], 0, self.nanos, event),
                Path::Smooth { begin, end } => {
                    block.set(lane, [begin, end], levels, crossing.limits());
                    any = true;
                }
                Path::Several(passers) => {
                    self.follow_several(motion, &passers, at, &mut crossing, event)
                }
            }
        }
        any
    }

    /// Whether thresholds differ from pixel to pixel or from window to window.
    #[inline(always)]
    fn is_uneven(&self) -> bool {
        !self.mismatch.is_empty() || self.is_spread()
    }

    /// Whether thresholds differ from window to window.
    #[inline(always)]
    fn is_spread(&self) -> bool {
        self.spec.sigma_positive_threshold > 0.0 || self.spec.sigma_negative_threshold > 0.0
    }

    #[inline(always)]
    fn crossing<'p>(&self, pixels: &'p mut Pixels<'_>, lane: usize) -> Crossing<'p> {
        let i = pixels.y * self.now.size_px[0] + pixels.x + lane;
        let mut thresholds = [self.spec.positive_threshold, self.spec.negative_threshold];
        if self.is_spread() {
            thresholds = self.chance.thresholds(self.spec, self.number, i);
        }
        if !self.mismatch.is_empty() {
            thresholds = thresholds.map(|threshold| threshold * self.mismatch[i]);
        }
        let silent_nanos = if pixels.silent_nanos.is_empty() {
            &mut pixels.none
        } else {
            &mut pixels.silent_nanos[lane]
        };
        Crossing {
            thresholds,
            reference: &mut pixels.references[lane],
            silent_nanos,
            refractory_nanos: self.spec.refractory_nanos,
        }
    }

    #[inline(always)]
    fn n_steps(&self, fastest_px: f32) -> usize {
        ((fastest_px / self.spec.substep_px).min(MAX_STEPS as f32 - 1.0) as usize + 1)
            .clamp(1, MAX_STEPS)
    }

    fn nanos(&self, step: usize, n_steps: usize) -> u32 {
        (self.nanos as u64 * step as u64 / n_steps as u64) as u32
    }

    /// Pixels that one surface passes; all use the steps of the fastest. Their levels lie within
    /// `bounds`.
    #[inline(always)]
    fn follow_smooth<L: Lanes>(
        &self,
        mut block: Block<L>,
        pixels: &mut Pixels<'_>,
        bounds: (f32, f32),
        event: &mut impl FnMut(usize, u32, u8),
    ) {
        if block.excludes(bounds, self.leak) {
            return;
        }
        let n_steps = self.n_steps(block.fastest_px());
        let per_step = 1.0 / n_steps as f32;
        let images = [self.previous, self.now];
        let mut before = block.begin;
        let mut step = 0;
        while step < n_steps {
            let last = (step + STRETCH_STEPS).min(n_steps);
            // A stretch of a long path is skipped at once if its own bounds exclude a crossing.
            let quiet = n_steps > STRETCH_STEPS
                && block.is_quiet(
                    images,
                    step as f32 * per_step,
                    last as f32 * per_step,
                    self.leak,
                );
            let first = if quiet { last } else { step + 1 };
            for next in first..=last {
                let share = next as f32 * per_step;
                let levels = if next == n_steps {
                    block.end
                } else {
                    block.levels(self.previous, self.now, share, self.leak * share)
                };
                let mut lanes = block.crossing_lanes(levels);
                if lanes != 0 {
                    let (begin_nanos, end_nanos) =
                        (self.nanos(step, n_steps), self.nanos(next, n_steps));
                    let (from, to) = (before.store(), levels.store());
                    while lanes != 0 {
                        let lane = lanes.trailing_zeros() as usize;
                        lanes &= lanes - 1;
                        let mut crossing = self.crossing(pixels, lane);
                        crossing.follow(
                            from[lane],
                            to[lane],
                            begin_nanos,
                            end_nanos,
                            &mut |nanos, polarity| event(lane, nanos, polarity),
                        );
                        block.set_limits(lane, crossing.limits());
                    }
                }
                (before, step) = (levels, next);
            }
        }
    }

    /// A pixel that several surfaces pass.
    #[inline(never)]
    fn follow_several(
        &self,
        motion: &MotionField<'_>,
        passers: &Passers,
        [x, y]: [usize; 2],
        crossing: &mut Crossing<'_>,
        event: &mut impl FnMut(u32, u8),
    ) {
        let i = y * self.now.size_px[0] + x;
        let n_steps = self.n_steps(passers.fastest_px());
        let mut before = self.previous.level[i];
        for step in 1..=n_steps {
            let share = step as f32 / n_steps as f32;
            let level = if step == n_steps {
                self.now.level[i]
            } else {
                motion.level(self.previous, self.now, passers, [x, y], share)
            };
            let level = level + self.leak * share;
            crossing.follow(
                before,
                level,
                self.nanos(step - 1, n_steps),
                self.nanos(step, n_steps),
                event,
            );
            before = level;
        }
    }
}
