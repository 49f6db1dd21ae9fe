//! Which worker makes the frames of which camera, and how cameras move.

use schema_types::ActorId;
use sensor_spec::SensorSpec;
use simd_frames::sensor::{Maker, Model, Sensor};
use simd_frames::share::{Group, divide as shares_of};

use super::lists::{is_complete, is_shared, say_that_lists_changed, stays_here};
use crate::daemon::Daemon;
use crate::workers::{Listed, Standing};

/// Gives cameras their places if these may have to change: one step of it, the next when all workers
/// have taken over the lists.
pub fn divide(daemon: &mut Daemon) -> anyhow::Result<()> {
    let listed = listed(&daemon.sensors.sensors);
    let workers = &mut daemon.workers;
    if listed != workers.listed {
        workers.must_divide = true;
    }
    if !workers.must_divide || !workers.all_took_over() || !is_complete(daemon) {
        return Ok(());
    }
    let wishes = wishes(daemon);
    let is_working = |number: u32| {
        let mut working = daemon.workers.working();
        working.any(|worker| worker.number == number)
    };
    let (mut next, mut is_moving) = (wishes.clone(), false);
    for (sensor, (_, maker)) in shared(&daemon.sensors.sensors).zip(&mut next) {
        if let Maker::Worker(owner) = sensor.maker
            && sensor.maker != *maker
            && is_working(owner)
        {
            // It closes its topics before anybody else opens them.
            *maker = Maker::Nobody;
            is_moving = true;
        }
    }
    let maker_of = |sensor: &Sensor| {
        let found = next.binary_search_by_key(&sensor.actor, |(actor, _)| *actor);
        found.map_or(sensor.maker, |idx| next[idx].1)
    };
    daemon.sensors.hand_over(&daemon.bus, maker_of)?;
    let now = self::listed(&daemon.sensors.sensors);
    if now != daemon.workers.listed {
        daemon.workers.listed = now;
        say_that_lists_changed(daemon);
    }
    daemon.workers.must_divide = is_moving;
    if wishes.iter().any(|(_, maker)| *maker == Maker::Nobody)
        && daemon
            .workers
            .workers
            .iter()
            .all(|it| it.standing != Standing::Joins)
        && !std::mem::replace(&mut daemon.workers.is_lack_said, true)
    {
        tracing::warn!(
            "the cameras have no frames: this simulator renders nothing (--no-gpu), and no render worker is there; start one with: gantry-render --domain {}",
            daemon.settings.domain
        );
    }
    if daemon.workers.has_any() {
        daemon.workers.is_lack_said = false;
    }
    Ok(())
}

/// Whether the lists of workers are those of the cameras that there are.
pub fn are_listed(daemon: &Daemon) -> bool {
    listed(&daemon.sensors.sensors) == daemon.workers.listed
}

/// The cameras as the lists of workers have them.
fn listed(sensors: &[Sensor]) -> Vec<Listed> {
    shared(sensors)
        .map(|it| (it.actor, it.n_beginnings, it.maker, it.hidden.clone()))
        .collect()
}

fn shared(sensors: &[Sensor]) -> impl Iterator<Item = &Sensor> {
    sensors.iter().filter(|sensor| is_shared(sensor))
}

/// Who is to make the frames of each camera, by rising actor.
fn wishes(daemon: &Daemon) -> Vec<(ActorId, Maker)> {
    let has_gpu = daemon.sensors.gpu().is_some();
    let workers: Vec<(u32, f64)> = daemon
        .workers
        .working()
        .map(|worker| (worker.number, worker.weight))
        .collect();
    // Who has no worker: rays need no GPU.
    let alone = |sensor: &Sensor| match sensor.model {
        Model::View(_) if !has_gpu => Maker::Nobody,
        _ => Maker::Here,
    };
    // Sensors of one rig that see the same are drawn once.
    let mut groups: Vec<(Alike, Group, Members)> = Vec::new();
    let mut wishes = Vec::new();
    for sensor in shared(&daemon.sensors.sensors) {
        if stays_here(daemon, sensor) {
            wishes.push((sensor.actor, Maker::Here));
            continue;
        }
        let alike = alike(daemon, sensor);
        let now = match sensor.maker {
            Maker::Worker(worker) => Some(worker),
            _ => None,
        };
        let member = (sensor.actor, alone(sensor));
        let cost = cost(sensor, daemon.clock.period_nanos());
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

fn alike(daemon: &Daemon, sensor: &Sensor) -> Alike {
    let pose = daemon
        .world
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
