//! Settings of the lidar: beams, rotation, losses.

use serde::{Deserialize, Serialize};

use crate::check::{SpecError, check_range};
use crate::mount::MountSpec;

/// Largest number of beams of a lidar.
pub const MAX_CHANNELS: u32 = 256;
/// Largest number of points per second of simulated time, for lidar and radar.
pub const MAX_POINTS_PER_SECOND: u32 = 50_000_000;

/// What one frame of a lidar holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LidarScan {
    /// One full turn of `columns` azimuths that ends at the tick, looking back.
    #[default]
    Turn,
    /// What the head sweeps in one tick, from `points_per_second` and `rotation_hz`: CARLA's lidar.
    /// The head turns clockwise seen from above and continues from where it stood at the previous
    /// firing.
    Sweep,
}

/// A spinning lidar.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LidarSpec {
    /// Frames per second.
    pub rate_hz: f64,
    /// Place on the vehicle.
    pub mount: MountSpec,
    /// Whether points carry class, object id and incidence instead of intensity; no losses then.
    pub semantic: bool,
    /// What one frame holds.
    pub scan: LidarScan,
    /// Beams.
    pub channels: u32,
    /// Azimuth steps of one frame (scan `turn`).
    pub columns: u32,
    /// Rays per second of simulated time, all channels together (scan `sweep`).
    pub points_per_second: u32,
    /// Turns per second of simulated time (scan `sweep`).
    pub rotation_hz: f64,
    /// Width of the turn, centred forward.
    pub horizontal_fov_deg: f64,
    /// Elevation of the highest beam.
    pub upper_fov_deg: f64,
    /// Elevation of the lowest beam.
    pub lower_fov_deg: f64,
    /// Distance of the farthest return, metres.
    pub range_m: f64,
    /// Intensity is exp(−rate · distance).
    pub attenuation_per_m: f64,
    /// Share of rays lost whatever they hit.
    pub dropoff_general_ratio: f64,
    /// Below this intensity more rays are lost …
    pub dropoff_intensity_limit: f64,
    /// … up to this share at intensity 0.
    pub dropoff_zero_intensity_ratio: f64,
    /// Standard deviation of the range, metres.
    pub noise_range_stddev_m: f64,
    /// Tells the noise of otherwise equal sensors apart.
    pub noise_seed: u64,
    /// Whether the sensor moves along its path while the head turns.
    pub motion_distortion: bool,
}

impl Default for LidarSpec {
    fn default() -> Self {
        LidarSpec {
            rate_hz: 10.0,
            mount: MountSpec::default(),
            semantic: false,
            scan: LidarScan::Turn,
            channels: 64,
            columns: 2000,
            points_per_second: 1_280_000,
            rotation_hz: 10.0,
            horizontal_fov_deg: 360.0,
            upper_fov_deg: 10.0,
            lower_fov_deg: -25.0,
            range_m: 120.0,
            attenuation_per_m: 0.004,
            dropoff_general_ratio: 0.0,
            dropoff_intensity_limit: 0.0,
            dropoff_zero_intensity_ratio: 0.0,
            noise_range_stddev_m: 0.0,
            noise_seed: 0,
            motion_distortion: false,
        }
    }
}

impl LidarSpec {
    /// Number of azimuths of a frame after a tick of `tick_secs`, which is rays per channel.
    pub fn columns_per_frame(&self, tick_secs: f64) -> u32 {
        match self.scan {
            LidarScan::Turn => self.columns,
            LidarScan::Sweep => {
                (self.points_per_second as f64 * tick_secs / self.channels as f64).round() as u32
            }
        }
    }

    /// Largest number of points of a frame after a tick of `tick_secs`.
    pub fn points_per_frame(&self, tick_secs: f64) -> u32 {
        self.channels
            .saturating_mul(self.columns_per_frame(tick_secs))
    }

    /// Elevation of a channel, radians; channel 0 is the highest.
    pub fn elevation_rad(&self, channel: u32) -> f64 {
        let steps = self.channels.saturating_sub(1).max(1) as f64;
        (self.upper_fov_deg - channel as f64 * (self.upper_fov_deg - self.lower_fov_deg) / steps)
            .to_radians()
    }

    pub(crate) fn check(&self, errors: &mut Vec<SpecError>) {
        check_range("channels", self.channels, 1, MAX_CHANNELS, errors);
        check_range("columns", self.columns, 1, 65_536, errors);
        check_range(
            "points_per_second",
            self.points_per_second,
            1,
            MAX_POINTS_PER_SECOND,
            errors,
        );
        check_range("rotation_hz", self.rotation_hz, 0.0, 1000.0, errors);
        check_range(
            "horizontal_fov_deg",
            self.horizontal_fov_deg,
            0.01,
            360.0,
            errors,
        );
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
        check_range(
            "attenuation_per_m",
            self.attenuation_per_m,
            0.0,
            10.0,
            errors,
        );
        check_range(
            "dropoff_general_ratio",
            self.dropoff_general_ratio,
            0.0,
            1.0,
            errors,
        );
        check_range(
            "dropoff_intensity_limit",
            self.dropoff_intensity_limit,
            0.0,
            1.0,
            errors,
        );
        check_range(
            "dropoff_zero_intensity_ratio",
            self.dropoff_zero_intensity_ratio,
            0.0,
            1.0,
            errors,
        );
        check_range(
            "noise_range_stddev_m",
            self.noise_range_stddev_m,
            0.0,
            100.0,
            errors,
        );
    }
}
