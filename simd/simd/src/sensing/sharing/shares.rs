//! Which worker makes the frames of which camera, and how cameras move.

use schema_types::ActorId;
use sensor_spec::SensorSpec;
use simd_frames::frames::Sensors;
use simd_frames::sensor::{Maker, Model, Sensor};
use simd_frames::share::{Group, divide as shares_of};
use simd_world::World;

use super::lists::{Surroundings, header_of_lists, listed, shared, stays_here};
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
    let wishes = wishes(sensors, workers, around);
    let (mut next, mut rest) = (wishes.clone(), Rest::default());
    for (sensor, (_, maker)) in shared(sensors).zip(&mut next) {
        let is_at_work = match sensor.maker {
            Maker::Here => true,
            Maker::Worker(owner) => workers.is_working(owner),
            Maker::Nobody => false,
        };
        if !is_at_work || sensor.maker == *maker {
            continue;
        }
        if around.parting == Parting::WithNextTick {
            *maker = sensor.maker;
            rest.is_to_move = true;
        } else if sensor.maker != Maker::Here {
            // It closes its topics before anybody else opens them.
            *maker = Maker::Nobody;
            rest.is_moving = true;
        }
    }
    let maker_of = |sensor: &Sensor| {
        let found = next.binary_search_by_key(&sensor.actor, |(actor, _)| *actor);
        found.map_or(sensor.maker, |idx| next[idx].1)
    };
    sensors.hand_over(around.bus, maker_of)?;
    let now = listed(sensors);
    if !workers.has_listed(&now) {
        let assets = around.world.episode().assets();
        if let Err(error) = workers.set_lists(now, header_of_lists(around), assets) {
            faults.unsent("a scene for render workers", &error);
        }
    }
    workers.has_divided(rest);
    let is_any_without = wishes.iter().any(|(_, maker)| *maker == Maker::Nobody);
    workers.say_lack(is_any_without, around.bus.domain());
    Ok(())
}

/// Whether the lists of workers are those of the cameras that there are.
pub fn are_listed(sensors: &Sensors, workers: &Workers) -> bool {
    workers.has_listed(&listed(sensors))
}

/// Who is to make the frames of each camera, by rising actor.
fn wishes(
    sensors: &Sensors,
    workers: &Workers,
    around: &Surroundings<'_>,
) -> Vec<(ActorId, Maker)> {
    let has_gpu = sensors.gpu().is_some();
    let workers = workers.shares();
    // Who has no worker: rays need no GPU.
    let alone = |sensor: &Sensor| match sensor.model {
        Model::View(_) if !has_gpu => Maker::Nobody,
        _ => Maker::Here,
    };
    // Sensors of one rig that see the same are drawn once.
    let mut groups: Vec<(Alike, Group, Members)> = Vec::new();
    let mut wishes = Vec::new();
    for sensor in shared(sensors) {
        if stays_here(sensors, around.world.episode().assets(), sensor) {
            wishes.push((sensor.actor, Maker::Here));
            continue;
        }
        let alike = alike(around.world.world(), sensor);
        let now = match sensor.maker {
            Maker::Worker(worker) => Some(worker),
            _ => None,
        };
        let member = (sensor.actor, alone(sensor));
        let cost = cost(sensor, around.clock.period_nanos());
        match groups.iter_mut().find(|(of, ..)| *of == alike) {
            Some((_, group, members)) => {
                group.cost += cost;
                group.now = group.now.or(now);
                members.push(member);
            }
            None => groups.push((alike, Group { cost, now }, vec![member])),
        }
    }
    let costs: Vec<Group> = groups.iter().map(|(_, group, _)| *group).collect();
    for ((_, _, members), owner) in groups.into_iter().zip(shares_of(&costs, &workers)) {
        let made = |(actor, alone)| (actor, owner.map_or(alone, Maker::Worker));
        wishes.extend(members.into_iter().map(made));
    }
    wishes.sort_unstable();
    wishes
}

/// What cameras have in common that see the same: rig, size, and place to the bit. A lidar is alone,
/// and has its actor in place of a size.
type Alike = (String, [u32; 2], [u64; 7]);

/// Sensors of a group, and who makes the frames of each without workers.
type Members = Vec<(ActorId, Maker)>;

fn alike(world: &World, sensor: &Sensor) -> Alike {
    let pose = world
        .record(sensor.actor)
        .map(|record| bytemuck::cast(record.world_from_actor))
        .unwrap_or_default();
    let size_px = match sensor.model {
        Model::Lidar { .. } => [0, sensor.actor.0],
        _ => size_px(&sensor.spec),
    };
    (sensor.rig.name.clone(), size_px, pose)
}

fn size_px(spec: &SensorSpec) -> [u32; 2] {
    match spec {
        SensorSpec::Camera(camera) => {
            let lens = camera.intrinsics();
            [lens.width_px, lens.height_px]
        }
        _ => [0; 2],
    }
}

/// Pixels times modalities; of a lidar its rays, each of which takes a processor about as long as a
/// pixel (measured: 0.11 µs and 0.08 µs).
fn cost(sensor: &Sensor, period_nanos: u64) -> u64 {
    if let SensorSpec::Lidar(lidar) = &sensor.spec {
        return u64::from(lidar.points_per_frame(period_nanos as f64 * 1e-9));
    }
    let [width_px, height_px] = size_px(&sensor.spec);
    u64::from(width_px) * u64::from(height_px) * sensor.topics.len().max(1) as u64
}
