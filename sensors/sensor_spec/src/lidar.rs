//! Lidar: beams, rotation, losses.

use serde::{Deserialize, Serialize};

use crate::{MountSpec, SpecError, check_range};

/// Most beams a lidar can have.
pub const MAX_CHANNELS: u32 = 256;

/// A spinning lidar. One frame is one full turn that ends at the tick it is published.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LidarSpec {
    /// Turns per second; one frame each.
    pub rate_hz: f64,
    /// Place on the vehicle.
    pub mount: MountSpec,
    /// Publish class, object id and incidence instead of intensity, without losses.
    pub semantic: bool,
    /// Beams.
    pub channels: u32,
    /// Azimuth steps of one turn.
    pub columns: u32,
    /// Elevation of the highest beam.
    pub upper_fov_deg: f64,
    /// Elevation of the lowest beam.
    pub lower_fov_deg: f64,
    /// Farthest return.
    pub range_m: f64,
    /// Intensity is exp(−rate · distance).
    pub attenuation_per_m: f64,
    /// Share of rays lost whatever they hit.
    pub dropoff_general_ratio: f64,
    /// Below this intensity more rays are lost…
    pub dropoff_intensity_limit: f64,
    /// …up to this share at intensity 0.
    pub dropoff_zero_intensity_ratio: f64,
    /// Standard deviation of the range.
    pub noise_range_stddev_m: f64,
    /// Move the sensor along its path during the turn.
    pub motion_distortion: bool,
}

impl Default for LidarSpec {
    fn default() -> Self {
        LidarSpec {
            rate_hz: 10.0,
            mount: MountSpec::default(),
            semantic: false,
            channels: 64,
            columns: 2000,
            upper_fov_deg: 10.0,
            lower_fov_deg: -25.0,
            range_m: 120.0,
            attenuation_per_m: 0.004,
            dropoff_general_ratio: 0.0,
            dropoff_intensity_limit: 0.0,
            dropoff_zero_intensity_ratio: 0.0,
            noise_range_stddev_m: 0.0,
            motion_distortion: false,
        }
    }
}

impl LidarSpec {
    /// Most points one frame can have.
    pub fn points_per_frame(&self) -> u32 {
        self.channels * self.columns
    }

    /// Elevation of a channel, radians; channel 0 is the highest.
    pub fn elevation_rad(&self, channel: u32) -> f64 {
        let steps = self.channels.saturating_sub(1).max(1) as f64;
        (self.upper_fov_deg - channel as f64 * (self.upper_fov_deg - self.lower_fov_deg) / steps).to_radians()
    }

    pub(crate) fn check(&self, errors: &mut Vec<SpecError>) {
        check_range("channels", self.channels, 1, MAX_CHANNELS, errors);
        check_range("columns", self.columns, 1, 65_536, errors);
        check_range("upper_fov_deg", self.upper_fov_deg, -90.0, 90.0, errors);
        check_range("lower_fov_deg", self.lower_fov_deg, -90.0, 90.0, errors);
        if self.lower_fov_deg > self.upper_fov_deg {
            errors.push(SpecError {
                key: "lower_fov_deg",
                value: self.lower_fov_deg.to_string(),
                allowed: format!("must not lie above upper_fov_deg {}", self.upper_fov_deg),
            });
        }
        check_range("range_m", self.range_m, 0.1, 10_000.0, errors);
        check_range("attenuation_per_m", self.attenuation_per_m, 0.0, 10.0, errors);
        check_range("dropoff_general_ratio", self.dropoff_general_ratio, 0.0, 1.0, errors);
        check_range("dropoff_intensity_limit", self.dropoff_intensity_limit, 0.0, 1.0, errors);
        check_range("dropoff_zero_intensity_ratio", self.dropoff_zero_intensity_ratio, 0.0, 1.0, errors);
        check_range("noise_range_stddev_m", self.noise_range_stddev_m, 0.0, 100.0, errors);
    }
}
