//! What moves as one from one process to another: cameras that see the same, because they are drawn
//! once, and all cameras of a batch, because one process must make all images of its frames.

use schema_types::ActorId;
use sensor_spec::SensorSpec;
use simd_frames::frames::Sensors;
use simd_frames::sensor::{Maker, Model, Sensor};
use simd_frames::share::Group;
use simd_world::World;

use super::lists::{shared, stays_here};
use crate::world::LiveWorld;

/// Sensors whose frames one process makes.
pub struct Unit {
    /// Its cost, and the worker that has it; `None` if its frames are made here whatever workers
    /// there are.
    pub group: Option<Group>,
    /// Sensors by rising actor, with the processes that make their frames.
    pub members: Vec<(ActorId, Maker)>,
    /// Who makes its frames without workers: rays need no GPU.
    pub alone: Maker,
}

/// The units of all cameras and lidars: those that stay here, then the others in the order of their
/// first sensors.
pub fn units(sensors: &Sensors, world: &LiveWorld, period_nanos: u64) -> Vec<Unit> {
    let assets = world.episode().assets();
    let (kept, shared): (Vec<&Sensor>, Vec<&Sensor>) =
        shared(sensors).partition(|sensor| stays_here(sensors, assets, sensor));
    let mut links: Vec<usize> = (0..shared.len()).collect();
    let looks: Vec<Alike> = shared
        .iter()
        .map(|sensor| alike(world.world(), sensor))
        .collect();
    let mut by_look: Vec<usize> = links.clone();
    by_look.sort_by(|a, b| looks[*a].cmp(&looks[*b]));
    for pair in by_look.windows(2) {
        if looks[pair[0]] == looks[pair[1]] {
            join(&mut links, pair[0], pair[1]);
        }
    }
    for batch in &sensors.batches {
        let mut own = (0..shared.len()).filter(|idx| batch.has_camera(shared[*idx]));
        if let Some(first) = own.next() {
            own.for_each(|idx| join(&mut links, first, idx));
        }
    }
    let kept = kept.into_iter().map(|sensor| Unit {
        group: None,
        members: vec![(sensor.actor, sensor.maker)],
        alone: Maker::Here,
    });
    let mut units: Vec<Unit> = kept.collect();
    // The first sensor of a unit is the end of all links of it, and comes before them.
    let mut unit_of = vec![0; shared.len()];
    for (idx, sensor) in shared.iter().enumerate() {
        let first = end_of(&links, idx);
        if first == idx {
            unit_of[idx] = units.len();
            let is_view = matches!(sensor.model, Model::View(_));
            units.push(Unit {
                group: Some(Group { cost: 0, now: None }),
                members: Vec::new(),
                alone: match is_view && sensors.gpu().is_none() {
                    true => Maker::Nobody,
                    false => Maker::Here,
                },
            });
        }
        let unit = &mut units[unit_of[first]];
        if let Some(group) = &mut unit.group {
            group.cost += cost(sensor, period_nanos);
            if let Maker::Worker(worker) = sensor.maker {
                group.now = group.now.or(Some(worker));
            }
        }
        unit.members.push((sensor.actor, sensor.maker));
    }
    units
}

/// Links two places, so that both lead to the lesser end of theirs.
fn join(links: &mut [usize], a: usize, b: usize) {
    let (a, b) = (end_of(links, a), end_of(links, b));
    links[a.max(b)] = a.min(b);
}

fn end_of(links: &[usize], mut at: usize) -> usize {
    while links[at] != at {
        at = links[at];
    }
    at
}

/// What cameras have in common that see the same: rig, size, and place to the bit. A lidar is alone,
/// and has its actor in place of a size.
type Alike = (String, [u32; 2], [u64; 7]);

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_linked_leads_to_the_first_of_it() {
        let mut links: Vec<usize> = (0..6).collect();
        for (a, b) in [(4, 5), (3, 1), (5, 3)] {
            join(&mut links, a, b);
        }
        let ends: Vec<usize> = (0..6).map(|at| end_of(&links, at)).collect();
        assert_eq!(ends, [0, 1, 2, 1, 1, 1]);
    }
}
