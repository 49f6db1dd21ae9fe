//! What keeps a driver from going on, and how it finds the first vehicle or walker on its path.

use crate::idm::{Idm, Leader};
use crate::lanes::path::{Foot, Path};
use crate::plane::{Side, distance};
use crate::speed;
use crate::traffic::{Grid, Mover, Stance, Traffic};

/// Largest offset of a long vehicle towards the inside of a bend, metres.
const INSIDE_M: f64 = 0.35;
/// Farthest that a front swings out, metres.
const MOST_SWING_M: f64 = 2.5;
/// Points between two that are tested first.
const STRIDE: usize = 4;
/// Most circles by which the box of a mover is covered.
const MOST_CIRCLES: f64 = 5.0;

/// Vehicles slower than this look where their own boxes will be, in so many steps, m/s.
const FORESIGHT_MPS: f64 = 8.0;
const FORESIGHT_STEPS: u32 = 6;
/// Boxes that come nearer than this touch, metres.
const TOUCH_M: f64 = 0.15;

/// Why a driver does not go on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wait {
    /// Nothing: it goes on.
    #[default]
    No,
    /// A traffic light.
    Light,
    /// A stop sign.
    Sign,
    /// It is another vehicle's turn at a junction.
    Turn,
    /// A vehicle or walker ahead.
    Ahead,
    /// The road ends.
    End,
}

/// What is in the way.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Obstacle {
    pub id: u32,
    pub is_vehicle: bool,
    pub gap_m: f64,
    pub along_mps: f64,
    /// Side of the path it is on: 1 left, −1 right.
    pub side: f64,
}

/// A vehicle on its path, looking ahead.
pub(crate) struct Lookout<'d> {
    pub me: &'d Mover,
    pub path: &'d Path,
    pub foot: Foot,
    pub wheelbase_m: f64,
    pub idm: Idm,
}

impl Lookout<'_> {
    /// The vehicle or walker on the path, or about to step onto it, that asks for the hardest
    /// braking, among those that `sees` accepts.
    pub fn obstacle(
        &self,
        traffic: &Traffic,
        grid: &Grid,
        margin_m: f64,
        sees: impl Fn(&Mover) -> bool,
    ) -> Option<Obstacle> {
        let me = self.me;
        let front = self.foot.arc_m + me.front_m();
        let reach = 16.0 + me.speed_mps * me.speed_mps / 5.0 + 2.0 * me.speed_mps;
        let places = self.path.places();
        let first = self.path.point_idx(self.foot.arc_m + 0.5 * me.front_m());
        let last = self.path.point_idx(front + reach);
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for place in places[first..=last].iter().step_by(STRIDE) {
            for axis in 0..2 {
                low[axis] = low[axis].min(place[axis] - 14.0);
                high[axis] = high[axis].max(place[axis] + 14.0);
            }
        }
        let mut nearest: Option<(f64, Obstacle)> = None;
        for idx in grid.within(low, high) {
            let other = &traffic.movers[idx as usize];
            if other.id == me.id
                || (other.position_m[2] - me.position_m[2]).abs() > 3.5
                || !sees(other)
            {
                continue;
            }
            let stance = grid.stance(idx);
            let found = self.meets(other, stance, [first, last], front + reach, margin_m);
            let soon = self.runs_into(other, stance);
            let Some(found) = (match (found, soon) {
                (Some(found), Some(soon)) if soon.gap_m < found.gap_m => Some(soon),
                (found, soon) => found.or(soon),
            }) else {
                continue;
            };
            let leader = Leader {
                gap_m: found.gap_m,
                speed_mps: found.along_mps,
            };
            let need = speed::follow(me.speed_mps, &self.idm, leader);
            if nearest
                .is_none_or(|(least, old)| need < least || need == least && found.gap_m < old.gap_m)
            {
                nearest = Some((need, found));
            }
        }
        nearest.map(|(_, obstacle)| obstacle)
    }

    /// A vehicle that ours is about to touch as the two move now, whatever the path says: the
    /// corners of a long one leave its lane on a narrow bend.
    fn runs_into(&self, other: &Mover, stance: Stance) -> Option<Obstacle> {
        let me = self.me;
        let v = me.speed_mps;
        if !other.is_vehicle || !(0.5..FORESIGHT_MPS).contains(&v) {
            return None;
        }
        let [x, y] = me.middle();
        let apart_m = distance([x, y], stance.middle_m);
        let secs = 0.3 + v / 6.0;
        let reach_m = me.half_m[0] + me.half_m[1] + other.half_m[0] + other.half_m[1];
        let theirs_mps = other.velocity_mps[0].hypot(other.velocity_mps[1]);
        if apart_m > reach_m + secs * (v + theirs_mps)
            || me.ahead_m(other) < 0.5 * me.half_m[0]
            || me.overlaps(other, 0.0)
        {
            return None;
        }
        let turn_radps = me.yaw_rate_radps.clamp(-1.0, 1.0);
        (1..=FORESIGHT_STEPS).find_map(|step| {
            let t = secs * f64::from(step) / f64::from(FORESIGHT_STEPS);
            let (mut ours, mut theirs) = (me.clone(), other.clone());
            let (sin, cos) = (me.yaw_rad + 0.5 * turn_radps * t).sin_cos();
            ours.position_m[0] += v * t * cos;
            ours.position_m[1] += v * t * sin;
            ours.yaw_rad += turn_radps * t;
            for axis in 0..2 {
                theirs.position_m[axis] += other.velocity_mps[axis] * t;
            }
            let (sin, cos) = self.foot.heading_rad.sin_cos();
            ours.overlaps(&theirs, TOUCH_M).then(|| Obstacle {
                id: other.id,
                is_vehicle: true,
                gap_m: (v * t).max(0.05),
                along_mps: (other.velocity_mps[0] * cos + other.velocity_mps[1] * sin).max(0.0),
                side: ((stance.middle_m[1] - y) * cos - (stance.middle_m[0] - x) * sin).signum(),
            })
        })
    }

    /// Where the path first touches another mover, between two points.
    fn meets(
        &self,
        other: &Mover,
        stance: Stance,
        [first, last]: [usize; 2],
        until_m: f64,
        margin_m: f64,
    ) -> Option<Obstacle> {
        let me = self.me;
        let lateral = me.half_m[1]
            + if other.is_vehicle {
                margin_m
            } else {
                margin_m + 0.4
            };
        let steps = if other.is_vehicle { 0.0 } else { 2.5 };
        let [vx, vy] = other.velocity_mps;
        let size = other.half_m[0] + other.half_m[1] + steps * (vx * vx + vy * vy).sqrt();
        let radius = size + lateral + MOST_SWING_M + 0.5 * STRIDE as f64;
        let [x, y] = stance.middle_m;
        let places = self.path.places();
        let is_near = |idx: &usize| {
            let [px, py] = places[*idx];
            (px - x) * (px - x) + (py - y) * (py - y) < radius * radius
        };
        let start = (first..=last).step_by(STRIDE).find(is_near)?;
        let start = self.path.nearest(stance.middle_m, start).segment;
        if other.is_vehicle && self.is_aside(other, stance, start, lateral) {
            return None;
        }
        let front = self.foot.arc_m + me.front_m();
        let from = self.foot.arc_m + 0.5 * me.front_m();
        let hits = other
            .outline_along(stance.along)
            .chain(other.steps_ahead())
            .filter_map(|point| {
                let near = self.path.nearest(point, start);
                let (arc_m, apart) = (self.path.arc_at(near), near.apart_m);
                if arc_m < from || arc_m > until_m || apart > lateral + MOST_SWING_M {
                    return None;
                }
                let foot = self.path.foot(near, point);
                let is_hit = apart < lateral || apart < lateral + self.swing_at(foot);
                is_hit.then_some(foot)
            });
        let hit = hits.min_by(|a, b| a.arc_m.total_cmp(&b.arc_m))?;
        // A vehicle alongside whose middle is behind ours is not ahead of us.
        if hit.arc_m < front && me.ahead_m(other) < 0.0 {
            return None;
        }
        let along_mps = vx * hit.heading_rad.cos() + vy * hit.heading_rad.sin();
        Some(Obstacle {
            id: other.id,
            is_vehicle: other.is_vehicle,
            gap_m: (hit.arc_m - front).max(0.05),
            along_mps: along_mps.max(0.0),
            side: hit.offset_m.signum(),
        })
    }

    /// Whether a vehicle is certainly beside the strip that we sweep, by circles that cover it.
    fn is_aside(&self, other: &Mover, stance: Stance, start: usize, lateral_m: f64) -> bool {
        let [half_x, half_y] = other.half_m;
        let n = (half_x / half_y).ceil().clamp(1.0, MOST_CIRCLES);
        let piece_m = half_x / n;
        let radius_m = piece_m.hypot(half_y);
        (0..n as u32).all(|i| {
            let along_m = -half_x + piece_m * (2.0 * f64::from(i) + 1.0);
            let centre = [0, 1].map(|axis| stance.middle_m[axis] + along_m * stance.along[axis]);
            let near = self.path.nearest(centre, start);
            let free_m = near.apart_m - radius_m - lateral_m;
            free_m > MOST_SWING_M
                || free_m > 0.0 && free_m > self.most_swing_m(near.segment, radius_m)
        })
    }

    /// An upper bound of how far the front swings out near a point of the path.
    fn most_swing_m(&self, point_idx: usize, radius_m: f64) -> f64 {
        let points = self.path.points();
        let arc_m = points[point_idx].arc_m;
        let behind_m = arc_m - radius_m - self.me.half_m[0] - 1.0;
        let before = points[..point_idx].iter().rev();
        let from = before.take_while(|p| p.arc_m > behind_m).count() + 1;
        let bends = points[point_idx.saturating_sub(from)..]
            .iter()
            .take_while(|p| p.arc_m < arc_m + radius_m + 3.0)
            .map(|p| p.curvature_per_m.abs());
        let bend = bends.fold(0.0, f64::max);
        // To the left of a bend to the right.
        swing_m(self.me, self.wheelbase_m, -bend, Side::Left).min(MOST_SWING_M)
    }

    /// How far the front swings out where it passes a place. The middle of the vehicle is still on
    /// the bend when the front has left it.
    fn swing_at(&self, foot: Foot) -> f64 {
        let behind = [0.0, 0.5, 1.0].map(|share| {
            self.path
                .at(foot.arc_m - share * self.me.half_m[0])
                .curvature_per_m
        });
        behind
            .into_iter()
            .map(|k| swing_m(self.me, self.wheelbase_m, k, foot.side()))
            .fold(0.0, f64::max)
            .min(MOST_SWING_M)
    }

    /// How far inside a bend to drive because the front swings out, metres, positive to the left.
    pub fn inside_m(&self) -> f64 {
        let near = [-2.0, 1.0, 4.0].map(|d| self.path.at(self.foot.arc_m + d).curvature_per_m);
        let bend = near.iter().sum::<f64>() / 3.0;
        let outer = if bend < 0.0 { Side::Left } else { Side::Right };
        bend.signum() * (0.6 * swing_m(self.me, self.wheelbase_m, bend, outer)).min(INSIDE_M)
    }
}

/// How far a vehicle's front swings out of the strip of its own width on a bend, on one side,
/// metres. It turns about a point beside its rear axle, while the point between the axles follows
/// the bend.
fn swing_m(me: &Mover, wheelbase_m: f64, curvature_per_m: f64, side: Side) -> f64 {
    let outside = match side {
        Side::Left => -curvature_per_m,
        Side::Right => curvature_per_m,
    };
    if outside < 1e-3 {
        return 0.0;
    }
    let (radius, half_base) = (1.0 / outside, 0.5 * wheelbase_m);
    let rear_radius = (radius * radius - half_base * half_base).max(1.0).sqrt();
    ((rear_radius + me.half_m[1]).hypot(half_base + me.front_m()) - radius - me.half_m[1]).max(0.0)
}
