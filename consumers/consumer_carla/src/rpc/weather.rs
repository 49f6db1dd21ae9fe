//! Calls about the weather.

use schema_frames::Command;

use crate::gateway::Gateway;
use crate::rpc::call::{Call, Calls};
use crate::wire::msgpack::Value;
use crate::wire::requests::{Answer, Failure, Outcome};
use crate::wire::sensor_message::records::GRAVITY_MPS2;
use crate::wire::weather::{read_weather, weather_values};

pub(crate) const CALLS: Calls = &[
    ("get_imui_gravity", |gateway, _| {
        let set = gateway.world.known().imu_gravity_mps2;
        Ok(Answer::Value((set.unwrap_or(GRAVITY_MPS2) as f32).into()))
    }),
    ("set_imui_gravity", |gateway, call| {
        let gravity = f64::from(call.f32()?);
        if !(0.0..=1000.0).contains(&gravity) {
            return Err(Failure::Refused(format!(
                "gravity is {gravity} m/s², but must be 0 to 1000"
            )));
        }
        gateway
            .world
            .change(|known| known.imu_gravity_mps2 = Some(gravity));
        Ok(Answer::Void)
    }),
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
