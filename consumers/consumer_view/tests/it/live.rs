//! The viewer on a real bus: a made-up drive is published, stopped and published anew, and each run
//! becomes a complete file.

#[path = "../../examples/sample/mod.rs"]
mod sample;

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use consumer_view::look::{Images, Look};
use consumer_view::session::{Options, Shown, Target, show};
use schema_bus::{Bus, BusOptions, FrameTopic, names};
use schema_frames::{FrameHeader, SnapshotHeader};

/// Publishes ticks of one run until `enough`.
fn publish(options: &BusOptions, epoch: u64, mut enough: impl FnMut() -> bool) {
    let bus = Bus::open_with("test", "daemon", options).unwrap();
    let publisher = |modality| {
        let spec = FrameTopic::new(modality, sample::frame(modality, 1).1.len() * 2 + 100_000);
        (
            modality,
            bus.frame_publisher(&sample::topic(modality), spec).unwrap(),
        )
    };
    let topics = sample::MODALITIES.map(publisher);
    let snapshots = bus.snapshot_publisher(16).unwrap();
    let mut events = vec![bus.notifier(&names::rig_tick("ego")).unwrap()];
    for (_, publisher) in &topics {
        events.push(bus.notifier(publisher.topic()).unwrap());
    }
    let mut actors = bus.document_publisher(names::WORLD_ACTORS).unwrap();
    actors.send_json(&sample::actors(), epoch, 0).unwrap();
    let mut tick = 0;
    while !enough() {
        tick += 1;
        let (header, records) = sample::snapshot(tick);
        snapshots
            .send(SnapshotHeader { epoch, ..header }, &records)
            .unwrap();
        for (modality, publisher) in topics
            .iter()
            .filter(|(_, publisher)| publisher.n_readers() > 0)
        {
            let (header, payload) = sample::frame(*modality, tick);
            let mut loan = publisher.loan(payload.len()).unwrap();
            loan.payload_mut().copy_from_slice(&payload);
            *loan.header_mut() = FrameHeader { epoch, ..header };
            loan.send().unwrap();
        }
        events.iter().for_each(|event| {
            event.notify_listeners();
        });
        actors.greet();
        snapshots.greet();
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn assert_is_rrd(path: &Path) {
    let bytes = std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    assert!(
        bytes.starts_with(b"RRF2"),
        "{} begins with {:?}",
        path.display(),
        &bytes[..4.min(bytes.len())]
    );
    assert!(
        bytes.len() > 40_000,
        "{} has only {} bytes",
        path.display(),
        bytes.len()
    );
}

/// Size of a file in which every topic is, coded or raw.
fn least_bytes(images: Images) -> u64 {
    match images {
        Images::Raw => 300_000,
        _ => 60_000,
    }
}

#[test]
fn every_topic_is_shown_and_a_restarted_simulator_gets_a_new_recording() {
    for images in [Images::Jpeg, Images::H264, Images::Raw] {
        view_two_runs(images);
    }
}

fn view_two_runs(images: Images) {
    let folder = format!("gantry-view-live-{}-{images:?}", std::process::id());
    let folder = std::env::temp_dir().join(folder);
    std::fs::create_dir_all(&folder).unwrap();
    let bus = BusOptions {
        iceoryx_root: Some(folder.join("iox")),
        prefix: Some(format!("gv{}_", std::process::id())),
    };
    let target = Target::Save(folder.join("drive.rrd"));
    let options = Options {
        domain: "test".into(),
        bus: bus.clone(),
        max_hz: 20.0,
        look: Look {
            images,
            ..Look::default()
        },
        topics: Vec::new(),
        enough: None,
        spectator: false,
        target: target.clone(),
    };
    let stop = AtomicBool::new(false);
    let deadline = Instant::now() + Duration::from_secs(60);
    let shown: Shown = std::thread::scope(|scope| {
        let viewer = scope.spawn(|| show(&options, &mut || stop.load(Ordering::Acquire)));
        let n_calls = AtomicU64::new(0);
        let first_file = folder.join("drive.rrd");
        // A file grows in steps of what is flushed; some seconds of ticks make enough to see it
        // grow.
        publish(&bus, 11, || {
            n_calls.fetch_add(1, Ordering::Relaxed);
            assert!(Instant::now() < deadline, "nothing was written");
            n_calls.load(Ordering::Relaxed) > 150
                && std::fs::metadata(&first_file).is_ok_and(|file| file.len() > least_bytes(images))
        });
        let second_file = folder.join("drive.2.rrd");
        n_calls.store(0, Ordering::Relaxed);
        publish(&bus, 22, || {
            n_calls.fetch_add(1, Ordering::Relaxed);
            assert!(Instant::now() < deadline, "the second run was not shown");
            n_calls.load(Ordering::Relaxed) > 100
                && std::fs::metadata(&second_file)
                    .is_ok_and(|file| file.len() > least_bytes(images))
        });
        stop.store(true, Ordering::Release);
        viewer.join().unwrap().unwrap()
    });
    assert_eq!(shown.n_runs, 2);
    assert_eq!(
        shown.frames.len(),
        sample::MODALITIES.len(),
        "{:?}",
        shown.frames
    );
    assert_is_rrd(&folder.join("drive.rrd"));
    assert_is_rrd(&folder.join("drive.2.rrd"));
    let again = show(
        &Options {
            target,
            ..options.clone()
        },
        &mut || true,
    );
    assert!(again.unwrap_err().to_string().contains("exists already"));
    std::fs::remove_dir_all(&folder).unwrap();
}
