//! Settings of the IMU: noise, slow errors of the bias, and how it measures what it feels.

use serde::{Deserialize, Serialize};

use crate::check::{SpecError, check_range};
use crate::mount::MountSpec;

/// An IMU. All noise is independent per axis; white noise also per sample.
///
/// What is measured of specific force and angular velocity `x` is, per kind of sensor,
/// `scale · x + misalignment · x + bias + drift + noise`, limited to the range. The drift is a bias
/// instability and a random walk as in IEEE 952.
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
    /// Constant added to the specific force, m/s².
    pub bias_accel_mps2: [f64; 3],
    /// Constant added to the angular velocity, rad/s.
    pub bias_gyro_radps: [f64; 3],
    /// Density of white noise of the specific force (N), m/s²/√Hz.
    pub density_accel_mps2_rthz: [f64; 3],
    /// Density of white noise of the angular velocity (N), rad/s/√Hz.
    pub density_gyro_radps_rthz: [f64; 3],
    /// Bias instability of the specific force (B), m/s². The Allan deviation's floor is 0.664 of it.
    pub instability_accel_mps2: [f64; 3],
    /// Bias instability of the angular velocity (B), rad/s. The Allan deviation's floor is 0.664 of
    /// it.
    pub instability_gyro_radps: [f64; 3],
    /// Random walk of the specific force (K), m/s²/√s.
    pub walk_accel_mps2_rts: [f64; 3],
    /// Random walk of the angular velocity (K), rad/s/√s.
    pub walk_gyro_radps_rts: [f64; 3],
    /// Scale of the specific force: what is measured per unit of what is felt.
    pub scale_accel_ratio: [f64; 3],
    /// Scale of the angular velocity: what is measured per unit of what is felt.
    pub scale_gyro_ratio: [f64; 3],
    /// By how much an axis of the accelerometer leans towards another one, radians: x to y, x to z, y to
    /// x, y to z, z to x, z to y.
    pub misalignment_accel_rad: [f64; 6],
    /// By how much an axis of the gyroscope leans towards another one, radians, in the same order.
    pub misalignment_gyro_rad: [f64; 6],
    /// How much of the specific force along an axis its angular velocity shows, rad/s per m/s².
    pub g_sensitivity_radps_mps2: [f64; 3],
    /// Largest specific force that is measured, m/s²; 0 is no limit.
    pub range_accel_mps2: f64,
    /// Largest angular velocity that is measured, rad/s; 0 is no limit.
    pub range_gyro_radps: f64,
    /// Frequency at which the specific force has 3 dB less, hertz; 0 is no limit.
    pub bandwidth_accel_hz: f64,
    /// Frequency at which the angular velocity has 3 dB less, hertz; 0 is no limit.
    pub bandwidth_gyro_hz: f64,
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
            bias_accel_mps2: [0.0; 3],
            bias_gyro_radps: [0.0; 3],
            density_accel_mps2_rthz: [0.0; 3],
            density_gyro_radps_rthz: [0.0; 3],
            instability_accel_mps2: [0.0; 3],
            instability_gyro_radps: [0.0; 3],
            walk_accel_mps2_rts: [0.0; 3],
            walk_gyro_radps_rts: [0.0; 3],
            scale_accel_ratio: [1.0; 3],
            scale_gyro_ratio: [1.0; 3],
            misalignment_accel_rad: [0.0; 6],
            misalignment_gyro_rad: [0.0; 6],
            g_sensitivity_radps_mps2: [0.0; 3],
            range_accel_mps2: 0.0,
            range_gyro_radps: 0.0,
            bandwidth_accel_hz: 0.0,
            bandwidth_gyro_hz: 0.0,
            noise_seed: 0,
        }
    }
}

impl ImuSpec {
    pub(crate) fn check(&self, errors: &mut Vec<SpecError>) {
        let mut all = |key: &'static str, values: &[f64], low: f64, high: f64| {
            for value in values {
                check_range(key, *value, low, high, errors);
            }
        };
        let most = 1e6;
        for (key, values) in [
            ("noise_accel_stddev_mps2", &self.noise_accel_stddev_mps2),
            ("noise_gyro_stddev_radps", &self.noise_gyro_stddev_radps),
            ("density_accel_mps2_rthz", &self.density_accel_mps2_rthz),
            ("density_gyro_radps_rthz", &self.density_gyro_radps_rthz),
            ("instability_accel_mps2", &self.instability_accel_mps2),
            ("instability_gyro_radps", &self.instability_gyro_radps),
            ("walk_accel_mps2_rts", &self.walk_accel_mps2_rts),
            ("walk_gyro_radps_rts", &self.walk_gyro_radps_rts),
        ] {
            all(key, values, 0.0, most);
        }
        all("bias_accel_mps2", &self.bias_accel_mps2, -most, most);
        all("bias_gyro_radps", &self.bias_gyro_radps, -most, most);
        all("scale_accel_ratio", &self.scale_accel_ratio, 0.0, 2.0);
        all("scale_gyro_ratio", &self.scale_gyro_ratio, 0.0, 2.0);
        let [of_accel, of_gyro] = [&self.misalignment_accel_rad, &self.misalignment_gyro_rad];
        all("misalignment_accel_rad", of_accel, -1.0, 1.0);
        all("misalignment_gyro_rad", of_gyro, -1.0, 1.0);
        let shown = &self.g_sensitivity_radps_mps2;
        all("g_sensitivity_radps_mps2", shown, -1.0, 1.0);
        all("range_accel_mps2", &[self.range_accel_mps2], 0.0, most);
        all("range_gyro_radps", &[self.range_gyro_radps], 0.0, most);
        all("bandwidth_accel_hz", &[self.bandwidth_accel_hz], 0.0, most);
        all("bandwidth_gyro_hz", &[self.bandwidth_gyro_hz], 0.0, most);
    }
}
