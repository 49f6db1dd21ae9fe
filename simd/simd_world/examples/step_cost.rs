//! What one step of the world costs: p50 and p99 of `World::step` (50 ms, sub-steps of 10 ms) on a generated town.
//!
//! `cargo run --release -p simd_world --example step_cost`

use std::time::Instant;

use schema_frames::VehicleControl;
use schema_types::noise::Noise;
use simd_world::{MapData, World, WorldOptions};

const TICK_NANOS: u64 = 50_000_000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let town = simd_town::Town::generate("Town10HD", 1)?;
    let map = MapData::from(&town);
    println!(
        "{} collision triangles, {} spawn points",
        map.collision.iter().map(|mesh| mesh.triangles.len()).sum::<usize>(),
        map.spawn_points.len()
    );
    for n_vehicles in [20, 200] {
        let mut world = World::new(WorldOptions::default());
        let start = Instant::now();
        world.load(&map)?;
        let load = start.elapsed();
        let scenario = world.spawn_scenario("vehicle.tesla.model3", 0, n_vehicles - 1)?;
        let mut micros = Vec::new();
        for tick in 0..400u64 {
            for actor in scenario.others.iter().chain([&scenario.ego]) {
                let noise = Noise::new(1, actor.0 as u64, tick / 40);
                let throttle_ratio = (0.4 * noise.uniform(0)) as f32;
                let steer_ratio = (0.2 * noise.uniform(1) - 0.1) as f32;
                world.set_control(*actor, VehicleControl { throttle_ratio, steer_ratio, ..Default::default() })?;
            }
            let start = Instant::now();
            world.step(TICK_NANOS);
            micros.push(start.elapsed().as_secs_f64() * 1e6);
        }
        micros.sort_by(f64::total_cmp);
        let n_placed = scenario.others.len() + 1;
        println!("{n_placed} vehicles: step p50 {:.0} us, p99 {:.0} us; load {:.0} ms", micros[200], micros[396], load.as_secs_f64() * 1e3);
    }
    Ok(())
}
