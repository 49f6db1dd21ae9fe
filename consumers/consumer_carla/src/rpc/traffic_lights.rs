//! Calls about traffic lights.

use schema_frames::{ActorKind, Command, LightState};

use crate::fields::Wrong;
use crate::gateway::{Answer, Failure, Gateway, Outcome};
use crate::msgpack::Value;
use crate::rpc::batch::{Commands, Item};
use crate::rpc::{Call, Calls};

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
    ("reset_all_traffic_lights", |gateway, call| {
        gateway.no_effect(call.method);
        Ok(Answer::Void)
    }),
    ("get_group_traffic_lights", Gateway::light_group),
];

pub(crate) const BATCH: Commands = &[(21, |actor, fields| {
    let state = light_name(fields.u8()?)?;
    Ok(Item::ask(actor, Command::SetTrafficLight { actor_id: actor, state }))
})];

/// Name of CARLA's traffic-light state in commands.
fn light_name(state: u8) -> Result<String, Wrong> {
    match LightState::from_code(state.into()) {
        LightState::Unknown => Err(format!("traffic-light state is {state}, but must be 0 (red), 1 (yellow), 2 (green) or 3 (off)")),
        known => Ok(known.name().to_owned()),
    }
}

impl Gateway {
    fn set_traffic_light(&self, call: &mut Call<'_>) -> Outcome {
        let (actor_id, state) = (self.known_actor(call)?, light_name(call.u8()?)?);
        self.commander.tell(Command::SetTrafficLight { actor_id, state });
        Ok(Answer::Void)
    }

    fn freeze(&self, frozen: bool) -> Outcome {
        self.commander.tell(Command::FreezeTrafficLights { frozen });
        Ok(Answer::Void)
    }

    fn light_group(&self, call: &mut Call<'_>) -> Outcome {
        let id = self.known_actor(call)?;
        let snapshot = self.world.known().snapshot.clone();
        let group = snapshot.as_ref().and_then(|at| at.actor(id)?.traffic_light()).map(|part| part.group);
        let group = group.ok_or_else(|| Failure::Refused(format!("actor {id} is not a traffic light")))?;
        let lights = snapshot.iter().flat_map(|at| &at.records).filter(|record| record.kind() == Some(ActorKind::TrafficLight));
        let members = lights.filter(|record| record.traffic_light().is_some_and(|part| part.group == group));
        Ok(Answer::Value(Value::Array(members.map(|record| record.id.into()).collect())))
    }
}
