//! Calls about traffic lights.

use schema_frames::{ActorKind, Command, CommandReply, LightState};

use crate::fields::Wrong;
use crate::gateway::{Answer, Failure, Gateway, Outcome};
use crate::msgpack::Value;
use crate::rpc::batch::{Commands, Item};
use crate::rpc::{Call, Calls};
use crate::shapes;

pub(crate) const CALLS: Calls = &[
    ("set_traffic_light_state", Gateway::set_traffic_light),
    ("freeze_traffic_light", |gateway, call| {
        call.u32()?;
        let frozen = call.bool()?;
        gateway.freeze(frozen)
    }),
    ("freeze_all_traffic_lights", |gateway, call| {
        let frozen = call.bool()?;
        gateway.freeze(frozen)
    }),
    ("set_traffic_light_green_time", |gateway, call| {
        gateway.set_light_time(call, "green")
    }),
    ("set_traffic_light_yellow_time", |gateway, call| {
        gateway.set_light_time(call, "yellow")
    }),
    ("set_traffic_light_red_time", |gateway, call| {
        gateway.set_light_time(call, "red")
    }),
    ("reset_traffic_light_group", Gateway::reset_light_group),
    ("reset_all_traffic_lights", |gateway, _| {
        gateway
            .commander
            .ask_one(Command::ResetTrafficLights { actor_id: None })?;
        Ok(Answer::Void)
    }),
    ("get_light_boxes", Gateway::light_boxes),
    ("get_group_traffic_lights", Gateway::light_group),
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

/// Stages that a light can be given, seconds; CARLA takes any number.
const STAGE_SECS: (f64, f64) = (0.01, 1e5);

/// Name of CARLA's traffic-light state in commands.
fn light_name(state: u8) -> Result<String, Wrong> {
    match state {
        0..=4 => Ok(LightState::from_code(state.into()).name().to_owned()),
        _ => Err(format!(
            "traffic-light state is {state}, but must be 0 (red), 1 (yellow), 2 (green), 3 (off) or 4 (unknown)"
        )),
    }
}

impl Gateway {
    fn set_traffic_light(&self, call: &mut Call<'_>) -> Outcome {
        let (actor_id, state) = (self.known_actor(call)?, light_name(call.u8()?)?);
        self.commander
            .tell(Command::SetTrafficLight { actor_id, state });
        Ok(Answer::Void)
    }

    fn freeze(&self, frozen: bool) -> Outcome {
        self.commander.tell(Command::FreezeTrafficLights { frozen });
        Ok(Answer::Void)
    }

    fn set_light_time(&self, call: &mut Call<'_>, state: &str) -> Outcome {
        let (actor_id, secs) = (
            self.known_actor(call)?,
            call.f64()?.clamp(STAGE_SECS.0, STAGE_SECS.1),
        );
        self.commander.tell(Command::SetTrafficLightTime {
            actor_id,
            state: state.to_owned(),
            secs,
        });
        Ok(Answer::Void)
    }

    fn reset_light_group(&self, call: &mut Call<'_>) -> Outcome {
        let actor_id = self.known_actor(call)?;
        self.commander.tell(Command::ResetTrafficLights {
            actor_id: Some(actor_id),
        });
        Ok(Answer::Void)
    }

    fn light_boxes(&self, call: &mut Call<'_>) -> Outcome {
        let actor_id = self.known_actor(call)?;
        match self.commander.ask_one(Command::LightBoxes { actor_id })? {
            (CommandReply::Boxes { boxes }, _) => Ok(Answer::Value(Value::Array(
                boxes.iter().map(shapes::posed_box).collect(),
            ))),
            (other, _) => Err(Failure::Refused(format!(
                "{other:?} is no answer to a question for boxes"
            ))),
        }
    }

    fn light_group(&self, call: &mut Call<'_>) -> Outcome {
        let id = self.known_actor(call)?;
        let snapshot = self.world.known().snapshot.clone();
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
}
