//! Calls about the weather.

use schema_frames::Command;

use crate::gateway::Gateway;
use crate::rpc::call::{Call, Calls};
use crate::wire::msgpack::Value;
use crate::wire::requests::{Answer, Outcome};
use crate::wire::weather::{read_weather, weather_values};

pub(crate) const CALLS: Calls = &[
    ("get_weather_parameters", |gateway, _| get_weather(gateway)),
    ("set_weather_parameters", set_weather),
];

fn get_weather(gateway: &Gateway) -> Outcome {
    let values = weather_values(&gateway.info()?.weather)
        .map(Value::from)
        .to_vec();
    Ok(Answer::Value(values.into()))
}

fn set_weather(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let weather = read_weather(&mut call.fields("the weather")?)?;
    gateway.commander.ask_one(Command::SetWeather { weather })?;
    gateway.world.change(|known| {
        if let Some(info) = &mut known.info {
            info.weather = weather;
        }
    });
    Ok(Answer::Void)
}
