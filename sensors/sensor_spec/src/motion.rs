//! IMU and GNSS: noise and bias.

use serde::{Deserialize, Serialize};

use crate::{MountSpec, SpecError, check_range};

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
    /// Tells the noise of otherwise equal sensors apart.
    pub noise_seed: u64,
}

impl Default for ImuSpec {
    fn default() -> Self {
        ImuSpec {
            rate_hz: 20.0,
            mount: MountSpec::default(),
            noise_accel_stddev_mps2: [0.0; 3],
            noise_gyro_stddev_radps: [0.0; 3],
            bias_gyro_radps: [0.0; 3],
            noise_seed: 0,
        }
    }
}

impl ImuSpec {
    pub(crate) fn check(&self, errors: &mut Vec<SpecError>) {
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

/// A GNSS receiver. Noise is Gaussian, independent per component and sample.
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
    /// Constant added to latitude and longitude, degrees.
    pub bias_position_deg: [f64; 2],
    /// Constant added to the altitude, metres.
    pub bias_altitude_m: f64,
    /// Tells the noise of otherwise equal sensors apart.
    pub noise_seed: u64,
}

impl Default for GnssSpec {
    fn default() -> Self {
        GnssSpec {
            rate_hz: 10.0,
            mount: MountSpec::default(),
            noise_position_stddev_deg: [0.0; 2],
            noise_altitude_stddev_m: 0.0,
            bias_position_deg: [0.0; 2],
            bias_altitude_m: 0.0,
            noise_seed: 0,
        }
    }
}

impl GnssSpec {
    pub(crate) fn check(&self, errors: &mut Vec<SpecError>) {
        for value in self.noise_position_stddev_deg {
            check_range("noise_position_stddev_deg", value, 0.0, 360.0, errors);
        }
        check_range(
            "noise_altitude_stddev_m",
            self.noise_altitude_stddev_m,
            0.0,
            1e6,
            errors,
        );
        for value in self.bias_position_deg {
            check_range("bias_position_deg", value, -360.0, 360.0, errors);
        }
        check_range("bias_altitude_m", self.bias_altitude_m, -1e6, 1e6, errors);
    }
}
