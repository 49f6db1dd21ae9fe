//! Rays per second against a triangle mesh from a file, for comparison with other ray casters on
//! the same mesh, rays and threads.
//!
//! `cargo run --release -p sensor_ray --example mesh_bench -- MESH [THREADS] [TURNS]`. `mesh_file`
//! has the format of MESH. The lidar stands at (0, −1.7, 1.9) with 64 beams from 2° to −24.8° and
//! 2048 azimuths; what is timed ends with the points in a frame's bytes, distances made exact in
//! `f64`. CPU time does not count what neighbours take.

#[path = "mesh_file/mod.rs"]
mod mesh_file;

use std::time::Instant;

use launch_cli::bench::{BenchResult, take_json_argument};
use nalgebra::Isometry3;
use schema_types::noise::Noise;
use sensor_ray::{Lidar, RayScene, SensorPath};
use sensor_spec::LidarSpec;

fn main() {
    let (words, json) = take_json_argument(std::env::args().skip(1));
    let mut result = BenchResult::new("mesh_bench", None);
    let mut args = words.into_iter();
    let path = args.next().expect("the first argument is the mesh file");
    let threads = args
        .next()
        .map_or(1, |text| text.parse().expect("threads are a whole number"));
    let turns = args
        .next()
        .map_or(12, |text| text.parse().expect("turns are a whole number"));
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("threads can be started");
    pool.install(|| run(&path, threads, turns, &mut result));
    result
        .write(json.as_deref())
        .unwrap_or_else(|error| panic!("{error:#}"));
}

fn run(path: &str, threads: usize, turns: usize, result: &mut BenchResult) {
    let assets = mesh_file::read(path);
    let begin = Instant::now();
    let scene = RayScene::load(&assets);
    println!(
        "{} triangles, built in {:.0} ms",
        scene.n_static_triangles(),
        begin.elapsed().as_secs_f64() * 1e3
    );
    let spec = LidarSpec {
        channels: 64,
        columns: 2048,
        upper_fov_deg: 2.0,
        lower_fov_deg: -24.8,
        range_m: 1e4,
        ..Default::default()
    };
    let n_rays = spec.channels * spec.columns;
    let mut lidar = Lidar::new(spec);
    let mut bytes = vec![0; n_rays as usize * 16];
    let pose = SensorPath::still(Isometry3::translation(0.0, -1.7, 1.9));
    let mut millis = Vec::new();
    let (mut n_points, mut cpu_best) = (0, f64::INFINITY);
    for _ in 0..turns {
        let (begin, cpu) = (Instant::now(), cpu_millis());
        n_points = lidar.scan(&scene, &pose, Noise::new(1, 2, 3), None);
        lidar.write(&mut bytes);
        millis.push(begin.elapsed().as_secs_f64() * 1e3);
        cpu_best = cpu_best.min(cpu_millis() - cpu);
    }
    millis.sort_by(f64::total_cmp);
    let rate = |millis: f64| n_rays as f64 / millis * 1e-3;
    let (best, median) = (millis[0], millis[millis.len() / 2]);
    println!(
        "threads {threads}: median {median:.2} ms, best {best:.2} ms, {:.2} Mray/s (best {:.2}); CPU best {cpu_best:.1} ms, {:.2} Mray/s; hits {:.3}",
        rate(median),
        rate(best),
        rate(cpu_best),
        n_points as f64 / n_rays as f64
    );
    result.row(
        "Gantry",
        &[
            ("n_threads", threads as f64),
            ("median_ms", median),
            ("best_ms", best),
            ("cpu_ms", cpu_best),
        ],
    );
}

/// CPU time of this process: it does not count what neighbours take.
fn cpu_millis() -> f64 {
    let usage = nix::sys::resource::getrusage(nix::sys::resource::UsageWho::RUSAGE_SELF)
        .expect("a process may ask for its own usage");
    let millis = |t: nix::sys::time::TimeVal| t.tv_sec() as f64 * 1e3 + t.tv_usec() as f64 * 1e-3;
    millis(usage.user_time()) + millis(usage.system_time())
}
