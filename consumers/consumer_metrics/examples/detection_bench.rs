//! Time of scoring detections.
//!
//! `cargo run --release -p consumer_metrics --example detection_bench -- [IMAGES [FOLDER]]
//! [--json FILE]` scores random boxes in images, masks of 1280 × 720 pixels and boxes in space, and
//! prints the time to add an image and to compute the scores of all. With a FOLDER it writes the
//! boxes there as COCO's `truths.json` and `results.json`, for `benches/detection_peer.py`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use consumer_metrics::average_precision::{self as ap, BoxPx, Pairs, RunMask};
use consumer_metrics::coco_json::{CocoResult, CocoTruth};
use consumer_metrics::detection3d::{self as space, Box3};
use fastrand::Rng;
use launch_cli::bench::{self, anyhow, clap};
use serde_json::json;

const N_CLASSES: u32 = 4;
const N_TRUTHS: usize = 12;
const N_FOUND: usize = 20;
/// Images of masks; more are the same ones again, because painting them takes longer than scoring.
const N_PAINTED: usize = 50;

/// Times the scores of detections
#[derive(Debug, clap::Args)]
struct Args {
    /// Images
    #[arg(default_value_t = 5000)]
    images: usize,
    /// Folder for the boxes as COCO's files
    folder: Option<PathBuf>,
}

fn main() -> ExitCode {
    bench::run("detection_bench", measure)
}

fn measure(args: &Args, result: &mut bench::BenchResult) -> anyhow::Result<()> {
    let n_images = args.images;
    let mut rng = Rng::with_seed(1);

    let boxes: Vec<_> = (0..n_images).map(|_| boxes(&mut rng)).collect();
    if let Some(folder) = &args.folder {
        write_coco(folder, &boxes);
    }
    let mut report = |name: &str, add_secs: f64, scores_secs: f64, value: Option<f64>| {
        let add_us = add_secs * 1e6 / n_images as f64;
        let (scores_ms, value) = (scores_secs * 1e3, value.unwrap_or(0.0));
        println!("{name}: {add_us:.2} µs an image, scores {scores_ms:.1} ms, value {value:.6}");
        let figures = [
            ("n_images", n_images as f64),
            ("add_us", add_us),
            ("scores_ms", scores_ms),
            ("value", value),
        ];
        result.row(name, &figures);
    };
    let mut collector = ap::Collector::new();
    let add = timed(|| {
        for (truths, found) in &boxes {
            collector.add(truths, found);
        }
    });
    let mut value = None;
    let scores = timed(|| value = collector.scores().all.ap);
    report("boxes in images", add, scores, value);

    let pairs: Vec<Pairs> = boxes.iter().map(|(t, f)| Pairs::new(t, f)).collect();
    let mut collector = ap::Collector::new();
    let add = timed(|| {
        for pairs in &pairs {
            collector.add_part(pairs, |index| index % 4 != 0, |_| false);
        }
    });
    let scores = timed(|| value = collector.scores().all.ap);
    report("a part of them, overlaps known", add, scores, value);

    let masks: Vec<_> = (0..N_PAINTED).map(|_| masks(&mut rng)).collect();
    let mut collector = ap::Collector::new();
    let add = timed(|| {
        for (truths, found) in masks.iter().cycle().take(n_images) {
            collector.add(truths, found);
        }
    });
    let scores = timed(|| value = collector.scores().all.ap);
    report("masks", add, scores, value);

    let frames: Vec<_> = (0..n_images).map(|_| in_space(&mut rng)).collect();
    let mut collector = space::Collector::new(space::Settings::default());
    let add = timed(|| {
        for (truths, found) in &frames {
            collector.add(truths, found);
        }
    });
    let scores = timed(|| value = collector.scores().nds);
    report("boxes in space", add, scores, value);
    Ok(())
}

fn timed(work: impl FnOnce()) -> f64 {
    let begin = Instant::now();
    work();
    begin.elapsed().as_secs_f64()
}

type Image<R> = (Vec<ap::Truth<R>>, Vec<ap::Detection<R>>);

fn boxes(rng: &mut Rng) -> Image<BoxPx> {
    let truths: Vec<_> = (0..N_TRUTHS)
        .map(|_| {
            let [x, y] = [rng.f64() * 1200.0, rng.f64() * 650.0];
            let size = 8.0 + 150.0 * rng.f64() * rng.f64();
            let region = BoxPx::new([x, y], [x + size, y + size * 0.8]);
            ap::Truth::new(rng.u32(0..N_CLASSES), region)
        })
        .collect();
    let found = (0..N_FOUND)
        .map(|i| {
            let truth = &truths[i % N_TRUTHS];
            let size = truth.region.xywh()[2];
            let mut off = || (rng.f64() - 0.5) * 0.2 * size;
            let region = BoxPx {
                min_px: truth.region.min_px.map(|at| at + off()),
                max_px: truth.region.max_px.map(|at| at + off()),
            };
            ap::Detection::new(truth.class, rng.f64(), region)
        })
        .collect();
    (truths, found)
}

fn masks(rng: &mut Rng) -> Image<RunMask> {
    let (truths, found) = boxes(rng);
    let painted = |region: &BoxPx| {
        let ([x0, y0], [x1, y1]) = (region.min_px, region.max_px);
        let [a, b] = [(x1 - x0) / 2.0, (y1 - y0) / 2.0];
        let mask = RunMask::from_pixels(1280, 720, |x, y| {
            let [dx, dy] = [(f64::from(x) - x0) / a - 1.0, (f64::from(y) - y0) / b - 1.0];
            dx * dx + dy * dy < 1.0
        });
        mask.expect("the image is small")
    };
    let truths = truths.iter();
    let found = found.iter();
    (
        truths
            .map(|truth| ap::Truth::new(truth.class, painted(&truth.region)))
            .collect(),
        found
            .map(|one| ap::Detection::new(one.class, one.score, painted(&one.region)))
            .collect(),
    )
}

fn in_space(rng: &mut Rng) -> (Vec<space::Truth>, Vec<space::Detection>) {
    let truths: Vec<_> = (0..N_TRUTHS)
        .map(|_| {
            let shape = Box3 {
                centre_m: [rng.f64() * 80.0, rng.f64() * 80.0, 0.0],
                size_m: [4.0, 2.0, 1.5],
                yaw_rad: rng.f64() * 6.0,
            };
            let mut truth = space::Truth::new(rng.u32(0..N_CLASSES), shape);
            truth.velocity_mps = Some([rng.f64() * 10.0, 0.0]);
            truth
        })
        .collect();
    let found = (0..N_FOUND)
        .map(|i| {
            let truth = &truths[i % N_TRUTHS];
            let mut shape = truth.shape;
            shape.centre_m = shape.centre_m.map(|at| at + rng.f64() * 2.0);
            let mut found = space::Detection::new(truth.class, rng.f64(), shape);
            found.velocity_mps = Some([rng.f64() * 10.0, 0.0]);
            found
        })
        .collect();
    (truths, found)
}

fn write_coco(folder: &Path, images: &[Image<BoxPx>]) {
    let (mut truths, mut results) = (Vec::new(), Vec::new());
    for (image_id, (of_image, found)) in (1..).zip(images) {
        for truth in of_image {
            truths.push(CocoTruth::of_box(truths.len() as u64 + 1, image_id, truth));
        }
        results.extend(found.iter().map(|one| CocoResult::of_box(image_id, one)));
    }
    let images: Vec<_> = (1..=images.len()).map(|id| json!({ "id": id })).collect();
    let categories: Vec<_> = (0..N_CLASSES).map(|id| json!({ "id": id })).collect();
    let truths = json!({
        "info": {}, "images": images, "categories": categories, "annotations": truths,
    });
    std::fs::write(folder.join("truths.json"), truths.to_string()).expect("FOLDER can be written");
    let results = json!(results).to_string();
    std::fs::write(folder.join("results.json"), results).expect("FOLDER can be written");
}
