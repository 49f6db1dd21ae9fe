//! Sensors that send a frame only when something happens: obstacle, collision, lane invasion.

use serde::{Deserialize, Serialize};

use crate::check::{SpecError, check_range};
use crate::mount::MountSpec;

/// Largest number of collisions or crossed lines in one frame; further ones are left out.
pub const MAX_EVENTS_PER_TICK: usize = 64;

/// Obstacle detector: moves a ball forward from the sensor until it touches something other than
/// the carrier.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ObstacleSpec {
    /// Firings per second.
    pub rate_hz: f64,
    /// Place on the vehicle.
    pub mount: MountSpec,
    /// How far the ball moves, metres.
    pub distance_m: f64,
    /// Radius of the ball, metres.
    pub hit_radius_m: f64,
    /// Whether only vehicles and walkers count.
    pub only_dynamics: bool,
    /// Whether colour images show the path of the ball, in red, with a circle at either end.
    pub debug_linetrace: bool,
}

impl Default for ObstacleSpec {
    fn default() -> Self {
        ObstacleSpec {
            rate_hz: 20.0,
            mount: MountSpec::default(),
            distance_m: 5.0,
            hit_radius_m: 0.5,
            only_dynamics: false,
            debug_linetrace: false,
        }
    }
}

impl ObstacleSpec {
    pub(crate) fn check(&self, errors: &mut Vec<SpecError>) {
        check_range("distance_m", self.distance_m, 0.0, 10_000.0, errors);
        check_range("hit_radius_m", self.hit_radius_m, 0.0, 100.0, errors);
    }
}

/// Collision detector: what its carrier pushed in a tick, and how hard. Fires at every tick.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CollisionSpec {
    /// Place on the vehicle.
    pub mount: MountSpec,
}

/// Lane invasion detector: painted lines that the box of its carrier crossed in a tick. Fires at
/// every tick.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LaneInvasionSpec {
    /// Place on the vehicle.
    pub mount: MountSpec,
}
