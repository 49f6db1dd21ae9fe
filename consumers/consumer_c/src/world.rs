//! Snapshots of the world.

use std::ptr::{from_ref, null};
use std::sync::Arc;

use consumer_kit::{KEPT_SNAPSHOTS, SnapshotTrail, WorldAt};
use schema_bus::{Listener, names};
use schema_frames::{ActorRecord, SnapshotHeader};

use crate::border::{Failure, Out, Status, ask, call, hand_over, needed};
use crate::place::{BusHandle, Place};
use crate::wait::Patience;

/// The handle `gantry_snapshots`.
#[derive(Debug)]
pub struct Snapshots {
    // Ports go before their node.
    trail: SnapshotTrail,
    event: Listener,
    place: Arc<Place>,
}

/// The handle `gantry_world`.
#[derive(Debug)]
pub struct World(pub Arc<WorldAt>);

/// Opens `world/snapshot`, and waits until it is there.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_snapshots_open(
    bus: Option<&BusHandle>,
    timeout_nanos: i64,
    snapshots: Out<'_, Option<Box<Snapshots>>>,
) -> Status {
    call(|| {
        let place = needed(bus, "bus")?.place.clone();
        let snapshots = needed(snapshots, "snapshots")?;
        let patience = Patience::new(timeout_nanos);
        // A reader of its own, which says what there is instead; the trail opens another.
        patience.open(|| Ok(place.bus.snapshot_reader().map(drop)?))?;
        let event = place.bus.listener(names::WORLD_SNAPSHOT)?;
        let mut trail = SnapshotTrail::new();
        trail.newest(&place.bus)?;
        let made = Snapshots {
            trail,
            event,
            place,
        };
        Ok(hand_over(snapshots, made))
    })
}

/// Stops reading.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_snapshots_close(snapshots: Option<Box<Snapshots>>) {
    ask((), || drop(snapshots));
}

/// The newest snapshot; waits for the first.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_snapshots_newest(
    snapshots: Option<&mut Snapshots>,
    timeout_nanos: i64,
    world: Out<'_, Option<Box<World>>>,
) -> Status {
    call(|| {
        let Snapshots {
            trail,
            event,
            place,
        } = needed(snapshots, "snapshots")?;
        let world = needed(world, "world")?;
        world.write(None);
        let patience = Patience::new(timeout_nanos);
        let found = patience.look(event, || Ok(trail.newest(&place.bus)?))?;
        Ok(found.map_or(Status::Nothing, |found| hand_over(world, World(found))))
    })
}

/// The snapshot of exactly `tick`; waits for it.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_snapshots_at(
    snapshots: Option<&mut Snapshots>,
    tick: u64,
    timeout_nanos: i64,
    world: Out<'_, Option<Box<World>>>,
) -> Status {
    call(|| {
        let Snapshots {
            trail,
            event,
            place,
        } = needed(snapshots, "snapshots")?;
        let world = needed(world, "world")?;
        world.write(None);
        let patience = Patience::new(timeout_nanos);
        let found = patience.look(event, || {
            let found = trail.at(&place.bus, tick)?;
            let newest = trail.newest(&place.bus)?;
            match newest.map(|newest| newest.header.tick) {
                Some(newest) if found.is_none() && newest > tick => Err(Failure::new(
                    Status::Failed,
                    format!("the snapshot of tick {tick} is gone, the newest is of tick {newest}; the last {KEPT_SNAPSHOTS} since the snapshots were opened are kept, so ask for it soon"),
                )),
                _ => Ok(found),
            }
        })?;
        Ok(found.map_or(Status::Nothing, |found| hand_over(world, World(found))))
    })
}

/// Header of a snapshot.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_world_header(world: Option<&World>) -> *const SnapshotHeader {
    world.map_or(null(), |world| from_ref(&world.0.header))
}

/// Actors of a snapshot by rising id.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_world_actors(
    world: Option<&World>,
    len: Out<'_, usize>,
) -> *const ActorRecord {
    let actors: &[ActorRecord] = world.map_or(&[], |world| &world.0.records);
    if let Some(len) = len {
        len.write(actors.len());
    }
    actors.as_ptr()
}

/// Frees a snapshot.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_world_release(world: Option<Box<World>>) {
    ask((), || drop(world));
}

const _: () = {
    const fn moves<T: Send>() {}
    moves::<Snapshots>();
    moves::<World>();
};
