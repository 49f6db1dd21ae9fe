//! Hears render workers, gives cameras their places, and says whether the world may go on.

mod lists;
mod questions;
mod shares;
mod units;

use schema_bus::Bus;
use schema_frames::SceneFiring;
use simd_frames::frames::{Sensors, TickView};
use simd_frames::sensor::{Maker, Sensor};

use crate::clock::Clock;
use crate::faults::Faults;
use crate::participants::Participants;
use crate::sensing::workers::{Look, Timeout, Workers};
use crate::world::LiveWorld;
pub use lists::Surroundings;

/// Hears the workers, and gives cameras their places. Called in every turn of the tick loop.
pub fn attend(
    sensors: &mut Sensors,
    workers: &mut Workers,
    around: &Surroundings<'_>,
    faults: &mut Faults,
) -> anyhow::Result<()> {
    workers.greet();
    if let Err(error) = workers.take_answers() {
        faults.unreadable(&error);
    }
    // A worker that was started again asks under its old name.
    workers.bury(around.bus, around.clock.tick().0);
    questions::answer(sensors, workers, around.world, faults);
    shares::divide(sensors, workers, around, faults)?;
    finish(sensors, workers, around.world, around.bus, faults)
}

/// Looks after workers for which the world waits.
pub fn look_after(
    sensors: &Sensors,
    workers: &mut Workers,
    clock: &Clock,
    participants: &Participants,
) {
    let look = Look {
        tick: clock.tick().0,
        behind: behind(sensors, participants),
        timeout_nanos: match participants.timeout_nanos() {
            _ if !participants.want_whole_ticks() => Timeout::Usual,
            Some(nanos) => Timeout::After(nanos),
            None => Timeout::Never,
        },
    };
    workers.look_after(&look);
}

/// Whether the next tick may start as far as workers are concerned.
pub fn let_go_on(
    sensors: &Sensors,
    workers: &Workers,
    clock: &Clock,
    participants: &Participants,
) -> bool {
    workers.is_complete(clock.tick())
        && workers.is_settled()
        && !workers.are_to_move()
        && shares::are_listed(sensors, workers)
        && workers.has_sent(behind(sensors, participants))
}

/// Whether commands may be answered: where all frames of a tick are sent before the next begins, they
/// are sent before an answer, too, unless a worker takes very long.
pub fn let_answer(workers: &Workers, participants: &Participants) -> bool {
    !participants.want_whole_ticks() || workers.has_sent_all() || workers.any_is_slow()
}

/// Messages that workers may be behind when a tick starts: none where all frames of a tick are sent
/// before the next begins.
fn behind(sensors: &Sensors, participants: &Participants) -> u64 {
    match participants.want_whole_ticks() {
        true => 0,
        false => u64::from(sensors.options().frames_in_flight),
    }
}

/// Has the frames made that a worker left undone, once its cameras have their new places.
fn finish(
    sensors: &mut Sensors,
    workers: &mut Workers,
    world: &LiveWorld,
    bus: &Bus,
    faults: &mut Faults,
) -> anyhow::Result<()> {
    let (mut here, mut away) = (Vec::new(), Vec::new());
    for firing in workers.take_unfinished(world.episode().assets().episode) {
        let of_firing = |sensor: &&Sensor| sensor.actor.0 == firing.sensor_id;
        let maker = match firing.batch() {
            Some(number) => {
                let mut batches = sensors.batches.iter();
                let batch = batches.find(|batch| batch.plan.number == number);
                batch.map(|batch| batch.maker)
            }
            None => {
                let sensor = sensors.sensors.iter().find(of_firing);
                sensor.map(|sensor| sensor.maker)
            }
        };
        match maker {
            Some(Maker::Here) => here.push(firing),
            Some(Maker::Worker(worker)) => away.push(SceneFiring { worker, ..firing }),
            Some(Maker::Nobody) | None => {}
        }
    }
    if !here.is_empty()
        && let Some((header, scene)) = workers.last_scene(world.episode().assets())?
    {
        let tick = TickView {
            scene: &scene,
            stamp: world.episode().stamp(),
            collisions: &[],
            roads: None,
        };
        sensors.settle_topics(bus, header.period_nanos)?;
        sensors.fire_given(&tick, &here)?;
    }
    if !away.is_empty()
        && let Err(error) = workers.send_again(&away)
    {
        faults.unsent("a scene for render workers", &error);
    }
    Ok(())
}
