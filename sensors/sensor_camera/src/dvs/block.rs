//! Neighbouring pixels that one surface passes, followed together: plain arithmetic over arrays,
//! which the compiler vectorises.

use super::lanes::{LANES, Lanes, larger, smaller};
use super::level_image::{Bounds, LevelImage};

/// Pixels of one row. Those that were not set do not move and never cross a threshold.
#[derive(Debug)]
pub(super) struct Block {
    at: [Lanes; 2],
    /// Motion at the beginning, x and y, pixels per window; in between it changes evenly.
    from: [Lanes; 2],
    /// Change of the motion until the end.
    change: [Lanes; 2],
    /// Levels at the beginning of the window.
    pub begin: Lanes,
    /// Levels at the end of the window.
    pub end: Lanes,
    low: Lanes,
    high: Lanes,
    /// Whether no path leaves the image.
    stays_inside: bool,
}

/// Positions of points in the image at the end and in the image at the beginning.
struct Places {
    ahead: [Lanes; 2],
    behind: [Lanes; 2],
}

impl Block {
    #[inline(always)]
    pub fn new(x: usize, y: usize) -> Block {
        let xs = std::array::from_fn(|lane| (x + lane) as f32 + 0.5);
        let zeros = [0.0; LANES];
        Block {
            at: [xs, [y as f32 + 0.5; LANES]],
            from: [zeros; 2],
            change: [zeros; 2],
            begin: zeros,
            end: zeros,
            low: [f32::NEG_INFINITY; LANES],
            high: [f32::INFINITY; LANES],
            stays_inside: true,
        }
    }

    /// Sets a pixel: motion and level at the beginning and the end, and the limits of its next
    /// events.
    #[inline(always)]
    pub fn set(
        &mut self,
        lane: usize,
        motions: [[f32; 2]; 2],
        levels: [f32; 2],
        limits: [f32; 2],
        size_px: [usize; 2],
    ) {
        for axis in 0..2 {
            for m in motions {
                let far = [self.at[axis][lane] + m[axis], self.at[axis][lane] - m[axis]];
                self.stays_inside &= far.iter().all(|x| (0.0..=size_px[axis] as f32).contains(x));
            }
            self.from[axis][lane] = motions[0][axis];
            self.change[axis][lane] = motions[1][axis] - motions[0][axis];
        }
        [self.begin[lane], self.end[lane]] = levels;
        self.set_limits(lane, limits);
    }

    #[inline(always)]
    pub fn set_limits(&mut self, lane: usize, limits: [f32; 2]) {
        [self.low[lane], self.high[lane]] = limits;
    }

    /// Whether any pixel was set.
    #[inline(always)]
    pub fn any(&self) -> bool {
        self.high.iter().any(|high| *high < f32::INFINITY)
    }

    #[inline(always)]
    pub fn fastest_px(&self) -> f32 {
        let norm2 = |lane: usize, share: f32| {
            let m = [0, 1].map(|axis| self.from[axis][lane] + self.change[axis][lane] * share);
            m[0] * m[0] + m[1] * m[1]
        };
        (0..LANES)
            .map(|lane| norm2(lane, 0.0).max(norm2(lane, 1.0)))
            .fold(0.0, f32::max)
            .sqrt()
    }

    #[inline(always)]
    fn places(&self, share: f32) -> Places {
        let along = |axis: usize, weight: f32| -> Lanes {
            std::array::from_fn(|lane| {
                self.at[axis][lane]
                    + (self.from[axis][lane] + self.change[axis][lane] * share) * weight
            })
        };
        Places {
            ahead: [along(0, 1.0 - share), along(1, 1.0 - share)],
            behind: [along(0, -share), along(1, -share)],
        }
    }

    /// Whether no level between these shares of the paths can cross a limit of any pixel, if
    /// references sink by `leak` at most.
    #[inline(always)]
    pub fn is_quiet(&self, bounds: [&Bounds; 2], from: f32, to: f32, leak: f32) -> bool {
        let (from, to) = (self.places(from), self.places(to));
        let before = bounds[0].within(corners(&from.behind, &to.behind));
        let after = bounds[1].within(corners(&from.ahead, &to.ahead));
        let (lowest, highest) = (smaller(before.0, after.0), larger(before.1, after.1));
        let (low, high) = (
            self.low.iter().copied().fold(f32::NEG_INFINITY, larger),
            self.high.iter().copied().fold(f32::INFINITY, smaller),
        );
        lowest > low && highest + leak < high
    }

    /// Levels when `share` of the window has passed and references have sunk by `leaked`, sampled
    /// in both images or in the one that shows the point.
    #[inline(always)]
    pub fn levels(
        &self,
        previous: &LevelImage,
        now: &LevelImage,
        share: f32,
        leaked: f32,
    ) -> Lanes {
        let places = self.places(share);
        let (before, after) = (
            previous.levels_at(&places.behind),
            now.levels_at(&places.ahead),
        );
        if self.stays_inside {
            return std::array::from_fn(|lane| {
                before[lane] + (after[lane] - before[lane]) * share + leaked
            });
        }
        let [width, height] = now.size_px.map(|px| px as f32);
        let is_inside = |at: &[Lanes; 2], lane: usize| {
            let (x, y) = (at[0][lane], at[1][lane]);
            (x >= 0.0) & (y >= 0.0) & (x <= width) & (y <= height)
        };
        std::array::from_fn(|lane| {
            let (was_inside, will_be) = (
                is_inside(&places.behind, lane),
                is_inside(&places.ahead, lane),
            );
            // If one image does not show the point, the other one's level is used for both; if
            // neither shows it, the level is interpolated linearly.
            let from = if was_inside {
                before[lane]
            } else {
                after[lane]
            };
            let to = if will_be { after[lane] } else { before[lane] };
            let (from, to) = if was_inside | will_be {
                (from, to)
            } else {
                (self.begin[lane], self.end[lane])
            };
            let own = if was_inside | will_be { leaked } else { 0.0 };
            from + (to - from) * share + own
        })
    }

    /// Whether any level is beyond its limits.
    #[inline(always)]
    pub fn crosses(&self, levels: &Lanes) -> bool {
        let mut beyond = f32::NEG_INFINITY;
        for ((level, high), low) in levels.iter().zip(&self.high).zip(&self.low) {
            beyond = larger(larger(level - high, low - level), beyond);
        }
        beyond >= 0.0
    }

    /// The lanes whose level is beyond its limits.
    #[inline(always)]
    pub fn crossing_lanes(&self, levels: &Lanes) -> impl Iterator<Item = usize> + use<> {
        let is_beyond: [bool; LANES] = std::array::from_fn(|lane| {
            levels[lane] - self.high[lane] >= 0.0 || self.low[lane] - levels[lane] >= 0.0
        });
        (0..LANES).filter(move |lane| is_beyond[*lane])
    }
}

/// Smallest and largest x and y of two sets of points.
#[inline(always)]
fn corners(a: &[Lanes; 2], b: &[Lanes; 2]) -> [[f32; 2]; 2] {
    let fold = |axis: usize, pick: fn(f32, f32) -> f32| {
        (0..LANES)
            .map(|lane| pick(a[axis][lane], b[axis][lane]))
            .reduce(pick)
            .unwrap_or(0.0)
    };
    [
        [fold(0, smaller), fold(1, smaller)],
        [fold(0, larger), fold(1, larger)],
    ]
}
