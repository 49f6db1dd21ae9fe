//! Time of scoring pixels, tracks, trajectories, lanes and drives.
//!
//! `cargo run --release -p consumer_metrics --example metrics_bench -- [FRAMES] [--json FILE]`
//! scores random frames of 640 × 480 pixels, of 20 tracks, of 6 lines, of one pose, and of a vehicle
//! among 20 others, and prints the time to add a frame and to compute the scores of all.

use std::process::ExitCode;
use std::time::Instant;

use consumer_metrics::sizes::SizesDiffer;
use consumer_metrics::{
    classes, depth, driving, event_flow, flow, lanes, odometry, stereo, tracking,
};
use fastrand::Rng;
use launch_cli::bench::{self, BenchResult, clap};
use nalgebra::{Isometry3, Vector3};

const N_PIXELS: usize = 640 * 480;
/// Frames that differ; more are the same ones again, because making them takes longer than scoring.
const N_MADE: usize = 8;

/// Times the scores of pixels, tracks, trajectories, lanes and drives
#[derive(Debug, clap::Args)]
struct Args {
    /// Frames
    #[arg(default_value_t = 200)]
    frames: usize,
}

fn main() -> ExitCode {
    bench::run("metrics_bench", |args: &Args, result| {
        let mut bench = Bench {
            n_frames: args.frames,
            result,
        };
        let mut rng = Rng::with_seed(1);
        pixels(&mut bench, &mut rng);
        things(&mut bench, &mut rng);
        motions(&mut bench, &mut rng);
        Ok(())
    })
}

struct Bench<'a> {
    n_frames: usize,
    result: &'a mut BenchResult,
}

impl Bench<'_> {
    /// Adds all frames, computes the scores, and says how long each took.
    fn row<C>(
        &mut self,
        name: &str,
        mut collector: C,
        mut add: impl FnMut(&mut C, usize),
        scores: impl Fn(&C) -> Option<f64>,
    ) {
        let began = Instant::now();
        for at in 0..self.n_frames {
            add(&mut collector, at);
        }
        let add_us = began.elapsed().as_secs_f64() * 1e6 / self.n_frames as f64;
        let began = Instant::now();
        let value = scores(&collector).unwrap_or(f64::NAN);
        let scores_ms = began.elapsed().as_secs_f64() * 1e3;
        println!("{name}: {add_us:.2} µs a frame, scores {scores_ms:.2} ms, value {value:.6}");
        let figures = [
            ("n_frames", self.n_frames as f64),
            ("add_us", add_us),
            ("scores_ms", scores_ms),
            ("value", value),
        ];
        self.result.row(name, &figures);
    }
}

fn pixels(bench: &mut Bench, rng: &mut Rng) {
    let mut numbers = |least: f32, most: f32| -> Vec<Vec<f32>> {
        let number = |rng: &mut Rng| least + (most - least) * rng.f32();
        (0..N_MADE)
            .map(|_| (0..2 * N_PIXELS).map(|_| number(rng)).collect())
            .collect()
    };
    let (truths, results) = (numbers(1.0, 70.0), numbers(1.0, 70.0));
    let labels: Vec<Vec<u8>> = truths
        .iter()
        .map(|frame| frame.iter().map(|it| (it / 4.0) as u8).collect())
        .collect();
    let mask: Vec<bool> = (0..N_PIXELS).map(|at| !at.is_multiple_of(5)).collect();
    let ones = |frames: &[Vec<f32>]| -> Vec<Vec<f32>> {
        frames.iter().map(|it| it[..N_PIXELS].to_vec()).collect()
    };
    let twos = |frames: &[Vec<f32>]| -> Vec<Vec<[f32; 2]>> {
        frames.iter().map(|it| it.as_chunks().0.to_vec()).collect()
    };
    let (truth1, result1) = (ones(&truths), ones(&results));
    let (truth2, result2) = (twos(&truths), twos(&results));
    let expect = |added: Result<(), SizesDiffer>| added.expect("sizes fit");
    bench.row(
        "classes",
        classes::Collector::new(classes::Settings::default()),
        |all, at| {
            let (truth, result) = (&labels[at % N_MADE], &labels[(at + 1) % N_MADE]);
            expect(all.add(&truth[..N_PIXELS], &result[..N_PIXELS], Some(&mask)));
        },
        |all| all.scores().miou,
    );
    bench.row(
        "depth",
        depth::Collector::new(depth::Settings::default()),
        |all, at| expect(all.add(&truth1[at % N_MADE], &result1[at % N_MADE], Some(&mask))),
        |all| all.scores().abs_rel,
    );
    bench.row(
        "stereo",
        stereo::Collector::new(),
        |all, at| expect(all.add(&truth1[at % N_MADE], &result1[at % N_MADE], Some(&mask))),
        |all| all.scores().d1,
    );
    bench.row(
        "flow",
        flow::Collector::new(),
        |all, at| {
            let masks = flow::Masks {
                scored: Some(&mask),
                moving: Some(&mask),
                occluded: Some(&mask),
            };
            expect(all.add(&truth2[at % N_MADE], &result2[at % N_MADE], masks));
        },
        |all| all.scores().all.fl,
    );
    bench.row(
        "event flow",
        event_flow::Collector::new(),
        |all, at| expect(all.add(&truth2[at % N_MADE], &result2[at % N_MADE], Some(&mask))),
        |all| all.scores().ae_deg,
    );
}

fn things(bench: &mut Bench, rng: &mut Rng) {
    let ids: Vec<u64> = (0..20).collect();
    let boxes: Vec<[f64; 4]> = ids
        .iter()
        .map(|_| {
            let [x, y] = [0; 2].map(|_| 300.0 * rng.f64());
            [x, y, x + 60.0, y + 60.0]
        })
        .collect();
    let shaken: Vec<[f64; 4]> = boxes
        .iter()
        .map(|it| it.map(|edge| edge + 10.0 * rng.f64()))
        .collect();
    bench.row(
        "tracking",
        tracking::Collector::new(tracking::Settings::default()),
        |all, _| {
            let frame = tracking::Frame {
                truths: &ids,
                ignored: &[],
                results: &ids,
                similarity: &tracking::iou_similarity(&boxes, &shaken),
            };
            all.add(frame).expect("sizes fit");
        },
        |all| all.scores().hota,
    );
    let lines: Vec<lanes::Line> = (0..6)
        .map(|number| {
            let left = 3.5 * f64::from(number);
            (0..110).map(|x| [f64::from(x), left, 0.0]).collect()
        })
        .collect();
    bench.row(
        "lanes",
        lanes::Collector::new(lanes::Settings::default()),
        |all, _| all.add(&lines, &[], &lines).expect("sizes fit"),
        |all| all.scores().at[0].f1,
    );
}

fn motions(bench: &mut Bench, rng: &mut Rng) {
    bench.row(
        "odometry",
        odometry::Collector::new(odometry::Settings::default()),
        |all, at| {
            let at = at as f64;
            let pose = Isometry3::new(Vector3::new(at, (at / 30.0).sin(), 0.0), Vector3::zeros());
            all.add(&pose, Some(&pose));
        },
        |all| all.scores().ate_rmse_m,
    );
    let body = |x: f64, y: f64, speed: f64| driving::Body {
        centre_m: [x, y],
        heading_rad: 0.0,
        velocity_mps: [speed, 0.0],
        half_m: [2.0, 1.0],
    };
    let others: Vec<_> = (0..20)
        .map(|number| body(20.0 * f64::from(number), 100.0 * rng.f64(), 5.0))
        .collect();
    bench.row(
        "driving",
        driving::Drive::new(0.001, 1000.0),
        |drive, at| drive.add(&body(0.01 * at as f64, 0.0, 10.0), 0.0, &others),
        |drive| {
            let mut all = driving::Collector::new(driving::Settings::default());
            all.add(drive);
            all.scores().jerk_longitudinal.p50
        },
    );
}
