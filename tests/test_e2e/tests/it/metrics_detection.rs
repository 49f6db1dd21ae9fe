//! Average precision of `consumer_metrics` against pycocotools, to 1e-6: boxes and masks of random
//! images with everything that its rules are about: equal scores, crowds, what is ignored, images
//! without anything, floods.

use consumer_metrics::average_precision::{self as ap, ANY_CLASS, BoxPx, Pairs, Region, RunMask};
use consumer_metrics::coco_json::{CocoResult, CocoTruth};
use consumer_truth::masks::runs_text;
use fastrand::Rng;
use serde_json::{Value, json};
use test_e2e::judged::judge;

/// One of a few scores, so that many are equal, or any.
fn score(rng: &mut Rng, tied: bool) -> f64 {
    if tied {
        f64::from(rng.u32(1..6)) / 8.0
    } else {
        f64::from(rng.f32())
    }
}

/// What differs between one case and another in images.
struct Images {
    n: usize,
    n_classes: u32,
    n_truths: usize,
    n_found: usize,
    tied: bool,
    with_parts: bool,
}

impl Images {
    fn any(rng: &mut Rng, mask: bool) -> Images {
        let flood = !mask && rng.u8(0..8) == 0;
        Images {
            n: if flood { 2 } else { rng.usize(1..20) },
            n_classes: rng.u32(1..6),
            n_truths: rng.usize(1..12),
            n_found: if flood { 400 } else { rng.usize(1..16) },
            tied: rng.bool(),
            with_parts: rng.bool(),
        }
    }
}

type Image<R> = (Vec<ap::Truth<R>>, Vec<ap::Detection<R>>);

/// Truths and detections of an image, most detections near truths of their class.
fn image<R: Region + Clone>(
    rng: &mut Rng,
    images: &Images,
    place: &mut dyn FnMut(&mut Rng) -> R,
    near: &mut dyn FnMut(&mut Rng, &R) -> R,
) -> Image<R> {
    let n_truths = rng.usize(0..=images.n_truths);
    let mut truths: Vec<ap::Truth<R>> = Vec::new();
    for _ in 0..n_truths {
        let class = rng.u32(0..images.n_classes);
        let region = place(rng);
        truths.push(match rng.u8(0..12) {
            0 => ap::Truth::crowd(class, region),
            1 => ap::Truth::ignored(class, region),
            2 => ap::Truth::crowd(ANY_CLASS, region),
            _ => ap::Truth::new(class, region),
        });
        let last = truths.last_mut().unwrap();
        if rng.u8(0..6) == 0 {
            last.area_px *= rng.f64() * 2.0;
        }
    }
    let mut found = Vec::new();
    for _ in 0..rng.usize(0..=images.n_found) {
        let (mut class, mut region) = (rng.u32(0..images.n_classes), place(rng));
        if !truths.is_empty() && rng.u8(0..5) > 0 {
            let truth = &truths[rng.usize(0..truths.len())];
            region = near(rng, &truth.region);
            if truth.class != ANY_CLASS && rng.u8(0..8) > 0 {
                class = truth.class;
            }
        }
        let mut detection = ap::Detection::new(class, score(rng, images.tied), region);
        detection.ignore_unmatched = rng.u8(0..12) == 0;
        found.push(detection);
    }
    (truths, found)
}

/// Writes truths and detections of a case, and the scores that we give it.
fn coco_case<R: Region + Clone>(
    kind: &str,
    size: [u32; 2],
    images: &[Image<R>],
    with_parts: bool,
    rng: &mut Rng,
    write_truth: impl Fn(u64, u64, &ap::Truth<R>) -> CocoTruth,
    write_found: impl Fn(u64, &ap::Detection<R>) -> CocoResult,
) -> Value {
    let mut collector = ap::Collector::new();
    let (mut all_truths, mut all_found) = (Vec::new(), Vec::new());
    for (image_id, (truths, found)) in (1..).zip(images) {
        let (mut truths, mut found) = (truths.clone(), found.clone());
        if with_parts {
            let ignored: Vec<bool> = truths.iter().map(|_| rng.u8(0..4) == 0).collect();
            let unmatched: Vec<bool> = found.iter().map(|_| rng.u8(0..4) == 0).collect();
            let pairs = Pairs::new(&truths, &found);
            collector.add_part(&pairs, |i| ignored[i], |i| unmatched[i]);
            for (truth, ignored) in truths.iter_mut().zip(ignored) {
                truth.ignore |= ignored;
            }
            for (detection, unmatched) in found.iter_mut().zip(unmatched) {
                detection.ignore_unmatched |= unmatched;
            }
        } else {
            collector.add(&truths, &found);
        }
        for truth in &truths {
            let id = all_truths.len() as u64 + 1;
            all_truths.push(write_truth(id, image_id, truth));
        }
        for detection in &found {
            let mut written = json!(write_found(image_id, detection));
            written["ignore_unmatched"] = json!(detection.ignore_unmatched);
            all_found.push(written);
        }
    }
    let scores = collector.scores();
    json!({
        "kind": kind, "size": size, "n_images": images.len(), "any_class": ANY_CLASS,
        "truths": all_truths, "found": all_found, "scores": scores,
    })
}

fn box_case(seed: u64) -> Value {
    let mut rng = Rng::with_seed(seed);
    let images = Images::any(&mut rng, false);
    let exact = rng.bool();
    // Small, medium and large ones; on a grid of quarters, where overlaps are often equal, or not.
    let largest = [20.0, 60.0, 400.0][rng.usize(0..3)];
    let round = move |value: f64| {
        if exact {
            (value * 4.0).round() / 4.0
        } else {
            f64::from(value as f32)
        }
    };
    let span = largest * 3.0;
    let mut place = |rng: &mut Rng| {
        let [x, y] = [0, 1].map(|_| round(rng.f64() * span));
        let [width, height] = [0, 1].map(|_| round(1.0 + rng.f64() * largest));
        BoxPx::new([x, y], [x + width, y + height])
    };
    let mut near = |rng: &mut Rng, region: &BoxPx| {
        let [x, y, width, height] = region.xywh();
        let wrong = [0.0, 0.05, 0.2, 0.5][rng.usize(0..4)];
        let mut off = |size: f64| round((rng.f64() - 0.5) * wrong * size);
        let [x, y] = [x + off(width), y + off(height)];
        let [width, height] = [width + off(width), height + off(height)];
        BoxPx::new([x, y], [x + width, y + height])
    };
    let mut frames = Vec::new();
    for _ in 0..images.n {
        frames.push(image(&mut rng, &images, &mut place, &mut near));
    }
    coco_case(
        "bbox",
        [4000, 4000],
        &frames,
        images.with_parts,
        &mut rng,
        CocoTruth::of_box,
        CocoResult::of_box,
    )
}

fn mask_case(seed: u64) -> Value {
    let mut rng = Rng::with_seed(seed);
    let images = Images::any(&mut rng, true);
    let size = [rng.u32(1..220), rng.u32(1..160)];
    let [width, height] = size;
    // Ellipses with holes of chance; rarely nothing at all.
    let paint = move |rng: &mut Rng, [x, y, a, b]: [f64; 4]| {
        let dense = 0.5 + 0.5 * rng.f64();
        let mask = RunMask::from_pixels(width, height, |column, row| {
            let [dx, dy] = [(f64::from(column) - x) / a, (f64::from(row) - y) / b];
            dx * dx + dy * dy <= 1.0 && rng.f64() < dense
        });
        mask.unwrap()
    };
    let mut place = |rng: &mut Rng| {
        let at = [
            rng.f64() * f64::from(width),
            rng.f64() * f64::from(height),
            0.3 + rng.f64() * 70.0,
            0.3 + rng.f64() * 70.0,
        ];
        paint(rng, at)
    };
    let mut near = |rng: &mut Rng, region: &RunMask| {
        let Some(bounds) = region.bounds().filter(|_| rng.bool()) else {
            return region.clone();
        };
        let [x0, y0, x1, y1] = bounds.map(f64::from);
        let mut off = |size: f64| size * (1.0 + (rng.f64() - 0.5) * 0.2);
        let [a, b] = [off((x1 - x0) / 2.0), off((y1 - y0) / 2.0)];
        paint(rng, [(x0 + x1) / 2.0, (y0 + y1) / 2.0, a, b])
    };
    let mut frames = Vec::new();
    for _ in 0..images.n.min(8) {
        frames.push(image(&mut rng, &images, &mut place, &mut near));
    }
    coco_case(
        "segm",
        size,
        &frames,
        images.with_parts,
        &mut rng,
        |id, image_id, truth| CocoTruth::of_mask(id, image_id, truth, runs_text),
        |image_id, detection| CocoResult::of_mask(image_id, detection, runs_text),
    )
}

#[test]
fn average_precision_of_boxes_and_masks_is_that_of_pycocotools() {
    let boxes = (0..120).map(box_case);
    let masks = (1000..1060).map(mask_case);
    let cases: Vec<String> = boxes.chain(masks).map(|case| case.to_string()).collect();
    judge("metrics_coco.py", &cases, 3000);
}
