//! Calls about weather and street lights.

use schema_frames::Command;
use schema_frames::document::Weather;

use crate::axes;
use crate::fields::{Fields, Wrong};
use crate::gateway::{Answer, Gateway, Outcome, lock};
use crate::list;
use crate::msgpack::Value;
use crate::rpc::{Call, Calls};

pub(crate) const CALLS: Calls = &[
    ("get_weather_parameters", |gateway, _| gateway.get_weather()),
    ("set_weather_parameters", Gateway::set_weather),
    // There are no street lights that could be switched.
    ("query_lights_state", |_, _| Ok(Answer::Value(list![]))),
];

impl Gateway {
    fn get_weather(&self) -> Outcome {
        let weather = self.info()?.weather;
        let extras = *lock(&self.weather_extras);
        let values = weather_values(&weather).into_iter().chain(extras).map(Value::from).collect::<Vec<_>>();
        Ok(Answer::Value(values.into()))
    }

    fn set_weather(&self, call: &mut Call<'_>) -> Outcome {
        let (weather, extras) = read_weather(&mut call.fields("the weather")?)?;
        self.commander.ask_one(Command::SetWeather { weather })?;
        *lock(&self.weather_extras) = extras;
        self.world.change(|known| {
            if let Some(info) = &mut known.info {
                info.weather = weather;
            }
        });
        Ok(Answer::Void)
    }
}

/// The ten parameters both have, in CARLA's order.
fn weather_values(weather: &Weather) -> [f32; 10] {
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
    ]
}

/// CARLA checks nothing, so values outside their range are taken as the nearest one inside. `WeatherParameters.Default` is −1 throughout
/// and means the map's own weather.
fn read_weather(given: &mut Fields<'_>) -> Result<(Weather, [f32; 4]), Wrong> {
    let mut ahead = Fields::new("the weather", given.rest());
    let mut is_default = true;
    for _ in 0..10 {
        is_default &= ahead.f32()? == -1.0;
    }
    let percent = |given: &mut Fields<'_>| given.f32().map(|x| x.clamp(0.0, 100.0));
    let weather = Weather {
        cloudiness: percent(given)?,
        precipitation: percent(given)?,
        precipitation_deposits: percent(given)?,
        wind_intensity: percent(given)?,
        sun_azimuth_deg: axes::azimuth_deg(given.f32()?),
        sun_altitude_deg: given.f32()?.clamp(-90.0, 90.0),
        fog_density: percent(given)?,
        fog_distance_m: given.f32()?.clamp(0.0, 1e5),
        fog_falloff: percent(given)?,
        wetness: percent(given)?,
    };
    let extras = [given.f32()?, given.f32()?, given.f32()?, given.f32()?];
    Ok((if is_default { Weather::default() } else { weather }, extras))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_preset_is_the_maps_own_weather() {
        let given = vec![Value::F32(-1.0); 14];
        assert_eq!(read_weather(&mut Fields::new("test", &given)).unwrap().0, Weather::default());
        assert!(read_weather(&mut Fields::new("test", &given[..13])).unwrap_err().contains("field 14"));
    }

    #[test]
    fn weather_goes_there_and_back() {
        let given: Vec<Value> = [10.0f32, 20.0, 30.0, 40.0, 45.0, -10.0, 5.0, 7.0, 0.5, 60.0, 1.0, 0.1, 0.2, 3.0].map(Value::from).into();
        let (weather, extras) = read_weather(&mut Fields::new("test", &given)).unwrap();
        assert_eq!(weather.sun_azimuth_deg, 315.0);
        let again: Vec<Value> = weather_values(&weather).into_iter().chain(extras).map(Value::from).collect();
        assert_eq!(again, given);
    }
}
