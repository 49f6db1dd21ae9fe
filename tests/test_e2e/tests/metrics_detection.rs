//! `consumer_metrics` against the public code of the benchmarks that define the figures:
//! pycocotools (boxes and masks) and nuscenes-devkit (boxes in space), to 1e-6, on random frames with
//! everything that their rules are about: equal scores, crowds, what is ignored, empty frames, floods.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use consumer_metrics::average_precision::{self as ap, ANY_CLASS, BoxPx, Pairs, Region, RunMask};
use consumer_metrics::coco_json::{CocoResult, CocoTruth};
use consumer_metrics::detection3d::{self as space, Box3, ClassRule, Heading};
use consumer_truth::masks::runs_text;
use fastrand::Rng;
use serde::Serialize;
use serde_json::{Value, json};
use test_e2e::venv_program;
use test_kit::Sandbox;
use test_kit::sandbox::repository;

/// Lets a script of `python/` judge the cases; it says how many figures it compared.
fn judge(script: &str, cases: &[Value], at_least: u64) {
    let sandbox = Sandbox::new("metrics");
    let lines: Vec<String> = cases.iter().map(Value::to_string).collect();
    let file = sandbox.write("cases.jsonl", &lines.join("\n"));
    let script = repository().join("tests/test_e2e/python").join(script);
    let words = [&script, &file].map(|path| path.to_str().unwrap());
    let judged = sandbox.spawn_program("python", &venv_program("python"), &words, &[]);
    let judged = judged.wait_longer(Duration::from_secs(300)).expect_code(0);
    let said = judged.lines.last().expect("the script says a line");
    let mut words = said.split(' ');
    assert_eq!(words.next(), Some("compared"), "{:#?}", judged.lines);
    let n: u64 = words.next().unwrap().parse().unwrap();
    assert!(n >= at_least, "{said}");
    println!("{said}");
}

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

/// Truths and detections of an image, most detections near truths of their class.
fn image<R: Region + Clone>(
    rng: &mut Rng,
    images: &Images,
    place: &mut dyn FnMut(&mut Rng) -> R,
    near: &mut dyn FnMut(&mut Rng, &R) -> R,
) -> (Vec<ap::Truth<R>>, Vec<ap::Detection<R>>) {
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
    images: &[(Vec<ap::Truth<R>>, Vec<ap::Detection<R>>)],
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
    let cases: Vec<Value> = boxes.chain(masks).collect();
    judge("metrics_coco.py", &cases, 3000);
}

/// nuScenes' classes, with their ranges in metres, in its order.
const CLASSES: [(&str, f64); 10] = [
    ("car", 50.0),
    ("truck", 50.0),
    ("bus", 50.0),
    ("trailer", 50.0),
    ("construction_vehicle", 50.0),
    ("pedestrian", 40.0),
    ("motorcycle", 40.0),
    ("bicycle", 40.0),
    ("traffic_cone", 30.0),
    ("barrier", 30.0),
];

/// nuScenes' attributes.
const ATTRIBUTES: [&str; 3] = ["vehicle.moving", "vehicle.parked", "vehicle.stopped"];

fn rule(name: &str, range_m: f64) -> ClassRule {
    let still = ["traffic_cone", "barrier"].contains(&name);
    ClassRule {
        range_m: Some(range_m),
        heading: match name {
            "traffic_cone" => Heading::None,
            "barrier" => Heading::HalfTurn,
            _ => Heading::Full,
        },
        velocity: !still,
        attribute: !still,
    }
}

/// A box as the script reads it.
#[derive(Serialize)]
struct Written {
    frame: usize,
    class: &'static str,
    shape: [f64; 7],
    velocity: Option<[f64; 2]>,
    attribute: &'static str,
    distance_m: f64,
    score: Option<f64>,
    flag: bool,
}

fn written(
    frame: usize,
    class: u32,
    shape: &Box3,
    velocity: Option<[f64; 2]>,
    attribute: Option<u32>,
) -> Written {
    let ([x, y, z], [length, width, height]) = (shape.centre_m, shape.size_m);
    Written {
        frame,
        class: CLASSES[class as usize].0,
        shape: [x, y, z, length, width, height, shape.yaw_rad],
        velocity,
        attribute: attribute.map_or("", |attribute| ATTRIBUTES[attribute as usize]),
        distance_m: 0.0,
        score: None,
        flag: false,
    }
}

/// A random case; with `flags`, truths stand so far apart that it is clear which detections belong
/// to one that is ignored.
fn space_case(seed: u64) -> Value {
    let mut rng = Rng::with_seed(seed);
    let (tied, flags, count_absent) = (rng.bool(), rng.u8(0..3) == 0, rng.bool());
    // What truths and detections say about velocities and attributes.
    let (has_velocity, has_attribute) = (rng.u8(0..4) > 0, rng.u8(0..3) > 0);
    let (says_velocity, says_attribute) = (rng.u8(0..4) > 0, rng.u8(0..4) > 0);
    let n_frames = rng.usize(1..15);
    let present: BTreeSet<u32> = (0..rng.usize(1..8)).map(|_| rng.u32(0..10)).collect();
    let present: Vec<u32> = present.into_iter().collect();
    let rules = (0..).zip(CLASSES);
    let mut collector = space::Collector::new(space::Settings {
        classes: rules
            .map(|(class, (name, range_m))| (class, rule(name, range_m)))
            .collect(),
        count_absent,
    });
    let (mut truth_lines, mut found_lines) = (Vec::new(), Vec::new());
    for frame in 0..n_frames {
        let (mut truths, mut found) = (Vec::new(), Vec::new());
        for i in 0..rng.usize(0..10) {
            let class = present[rng.usize(0..present.len())];
            let any = |rng: &mut Rng, span: f64| (rng.f64() - 0.5) * span;
            let centre_m = if flags {
                [30.0 * i as f64, any(&mut rng, 4.0), 0.0]
            } else {
                [any(&mut rng, 20.0), any(&mut rng, 20.0), 0.0]
            };
            let mut truth = space::Truth::new(
                class,
                Box3 {
                    centre_m,
                    size_m: [0; 3].map(|_| 0.5 + 4.0 * rng.f64()),
                    yaw_rad: any(&mut rng, 20.0),
                },
            );
            truth.distance_m = rng.f64() * 60.0;
            truth.ignore = flags && rng.u8(0..4) == 0;
            if has_velocity && rng.u8(0..5) > 0 {
                truth.velocity_mps = Some([any(&mut rng, 20.0), any(&mut rng, 20.0)]);
            }
            if has_attribute && rng.u8(0..5) > 0 {
                truth.attribute = Some(rng.u32(0..3));
            }
            for _ in 0..rng.usize(0..4) {
                let mut shape = truth.shape;
                let wrong = [0.0, 0.5, 2.0, 6.0][rng.usize(0..4)];
                shape.centre_m = shape.centre_m.map(|at| at + any(&mut rng, wrong));
                shape.size_m = shape.size_m.map(|size| size * (0.8 + 0.4 * rng.f64()));
                shape.yaw_rad += any(&mut rng, 4.0);
                let score = score(&mut rng, tied);
                let mut detection = space::Detection::new(class, score, shape);
                detection.distance_m = (truth.distance_m + any(&mut rng, 2.0)).abs();
                detection.ignore_unmatched = flags && rng.u8(0..4) == 0;
                if says_velocity && rng.u8(0..5) > 0 {
                    detection.velocity_mps = Some([any(&mut rng, 20.0), any(&mut rng, 20.0)]);
                }
                if says_attribute && rng.u8(0..5) > 0 {
                    detection.attribute = Some(rng.u32(0..3));
                }
                found.push(detection);
            }
            truths.push(truth);
        }
        rng.shuffle(&mut found);
        if !flags || rng.bool() {
            collector.add(&truths, &found);
        } else {
            // The same, said from outside.
            let (mut plain, mut plain_found) = (truths.clone(), found.clone());
            plain.iter_mut().for_each(|truth| truth.ignore = false);
            plain_found
                .iter_mut()
                .for_each(|detection| detection.ignore_unmatched = false);
            collector.add_part(
                &plain,
                &plain_found,
                |i| truths[i].ignore,
                |i| found[i].ignore_unmatched,
            );
        }
        truth_lines.extend(truths.iter().map(|truth| Written {
            distance_m: truth.distance_m,
            flag: truth.ignore,
            ..written(
                frame,
                truth.class,
                &truth.shape,
                truth.velocity_mps,
                truth.attribute,
            )
        }));
        found_lines.extend(found.iter().map(|detection| Written {
            distance_m: detection.distance_m,
            flag: detection.ignore_unmatched,
            score: Some(detection.score),
            ..written(
                frame,
                detection.class,
                &detection.shape,
                detection.velocity_mps,
                detection.attribute,
            )
        }));
    }
    let scores = collector.scores();
    let name = |class: u32| CLASSES[class as usize].0.to_owned();
    let ranges: BTreeMap<&str, f64> = CLASSES.into_iter().collect();
    json!({
        "n_frames": n_frames, "flags": flags, "count_absent": count_absent, "ranges": ranges,
        "truths": truth_lines, "found": found_lines,
        "named": scores.named(), "classes": scores.named_classes(name),
    })
}

#[test]
fn detection_in_space_is_that_of_the_nuscenes_devkit() {
    let cases: Vec<Value> = (0..200).map(space_case).collect();
    judge("metrics_nuscenes.py", &cases, 3000);
}
