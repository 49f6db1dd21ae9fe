//! Strollers among cars that stand in their way: none walks on the spot against a car, and all get
//! on.

use std::collections::BTreeMap;

use nalgebra::Point3;
use schema_frames::VehicleControl;
use schema_roads::{LaneKind, LanePosition};
use schema_types::{ActorId, Pose};
use simd_town::Town;
use simd_world::{MapData, World, WorldOptions};

const TICK_NANOS: u64 = 50_000_000;
const TICK_SECS: f64 = 0.05;
const N_WALKERS: usize = 60;

/// Cars with their hand brakes on, every few metres along the middle of pavements and across
/// crosswalks.
fn block(world: &mut World) -> Vec<ActorId> {
    let roads = world.roads().unwrap().clone();
    let mut places = Vec::new();
    for lane in roads
        .lanes()
        .iter()
        .filter(|lane| lane.kind == LaneKind::Sidewalk)
    {
        let n = (lane.length_m / 25.0) as usize;
        places.extend((0..n).map(|k| {
            Pose::from(
                roads
                    .pose(LanePosition::new(lane.key, (k as f64 + 0.5) * 25.0))
                    .unwrap(),
            )
        }));
    }
    for walk in roads.crosswalks() {
        let n = walk.corners.len() as f64;
        let [x, y, z] = walk.corners.iter().fold([0.0; 3], |sum, p| {
            std::array::from_fn(|i| sum[i] + p[i] / n)
        });
        let lane = roads
            .nearest([x, y, z], |lane| lane.kind.is_drivable())
            .unwrap();
        places.push(Pose::from(roads.pose(lane).unwrap()));
    }
    let mut cars = Vec::new();
    for mut place in places {
        place.translation_m[2] += 0.3;
        // Trees, lamps and benches stand on pavements too.
        if let Ok(car) = world.spawn("vehicle.tesla.model3", place, None, "", &BTreeMap::new()) {
            world
                .set_control(
                    car,
                    VehicleControl {
                        hand_brake: true,
                        brake_ratio: 1.0,
                        ..VehicleControl::default()
                    },
                )
                .unwrap();
            cars.push(car);
        }
    }
    cars
}

#[test]
fn nobody_walks_on_the_spot_against_a_standing_car() {
    let mut world = World::new(WorldOptions {
        seed: 5,
        ..WorldOptions::default()
    });
    world
        .load(&MapData::from(&Town::generate("Town10HD", 1).unwrap()))
        .unwrap();
    let walkers = world.spawn_walkers(N_WALKERS);
    let cars = block(&mut world);
    assert!(
        cars.len() > 60 && walkers.len() == N_WALKERS,
        "{} cars",
        cars.len()
    );
    let at =
        |world: &World, actor: ActorId| world.record(actor).unwrap().world_from_actor.translation_m;
    let mut last: Vec<[f64; 3]> = walkers.iter().map(|walker| at(&world, *walker)).collect();
    let (mut pressed_secs, mut longest_secs, mut ways) =
        (vec![0.0f64; N_WALKERS], 0.0f64, vec![0.0f64; N_WALKERS]);
    let mut met = [false; N_WALKERS];
    for _ in 0..2400 {
        world.step(TICK_NANOS);
        for (i, walker) in walkers.iter().enumerate() {
            let record = world.record(*walker).unwrap();
            let (now, radius) = (
                at(&world, *walker),
                f64::from(record.half_box_m[0].max(record.half_box_m[1])),
            );
            let moved = (now[0] - last[i][0]).hypot(now[1] - last[i][1]);
            let wants = f64::from(record.walker().unwrap().speed_mps) * TICK_SECS;
            let near = |car: &ActorId, room: f64| {
                let record = world.record(*car).unwrap();
                let local = record
                    .world_from_actor
                    .isometry()
                    .inverse_transform_point(&Point3::from(now));
                (0..2).all(|k| local[k].abs() < f64::from(record.half_box_m[k]) + radius + room)
                    && local.z.abs() < 2.0
            };
            met[i] |= cars.iter().any(|car| near(car, 1.0));
            let presses =
                wants > 0.0 && moved < 0.2 * wants && cars.iter().any(|car| near(car, 0.2));
            pressed_secs[i] = if presses {
                pressed_secs[i] + TICK_SECS
            } else {
                0.0
            };
            longest_secs = longest_secs.max(pressed_secs[i]);
            ways[i] += moved;
            last[i] = now;
        }
    }
    let n_met = met.iter().filter(|met| **met).count();
    ways.sort_by(f64::total_cmp);
    println!(
        "{} cars, {n_met} of {N_WALKERS} came near one, longest {longest_secs:.2} s against one, ways {:.0} m",
        cars.len(),
        ways[N_WALKERS / 2]
    );
    // Where a car leaves no way around on the pavement, people turn back before they are near;
    // elsewhere they pass it.
    assert!(n_met > N_WALKERS / 4, "only {n_met} came near a car");
    // Between a car and a lamp post somebody may stop for a moment; a walker without a way around
    // would stop for half a minute.
    assert!(
        longest_secs < 3.0,
        "somebody walked against a car for {longest_secs} s"
    );
    assert!(
        ways[N_WALKERS / 4] > 40.0,
        "three of four walk most of the time: {ways:?}"
    );
}
