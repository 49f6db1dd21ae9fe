//! The time between two firings, row by row.

use schema_frames::DvsEvent;
use sensor_core::vector::VectorWork;
use sensor_spec::DvsSpec;

use super::block::Block;
use super::chance::Chance;
use super::crossing::Crossing;
use super::images::{EventImages, word};
use super::lanes::LANES;
use super::level_image::LevelImage;
use super::motion_field::{MotionField, Path, TileMotion, norm2};

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

/// One row of a window.
pub(super) struct Row<'w> {
    pub window: &'w Window<'w>,
    pub y: usize,
    /// Level at the last event, per pixel.
    pub references: &'w mut [f32],
    /// Rest of the refractory period, per pixel; empty without such a period.
    pub silent_nanos: &'w mut [u32],
    pub images: &'w EventImages<'w>,
    /// Its events; earlier contents are replaced.
    pub events: &'w mut Vec<DvsEvent>,
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

impl VectorWork for Row<'_> {
    type Out = ();

    #[inline(always)]
    fn run(self) {
        let Row {
            window,
            y,
            references,
            silent_nanos,
            images,
            events,
        } = self;
        let (ids, classes) = (images.instance.row(y), images.class.row(y));
        events.clear();
        for first in (0..references.len()).step_by(LANES) {
            let end = (first + LANES).min(references.len());
            let silent_nanos = if silent_nanos.is_empty() {
                &mut [][..]
            } else {
                &mut silent_nanos[first..end]
            };
            let mut pixels = Pixels {
                x: first,
                y,
                references: &mut references[first..end],
                silent_nanos,
                none: 0,
            };
            window.follow_pixels(&mut pixels, &mut |lane, nanos_in_window, polarity| {
                let x = first + lane;
                events.push(DvsEvent {
                    nanos_in_window,
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

impl Window<'_> {
    /// Follows up to [`LANES`] neighbouring pixels and calls `event(lane, nanos_in_window,
    /// polarity)` for each crossing.
    #[inline(always)]
    fn follow_pixels(&self, pixels: &mut Pixels<'_>, event: &mut impl FnMut(usize, u32, u8)) {
        let (x, y) = (pixels.x, pixels.y);
        let row = y * self.now.size_px[0];
        let n = pixels.references.len();
        let begin = &self.previous.level[row + x..row + x + n];
        let end = &self.now.level[row + x..row + x + n];
        match self.motion.map(|motion| (motion, motion.tile_motion(x, y))) {
            None | Some((_, TileMotion::Slow)) => self.follow_still(pixels, begin, end, event),
            Some((motion, TileMotion::Smooth)) => {
                let motions = motion.of_block(x, y, n);
                let mut block = Block::new(x, y);
                for lane in 0..n {
                    let limits = self.crossing(pixels, lane).limits();
                    let motions = [motions[0][lane], motions[1][lane]];
                    block.set(
                        lane,
                        motions,
                        [begin[lane], end[lane] + self.leak],
                        limits,
                        self.now.size_px,
                    );
                }
                self.follow_smooth(&mut block, pixels, event);
            }
            Some((motion, TileMotion::Mixed)) => {
                self.follow_mixed(motion, pixels, begin, end, event)
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

    /// Pixels whose level is interpolated linearly between the images.
    #[inline(always)]
    fn follow_still(
        &self,
        pixels: &mut Pixels<'_>,
        begin: &[f32],
        end: &[f32],
        event: &mut impl FnMut(usize, u32, u8),
    ) {
        let n = pixels.references.len();
        // Fast path for most pixels of most images: nothing happens. Thresholds that vary are
        // checked one by one.
        if n == LANES && self.mismatch.is_empty() && !self.is_spread() {
            let (up, down) = (self.spec.positive_threshold, self.spec.negative_threshold);
            let mut beyond = false;
            for (end, reference) in end.iter().zip(pixels.references.iter()) {
                let change = end + self.leak - reference;
                beyond |= (change >= up) | (change <= -down);
            }
            if !beyond {
                return;
            }
        }
        for lane in 0..n {
            let mut crossing = self.crossing(pixels, lane);
            let after = end[lane] + self.leak;
            crossing.follow(begin[lane], after, 0, self.nanos, &mut |nanos, polarity| {
                event(lane, nanos, polarity)
            });
        }
    }

    /// Pixels that different surfaces pass.
    #[inline(never)]
    fn follow_mixed(
        &self,
        motion: &MotionField<'_>,
        pixels: &mut Pixels<'_>,
        begin: &[f32],
        end: &[f32],
        event: &mut impl FnMut(usize, u32, u8),
    ) {
        let mut block = Block::new(pixels.x, pixels.y);
        for lane in 0..pixels.references.len() {
            let levels = [begin[lane], end[lane] + self.leak];
            let at = [pixels.x + lane, pixels.y];
            let mut crossing = self.crossing(pixels, lane);
            let event = &mut |nanos, polarity| event(lane, nanos, polarity);
            match motion.path(at[0], at[1]) {
                Path::Still => crossing.follow(levels[0], levels[1], 0, self.nanos, event),
                Path::Smooth { begin, end } => block.set(
                    lane,
                    [begin, end],
                    levels,
                    crossing.limits(),
                    self.now.size_px,
                ),
                Path::Several { motions, n } => {
                    self.follow_several(motion, &motions[..n], at, &mut crossing, event)
                }
            }
        }
        if block.any() {
            self.follow_smooth(&mut block, pixels, event);
        }
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

    /// Pixels that one surface passes; all use the steps of the fastest.
    #[inline(always)]
    fn follow_smooth(
        &self,
        block: &mut Block,
        pixels: &mut Pixels<'_>,
        event: &mut impl FnMut(usize, u32, u8),
    ) {
        let n_steps = self.n_steps(block.fastest_px());
        let per_step = 1.0 / n_steps as f32;
        let bounds = [&self.previous.bounds, &self.now.bounds];
        let mut before = block.begin;
        let mut step = 0;
        while step < n_steps {
            // A stretch whose bounds exclude a crossing is skipped at once.
            let last = (step + STRETCH_STEPS).min(n_steps);
            let quiet = block.is_quiet(
                bounds,
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
                if block.crosses(&levels) {
                    for lane in block.crossing_lanes(&levels) {
                        let mut crossing = self.crossing(pixels, lane);
                        let (begin_nanos, end_nanos) =
                            (self.nanos(step, n_steps), self.nanos(next, n_steps));
                        crossing.follow(
                            before[lane],
                            levels[lane],
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
        motions: &[[f32; 2]],
        [x, y]: [usize; 2],
        crossing: &mut Crossing<'_>,
        event: &mut impl FnMut(u32, u8),
    ) {
        let i = y * self.now.size_px[0] + x;
        let fastest_px = motions.iter().map(|m| norm2(*m)).fold(0.0, f32::max).sqrt();
        let n_steps = self.n_steps(fastest_px);
        let mut before = self.previous.level[i];
        for step in 1..=n_steps {
            let share = step as f32 / n_steps as f32;
            let level = if step == n_steps {
                self.now.level[i]
            } else {
                motion.level(self.previous, self.now, motions, x, y, share)
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
