//! Measures one view with six modalities against six views with one each, and the event camera, on
//! the test street.
//!
//! `cargo run --release --example measure_views -- [WIDTH HEIGHT FRAMES] [--json FILE]`; prints
//! wall time per frame as min / median, the process's CPU time per frame (the figure to trust on a
//! busy machine), and what was drawn.

#[path = "../tests/it/common.rs"]
mod common;

use std::process::ExitCode;
use std::time::Instant;

use launch_cli::bench::{self, BenchResult, Samples, clap, process_cpu_secs};
use schema_frames::Modality;
use sensor_camera::{CameraRenderer, Output, Place, Quality, View, ViewJob};
use sensor_gpu::Gpu;

const SIX: [Modality; 6] = [
    Modality::Rgb,
    Modality::Depth,
    Modality::Semantic,
    Modality::Instance,
    Modality::Flow,
    Modality::Normals,
];

/// Measures views of one modality and of six
#[derive(Debug, clap::Args)]
struct Args {
    #[arg(default_value_t = 800)]
    width: u32,
    #[arg(default_value_t = 600)]
    height: u32,
    #[arg(default_value_t = 40)]
    frames: u32,
}

fn main() -> ExitCode {
    bench::run("measure_views", |args: &Args, result| {
        measure_all(args, result);
        Ok(())
    })
}

fn measure_all(args: &Args, result: &mut BenchResult) {
    let gpu = common::gpu();
    println!(
        "{} at {}x{}, {} frames",
        gpu.name(),
        args.width,
        args.height,
        args.frames
    );
    result.set_gpu(gpu.name());
    let mut bench = Bench {
        gpu: &gpu,
        size_px: [args.width, args.height],
        n_frames: args.frames,
        quality: Quality::default_for(&gpu),
        result,
    };
    // The first measurement includes the wake-up of the device.
    bench.measure("depth alone", &[&[Modality::Depth]]);
    let together = bench.measure("one view, six modalities", &[&SIX]);
    let apart = bench.measure(
        "six views, one modality each",
        &SIX.each_ref().map(std::slice::from_ref),
    );
    println!(
        "six views cost {:.1} times the CPU time of one",
        apart / together
    );
    bench.measure("rgb alone", &[&[Modality::Rgb]]);
    bench.measure("events alone", &[&[Modality::Dvs]]);
    bench.measure("no reader", &[&[]]);
}

struct Bench<'g> {
    gpu: &'g Gpu,
    size_px: [u32; 2],
    n_frames: u32,
    quality: Quality,
    result: &'g mut BenchResult,
}

impl Bench<'_> {
    /// Renders a drive along the street; returns the CPU milliseconds per frame.
    fn measure(&mut self, name: &str, asked: &[&[Modality]]) -> f64 {
        let (assets, car) = common::street();
        let mut renderer = CameraRenderer::new(self.gpu, self.quality);
        let mut views: Vec<View> = asked
            .iter()
            .map(|_| common::view(self.gpu, self.size_px[0], self.size_px[1]))
            .collect();
        let mut memory: Vec<Vec<Vec<u8>>> = asked
            .iter()
            .map(|list| {
                list.iter()
                    .map(|m| vec![0; views[0].payload_bytes(*m)])
                    .collect()
            })
            .collect();
        let mut millis = Vec::new();
        let (mut counts, mut cpu_begin) = (self.gpu.counters().counts(), process_cpu_secs());
        for step in 0..self.n_frames + WARM_UP {
            if step == WARM_UP {
                (counts, cpu_begin) = (self.gpu.counters().counts(), process_cpu_secs());
            }
            let x_m = step as f64 * 0.4;
            let cars = (0..8)
                .map(|i| {
                    common::moving(
                        20 + i,
                        car,
                        common::pose(x_m * 1.1 + 9.0 * i as f64, -2.0, 0.0, [0.0; 3]),
                    )
                })
                .collect();
            let scene = common::scene(&assets, cars, (step as u64 + 1) * 50_000_000);
            let jobs =
                views
                    .iter_mut()
                    .zip(&mut memory)
                    .zip(asked)
                    .map(|((view, memory), list)| {
                        let outputs = list.iter().zip(memory).map(|(modality, bytes)| Output {
                            modality: *modality,
                            place: Place::Memory(bytes),
                        });
                        ViewJob {
                            view,
                            world_from_sensor: common::pose(x_m - 60.0, -2.0, 1.6, [0.0, 2.0, 0.0]),
                            outputs: outputs.collect(),
                        }
                    });
            let begin = Instant::now();
            let submission = renderer
                .render(&scene, jobs.collect())
                .expect("the request is in order");
            submission.wait().expect("the device works");
            millis.push(begin.elapsed().as_secs_f64() * 1e3);
        }
        let counts = self.gpu.counters().counts().since(counts);
        let cpu = (process_cpu_secs() - cpu_begin) * 1e3 / self.n_frames as f64;
        let millis: Samples = millis.into_iter().skip(WARM_UP as usize).collect();
        let (best, median) = (millis.best(), millis.median());
        let per_frame = |n: u64| n / self.n_frames as u64;
        println!(
            "{name}: {best:.2} / {median:.2} ms, CPU {cpu:.1} ms; {} passes, {} draws, {} triangles, {} copies",
            per_frame(counts.passes),
            per_frame(counts.draws),
            per_frame(counts.triangles),
            per_frame(counts.copies)
        );
        self.result.row(
            name,
            &[("min_ms", best), ("median_ms", median), ("cpu_ms", cpu)],
        );
        cpu
    }
}

/// Frames before counting: pipelines compile, the shadow map is drawn.
const WARM_UP: u32 = 3;
