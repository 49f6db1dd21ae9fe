//! Weather: which values it may have, and its effect on tyres and lidar where that is switched on.

use schema_frames::document::Weather;
use serde::{Deserialize, Serialize};

use crate::errors::OutOfRange;

/// Grip of tyres on a flooded road as a share of that on a dry one.
const SOAKED_GRIP_RATIO: f64 = 0.6;
/// Rain of 100 percent, mm/h.
const HEAVIEST_RAIN_MMPH: f64 = 50.0;
/// One dB/km as an extinction, 1/m.
const DECIBELS_PER_KM: f64 = 1e-3 * std::f64::consts::LN_10 / 10.0;
/// Visibility in the thinnest fog and in fog of 100 percent, metres.
const FOG_VISIBILITY_M: (f64, f64) = (2000.0, 50.0);
/// Extinction by dust of 100 percent, 1/m; it leaves a visibility of 100 m.
const DUST_EXTINCTION_PER_M: f64 = 0.039;

/// The weather, and whether it has effects.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct WeatherInForce {
    pub now: Weather,
    /// Whether it acts on tyres and lidar. Off by default, as in CARLA, where it is only seen.
    pub acts: bool,
}

impl WeatherInForce {
    /// Changes the weather.
    ///
    /// # Errors
    /// If a value lies outside its range; the weather then stays as it is.
    pub fn set(&mut self, weather: Weather) -> Result<(), OutOfRange> {
        let values = [
            ("cloudiness", weather.cloudiness, 0.0, 100.0),
            ("precipitation", weather.precipitation, 0.0, 100.0),
            (
                "precipitation_deposits",
                weather.precipitation_deposits,
                0.0,
                100.0,
            ),
            ("wind_intensity", weather.wind_intensity, 0.0, 100.0),
            ("sun_azimuth_deg", weather.sun_azimuth_deg, -360.0, 360.0),
            ("sun_altitude_deg", weather.sun_altitude_deg, -90.0, 90.0),
            ("fog_density", weather.fog_density, 0.0, 100.0),
            ("fog_distance_m", weather.fog_distance_m, 0.0, 1e5),
            ("fog_falloff", weather.fog_falloff, 0.0, 100.0),
            ("wetness", weather.wetness, 0.0, 100.0),
            (
                "scattering_intensity",
                weather.scattering_intensity,
                0.0,
                1000.0,
            ),
            (
                "mie_scattering_scale",
                weather.mie_scattering_scale,
                0.0,
                5.0,
            ),
            (
                "rayleigh_scattering_scale",
                weather.rayleigh_scattering_scale,
                0.0,
                2.0,
            ),
            ("dust_storm", weather.dust_storm, 0.0, 100.0),
        ];
        for (name, value, low, high) in values {
            OutOfRange::check(name, value, low, high)?;
        }
        self.now = weather;
        Ok(())
    }

    /// Grip of tyres as a share of that on a dry road: 1 unless weather acts.
    pub fn grip_ratio(&self) -> f64 {
        if self.acts {
            grip_ratio(&self.now)
        } else {
            1.0
        }
    }

    /// Extinction of lidar light by rain, fog and dust, 1/m: 0 unless weather acts.
    pub fn lidar_extinction_per_m(&self) -> f64 {
        if self.acts {
            extinction_per_m(&self.now)
        } else {
            0.0
        }
    }
}

/// Grip falls linearly with the water on the road, whatever brought it.
fn grip_ratio(weather: &Weather) -> f64 {
    let water = weather
        .wetness
        .max(weather.precipitation_deposits)
        .max(weather.precipitation) as f64
        / 100.0;
    1.0 - (1.0 - SOAKED_GRIP_RATIO) * water.clamp(0.0, 1.0)
}

/// Rain follows ITU-R P.1814: 1.076 R^0.67 dB/km with R in mm/h. Fog follows Koschmieder: 3.912
/// over the visibility, which falls exponentially with the density. Dust is linear.
fn extinction_per_m(weather: &Weather) -> f64 {
    let share = |percent: f32| f64::from(percent).clamp(0.0, 100.0) / 100.0;
    let rain = match share(weather.precipitation) {
        0.0 => 0.0,
        rain => DECIBELS_PER_KM * 1.076 * (HEAVIEST_RAIN_MMPH * rain).powf(0.67),
    };
    let fog = match share(weather.fog_density) {
        0.0 => 0.0,
        fog => 3.912 / (FOG_VISIBILITY_M.0 * (FOG_VISIBILITY_M.1 / FOG_VISIBILITY_M.0).powf(fog)),
    };
    rain + fog + DUST_EXTINCTION_PER_M * share(weather.dust_storm)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weather_acts_only_where_asked() {
        let storm = Weather {
            precipitation: 100.0,
            wetness: 100.0,
            fog_density: 100.0,
            ..Weather::default()
        };
        let mut weather = WeatherInForce::default();
        weather.set(storm).unwrap();
        assert_eq!(
            (weather.grip_ratio(), weather.lidar_extinction_per_m()),
            (1.0, 0.0)
        );
        weather.acts = true;
        assert!((weather.grip_ratio() - SOAKED_GRIP_RATIO).abs() < 1e-12);
        // 50 mm/h give 14.8 dB/km by the formula, and a visibility of 50 m leaves 2 % of the light
        // over 50 m.
        let expected = 14.79e-3 / 4.3429 + (1.0f64 / 0.02).ln() / 50.0;
        assert!(
            (weather.lidar_extinction_per_m() / expected - 1.0).abs() < 2e-3,
            "{}",
            weather.lidar_extinction_per_m()
        );
        weather
            .set(Weather {
                precipitation: 0.0,
                wetness: 0.0,
                fog_density: 0.0,
                ..storm
            })
            .unwrap();
        assert_eq!(
            (weather.grip_ratio(), weather.lidar_extinction_per_m()),
            (1.0, 0.0)
        );
    }

    #[test]
    fn what_is_out_of_range_is_named() {
        let mut weather = WeatherInForce::default();
        let error = weather
            .set(Weather {
                dust_storm: 101.0,
                ..Weather::default()
            })
            .unwrap_err();
        assert_eq!(error.to_string(), "dust_storm is 101, but must be 0 to 100");
        assert!(
            weather
                .set(Weather {
                    fog_density: f32::NAN,
                    ..Weather::default()
                })
                .is_err()
        );
    }
}
