//! Calls about vehicles: controls and lamps.

use schema_frames::{Command, VehicleControlRecord};

use crate::gateway::{Answer, Gateway, Outcome};
use crate::list;
use crate::msgpack::Value;
use crate::rpc::batch::{Commands, Item};
use crate::rpc::{Call, Calls};

/// Lamps that exist; `VehicleLightState.All` has every bit.
pub(crate) const LAMPS: u32 = 0x7ff;

pub(crate) const CALLS: Calls = &[
    ("apply_control_to_vehicle", Gateway::apply_control),
    ("get_vehicle_light_state", Gateway::vehicle_lamps),
    ("set_vehicle_light_state", Gateway::set_vehicle_lamps),
    ("get_vehicle_light_states", |gateway, _| Ok(Answer::Value(gateway.all_lamps()))),
];

pub(crate) const BATCH: Commands = &[
    (2, |actor, fields| Ok(Item::Control { actor, record: VehicleControlRecord::new(actor, fields.vehicle_control()?) })),
    (18, |actor, fields| Ok(Item::ask(actor, Command::SetLamps { actor_id: actor, lamps: fields.u32()? & LAMPS }))),
];

impl Gateway {
    fn apply_control(&self, call: &mut Call<'_>) -> Outcome {
        let (actor_id, control) = (self.known_actor(call)?, call.vehicle_control()?);
        self.commander.control(vec![VehicleControlRecord::new(actor_id, control)]);
        Ok(Answer::Void)
    }

    fn vehicle_lamps(&self, call: &mut Call<'_>) -> Outcome {
        let id = self.known_actor(call)?;
        let snapshot = self.world.known().snapshot.clone();
        let lamps = snapshot.and_then(|at| at.actor(id)?.vehicle()).map_or(0, |part| part.lamps);
        Ok(Answer::Value(list![lamps]))
    }

    fn set_vehicle_lamps(&self, call: &mut Call<'_>) -> Outcome {
        let (actor_id, lamps) = (self.known_actor(call)?, call.fields("a light state")?.u32()?);
        self.commander.tell(Command::SetLamps { actor_id, lamps: lamps & LAMPS });
        Ok(Answer::Void)
    }

    fn all_lamps(&self) -> Value {
        let snapshot = self.world.known().snapshot.clone();
        let records = snapshot.iter().flat_map(|snapshot| &snapshot.records);
        Value::Array(records.filter_map(|record| Some(list![record.id, record.vehicle()?.lamps])).collect())
    }
}
