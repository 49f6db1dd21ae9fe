//! Looking at a bus without taking part: who has which ports, the newest samples of writers, and
//! samples of programs that do not use our headers. Each test has a private root and prefix.

use std::time::{Duration, Instant};

use iceoryx2::prelude::*;
use schema_bus::{Bus, Exchange, FrameTopic, Newest, ResultTopic, TopicKind, Watch};
use schema_frames::{Modality, ResultType, Scalar, VehicleControlRecord};

use crate::place::Place;

/// The newest sample of the only writer of `topic`.
fn newest(bus: &Bus, watch: &mut Watch, topic: &str) -> Option<Newest> {
    let services = bus.services().unwrap();
    watch.follow(&services);
    let is_it = |exchange| exchange == Exchange::Topic;
    let service = services
        .iter()
        .find(|of| of.name == topic && is_it(of.exchange))
        .unwrap();
    watch.newest(service.writers[0].id)
}

#[test]
fn services_name_their_ports_and_looking_opens_none() {
    let place = Place::with_foreigners("ports");
    let (simd, viewer) = (place.bus("simd"), place.bus("viewer"));
    let spec = FrameTopic::new(Modality::Imu, 72);
    let imu = simd.frame_publisher("ego/imu/imu", spec).unwrap();
    let _reader = viewer.frame_reader("ego/imu/imu").unwrap();
    let _server = simd.command_server().unwrap();
    let _client = viewer.command_client("viewer").unwrap();
    let top = place.bus("top");
    let services = top.services().unwrap();
    let of = |name: &str, exchange| {
        let is_it = |of: &&schema_bus::ServicePorts| of.name == name && of.exchange == exchange;
        services
            .iter()
            .find(is_it)
            .unwrap_or_else(|| panic!("{name} in {services:?}"))
    };
    let topic = of("ego/imu/imu", Exchange::Topic);
    assert_eq!(topic.kind(), TopicKind::Frames);
    assert_eq!((topic.max_readers, topic.max_writers), (16, 2));
    assert_eq!(topic.qos.unwrap(), schema_bus::qos::SMALL_FRAME);
    let names = |ports: &[schema_bus::Port]| {
        ports
            .iter()
            .map(|port| port.program.clone())
            .collect::<Vec<_>>()
    };
    assert_eq!(
        (names(&topic.writers), names(&topic.readers)),
        (vec!["simd".into()], vec!["viewer".into()])
    );
    assert_eq!(topic.writers[0].pid, Some(std::process::id()));
    assert_eq!(topic.writers[0].max_payload_bytes, 72);
    let commands = of("control/world", Exchange::Requests);
    assert_eq!(
        (names(&commands.writers), names(&commands.readers)),
        (vec!["viewer".into()], vec!["simd".into()])
    );
    let wake = of("control/wake", Exchange::WakeUps);
    assert!(!wake.writers.is_empty(), "{wake:?}");
    // Looking took no place and made nothing.
    assert_eq!(imu.n_readers(), 1);
    assert_eq!(top.services().unwrap(), services);
}

#[test]
fn the_newest_sample_is_seen_without_a_reader() {
    let place = Place::with_foreigners("newest");
    let (simd, top) = (place.bus("simd"), place.bus("top"));
    let mut watch = top.watch();
    let pixels = 16 * 8 * 4;
    let spec = FrameTopic::new(Modality::Rgb, pixels);
    let camera = simd.frame_publisher("ego/front/rgb", spec).unwrap();
    assert_eq!(
        newest(&top, &mut watch, "ego/front/rgb"),
        None,
        "nothing was sent"
    );
    let viewer = place.bus("viewer");
    let mut reader = viewer.frame_reader("ego/front/rgb").unwrap();
    let mut held = Vec::new();
    for seq in 1..=5u64 {
        let mut loan = camera.loan(pixels).unwrap();
        let header = loan.header_mut();
        header.set_image(16, 8);
        (header.seq, header.tick, header.sim_nanos, header.epoch) = (seq, seq + 40, seq * 50, 77);
        loan.send().unwrap();
        let found = newest(&top, &mut watch, "ego/front/rgb").unwrap();
        assert_eq!((found.seq, found.tick, found.epoch), (seq, seq + 40, 77));
        assert_eq!(
            (found.payload_bytes, found.sim_nanos),
            (pixels as u64, Some(seq * 50))
        );
        let frame = reader.next().unwrap().unwrap();
        assert_eq!(
            found.published_mono_nanos,
            Some(frame.header().published_mono_nanos)
        );
        // Samples that a reader holds make the writer take other slots.
        if seq < 3 {
            held.push(frame);
        }
    }
    // A sample that is being filled hides none, and does not count.
    let mut loan = camera.loan(pixels).unwrap();
    loan.header_mut().seq = 99;
    watch.look();
    assert_eq!(newest(&top, &mut watch, "ego/front/rgb").unwrap().seq, 5);
    assert_eq!(camera.n_readers(), 1);
}

#[test]
fn growing_segments_and_every_kind_of_header_are_seen() {
    let place = Place::with_foreigners("kinds");
    let (simd, top) = (place.bus("simd"), place.bus("top"));
    let mut watch = top.watch();
    let mut info = simd.document_publisher("world/info").unwrap();
    info.send("{}", 5, 1).unwrap();
    assert_eq!(
        newest(&top, &mut watch, "world/info")
            .unwrap()
            .payload_bytes,
        2
    );
    // Longer than the first slots, so the segment grows.
    let text = "x".repeat(300_000);
    info.send(&text, 5, 2).unwrap();
    let found = newest(&top, &mut watch, "world/info").unwrap();
    assert_eq!(
        (found.seq, found.tick, found.payload_bytes),
        (2, 2, 300_000)
    );

    let mut controls = simd.control_writer("pilot").unwrap();
    controls
        .send(9, &[VehicleControlRecord::new(1, Default::default()); 3])
        .unwrap();
    let found = newest(&top, &mut watch, "control/vehicles").unwrap();
    assert_eq!((found.seq, found.tick, found.payload_bytes), (1, 9, 96));

    let acks = simd.ack_writer("planner").unwrap();
    acks.send(1, 5, 12).unwrap();
    let found = newest(&top, &mut watch, "control/ack").unwrap();
    assert_eq!((found.seq, found.epoch), (12, 5));

    let spec = ResultTopic::new(ResultType::Scalars);
    let scalars = simd.result_publisher("a/scalars", &spec).unwrap();
    let mut loan = scalars.loan(64).unwrap();
    loan.write(&[Scalar::new("speed_mps", 3.0)]).unwrap();
    loan.send().unwrap();
    let found = newest(&top, &mut watch, "a/scalars").unwrap();
    assert_eq!((found.seq, found.payload_bytes), (1, 64));
    assert!(found.published_mono_nanos.is_some() && found.origin_mono_nanos.is_none());
}

#[test]
fn slots_of_a_grown_segment_are_found_while_readers_hold_samples() {
    let place = Place::with_foreigners("grown");
    let (writer, reader, top) = (place.bus("writer"), place.bus("reader"), place.bus("top"));
    let mut watch = top.watch();
    let text = writer
        .result_publisher("a/text", &ResultTopic::new(ResultType::Text))
        .unwrap();
    let mut texts = reader.result_reader("a/text").unwrap();
    let mut held = std::collections::VecDeque::new();
    // Grows at 9 kB and at 70 kB, and sends short ones in between.
    for (i, len) in [100, 9_000, 9_000, 50, 9_500, 70_000, 10, 69_000, 70_000, 5]
        .iter()
        .enumerate()
    {
        let mut loan = text.loan(*len).unwrap();
        loan.write(&vec![b'x'; *len]).unwrap();
        loan.send().unwrap();
        let found = newest(&top, &mut watch, "a/text").unwrap();
        assert_eq!(
            (found.seq, found.payload_bytes),
            (i as u64 + 1, len.next_multiple_of(8) as u64)
        );
        held.push_back(texts.next().unwrap().unwrap());
        if held.len() > 2 {
            held.pop_front();
        }
    }
    // Without a look at everything in between, the slots in use are seen all the same.
    let services = top.services().unwrap();
    let port = services
        .iter()
        .find(|of| of.name == "a/text")
        .unwrap()
        .writers[0]
        .id;
    for turn in 0..6 {
        let mut loan = text.loan(9_000).unwrap();
        loan.write(&vec![b'y'; 9_000]).unwrap();
        loan.send().unwrap();
        drop(texts.next().unwrap().unwrap());
        watch.look();
        assert_eq!(watch.newest(port).unwrap().seq, 11 + turn);
    }
}

#[test]
fn samples_of_other_programs_are_read_as_bytes() {
    let place = Place::with_foreigners("other");
    let node = NodeBuilder::new()
        .config(&place.config())
        .create::<ipc_threadsafe::Service>()
        .unwrap();
    let service = node
        .service_builder(&"d/weather/wind".try_into().unwrap())
        .publish_subscribe::<[u16]>()
        .user_header::<u64>()
        .create()
        .unwrap();
    let publisher = service
        .publisher_builder()
        .initial_max_slice_len(8)
        .create()
        .unwrap();
    let bus = place.bus("top");
    let services = bus.services().unwrap();
    let wind = services
        .iter()
        .find(|of| of.name == "weather/wind")
        .unwrap();
    assert_eq!((wind.kind(), wind.schema.as_str()), (TopicKind::Other, ""));
    assert_eq!(
        (wind.payload.as_str(), wind.header.as_str()),
        ("u16", "u64")
    );
    assert_eq!(wind.writers[0].max_payload_bytes, 16);
    let mut reader = bus.any_reader("weather/wind").unwrap();
    assert_eq!(
        (reader.header_type(), reader.payload_type()),
        ("u64", "u16")
    );
    let mut sample = publisher
        .loan_slice_uninit(3)
        .unwrap()
        .write_from_slice(&[1, 2, 0x304]);
    *sample.user_header_mut() = 7;
    sample.send().unwrap();
    let start = Instant::now();
    let sample = loop {
        if let Some(sample) = reader.next().unwrap() {
            break sample;
        }
        assert!(start.elapsed() < Duration::from_secs(60), "no sample came");
    };
    assert_eq!(sample.header(), 7u64.to_le_bytes());
    assert_eq!(sample.payload(), [1, 0, 2, 0, 4, 3]);
    assert!(reader.next().unwrap().is_none());
    let missing = bus.any_reader("weather/rain").unwrap_err().to_string();
    assert!(
        missing.contains("there is no topic") && missing.contains("weather/wind"),
        "{missing}"
    );
}
