//! Neighbouring pixels that one surface passes, followed together.

use sensor_core::vector_lanes::Lanes;

use super::lanes::LANES;
use super::level_image::LevelImage;

/// What is known of a block's pixels before they are followed. Pixels that were not set do not move
/// and never cross a threshold.
#[derive(Debug)]
pub(super) struct BlockPixels {
    /// Motion at the beginning and at the end, pixels per window.
    pub motions: [[[f32; 2]; LANES]; 2],
    /// Levels at the beginning and at the end of the window.
    pub levels: [[f32; LANES]; 2],
    /// Levels at which the next events come, below and above.
    pub limits: [[f32; LANES]; 2],
}

impl BlockPixels {
    /// Pixels none of which is set.
    #[inline(always)]
    pub fn unset() -> BlockPixels {
        BlockPixels {
            motions: [[[0.0; 2]; LANES]; 2],
            levels: [[0.0; LANES]; 2],
            limits: [[f32::NEG_INFINITY; LANES], [f32::INFINITY; LANES]],
        }
    }

    /// Sets a pixel: motions and levels at the beginning and the end, and the limits of its next
    /// events.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, motions: [[f32; 2]; 2], levels: [f32; 2], limits: [f32; 2]) {
        for i in 0..2 {
            self.motions[i][lane] = motions[i];
            self.levels[i][lane] = levels[i];
            self.limits[i][lane] = limits[i];
        }
    }
}

/// Pixels of one row on their paths.
pub(super) struct Block<L: Lanes> {
    at: [L; 2],
    /// Motion at the beginning, x and y, pixels per window; in between it changes evenly.
    from: [L; 2],
    /// Change of the motion until the end.
    change: [L; 2],
    /// Levels at the beginning of the window.
    pub begin: L,
    /// Levels at the end of the window.
    pub end: L,
    limits: [[f32; LANES]; 2],
    /// Whether no path leaves the image.
    stays_inside: bool,
}

/// Positions of points in the image at the end and in the image at the beginning.
struct Places<L: Lanes> {
    ahead: [L; 2],
    behind: [L; 2],
}

impl<L: Lanes> Block<L> {
    /// The block whose first pixel is at `x`, `y`.
    #[inline(always)]
    pub fn new(x: usize, y: usize, pixels: &BlockPixels, size_px: [usize; 2]) -> Block<L> {
        let xs = std::array::from_fn(|lane| (x + lane) as f32 + 0.5);
        let at = [L::load(&xs), L::splat(y as f32 + 0.5)];
        let (from, to) = (L::unzip(&pixels.motions[0]), L::unzip(&pixels.motions[1]));
        let mut inside = 0xff;
        for axis in 0..2 {
            for motion in [from[axis], to[axis]] {
                for far in [at[axis].add(motion), at[axis].sub(motion)] {
                    inside &= L::bits(is_between(far, size_px[axis] as f32));
                }
            }
        }
        Block {
            at,
            from,
            change: [to[0].sub(from[0]), to[1].sub(from[1])],
            begin: L::load(&pixels.levels[0]),
            end: L::load(&pixels.levels[1]),
            limits: pixels.limits,
            stays_inside: inside == 0xff,
        }
    }

    #[inline(always)]
    pub fn set_limits(&mut self, lane: usize, [low, high]: [f32; 2]) {
        self.limits[0][lane] = low;
        self.limits[1][lane] = high;
    }

    /// The fastest motion, pixels per window.
    #[inline(always)]
    pub fn fastest_px(&self) -> f32 {
        let norm2 = |share: f32| {
            let [x, y] = self.motion(L::splat(share));
            x.mul(x).add(y.mul(y))
        };
        norm2(0.0).max(norm2(1.0)).largest().max(0.0).sqrt()
    }

    #[inline(always)]
    fn motion(&self, share: L) -> [L; 2] {
        [
            self.from[0].add(self.change[0].mul(share)),
            self.from[1].add(self.change[1].mul(share)),
        ]
    }

    #[inline(always)]
    fn places(&self, share: f32) -> Places<L> {
        let motion = self.motion(L::splat(share));
        Places {
            ahead: self.along(motion, L::splat(1.0 - share)),
            behind: self.along(motion, L::splat(-share)),
        }
    }

    #[inline(always)]
    fn along(&self, motion: [L; 2], weight: L) -> [L; 2] {
        [
            self.at[0].add(motion[0].mul(weight)),
            self.at[1].add(motion[1].mul(weight)),
        ]
    }

    /// Whether no level between these shares of the paths can cross a limit of any pixel, if
    /// references sink by `leak` at most.
    #[inline(always)]
    pub fn is_quiet(&self, images: [&LevelImage; 2], from: f32, to: f32, leak: f32) -> bool {
        let (from, to) = (self.places(from), self.places(to));
        let before = images[0].bounds_within(corners(from.behind, to.behind));
        let after = images[1].bounds_within(corners(from.ahead, to.ahead));
        self.excludes((before.0.min(after.0), before.1.max(after.1)), leak)
    }

    /// Whether levels within these bounds cross no limit of any pixel, if references sink by `leak`
    /// at most.
    #[inline(always)]
    pub fn excludes(&self, (lowest, highest): (f32, f32), leak: f32) -> bool {
        let (low, high) = (L::load(&self.limits[0]), L::load(&self.limits[1]));
        lowest > low.largest() && highest + leak < high.smallest()
    }

    /// Levels when `share` of the window has passed and references have sunk by `leaked`, sampled
    /// in both images or in the one that shows the point.
    #[inline(always)]
    pub fn levels(&self, previous: &LevelImage, now: &LevelImage, share: f32, leaked: f32) -> L {
        let places = self.places(share);
        let (before, after) = (
            previous.levels_at(places.behind),
            now.levels_at(places.ahead),
        );
        let (part, leaked) = (L::splat(share), L::splat(leaked));
        if self.stays_inside {
            return before.add(after.sub(before).mul(part)).add(leaked);
        }
        let was_inside = is_inside(places.behind, now.size_px);
        let will_be = is_inside(places.ahead, now.size_px);
        let is_seen = L::or(was_inside, will_be);
        // If one image does not show the point, the other one's level is used for both; if
        // neither shows it, the level is interpolated linearly.
        let from = L::select(was_inside, before, after);
        let to = L::select(will_be, after, before);
        let from = L::select(is_seen, from, self.begin);
        let to = L::select(is_seen, to, self.end);
        let own = L::select(is_seen, leaked, L::splat(0.0));
        from.add(to.sub(from).mul(part)).add(own)
    }

    /// The lanes whose level is beyond its limits, as bits.
    #[inline(always)]
    pub fn crossing_lanes(&self, levels: L) -> u32 {
        let (low, high) = (L::load(&self.limits[0]), L::load(&self.limits[1]));
        let zero = L::splat(0.0);
        L::bits(L::or(zero.le(levels.sub(high)), zero.le(low.sub(levels))))
    }
}

/// Where numbers are from 0 to `end`.
#[inline(always)]
fn is_between<L: Lanes>(x: L, end: f32) -> L::Mask {
    L::and(L::splat(0.0).le(x), x.le(L::splat(end)))
}

/// Where points are inside an image.
#[inline(always)]
fn is_inside<L: Lanes>(at: [L; 2], size_px: [usize; 2]) -> L::Mask {
    L::and(
        is_between(at[0], size_px[0] as f32),
        is_between(at[1], size_px[1] as f32),
    )
}

/// Smallest and largest x and y of two sets of points.
#[inline(always)]
fn corners<L: Lanes>(a: [L; 2], b: [L; 2]) -> [[f32; 2]; 2] {
    [
        [a[0].min(b[0]).smallest(), a[1].min(b[1]).smallest()],
        [a[0].max(b[0]).largest(), a[1].max(b[1]).largest()],
    ]
}
