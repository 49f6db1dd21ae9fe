//! What keeps a driver from going on, and how it finds the first vehicle or walker on its path.

use crate::path::{Foot, Path, Side, distance};
use crate::speed;
use crate::traffic::{Mover, Traffic};

/// Largest offset of a long vehicle towards the inside of a bend, metres.
const INSIDE_M: f64 = 0.35;

/// Why a driver does not go on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wait {
    /// Nothing: it goes on.
    #[default]
    No,
    /// A traffic light.
    Light,
    /// It is another vehicle's turn at a junction.
    Turn,
    /// A vehicle or walker ahead.
    Ahead,
    /// The road ends.
    End,
}

/// What is in the way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Obstacle {
    pub id: u32,
    pub gap_m: f64,
    pub along_mps: f64,
    /// Side of the path it is on: 1 left, −1 right.
    pub side: f64,
}

/// A vehicle on its path, looking ahead.
pub(super) struct Lookout<'d> {
    pub me: &'d Mover,
    pub path: &'d Path,
    pub foot: Foot,
    pub wheelbase_m: f64,
}

impl Lookout<'_> {
    /// The vehicle or walker on the path, or about to step onto it, that asks for the hardest
    /// braking.
    pub fn obstacle(&self, traffic: &Traffic, margin_m: f64) -> Option<Obstacle> {
        let me = self.me;
        let front = self.foot.arc_m + me.front_m();
        let reach = 20.0 + me.speed_mps * me.speed_mps / 4.0 + 2.0 * me.speed_mps;
        let mut nearest: Option<Obstacle> = None;
        for other in &traffic.movers {
            if other.id == me.id || (other.position_m[2] - me.position_m[2]).abs() > 3.5 {
                continue;
            }
            let apart = distance(other.middle(), me.middle());
            if apart > reach + other.half_m[0] + me.half_m[0] {
                continue;
            }
            let lateral = me.half_m[1]
                + if other.is_vehicle {
                    margin_m
                } else {
                    margin_m + 0.4
                };
            let from = self.foot.arc_m + 0.5 * me.front_m();
            let reach_at = |arc: f64, side: Side| lateral + self.swing_at(arc, side);
            let hits = other
                .outline()
                .into_iter()
                .chain(other.steps_ahead())
                .filter_map(|p| self.path.first_within(p, from, front + reach, reach_at));
            let hit = hits.min_by(|a, b| a.arc_m.total_cmp(&b.arc_m));
            let Some(Foot {
                arc_m: arc,
                heading_rad: heading,
                offset_m,
            }) = hit
            else {
                continue;
            };
            // A vehicle alongside whose middle is behind ours is not ahead of us.
            if arc < front && me.ahead_m(other) < 0.0 {
                continue;
            }
            let along_mps =
                other.velocity_mps[0] * heading.cos() + other.velocity_mps[1] * heading.sin();
            let gap_m = (arc - front).max(0.05);
            let candidate = Obstacle {
                id: other.id,
                gap_m,
                along_mps: along_mps.max(0.0),
                side: offset_m.signum(),
            };
            let need = |o: &Obstacle| speed::follow(me.speed_mps, o.along_mps, o.gap_m, 2.2);
            if nearest.is_none_or(|n| need(&candidate) < need(&n)) {
                nearest = Some(candidate);
            }
        }
        nearest
    }

    /// How far the front swings out where it passes a place. The middle of the vehicle is still on
    /// the bend when the front has left it.
    fn swing_at(&self, arc_m: f64, side: Side) -> f64 {
        let behind = [0.0, 0.5, 1.0].map(|share| {
            self.path
                .at(arc_m - share * self.me.half_m[0])
                .curvature_per_m
        });
        behind
            .into_iter()
            .map(|k| swing_m(self.me, self.wheelbase_m, k, side))
            .fold(0.0, f64::max)
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
