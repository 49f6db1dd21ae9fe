//! Measures what going back costs: CPU time of `World::restore`, of a step of 50 ms after it, and
//! of `World::checkpoint`, on one core, in Town10HD with all its lights and signs.
//!
//! `lite` is an ego with physics, eight cars without (they are moved by `set_pose`, as replayed
//! ones are) and four people on foot; `full` is an ego with twenty cars, all with physics, and
//! twenty people.
//!
//! `cargo run --release -p simd_world --example restore_cost [-- --json FILE]`; results are in
//! `docs/benchmarks/worlds.md`.

use std::process::ExitCode;

use launch_cli::bench::{self, BenchResult, NoArgs, anyhow, process_cpu_secs};
use schema_frames::{Command, PhysicsAction, VehicleControl};
use schema_types::{ActorId, Pose};
use simd_world::{EgoSpawn, MapData, World, WorldOptions};

const TICK_NANOS: u64 = 50_000_000;
/// Ticks before the checkpoint: everything has come to rest by then.
const N_BEFORE: u64 = 100;
const N_ROUNDS: u32 = 2000;

/// A world with its ego and the cars that are moved by `set_pose`.
struct Populated {
    world: World,
    ego: ActorId,
    moved: Vec<ActorId>,
}

impl Populated {
    fn new(
        map: &MapData,
        n_cars: usize,
        n_people: usize,
        with_physics: bool,
    ) -> anyhow::Result<Self> {
        let mut world = World::new(WorldOptions::default());
        world.load(map)?;
        let scenario = world.spawn_scenario(
            Some(EgoSpawn {
                type_id: "vehicle.tesla.model3",
                spawn_idx: 0,
            }),
            n_cars,
        )?;
        world.spawn_walkers(n_people);
        let mut moved = Vec::new();
        if !with_physics {
            for car in &scenario.others {
                world.apply(&Command::Physics {
                    actor_id: car.0,
                    action: PhysicsAction::SetSimulated { enabled: false },
                });
            }
            moved = scenario.others;
        }
        let ego = scenario.ego.expect("one was asked for");
        let mut populated = Populated { world, ego, moved };
        for _ in 0..N_BEFORE {
            populated.step()?;
        }
        Ok(populated)
    }

    fn step(&mut self) -> anyhow::Result<()> {
        let control = VehicleControl {
            throttle_ratio: 0.3,
            ..VehicleControl::default()
        };
        self.world.set_control(self.ego, control)?;
        for car in &self.moved {
            let mut pose: Pose = self
                .world
                .record(*car)
                .expect("it was spawned")
                .world_from_actor;
            pose.translation_m[2] += 1e-4;
            self.world.set_pose(*car, pose)?;
        }
        self.world.step(TICK_NANOS);
        Ok(())
    }
}

fn main() -> ExitCode {
    bench::run("restore_cost", |_: &NoArgs, result| measure_all(result))
}

fn measure_all(result: &mut BenchResult) -> anyhow::Result<()> {
    // The measure is CPU time, and a single thread makes it that of one core.
    rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build_global()?;
    let map = MapData::from(&simd_town::Town::generate("Town10HD", 1)?);
    println!("world | actors | step, us | checkpoint, us | restore, us | restore and step, us");
    for (name, n_cars, n_people, with_physics) in [("lite", 8, 4, false), ("full", 20, 20, true)] {
        let mut populated = Populated::new(&map, n_cars, n_people, with_physics)?;
        let saved = populated.world.checkpoint(0);
        let n_actors = populated.world.snapshot_records().len();
        let us = |secs: f64| secs * 1e6 / f64::from(N_ROUNDS);

        let begin = process_cpu_secs();
        for _ in 0..N_ROUNDS {
            populated.step()?;
        }
        let step_us = us(process_cpu_secs() - begin);
        let begin = process_cpu_secs();
        for _ in 0..N_ROUNDS {
            std::hint::black_box(populated.world.checkpoint(0));
        }
        let checkpoint_us = us(process_cpu_secs() - begin);
        let begin = process_cpu_secs();
        for _ in 0..N_ROUNDS {
            populated.world.restore(&saved)?;
        }
        let restore_us = us(process_cpu_secs() - begin);
        let begin = process_cpu_secs();
        for _ in 0..N_ROUNDS {
            populated.world.restore(&saved)?;
            populated.step()?;
        }
        let both_us = us(process_cpu_secs() - begin);
        println!(
            "{name} | {n_actors} | {step_us:.1} | {checkpoint_us:.1} | {restore_us:.1} | {both_us:.1}"
        );
        result.row(
            name,
            &[
                ("actors", n_actors as f64),
                ("step_us", step_us),
                ("checkpoint_us", checkpoint_us),
                ("restore_us", restore_us),
                ("restore_step_us", both_us),
            ],
        );
    }
    Ok(())
}
