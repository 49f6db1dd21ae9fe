//! Which worker makes the frames of which camera, and how cameras move.

use std::collections::BTreeMap;

use simd_frames::batch::Batch;
use simd_frames::frames::Sensors;
use simd_frames::sensor::{Maker, Sensor};
use simd_frames::share::{Group, divide as shares_of};

use super::lists::{Surroundings, header_of_lists, listed};
use super::units::units;
use crate::faults::Faults;
use crate::sensing::workers::{Parting, Rest, Workers};

/// Gives cameras their places if these may have to change: one step of it, the next when all workers
/// have taken over the lists. Cameras of a process that is gone move whatever `around` says of parting.
pub fn divide(
    sensors: &mut Sensors,
    workers: &mut Workers,
    around: &Surroundings<'_>,
    faults: &mut Faults,
) -> anyhow::Result<()> {
    if !workers.may_divide(&listed(sensors), around.parting)
        || !workers.is_complete(around.clock.tick())
    {
        return Ok(());
    }
    let units = units(sensors, around.world, around.clock.period_nanos());
    let costs: Vec<Group> = units.iter().filter_map(|unit| unit.group).collect();
    let mut owners = shares_of(&costs, &workers.shares()).into_iter();
    let (mut makers, mut rest, mut is_any_without) = (BTreeMap::new(), Rest::default(), false);
    for unit in &units {
        let owner = unit.group.and_then(|_| owners.next().flatten());
        let wish = owner.map_or(unit.alone, Maker::Worker);
        is_any_without |= wish == Maker::Nobody;
        let is_held = |now: Maker| {
            let is_to_move = now != wish && is_at_work(now, workers);
            is_to_move && around.parting == Parting::WithNextTick
        };
        let held = unit.members.iter().map(|(_, now)| *now);
        let held = held.filter(|now| is_held(*now)).min();
        rest.is_to_move |= held.is_some();
        for (actor, now) in &unit.members {
            let is_working = is_at_work(*now, workers);
            let next = match held {
                // What nobody has goes where the others are until the next tick.
                Some(held) if !is_working => held,
                _ if is_held(*now) => *now,
                _ if is_working && *now != wish && *now != Maker::Here => {
                    // It closes its topics before anybody else opens them.
                    rest.is_moving = true;
                    Maker::Nobody
                }
                _ => wish,
            };
            makers.insert(*actor, next);
        }
    }
    let of_sensor = |sensor: &Sensor| makers.get(&sensor.actor).copied().unwrap_or(sensor.maker);
    let of_batches: Vec<Maker> = sensors
        .batches
        .iter()
        .map(|batch| maker_of(batch, sensors, workers, of_sensor))
        .collect();
    let of_batch = |batch: &Batch| of_batches[batch.plan.number as usize];
    sensors.hand_over(around.bus, of_sensor, of_batch)?;
    let now = listed(sensors);
    if !workers.has_listed(&now) {
        let assets = around.world.episode().assets();
        if let Err(error) = workers.set_lists(now, header_of_lists(around), assets) {
            faults.unsent("a scene for render workers", &error);
        }
    }
    workers.has_divided(rest);
    workers.say_lack(is_any_without, around.bus.domain());
    Ok(())
}

/// Whether the lists of workers are those of the cameras that there are.
pub fn are_listed(sensors: &Sensors, workers: &Workers) -> bool {
    workers.has_listed(&listed(sensors))
}

/// Whether a process works that makes frames.
fn is_at_work(maker: Maker, workers: &Workers) -> bool {
    match maker {
        Maker::Here => true,
        Maker::Worker(owner) => workers.is_working(owner),
        Maker::Nobody => false,
    }
}

/// Who makes the frames of a batch: the process that makes those of all of its cameras. One whose
/// cameras have all ended stays where it is.
fn maker_of(
    batch: &Batch,
    sensors: &Sensors,
    workers: &Workers,
    of_sensor: impl Fn(&Sensor) -> Maker,
) -> Maker {
    let mut makers = sensors
        .sensors
        .iter()
        .filter(|sensor| batch.has_camera(sensor))
        .map(of_sensor);
    match makers.next() {
        Some(first) if makers.all(|maker| maker == first) => first,
        None if is_at_work(batch.maker, workers) => batch.maker,
        _ => Maker::Nobody,
    }
}
