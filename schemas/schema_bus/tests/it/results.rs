//! Results of users' programs on real shared memory: what is declared, written, answered, refused
//! and cleaned up. Each test has a private root and prefix.

use std::time::{Duration, Instant};

use schema_bus::{BusError, FrameTopic, ResultTopic, TopicKind};
use schema_frames::result::MAX_INPUTS;
use schema_frames::{
    About, Box2d, BytesSchema, ElementType, Modality, PixelFormat, ResultType, Space, Track,
};

use crate::place::Place;

fn person() -> Box2d {
    Box2d {
        min_px: [10.0, 20.0],
        max_px: [30.0, 60.0],
        score: 0.5,
        class: 0,
        id: 7,
        reserved: 0,
    }
}

#[test]
fn a_chain_of_results_names_its_inputs_and_hands_on_where_it_began() {
    let place = Place::new("chain");
    let (simd, detector, tracker) = (
        place.bus("simd"),
        place.bus("detector"),
        place.bus("tracker"),
    );
    let spec = FrameTopic::new(Modality::Rgb, 16 * 8 * 4);
    let camera = simd.frame_publisher("ego/front/rgb", spec).unwrap();
    let mut images = detector.frame_reader("ego/front/rgb").unwrap();
    let boxes = detector
        .result_publisher("detector/boxes", &ResultTopic::new(ResultType::Boxes2d))
        .unwrap();
    let mut seen = tracker.result_reader("detector/boxes").unwrap();
    let tracks = tracker
        .result_publisher("tracker/tracks", &ResultTopic::new(ResultType::Tracks))
        .unwrap();
    let mut shown = simd.result_reader("tracker/tracks").unwrap();
    let wake = tracker.listener("detector/boxes").unwrap();

    let mut loan = camera.loan(16 * 8 * 4).unwrap();
    let header = loan.header_mut();
    header.set_image(16, 8);
    (header.tick, header.seq, header.sim_nanos) = (41, 5, 2_050_000_000);
    (header.epoch, header.episode) = (77, 3);
    header.world_from_sensor.translation_m = [4.0, 5.0, 6.0];
    header.intrinsics_px = [8.0, 8.0, 8.0, 4.0];
    loan.send().unwrap();
    let image = images.next().unwrap().unwrap();

    let mut loan = boxes.loan(10 * size_of::<Box2d>()).unwrap();
    loan.answers(&image);
    loan.write(&[person(), person()]).unwrap();
    assert_eq!(loan.send().unwrap(), 1);
    assert!(wake.wait(Duration::from_secs(10)).unwrap());

    let result = seen.next().unwrap().unwrap();
    let header = *result.header();
    assert_eq!((header.tick, header.sim_nanos), (41, 2_050_000_000));
    assert_eq!((header.epoch, header.episode, header.seq), (77, 3, 1));
    assert_eq!(header.space(), Some(Space::Image));
    assert_eq!(header.world_from_space.translation_m, [4.0, 5.0, 6.0]);
    assert_eq!(header.intrinsics_px, [8.0, 8.0, 8.0, 4.0]);
    let published = image.header().published_mono_nanos;
    assert_eq!(header.origin_mono_nanos, published);
    assert!(published <= header.taken_mono_nanos);
    assert!(header.taken_mono_nanos <= header.published_mono_nanos);
    assert_eq!(result.records::<Box2d>().unwrap(), [person(), person()]);
    assert!(result.records::<Track>().is_none());
    let [input] = result.inputs() else {
        panic!("{:?}", result.inputs())
    };
    assert_eq!(input.topic(), "ego/front/rgb");
    assert_eq!((input.tick, input.seq, input.epoch), (41, 5, 77));

    let mut loan = tracks.loan(size_of::<Track>()).unwrap();
    loan.answers(&result);
    loan.write(&[some_track()]).unwrap();
    loan.send().unwrap();
    let result = shown.next().unwrap().unwrap();
    assert_eq!(result.header().origin_mono_nanos, published);
    assert_eq!(result.header().intrinsics_px, [8.0, 8.0, 8.0, 4.0]);
    assert_eq!((result.header().tick, result.header().epoch), (41, 77));
    assert_eq!(result.inputs()[0].topic(), "detector/boxes");
    assert_eq!(result.inputs()[0].seq, 1);
    assert_eq!(result.as_ptr() as usize % 64, 0, "bodies are 64-aligned");
}

fn some_track() -> Track {
    let mut track: Track = bytemuck::Zeroable::zeroed();
    (track.id, track.flags) = (1, Track::IN_IMAGE);
    track
}

#[test]
fn a_topic_has_one_writer_and_a_dead_or_gone_one_makes_room() {
    let place = Place::new("one");
    let (first, second) = (place.bus("first"), place.bus("second"));
    let spec = ResultTopic::new(ResultType::Text);
    let publisher = first.result_publisher("a/log", &spec).unwrap();
    let error = second.result_publisher("a/log", &spec).unwrap_err();
    let text = error.to_string();
    let expected = format!("is written by first (process {})", std::process::id());
    assert!(
        matches!(error, BusError::TopicTaken { .. }) && text.contains(&expected),
        "{text}"
    );
    drop(publisher);
    second.result_publisher("a/log", &spec).unwrap();
}

#[test]
fn of_many_writers_that_come_at_once_at_most_one_stays() {
    let place = Place::new("race");
    for _ in 0..20 {
        let start = std::sync::Barrier::new(4);
        let kept: Vec<_> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..4)
                .map(|i| {
                    let (place, start) = (&place, &start);
                    scope.spawn(move || {
                        let bus = place.bus(&format!("racer{i}"));
                        start.wait();
                        let spec = ResultTopic::new(ResultType::Json);
                        let publisher = bus.result_publisher("race/line", &spec);
                        // Kept until all have tried.
                        start.wait();
                        publisher.map(drop).is_ok()
                    })
                })
                .collect();
            threads.into_iter().map(|it| it.join().unwrap()).collect()
        });
        assert!(kept.iter().filter(|kept| **kept).count() <= 1, "{kept:?}");
    }
}

#[test]
fn names_types_and_descriptions_that_do_not_fit_get_a_sentence() {
    let place = Place::new("fit");
    let bus = place.bus("me");
    let text = |topic: &str, kind| {
        bus.result_publisher(topic, &ResultTopic::new(kind))
            .unwrap_err()
            .to_string()
    };
    for reserved in ["world/info", "control/vehicles", "mine/about"] {
        let error = text(reserved, ResultType::Text);
        assert!(error.contains("cannot be published"), "{error}");
    }
    let error = text("a b", ResultType::Text);
    assert!(error.contains("is not usable"), "{error}");
    let error = text("mine/bytes", ResultType::Bytes);
    assert!(error.contains("must name its schema"), "{error}");

    let _camera = bus
        .frame_publisher("ego/front/rgb", FrameTopic::new(Modality::Rgb, 64))
        .unwrap();
    let error = text("ego/front/rgb", ResultType::Image);
    assert!(
        error.contains("carries sensor frames, not image"),
        "{error}"
    );
    let _boxes = bus
        .result_publisher("mine/boxes", &ResultTopic::new(ResultType::Boxes2d))
        .unwrap();
    let error = text("mine/boxes", ResultType::Tracks);
    assert!(error.contains("carries boxes2d, not tracks"), "{error}");
    let error = bus.frame_reader("mine/boxes").unwrap_err().to_string();
    assert!(
        error.contains("carries results, not sensor frames"),
        "{error}"
    );
    let error = bus.result_reader("ego/front/rgb").unwrap_err().to_string();
    assert!(
        error.contains("carries sensor frames, not results"),
        "{error}"
    );
    let error = bus.result_reader("mine/nothing").unwrap_err().to_string();
    assert!(error.contains("there is no topic"), "{error}");
}

#[test]
fn longer_results_make_the_slots_grow_and_pixels_tensors_and_texts_arrive() {
    let place = Place::new("grow");
    let bus = place.bus("me");
    let tensor = bus
        .result_publisher("net/logits", &ResultTopic::new(ResultType::Tensor))
        .unwrap();
    let mut reader = bus.result_reader("net/logits").unwrap();
    for n in [10usize, 100_000, 1000, 400_000] {
        let mut loan = tensor.loan(n * 4).unwrap();
        loan.set_tensor(ElementType::F32, &[2, n as u32 / 2])
            .unwrap();
        let values: Vec<f32> = (0..n).map(|i| i as f32).collect();
        loan.body_mut()[..n * 4].copy_from_slice(bytemuck::cast_slice(&values));
        loan.send().unwrap();
        let result = reader.next().unwrap().unwrap();
        assert_eq!(result.header().shape(), [2, n as u32 / 2]);
        assert_eq!(result.elements::<f32>().unwrap(), values);
        assert!(result.inputs().is_empty());
    }
    assert_eq!(reader.counts().lost, 0);

    let mut image = ResultTopic::new(ResultType::Image);
    image.body_bytes = 4 * 3 * 3;
    let image = bus.result_publisher("net/picture", &image).unwrap();
    let mut reader = bus.result_reader("net/picture").unwrap();
    let mut loan = image.loan(36).unwrap();
    let error = loan.set_image(5, 3, PixelFormat::Bgr8).unwrap_err();
    assert!(matches!(
        error,
        BusError::TooLong {
            len: 45,
            limit: 36,
            ..
        }
    ));
    loan.set_image(4, 3, PixelFormat::Bgr8).unwrap();
    loan.body_mut().fill(9);
    loan.send().unwrap();
    let result = reader.next().unwrap().unwrap();
    assert_eq!(result.row(2).unwrap(), [9; 12]);
    assert!(result.row(3).is_none());

    let text = bus
        .result_publisher("net/says", &ResultTopic::new(ResultType::Text))
        .unwrap();
    let mut reader = bus.result_reader("net/says").unwrap();
    let mut loan = text.loan(5).unwrap();
    loan.write("hallo".as_bytes()).unwrap();
    loan.send().unwrap();
    assert_eq!(reader.next().unwrap().unwrap().text(), Some("hallo"));
    // A header that contradicts the topic's type is not sent.
    let mut loan = text.loan(5).unwrap();
    loan.header_mut().result_type = ResultType::Boxes2d as u16;
    assert!(matches!(loan.send(), Err(BusError::BadResult { .. })));
}

#[test]
fn a_slow_reader_sees_a_gap_and_a_restarted_writer_another_epoch() {
    let place = Place::new("gap");
    let (writer, reader) = (place.bus("writer"), place.bus("reader"));
    let spec = ResultTopic::new(ResultType::Scalars);
    let publisher = writer.result_publisher("a/numbers", &spec).unwrap();
    let mut numbers = reader.result_reader("a/numbers").unwrap();
    let send = |publisher: &schema_bus::ResultPublisher| {
        let mut loan = publisher.loan(64).unwrap();
        loan.write(&[schema_frames::Scalar::new("x", 1.0)]).unwrap();
        loan.send().unwrap();
    };
    (0..20).for_each(|_| send(&publisher));
    let mut n = 0;
    while numbers.next().unwrap().is_some() {
        n += 1;
    }
    // 16 places: the first four of 20 were pushed out. The first that arrives begins the count.
    assert_eq!((n, numbers.counts().lost), (16, 0));
    (0..18).for_each(|_| send(&publisher));
    let first = numbers.next().unwrap().unwrap();
    assert_eq!((first.header().seq, numbers.counts().lost), (23, 2));
    drop((first, publisher));
    let publisher = writer.result_publisher("a/numbers", &spec).unwrap();
    send(&publisher);
    let newest = numbers.latest().unwrap().unwrap();
    assert_eq!((newest.header().seq, numbers.counts().restarts), (1, 1));
}

#[test]
fn the_description_reaches_readers_that_come_before_and_after() {
    let place = Place::new("about");
    let (writer, reader) = (place.bus("writer"), place.bus("reader"));
    let mut spec = ResultTopic::new(ResultType::Bytes);
    spec.about = About {
        schema: Some(BytesSchema {
            name: "perception.Lanes".into(),
            message_encoding: "protobuf".into(),
            schema_encoding: "protobuf".into(),
            base64: "CgR0ZXN0".into(),
            ..BytesSchema::default()
        }),
        ..About::default()
    };
    let publisher = writer.result_publisher("lanes/raw", &spec).unwrap();
    let mut samples = reader.result_reader("lanes/raw").unwrap();
    let mut about = reader.document_reader("lanes/raw/about").unwrap();
    let mut loan = publisher.loan(3).unwrap();
    loan.write(&[1u8, 2, 3]).unwrap();
    loan.send().unwrap();
    assert_eq!(&samples.next().unwrap().unwrap()[..], [1, 2, 3]);
    let text = about.latest().unwrap().expect("it came before the sample");
    assert_eq!(text.json::<About>().unwrap(), spec.about);
}

#[test]
fn a_description_that_comes_later_costs_a_reader_nothing_that_was_sent() {
    let place = Place::new("described");
    let (writer, reader) = (place.bus("writer"), place.bus("reader"));
    let publisher = writer
        .result_publisher("lanes/raw", &ResultTopic::new(ResultType::Text))
        .unwrap();
    let mut samples = reader.result_reader("lanes/raw").unwrap();
    let send = |byte: u8| {
        let mut loan = publisher.loan(1).unwrap();
        loan.write(&[byte]).unwrap();
        loan.send().unwrap();
    };
    send(1);
    writer
        .describe_results(&publisher, &About::default())
        .unwrap();
    let of_bytes = About {
        schema: Some(BytesSchema::default()),
        ..About::default()
    };
    let wrong = writer.describe_results(&publisher, &of_bytes).unwrap_err();
    assert!(matches!(wrong, BusError::Description { .. }), "{wrong}");
    let missing = reader.document_reader("lanes/raw/about").unwrap_err();
    assert!(matches!(missing, BusError::NoSuchTopic { .. }), "{missing}");
    let classes = |names: &[&str]| About {
        classes: names.iter().map(|name| (*name).into()).collect(),
        ..About::default()
    };
    writer
        .describe_results(&publisher, &classes(&["kerb"]))
        .unwrap();
    let mut about = reader.document_reader("lanes/raw/about").unwrap();
    publisher.greet();
    let mut is_said = |names: &[&str]| {
        let text = about.latest().unwrap().expect("the description has come");
        assert_eq!(text.json::<About>().unwrap(), classes(names));
    };
    is_said(&["kerb"]);
    send(2);
    writer
        .describe_results(&publisher, &classes(&["kerb", "line"]))
        .unwrap();
    is_said(&["kerb", "line"]);
    for byte in [1, 2] {
        assert_eq!(&samples.next().unwrap().unwrap()[..], [byte]);
    }
    assert_eq!((samples.counts().lost, samples.counts().restarts), (0, 0));
}

#[test]
fn a_launcher_keeps_a_topic_with_other_capacities_for_who_comes() {
    let place = Place::new("kept");
    let (launcher, writer) = (place.bus("launcher"), place.bus("writer"));
    let mut spec = ResultTopic::new(ResultType::Path);
    (spec.qos.readers, spec.qos.buffer, spec.qos.borrowed) = (1, 2, 1);
    let kept = launcher.result_service("plan/path", &spec).unwrap();
    let mut early = launcher.result_reader("plan/path").unwrap();
    let error = launcher.result_reader("plan/path").unwrap_err();
    assert!(matches!(error, BusError::TooManyReaders { limit: 1, .. }));
    let publisher = writer
        .result_publisher("plan/path", &ResultTopic::new(ResultType::Path))
        .unwrap();
    for _ in 0..3 {
        let mut loan = publisher.loan(80).unwrap();
        loan.set_list(0, 80, 0).unwrap();
        loan.send().unwrap();
    }
    let held = early.next().unwrap().unwrap();
    assert_eq!(held.header().seq, 2, "two wait, the first was pushed out");
    assert!(matches!(early.next(), Err(BusError::BorrowLimit { .. })));
    assert_eq!(kept.n_readers(), 1);
}

#[test]
fn topics_tell_type_writers_and_readers() {
    let place = Place::new("list");
    let bus = place.bus("me");
    let spec = ResultTopic::new(ResultType::Masks);
    let _publisher = bus.result_publisher("seg/masks", &spec).unwrap();
    let _reader = bus.result_reader("seg/masks").unwrap();
    let topics = bus.topics().unwrap();
    let [topic] = topics.as_slice() else {
        panic!("{topics:?}")
    };
    assert_eq!(topic.kind, TopicKind::Results);
    assert_eq!(topic.result, Some(ResultType::Masks));
    assert_eq!(topic.modality, None);
    assert_eq!((topic.publishers, topic.subscribers), (1, 1));
    assert_eq!(topic.max_subscribers, spec.qos.readers);
}

#[test]
fn more_than_eight_inputs_are_not_named() {
    let place = Place::new("many");
    let bus = place.bus("me");
    let publisher = bus
        .result_publisher("fusion/text", &ResultTopic::new(ResultType::Text))
        .unwrap();
    let mut reader = bus.result_reader("fusion/text").unwrap();
    let mut loan = publisher.loan(2).unwrap();
    loan.write(b"ok").unwrap();
    for i in 0..20 {
        loan.add_input(schema_frames::InputRecord::new(&format!("in/{i}")));
    }
    loan.send().unwrap();
    let result = reader.next().unwrap().unwrap();
    assert_eq!(result.inputs().len(), MAX_INPUTS);
    assert_eq!(result.inputs()[7].topic(), "in/7");
}

#[test]
fn a_loan_that_is_dropped_or_held_blocks_nobody() {
    let place = Place::new("loans");
    let bus = place.bus("me");
    let publisher = bus
        .result_publisher("a/text", &ResultTopic::new(ResultType::Text))
        .unwrap();
    let began = Instant::now();
    for _ in 0..100 {
        drop(publisher.loan(8).unwrap());
    }
    let held = (publisher.loan(8).unwrap(), publisher.loan(8).unwrap());
    let error = publisher.loan(8).unwrap_err().to_string();
    assert!(error.contains("all 2 loans are in use"), "{error}");
    drop(held);
    publisher.loan(8).unwrap();
    assert!(began.elapsed() < Duration::from_secs(60));
}
