//! Settings of the radar: field of view, range, density.

use serde::{Deserialize, Serialize};

use crate::check::{SpecError, check_range};
use crate::lidar::MAX_POINTS_PER_SECOND;
use crate::mount::MountSpec;

/// A radar that casts rays: CARLA's model, without noise, cross sections or echoes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RadarSpec {
    /// Frames per second.
    pub rate_hz: f64,
    /// Place on the vehicle.
    pub mount: MountSpec,
    /// Width of the field of view.
    pub horizontal_fov_deg: f64,
    /// Height of the field of view.
    pub vertical_fov_deg: f64,
    /// Distance of the plane at which its rays end, metres; rays towards the rim are longer.
    pub range_m: f64,
    /// Rays per second of simulated time; a frame has the rays of one tick.
    pub points_per_second: u32,
    /// Tells the directions of otherwise equal radars apart.
    pub noise_seed: u64,
}

impl Default for RadarSpec {
    fn default() -> Self {
        RadarSpec {
            rate_hz: 20.0,
            mount: MountSpec::default(),
            horizontal_fov_deg: 30.0,
            vertical_fov_deg: 30.0,
            range_m: 100.0,
            points_per_second: 1500,
            noise_seed: 0,
        }
    }
}

impl RadarSpec {
    /// Rays of a frame after a tick of `tick_secs`.
    pub fn rays_per_frame(&self, tick_secs: f64) -> u32 {
        // The factor keeps rounding from losing a ray: 0.05 s · 1500/s must give 75.
        (self.points_per_second as f64 * tick_secs * (1.0 + 1e-12)) as u32
    }

    pub(crate) fn check(&self, errors: &mut Vec<SpecError>) {
        check_range(
            "horizontal_fov_deg",
            self.horizontal_fov_deg,
            0.0,
            170.0,
            errors,
        );
        check_range(
            "vertical_fov_deg",
            self.vertical_fov_deg,
            0.0,
            170.0,
            errors,
        );
        check_range("range_m", self.range_m, 0.1, 10_000.0, errors);
        check_range(
            "points_per_second",
            self.points_per_second,
            1,
            MAX_POINTS_PER_SECOND,
            errors,
        );
    }
}
