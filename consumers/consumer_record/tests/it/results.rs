//! Results of users' programs in a recording: every byte comes back, other programs can show what
//! they know, and broken items are only counted.

#[path = "sample/results.rs"]
mod sample;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use consumer_record::options::{Coding, Options};
use consumer_record::select::Select;
use consumer_record::session::{Report, record};
use foxglove::Decode as _;
use foxglove::messages as fox;
use schema_bus::{Bus, BusOptions, FrameTopic};
use schema_frames::{InputRecord, Modality, ResultHeader, ResultType};
use schema_recording::wire::{Value, bytes_field, fields};
use schema_recording::write::ChunkCompression;

const PERIOD_NANOS: u64 = 50_000_000;
const N_TICKS: u64 = 20;

/// Records what all writers publish in [`N_TICKS`] ticks, and then garbage `n_garbage` times.
fn recorded(folder: &Path, topics: &[&str], n_garbage: u64) -> Report {
    let bus = BusOptions {
        iceoryx_root: Some(folder.join("iox")),
        prefix: Some(format!(
            "gr{}{n_garbage}{}_",
            std::process::id(),
            topics.len()
        )),
    };
    let options = Options {
        domain: "test".into(),
        bus: bus.clone(),
        select: Select {
            topics: topics.iter().map(|it| it.to_string()).collect(),
            ..Default::default()
        },
        out: folder.join("results.mcap"),
        compression: ChunkCompression::Lz4,
        queue_bytes: 64 << 20,
        lockstep: false,
        coding: Coding::none(),
        ..Options::new("test", "unused".into())
    };
    let bus = Bus::open_with("test", "user", &bus).unwrap();
    let camera = bus
        .frame_publisher("ego/front/rgb", FrameTopic::new(Modality::Rgb, 8 * 6 * 4))
        .unwrap();
    let mut eye = bus.frame_reader("ego/front/rgb").unwrap();
    let mut writers = sample::Writers::open(&bus);
    let stop = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let recorder = scope.spawn(|| record(&options, &|| stop.load(Ordering::Acquire)));
        let deadline = Instant::now() + Duration::from_secs(60);
        let is_there = || match topics.is_empty() {
            true => writers.n_readers() > 0,
            false => writers.n_readers_of(ResultType::Boxes3d) > 0,
        };
        while !is_there() {
            std::thread::sleep(Duration::from_millis(5));
            assert!(Instant::now() < deadline, "the recorder never came");
        }
        for tick in 1..=N_TICKS + n_garbage {
            let mut loan = camera.loan(8 * 6 * 4).unwrap();
            let header = loan.header_mut();
            header.set_image(8, 6);
            (header.tick, header.seq, header.epoch) = (tick, tick, 7);
            header.sim_nanos = tick * PERIOD_NANOS;
            loan.send().unwrap();
            let frame = eye.latest().unwrap().unwrap();
            match tick <= N_TICKS {
                true => writers.send(&frame),
                false => writers.send_garbage(&frame),
            }
            // The topics' buffers hold all of them, so that nothing is lost on a slow machine.
            std::thread::sleep(Duration::from_millis(5));
        }
        stop.store(true, Ordering::Release);
        recorder.join().unwrap().unwrap()
    })
}

/// All messages of a file: by channel and tick, with schema and encoding.
struct Messages(BTreeMap<(String, u64), (String, String, Vec<u8>)>);

impl Messages {
    fn read(path: &Path) -> Messages {
        let bytes = std::fs::read(path).unwrap();
        let mut messages = BTreeMap::new();
        for message in mcap::MessageStream::new(&bytes).unwrap() {
            let message = message.unwrap();
            let schema = message.channel.schema.as_ref().unwrap().name.clone();
            messages.insert(
                (
                    message.channel.topic.clone(),
                    message.log_time / PERIOD_NANOS,
                ),
                (
                    schema,
                    message.channel.message_encoding.clone(),
                    message.data.to_vec(),
                ),
            );
        }
        Messages(messages)
    }

    /// The message of tick 10 on `/user/<kind>`.
    fn shown(&self, kind: ResultType) -> (&str, &[u8]) {
        let found = self.0.get(&(format!("/{}", sample::topic(kind)), 10));
        let (schema, _, data) = found.unwrap_or_else(|| panic!("{kind:?} is missing"));
        (schema, data)
    }

    fn decoded<M: fox_message::Message>(&self, kind: ResultType) -> M {
        let (_, data) = self.shown(kind);
        M::decoded(data)
    }
}

/// Foxglove's messages have no common trait that decodes without their buffer type.
mod fox_message {
    pub trait Message {
        fn decoded(data: &[u8]) -> Self;
    }
    macro_rules! messages {
        ($($name:ident)*) => {$(
            impl Message for foxglove::messages::$name {
                fn decoded(data: &[u8]) -> Self {
                    <Self as foxglove::Decode>::decode(data).unwrap()
                }
            }
        )*};
    }
    messages!(ImageAnnotations SceneUpdate PosesInFrame PointCloud RawImage Log Odometry);
}

#[test]
fn every_result_comes_back_byte_for_byte_and_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    let report = recorded(folder.path(), &[], 0);
    let lost: Vec<&String> = report
        .lost
        .keys()
        .filter(|it| it.starts_with("user/"))
        .collect();
    assert!(lost.is_empty(), "{:?}", report.lost);
    assert!(report.bad_items.is_empty(), "{:?}", report.bad_items);
    let file = Messages::read(&folder.path().join("results.mcap"));
    for kind in ResultType::ALL.iter().copied() {
        let channel = format!("/{}", sample::topic(kind));
        let n = file
            .0
            .keys()
            .filter(|(topic, _)| *topic == format!("{channel}/gantry"));
        assert_eq!(n.count() as u64, N_TICKS, "{channel}");
        for tick in 1..=N_TICKS {
            let (schema, _, result) = &file.0[&(format!("{channel}/gantry"), tick)];
            assert_eq!(schema, "gantry.Result");
            let header: ResultHeader =
                bytemuck::pod_read_unaligned(bytes_field(result, 4).unwrap());
            assert_eq!((header.tick, header.kind()), (tick, Some(kind)));
            let input: InputRecord = bytemuck::pod_read_unaligned(bytes_field(result, 7).unwrap());
            let answered = match kind {
                ResultType::Tracks => sample::topic(ResultType::Boxes2d),
                _ => "ego/front/rgb".to_string(),
            };
            assert_eq!((input.topic(), input.tick), (answered, tick), "{kind:?}");
            let body = match bytes_field(result, 6) {
                None => bytes_field(result, 5).unwrap_or_default().to_vec(),
                Some(elsewhere) => {
                    assert_eq!(elsewhere, channel.as_bytes());
                    let (schema, encoding, data) = &file.0[&(channel.clone(), tick)];
                    match (schema.starts_with("foxglove."), encoding.as_str()) {
                        (true, _) => {
                            bytes_field(data, consumer_forms::foxglove::frames::DATA_FIELD)
                                .unwrap()
                                .to_vec()
                        }
                        (false, _) => data.clone(),
                    }
                }
            };
            assert_eq!(body, sample::body(kind, tick), "{kind:?} of tick {tick}");
        }
    }
    for kind in [
        ResultType::Boxes2d,
        ResultType::Keypoints,
        ResultType::Bytes,
    ] {
        let about = format!("/{}/about", sample::topic(kind));
        let (_, (schema, _, document)) = file
            .0
            .iter()
            .find(|((topic, _), _)| *topic == about)
            .unwrap();
        assert_eq!(schema, "gantry.Document");
        let text = std::str::from_utf8(bytes_field(document, 4).unwrap()).unwrap();
        let found: schema_frames::About = serde_json::from_str(text).unwrap();
        assert_eq!(found, sample::about(kind));
    }
    what_others_see(&file);
}

/// The messages of tick 10 as other programs read them.
fn what_others_see(file: &Messages) {
    let boxes: fox::ImageAnnotations = file.decoded(ResultType::Boxes2d);
    assert_eq!((boxes.points.len(), boxes.texts.len()), (2, 2));
    assert_eq!(boxes.texts[0].text, "car 0.75");
    let corner = boxes.points[0].points[2];
    assert_eq!((corner.x, corner.y), (5.0, 4.5));

    let masks: fox::ImageAnnotations = file.decoded(ResultType::Masks);
    let line = masks.points.last().unwrap();
    let ends: Vec<(f64, f64)> = line.points.iter().map(|it| (it.x, it.y)).collect();
    assert_eq!(
        ends,
        [(1.5, 1.0), (1.5, 4.0)],
        "the second column, rows 1 to 3"
    );

    let bones: fox::ImageAnnotations = file.decoded(ResultType::Keypoints);
    let n_ends: Vec<usize> = bones.points.iter().map(|it| it.points.len()).collect();
    assert_eq!(
        n_ends,
        [3, 4],
        "three points and the two bones whose ends are there"
    );

    let solids: fox::SceneUpdate = file.decoded(ResultType::Boxes3d);
    let cube = &solids.entities[0].cubes[0];
    assert_eq!(cube.pose.unwrap().position.unwrap().x, 10.0);
    assert_eq!(cube.size.unwrap().x, 4.0);
    let (schema, _, tracks) = &file.0[&("/user/tracks/space".to_string(), 10)];
    assert_eq!(schema, "foxglove.SceneUpdate");
    let tracks = fox::SceneUpdate::decode(tracks.as_slice()).unwrap();
    assert_eq!(tracks.entities[0].texts[0].text, "Car 0.90 #5");

    let path: fox::SceneUpdate = file.decoded(ResultType::Path);
    assert_eq!(path.entities[0].lines[0].points.len(), 3);
    let poses: fox::PosesInFrame = file.decoded(ResultType::Pose);
    assert_eq!((poses.frame_id.as_str(), poses.poses.len()), ("map", 1));
    let odometry: fox::Odometry = file.decoded(ResultType::Odometry);
    assert_eq!(odometry.linear_velocity.unwrap().x, 3.0);
    let cloud: fox::PointCloud = file.decoded(ResultType::Points);
    assert_eq!((cloud.point_stride, cloud.fields.len()), (16, 4));
    let image: fox::RawImage = file.decoded(ResultType::Image);
    assert_eq!((image.encoding.as_str(), image.step), ("rgb8", 24));
    let log: fox::Log = file.decoded(ResultType::Text);
    assert_eq!(
        (log.message.as_str(), log.name.as_str()),
        ("tick 10", "user/text")
    );

    let json = |kind| -> serde_json::Value { serde_json::from_slice(file.shown(kind).1).unwrap() };
    assert_eq!(json(ResultType::Json)["tick"], 10);
    assert_eq!(json(ResultType::Scalars)["values"]["speed_mps"], 10.0);
    assert_eq!(
        json(ResultType::Control)["vehicles"][0]["throttle_ratio"],
        0.25
    );
    let tensor = json(ResultType::Tensor);
    assert_eq!(tensor["shape"], serde_json::json!([2, 3, 4]));
    assert_eq!(
        (&tensor["min"], &tensor["max"]),
        (&10.0.into(), &33.0.into())
    );

    let (schema, data) = file.shown(ResultType::Bytes);
    assert_eq!(schema, "user.Detection");
    let score = fields(data).find_map(|(number, value)| match (number, value) {
        (2, Value::Fixed64(bits)) => Some(f64::from_bits(bits)),
        _ => None,
    });
    assert_eq!(score, Some(0.5));
}

#[test]
fn broken_items_are_counted_and_kept_losslessly() {
    let folder = tempfile::tempdir().unwrap();
    let report = recorded(folder.path(), &[], 3);
    let lost: Vec<&String> = report
        .lost
        .keys()
        .filter(|it| it.starts_with("user/"))
        .collect();
    assert!(lost.is_empty(), "{:?}", report.lost);
    let bad: BTreeMap<&str, u64> = report
        .bad_items
        .iter()
        .map(|(topic, n)| (topic.as_str(), *n))
        .collect();
    let expected = [
        ("user/boxes2d", 3),
        ("user/json", 3),
        ("user/masks", 3),
        ("user/text", 3),
        ("user/tracks", 3),
    ];
    assert_eq!(bad, expected.into());
    let file = Messages::read(&folder.path().join("results.mcap"));
    let (_, _, lossless) = &file.0[&("/user/boxes2d/gantry".to_string(), N_TICKS + 3)];
    let kept = bytes_field(lossless, 5).unwrap();
    assert_eq!(Some(kept.to_vec()), sample::garbage(ResultType::Boxes2d));
}

#[test]
fn only_the_topics_that_were_asked_for_are_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let report = recorded(folder.path(), &["user/box*"], 0);
    let topics: Vec<&str> = report.recorded.keys().map(String::as_str).collect();
    assert_eq!(
        topics,
        ["user/boxes2d", "user/boxes2d/about", "user/boxes3d"]
    );
}

/// Goal: no body whatever makes a converter panic. Method: bodies of all types with bytes and
/// header fields changed at random, with a fixed seed; a header that fails its check is left out.
#[test]
fn mutated_results_never_panic() {
    let mut rng = fastrand::Rng::with_seed(20_261_122);
    let mut converter = consumer_forms::foxglove::results::ResultConverter::default();
    let mut n_converted = 0;
    for round in 0..20_000 {
        let kind = ResultType::ALL[round % ResultType::ALL.len()];
        let mut body = sample::body(kind, round as u64);
        let mut header = ResultHeader::new(kind);
        sample::describe(&mut header, kind, body.len());
        for _ in 0..rng.usize(0..8) {
            let at = rng.usize(0..body.len());
            body[at] = rng.choice([0, 1, 0x7f, 0x80, 0xff]).unwrap();
        }
        if rng.u8(..) < 40 {
            let value = rng.choice([0, 1, 2, 7, u32::MAX]).unwrap();
            match rng.u8(0..4) {
                0 => header.width = value,
                1 => header.height = value,
                2 => header.row_stride = value,
                _ => header.space = value,
            }
        }
        header.payload_bytes = ResultHeader::payload_for(header.body_bytes, 0);
        body.resize(header.payload_bytes as usize, 0);
        if header.check(body.len()).is_err() {
            continue;
        }
        let mut about = sample::about(kind);
        if rng.bool() {
            about.classes = vec!["a".into()];
        }
        let parts = consumer_kit::items::ResultParts {
            topic: "user/any",
            header: &header,
            kind,
            body: &body[..header.body_bytes as usize],
            inputs: &[],
            about: &about,
        };
        let entries = converter.entries(&parts, 5, &mut |n| Vec::with_capacity(n));
        assert_eq!(entries[0].topic, "/user/any/gantry");
        n_converted += 1;
    }
    assert!(n_converted > 15_000, "{n_converted}");
}
