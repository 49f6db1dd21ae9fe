//! Tracks against TrackEval, and against motmetrics where the two define the same.

use consumer_metrics::tracking::{Collector, Frame, Settings, centre_similarity, iou_similarity};
use serde_json::{Value, json};
use test_e2e::judged::judge;

use super::{Rng, case, normal};

/// An object and how it is seen.
struct Thing {
    id: u64,
    first: usize,
    last: usize,
    at: [f64; 2],
    step: [f64; 2],
    size: [f64; 2],
    ignored: bool,
    /// The track that follows it now.
    track: u64,
}

/// How bad a tracker is.
struct Tracker {
    miss: f64,
    false_alarm: f64,
    switch: f64,
    blur: f64,
    /// Objects go side by side and never meet.
    apart: bool,
}

/// A sequence of random boxes with a tracker that misses, invents, swaps and shakes.
fn sequence(
    rng: &mut Rng,
    tracker: &Tracker,
    with_ignored: bool,
    collector: &mut Collector,
) -> Value {
    let n_frames = rng.usize(1..40);
    let mut things: Vec<Thing> = (0..rng.u64(1..9))
        .map(|number| Thing {
            id: 100 + number,
            first: rng.usize(0..n_frames) * usize::from(!tracker.apart),
            last: rng.usize(n_frames / 2..2 * n_frames) + n_frames * usize::from(tracker.apart),
            at: if tracker.apart {
                [0.0, 100.0 * number as f64]
            } else {
                [0; 2].map(|_| 200.0 * rng.f64())
            },
            step: if tracker.apart {
                [3.0 * normal(rng), 0.0]
            } else {
                [0; 2].map(|_| 3.0 * normal(rng))
            },
            size: [0; 2].map(|_| 20.0 + 40.0 * rng.f64()),
            ignored: with_ignored && rng.u8(0..4) == 0,
            track: 1000 + number,
        })
        .collect();
    let mut next_track = 2000;
    let mut frames = Vec::new();
    for time in 0..n_frames {
        let (mut truths, mut ignored, mut truth_boxes) = (Vec::new(), Vec::new(), Vec::new());
        let (mut results, mut result_boxes) = (Vec::new(), Vec::new());
        for thing in &mut things {
            if !(thing.first..=thing.last).contains(&time) {
                continue;
            }
            thing.at = [0, 1].map(|axis| thing.at[axis] + thing.step[axis]);
            let [x, y] = thing.at;
            let [width, height] = thing.size;
            truths.push(thing.id);
            ignored.push(thing.ignored);
            truth_boxes.push([x, y, x + width, y + height]);
            if rng.f64() < tracker.switch {
                thing.track = next_track;
                next_track += 1;
            }
            if rng.f64() >= tracker.miss {
                let shake = [0; 2].map(|_| tracker.blur * normal(rng));
                let [x, y] = [x + shake[0], y + shake[1]];
                results.push(thing.track);
                result_boxes.push([x, y, x + width, y + height]);
            }
        }
        while rng.f64() < tracker.false_alarm {
            let far = if tracker.apart { 2000.0 } else { 0.0 };
            let [x, y] = [0; 2].map(|_| far + 200.0 * rng.f64());
            results.push(next_track);
            next_track += u64::from(rng.bool());
            result_boxes.push([x, y, x + 40.0, y + 40.0]);
            if results[..results.len() - 1].contains(&results[results.len() - 1]) {
                results.pop();
                result_boxes.pop();
            }
        }
        let similarity = if tracker.blur > 4.0 {
            let centre = |it: &[f64; 4]| [(it[0] + it[2]) / 2.0, (it[1] + it[3]) / 2.0, 0.0];
            let [truths, results] = [&truth_boxes, &result_boxes]
                .map(|boxes| boxes.iter().map(centre).collect::<Vec<_>>());
            centre_similarity(&truths, &results, 40.0)
        } else {
            iou_similarity(&truth_boxes, &result_boxes)
        };
        collector
            .add(Frame {
                truths: &truths,
                ignored: &ignored,
                results: &results,
                similarity: &similarity,
            })
            .unwrap();
        frames.push(json!({
            "truths": truths,
            "ignored": ignored,
            "results": results,
            "similarity": similarity,
            "truth_boxes": truth_boxes,
            "result_boxes": result_boxes,
            "is_overlap": tracker.blur <= 4.0,
        }));
    }
    collector.end_sequence();
    json!(frames)
}

fn tracking_case(seed: u64) -> String {
    let mut rng = Rng::with_seed(seed);
    let some = |rng: &mut Rng, most: f64| [0.0, most / 4.0, most][rng.usize(0..3)];
    let tracker = Tracker {
        miss: some(&mut rng, 0.4),
        false_alarm: some(&mut rng, 0.5),
        switch: some(&mut rng, 0.1),
        blur: some(&mut rng, 10.0),
        apart: seed.is_multiple_of(3),
    };
    let with_ignored = rng.u8(0..3) == 0;
    let mut whole = Collector::new(Settings::default());
    let mut sequences = Vec::new();
    for _ in 0..rng.usize(1..4) {
        let mut part = Collector::new(Settings::default());
        sequences.push(sequence(&mut rng, &tracker, with_ignored, &mut part));
        whole.merge(&part);
    }
    let scores = whole.scores();
    let mut figures = scores.named();
    for (name, figure) in [
        ("DetRe", scores.det_re),
        ("DetPr", scores.det_pr),
        ("AssRe", scores.ass_re),
        ("AssPr", scores.ass_pr),
    ] {
        figures.extend(figure.map(|figure| (name.to_owned(), figure)));
    }
    for (at, hota) in scores.hota_at.iter().enumerate() {
        figures.insert(format!("HOTA@{at}"), *hota);
    }
    case("tracking", json!(sequences), &figures)
}

#[test]
fn tracks_score_as_elsewhere() {
    let cases: Vec<String> = (0..120).map(tracking_case).collect();
    judge("metrics_tracking.py", &cases, 4000);
}
