//! Fake programs with known delay and known error against truths in closed form.

mod dense;
mod scene;
mod space;

use schema_frames::{Box2d, ResultType, Track};

use super::objects::boxes2d::Boxes2d;
use super::objects::tracking::Tracking;
use super::{AnyTask, TaskRun};
use crate::capture::{Capture, Mode};
use crate::suite::TaskKind;
use scene::{MS, about, capture, plan, result, scenario, scored, spec, tick, views};

const CAR: u8 = 14;

/// Width of the car that crosses the image, pixels.
const WIDTH: u64 = 40;

/// Left edge of the car, pixels: it moves 40 pixels a second.
fn left(sim_nanos: u64) -> u64 {
    sim_nanos / MS * 40 / 1000
}

fn rectangle(sim_nanos: u64) -> [u32; 4] {
    let x0 = left(sim_nanos) as u32;
    [x0, 10, x0 + WIDTH as u32, 30]
}

fn boxed(of: [u32; 4], shift: f32, class: u32, id: u32) -> Box2d {
    let [x0, y0, x1, y1] = of.map(|part| part as f32);
    Box2d {
        min_px: [x0 + shift, y0],
        max_px: [x1 + shift, y1],
        score: 0.9,
        class,
        id,
        reserved: 0,
    }
}

/// A program that answers every frame `late_ms` after it, `shift` pixels too far to the right.
fn crossing(mode: Mode, frame_ms: u64, n_frames: u64, late_ms: u64, shift: f32) -> Capture {
    let times = (0..n_frames).map(|n| n * frame_ms * MS);
    let mut capture = capture(mode, times.clone());
    for at in times {
        let found = [boxed(rectangle(at), shift, 0, 1)];
        let answer = result(ResultType::Boxes2d, at, at + late_ms * MS, &found);
        capture.results.push(answer);
    }
    capture.abouts.insert("mine/out".into(), about(&["car"]));
    capture
}

fn truth(at: u64) -> consumer_truth::ticks::TickSet {
    tick(at, views(at, &[(9, CAR, 20.0, rectangle(at))]), Vec::new())
}

/// Share of COCO's ten thresholds that an overlap reaches.
fn reached(iou: f64) -> f64 {
    let thresholds = (0..10).map(|n| 0.5 + 0.05 * f64::from(n));
    thresholds.filter(|threshold| iou >= *threshold).count() as f64 / 10.0
}

fn close(found: Option<&f64>, expected: f64, what: &str) {
    let found = *found.unwrap_or_else(|| panic!("{what} is missing"));
    assert!(
        (found - expected).abs() < 1e-9,
        "{what}: {found}, not {expected}"
    );
}

#[test]
fn a_crossing_car_gives_a_step_function_of_the_delay() {
    // A frame every 100 ms, in which the car moves 4 pixels; answers take 30 ms. A query at a frame's
    // time finds the answer to the frame before, or to the n-th before it with a delay added.
    let (frame_ms, late_ms, n) = (100, 30, 40);
    let delays = [0, 50, 70, 71, 170, 171, 300, 500];
    let capture = crossing(Mode::Streaming, frame_ms, n, late_ms, 0.0);
    let measure = Boxes2d::new(&spec(TaskKind::Boxes2d)).expect("the usual classes");
    let mut task = TaskRun::new(
        spec(TaskKind::Boxes2d),
        Mode::Streaming,
        plan(&delays),
        measure,
    );
    let from = 1000 * MS;
    let ticks = (0..n).map(|n| truth(n * frame_ms * MS));
    let scored = scored(&mut task, &capture, &scenario(), from, ticks);
    for (delay, point) in delays.iter().zip(&scored.score.curve) {
        let frames_behind = (late_ms + delay).div_ceil(frame_ms);
        let shift = 4.0 * frames_behind as f64;
        let iou = (WIDTH as f64 - shift) / (WIDTH as f64 + shift);
        close(
            Some(&point.value),
            reached(iou),
            &format!("AP at {delay} ms"),
        );
        assert_eq!(point.delay_ms, *delay as f64);
    }
    // By hand: 36/44 passes the first seven thresholds, 32/48 four, 24/56 none.
    let values: Vec<f64> = scored.score.curve.iter().map(|point| point.value).collect();
    assert_eq!(values[0], 0.7);
    assert_eq!((values[2], values[3], values[7]), (0.7, 0.4, 0.0));
    close(scored.score.streaming.get("AP75"), 1.0, "AP75");
    close(scored.score.offline.get("AP"), 1.0, "offline AP");
    let association = scored.association;
    assert_eq!((association.n_queries, association.miss), (30, 0));
    assert_eq!((association.in_time, association.mismatch), (0, 30));
    // Strata: everything stands 20 m away, and by day.
    let part = |by: &str, part: &str| {
        let mut strata = scored.score.strata.iter();
        strata
            .find(|own| own.by == by && own.part == part)
            .map(|own| (own.n, own.streaming))
    };
    assert_eq!(part("distance_m", "20-40"), Some((30, Some(0.7))));
    assert_eq!(part("distance_m", "0-10"), None);
    assert_eq!(part("light", "day"), Some((30, Some(0.7))));
}

#[test]
fn without_a_warm_up_the_first_queries_are_misses_and_cost_recall() {
    let (frame_ms, n) = (100, 50);
    // Answers take 430 ms: the queries of frames 0 to 4 find nothing; then five frames behind.
    let capture = crossing(Mode::Streaming, frame_ms, n, 430, 0.0);
    let measure = Boxes2d::new(&spec(TaskKind::Boxes2d)).expect("the usual classes");
    let mut task = TaskRun::new(
        spec(TaskKind::Boxes2d),
        Mode::Streaming,
        plan(&[0]),
        measure,
    );
    // A car that stands still: late answers are right.
    let still = |at: u64| tick(at, views(at, &[(9, CAR, 20.0, rectangle(0))]), Vec::new());
    let mut standing = capture.clone();
    for result in &mut standing.results {
        let found = [boxed(rectangle(0), 0.0, 0, 1)];
        result.body = crate::capture::Body::Held(bytemuck::cast_slice(&found).into());
    }
    let ticks = (0..n).map(|n| still(n * frame_ms * MS));
    let scored = scored(&mut task, &standing, &scenario(), 0, ticks);
    let association = scored.association;
    assert_eq!((association.n_queries, association.miss), (50, 5));
    assert_eq!((association.in_time, association.mismatch), (0, 45 * 5));
    // Precision is 1 up to a recall of 45/50, so of COCO's 101 recalls 0 to 0.90 count.
    close(scored.score.streaming.get("AP"), 91.0 / 101.0, "AP");
    close(scored.score.streaming.get("AR100"), 0.9, "AR");
}

#[test]
fn a_thousand_queries_a_second_see_the_error_grow_until_the_next_answer() {
    // The car moves a pixel every 25 ms; answers take 30 ms and come every 100 ms, so at a query the
    // answered frame lies 30 to 129 ms back.
    let (frame_ms, late_ms, n) = (100u64, 30u64, 30u64);
    let capture = crossing(Mode::Streaming, frame_ms, n, late_ms, 0.0);
    let measure = Boxes2d::new(&spec(TaskKind::Boxes2d)).expect("the usual classes");
    let mut task = TaskRun::new(
        spec(TaskKind::Boxes2d),
        Mode::Streaming,
        plan(&[0]),
        measure,
    );
    let (from, to) = (500, 2500u64);
    let ticks = (from..to).map(|ms| truth(ms * MS));
    let scored = scored(&mut task, &capture, &scenario(), from * MS, ticks);
    let mut mean = 0.0;
    let (mut in_time, mut mismatch) = (0, 0);
    for ms in from..to {
        let answered = (ms - late_ms) / frame_ms * frame_ms;
        let shift = (left(ms * MS) - left(answered * MS)) as f64;
        mean += reached((WIDTH as f64 - shift) / (WIDTH as f64 + shift)) / (to - from) as f64;
        in_time += u64::from(ms / frame_ms == answered / frame_ms);
        mismatch += ms / frame_ms - answered / frame_ms;
    }
    // One object, one detection in each image: recall at a threshold is the share of hits.
    close(scored.score.streaming.get("AR1"), mean, "AR1");
    let association = scored.association;
    assert_eq!((association.n_queries, association.miss), (2000, 0));
    assert_eq!(
        (association.in_time, association.mismatch),
        (in_time, mismatch)
    );
    assert_eq!((in_time, mismatch), (1400, 600));
}

#[test]
fn in_lockstep_time_plays_no_part_and_an_unanswered_frame_counts_as_empty() {
    let n = 20;
    let mut capture = crossing(Mode::Offline, 100, n, 5000, 4.0);
    // Every fourth frame stays without an answer.
    let mut number = 0;
    capture.results.retain(|_| {
        number += 1;
        number % 4 != 0
    });
    let measure = Boxes2d::new(&spec(TaskKind::Boxes2d)).expect("the usual classes");
    let mut task = TaskRun::new(spec(TaskKind::Boxes2d), Mode::Offline, plan(&[0]), measure);
    let ticks = (0..n).map(|n| truth(n * 100 * MS));
    let scored = scored(&mut task, &capture, &scenario(), 0, ticks);
    // 4 pixels beside it: 36/44, so seven thresholds; recall ends at 15/20.
    close(scored.score.offline.get("AP"), 0.7 * 76.0 / 101.0, "AP");
    assert!(scored.score.streaming.is_empty() && scored.score.curve.is_empty());
    assert_eq!(scored.association.n_queries, 0);
    assert_eq!(scored.score.n_scored, 20);
    // The worst frame is one without an answer.
    assert_eq!(scored.worst[0].result, None);
    assert!(scored.worst[0].bad.why.contains("1 of 1 missed"));
}

#[test]
fn all_scenarios_together_are_their_frames_together() {
    let measure = Boxes2d::new(&spec(TaskKind::Boxes2d)).expect("the usual classes");
    let mut task = TaskRun::new(spec(TaskKind::Boxes2d), Mode::Offline, plan(&[0]), measure);
    let ticks = || (0..10).map(|n| truth(n * 100 * MS));
    let right = crossing(Mode::Offline, 100, 10, 1, 0.0);
    let nothing = capture(Mode::Offline, (0..10).map(|n| n * 100 * MS));
    let first = scored(&mut task, &right, &scenario(), 0, ticks());
    let second = scored(&mut task, &nothing, &scenario(), 0, ticks());
    close(first.score.offline.get("AP"), 1.0, "the first");
    close(second.score.offline.get("AP"), 0.0, "the second");
    close(task.total().offline.get("AP"), 51.0 / 101.0, "both");
}

#[test]
fn what_can_hardly_be_seen_is_neither_asked_for_nor_wrong() {
    let frames = || (0..10u64).map(|n| n * 100 * MS);
    // A car, a car of 8 rows, a rider, and a truck that is not asked for.
    let things = [
        (9, CAR, 20.0, [10, 5, 50, 30]),
        (8, CAR, 90.0, [60, 5, 90, 13]),
        (7, 13, 20.0, [100, 5, 120, 30]),
        (6, 15, 20.0, [130, 5, 160, 30]),
    ];
    let mut asked = spec(TaskKind::Boxes2d);
    asked.classes = vec!["car".into(), "person".into()];
    let run = |found: &[([u32; 4], u32)]| {
        let mut capture = capture(Mode::Offline, frames());
        let boxes: Vec<Box2d> = found
            .iter()
            .map(|(of, class)| boxed(*of, 0.0, *class, 0))
            .collect();
        for at in frames() {
            capture
                .results
                .push(result(ResultType::Boxes2d, at, at + MS, &boxes));
        }
        capture
            .abouts
            .insert("mine/out".into(), about(&["car", "person", "truck"]));
        let measure = Boxes2d::new(&asked).expect("known classes");
        let mut task = TaskRun::new(asked.clone(), Mode::Offline, plan(&[0]), measure);
        let ticks = frames().map(|at| tick(at, views(at, &things), Vec::new()));
        scored(&mut task, &capture, &scenario(), 0, ticks).score
    };
    let only = run(&[(things[0].3, 0)]);
    let with_ignored = run(&[
        (things[0].3, 0),
        (things[1].3, 0),
        (things[2].3, 1),
        (things[3].3, 2),
    ]);
    for score in [&only, &with_ignored] {
        close(score.offline.get("AP"), 1.0, "AP");
        assert_eq!((score.n_scored, score.n_ignored), (10, 20));
    }
    // Calling the truck a car is a false alarm, and of the same confidence as the car.
    let wrong = run(&[(things[3].3, 0), (things[0].3, 0)]);
    assert!(wrong.offline["AP"] < 0.9, "{}", wrong.offline["AP"]);
}

#[test]
fn a_track_that_keeps_its_number_is_better_than_one_that_changes_it() {
    let frames = || (0..20u64).map(|n| n * 100 * MS);
    let run = |id: &dyn Fn(u64) -> u32| {
        let mut capture = capture(Mode::Offline, frames());
        for at in frames() {
            let [x0, y0, x1, y1] = rectangle(at).map(|part| part as f32);
            let mut track: Track = bytemuck::Zeroable::zeroed();
            (track.id, track.state, track.flags) = (id(at), 1, Track::IN_IMAGE);
            (track.min_px, track.max_px, track.score) = ([x0, y0], [x1, y1], 0.9);
            capture
                .results
                .push(result(ResultType::Tracks, at, at + MS, &[track]));
        }
        capture.abouts.insert("mine/out".into(), about(&["car"]));
        let measure = Tracking::new(&spec(TaskKind::Tracking)).expect("the usual classes");
        let mut task = TaskRun::new(spec(TaskKind::Tracking), Mode::Offline, plan(&[0]), measure);
        scored(&mut task, &capture, &scenario(), 0, frames().map(truth)).score
    };
    let steady = run(&|_| 5);
    for metric in ["HOTA", "MOTA", "IDF1"] {
        close(steady.offline.get(metric), 1.0, metric);
    }
    // A new number halfway: detections are all right, one switch in 20 frames, and each half of the
    // track has half of the truth: association 1/2, so HOTA √(1 · 1/2).
    let changing = run(&|at| if at < 1000 * MS { 5 } else { 6 });
    close(changing.offline.get("HOTA"), 0.5f64.sqrt(), "HOTA");
    close(changing.offline.get("MOTA"), 1.0 - 1.0 / 20.0, "MOTA");
    close(changing.offline.get("IDF1"), 0.5, "IDF1");
}

#[test]
fn results_that_cannot_be_read_are_counted_and_answer_nothing() {
    let frames = || (0..4u64).map(|n| n * 100 * MS);
    let mut capture = capture(Mode::Offline, frames());
    for at in frames() {
        capture
            .results
            .push(result(ResultType::Pose, at, at + MS, &[0u8; 344]));
    }
    let measure = Boxes2d::new(&spec(TaskKind::Boxes2d)).expect("the usual classes");
    let mut task = TaskRun::new(spec(TaskKind::Boxes2d), Mode::Offline, plan(&[0]), measure);
    let scored = scored(&mut task, &capture, &scenario(), 0, frames().map(truth));
    assert_eq!(scored.n_unreadable, 4);
    close(scored.score.offline.get("AP"), 0.0, "AP");
    let fault = scored.first_fault.expect("a sentence");
    assert!(
        fault.contains("is of type pose, but boxes2d needs boxes2d"),
        "{fault}"
    );
}
