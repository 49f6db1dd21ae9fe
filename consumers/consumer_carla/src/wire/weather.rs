//! The weather as CARLA writes it.

use schema_frames::document::Weather;

use crate::wire::axes;
use crate::wire::fields::{Fields, Wrong};

/// The weather's parameters in CARLA's order.
pub fn weather_values(weather: &Weather) -> [f32; 14] {
    [
        weather.cloudiness,
        weather.precipitation,
        weather.precipitation_deposits,
        weather.wind_intensity,
        axes::azimuth_deg(weather.sun_azimuth_deg),
        weather.sun_altitude_deg,
        weather.fog_density,
        weather.fog_distance_m,
        weather.fog_falloff,
        weather.wetness,
        weather.scattering_intensity,
        weather.mie_scattering_scale,
        weather.rayleigh_scattering_scale,
        weather.dust_storm,
    ]
}

/// Reads the weather's parameters. CARLA checks nothing, so values outside their ranges are
/// clamped. −1 means the map's own value: all presets have it for the azimuth, and
/// `WeatherParameters.Default` for everything.
pub fn read_weather(given: &mut Fields<'_>) -> Result<Weather, Wrong> {
    let own = Weather::default();
    let mut ahead = Fields::new("the weather", given.rest());
    let mut is_default = true;
    for _ in 0..10 {
        is_default &= ahead.f32()? == -1.0;
    }
    if is_default {
        (0..4).try_for_each(|_| ahead.f32().map(drop))?;
        return Ok(own);
    }
    let within =
        |given: &mut Fields<'_>, low: f32, high: f32| given.f32().map(|x| x.clamp(low, high));
    let percent = |given: &mut Fields<'_>| within(given, 0.0, 100.0);
    Ok(Weather {
        cloudiness: percent(given)?,
        precipitation: percent(given)?,
        precipitation_deposits: percent(given)?,
        wind_intensity: percent(given)?,
        sun_azimuth_deg: match given.f32()? {
            -1.0 => own.sun_azimuth_deg,
            azimuth_deg => axes::azimuth_deg(azimuth_deg),
        },
        sun_altitude_deg: given.f32()?.clamp(-90.0, 90.0),
        fog_density: percent(given)?,
        fog_distance_m: given.f32()?.clamp(0.0, 1e5),
        fog_falloff: percent(given)?,
        wetness: percent(given)?,
        scattering_intensity: within(given, 0.0, 1000.0)?,
        mie_scattering_scale: within(given, 0.0, 5.0)?,
        rayleigh_scattering_scale: within(given, 0.0, 2.0)?,
        dust_storm: percent(given)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::msgpack::Value;

    #[test]
    fn the_default_preset_is_the_maps_own_weather() {
        let given = vec![Value::F32(-1.0); 14];
        assert_eq!(
            read_weather(&mut Fields::new("test", &given)).unwrap(),
            Weather::default()
        );
        assert!(
            read_weather(&mut Fields::new("test", &given[..13]))
                .unwrap_err()
                .to_string()
                .contains("field 14")
        );
    }

    #[test]
    fn weather_goes_there_and_back() {
        let given: Vec<Value> = [
            10.0f32, 20.0, 30.0, 40.0, 45.0, -10.0, 5.0, 7.0, 0.5, 60.0, 1.0, 0.1, 0.2, 3.0,
        ]
        .map(Value::from)
        .into();
        let weather = read_weather(&mut Fields::new("test", &given)).unwrap();
        assert_eq!(weather.sun_azimuth_deg, 315.0);
        let again: Vec<Value> = weather_values(&weather).map(Value::from).to_vec();
        assert_eq!(again, given);
    }
}
