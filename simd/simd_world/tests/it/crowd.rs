//! Strollers stay on pavements and crosswalks, wait for red lights, and do the same in every run.

use schema_frames::LightState;
use schema_roads::walkable::Ground;
use simd_town::Town;
use simd_world::{MapData, World, WorldOptions};

const TICK_NANOS: u64 = 50_000_000;

fn town() -> World {
    let mut world = World::new(WorldOptions {
        seed: 5,
        ..WorldOptions::default()
    });
    world
        .load(&MapData::from(&Town::generate("Town10HD", 1).unwrap()))
        .unwrap();
    world
}

#[test]
fn strollers_keep_to_pavements_and_cross_when_the_traffic_has_red() {
    let mut world = town();
    let walkers = world.spawn_walkers(40);
    assert_eq!(walkers.len(), 40);
    let roads = world.roads().unwrap().clone();
    let mesh = roads.walkable(true);
    let (mut ways, mut seen, mut begun) = (vec![0.0; 40], [0usize; 3], 0);
    let mut last: Vec<([f64; 3], Option<Ground>)> = walkers
        .iter()
        .map(|walker| {
            (
                world
                    .record(*walker)
                    .unwrap()
                    .world_from_actor
                    .translation_m,
                None,
            )
        })
        .collect();
    for tick in 0..2400 {
        world.step(TICK_NANOS);
        if tick % 5 != 0 {
            continue;
        }
        for (i, walker) in walkers.iter().enumerate() {
            let at = world
                .record(*walker)
                .unwrap()
                .world_from_actor
                .translation_m;
            ways[i] += (at[0] - last[i].0[0]).hypot(at[1] - last[i].0[1]);
            let feet = [
                at[0],
                at[1],
                at[2] - f64::from(world.record(*walker).unwrap().half_box_m[2]),
            ];
            let ground = mesh.face_at(feet, 1.5).map(|face| mesh.faces[face].ground);
            let lane = roads.nearest(feet, |lane| lane.kind.is_drivable()).unwrap();
            let on_lane = lane.offset_m.abs() < 0.5 * roads.width_m(lane);
            let of = if ground == Some(Ground::Crosswalk) {
                Ground::Crosswalk
            } else if on_lane {
                Ground::Road
            } else {
                Ground::Sidewalk
            };
            seen[of as usize] += 1;
            let steps_out =
                last[i].1 == Some(Ground::Sidewalk) && ground == Some(Ground::Crosswalk);
            // If the crossed road has a light, it was red a moment ago.
            if steps_out
                && let Some(lane) = roads.nearest(feet, |lane| {
                    lane.kind.is_drivable() && lane.junction.is_none()
                })
            {
                begun += 1;
                for signal in roads.signals() {
                    let guards = |stop: &schema_roads::SignalStop| {
                        let line = roads.pose(stop.stop).unwrap().translation.vector;
                        stop.stop.lane.road == lane.lane.road
                            && (line.x - feet[0]).hypot(line.y - feet[1]) < 10.0
                    };
                    if signal.stops.iter().any(guards) {
                        let part = world
                            .snapshot_records()
                            .iter()
                            .filter_map(|record| record.traffic_light())
                            .find(|part| part.opendrive_id() == signal.id);
                        let Some(part) = part else { continue };
                        let red = part.state == LightState::Red as u32 || part.elapsed_secs < 2.0;
                        assert!(
                            red,
                            "walker {walker} steps onto a crosswalk while {} shows {}",
                            signal.id, part.state
                        );
                    }
                }
            }
            last[i] = (at, ground);
        }
    }
    let on_foot: usize = seen.iter().sum();
    assert!(seen[Ground::Road as usize] * 50 < on_foot, "{seen:?}");
    assert!(begun >= 5, "{begun} crossings in two minutes");
    ways.sort_by(f64::total_cmp);
    assert!(
        ways[10] > 40.0 && ways[39] < 250.0,
        "three of four walk most of the time: {ways:?}"
    );
}

#[test]
fn the_same_seed_makes_the_same_crowd() {
    let run = || {
        let mut world = town();
        world.spawn_walkers(15);
        (0..300).for_each(|_| world.step(TICK_NANOS));
        world.snapshot_records().to_vec()
    };
    let (first, second) = (run(), run());
    assert_eq!(
        bytemuck::cast_slice::<_, u8>(&first),
        bytemuck::cast_slice::<_, u8>(&second)
    );
}

/// Walkable ground is where the mesh has a face. A walker that is pushed apart from another or
/// steps around a car may stand a little beside it.
#[test]
fn in_long_ticks_strollers_keep_to_walkable_ground() {
    let mut world = town();
    let walkers = world.spawn_walkers(40);
    let mesh = world.roads().unwrap().walkable(true);
    let (mut off, mut ways) = (0, vec![0.0; walkers.len()]);
    let feet = |world: &World, walker| {
        let record = world.record(walker).unwrap();
        let [x, y, z] = record.world_from_actor.translation_m;
        [x, y, z - f64::from(record.half_box_m[2])]
    };
    for _ in 0..30 {
        let before: Vec<_> = walkers.iter().map(|walker| feet(&world, *walker)).collect();
        world.step(10_000_000_000);
        for (i, walker) in walkers.iter().enumerate() {
            let at = feet(&world, *walker);
            ways[i] += (at[0] - before[i][0]).hypot(at[1] - before[i][1]);
            off += usize::from(mesh.face_at(at, 1.5).is_none());
        }
    }
    assert!(
        off * 50 < 30 * walkers.len(),
        "{off} of {} times beside the mesh",
        30 * walkers.len()
    );
    ways.sort_by(f64::total_cmp);
    assert!(ways[10] > 60.0, "three of four walk: {ways:?}");
}
