//! Rays per second against a triangle mesh from a file, for comparison with other ray casters on
//! the same mesh, rays and threads.
//!
//! `cargo run --release -p sensor_ray --example mesh_bench -- MESH [THREADS] [TURNS]
//! [--json FILE]`. `mesh_file`
//! has the format of MESH. The lidar stands at (0, −1.7, 1.9) with 64 beams from 2° to −24.8° and
//! 2048 azimuths; what is timed ends with the points in a frame's bytes, distances made exact in
//! `f64`. CPU time does not count what neighbours take.

#[path = "mesh_file/mod.rs"]
mod mesh_file;

use std::process::ExitCode;
use std::time::Instant;

use launch_cli::bench::{self, BenchResult, Samples, clap, process_cpu_secs};
use nalgebra::Isometry3;
use schema_types::noise::Noise;
use sensor_ray::{Lidar, RayScene, SensorPath};
use sensor_spec::LidarSpec;

/// Casts rays against a mesh from a file
#[derive(Debug, clap::Args)]
struct Args {
    /// The mesh
    mesh: String,
    #[arg(default_value_t = 1)]
    threads: usize,
    #[arg(default_value_t = 12)]
    turns: usize,
}

fn main() -> ExitCode {
    bench::run("mesh_bench", |args: &Args, result| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(args.threads)
            .build()?;
        pool.install(|| run(args, result));
        Ok(())
    })
}

fn run(args: &Args, result: &mut BenchResult) {
    let threads = args.threads;
    let assets = mesh_file::read(&args.mesh);
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
    let (mut n_points, mut cpu_best) = (0, f64::INFINITY);
    let millis = Samples::of(args.turns, || {
        let (begin, cpu) = (Instant::now(), process_cpu_secs());
        n_points = lidar.scan(&scene, &pose, Noise::new(1, 2, 3), None);
        lidar.write(&mut bytes);
        let wall = begin.elapsed();
        cpu_best = cpu_best.min((process_cpu_secs() - cpu) * 1e3);
        wall.as_secs_f64() * 1e3
    });
    let rate = |millis: f64| n_rays as f64 / millis * 1e-3;
    let (best, median) = (millis.best(), millis.median());
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
