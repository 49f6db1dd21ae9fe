//! Every vehicle at 10 to 1000 ticks per second is dropped, driven off, steered and braked. None
//! blows up, flips or sinks in.

use std::collections::BTreeMap;

use schema_frames::{ActorRecord, VehicleControl};
use schema_types::Pose;
use simd_world::{MapData, World, WorldOptions, vehicle_models};

fn up_z(record: &ActorRecord) -> f64 {
    (record.world_from_actor.isometry().rotation * nalgebra::Vector3::z()).z
}

/// All models in one world, far apart; returns the records after each phase of 3 s: dropped, full
/// throttle, full steer, full brake.
fn drive_all(tick_nanos: u64) -> Vec<Vec<ActorRecord>> {
    // As long as a tick, whatever that is.
    let mut world = World::new(WorldOptions {
        physics_substep_secs: tick_nanos as f64 * 1e-9,
        ..WorldOptions::default()
    });
    world.load(&MapData::flat(3000.0)).unwrap();
    let place = |i: usize| Pose::from_xyz_yaw(-500.0, -1000.0 + 50.0 * i as f64, 0.5, 0.0);
    let spawn = |(i, model): (usize, &simd_world::VehicleModel)| {
        world
            .spawn(model.type_id, place(i), None, "", &BTreeMap::new())
            .unwrap()
    };
    let cars: Vec<_> = vehicle_models().iter().enumerate().map(spawn).collect();
    let phases = [
        VehicleControl {
            hand_brake: true,
            ..Default::default()
        },
        VehicleControl {
            throttle_ratio: 1.0,
            ..Default::default()
        },
        VehicleControl {
            throttle_ratio: 0.3,
            steer_ratio: 1.0,
            ..Default::default()
        },
        VehicleControl {
            brake_ratio: 1.0,
            ..Default::default()
        },
    ];
    let mut results = Vec::new();
    for control in phases {
        cars.iter()
            .for_each(|car| world.set_control(*car, control).unwrap());
        for _ in 0..3_000_000_000 / tick_nanos {
            world.step(tick_nanos);
            for (car, model) in cars.iter().zip(vehicle_models()) {
                let record = world.record(*car).unwrap();
                let [_, _, z_m] = record.world_from_actor.translation_m;
                let least = if model.is_two_wheeler() { 0.55 } else { 0.85 };
                let id = model.type_id;
                assert!(
                    up_z(record) > least,
                    "{id} at {tick_nanos} ns tips over: up {}",
                    up_z(record)
                );
                assert!(
                    (-0.15..0.6).contains(&z_m),
                    "{id} at {tick_nanos} ns is {z_m} m high"
                );
                assert_eq!(
                    record.flags & (ActorRecord::QUARANTINED | ActorRecord::TOUCHED),
                    0,
                    "{id} at {tick_nanos} ns"
                );
            }
        }
        results.push(
            cars.iter()
                .map(|car| *world.record(*car).unwrap())
                .collect(),
        );
    }
    results
}

#[test]
fn every_vehicle_drives_alike_from_10_to_1000_ticks_per_second() {
    let reference = drive_all(1_000_000);
    for tick_millis in [100, 50, 20, 10, 5] {
        let phases = drive_all(tick_millis * 1_000_000);
        for (i, model) in vehicle_models().iter().enumerate() {
            let id = model.type_id;
            let [dropped, driven, _, braked] = [0, 1, 2, 3].map(|phase| phases[phase][i]);
            let fine = reference[1][i].speed_mps();
            assert!(
                dropped.speed_mps() < 0.02,
                "{id} at {tick_millis} ms does not come to rest: {} m/s",
                dropped.speed_mps()
            );
            assert!(
                braked.speed_mps() < 0.05,
                "{id} at {tick_millis} ms does not stop: {} m/s",
                braked.speed_mps()
            );
            let apart = (driven.speed_mps() / fine - 1.0).abs();
            assert!(
                apart < 0.08,
                "{id} at {tick_millis} ms reaches {} m/s, at 1 ms {fine} m/s",
                driven.speed_mps()
            );
        }
    }
}
