//! Results of users' programs in the viewer: where each type is drawn, and that broken ones are only
//! counted.

#[path = "../../../consumer_record/tests/it/sample/results.rs"]
mod sample;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use consumer_kit::items::ResultParts;
use consumer_view::look::Look;
use consumer_view::rerun;
use consumer_view::session::{Options, Target, show};
use consumer_view::stage::Stage;
use rerun::log::{Chunk, LogMsg};
use rerun::{RecordingStreamBuilder, StoreKind};
use schema_bus::{Bus, BusOptions, FrameTopic};
use schema_frames::{About, FrameHeader, InputRecord, Modality, ResultHeader, ResultType};

/// A stage in memory that has shown one frame of a camera.
struct Shown {
    stage: Stage,
    storage: rerun::sink::MemorySinkStorage,
}

impl Shown {
    fn new() -> Shown {
        let (rec, storage) = RecordingStreamBuilder::new("test").memory().unwrap();
        let mut stage = Stage::new(rec, Look::default()).unwrap();
        stage.set_topics(["ego/front/rgb"]).unwrap();
        let mut header = FrameHeader::new(Modality::Rgb);
        header.set_image(8, 6);
        (header.tick, header.sim_nanos) = (10, 500_000_000);
        header.intrinsics_px = [4.0, 4.0, 4.0, 3.0];
        stage
            .show_frame("ego/front/rgb", &header, &[0; 8 * 6 * 4], 1000)
            .unwrap();
        Shown { stage, storage }
    }

    fn result(&mut self, kind: ResultType, body: &[u8], input: &str, about: &About) {
        let mut header = ResultHeader::new(kind);
        sample::describe(&mut header, kind, body.len());
        (header.tick, header.sim_nanos) = (10, 500_000_000);
        header.payload_bytes = ResultHeader::payload_for(header.body_bytes, 0);
        let topic = sample::topic(kind);
        header.check(header.payload_bytes as usize).unwrap();
        let inputs = match input {
            "" => vec![],
            input => vec![InputRecord::new(input)],
        };
        let parts = ResultParts {
            topic: &topic,
            header: &header,
            kind,
            body,
            inputs: &inputs,
            about,
        };
        self.stage.show_result(&parts, 1000).unwrap();
    }

    /// By entity: the archetypes that were logged, and the ticks at which they were.
    fn entities(&self) -> BTreeMap<String, (BTreeSet<String>, BTreeSet<i64>)> {
        self.stage.flush(Duration::from_secs(20)).unwrap();
        let mut entities: BTreeMap<String, (BTreeSet<String>, BTreeSet<i64>)> = BTreeMap::new();
        for message in self.storage.take() {
            let LogMsg::ArrowMsg(store, message) = message else {
                continue;
            };
            if store.kind() != StoreKind::Recording {
                continue;
            }
            let chunk = Chunk::from_arrow_msg(&message).unwrap();
            let entry = entities.entry(chunk.entity_path().to_string()).or_default();
            for component in chunk.component_descriptors() {
                let archetype = component
                    .archetype
                    .map(|name| name.short_name().to_string());
                entry.0.extend(archetype);
            }
            for (name, times) in chunk.timelines() {
                if name.as_str() == "tick" {
                    entry.1.extend(times.times_raw());
                }
            }
        }
        entities
    }
}

#[test]
fn every_type_is_drawn_where_it_belongs() {
    let mut shown = Shown::new();
    for kind in ResultType::ALL.iter().copied() {
        // Tracks answer the boxes, which answer the camera.
        let input = match kind {
            ResultType::Tracks => sample::topic(ResultType::Boxes2d),
            _ => "ego/front/rgb".to_string(),
        };
        shown.result(kind, &sample::body(kind, 10), &input, &sample::about(kind));
    }
    let entities = shown.entities();
    let camera = "/world/ego/front/rgb/user";
    let expected = [
        (format!("{camera}/boxes2d"), "Boxes2D"),
        (format!("{camera}/boxes2d"), "AnnotationContext"),
        (format!("{camera}/tracks"), "Boxes2D"),
        (format!("{camera}/masks/pixels"), "EncodedImage"),
        (format!("{camera}/masks"), "Boxes2D"),
        (format!("{camera}/keypoints"), "Points2D"),
        (format!("{camera}/keypoints/bones"), "LineStrips2D"),
        ("/world/results/user/boxes3d".into(), "Transform3D"),
        ("/world/results/user/boxes3d/boxes".into(), "Boxes3D"),
        ("/world/results/user/boxes3d/velocities".into(), "Arrows3D"),
        ("/world/results/user/tracks/boxes".into(), "Boxes3D"),
        ("/world/results/user/points/points".into(), "Points3D"),
        ("/world/results/user/pose/pose".into(), "TransformAxes3D"),
        ("/world/results/user/odometry/pose".into(), "Transform3D"),
        ("/world/trails/user/pose".into(), "LineStrips3D"),
        ("/world/results/user/path/path".into(), "LineStrips3D"),
        ("/results/user/image".into(), "EncodedImage"),
        ("/results/user/flow".into(), "EncodedImage"),
        ("/results/user/depth".into(), "EncodedDepthImage"),
        ("/results/user/semantic".into(), "SegmentationImage"),
        ("/results/user/instance".into(), "EncodedImage"),
        ("/results/user/tensor".into(), "Tensor"),
        ("/results/user/tensor/histogram".into(), "BarChart"),
        ("/results/user/scalars/speed_mps".into(), "Scalars"),
        ("/results/user/control/throttle".into(), "Scalars"),
        ("/results/user/json".into(), "TextDocument"),
        ("/logs/user/text".into(), "TextLog"),
        ("/logs/user/bytes".into(), "TextLog"),
        ("/plots/latency/user/boxes2d".into(), "Scalars"),
    ];
    for (path, archetype) in expected {
        let found = entities
            .get(&path)
            .unwrap_or_else(|| panic!("{path} is missing"));
        assert!(found.0.contains(archetype), "{path}: {:?}", found.0);
        if archetype != "AnnotationContext" {
            assert!(found.1.contains(&10), "{path} at {:?}", found.1);
        }
    }
    assert!(
        shown.stage.bad_items().is_empty(),
        "{:?}",
        shown.stage.bad_items()
    );
}

#[test]
fn boxes_of_an_unknown_camera_get_a_view_of_their_own() {
    let mut shown = Shown::new();
    let kind = ResultType::Boxes2d;
    shown.result(kind, &sample::body(kind, 1), "", &About::default());
    let entities = shown.entities();
    assert!(entities["/results/user/boxes2d"].0.contains("Boxes2D"));
}

#[test]
fn what_cannot_be_drawn_is_counted_and_the_rest_is_drawn() {
    let mut shown = Shown::new();
    let kinds: Vec<ResultType> = ResultType::ALL
        .iter()
        .copied()
        .filter(|kind| sample::garbage(*kind).is_some())
        .collect();
    for _ in 0..2 {
        for kind in &kinds {
            let body = sample::garbage(*kind).unwrap();
            shown.result(*kind, &body, "ego/front/rgb", &About::default());
        }
    }
    let bad: Vec<(&str, u64)> = shown
        .stage
        .bad_items()
        .iter()
        .map(|(topic, n)| (topic.as_str(), *n))
        .collect();
    let expected = [
        ("user/boxes2d", 2),
        ("user/json", 2),
        ("user/masks", 2),
        ("user/text", 2),
        ("user/tracks", 2),
    ];
    assert_eq!(bad, expected);
    let entities = shown.entities();
    assert!(
        entities.contains_key("/world/ego/front/rgb/user/tracks"),
        "its good box"
    );
}

/// Goal: no body whatever makes the viewer panic. Method: bodies of all types with bytes changed at
/// random, with a fixed seed.
#[test]
fn mutated_results_never_panic() {
    let mut shown = Shown::new();
    let mut state = 1u64;
    let mut random = |below: usize| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 33) as usize % below
    };
    for round in 0..4000 {
        let kind = ResultType::ALL[round % ResultType::ALL.len()];
        let mut body = sample::body(kind, round as u64);
        for _ in 0..random(8) {
            let at = random(body.len());
            body[at] = [0, 1, 0x7f, 0x80, 0xff][random(5)];
        }
        shown.result(kind, &body, "ego/front/rgb", &sample::about(kind));
        if round % 200 == 0 {
            drop(shown.storage.take());
        }
    }
}

#[test]
fn results_of_a_running_program_are_shown_and_garbage_is_counted() {
    let folder = std::env::temp_dir().join(format!("gantry-view-results-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let place = BusOptions {
        iceoryx_root: Some(folder.join("iox")),
        prefix: Some(format!("gvr{}_", std::process::id())),
    };
    let options = Options {
        domain: "test".into(),
        bus: place.clone(),
        max_hz: 100.0,
        look: Look::default(),
        topics: Vec::new(),
        enough: None,
        spectator: false,
        target: Target::Save(folder.join("results.rrd")),
    };
    let bus = Bus::open_with("test", "user", &place).unwrap();
    let camera = bus
        .frame_publisher("ego/front/rgb", FrameTopic::new(Modality::Rgb, 8 * 6 * 4))
        .unwrap();
    let mut eye = bus.frame_reader("ego/front/rgb").unwrap();
    let (stop, n_turns) = (AtomicBool::new(false), AtomicU64::new(0));
    let mut ends = || {
        n_turns.fetch_add(1, Ordering::AcqRel);
        stop.load(Ordering::Acquire)
    };
    let shown = std::thread::scope(|scope| {
        let viewer = scope.spawn(|| show(&options, &mut ends));
        // The writers come after the viewer, which must find them.
        std::thread::sleep(Duration::from_millis(300));
        let mut writers = sample::Writers::open(&bus);
        let deadline = Instant::now() + Duration::from_secs(120);
        while writers.n_readers() == 0 {
            std::thread::sleep(Duration::from_millis(5));
            assert!(Instant::now() < deadline, "the viewer never came");
        }
        for tick in 1..=40u64 {
            let mut loan = camera.loan(8 * 6 * 4).unwrap();
            let header = loan.header_mut();
            header.set_image(8, 6);
            (header.tick, header.seq, header.epoch) = (tick, tick, 7);
            header.sim_nanos = tick * 50_000_000;
            loan.send().unwrap();
            let frame = eye.latest().unwrap().unwrap();
            match tick <= 30 {
                true => writers.send(&frame),
                false => writers.send_garbage(&frame),
            }
            std::thread::sleep(Duration::from_millis(30));
        }
        // The newest of each topic waits for the viewer; it needs one turn to take it, and some time
        // since those before it.
        std::thread::sleep(Duration::from_secs(1));
        let n_before = n_turns.load(Ordering::Acquire);
        while n_turns.load(Ordering::Acquire) < n_before + 3 {
            std::thread::sleep(Duration::from_millis(5));
            assert!(Instant::now() < deadline, "the viewer stands still");
        }
        stop.store(true, Ordering::Release);
        viewer.join().unwrap().unwrap()
    });
    let topics: BTreeSet<&str> = shown.results.keys().map(String::as_str).collect();
    let all: Vec<String> = ResultType::ALL
        .iter()
        .map(|it| sample::topic(*it))
        .collect();
    assert_eq!(topics, all.iter().map(String::as_str).collect());
    assert!(
        shown.results.values().all(|n| *n >= 1),
        "{:?}",
        shown.results
    );
    assert_eq!(shown.bad_items.len(), 5, "{:?}", shown.bad_items);
    let bytes = std::fs::read(folder.join("results.rrd")).unwrap();
    assert!(
        bytes.starts_with(b"RRF2") && bytes.len() > 20_000,
        "{}",
        bytes.len()
    );
    std::fs::remove_dir_all(&folder).unwrap();
}
