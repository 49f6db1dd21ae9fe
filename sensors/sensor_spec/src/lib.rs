//! What a launch file or a blueprint may ask of each sensor, and the checks. No GPU, no scene.
//!
//! Units are in the keys. Every check answers with what, which value, what is allowed.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod camera;
pub mod lidar;
pub mod mount;

pub use camera::{CameraSpec, DvsSpec, Intrinsics};
pub use lidar::LidarSpec;
pub use mount::{Attachment, MountSpec};

use schema_frames::Modality;
use serde::{Deserialize, Serialize};

/// One sensor of a rig: `[sensor.NAME]` in a launch file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum SensorSpec {
    /// A view with any of the camera modalities.
    Camera(CameraSpec),
    /// Lidar, plain or semantic.
    Lidar(LidarSpec),
    /// Inertial measurement unit.
    Imu(ImuSpec),
    /// Satellite positioning.
    Gnss(GnssSpec),
}

impl SensorSpec {
    /// Firings per second of simulated time.
    pub fn rate_hz(&self) -> f64 {
        match self {
            SensorSpec::Camera(spec) => spec.rate_hz,
            SensorSpec::Lidar(spec) => spec.rate_hz,
            SensorSpec::Imu(spec) => spec.rate_hz,
            SensorSpec::Gnss(spec) => spec.rate_hz,
        }
    }

    /// Where it sits.
    pub fn mount(&self) -> &MountSpec {
        match self {
            SensorSpec::Camera(spec) => &spec.mount,
            SensorSpec::Lidar(spec) => &spec.mount,
            SensorSpec::Imu(spec) => &spec.mount,
            SensorSpec::Gnss(spec) => &spec.mount,
        }
    }

    /// What it publishes, one topic each.
    pub fn modalities(&self) -> Vec<Modality> {
        match self {
            SensorSpec::Camera(spec) => spec.modalities.clone(),
            SensorSpec::Lidar(spec) => vec![if spec.semantic { Modality::SemanticLidar } else { Modality::Lidar }],
            SensorSpec::Imu(_) => vec![Modality::Imu],
            SensorSpec::Gnss(_) => vec![Modality::Gnss],
        }
    }

    /// Most payload bytes one frame of `modality` can have.
    pub fn max_payload_bytes(&self, modality: Modality) -> usize {
        let n_elements = match self {
            SensorSpec::Camera(spec) if modality == Modality::Dvs => spec.dvs.max_events as usize,
            SensorSpec::Camera(spec) => spec.width_px as usize * spec.height_px as usize,
            SensorSpec::Lidar(spec) => spec.points_per_frame() as usize,
            SensorSpec::Imu(_) | SensorSpec::Gnss(_) => 1,
        };
        n_elements * modality.element_bytes()
    }

    /// Checks every value; `tick_hz` is the launch file's tick rate.
    ///
    /// # Errors
    /// All problems found, each naming key, value and what is allowed.
    pub fn check(&self, tick_hz: f64) -> Result<(), Vec<SpecError>> {
        let mut errors = Vec::new();
        check_rate(self.rate_hz(), tick_hz, &mut errors);
        self.mount().check(&mut errors);
        match self {
            SensorSpec::Camera(spec) => spec.check(&mut errors),
            SensorSpec::Lidar(spec) => spec.check(&mut errors),
            SensorSpec::Imu(spec) => spec.check(&mut errors),
            SensorSpec::Gnss(spec) => spec.check(&mut errors),
        }
        if errors.is_empty() { Ok(()) } else { Err(errors) }
    }
}

/// One value that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{key} is {value}, but {allowed}")]
pub struct SpecError {
    /// Key in the sensor's table, e.g. `channels`.
    pub key: &'static str,
    /// The value found.
    pub value: String,
    /// What is allowed and what to do, e.g. `must be 1 to 128`.
    pub allowed: String,
}

impl SpecError {
    /// A value outside `low..=high`.
    pub fn range(key: &'static str, value: impl std::fmt::Display, low: impl std::fmt::Display, high: impl std::fmt::Display) -> Self {
        SpecError { key, value: value.to_string(), allowed: format!("must be {low} to {high}") }
    }
}

/// Pushes an error unless `low <= value <= high` (NaN is outside).
pub(crate) fn check_range<T: PartialOrd + std::fmt::Display>(key: &'static str, value: T, low: T, high: T, errors: &mut Vec<SpecError>) {
    if !(value >= low && value <= high) {
        errors.push(SpecError::range(key, value, low, high));
    }
}

/// A launch file's rate must divide the tick rate.
fn check_rate(rate_hz: f64, tick_hz: f64, errors: &mut Vec<SpecError>) {
    if !(rate_hz > 0.0 && rate_hz <= tick_hz) {
        errors.push(SpecError {
            key: "rate_hz",
            value: rate_hz.to_string(),
            allowed: format!("must be above 0 and at most the tick rate {tick_hz}"),
        });
        return;
    }
    let ticks = tick_hz / rate_hz;
    if (ticks - ticks.round()).abs() > 1e-9 * ticks {
        let nearest = [ticks.floor(), ticks.ceil()].map(|n| format!("{}", tick_hz / n));
        let allowed = format!("must divide the tick rate {tick_hz}; try {} or {}", nearest[0], nearest[1]);
        errors.push(SpecError { key: "rate_hz", value: rate_hz.to_string(), allowed });
    }
}

/// An IMU. Noise is Gaussian, independent per axis and sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ImuSpec {
    /// Firings per second.
    pub rate_hz: f64,
    /// Place on the vehicle.
    pub mount: MountSpec,
    /// Standard deviation of the specific force, m/s².
    pub noise_accel_stddev_mps2: [f64; 3],
    /// Standard deviation of the angular velocity, rad/s.
    pub noise_gyro_stddev_radps: [f64; 3],
    /// Constant added to the angular velocity, rad/s.
    pub bias_gyro_radps: [f64; 3],
}

impl Default for ImuSpec {
    fn default() -> Self {
        ImuSpec {
            rate_hz: 20.0,
            mount: MountSpec::default(),
            noise_accel_stddev_mps2: [0.0; 3],
            noise_gyro_stddev_radps: [0.0; 3],
            bias_gyro_radps: [0.0; 3],
        }
    }
}

impl ImuSpec {
    fn check(&self, errors: &mut Vec<SpecError>) {
        for value in self.noise_accel_stddev_mps2 {
            check_range("noise_accel_stddev_mps2", value, 0.0, 1e6, errors);
        }
        for value in self.noise_gyro_stddev_radps {
            check_range("noise_gyro_stddev_radps", value, 0.0, 1e6, errors);
        }
        for value in self.bias_gyro_radps {
            check_range("bias_gyro_radps", value, -1e6, 1e6, errors);
        }
    }
}

/// A GNSS receiver. Noise is Gaussian, independent per sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GnssSpec {
    /// Firings per second.
    pub rate_hz: f64,
    /// Place on the vehicle.
    pub mount: MountSpec,
    /// Standard deviation of latitude and longitude, degrees.
    pub noise_position_stddev_deg: [f64; 2],
    /// Standard deviation of the altitude, metres.
    pub noise_altitude_stddev_m: f64,
}

impl Default for GnssSpec {
    fn default() -> Self {
        GnssSpec { rate_hz: 10.0, mount: MountSpec::default(), noise_position_stddev_deg: [0.0; 2], noise_altitude_stddev_m: 0.0 }
    }
}

impl GnssSpec {
    fn check(&self, errors: &mut Vec<SpecError>) {
        for value in self.noise_position_stddev_deg {
            check_range("noise_position_stddev_deg", value, 0.0, 1.0, errors);
        }
        check_range("noise_altitude_stddev_m", self.noise_altitude_stddev_m, 0.0, 1e6, errors);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rate_that_does_not_divide_the_tick_rate_is_refused_with_neighbours() {
        let spec = SensorSpec::Imu(ImuSpec { rate_hz: 30.0, ..Default::default() });
        let errors = spec.check(100.0).unwrap_err();
        assert_eq!(errors[0].to_string(), "rate_hz is 30, but must divide the tick rate 100; try 33.333333333333336 or 25");
        assert!(SensorSpec::Imu(ImuSpec { rate_hz: 25.0, ..Default::default() }).check(100.0).is_ok());
    }

    #[test]
    fn nan_is_refused() {
        let spec = SensorSpec::Gnss(GnssSpec { rate_hz: f64::NAN, noise_altitude_stddev_m: f64::NAN, ..Default::default() });
        assert_eq!(spec.check(20.0).unwrap_err().len(), 2);
    }
}
