//! A place in lockstep: ticks one by one, each acknowledged when the next is asked for.

use std::sync::Arc;
use std::time::Duration;

use consumer_kit::Steps;

use crate::border::{Out, Status, Text, ask, call, hand_over, needed};
use crate::place::{BusHandle, Place};
use crate::wait::Patience;
use crate::world::World;

/// Longest time in which the simulator answers that a place is taken.
const JOIN_TIMEOUT: Duration = Duration::from_secs(3600);

/// The handle `gantry_lockstep`.
#[derive(Debug)]
pub struct Lockstep {
    // Ports go before their node.
    steps: Steps,
    place: Arc<Place>,
}

/// Joins under a name, and waits for the simulator.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_lockstep_join(
    bus: Option<&BusHandle>,
    name: Text<'_>,
    timeout_nanos: i64,
    lockstep: Out<'_, Option<Box<Lockstep>>>,
) -> Status {
    call(|| {
        let place = needed(bus, "bus")?.place.clone();
        let name = name.needed("name")?;
        let lockstep = needed(lockstep, "lockstep")?;
        let patience = Patience::new(timeout_nanos);
        let steps = patience.open(|| {
            let wait = patience.left(JOIN_TIMEOUT);
            Ok(Steps::join_on(&place.bus, name, wait)?)
        })?;
        Ok(hand_over(lockstep, Lockstep { steps, place }))
    })
}

/// Acknowledges the last tick, and waits until everything of the next was sent.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_lockstep_next(
    lockstep: Option<&mut Lockstep>,
    timeout_nanos: i64,
    world: Out<'_, Option<Box<World>>>,
) -> Status {
    call(|| {
        let Lockstep { steps, place } = needed(lockstep, "lockstep")?;
        let world = needed(world, "world")?;
        world.write(None);
        let patience = Patience::new(timeout_nanos);
        loop {
            if let Some(found) = steps.next(&place.bus, patience.slice())? {
                return Ok(hand_over(world, World(found)));
            }
            if patience.is_over() {
                return Ok(Status::Nothing);
            }
        }
    })
}

/// Acknowledges the last tick now.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_lockstep_acknowledge(lockstep: Option<&mut Lockstep>) -> Status {
    call(|| {
        needed(lockstep, "lockstep")?.steps.acknowledge()?;
        Ok(Status::Ok)
    })
}

/// Leaves: the simulator waits no longer.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_lockstep_leave(lockstep: Option<Box<Lockstep>>) {
    ask((), || drop(lockstep));
}

const _: () = {
    const fn moves<T: Send>() {}
    moves::<Lockstep>();
};
