//! Runs repeat bit for bit: again, after a load, and on any number of threads.

use schema_frames::{ActorRecord, VehicleControl};
use schema_types::noise::Noise;
use simd_world::{EgoSpawn, MapData, World, WorldOptions};

const TICK_NANOS: u64 = 50_000_000;
const N_TICKS: u64 = 1000;

/// Hash (FNV-1a) of all records of all ticks of vehicles that drive at random, bump into each other
/// and are pushed. Ids go on counting over loads, so they are taken relative to the first one.
fn run(world: &mut World, n_vehicles: usize, n_ticks: u64) -> (u64, usize) {
    world.load(&MapData::flat(1000.0)).unwrap();
    let scenario = world
        .spawn_scenario(
            Some(EgoSpawn {
                type_id: "vehicle.tesla.model3",
                spawn_idx: 0,
            }),
            n_vehicles - 1,
        )
        .unwrap();
    let cars: Vec<_> = scenario
        .others
        .iter()
        .chain(&scenario.ego)
        .copied()
        .collect();
    assert_eq!(cars.len(), n_vehicles);
    let first = world.spectator().0;
    let (mut hash, mut n_touched) = (0xcbf2_9ce4_8422_2325u64, 0);
    for tick in 0..n_ticks {
        for actor in &cars {
            let noise = Noise::new(3, u64::from(actor.0 - first), tick / 20);
            let control = VehicleControl {
                throttle_ratio: noise.uniform(0) as f32,
                steer_ratio: (noise.uniform(1) * 2.0 - 1.0) as f32,
                brake_ratio: (noise.uniform(2) * 1.5 - 1.0) as f32,
                ..Default::default()
            };
            world.set_control(*actor, control).unwrap();
        }
        world.step(TICK_NANOS);
        for record in world.snapshot_records() {
            n_touched += usize::from(record.flags & ActorRecord::TOUCHED != 0);
            let record = ActorRecord {
                id: record.id - first,
                ..*record
            };
            for byte in bytemuck::bytes_of(&record) {
                hash = (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
            }
        }
    }
    (hash, n_touched)
}

fn fresh() -> World {
    World::new(WorldOptions {
        seed: 7,
        ..Default::default()
    })
}

#[test]
fn a_hundred_vehicles_repeat_bit_for_bit_after_a_load_and_on_any_number_of_threads() {
    let on_threads = |n_threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(n_threads)
            .build()
            .unwrap();
        pool.install(|| run(&mut fresh(), 100, N_TICKS))
    };
    let (hash, n_touched) = on_threads(1);
    assert!(n_touched > 0, "the run is meant to have crashes");
    assert_eq!(on_threads(2).0, hash, "two threads");
    assert_eq!(on_threads(5).0, hash, "five threads");
    let mut world = fresh();
    assert_eq!(run(&mut world, 100, N_TICKS).0, hash, "again");
    assert_eq!(run(&mut world, 100, N_TICKS).0, hash, "after a load");
    assert_ne!(run(&mut world, 99, N_TICKS).0, hash);
}
