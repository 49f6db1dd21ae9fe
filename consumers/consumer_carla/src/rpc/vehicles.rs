//! Calls about vehicles: controls, lamps and doors.

use schema_frames::{Command, VehicleControlRecord};

use crate::gateway::Gateway;
use crate::list;
use crate::rpc::batch_item::{Commands, Item};
use crate::rpc::call::{Call, Calls};
use crate::wire::fields::Structures as _;
use crate::wire::msgpack::Value;
use crate::wire::requests::{Answer, Outcome};
use crate::wire::structures::LAMPS;

/// `VehicleDoor.All`.
const ALL_DOORS: u8 = 6;

pub(crate) const CALLS: Calls = &[
    ("apply_control_to_vehicle", apply_control),
    ("get_vehicle_light_state", vehicle_lamps),
    ("set_vehicle_light_state", set_vehicle_lamps),
    ("open_vehicle_door", |gateway, call| {
        set_doors(gateway, call, true)
    }),
    ("close_vehicle_door", |gateway, call| {
        set_doors(gateway, call, false)
    }),
    ("get_vehicle_light_states", |gateway, _| {
        Ok(Answer::Value(all_lamps(gateway)))
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

fn apply_control(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let (actor_id, control) = (call.known_actor(gateway)?, call.vehicle_control()?);
    gateway
        .commander
        .control(vec![VehicleControlRecord::new(actor_id, control)]);
    Ok(Answer::Void)
}

fn vehicle_lamps(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let id = call.known_actor(gateway)?;
    let snapshot = gateway.world.known().snapshot.clone();
    let lamps = snapshot
        .and_then(|at| at.actor(id)?.vehicle())
        .map_or(0, |part| part.lamps);
    Ok(Answer::Value(list![lamps]))
}

fn set_vehicle_lamps(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let (actor_id, lamps) = (
        call.known_actor(gateway)?,
        call.fields("a light state")?.u32()?,
    );
    gateway.commander.tell(Command::SetLamps {
        actor_id,
        lamps: lamps & LAMPS,
    });
    Ok(Answer::Void)
}

/// Opens or shuts doors. The simulator ignores this for vehicles without doors that open, as CARLA
/// does.
fn set_doors(gateway: &Gateway, call: &mut Call<'_>, open: bool) -> Outcome {
    let (actor_id, door) = (call.known_actor(gateway)?, call.u8()?);
    let doors = match door {
        0..=3 => 1 << door,
        ALL_DOORS => 15,
        // Bonnet and boot do not open.
        _ => return Ok(Answer::Void),
    };
    gateway.commander.tell(Command::SetDoors {
        actor_id,
        doors,
        open,
    });
    Ok(Answer::Void)
}

fn all_lamps(gateway: &Gateway) -> Value {
    let snapshot = gateway.world.known().snapshot.clone();
    let records = snapshot.iter().flat_map(|snapshot| &snapshot.records);
    Value::Array(
        records
            .filter_map(|record| Some(list![record.id, record.vehicle()?.lamps]))
            .collect(),
    )
}
