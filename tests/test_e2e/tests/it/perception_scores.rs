//! The scorer on a real recording: a program that answers with the exact truth is perfect at every
//! task, the same a frame late is not, and one that says nothing finds nothing.

use std::collections::{BTreeMap, HashSet};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use bytemuck::{Pod, Zeroable};
use consumer_perception::capture::{Body, Capture, CapturedResult, Clock, Mode, SentFrame};
use consumer_perception::evidence::ignore::Rules;
use consumer_perception::evidence::moment::Moment;
use consumer_perception::report::{Run, TaskScore};
use consumer_perception::score::Scorer;
use consumer_perception::suite::{Suite, TaskKind};
use consumer_perception::tasks::motion::lanes::Lanes;
use consumer_perception::tasks::{Context, Measure, Options, Spec};
use consumer_perception::truth_pass::{self, TruthRecording};
use consumer_truth::Mask;
use consumer_truth::recording::{TickReader, scenario};
use consumer_truth::scenario::Scenario;
use consumer_truth::ticks::TickSet;
use schema_frames::about::PointField;
use schema_frames::sealed::mount_between;
use schema_frames::{
    About, Box2d, Box3d, InputRecord, MaskRecord, Modality, Odometry, PathPoint, PixelFormat,
    ResultHeader, ResultType, SemanticLidarPoint, Space, Track,
};
use schema_recording::read::RecordingFile;
use schema_types::Pose;
use test_e2e::exports::record_drive;
use test_kit::Sandbox;

/// A street with traffic; a stereo pair, an event camera and a lidar.
const SUITE: &str = r#"
version = 1
secs = 3.0
warm_up_s = 0.5
tick_hz = 20
query_hz = 20
delays_ms = [0, 100, 300]
[matrix]
maps = ["Town10HD"]
spawn_points = [126]
seeds = [7]
densities = ["street"]
[density.street]
vehicles = 40
walkers = 60
[rig.car.sensor.front]
kind = "camera"
modalities = ["rgb"]
rate_hz = 10
width_px = 320
height_px = 180
mount.position_m = [0.6, 0.0, 1.6]
[rig.car.sensor.front_right]
kind = "camera"
modalities = ["rgb"]
rate_hz = 10
width_px = 320
height_px = 180
mount.position_m = [0.6, -0.5, 1.6]
[rig.car.sensor.events]
kind = "camera"
modalities = ["dvs"]
rate_hz = 20
width_px = 160
height_px = 90
mount.position_m = [0.6, 0.0, 1.6]
[rig.car.sensor.roof]
kind = "lidar"
rate_hz = 10
channels = 16
columns = 500
range_m = 80
mount.position_m = [0.0, 0.0, 2.0]
"#;

/// Every task that a recording has a truth of, and its sensor.
const TASKS: [(&str, &str); 12] = [
    ("boxes2d", "front"),
    ("masks", "front"),
    ("semantic", "front"),
    ("depth", "front"),
    ("stereo", "front"),
    ("flow", "front"),
    ("tracking", "front"),
    ("lanes", "front"),
    ("event_flow", "events"),
    ("boxes3d", "roof"),
    ("lidar_semantic", "roof"),
    ("odometry", "roof"),
];

/// Every task, and two programs that answer them all.
fn all_tasks() -> String {
    let mut text = String::new();
    for (kind, sensor) in TASKS {
        text += &format!("[[task]]\nkind = \"{kind}\"\nsensor = \"{sensor}\"\n");
        // The images are small, and most of the traffic in them too.
        text += match kind {
            "stereo" => "partner = \"front_right\"\n",
            "boxes2d" | "masks" | "tracking" => "ignore = { min_pixels = 9, min_height_px = 4 }\n",
            _ => "",
        };
    }
    for name in ["perfect", "silent"] {
        text += &format!("[program.{name}]\ncmd = [\"{name}\"]\n[program.{name}.results]\n");
        for (kind, _) in TASKS {
            text += &format!("\"{name}/{kind}\" = \"{kind}\"\n");
        }
    }
    text
}

fn suite(tasks: &str) -> Suite {
    let text = format!("{SUITE}{tasks}");
    Suite::parse(&text, Path::new("/"), "hand").unwrap()
}

/// Monotonic time of simulated time 0.
const ZERO_MONO: u64 = 5_000_000_000;

fn list<T: Pod>(kind: ResultType, records: &[T]) -> (ResultHeader, Vec<u8>) {
    let mut header = ResultHeader::new(kind);
    header.set_list(records.len() as u32, size_of::<T>() as u32, 0);
    (header, bytemuck::cast_slice(records).to_vec())
}

fn pixels(
    set: &TickSet,
    sensor: &str,
    modality: Modality,
    kind: ResultType,
) -> Option<(ResultHeader, Vec<u8>)> {
    let frame = set.frame(sensor, modality)?;
    let mut header = ResultHeader::new(kind);
    let format = PixelFormat::from_code(modality as u16).unwrap();
    header.set_image(frame.header.width, frame.header.height, format);
    header.row_stride = frame.header.row_stride;
    header.body_bytes = frame.payload.len() as u64;
    Some((header, frame.payload.clone()))
}

/// What a perfect program says at one tick, by task.
fn answers(
    set: &TickSet,
    moment: &Moment<'_>,
    lanes: &Lanes,
) -> Vec<(&'static str, ResultHeader, Vec<u8>)> {
    let mut said = Vec::new();
    if let Some(view) = moment.view("ego/front_truth") {
        let seen = || view.objects.iter().filter(|it| matches!(it.class, 12..=19));
        let boxes: Vec<Box2d> = seen()
            .map(|object| Box2d {
                min_px: [object.bounds[0], object.bounds[1]].map(|it| it as f32),
                max_px: [object.bounds[2], object.bounds[3]].map(|it| it as f32),
                score: 0.9,
                class: u32::from(object.class),
                id: 0,
                reserved: 0,
            })
            .collect();
        let (header, body) = list(ResultType::Boxes2d, &boxes);
        said.push(("boxes2d", header, body));
        let tracks: Vec<Track> = seen()
            .zip(&boxes)
            .map(|(object, boxed)| {
                let mut track: Track = Zeroable::zeroed();
                // Riders have the id of what they ride.
                track.id = object.id << 1 | u32::from(object.class == 13);
                (track.class, track.state) = (boxed.class, 1);
                (track.flags, track.score) = (Track::IN_IMAGE, 0.9);
                (track.min_px, track.max_px) = (boxed.min_px, boxed.max_px);
                track
            })
            .collect();
        let (header, body) = list(ResultType::Tracks, &tracks);
        said.push(("tracking", header, body));
        let (width, height) = (view.camera.width, view.camera.height);
        let mut masks = Vec::new();
        let mut runs: Vec<u32> = Vec::new();
        for object in seen() {
            let mask = Mask::new(object.bounds, |column, row| {
                let at = (row * width + column) as usize;
                view.instance[at] == object.id && view.semantic[at] == object.class
            });
            let own = mask.runs(width, height);
            let mut record: MaskRecord = Zeroable::zeroed();
            (record.class, record.score) = (u32::from(object.class), 0.9);
            (record.first_run, record.n_runs) = (runs.len() as u32, own.len() as u32);
            runs.extend(own);
            masks.push(record);
        }
        let (mut header, mut body) = list(ResultType::Masks, &masks);
        body.extend(bytemuck::cast_slice::<u32, u8>(&runs));
        header.body_bytes = body.len() as u64;
        (header.width, header.height) = (width, height);
        said.push(("masks", header, body));
        if let Some((lines, _)) = lanes.truths(moment) {
            let mut points: Vec<PathPoint> = Vec::new();
            let place = |at: [f64; 3]| PathPoint {
                pose: Pose {
                    translation_m: at,
                    ..Pose::IDENTITY
                },
                after_secs: f32::NAN,
                speed_mps: f32::NAN,
                acceleration_mps2: f32::NAN,
                curvature_pm: f32::NAN,
                reserved: [0; 2],
            };
            for line in lines {
                points.extend(line.into_iter().map(place));
                points.push(place([f64::NAN; 3]));
            }
            let (mut header, body) = list(ResultType::Path, &points);
            header.space = Space::Vehicle as u32;
            said.push(("lanes", header, body));
        }
    }
    for (task, sensor, modality, kind) in [
        (
            "semantic",
            "front_truth",
            Modality::Semantic,
            ResultType::Semantic,
        ),
        ("depth", "front_truth", Modality::Depth, ResultType::Depth),
        ("stereo", "front_truth", Modality::Depth, ResultType::Depth),
        ("flow", "front", Modality::Flow, ResultType::Flow),
        (
            "event_flow",
            "events_truth10",
            Modality::Flow,
            ResultType::Flow,
        ),
    ] {
        let found = pixels(set, sensor, modality, kind);
        said.extend(found.map(|(header, body)| (task, header, body)));
    }
    if let Some(cloud) = set.frame("roof_truth", Modality::SemanticLidar) {
        let mut body = Vec::new();
        let points: Vec<SemanticLidarPoint> = cloud.elements();
        for point in &points {
            body.extend(bytemuck::bytes_of(&point.hit_in_sensor_m));
            body.extend(u32::from(point.class).to_le_bytes());
        }
        let mut header = ResultHeader::new(ResultType::Points);
        header.set_list(points.len() as u32, 16, 0);
        // Programs see a sealed world, of which they know the mount.
        let ego = moment.ego().expect("the carrier").world_from_ego;
        header.world_from_space = mount_between(&ego.into(), &cloud.header.world_from_sensor);
        said.push(("lidar_semantic", header, body));
        let boxes: Vec<Box3d> = moment
            .bodies()
            .iter()
            .map(|body| {
                let mut found: Box3d = Zeroable::zeroed();
                found.pose = body.world_from_box.into();
                found.half_m = [body.half_m.x, body.half_m.y, body.half_m.z].map(|it| it as f32);
                let velocity = body.velocity_mps;
                found.velocity_mps = [velocity.x, velocity.y, velocity.z].map(|it| it as f32);
                (found.score, found.class) = (0.9, u32::from(body.class));
                found
            })
            .collect();
        let (mut header, body) = list(ResultType::Boxes3d, &boxes);
        header.space = Space::World as u32;
        said.push(("boxes3d", header, body));
        let mut pose: Odometry = Zeroable::zeroed();
        pose.pose = cloud.header.world_from_sensor;
        let (header, body) = list(ResultType::Odometry, &[pose]);
        said.push(("odometry", header, body));
    }
    said
}

/// All frames of the recording's inputs, and no result.
fn empty(truth: &TruthRecording, program: &str, mode: Mode) -> Capture {
    let mut clock = Clock::default();
    clock.push(0, ZERO_MONO);
    clock.push(1_000_000_000, ZERO_MONO + 1_000_000_000);
    let mut frames: Vec<SentFrame> = Vec::new();
    for input in &truth.inputs {
        frames.extend(truth.sent(&input.topic).into_iter().map(|frame| SentFrame {
            published_mono_nanos: ZERO_MONO + frame.sim_nanos,
            ..frame
        }));
    }
    Capture {
        program: program.into(),
        scenario: truth.scenario.name.clone(),
        mode,
        speed: 1.0,
        added_delay_nanos: 0,
        clock,
        results: Vec::new(),
        abouts: BTreeMap::new(),
        frames,
        n_lost: 0,
        n_refused: 0,
        usage: Vec::new(),
        faults: Vec::new(),
        has_crashed: false,
        drive_recording: None,
    }
}

/// Answers every input frame with the truth, `late_ms` after it.
fn perfect(
    truth: &TruthRecording,
    file: &RecordingFile,
    about: &Scenario,
    mode: Mode,
    late_ms: u64,
) -> Capture {
    let mut capture = empty(truth, "perfect", mode);
    let field = |(i, (name, element)): (usize, &(&str, &str))| PointField {
        name: (*name).into(),
        element: (*element).into(),
        offset: i as u32 * 4,
    };
    let fields = [("x", "f32"), ("y", "f32"), ("z", "f32"), ("class", "u32")];
    capture.abouts.insert(
        "perfect/lidar_semantic".into(),
        About {
            fields: fields.iter().enumerate().map(field).collect(),
            ..About::default()
        },
    );
    let spec = Spec {
        name: "lanes".into(),
        kind: TaskKind::Lanes,
        topic: String::new(),
        input: "ego/front/rgb".into(),
        truth: "ego/front_truth".into(),
        images: String::new(),
        classes: Vec::new(),
        rules: Rules::default(),
        options: Options::default(),
    };
    let mut lanes = Lanes::new(&spec);
    let context = Context {
        scenario: about,
        spec: &spec,
        is_sealed: false,
    };
    lanes.begin(&context).unwrap();
    let topics: HashSet<Arc<str>> = truth
        .topics
        .iter()
        .map(|topic| topic.as_str().into())
        .collect();
    let mut ticks = TickReader::new(file, (0, u64::MAX), &topics).unwrap();
    let sensor_of: BTreeMap<&str, &str> = TASKS.into_iter().collect();
    while let Some(set) = ticks.next_tick().unwrap() {
        let mut moment = Moment::new(&set, about.carrier_id, &["ego/front_truth".into()]);
        moment.is_query = true;
        for (task, mut header, body) in answers(&set, &moment, &lanes) {
            let own = format!("ego/{}/", sensor_of[task]);
            let frame = capture
                .frames
                .iter()
                .find(|frame| frame.tick == set.tick && frame.topic.starts_with(&own));
            let Some(frame) = frame else { continue };
            let mut input = InputRecord::new(&frame.topic);
            (input.tick, input.sim_nanos) = (set.tick, set.sim_nanos);
            (header.tick, header.sim_nanos) = (set.tick, set.sim_nanos);
            let at = frame.published_mono_nanos + late_ms * 1_000_000;
            header.published_mono_nanos = at;
            capture.results.push(CapturedResult {
                topic: format!("perfect/{task}").into(),
                header,
                body: Body::Held(body.into()),
                inputs: vec![input],
                held_mono_nanos: at,
            });
        }
    }
    capture
}

fn of<'a>(run: &'a Run, task: &str) -> &'a TaskScore {
    let found = run.scores.iter().find(|score| score.task == task);
    found.unwrap_or_else(|| panic!("{task} was not scored"))
}

#[test]
fn the_truth_itself_is_perfect_and_late_it_is_not() {
    let sandbox = Sandbox::new("perceptionscores");
    let suite = suite(&all_tasks());
    let scenarios = consumer_perception::scenario::scenarios(&suite).unwrap();
    let mut launch = scenarios[0].launch_with_truth(&suite).unwrap();
    // The recorder of the tests lets the world run by itself, held by lockstep.
    let world = launch["scenario"].as_table_mut().unwrap();
    world.insert("mode".into(), "free_running".into());
    record_drive(&sandbox, &toml::to_string(&launch).unwrap(), 70);
    let path = sandbox.path("drive.mcap");
    let options = truth_pass::Options {
        cache_limit_bytes: u64::MAX,
        cache: sandbox.path("cache"),
        adapter: None,
        stall: Duration::from_secs(60),
        build: "test".into(),
    };
    let truth = truth_pass::of_file(&path, &suite, &options).unwrap();
    let file = RecordingFile::open(&path).unwrap();
    let about = scenario(&file, "drive", 0, "", Some("ego")).unwrap();
    let captures = [
        perfect(&truth, &file, &about, Mode::Offline, 5),
        perfect(&truth, &file, &about, Mode::Streaming, 30),
        empty(&truth, "silent", Mode::Offline),
        empty(&truth, "silent", Mode::Streaming),
    ];
    let out = sandbox.path("report");
    let mut scorer = Scorer::new(&suite).unwrap();
    scorer.add(&truth, &captures, &out).unwrap();
    let finished = scorer.finish();
    assert_eq!(finished.runs.len(), 4);
    let [offline, streaming, silent, silent_streaming] = &finished.runs[..] else {
        panic!("four runs");
    };
    assert_eq!(offline.faults, [""; 0]);
    for (task, metric, value, slack) in [
        ("boxes2d", "AP", 1.0, 1e-9),
        ("masks", "AP", 1.0, 1e-9),
        ("semantic", "mIoU", 1.0, 1e-9),
        ("depth", "AbsRel", 0.0, 1e-9),
        // Disparity and depth go through f32.
        ("stereo", "D1", 0.0, 1e-9),
        ("stereo", "EPE", 0.0, 1e-4),
        ("flow", "Fl", 0.0, 1e-9),
        ("flow", "EPE", 0.0, 1e-9),
        ("event_flow", "EPE", 0.0, 1e-9),
        ("tracking", "HOTA", 1.0, 1e-9),
        ("tracking", "IDF1", 1.0, 1e-9),
        ("boxes3d", "mAP", 1.0, 1e-9),
        ("boxes3d", "NDS", 1.0, 1e-4),
        ("lidar_semantic", "mIoU", 1.0, 1e-9),
        ("odometry", "ATE", 0.0, 1e-6),
        ("lanes", "F1", 1.0, 1e-9),
    ] {
        let score = of(offline, task);
        let found = score.offline.get(metric).copied();
        let found = found.unwrap_or_else(|| panic!("{task} has no {metric}: {score:?}"));
        assert!((found - value).abs() <= slack, "{task} {metric}: {found}");
        assert!(score.n_scored > 0, "{task}");
        // What a program answers in real time is as right as in lockstep, where it is asked.
        let again = of(streaming, task).offline[metric];
        assert!(
            (again - value).abs() <= slack,
            "{task} {metric} in time: {again}"
        );
    }
    // The vehicle drives, so what was true 30 to 130 ms ago is not true any more.
    for (task, metric) in [
        ("semantic", "mIoU"),
        ("depth", "AbsRel"),
        ("flow", "EPE"),
        ("odometry", "ATE/max"),
    ] {
        let score = of(streaming, task);
        let late = score.streaming.get(metric);
        let late = *late.unwrap_or_else(|| panic!("{task} has no {metric}: {:?}", score.streaming));
        let right = of(offline, task).offline[metric];
        let is_worse = if metric == "mIoU" {
            late < right
        } else {
            late > right
        };
        assert!(is_worse, "{task} {metric}: {late} in time, {right} at all");
        assert_eq!(score.curve.len(), 3);
    }
    let depth: Vec<f64> = of(streaming, "depth")
        .curve
        .iter()
        .map(|point| point.value)
        .collect();
    assert!(depth[0] < depth[1] && depth[1] < depth[2], "{depth:?}");
    for (task, metric, value) in [
        ("boxes2d", "AP", 0.0),
        ("semantic", "mIoU", 0.0),
        ("stereo", "D1", 100.0),
        ("flow", "Fl", 100.0),
        ("tracking", "HOTA", 0.0),
        ("boxes3d", "mAP", 0.0),
        ("lanes", "F1", 0.0),
    ] {
        let found = of(silent, task).offline.get(metric).copied().unwrap_or(0.0);
        assert_eq!(found, value, "{task} {metric} of who says nothing");
    }
    let counts = &silent_streaming.counts;
    assert_eq!(counts.miss, counts.n_queries);
    assert!(counts.n_frames > 0 && counts.n_answered == 0 && counts.n_results == 0);
    let counts = &offline.counts;
    assert_eq!(
        (counts.n_invented, counts.n_repeated, counts.n_unreadable),
        (0, 0, 0)
    );
    driven(&truth, &path, &options);
    // Pictures of what is missed lie beside the report.
    let worst = &silent.scenarios[0].worst;
    assert!(
        worst.iter().any(|worst| worst.task == "boxes2d"),
        "{worst:?}"
    );
    for frame in worst {
        for picture in [&frame.truth_image, &frame.result_image] {
            let bytes = std::fs::read(out.join(picture)).unwrap();
            assert!(bytes.starts_with(&[0xff, 0xd8]), "{picture}");
        }
    }
    assert!(
        finished
            .files
            .coco
            .iter()
            .any(|files| files.task == "boxes2d")
    );
    for files in &finished.files.coco {
        assert_eq!(files.results.len(), 4, "{}", files.task);
        assert!(!files.truths.is_empty() && !files.images.is_empty());
    }
}

/// The same recording as a program's own drive: its way along the lanes is the way of the vehicle.
fn driven(truth: &TruthRecording, path: &Path, options: &truth_pass::Options) {
    let suite = suite(
        "[[task]]\nkind = \"driving\"\noptions = { route_m = 1000.0 }\n[program.driver]\ncmd = [\"driver\"]\n",
    );
    let scenarios = consumer_perception::scenario::scenarios(&suite).unwrap();
    let nothing = truth_pass::of_closed_loop(&suite, &scenarios[0], options).unwrap();
    let mut capture = empty(truth, "driver", Mode::Streaming);
    capture.drive_recording = Some(path.to_owned());
    let mut scorer = Scorer::new(&suite).unwrap();
    scorer
        .add(&nothing, &[capture], Path::new("/nowhere"))
        .unwrap();
    let runs = scorer.finish().runs;
    assert_eq!(runs[0].faults, [""; 0]);
    let score = of(&runs[0], "driving");
    let file = RecordingFile::open(path).unwrap();
    let about = scenario(&file, "drive", 0, "", Some("ego")).unwrap();
    let mut ticks = TickReader::new(&file, (0, u64::MAX), &HashSet::new()).unwrap();
    let (mut way_m, mut before) = (0.0, None);
    while let Some(set) = ticks.next_tick().unwrap() {
        let world = set.world.unwrap();
        let ego = world.record(about.carrier_id).unwrap();
        let [x, y, _] = ego.world_from_actor.translation_m;
        if let Some((x0, y0)) = before.replace((x, y)) {
            way_m += f64::hypot(x - x0, y - y0);
        }
    }
    assert!(way_m > 5.0, "the vehicle drove {way_m} m");
    let completed = score.streaming["route_completion"] * 1000.0;
    assert!(
        (completed - way_m).abs() < 0.03 * way_m,
        "{completed} of {way_m} m"
    );
    assert_eq!(score.streaming["collisions"], 0.0);
    assert!(score.streaming["driving_score"] > 0.0);
}
