//! Weathers by name, as the gallery shows them and the benchmark measures them.

use schema_frames::document::Weather;

/// Names and what they mean.
pub const NAMES: [&str; 9] = [
    "day",
    "overcast",
    "dusk",
    "night",
    "rain",
    "fog",
    "rainy_night",
    "dust",
    "hazy",
];

/// The weather of that name; `None` if there is none.
pub fn named(name: &str) -> Option<Weather> {
    let clear = Weather::default();
    let night = Weather {
        sun_altitude_deg: -40.0,
        cloudiness: 20.0,
        ..clear
    };
    let rain = Weather {
        cloudiness: 90.0,
        precipitation: 70.0,
        precipitation_deposits: 60.0,
        wetness: 80.0,
        wind_intensity: 30.0,
        ..clear
    };
    Some(match name {
        "day" => Weather {
            sun_azimuth_deg: 250.0,
            sun_altitude_deg: 42.0,
            cloudiness: 25.0,
            ..clear
        },
        "overcast" => Weather {
            cloudiness: 95.0,
            ..clear
        },
        "dusk" => Weather {
            sun_azimuth_deg: 200.0,
            sun_altitude_deg: 1.5,
            cloudiness: 40.0,
            ..clear
        },
        "night" => night,
        "rain" => rain,
        "fog" => Weather {
            fog_density: 55.0,
            fog_distance_m: 5.0,
            fog_falloff: 0.4,
            cloudiness: 70.0,
            ..clear
        },
        "rainy_night" => Weather {
            sun_altitude_deg: -40.0,
            ..rain
        },
        "dust" => Weather {
            dust_storm: 100.0,
            wind_intensity: 100.0,
            ..clear
        },
        "hazy" => Weather {
            sun_azimuth_deg: 20.0,
            sun_altitude_deg: 12.0,
            mie_scattering_scale: 0.4,
            rayleigh_scattering_scale: 0.08,
            ..clear
        },
        _ => return None,
    })
}
