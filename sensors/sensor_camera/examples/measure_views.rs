//! Measures one view with six modalities against six views with one each, and the event camera, on
//! the test street.
//!
//! `cargo run --release --example measure_views -- [WIDTH HEIGHT FRAMES] [--json FILE]`; prints
//! wall time per frame as min / median, the process's CPU time per frame (the figure to trust on a
//! busy machine), and what was drawn.

#[path = "../tests/common/mod.rs"]
mod common;

use std::cell::RefCell;
use std::time::Instant;

use launch_cli::bench::{BenchResult, take_json_argument};
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

fn main() {
    let (words, json) = take_json_argument(std::env::args().skip(1));
    let numbers: Vec<u32> = words
        .iter()
        .map(|text| text.parse().expect("arguments are whole numbers"))
        .collect();
    let (width_px, height_px, n_frames) = match numbers[..] {
        [width_px, height_px, n_frames] => (width_px, height_px, n_frames),
        _ => (800, 600, 40),
    };
    let gpu = common::gpu();
    println!(
        "{} at {width_px}x{height_px}, {n_frames} frames",
        gpu.name()
    );
    let bench = Bench {
        gpu: &gpu,
        size_px: [width_px, height_px],
        n_frames,
        quality: Quality::default_for(&gpu),
        result: RefCell::new(BenchResult::new("measure_views", Some(gpu.name()))),
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
    let result = bench.result.borrow();
    result
        .write(json.as_deref())
        .unwrap_or_else(|error| panic!("{error:#}"));
}

struct Bench<'g> {
    gpu: &'g Gpu,
    size_px: [u32; 2],
    n_frames: u32,
    quality: Quality,
    result: RefCell<BenchResult>,
}

impl Bench<'_> {
    /// Renders a drive along the street; returns the CPU milliseconds per frame.
    fn measure(&self, name: &str, asked: &[&[Modality]]) -> f64 {
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
        let (mut counts, mut cpu_begin) = (self.gpu.counters().counts(), cpu_millis());
        for step in 0..self.n_frames + WARM_UP {
            if step == WARM_UP {
                (counts, cpu_begin) = (self.gpu.counters().counts(), cpu_millis());
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
        let cpu = (cpu_millis() - cpu_begin) / self.n_frames as f64;
        let mut millis = millis.split_off(WARM_UP as usize);
        millis.sort_by(f64::total_cmp);
        let median = millis[millis.len() / 2];
        let per_frame = |n: u64| n / self.n_frames as u64;
        println!(
            "{name}: {:.2} / {median:.2} ms, CPU {cpu:.1} ms; {} passes, {} draws, {} triangles, {} copies",
            millis[0],
            per_frame(counts.passes),
            per_frame(counts.draws),
            per_frame(counts.triangles),
            per_frame(counts.copies)
        );
        self.result.borrow_mut().row(
            name,
            &[
                ("min_ms", millis[0]),
                ("median_ms", median),
                ("cpu_ms", cpu),
            ],
        );
        cpu
    }
}

/// CPU time of this process so far (Linux counts it in hundredths of a second).
fn cpu_millis() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").expect("Linux has /proc");
    let after_name = &stat[stat.rfind(')').expect("the name ends in a bracket")..];
    after_name
        .split(' ')
        .skip(12)
        .take(2)
        .map(|ticks| ticks.parse::<f64>().expect("ticks are a number") * 10.0)
        .sum()
}

/// Frames before counting: pipelines compile, the shadow map is drawn.
const WARM_UP: u32 = 3;
