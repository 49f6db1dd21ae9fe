//! Poses of a replay: between two recorded ones, and how walkers get to them.

use schema_frames::Command;

use crate::wire::axes::{self, Transform};

/// Whether a walker stands: then it is led to its place. One that lies was knocked over.
pub fn is_upright(at: &Transform) -> bool {
    const TILT_DEG: f64 = 1.0;
    let [pitch, _, roll] = at.rotation_deg;
    pitch.abs() < TILT_DEG && roll.abs() < TILT_DEG
}

/// The command that leads a walker to a place.
pub fn lead(actor_id: u32, at: &Transform, speed_mps: f64) -> Command {
    Command::LeadWalker {
        actor_id,
        ground_point_m: axes::mirror(at.location_m),
        yaw_rad: axes::pose(at).yaw_rad(),
        speed_mps,
    }
}

/// Whether a pose consists of numbers.
pub fn is_somewhere(at: &Transform) -> bool {
    let numbers = at.location_m.iter().chain(&at.rotation_deg);
    numbers.into_iter().all(|number| number.is_finite())
}

/// Interpolates two poses: along a straight line, and turning the short way round.
pub fn between(a: &Transform, b: &Transform, share: f64) -> Transform {
    let turn = |a: f64, b: f64| {
        let by = (b - a + 180.0).rem_euclid(360.0) - 180.0;
        a + by * share
    };
    Transform {
        location_m: std::array::from_fn(|i| {
            a.location_m[i] + (b.location_m[i] - a.location_m[i]) * share
        }),
        rotation_deg: std::array::from_fn(|i| turn(a.rotation_deg[i], b.rotation_deg[i])),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halfway_is_halfway_the_short_way_round() {
        let at = |x: f64, yaw: f64| Transform {
            location_m: [x, 0.0, 1.0],
            rotation_deg: [0.0, yaw, 0.0],
        };
        let half = between(&at(1.0, 170.0), &at(3.0, -170.0), 0.5);
        assert_eq!(half.location_m, [2.0, 0.0, 1.0]);
        assert!((half.rotation_deg[1] - 180.0).abs() < 1e-9);
        assert_eq!(between(&at(1.0, 5.0), &at(3.0, 9.0), 0.0), at(1.0, 5.0));
    }
}
