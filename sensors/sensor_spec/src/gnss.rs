//! Settings of the GNSS receiver: noise and bias.

use serde::{Deserialize, Serialize};

use crate::check::{SpecError, check_range};
use crate::mount::MountSpec;

/// How a receiver's places on Earth follow from places of the world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Datum {
    /// CARLA's: a transverse Mercator projection of a sphere about the map's reference.
    #[default]
    Carla,
    /// WGS 84: the world is the plane that touches the ellipsoid at the map's reference, where its
    /// z is 0.
    Wgs84,
}

/// A GNSS receiver. Noise is Gaussian, independent per component and sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GnssSpec {
    /// Firings per second.
    pub rate_hz: f64,
    /// Place on the vehicle.
    pub mount: MountSpec,
    /// How places on Earth follow from places of the world.
    pub datum: Datum,
    /// Standard deviation towards east and north, metres.
    pub noise_position_stddev_m: [f64; 2],
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
            datum: Datum::Carla,
            noise_position_stddev_m: [0.0; 2],
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
        for value in self.noise_position_stddev_m {
            check_range("noise_position_stddev_m", value, 0.0, 1e6, errors);
        }
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
