//! Settings of the IMU: noise and bias.

use serde::{Deserialize, Serialize};

use crate::check::{SpecError, check_range};
use crate::mount::MountSpec;

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
