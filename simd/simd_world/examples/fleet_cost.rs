//! Measures what vehicles cost: CPU time of `World::step` (50 ms, sub-steps of 10 ms) on one core,
//! for fleets of 50 to 1000 on town streets. All have physics and changing controls, or nine out of
//! ten are moved by `set_pose` as in a Traffic Manager's hybrid mode.
//!
//! `cargo run --release -p simd_world --example fleet_cost [-- --json FILE]`; results are in
//! `docs/benchmarks/vehicles.md`.

use std::process::ExitCode;

use launch_cli::bench::{self, BenchResult, NoArgs, anyhow, process_cpu_secs};
use schema_frames::command::Command;
use schema_frames::{PhysicsAction, VehicleControl};
use schema_types::{ActorId, Pose};
use simd_world::{EgoSpawn, MapData, World, WorldOptions};

const TICK_NANOS: u64 = 50_000_000;
const N_TICKS: u64 = 200;
/// Copies of the town beside each other, so that a thousand vehicles find a place.
const N_COPIES: usize = 4;

fn streets() -> anyhow::Result<MapData> {
    let town = MapData::from(&simd_town::Town::generate("Town10HD", 1)?);
    let mut map = MapData {
        name: "streets".to_owned(),
        origin_m: town.origin_m,
        ..MapData::default()
    };
    for copy in 0..N_COPIES {
        let shift_m = 2000.0 * copy as f32;
        for mesh in &town.collision {
            let mut mesh = mesh.clone();
            mesh.vertices_m
                .iter_mut()
                .for_each(|corner| corner[0] += shift_m);
            map.collision.push(mesh);
        }
        let moved = |point: &Pose| Pose {
            translation_m: [
                point.translation_m[0] + f64::from(shift_m),
                point.translation_m[1],
                point.translation_m[2],
            ],
            ..*point
        };
        map.spawn_points.extend(town.spawn_points.iter().map(moved));
    }
    Ok(map)
}

/// Drives to and fro on the spot, so that no vehicle meets another: a second forward, a second
/// back.
fn control(actor: ActorId, tick: u64) -> VehicleControl {
    let phase = (tick + u64::from(actor.0)) % 40;
    let braking = phase % 20 > 13;
    VehicleControl {
        throttle_ratio: if braking { 0.0 } else { 0.25 },
        brake_ratio: if braking { 0.6 } else { 0.0 },
        steer_ratio: if phase < 20 { 0.1 } else { -0.1 },
        reverse: phase >= 20,
        ..VehicleControl::default()
    }
}

fn measure(
    map: &MapData,
    n_vehicles: usize,
    n_simulated: usize,
) -> anyhow::Result<(usize, f64, f64)> {
    let mut world = World::new(WorldOptions::default());
    world.load(map)?;
    let scenario = world.spawn_scenario(
        Some(EgoSpawn {
            type_id: "vehicle.tesla.model3",
            spawn_idx: 0,
        }),
        n_vehicles - 1,
    )?;
    let cars: Vec<ActorId> = scenario
        .others
        .iter()
        .chain(&scenario.ego)
        .copied()
        .collect();
    let (driven, carried) = cars.split_at(n_simulated.min(cars.len()));
    for car in carried {
        world.apply(&Command::Physics {
            actor_id: car.0,
            action: PhysicsAction::SetSimulated { enabled: false },
        });
    }
    let (mut in_steps, mut in_all) = (0.0, 0.0);
    for tick in 0..2 * N_TICKS {
        let before = process_cpu_secs();
        for car in driven {
            world.set_control(*car, control(*car, tick))?;
        }
        for car in carried {
            let mut pose = world.record(*car).expect("it was spawned").world_from_actor;
            pose.translation_m[2] += 1e-4;
            world.set_pose(*car, pose)?;
        }
        let begin = process_cpu_secs();
        world.step(TICK_NANOS);
        // The first half lets everything come to rest and touches all memory.
        if tick >= N_TICKS {
            in_steps += process_cpu_secs() - begin;
            in_all += process_cpu_secs() - before;
        }
    }
    Ok((
        cars.len(),
        in_steps / N_TICKS as f64,
        in_all / N_TICKS as f64,
    ))
}

fn main() -> ExitCode {
    bench::run("fleet_cost", |_: &NoArgs, result| measure_all(result))
}

fn measure_all(result: &mut BenchResult) -> anyhow::Result<()> {
    // The measure is CPU time, and a single thread makes it that of one core.
    rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build_global()?;
    let map = streets()?;
    println!(
        "{} collision triangles",
        map.collision
            .iter()
            .map(|mesh| mesh.triangles.len())
            .sum::<usize>()
    );
    println!(
        "vehicles | with physics | ms per step | steps per second | us per vehicle and step | with commands, ms"
    );
    for (n_vehicles, n_simulated) in [
        (50, 50),
        (100, 100),
        (200, 200),
        (500, 500),
        (1000, 1000),
        (1000, 100),
    ] {
        let (n, step, all) = measure(&map, n_vehicles, n_simulated)?;
        println!(
            "{n} | {n_simulated} | {:.2} | {:.0} | {:.1} | {:.2}",
            step * 1e3,
            1.0 / step,
            step * 1e6 / n as f64,
            all * 1e3
        );
        let name = if n_simulated < n_vehicles {
            format!("{n_vehicles}, {n_simulated} with physics")
        } else {
            n_vehicles.to_string()
        };
        result.row(
            &name,
            &[
                ("vehicles", n as f64),
                ("simulated", n_simulated as f64),
                ("step_ms", step * 1e3),
                ("steps_per_sec", 1.0 / step),
                ("vehicle_us", step * 1e6 / n as f64),
                ("with_commands_ms", all * 1e3),
            ],
        );
    }
    Ok(())
}
