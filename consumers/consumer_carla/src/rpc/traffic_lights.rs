//! Calls about traffic lights.

use schema_frames::{ActorKind, Command, CommandReply, LightState};

use crate::gateway::Gateway;
use crate::rpc::batch_item::{Commands, Item};
use crate::rpc::call::{Call, Calls};
use crate::wire::fields::Wrong;
use crate::wire::msgpack::Value;
use crate::wire::requests::{Answer, Failure, Outcome};
use crate::wire::structures;

pub(crate) const CALLS: Calls = &[
    ("set_traffic_light_state", set_traffic_light),
    ("freeze_traffic_light", |gateway, call| {
        call.u32()?;
        let frozen = call.bool()?;
        freeze(gateway, frozen)
    }),
    ("freeze_all_traffic_lights", |gateway, call| {
        let frozen = call.bool()?;
        freeze(gateway, frozen)
    }),
    ("set_traffic_light_green_time", |gateway, call| {
        set_light_time(gateway, call, "green")
    }),
    ("set_traffic_light_yellow_time", |gateway, call| {
        set_light_time(gateway, call, "yellow")
    }),
    ("set_traffic_light_red_time", |gateway, call| {
        set_light_time(gateway, call, "red")
    }),
    ("reset_traffic_light_group", reset_light_group),
    ("reset_all_traffic_lights", |gateway, _| {
        gateway
            .commander
            .ask_one(Command::ResetTrafficLights { actor_id: None })?;
        Ok(Answer::Void)
    }),
    ("get_light_boxes", light_boxes),
    ("get_group_traffic_lights", light_group),
];

pub(crate) const BATCH: Commands = &[(21, |actor, fields| {
    let state = light_name(fields.u8()?)?;
    Ok(Item::ask(
        actor,
        Command::SetTrafficLight {
            actor_id: actor,
            state,
        },
    ))
})];

/// Shortest and longest stage of a light, seconds; CARLA takes any number.
const STAGE_SECS: (f64, f64) = (0.01, 1e5);

/// Name of CARLA's traffic-light state in commands.
fn light_name(state: u8) -> Result<String, Wrong> {
    match state {
        0..=4 => Ok(LightState::from_code(state.into()).name().to_owned()),
        _ => Err(Wrong::Value(format!(
            "traffic-light state is {state}, but must be 0 (red), 1 (yellow), 2 (green), 3 (off) or 4 (unknown)"
        ))),
    }
}

fn set_traffic_light(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let (actor_id, state) = (call.known_actor(gateway)?, light_name(call.u8()?)?);
    gateway
        .commander
        .tell(Command::SetTrafficLight { actor_id, state });
    Ok(Answer::Void)
}

fn freeze(gateway: &Gateway, frozen: bool) -> Outcome {
    gateway
        .commander
        .tell(Command::FreezeTrafficLights { frozen });
    Ok(Answer::Void)
}

fn set_light_time(gateway: &Gateway, call: &mut Call<'_>, state: &str) -> Outcome {
    let (actor_id, secs) = (
        call.known_actor(gateway)?,
        call.f64()?.clamp(STAGE_SECS.0, STAGE_SECS.1),
    );
    gateway.commander.tell(Command::SetTrafficLightTime {
        actor_id,
        state: state.to_owned(),
        secs,
    });
    Ok(Answer::Void)
}

fn reset_light_group(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let actor_id = call.known_actor(gateway)?;
    gateway.commander.tell(Command::ResetTrafficLights {
        actor_id: Some(actor_id),
    });
    Ok(Answer::Void)
}

fn light_boxes(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let actor_id = call.known_actor(gateway)?;
    match gateway
        .commander
        .ask_one(Command::LightBoxes { actor_id })?
    {
        (CommandReply::Boxes { boxes }, _) => Ok(Answer::Value(Value::Array(
            boxes.iter().map(structures::posed_box).collect(),
        ))),
        (other, _) => Err(Failure::Refused(format!(
            "{other:?} is no answer to a question for boxes"
        ))),
    }
}

fn light_group(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let id = call.known_actor(gateway)?;
    let snapshot = gateway.world.known().snapshot.clone();
    let group = snapshot
        .as_ref()
        .and_then(|at| at.actor(id)?.traffic_light())
        .map(|part| part.group);
    let group =
        group.ok_or_else(|| Failure::Refused(format!("actor {id} is not a traffic light")))?;
    let lights = snapshot
        .iter()
        .flat_map(|at| &at.records)
        .filter(|record| record.kind() == Some(ActorKind::TrafficLight));
    let members = lights.filter(|record| {
        record
            .traffic_light()
            .is_some_and(|part| part.group == group)
    });
    Ok(Answer::Value(Value::Array(
        members.map(|record| record.id.into()).collect(),
    )))
}
