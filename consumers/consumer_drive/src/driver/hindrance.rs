//! What keeps a driver from going on, and how it finds the first vehicle or walker on its path.

use crate::path::{Foot, Path};
use crate::plane::Side;
use crate::speed;
use crate::traffic::{Grid, Mover, Traffic};

/// Largest offset of a long vehicle towards the inside of a bend, metres.
const INSIDE_M: f64 = 0.35;
/// Farthest that a front swings out, metres.
const MOST_SWING_M: f64 = 2.5;
/// Points between two that are tested first.
const STRIDE: usize = 4;

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
    pub standing_gap_m: f64,
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
        let points = self.path.points();
        let first = self.path.point_idx(self.foot.arc_m + 0.5 * me.front_m());
        let last = self.path.point_idx(front + reach);
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for point in points[first..=last].iter().step_by(STRIDE) {
            for axis in 0..2 {
                low[axis] = low[axis].min(point.position_m[axis] - 14.0);
                high[axis] = high[axis].max(point.position_m[axis] + 14.0);
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
            let Some(found) = self.meets(other, [first, last], front + reach, margin_m) else {
                continue;
            };
            let need = speed::follow(
                me.speed_mps,
                found.along_mps,
                found.gap_m,
                self.standing_gap_m,
            );
            if nearest
                .is_none_or(|(least, old)| need < least || need == least && found.gap_m < old.gap_m)
            {
                nearest = Some((need, found));
            }
        }
        nearest.map(|(_, obstacle)| obstacle)
    }

    /// Where the path first touches another mover, between two points.
    fn meets(
        &self,
        other: &Mover,
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
        let [x, y] = other.middle();
        let points = self.path.points();
        let is_near = |idx: &usize| {
            let [px, py] = points[*idx].position_m;
            (px - x) * (px - x) + (py - y) * (py - y) < radius * radius
        };
        let start = (first..=last).step_by(STRIDE).find(is_near)?;
        let front = self.foot.arc_m + me.front_m();
        let from = self.foot.arc_m + 0.5 * me.front_m();
        let hits = other
            .outline()
            .chain(other.steps_ahead())
            .filter_map(|point| {
                let (foot, apart) = self.path.descend(point, start);
                if foot.arc_m < from || foot.arc_m > until_m || apart > lateral + MOST_SWING_M {
                    return None;
                }
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
