//! Every vehicle at every sub-step length from 10 to 1000 Hz: dropped, driven off, steered, braked. Nothing blows up, flips or sinks in.

use std::collections::BTreeMap;

use schema_frames::{ActorRecord, VehicleControl};
use schema_types::Pose;
use simd_world::{MapData, World, WorldOptions, vehicle_models};

const TICK_NANOS: u64 = 100_000_000;

fn up_z(record: &ActorRecord) -> f64 {
    (record.world_from_actor.isometry().rotation * nalgebra::Vector3::z()).z
}

/// All models in one world, far apart; returns the records after each phase of 3 s: dropped, full throttle, full steer, full brake.
fn drive_all(physics_substep_secs: f64) -> Vec<Vec<ActorRecord>> {
    let mut world = World::new(WorldOptions { physics_substep_secs, ..WorldOptions::default() });
    world.load(&MapData::flat(3000.0)).unwrap();
    let place = |i: usize| Pose::from_xyz_yaw(-500.0, -1000.0 + 50.0 * i as f64, 0.5, 0.0);
    let spawn = |(i, model): (usize, &simd_world::VehicleModel)| world.spawn(model.type_id, place(i), None, "", &BTreeMap::new()).unwrap();
    let cars: Vec<_> = vehicle_models().iter().enumerate().map(spawn).collect();
    let phases = [
        VehicleControl { hand_brake: true, ..Default::default() },
        VehicleControl { throttle_ratio: 1.0, ..Default::default() },
        VehicleControl { throttle_ratio: 0.3, steer_ratio: 1.0, ..Default::default() },
        VehicleControl { brake_ratio: 1.0, ..Default::default() },
    ];
    let mut results = Vec::new();
    for control in phases {
        cars.iter().for_each(|car| world.set_control(*car, control).unwrap());
        for _ in 0..30 {
            world.step(TICK_NANOS);
            for (car, model) in cars.iter().zip(vehicle_models()) {
                let record = world.record(*car).unwrap();
                let [_, _, z_m] = record.world_from_actor.translation_m;
                let least = if model.is_two_wheeler() { 0.55 } else { 0.85 };
                let id = model.type_id;
                assert!(up_z(record) > least, "{id} at {physics_substep_secs} s tips over: up {}", up_z(record));
                assert!((-0.15..0.6).contains(&z_m), "{id} at {physics_substep_secs} s is {z_m} m high");
                assert_eq!(record.flags & (ActorRecord::QUARANTINED | ActorRecord::TOUCHED), 0, "{id} at {physics_substep_secs} s");
            }
        }
        results.push(cars.iter().map(|car| *world.record(*car).unwrap()).collect());
    }
    results
}

#[test]
fn every_vehicle_is_stable_from_10_to_1000_hz() {
    let reference = drive_all(0.01);
    for substep_secs in [0.1, 0.05, 0.02, 0.005, 0.001] {
        let phases = drive_all(substep_secs);
        for (i, model) in vehicle_models().iter().enumerate() {
            let id = model.type_id;
            let [dropped, driven, _, braked] = [0, 1, 2, 3].map(|phase| phases[phase][i]);
            let fine = reference[1][i].speed_mps();
            assert!(dropped.speed_mps() < 0.02, "{id} at {substep_secs} s does not come to rest: {} m/s", dropped.speed_mps());
            assert!(braked.speed_mps() < 0.05, "{id} at {substep_secs} s does not stop: {} m/s", braked.speed_mps());
            // The length of the sub-step changes the way a car drives off only a little; ten per second are stable, not exact.
            let apart = (driven.speed_mps() / fine - 1.0).abs();
            let most = if substep_secs > 0.06 { 0.5 } else { 0.15 };
            assert!(apart < most, "{id} at {substep_secs} s reaches {} m/s, at 10 ms {fine} m/s", driven.speed_mps());
        }
    }
}
