//! Lidar on the GPU against a triangle mesh from a file: one scan from submission to points in
//! (imported) memory, and rays per second over a batch of lidars at different places.
//!
//! `cargo run --release -p sensor_ray --example gpu_bench -- MESH [TURNS] [ADAPTER]
//! [--json FILE]`; `mesh_file` has the format of MESH.

#![expect(
    unsafe_code,
    reason = "targets are raw memory; each block carries its proof"
)]

#[path = "mesh_file/mod.rs"]
mod mesh_file;

use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

use launch_cli::bench::{self, BenchResult, Samples, anyhow, clap};
use nalgebra::{Isometry3, Vector3};
use schema_types::noise::Noise;
use sensor_gpu::{Gpu, GpuOptions, Place, ShmTarget};
use sensor_ray::{GpuRayOptions, GpuRays, Lidar, RayScene, ScanJob, SensorPath};
use sensor_spec::LidarSpec;

/// Casts a lidar's rays on the GPU against a mesh from a file
#[derive(Debug, clap::Args)]
struct Args {
    /// The mesh
    mesh: String,
    #[arg(default_value_t = 20)]
    turns: usize,
    /// Part of the adapter's name
    adapter: Option<String>,
}

fn main() -> ExitCode {
    bench::run("gpu_bench", measure_all)
}

fn measure_all(args: &Args, result: &mut BenchResult) -> anyhow::Result<()> {
    let turns = args.turns.max(1);
    let gpu = Gpu::open(&GpuOptions {
        adapter: args.adapter.clone(),
        ..Default::default()
    })?;
    println!("adapter {}, can import: {}", gpu.name(), gpu.can_import());
    result.set_gpu(gpu.name());
    let assets = mesh_file::read(&args.mesh);
    let scene = RayScene::load_for_gpu(&assets);
    println!("{} triangles", scene.n_static_triangles());
    let (base, len) = segment(BATCH * SLOT_BYTES);
    // SAFETY: the memory is leaked, and only the scans write to it.
    let target = Arc::new(unsafe { ShmTarget::import(&gpu, base, len, ()) });
    let default = GpuRayOptions::default();
    let of_blocks = [4, 8, 16, 32].map(|block_columns| GpuRayOptions {
        block_columns,
        ..default
    });
    let of_groups = [1 << 18, 1 << 19, 1 << 21, 1 << 30].map(|group_rays| GpuRayOptions {
        group_rays,
        ..default
    });
    for options in of_blocks
        .into_iter()
        .chain(of_groups)
        .chain([GpuRayOptions {
            writes_directly: false,
            ..default
        }])
    {
        let mut rays = GpuRays::new(&gpu, options);
        rays.update(&scene)
            .unwrap_or_else(|error| panic!("{error}"));
        println!("{options:?}");
        for n_lidars in [1, 4, 16, BATCH] {
            let name = format!("{n_lidars}, {options:?}");
            result.row(&name, &measure(&mut rays, &target, n_lidars, turns, true));
        }
    }
    let mut rays = GpuRays::new(&gpu, default);
    rays.update(&scene)
        .unwrap_or_else(|error| panic!("{error}"));
    if gpu.set_timing(true) {
        for n_lidars in [1, BATCH] {
            gpu.take_spans();
            let _ = measure(&mut rays, &target, n_lidars, turns, true);
            for span in gpu.take_spans() {
                println!(
                    "    {} {}: {:.4} ms",
                    span.place,
                    span.label,
                    span.millis / (turns + 3) as f64
                );
            }
        }
        gpu.set_timing(false);
    }
    println!("few rays: what a submission costs");
    result.row("few rays", &measure(&mut rays, &target, 1, turns, false));
    compare(&mut rays, &scene);
    Ok(())
}

const BATCH: usize = 32;
const SLOT_BYTES: usize = 64 * 2048 * 16 + 4096;

fn spec(columns: u32) -> LidarSpec {
    LidarSpec {
        channels: 64,
        columns,
        upper_fov_deg: 2.0,
        lower_fov_deg: -24.8,
        range_m: 1e4,
        ..Default::default()
    }
}

/// The place of the comparison with other ray casters, then others along the street.
fn place(i: usize) -> SensorPath {
    let turn = Vector3::new(0.0, 0.0, 0.4 * i as f64);
    SensorPath::still(Isometry3::new(
        Vector3::new(3.0 * i as f64, -1.7, 1.9),
        turn,
    ))
}

fn measure(
    rays: &mut GpuRays,
    target: &Arc<ShmTarget>,
    n_lidars: usize,
    turns: usize,
    whole: bool,
) -> [(&'static str, f64); 5] {
    let spec = spec(if whole { 2048 } else { 16 });
    let mut lidars: Vec<Lidar> = (0..n_lidars).map(|_| Lidar::new(spec.clone())).collect();
    let (mut after_submit, mut with_recording) = (Vec::new(), Vec::new());
    let mut n_points = 0;
    for turn in 0..turns + 3 {
        // SAFETY: ranges of a leaked segment that do not overlap, and are looked at after the wait.
        let place_of = |i| unsafe { target.place(i * SLOT_BYTES, SLOT_BYTES) };
        let noise = Noise::new(1, 2, turn as u64);
        let begin = Instant::now();
        let job = |(i, lidar)| ScanJob {
            lidar,
            path: place(i),
            noise,
            ignored: None,
            place: place_of(i),
        };
        let scans = rays.scan(lidars.iter_mut().enumerate().map(job).collect());
        let submitted = Instant::now();
        let outcomes = scans.wait().unwrap_or_else(|error| panic!("{error}"));
        let end = Instant::now();
        n_points = outcomes.iter().map(|outcome| outcome.n_points).sum();
        if turn >= 3 {
            after_submit.push((end - submitted).as_secs_f64() * 1e3);
            with_recording.push((end - begin).as_secs_f64() * 1e3);
        }
    }
    let after_submit: Samples = after_submit.into_iter().collect();
    let with_recording: Samples = with_recording.into_iter().collect();
    let n_rays = n_lidars as f64 * (spec.channels * spec.columns) as f64;
    let (after, whole) = (after_submit.median(), with_recording.median());
    println!(
        "  {n_lidars:2} lidars: median {after:.3} ms after submission (best {:.3}), {whole:.3} ms with recording (best {:.3}), {:.0} Mray/s, {:.3} of rays return",
        after_submit.best(),
        with_recording.best(),
        n_rays / whole * 1e-3,
        n_points as f64 / n_rays
    );
    [
        ("ms", after),
        ("best_ms", after_submit.best()),
        ("recorded_ms", whole),
        ("recorded_best_ms", with_recording.best()),
        ("mrays_per_sec", n_rays / whole * 1e-3),
    ]
}

/// The points of the GPU against the CPU's.
fn compare(rays: &mut GpuRays, scene: &RayScene) {
    let (mut on_gpu, mut on_cpu) = (Lidar::new(spec(2048)), Lidar::new(spec(2048)));
    let mut bytes = vec![0u8; SLOT_BYTES];
    let noise = Noise::new(1, 2, 3);
    let job = ScanJob {
        lidar: &mut on_gpu,
        path: place(0),
        noise,
        ignored: None,
        place: Place::Memory(&mut bytes),
    };
    let outcome = rays
        .scan(vec![job])
        .wait()
        .unwrap_or_else(|error| panic!("{error}"));
    let n_points = on_cpu.scan(scene, &place(0), noise, None);
    let mut expected = vec![0u8; on_cpu.payload_bytes()];
    on_cpu.write(&mut expected);
    let points =
        |bytes: &[u8]| bytemuck::pod_collect_to_vec::<u8, schema_frames::LidarPoint>(bytes);
    let (ours, theirs) = (
        points(&bytes[..16 * outcome[0].n_points as usize]),
        points(&expected),
    );
    let gaps: Vec<f32> = ours
        .iter()
        .zip(&theirs)
        .map(|(a, b)| (Vector3::from(a.hit_in_sensor_m) - Vector3::from(b.hit_in_sensor_m)).norm())
        .collect();
    let n_far = gaps.iter().filter(|gap| **gap > 1e-3).count();
    println!(
        "{} points on the GPU, {n_points} on the CPU, {n_far} farther than 1 mm apart",
        outcome[0].n_points
    );
}

/// Page-aligned memory that lives as long as the process.
fn segment(n_bytes: usize) -> (*mut u8, usize) {
    let len = n_bytes.next_multiple_of(4096);
    let memory: &'static mut [u8] = vec![0u8; len + 4096].leak();
    let aligned = memory.as_ptr().align_offset(4096);
    (memory[aligned..aligned + len].as_mut_ptr(), len)
}
