//! Classes against scikit-learn, depth against scikit-learn and SciPy, disparity and flow against
//! mmflow, event flow against mmflow and SciPy.

use consumer_metrics::{classes, depth, event_flow, flow, stereo};
use serde_json::json;
use test_e2e::judged::judge;

use super::{Rng, case, exact, normal};

fn mask(rng: &mut Rng, n: usize) -> Vec<bool> {
    (0..n).map(|_| rng.u8(0..4) > 0).collect()
}

fn classes_case(seed: u64) -> String {
    let mut rng = Rng::with_seed(seed);
    let n_classes = rng.u8(2..12);
    let ignored: Vec<u8> = (0..n_classes).filter(|_| rng.u8(0..6) == 0).collect();
    let settings = classes::Settings {
        ignored: ignored.clone(),
    };
    let mut whole = classes::Collector::new(settings.clone());
    let mut frames = Vec::new();
    for _ in 0..rng.usize(1..5) {
        let n = rng.usize(50..400);
        // Some classes occur in the truth alone, some in the results alone.
        let truth: Vec<u8> = (0..n).map(|_| rng.u8(0..n_classes).max(1)).collect();
        let result: Vec<u8> = truth
            .iter()
            .map(|&it| if rng.bool() { it } else { rng.u8(0..n_classes) })
            .collect();
        let mask = mask(&mut rng, n);
        let mut part = classes::Collector::new(settings.clone());
        part.add(&truth, &result, Some(&mask)).unwrap();
        whole.merge(&part);
        frames.push(json!({ "truth": truth, "result": result, "mask": mask }));
    }
    let scores = whole.scores();
    let mut figures = scores.named();
    figures.extend(scores.named_classes(|class| class.to_string()));
    let input = json!({ "frames": frames, "ignored": ignored });
    case("classes", input, &figures)
}

fn depth_case(seed: u64) -> String {
    let mut rng = Rng::with_seed(seed);
    let scaling = if rng.bool() {
        depth::Scaling::Median
    } else {
        depth::Scaling::None
    };
    let settings = depth::Settings {
        min_m: 0.5,
        max_m: 60.0,
        scaling,
    };
    let mut whole = depth::Collector::new(settings);
    let mut images = Vec::new();
    let error = [0.01, 0.1, 0.4][rng.usize(0..3)];
    for _ in 0..rng.usize(1..5) {
        let n = rng.usize(50..300);
        let truth: Vec<f32> = (0..n)
            .map(|_| match rng.u8(0..12) {
                0 => f32::INFINITY,
                _ => (90.0 * rng.f64().powi(2)) as f32,
            })
            .collect();
        let result: Vec<f32> = truth
            .iter()
            .map(|&it| match rng.u8(0..12) {
                0 => f32::NAN,
                1 => 0.0,
                _ => it * (0.05 + error * normal(&mut rng)).exp() as f32,
            })
            .collect();
        let mask = mask(&mut rng, n);
        let mut part = depth::Collector::new(settings);
        part.add(&truth, &result, Some(&mask)).unwrap();
        whole.merge(&part);
        images.push(json!({ "truth": exact(&truth), "result": exact(&result), "mask": mask }));
    }
    let input = json!({
        "images": images,
        "min_m": settings.min_m,
        "max_m": settings.max_m,
        "median": scaling == depth::Scaling::Median,
    });
    case("depth", input, &whole.scores().named())
}

fn stereo_case(seed: u64) -> String {
    let mut rng = Rng::with_seed(seed);
    let mut whole = stereo::Collector::new();
    let mut images = Vec::new();
    for _ in 0..rng.usize(1..5) {
        let n = rng.usize(50..300);
        let truth: Vec<f32> = (0..n)
            .map(|_| match rng.u8(0..8) {
                0 => 0.0,
                _ => (150.0 * rng.f64()) as f32,
            })
            .collect();
        let result: Vec<f32> = truth
            .iter()
            .map(|&it| match rng.u8(0..12) {
                0 => -1.0,
                1 => f32::NAN,
                _ => (it + 4.0 * normal(&mut rng) as f32).max(0.0),
            })
            .collect();
        let mask = mask(&mut rng, n);
        let mut part = stereo::Collector::new();
        part.add(&truth, &result, Some(&mask)).unwrap();
        whole.merge(&part);
        images.push(json!({ "truth": exact(&truth), "result": exact(&result), "mask": mask }));
    }
    case(
        "stereo",
        json!({ "images": images }),
        &whole.scores().named(),
    )
}

/// A true flow and one that is wrong, with gaps in both.
fn flows(rng: &mut Rng, n: usize) -> (Vec<[f32; 2]>, Vec<[f32; 2]>) {
    let truth: Vec<[f32; 2]> = (0..n)
        .map(|_| {
            let length = 100.0 * rng.f64().powi(3);
            let gap = if rng.u8(0..10) == 0 { f64::NAN } else { 1.0 };
            [0; 2].map(|_| (gap * length * normal(rng)) as f32)
        })
        .collect();
    let result = truth
        .iter()
        .map(|it| {
            let gap = if rng.u8(0..12) == 0 { f32::NAN } else { 1.0 };
            it.map(|it| {
                let it = if it.is_finite() { it } else { 0.0 };
                gap * (it + 3.0 * normal(rng) as f32)
            })
        })
        .collect();
    (truth, result)
}

fn flow_case(seed: u64) -> String {
    let mut rng = Rng::with_seed(seed);
    let mut whole = flow::Collector::new();
    let mut frames = Vec::new();
    for _ in 0..rng.usize(1..5) {
        let n = rng.usize(50..300);
        let (truth, result) = flows(&mut rng, n);
        let [scored, moving, occluded] = [0; 3].map(|_| mask(&mut rng, n));
        let masks = flow::Masks {
            scored: Some(&scored),
            moving: Some(&moving),
            occluded: Some(&occluded),
        };
        let mut part = flow::Collector::new();
        part.add(&truth, &result, masks).unwrap();
        whole.merge(&part);
        frames.push(json!({
            "truth": exact(truth.as_flattened()),
            "result": exact(result.as_flattened()),
            "mask": scored,
            "moving": moving,
            "occluded": occluded,
        }));
    }
    case("flow", json!({ "images": frames }), &whole.scores().named())
}

fn event_flow_case(seed: u64) -> String {
    let mut rng = Rng::with_seed(seed);
    let mut whole = event_flow::Collector::new();
    let mut frames = Vec::new();
    for _ in 0..rng.usize(1..5) {
        let n = rng.usize(50..300);
        let (truth, result) = flows(&mut rng, n);
        let mask = mask(&mut rng, n);
        let mut part = event_flow::Collector::new();
        part.add(&truth, &result, Some(&mask)).unwrap();
        whole.merge(&part);
        frames.push(json!({
            "truth": exact(truth.as_flattened()),
            "result": exact(result.as_flattened()),
            "mask": mask,
        }));
    }
    let input = json!({ "images": frames });
    case("event_flow", input, &whole.scores().named())
}

#[test]
fn pixels_score_as_elsewhere() {
    let mut cases = Vec::new();
    for seed in 0..30 {
        cases.extend([
            classes_case(seed),
            depth_case(seed),
            stereo_case(seed),
            flow_case(seed),
            event_flow_case(seed),
        ]);
    }
    judge("metrics_dense.py", &cases, 1500);
}
