//! Calls about vehicles: controls, lamps and doors.

use schema_frames::{Command, VehicleControlRecord};

use crate::gateway::{Answer, Gateway, Outcome};
use crate::list;
use crate::msgpack::Value;
use crate::rpc::batch::{Commands, Item};
use crate::rpc::{Call, Calls};

/// Lamps that exist; `VehicleLightState.All` has every bit.
pub(crate) const LAMPS: u32 = 0x7ff;

/// `VehicleDoor.All`.
const ALL_DOORS: u8 = 6;

pub(crate) const CALLS: Calls = &[
    ("apply_control_to_vehicle", Gateway::apply_control),
    ("get_vehicle_light_state", Gateway::vehicle_lamps),
    ("set_vehicle_light_state", Gateway::set_vehicle_lamps),
    ("open_vehicle_door", |gateway, call| {
        gateway.set_doors(call, true)
    }),
    ("close_vehicle_door", |gateway, call| {
        gateway.set_doors(call, false)
    }),
    ("get_vehicle_light_states", |gateway, _| {
        Ok(Answer::Value(gateway.all_lamps()))
    }),
];

pub(crate) const BATCH: Commands = &[
    (2, |actor, fields| {
        Ok(Item::Control {
            actor,
            record: VehicleControlRecord::new(actor, fields.vehicle_control()?),
        })
    }),
    (18, |actor, fields| {
        Ok(Item::ask(
            actor,
            Command::SetLamps {
                actor_id: actor,
                lamps: fields.u32()? & LAMPS,
            },
        ))
    }),
];

impl Gateway {
    fn apply_control(&self, call: &mut Call<'_>) -> Outcome {
        let (actor_id, control) = (self.known_actor(call)?, call.vehicle_control()?);
        self.commander
            .control(vec![VehicleControlRecord::new(actor_id, control)]);
        Ok(Answer::Void)
    }

    fn vehicle_lamps(&self, call: &mut Call<'_>) -> Outcome {
        let id = self.known_actor(call)?;
        let snapshot = self.world.known().snapshot.clone();
        let lamps = snapshot
            .and_then(|at| at.actor(id)?.vehicle())
            .map_or(0, |part| part.lamps);
        Ok(Answer::Value(list![lamps]))
    }

    fn set_vehicle_lamps(&self, call: &mut Call<'_>) -> Outcome {
        let (actor_id, lamps) = (
            self.known_actor(call)?,
            call.fields("a light state")?.u32()?,
        );
        self.commander.tell(Command::SetLamps {
            actor_id,
            lamps: lamps & LAMPS,
        });
        Ok(Answer::Void)
    }

    /// The simulator leaves vehicles without doors that open as they are, as CARLA does.
    fn set_doors(&self, call: &mut Call<'_>, open: bool) -> Outcome {
        let (actor_id, door) = (self.known_actor(call)?, call.u8()?);
        let doors = match door {
            0..=3 => 1 << door,
            ALL_DOORS => 15,
            // Bonnet and boot do not open.
            _ => return Ok(Answer::Void),
        };
        self.commander.tell(Command::SetDoors {
            actor_id,
            doors,
            open,
        });
        Ok(Answer::Void)
    }

    fn all_lamps(&self) -> Value {
        let snapshot = self.world.known().snapshot.clone();
        let records = snapshot.iter().flat_map(|snapshot| &snapshot.records);
        Value::Array(
            records
                .filter_map(|record| Some(list![record.id, record.vehicle()?.lamps]))
                .collect(),
        )
    }
}
