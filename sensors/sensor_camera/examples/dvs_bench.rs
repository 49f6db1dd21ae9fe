//! Time of the event camera alone: images are rendered first, then fed again and again.
//!
//! `cargo run --release -p sensor_camera --example dvs_bench -- [WIDTH HEIGHT ROUNDS THREADS]
//! [--json FILE]` prints, per case, CPU time per frame and events per second and core. The drive
//! moves 0.4 m a frame along the test street; `flicker` is an image that turns brighter and darker
//! everywhere, so that the time is that of making, sorting and writing events.

#[path = "../tests/it/common.rs"]
mod common;
#[path = "dvs_shots/mod.rs"]
mod shots;

use std::process::ExitCode;

use launch_cli::bench::{self, BenchResult, anyhow, clap, process_cpu_secs};
use sensor_camera::dvs::EventCamera;
use sensor_spec::{DvsMode, DvsSpec};
use shots::{Shot, drive};

const WINDOW_NANOS: u64 = 50_000_000;

/// Times the event camera alone
#[derive(Debug, clap::Args)]
struct Args {
    #[arg(default_value_t = 800)]
    width: u32,
    #[arg(default_value_t = 600)]
    height: u32,
    #[arg(default_value_t = 3)]
    rounds: u32,
    #[arg(default_value_t = 1)]
    threads: usize,
}

fn main() -> ExitCode {
    bench::run("dvs_bench", measure_all)
}

fn measure_all(args: &Args, result: &mut BenchResult) -> anyhow::Result<()> {
    let (size_px, rounds) = ([args.width, args.height], args.rounds);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(args.threads)
        .build()?;
    // Six firings, 0.4 m apart.
    let drive = drive(
        size_px,
        (0..6u64).map(|step| (step as f64 * 0.4, (step + 1) * WINDOW_NANOS)),
    );
    pool.install(|| {
        let base = DvsSpec {
            max_events: 20_000_000,
            ..Default::default()
        };
        let mut measure = |name: &str, shots: &[Shot], size_px, rounds, spec: &DvsSpec| {
            result.row(name, &measure(name, shots, size_px, rounds, spec));
        };
        measure("drive, steps of 1 px", &drive, size_px, rounds, &base);
        measure(
            "drive, steps of 4 px",
            &drive,
            size_px,
            rounds,
            &DvsSpec {
                substep_px: 4.0,
                ..base.clone()
            },
        );
        measure(
            "drive, two_frame",
            &drive,
            size_px,
            rounds,
            &DvsSpec {
                mode: DvsMode::TwoFrame,
                ..base.clone()
            },
        );
        let flicker = flicker(size_px);
        measure(
            "flicker, 1 event",
            &flicker,
            size_px,
            rounds,
            &DvsSpec {
                positive_threshold: 0.6,
                negative_threshold: 0.6,
                ..base.clone()
            },
        );
        measure(
            "flicker, 6 events",
            &flicker,
            size_px,
            rounds,
            &DvsSpec {
                positive_threshold: 0.1,
                negative_threshold: 0.1,
                ..base
            },
        );
    });
    Ok(())
}

fn measure(
    name: &str,
    shots: &[Shot],
    size_px: [u32; 2],
    rounds: u32,
    spec: &DvsSpec,
) -> [(&'static str, f64); 4] {
    let mut camera = EventCamera::new(spec.clone(), size_px, 1, 2);
    let mut out = vec![0; spec.max_events as usize * 16];
    let width = size_px[0] as usize;
    camera.advance(&shots[0].images(width), WINDOW_NANOS, &mut out);
    // There and back again, so that every frame follows a neighbour.
    let order: Vec<usize> = (1..shots.len()).collect();
    let (mut n_events, mut best, mut best_wall) = (0, f64::INFINITY, f64::INFINITY);
    for _ in 0..rounds {
        let (begin, wall) = (process_cpu_secs(), std::time::Instant::now());
        n_events = order
            .iter()
            .map(|i| {
                camera
                    .advance(&shots[*i].images(width), WINDOW_NANOS, &mut out)
                    .n_events
            })
            .sum();
        best = best.min(process_cpu_secs() - begin);
        best_wall = best_wall.min(wall.elapsed().as_secs_f64());
    }
    let n_frames = order.len() as f64;
    println!(
        "{name}: {:.2} ms wall, {:.1} ms CPU a frame, {} events a frame, {:.1} million events per second and core",
        best_wall * 1e3 / n_frames,
        best * 1e3 / n_frames,
        n_events as f64 / n_frames,
        n_events as f64 / best * 1e-6
    );
    [
        ("wall_ms", best_wall * 1e3 / n_frames),
        ("cpu_ms", best * 1e3 / n_frames),
        ("events", n_events as f64 / n_frames),
        ("mevents_per_sec", n_events as f64 / best * 1e-6),
    ]
}

/// Two grey images in turn, the second brighter by 0.65 in the logarithm.
fn flicker([width, height]: [u32; 2]) -> Vec<Shot> {
    let n = (width * height) as usize;
    let grey = |i: usize| 0.2 + 0.1 * ((i * 7919) % 1000) as f32 * 1e-3;
    let shot = |step: usize| Shot {
        luminance: (0..n)
            .flat_map(|i| (grey(i) * if step % 2 == 1 { 0.65f32.exp() } else { 1.0 }).to_le_bytes())
            .collect(),
        flow: vec![0; 8 * n],
        depth: (0..n).flat_map(|_| 10f32.to_le_bytes()).collect(),
        instance: vec![1; 4 * n],
        class: vec![1; n],
    };
    (0..5).map(shot).collect()
}
