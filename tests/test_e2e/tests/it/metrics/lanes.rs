//! Lines of lanes against the development kit of OpenLane-V2, and their errors against SciPy.

use consumer_metrics::lanes::{Collector, Line, Settings};
use serde_json::json;
use test_e2e::judged::judge;

use super::{Rng, case, normal};

fn line(rng: &mut Rng, left_m: f64, from_m: f64, to_m: f64, noise_m: f64) -> Line {
    let bend = 0.002 * normal(rng);
    let rise = 0.02 * normal(rng);
    let mut x = from_m;
    let mut points = Vec::new();
    while x < to_m {
        let left = left_m + bend * x * x / 2.0 + noise_m * normal(rng);
        points.push([x, left, rise * x + 0.1 * noise_m * normal(rng)]);
        x += 0.5 + 8.0 * rng.f64();
    }
    points
}

fn lanes_case(seed: u64) -> String {
    let mut rng = Rng::with_seed(seed);
    let settings = Settings {
        use_height: rng.bool(),
        ..Settings::default()
    };
    let mut whole = Collector::new(settings.clone());
    let noise_m = [0.05, 0.3, 1.0][rng.usize(0..3)];
    let mut frames = Vec::new();
    for _ in 0..rng.usize(1..6) {
        let mut truths: Vec<Line> = Vec::new();
        let mut results: Vec<Line> = Vec::new();
        for number in 0..rng.i32(0..6) {
            let left = 3.5 * f64::from(number) - 7.0;
            let (from, to) = (-10.0 + 40.0 * rng.f64(), 40.0 + 80.0 * rng.f64());
            let truth = line(&mut rng, left, from, to, 0.0);
            if rng.u8(0..5) > 0 {
                let ends = [from, to].map(|end| end + 8.0 * normal(&mut rng));
                let mut result: Line = truth.clone();
                result.retain(|point| (ends[0]..ends[1]).contains(&point[0]));
                for point in &mut result {
                    point[1] += noise_m * normal(&mut rng);
                    point[2] += 0.1 * normal(&mut rng);
                }
                results.push(result);
            }
            truths.push(truth);
        }
        if rng.u8(0..3) == 0 {
            let left = 8.0 * normal(&mut rng);
            results.push(line(&mut rng, left, 0.0, 80.0, 0.2));
        }
        results.retain(|line| line.len() > 1);
        truths.retain(|line| line.len() > 1);
        let mut part = Collector::new(settings.clone());
        part.add(&truths, &[], &results).unwrap();
        whole.merge(&part).unwrap();
        frames.push(json!({ "truths": truths, "results": results }));
    }
    let mut figures = whole.scores().named();
    for at in whole.scores().at {
        for (name, figure) in [
            ("precision", at.precision),
            ("recall", at.recall),
            ("lateral_near", at.lateral_near_m),
            ("lateral_far", at.lateral_far_m),
            ("height_near", at.height_near_m),
            ("height_far", at.height_far_m),
        ] {
            figures.extend(figure.map(|figure| (format!("{name}@{}m", at.threshold_m), figure)));
        }
    }
    let input = json!({ "frames": frames, "use_height": settings.use_height });
    case("lanes", input, &figures)
}

#[test]
fn lanes_score_as_elsewhere() {
    let cases: Vec<String> = (0..60).map(lanes_case).collect();
    judge("metrics_lanes.py", &cases, 1000);
}
