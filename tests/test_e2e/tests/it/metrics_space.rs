//! Detection in space of `consumer_metrics` against nuscenes-devkit, to 1e-6, on random frames with
//! everything that its rules are about: equal scores, ranges, classes without headings, what is not
//! estimated, what is ignored.

use std::collections::{BTreeMap, BTreeSet};

use consumer_metrics::detection3d::{self as space, Box3, ClassRule, Heading};
use fastrand::Rng;
use serde::Serialize;
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
    let cases: Vec<String> = (0..200).map(|seed| space_case(seed).to_string()).collect();
    judge("metrics_nuscenes.py", &cases, 3000);
}
