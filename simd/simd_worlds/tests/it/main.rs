//! Tests of `simd_worlds`: one program for all of them, so that it is linked once.

mod alone;
mod refusals;
mod rules;

use std::sync::{Arc, LazyLock};

use schema_types::noise::Noise;
use simd_worlds::{Autoreset, Course, Task, Worlds};

/// A built-in task, prepared once for all tests.
fn course(name: &str) -> Arc<Course> {
    static LANES: LazyLock<Arc<Course>> = LazyLock::new(|| prepare("LaneKeeping"));
    static BRAKES: LazyLock<Arc<Course>> = LazyLock::new(|| prepare("EmergencyBrake"));
    match name {
        "LaneKeeping" => LANES.clone(),
        _ => BRAKES.clone(),
    }
}

fn prepare(name: &str) -> Arc<Course> {
    Arc::new(Course::new(Task::built_in(name).unwrap(), 1).unwrap())
}

fn worlds(name: &str, n: usize, n_threads: usize, autoreset: Autoreset) -> Worlds {
    Worlds::new(course(name), n, n_threads, autoreset).unwrap()
}

/// Actions of a world at a step, by lot but mostly straight ahead.
fn action(world: u64, step: u64) -> [f32; 2] {
    let lot = Noise::new(9, world, step);
    [
        (0.1 * (lot.uniform(0) - 0.5)) as f32,
        (1.4 * lot.uniform(1) - 0.6) as f32,
    ]
}
