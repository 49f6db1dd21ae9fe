//! Measures depth, classes, ids, flow and normals by tiles on the processor against the renderer on
//! the adapter, by turns, on the test street.
//!
//! `cargo run --release --example tiles_bench -- [WIDTH HEIGHT FRAMES TURNS] [--json FILE]`; prints
//! the process's CPU time per frame, the median of all turns and the least. Tiles draw everything
//! that the street has on one thread and write every modality; the renderer leaves out what is not
//! seen and copies what it drew.

#[path = "../tests/it/common.rs"]
mod common;
#[path = "../tests/it/lists.rs"]
mod lists;

use std::process::ExitCode;

use launch_cli::bench::{self, BenchResult, Samples, clap, process_cpu_secs};
use lists::Lists;
use nalgebra::Isometry3;
use schema_frames::Modality;
use sensor_camera::{CameraRenderer, Quality};
use sensor_core::Scene;

const EXACT: [Modality; 5] = [
    Modality::Depth,
    Modality::Semantic,
    Modality::Instance,
    Modality::Flow,
    Modality::Normals,
];

/// Measures tiles on the processor against the adapter
#[derive(Debug, clap::Args)]
struct Args {
    #[arg(default_value_t = 800)]
    width: u32,
    #[arg(default_value_t = 600)]
    height: u32,
    #[arg(default_value_t = 20)]
    frames: u32,
    #[arg(default_value_t = 7)]
    turns: usize,
}

fn main() -> ExitCode {
    bench::run("tiles_bench", |args: &Args, result| {
        measure(args, result);
        Ok(())
    })
}

/// Scenes and poses of a drive along the street.
fn drive(n_frames: u32) -> Vec<(Scene, Isometry3<f64>)> {
    let (assets, car) = common::street();
    let frame = |step: u32| {
        let x_m = step as f64 * 0.4;
        let cars = (0..8).map(|i| {
            let place = common::pose(x_m * 1.1 + 9.0 * i as f64, -2.0, 0.0, [0.0; 3]);
            common::moving(20 + i, car, place)
        });
        let scene = common::scene(&assets, cars.collect(), (step as u64 + 1) * 50_000_000);
        (scene, common::pose(x_m - 60.0, -2.0, 1.6, [0.0, 2.0, 0.0]))
    };
    (0..n_frames + 1).map(frame).collect()
}

fn measure(args: &Args, result: &mut BenchResult) {
    let gpu = common::gpu();
    result.set_gpu(gpu.name());
    let frames = drive(args.frames);
    let lens = common::view(&gpu, args.width, args.height).intrinsics();
    let lists: Vec<Lists> = frames
        .windows(2)
        .map(|two| Lists::of([&two[0].0, &two[1].0], &[two[0].1, two[1].1], &lens))
        .collect();
    let mut renderer = CameraRenderer::new(&gpu, Quality::Low);
    let mut millis: [Vec<f64>; 2] = Default::default();
    // The first turn compiles pipelines and does not count.
    for turn in 0..=args.turns {
        let begin = process_cpu_secs();
        let mut n_seen = 0;
        for lists in &lists {
            let images = lists.exact_images();
            n_seen += images
                .depth_m
                .iter()
                .filter(|depth| depth.is_finite())
                .count();
        }
        assert!(n_seen > 0, "tiles show nothing");
        let middle = process_cpu_secs();
        let mut view = common::view(&gpu, args.width, args.height);
        for (scene, pose) in &frames[1..] {
            common::render(&mut renderer, scene, &mut view, *pose, &EXACT);
        }
        let times = [middle - begin, process_cpu_secs() - middle];
        if turn > 0 {
            for (all, secs) in millis.iter_mut().zip(times) {
                all.push(secs * 1e3 / args.frames as f64);
            }
        }
    }
    let n_triangles: u32 = lists[0].draws.iter().map(|draw| draw.n_triangles).sum();
    println!("{n_triangles} triangles at {}x{}", args.width, args.height);
    for (name, all) in ["tiles", gpu.name()].into_iter().zip(millis) {
        let all: Samples = all.into_iter().collect();
        println!(
            "{name}: CPU {:.1} ms, at least {:.1}",
            all.median(),
            all.best()
        );
        result.row(
            name,
            &[("cpu_ms", all.median()), ("least_cpu_ms", all.best())],
        );
    }
}
