//! A way round what stands, over a lane that may belong to oncoming traffic: whether the time that it
//! takes is less than the time until somebody comes.

use crate::lanes::path::{Foot, Path};
use crate::plane::{distance, wrap};
use crate::speed;
use crate::traffic::{Grid, Mover, Traffic};

/// Time between our return to the lane and an oncoming vehicle, seconds: before a way round is begun,
/// and below which it is broken off.
pub(crate) const MARGIN_SECS: f64 = 2.0;
pub(crate) const BEGUN_MARGIN_SECS: f64 = 0.5;
/// Time to begin to move, seconds, and acceleration with which a way round is driven at least, m/s².
const START_SECS: f64 = 0.5;
const CALM_ACCEL_MPS2: f64 = 1.4;
/// Fastest oncoming vehicle that is looked for, m/s.
const FASTEST_MPS: f64 = 40.0;
/// A queue nearer to the way round than this may start before it has been driven, metres.
const QUEUE_ROOM_M: f64 = 40.0;
/// Beyond this a vehicle that drives straight at us counts wherever the path leads, metres.
const FAR_M: f64 = 30.0;
const STRAIGHT_RAD: f64 = 0.15;

/// What is seen of a vehicle that goes round something.
pub(crate) struct Scene<'a> {
    pub me: &'a Mover,
    pub foot: Foot,
    pub traffic: &'a Traffic,
    pub grid: &'a Grid,
}

/// A way round something over the lane beside, which may belong to oncoming traffic.
#[derive(Clone, Debug)]
pub(crate) struct Detour {
    pub blocker: u32,
    /// Path lengths between which the whole offset is kept, and at which it ends, metres.
    pub between_m: [f64; 2],
    pub until_m: f64,
    pub offset_m: f64,
    /// Speed that its bends allow, m/s.
    pub pace_mps: f64,
    /// The path without it.
    pub before: Box<Path>,
}

impl Detour {
    /// Whether somebody is on the way round, or will come along it before it has been driven.
    pub fn is_taken(&self, scene: &Scene, is_queueing: impl Fn(u32) -> bool) -> bool {
        let (me, from_m) = (scene.me, scene.foot.arc_m);
        let is_on_it = self.near(scene, 0.0).any(|(mover, at)| {
            let overlaps = at.arc_m > from_m - 12.0 && at.arc_m < self.until_m + 4.0;
            let is_next_in_lane = at.arc_m > self.between_m[1]
                && at.arc_m < self.until_m + 6.0
                && at.offset_m.abs() < 1.5;
            // One that stands there facing us may start.
            let may_come = overlaps
                || is_queueing(mover.id)
                    && at.arc_m < self.until_m + QUEUE_ROOM_M
                    && faces(mover, at);
            self.in_strip(mover, me, at) && may_come || is_next_in_lane
        });
        is_on_it || self.meets_oncoming(scene, MARGIN_SECS)
    }

    /// Whether an oncoming vehicle is there before the way round has been driven and some time more.
    pub fn meets_oncoming(&self, scene: &Scene, margin_secs: f64) -> bool {
        let me = scene.me;
        let left_m = self.until_m - scene.foot.arc_m;
        let mine_secs = speed::travel_secs(left_m, me.speed_mps, self.pace_mps, CALM_ACCEL_MPS2)
            + START_SECS
            + margin_secs;
        let middle = self
            .before
            .at(0.5 * (scene.foot.arc_m + self.until_m))
            .position_m;
        let reach_m = FASTEST_MPS * mine_secs;
        self.near(scene, reach_m).any(|(mover, at)| {
            let comes_mps = -(mover.velocity_mps[0] * at.heading_rad.cos()
                + mover.velocity_mps[1] * at.heading_rad.sin());
            if comes_mps < 0.5 || at.arc_m < scene.foot.arc_m {
                return false;
            }
            let along_m = at.arc_m - self.until_m;
            let straight_m = distance(mover.middle(), middle) - 0.5 * left_m;
            // Beyond a junction the path may turn away from the road on which it comes.
            let is_straight = heads_for(mover, middle);
            let left_m = match (self.in_strip(mover, me, at), is_straight) {
                (true, _) => along_m,
                (false, true) if along_m > FAR_M => straight_m,
                _ => return false,
            };
            let most = comes_mps.max(self.before.at(self.until_m).limit_mps);
            let theirs_secs =
                speed::travel_secs(left_m - mover.half_m[0], comes_mps, most, CALM_ACCEL_MPS2);
            theirs_secs < mine_secs
        })
    }

    /// Movers near the way round and along it, and where they are beside the path.
    fn near<'a>(
        &'a self,
        scene: &'a Scene<'a>,
        reach_m: f64,
    ) -> impl Iterator<Item = (&'a Mover, Foot)> {
        let front = scene.foot.arc_m + scene.me.front_m();
        let middle = self.before.at(0.5 * (front + self.until_m)).position_m;
        let reach_m = 0.5 * (self.until_m - front) + reach_m + QUEUE_ROOM_M;
        let (low, high) = (middle.map(|x| x - reach_m), middle.map(|x| x + reach_m));
        let start = self.before.point_idx(self.between_m[1]);
        let is_other = move |mover: &&Mover| {
            mover.is_vehicle && mover.id != scene.me.id && mover.id != self.blocker
        };
        let movers = scene.grid.within(low, high);
        movers
            .map(|idx| &scene.traffic.movers[idx as usize])
            .filter(is_other)
            .map(move |mover| (mover, self.before.descend(mover.middle(), start).0))
    }

    /// Whether a mover is where the way round leads, or beside it where that goes on.
    fn in_strip(&self, mover: &Mover, me: &Mover, at: Foot) -> bool {
        let aside = mover.half_m[1] + 0.6;
        at.offset_m + aside > self.offset_m - me.half_m[1] - 1.0
            && at.offset_m - aside < self.offset_m + me.half_m[1] + 0.5
    }
}

/// Whether a vehicle stands or drives against the direction of the path beside it.
fn faces(mover: &Mover, at: Foot) -> bool {
    wrap(mover.yaw_rad - at.heading_rad).abs() > 2.3
}

/// Whether a vehicle drives straight towards a place.
fn heads_for(mover: &Mover, place_m: [f64; 2]) -> bool {
    let [x, y] = mover.middle();
    let there = (place_m[1] - y).atan2(place_m[0] - x);
    let course = mover.velocity_mps[1].atan2(mover.velocity_mps[0]);
    wrap(there - course).abs() < STRAIGHT_RAD
}
