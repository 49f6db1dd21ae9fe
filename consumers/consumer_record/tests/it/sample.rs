//! Made-up frames of every modality; each byte follows from the tick.

#![allow(dead_code, reason = "every test and the example use their part of it")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use consumer_forms::foxglove::frames::{TopicName, frame_entries};
use consumer_forms::foxglove::snapshots::{SnapshotConverter, document};
use consumer_record::files::Files;
use consumer_record::options::{Coding, Split};
use consumer_record::queue::{FrameJob, Job, Payload, queue};
use consumer_record::writer::{Target, run, start_coders};
use schema_frames::document::{DOCUMENT_MAGIC, DocumentHeader};
use schema_frames::snapshot::SNAPSHOT_MAGIC;
use schema_frames::{
    ActorKind, ActorRecord, FrameHeader, GnssSample, ImuSample, Modality, SCHEMA_VERSION,
    SnapshotHeader,
};
use schema_recording::messages::{Batch, Entry};
use schema_recording::read::{RecordingFile, Selection, What};
use schema_recording::write::{ChunkCompression, Written};
use schema_types::Pose;

/// Length of a tick.
pub const PERIOD_NANOS: u64 = 50_000_000;
/// Wall clock of tick 0.
pub const WALL_NANOS: u64 = 1_700_000_000_000_000_000;
/// Size of the pictures.
pub const SIZE_PX: [u32; 2] = [64, 48];

/// Topics of the sample.
pub fn topics() -> Vec<String> {
    let camera = [
        Modality::Rgb,
        Modality::Depth,
        Modality::Semantic,
        Modality::Instance,
        Modality::Flow,
        Modality::Dvs,
    ];
    let mut topics: Vec<String> = camera
        .iter()
        .map(|modality| format!("ego/front/{}", modality.name()))
        .collect();
    topics.extend(["ego/roof/lidar", "ego/imu/imu", "ego/gnss/gnss"].map(String::from));
    topics
}

/// Header and payload of a topic at a tick.
pub fn frame(topic: &str, tick: u64) -> (FrameHeader, Vec<u8>) {
    let modality = Modality::from_name(topic.rsplit('/').next().unwrap()).unwrap();
    let mut header = FrameHeader::new(modality);
    match modality {
        Modality::Lidar => header.set_list(100 + tick as u32),
        Modality::Dvs => header.set_list(tick as u32 * 3),
        Modality::Imu | Modality::Gnss => header.set_list(1),
        _ => header.set_image(SIZE_PX[0], SIZE_PX[1]),
    }
    header.tick = tick;
    header.sim_nanos = tick * PERIOD_NANOS;
    header.seq = tick;
    header.epoch = 77;
    header.parent_id = 7;
    header.world_from_sensor = Pose::from_xyz_yaw(tick as f64, 2.0, 1.5, 0.1);
    if modality.sensor_kind() == schema_frames::SensorKind::Camera {
        header.intrinsics_px = [50.0, 50.0, SIZE_PX[0] as f64 / 2.0, SIZE_PX[1] as f64 / 2.0];
    }
    let payload = match modality {
        Modality::Gnss => bytemuck::bytes_of(&GnssSample {
            latitude_deg: 49.0 + tick as f64 * 1e-5,
            longitude_deg: 8.0,
            altitude_m: 110.0,
            reserved: [0; 2],
        })
        .to_vec(),
        Modality::Imu => bytemuck::bytes_of(&ImuSample {
            specific_force_mps2: [0.1, 0.2, 9.81],
            angular_velocity_radps: [0.0, 0.0, tick as f64],
            compass_rad: 1.0,
            reserved: [0; 2],
        })
        .to_vec(),
        _ => (0..header.payload_bytes)
            .map(|idx| (idx * 7 + tick * 13) as u8)
            .collect(),
    };
    (header, payload)
}

fn batch(source: &str, tick: u64, entries: Vec<Entry>) -> Job {
    let (log_nanos, publish_nanos) = (tick * PERIOD_NANOS, WALL_NANOS + tick * PERIOD_NANOS);
    Job::Batch(Batch {
        source: source.into(),
        sequence: tick as u32,
        log_nanos,
        publish_nanos,
        entries,
    })
}

/// Records `n_ticks` ticks into `target` through the real queue and writer thread, payloads as they
/// are.
pub fn record(
    target: &Path,
    n_ticks: u64,
    compression: ChunkCompression,
) -> anyhow::Result<Written> {
    let files = Files::create(target, compression, Split::default())?;
    let mut written = record_to(Target::Files(Box::new(files)), n_ticks, Coding::none())?;
    Ok(written.remove(0).1)
}

/// Records `n_ticks` ticks, coded by the real threads.
pub fn record_to(
    target: Target,
    n_ticks: u64,
    coding: Coding,
) -> anyhow::Result<Vec<(PathBuf, Written)>> {
    let (queue, bench, outlet) = queue(64 << 20);
    start_coders(&bench, coding)?;
    let writer = std::thread::spawn(move || run(target, outlet));
    let push = |job: Job| {
        queue
            .push(job)
            .map_err(|refused| anyhow::anyhow!("{refused:?}"))
    };
    let text = r#"{"map":"Sample"}"#;
    let document_header = DocumentHeader {
        magic: DOCUMENT_MAGIC,
        schema_version: SCHEMA_VERSION,
        epoch: 77,
        revision: 1,
        payload_bytes: text.len() as u64,
        ..bytemuck::Zeroable::zeroed()
    };
    push(batch(
        "world/info",
        0,
        vec![document("world/info", &document_header, text)],
    ))?;
    push(Job::Attach {
        name: "Sample.xodr".into(),
        media_type: "application/xml",
        data: b"<OpenDRIVE/>".to_vec(),
        log_nanos: 0,
    })?;
    push(Job::Metadata {
        name: "gantry".into(),
        pairs: [("domain".to_string(), "sample".to_string())].into(),
    })?;
    let mut scene = SnapshotConverter::default();
    for tick in 1..=n_ticks {
        let header = SnapshotHeader {
            magic: SNAPSHOT_MAGIC,
            schema_version: SCHEMA_VERSION,
            header_bytes: 128,
            tick,
            sim_nanos: tick * PERIOD_NANOS,
            n_actors: 1,
            ..bytemuck::Zeroable::zeroed()
        };
        let ego = ActorRecord {
            id: 7,
            kind: ActorKind::Vehicle as u16,
            class: 14,
            world_from_actor: Pose::from_xyz_yaw(tick as f64, 2.0, 0.0, 0.1),
            half_box_m: [2.0, 1.0, 0.8],
            velocity_in_world_mps: [20.0, 0.0, 0.0],
            ..bytemuck::Zeroable::zeroed()
        };
        push(batch(
            "world/snapshot",
            tick,
            scene.snapshot_entries(&header, &[ego]),
        ))?;
        for topic in topics() {
            let (header, payload) = frame(&topic, tick);
            let name = TopicName::new(&topic).unwrap();
            let extras = scene.frame_extras(&name, &header);
            if coding.is_plain() {
                let mut entries = frame_entries(&name, &header, &payload, &mut |n| queue.buffer(n));
                entries.extend(extras);
                push(batch(&topic, tick, entries))?;
                continue;
            }
            let Job::Batch(batch) = batch(&topic, tick, extras) else {
                unreachable!("batch() makes a batch")
            };
            push(Job::Frame(Box::new(FrameJob {
                batch,
                name: name.into(),
                header,
                payload: Payload::Copied(payload),
            })))?;
        }
    }
    drop(queue);
    writer.join().expect("the writer does not panic")
}

/// Every frame of a recording by topic and tick: header and decoded payload.
pub fn frames_of(path: &Path) -> BTreeMap<(String, u64), (FrameHeader, Vec<u8>)> {
    let file = RecordingFile::open(path).unwrap();
    let mut samples = file.samples(&Selection::default());
    let mut found = BTreeMap::new();
    while let Some(sample) = samples.next().unwrap() {
        if let What::Frame {
            topic,
            header,
            mut payload,
        } = sample.what
        {
            let bytes = payload.to_vec().unwrap();
            found.insert((topic.to_string(), header.tick), (header, bytes));
        }
    }
    assert_eq!(samples.damage().total(), 0, "{:?}", samples.damage());
    found
}

/// Every frame of these ticks is in the file, whole.
pub fn assert_frames(path: &Path, ticks: std::ops::RangeInclusive<u64>) {
    let found = frames_of(path);
    for (tick, topic) in ticks.flat_map(|tick| topics().into_iter().map(move |it| (tick, it))) {
        let (header, payload) = frame(&topic, tick);
        let (kept, bytes) = found
            .get(&(topic.clone(), tick))
            .unwrap_or_else(|| panic!("{topic} of tick {tick} is missing"));
        assert_eq!(
            kept.hashed_bytes(),
            header.hashed_bytes(),
            "{topic} of tick {tick}"
        );
        assert!(*bytes == payload, "the payload of {topic} of tick {tick}");
    }
}
