//! The bus on real shared memory, each test in a private root with a private prefix, so that
//! "nothing left" can be asserted.

use std::io::Read as _;
use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant};

use schema_bus::{Bus, BusError, CommandError, FrameTopic, LoanError, TopicKind, WaitSet, names};
use schema_frames::command::CommandReply;
use schema_frames::{
    ActorRecord, Command as Order, CommandBatch, Modality, ReplyBatch, SnapshotHeader,
    VehicleControl, VehicleControlRecord,
};

use crate::place::Place;

const RGB: FrameTopic = FrameTopic {
    max_payload_bytes: 16 * 8 * 4,
    frames_in_flight: 2,
    max_readers: 4,
    buffer: 2,
    borrowed: 3,
};

fn send(publisher: &schema_bus::FramePublisher, epoch: u64, seq: u64, fill: u8) -> usize {
    let mut loan = publisher.loan(16 * 8 * 4).unwrap();
    loan.payload_mut().fill(fill);
    let header = loan.header_mut();
    header.set_image(16, 8);
    (header.epoch, header.seq, header.tick) = (epoch, seq, seq);
    loan.send().unwrap()
}

#[test]
fn a_frame_arrives_unchanged_aligned_and_in_place() {
    let place = Place::new("round");
    let (daemon, consumer) = (place.bus("simd"), place.bus("reader"));
    let publisher = daemon.frame_publisher("ego/front/rgb", RGB).unwrap();
    publisher.touch().unwrap();
    assert_eq!(publisher.n_readers(), 0);
    let mut reader = consumer.frame_reader("ego/front/rgb").unwrap();
    assert_eq!(publisher.n_readers(), 1);

    let segment = publisher.segment().unwrap();
    let need = RGB.segment_bytes(Modality::Rgb) as usize;
    assert!(
        segment.len <= need && need <= segment.len + (1 << 17),
        "the budget says {need}, the segment has {}",
        segment.len
    );
    assert_eq!((segment.base as usize % 4096, segment.len % 4096), (0, 0));
    let mut loan = publisher.loan(512).unwrap();
    let offset = loan.offset_in_segment().expect("the segment is known");
    assert_eq!(loan.payload_ptr() as usize, segment.base as usize + offset);
    assert_eq!(offset % 64, 0);
    for (i, byte) in loan.payload_mut().iter_mut().enumerate() {
        *byte = i as u8;
    }
    let header = loan.header_mut();
    header.set_image(16, 8);
    (header.epoch, header.seq) = (5, 1);
    assert_eq!(loan.send().unwrap(), 1);

    let frame = reader.next().unwrap().expect("a frame");
    assert_eq!(frame.modality(), Modality::Rgb);
    assert_eq!(frame.len(), 512);
    assert!(frame.iter().enumerate().all(|(i, byte)| *byte == i as u8));
    assert_eq!(frame.row(7).unwrap().len(), 64);
    assert!(frame.row(8).is_none());
    assert_eq!(frame.as_ptr() as usize % 64, 0);
    assert!(frame.header().published_mono_nanos > 0);
    assert!(reader.next().unwrap().is_none());
}

#[test]
fn a_list_shorter_than_its_loan_shows_only_what_is_used() {
    let place = Place::new("list");
    let bus = place.bus("simd");
    let publisher = bus
        .frame_publisher("ego/front/dvs", FrameTopic::new(Modality::Dvs, 1600))
        .unwrap();
    let mut reader = bus.frame_reader("ego/front/dvs").unwrap();
    let mut loan = publisher.loan(1600).unwrap();
    loan.header_mut().set_list(3);
    loan.send().unwrap();
    let frame = reader.latest().unwrap().unwrap();
    assert_eq!(
        frame.elements::<schema_frames::DvsEvent>().unwrap().len(),
        3
    );

    let mut loan = publisher.loan(32).unwrap();
    loan.header_mut().set_list(3);
    assert!(
        matches!(loan.send(), Err(BusError::BadFrame { .. })),
        "48 bytes do not fit a loan of 32"
    );
}

#[test]
fn a_late_joiner_gets_the_next_frame_and_never_an_old_one() {
    let place = Place::new("late");
    let bus = place.bus("simd");
    let publisher = bus.frame_publisher("ego/front/rgb", RGB).unwrap();
    send(&publisher, 1, 1, 1);
    let mut reader = bus.frame_reader("ego/front/rgb").unwrap();
    assert!(reader.latest().unwrap().is_none());
    send(&publisher, 1, 2, 2);
    assert_eq!(reader.latest().unwrap().unwrap().header().seq, 2);
    assert_eq!(reader.counts().lost, 0);
}

#[test]
fn a_slow_reader_loses_the_oldest_and_counts_the_gap() {
    let place = Place::new("slow");
    let bus = place.bus("simd");
    let publisher = bus.frame_publisher("ego/front/rgb", RGB).unwrap();
    let mut reader = bus.frame_reader("ego/front/rgb").unwrap();
    send(&publisher, 1, 1, 1);
    assert_eq!(reader.next().unwrap().unwrap().header().seq, 1);
    for seq in 2..=6 {
        send(&publisher, 1, seq, seq as u8);
    }
    let seen: Vec<u64> = std::iter::from_fn(|| reader.next().unwrap())
        .map(|frame| frame.header().seq)
        .collect();
    assert_eq!(seen, [5, 6], "two wait, the rest gave way");
    assert_eq!((reader.counts().lost, reader.counts().taken), (3, 3));
}

#[test]
fn a_reader_that_hoards_is_told_and_can_go_on() {
    let place = Place::new("hoard");
    let bus = place.bus("simd");
    let publisher = bus.frame_publisher("ego/front/rgb", RGB).unwrap();
    let mut reader = bus.frame_reader("ego/front/rgb").unwrap();
    let mut held = Vec::new();
    for seq in 1..=3 {
        send(&publisher, 1, seq, seq as u8);
        held.push(reader.next().unwrap().unwrap());
    }
    send(&publisher, 1, 4, 4);
    let error = reader.next().unwrap_err().to_string();
    assert!(error.contains("already holds 3 (limit 3)"), "{error}");
    assert!(
        held.iter()
            .zip(1..)
            .all(|(frame, fill)| frame.iter().all(|byte| *byte == fill)),
        "held frames stay as they were"
    );
    held.pop();
    assert_eq!(reader.latest().unwrap().unwrap().header().seq, 4);
}

#[test]
fn loans_run_out_with_a_sentence_and_come_back() {
    let place = Place::new("loans");
    let bus = place.bus("simd");
    let publisher = bus.frame_publisher("ego/front/rgb", RGB).unwrap();
    let loans: Vec<_> = (0..publisher.max_loans())
        .map(|_| publisher.loan(512).unwrap())
        .collect();
    assert!(matches!(
        publisher.loan(512),
        Err(LoanError::NoFreeSlot { loans: 3, .. })
    ));
    drop(loans);
    assert!(matches!(
        publisher.loan(513),
        Err(LoanError::TooLong { limit: 512, .. })
    ));
    assert_eq!(send(&publisher, 1, 1, 1), 0);
}

#[test]
fn a_restarted_writer_is_noticed_by_a_reader_that_stayed() {
    let place = Place::new("again");
    let (first, consumer) = (place.bus("simd"), place.bus("reader"));
    let publisher = first.frame_publisher("ego/front/rgb", RGB).unwrap();
    let mut reader = consumer.frame_reader("ego/front/rgb").unwrap();
    send(&publisher, 1, 7, 1);
    assert_eq!(reader.next().unwrap().unwrap().header().epoch, 1);
    drop(publisher);
    drop(first);
    assert!(!reader.has_writer());
    let second = place.bus("simd");
    let publisher = second.frame_publisher("ego/front/rgb", RGB).unwrap();
    send(&publisher, 2, 1, 2);
    assert_eq!(reader.next().unwrap().unwrap().header().epoch, 2);
    assert_eq!((reader.counts().restarts, reader.counts().lost), (1, 0));
}

#[test]
fn another_schema_is_refused_with_a_sentence_before_opening() {
    let place = Place::new("skew");
    // A publisher of another version, made with iceoryx2 itself.
    use iceoryx2::prelude::*;
    let node = NodeBuilder::new()
        .config(&place.config())
        .create::<ipc::Service>()
        .unwrap();
    let attributes = AttributeSpecifier::new()
        .define(
            &"gantry.schema".try_into().unwrap(),
            &"4".try_into().unwrap(),
        )
        .unwrap();
    let service = node
        .service_builder(&"d/ego/roof/lidar".try_into().unwrap())
        .publish_subscribe::<[u8]>();
    let _service = service.create_with_attributes(&attributes).unwrap();
    let foreign = node
        .service_builder(&"d/ego/roof/depth".try_into().unwrap())
        .publish_subscribe::<[u8]>()
        .create()
        .unwrap();

    let bus = place.bus("reader");
    let error = bus.frame_reader("ego/roof/lidar").unwrap_err().to_string();
    assert_eq!(
        error,
        "cannot join service \"d/ego/roof/lidar\": it carries schema 4, this binary reads 1; rebuild the consumer"
    );
    let error = bus.frame_reader("ego/roof/depth").unwrap_err().to_string();
    assert!(error.contains("it carries schema none"), "{error}");
    let error = bus
        .frame_publisher("ego/roof/lidar", FrameTopic::new(Modality::Lidar, 160))
        .unwrap_err();
    assert!(matches!(error, BusError::SchemaSkew { .. }), "{error}");
    drop(foreign);
}

#[test]
fn a_missing_topic_names_what_there_is() {
    let place = Place::new("missing");
    let bus = place.bus("reader");
    let error = bus.frame_reader("ego/front/rgb").unwrap_err().to_string();
    assert!(error.contains("nothing runs on domain \"d\""), "{error}");
    assert!(!bus.exists("ego/rear/rgb"));
    let _publisher = bus.frame_service("ego/rear/rgb", RGB).unwrap();
    assert!(bus.exists("ego/rear/rgb"));
    let error = bus.frame_reader("ego/front/rgb").unwrap_err().to_string();
    assert_eq!(
        error,
        "there is no topic \"d/ego/front/rgb\"; there is ego/rear/rgb"
    );
    assert!(matches!(
        bus.frame_service("ego/front/rbg", RGB),
        Err(BusError::Name { .. })
    ));
    assert!(matches!(
        Bus::open("a/b", "x"),
        Err(BusError::Domain { .. })
    ));
}

#[test]
fn a_segment_larger_than_shared_memory_is_refused_with_both_figures() {
    let place = Place::new("huge");
    let bus = place.bus("simd");
    let spec = FrameTopic {
        max_payload_bytes: 1 << 40,
        ..RGB
    };
    let error = bus
        .frame_publisher("ego/front/rgb", spec)
        .unwrap_err()
        .to_string();
    assert!(
        error.starts_with(
            "cannot reserve 24117249 MiB of shared memory for d/ego/front/rgb: /dev/shm has "
        ),
        "{error}"
    );
}

#[test]
fn a_daemon_that_comes_back_with_more_readers_is_told_to_stop_the_old_ones() {
    let place = Place::new("capacity");
    let bus = place.bus("simd");
    let service = bus.frame_service("ego/front/rgb", RGB).unwrap();
    let _reader = place.bus("reader").frame_reader("ego/front/rgb").unwrap();
    drop(service);
    let error = bus
        .frame_service(
            "ego/front/rgb",
            FrameTopic {
                max_readers: 8,
                ..RGB
            },
        )
        .unwrap_err();
    assert!(matches!(error, BusError::Capacity { .. }), "{error}");
    assert!(
        error
            .to_string()
            .contains("stop all readers of this domain"),
        "{error}"
    );
}

#[test]
fn a_second_daemon_sees_the_first_and_not_a_killed_one() {
    let place = Place::new("second");
    let bus = place.bus("second");
    let mut child = start_child(&place, "info");
    let deadline = Instant::now() + Duration::from_secs(20);
    while !bus.daemon_alive().unwrap() {
        assert!(Instant::now() < deadline);
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!bus.daemon_alive().unwrap());
}

#[test]
fn readers_beyond_the_limit_are_refused_with_the_limit() {
    let place = Place::new("crowd");
    let bus = place.bus("simd");
    let spec = FrameTopic {
        max_readers: 1,
        ..RGB
    };
    let _publisher = bus.frame_publisher("ego/front/rgb", spec).unwrap();
    let _first = bus.frame_reader("ego/front/rgb").unwrap();
    let error = bus.frame_reader("ego/front/rgb").unwrap_err().to_string();
    assert!(
        error.starts_with("service \"d/ego/front/rgb\" already has 1 readers (limit 1)"),
        "{error}"
    );
}

#[test]
fn documents_greet_a_late_reader_and_grow() {
    let place = Place::new("docs");
    let bus = place.bus("simd");
    assert!(!bus.daemon_alive().unwrap());
    let mut publisher = bus.document_publisher(names::WORLD_INFO).unwrap();
    assert!(bus.daemon_alive().unwrap());
    publisher.send("old", 9, 0).unwrap();
    let long = "map ".repeat(100_000);
    assert_eq!(publisher.send(&long, 9, 3).unwrap(), 2);
    let wake = bus.listener(names::CONTROL_WAKE).unwrap();
    let consumer = place.bus("reader");
    let mut reader = consumer.document_reader(names::WORLD_INFO).unwrap();
    assert!(
        wake.wait(Duration::from_secs(5)).unwrap(),
        "a new reader wakes the daemon, which greets it"
    );
    publisher.greet();
    let document = reader.latest().unwrap().expect("a greeting");
    assert_eq!(
        (
            document.header.revision,
            document.header.tick,
            document.text.len()
        ),
        (2, 3, long.len())
    );
    assert!(reader.latest().unwrap().is_none(), "only news");
    publisher
        .send_json(&schema_frames::ActorList::default(), 9, 4)
        .unwrap();
    let list: schema_frames::ActorList = reader.latest().unwrap().unwrap().json().unwrap();
    assert!(list.actors.is_empty());
}

#[test]
fn snapshots_come_whole_and_the_newest_greets() {
    let place = Place::new("snap");
    let bus = place.bus("simd");
    let publisher = bus.snapshot_publisher(8).unwrap();
    let record = |id| ActorRecord {
        id,
        ..bytemuck::Zeroable::zeroed()
    };
    let header = |tick| SnapshotHeader {
        tick,
        ..bytemuck::Zeroable::zeroed()
    };
    publisher.send(header(1), &[record(1)]).unwrap();
    publisher.send(header(2), &[record(1), record(5)]).unwrap();
    let mut reader = bus.snapshot_reader().unwrap();
    publisher.greet();
    let snapshot = reader.latest().unwrap().unwrap();
    assert_eq!((snapshot.header().tick, snapshot.header().n_actors), (2, 2));
    assert_eq!(snapshot.actor(5).map(|actor| actor.id), Some(5));
    assert!(snapshot.actor(4).is_none());
    let many: Vec<_> = (1..=9).map(record).collect();
    assert!(matches!(
        publisher.send(header(3), &many),
        Err(BusError::TooLong { .. })
    ));
}

#[test]
fn controls_arrive_in_the_order_in_which_they_count() {
    let place = Place::new("controls");
    let bus = place.bus("simd");
    let mut reader = bus.control_reader().unwrap();
    let (mut zoe, mut adam) = (
        bus.control_writer("zoe").unwrap(),
        bus.control_writer("adam").unwrap(),
    );
    let record = VehicleControlRecord::new(
        3,
        VehicleControl {
            throttle_ratio: 0.5,
            ..Default::default()
        },
    );
    zoe.send(1, &[record]).unwrap();
    adam.send(1, &[record, record]).unwrap();
    adam.send(2, &[]).unwrap();
    let order: Vec<_> = reader
        .drain()
        .unwrap()
        .into_iter()
        .map(|batch| (batch.writer, batch.seq, batch.records.len()))
        .collect();
    assert_eq!(
        order,
        [
            ("adam".to_string(), 1, 2),
            ("adam".to_string(), 2, 0),
            ("zoe".to_string(), 1, 1)
        ]
    );
}

#[test]
fn acknowledgements_wake_the_daemon_and_name_their_writers() {
    let place = Place::new("acks");
    let bus = place.bus("simd");
    let mut reader = bus.ack_reader().unwrap();
    let mut set = WaitSet::new();
    let wake = set.add(bus.listener(names::CONTROL_WAKE).unwrap());
    let other = set.add(bus.listener("ego/tick").unwrap());
    assert!(!set.wait(Duration::from_millis(5)).unwrap());
    let writer = bus.ack_writer("recorder").unwrap();
    writer.send(2, 9, 77).unwrap();
    assert!(set.wait(Duration::from_secs(5)).unwrap());
    assert!(set.woken(wake) && !set.woken(other));
    assert!(!set.wait(Duration::ZERO).unwrap(), "drained");
    let acks = reader.drain().unwrap();
    assert_eq!(
        (acks.len(), acks[0].participant, acks[0].epoch, acks[0].tick),
        (1, 2, 9, 77)
    );
    let writers = reader.writers();
    assert_eq!(writers.len(), 1);
    assert_eq!(writers[0].port, "recorder");
    assert_eq!(writers[0].pid, Some(std::process::id()));
    assert_eq!(acks[0].origin.port, "recorder");
}

#[test]
fn a_command_goes_there_and_back_and_nobody_home_is_said_at_once() {
    let place = Place::new("cmd");
    let bus = place.bus("simd");
    let mut client = place.bus("cli").command_client("cli").unwrap();
    let batch = CommandBatch::new(vec![Order::Step { n: 3 }]);
    assert!(matches!(
        client.request(&batch, Duration::from_secs(5)),
        Err(CommandError::NoServer { .. })
    ));

    let mut server = bus.command_server().unwrap();
    assert!(matches!(
        client.request(&batch, Duration::from_millis(60)),
        Err(CommandError::Timeout { .. })
    ));
    let wake = bus.listener(names::CONTROL_WAKE).unwrap();
    let asked = batch.clone();
    let thread = std::thread::spawn(move || client.request(&asked, Duration::from_secs(10)));
    assert!(wake.wait(Duration::from_secs(10)).unwrap());
    let deadline = Instant::now() + Duration::from_secs(10);
    let request = loop {
        // The one that timed out may still wait; its client has gone on.
        match server
            .take_all()
            .unwrap()
            .into_iter()
            .find(|request| request.seq == 2)
        {
            Some(request) => break request,
            None => assert!(Instant::now() < deadline),
        }
    };
    assert_eq!(
        (request.client.as_str(), request.batch.as_ref()),
        ("cli", Ok(&batch))
    );
    let answer = ReplyBatch {
        v: 1,
        epoch: "9".into(),
        tick: 4,
        replies: vec![CommandReply::Stepping { last_tick: 7 }],
    };
    server.reply(request, &answer).unwrap();
    assert_eq!(thread.join().unwrap().unwrap(), answer);
}

/// A server that is busy with a client's request takes no further ones of that client, and is not
/// behind for them.
#[test]
fn requests_of_a_busy_client_wait_and_keep_their_order() {
    let place = Place::new("busy");
    let (bus, clients) = (place.bus("simd"), place.bus("cli"));
    let mut server = bus.command_server().unwrap();
    let batch = |n| CommandBatch::new(vec![Order::Step { n }]);
    let mut slow = clients.command_client("slow").unwrap();
    let mut quick = clients.command_client("quick").unwrap();
    let send = |client: &mut schema_bus::CommandClient, n| {
        let sent = client.request(&batch(n), Duration::from_millis(1));
        assert!(matches!(sent, Err(CommandError::Timeout { .. })));
    };
    (1..=2).for_each(|n| send(&mut slow, n));
    let mut taken = server.take_all().unwrap();
    assert_eq!(taken.len(), 2);
    let later = taken.pop().unwrap();
    let port = later.client_port();
    server.hold(later);
    assert!(!server.is_behind());
    send(&mut slow, 3);
    send(&mut quick, 4);
    let asked = |requests: Vec<schema_bus::Request>| {
        let of = |request: schema_bus::Request| request.batch.unwrap();
        requests.into_iter().map(of).collect::<Vec<_>>()
    };
    let others = server.take_all_but(|other| other == port).unwrap();
    assert_eq!(asked(others), [batch(4)]);
    assert!(!server.is_behind());
    let held = server.take_all().unwrap();
    assert_eq!(asked(held), [batch(2), batch(3)]);
}

/// Answers that a client did not wait for may lie where the next client of its process looks.
#[test]
fn an_answer_never_reaches_the_client_after_its_own() {
    let place = Place::new("late");
    let (bus, clients) = (place.bus("simd"), place.bus("cli"));
    let mut server = bus.command_server().unwrap();
    let next = |server: &mut schema_bus::CommandServer| {
        let deadline = Instant::now() + Duration::from_secs(10);
        loop {
            if let Some(request) = server.take().unwrap() {
                return request;
            }
            assert!(Instant::now() < deadline);
        }
    };
    let answer = |last_tick| ReplyBatch {
        v: 1,
        epoch: "9".into(),
        tick: 4,
        replies: vec![CommandReply::Stepping { last_tick }],
    };
    let batch = CommandBatch::new(vec![Order::Step { n: 3 }]);
    for round in 0..20 {
        let mut hasty = clients.command_client("cli").unwrap();
        let timed_out = hasty.request(&batch, Duration::from_millis(1));
        assert!(matches!(timed_out, Err(CommandError::Timeout { .. })));
        let late = next(&mut server);
        // Before or after the client has gone.
        let after = round % 2 == 0;
        let late = match after {
            true => Some(late),
            false => {
                server.reply(late, &answer(1)).unwrap();
                None
            }
        };
        drop(hasty);
        let mut client = clients.command_client("cli").unwrap();
        let asked = batch.clone();
        let thread = std::thread::spawn(move || client.request(&asked, Duration::from_secs(10)));
        if let Some(late) = late {
            server.reply(late, &answer(1)).unwrap();
        }
        let request = next(&mut server);
        server.reply(request, &answer(2)).unwrap();
        assert_eq!(thread.join().unwrap().unwrap(), answer(2), "round {round}");
    }
}

#[test]
fn topics_are_listed_with_their_ports() {
    let place = Place::new("topics");
    let bus = place.bus("simd");
    let _publisher = bus.frame_publisher("ego/front/rgb", RGB).unwrap();
    let _reader = bus.frame_reader("ego/front/rgb").unwrap();
    let _info = bus.document_publisher(names::WORLD_INFO).unwrap();
    let _acks = bus.ack_reader().unwrap();
    let topics = bus.topics().unwrap();
    let kinds: Vec<_> = topics
        .iter()
        .map(|topic| (topic.name.as_str(), topic.kind))
        .collect();
    assert_eq!(
        kinds,
        [
            ("control/ack", TopicKind::Other),
            ("ego/front/rgb", TopicKind::Frames),
            ("world/info", TopicKind::Document)
        ]
    );
    let rgb = &topics[1];
    assert_eq!(
        (
            rgb.modality,
            rgb.publishers,
            rgb.subscribers,
            rgb.max_subscribers
        ),
        (Some(Modality::Rgb), 1, 1, 4)
    );
    assert_eq!((rgb.payload_bytes, rgb.schema.as_str()), (512, "1"));
    assert_eq!(bus.programs(), ["simd"]);
}

#[test]
fn a_private_config_file_is_what_iceoryx2_reads() {
    let folder = tempfile::tempdir().unwrap();
    let path = schema_bus::write_private_config(folder.path(), &folder.path().join("root"), "gtx_")
        .unwrap();
    use iceoryx2::prelude::SemanticString as _;
    let name = iceoryx2::prelude::FilePath::new(path.to_str().unwrap().as_bytes()).unwrap();
    let config = iceoryx2::config::Config::from_file(&name).unwrap();
    assert_eq!(config.global.prefix.to_string(), "gtx_");
    assert!(config.global.root_path().to_string().ends_with("/root"));
}

/// Starts the example `bus_child`.
pub fn start_child(place: &Place, role: &str) -> std::process::Child {
    let root = place.root();
    let test = std::env::current_exe().unwrap();
    let built = test.parent().and_then(std::path::Path::parent);
    Command::new(built.unwrap().join("examples/bus_child"))
        .args([root.as_os_str(), place.prefix.as_ref(), role.as_ref()])
        .spawn()
        .expect("examples are built with the tests")
}

#[test]
fn readers_killed_with_9_while_they_hold_frames_give_their_places_back() {
    let place = Place::new("crash");
    let bus = place.bus("simd");
    let publisher = bus.frame_publisher("ego/front/rgb", RGB).unwrap();
    let mut seq = 0;
    for _ in 0..6 {
        let mut child = start_child(&place, "read");
        let deadline = Instant::now() + Duration::from_secs(20);
        while publisher.n_readers() == 0 {
            assert!(Instant::now() < deadline && child.try_wait().unwrap().is_none());
            std::thread::sleep(Duration::from_millis(1));
        }
        for _ in 0..10 {
            seq += 1;
            send(&publisher, 1, seq, seq as u8);
            std::thread::sleep(Duration::from_millis(3));
        }
        child.kill().unwrap();
        child.wait().unwrap();
        bus.clean_dead_nodes();
        assert_eq!(publisher.n_readers(), 0);
    }
    // More readers died than there are places, each holding three frames: all slots are free again.
    let mut reader = bus.frame_reader("ego/front/rgb").unwrap();
    let loans: Vec<_> = (0..publisher.max_loans())
        .map(|_| publisher.loan(512).unwrap())
        .collect();
    drop(loans);
    send(&publisher, 1, seq + 1, 7);
    assert_eq!(reader.latest().unwrap().unwrap().header().seq, seq + 1);
}

#[test]
fn a_publisher_killed_with_9_leaves_held_frames_valid_and_its_memory_is_reclaimed() {
    let place = Place::new("kill");
    let mut child = start_child(&place, "publish");
    let bus = place.bus("reader");
    let deadline = Instant::now() + Duration::from_secs(20);
    let mut reader = loop {
        match bus.frame_reader("ego/front/rgb") {
            Ok(reader) => break reader,
            Err(error) => assert!(Instant::now() < deadline, "{error}"),
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    let held = loop {
        assert!(Instant::now() < deadline);
        if let Some(frame) = reader.latest().unwrap() {
            break frame;
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!place.left_over().is_empty(), "the dead left its segment");
    assert!(bus.clean_dead_nodes() >= 1);
    assert!(!reader.has_writer());
    let fill = held.header().seq as u8;
    assert!(
        held.iter().all(|byte| *byte == fill),
        "a held frame outlives its writer"
    );

    let publisher = bus.frame_publisher("ego/front/rgb", RGB).unwrap();
    send(&publisher, 2, 1, 99);
    let frame = loop {
        let frame = reader
            .next()
            .unwrap()
            .expect("the new writer's frame is there");
        if frame.header().epoch == 2 {
            break frame;
        }
    };
    assert!(frame.iter().all(|byte| *byte == 99));
    assert_eq!(reader.counts().restarts, 1);
}

/// Files of iceoryx2's bookkeeping below a folder of the place.
fn files_below(folder: &std::path::Path) -> Vec<std::path::PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let paths = entries.map(|entry| entry.path());
    let (folders, mut files): (Vec<_>, Vec<_>) = paths.partition(|path| path.is_dir());
    files.extend(folders.iter().flat_map(|folder| files_below(folder)));
    files
}

/// Makes a file as iceoryx2 does before it gives it its content and its final permissions.
fn put_in_the_making(path: &std::path::Path) {
    use std::os::unix::fs::OpenOptionsExt as _;
    let mut made = std::fs::OpenOptions::new();
    made.write(true).create_new(true).mode(0o600);
    made.open(path).unwrap();
}

/// The folder of a child's node, once it publishes.
fn node_folder(place: &Place, child: u32) -> std::path::PathBuf {
    let nodes = place.folder.path().join("iceoryx2/nodes");
    let deadline = Instant::now() + Duration::from_secs(20);
    loop {
        let entries = std::fs::read_dir(&nodes).into_iter().flatten().flatten();
        let mut folders = entries.map(|e| e.path()).filter(|path| path.is_dir());
        let is_childs = |path: &std::path::PathBuf| {
            let id: u128 = path.file_name().unwrap().to_str().unwrap().parse().unwrap();
            id.to_ne_bytes()[8..12] == child.to_ne_bytes()
        };
        if let Some(found) = folders.find(is_childs) {
            return found;
        }
        assert!(Instant::now() < deadline, "the child has no node");
        std::thread::sleep(Duration::from_millis(2));
    }
}

pub fn is_eventually(what: &str, mut holds: impl FnMut() -> bool) {
    let deadline = Instant::now() + Duration::from_secs(60);
    while !holds() {
        assert!(Instant::now() < deadline, "{what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Kills a child that publishes, puts what it could have left into its node's folder or beside it,
/// and expects that whoever cleans removes all of it.
fn a_node_is_removed_whole(name: &str, leave: impl Fn(&Place, &std::path::Path)) {
    let place = Place::new(name);
    let nodes = place.folder.path().join("iceoryx2/nodes");
    let mut child = start_child(&place, "publish");
    let bus = place.bus("reader");
    is_eventually("the child publishes", || {
        bus.frame_reader("ego/front/rgb").is_ok()
    });
    let folder = node_folder(&place, child.id());
    child.kill().unwrap();
    child.wait().unwrap();
    leave(&place, &folder);
    is_eventually("the node is removed", || {
        bus.clean_dead_nodes();
        let id = folder.file_name().unwrap().to_string_lossy();
        let left = std::fs::read_dir(&nodes).unwrap().flatten();
        left.into_iter()
            .all(|entry| !entry.file_name().to_string_lossy().contains(&*id))
    });
    drop(bus);
    assert_eq!(files_below(&nodes), Vec::<std::path::PathBuf>::new());
}

#[test]
fn a_node_killed_while_it_made_a_tag_is_removed() {
    let hash = "0123456789012345678901234567890123456789";
    a_node_is_removed_whole("tag", |place, folder| {
        put_in_the_making(&folder.join(format!("{}{hash}.service_tag", place.prefix)));
        put_in_the_making(&folder.join(format!("{}17.port_tag", place.prefix)));
    });
    // Whoever met it first, and has another configuration, may have removed the node's details.
    a_node_is_removed_whole("details", |place, folder| {
        put_in_the_making(&folder.join(format!("{}{hash}.service_tag", place.prefix)));
        place.bus("first").clean_dead_nodes();
        let _ = std::fs::remove_file(folder.join(format!("{}node.details", place.prefix)));
    });
}

#[test]
fn a_node_killed_while_it_was_removed_is_removed() {
    a_node_is_removed_whole("removal", |place, folder| {
        let (nodes, id) = (folder.parent().unwrap(), folder.file_name().unwrap());
        let state = format!("{}{}.node_monitor", place.prefix, id.to_string_lossy());
        std::fs::remove_file(nodes.join(state)).unwrap();
        // Its port is left to the service, whose next owner is told.
        for entry in std::fs::read_dir("/dev/shm").unwrap().flatten() {
            if entry
                .file_name()
                .to_string_lossy()
                .starts_with(&place.prefix)
            {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    });
}

#[test]
fn a_node_killed_while_it_was_made_is_removed_and_one_that_starts_is_left() {
    let place = Place::new("start");
    let nodes = place.folder.path().join("iceoryx2/nodes");
    let bus = place.bus("reader");
    // Two nodes of which there is a folder alone: this process's own, and one of a process that
    // has ended.
    let mut ended = Command::new("true").spawn().unwrap();
    let pids = [std::process::id(), ended.id()];
    ended.wait().unwrap();
    let long_ago = std::time::SystemTime::now() - Duration::from_secs(3600);
    let [ours, gone] = pids.map(|pid| {
        let mut id = [1; 16];
        id[8..12].copy_from_slice(&pid.to_ne_bytes());
        let folder = nodes.join(u128::from_ne_bytes(id).to_string());
        std::fs::create_dir(&folder).unwrap();
        put_in_the_making(&folder.join(format!("{}node.details", place.prefix)));
        let times = std::fs::FileTimes::new().set_modified(long_ago);
        std::fs::File::open(&folder)
            .unwrap()
            .set_times(times)
            .unwrap();
        folder
    });
    bus.clean_dead_nodes();
    assert!(ours.exists(), "it may yet become a node");
    assert!(!gone.exists(), "its process has ended");
    // A folder that was made just now may belong to a process of another container.
    std::fs::create_dir(&gone).unwrap();
    bus.clean_dead_nodes();
    assert!(gone.exists(), "it is too young");
    // So may one whose files have another prefix, which says nothing to us about its state.
    put_in_the_making(&gone.join("other_node.details"));
    let times = std::fs::FileTimes::new().set_modified(long_ago);
    let folder = std::fs::File::open(&gone).unwrap();
    folder.set_times(times).unwrap();
    bus.clean_dead_nodes();
    assert_eq!(files_below(&gone).len(), 1, "it is not ours");
}

#[test]
fn a_service_whose_maker_was_killed_meanwhile_can_be_made() {
    let place = Place::new("made");
    let services = place.folder.path().join("iceoryx2/services");
    let bus = place.bus("simd");
    drop(bus.frame_publisher("ego/front/rgb", RGB).unwrap());
    let publisher = bus.frame_publisher("ego/front/rgb", RGB).unwrap();
    let files = files_below(&services);
    drop(publisher);
    assert_eq!(files_below(&services), Vec::<std::path::PathBuf>::new());
    for file in &files {
        put_in_the_making(file);
    }
    // It is made all the same, and by a program that starts it is not even met.
    bus.frame_publisher("ego/front/rgb", RGB).unwrap();
    assert_eq!(files_below(&services), Vec::<std::path::PathBuf>::new());
    put_in_the_making(&files[0]);
    drop(place.bus("next"));
    assert_eq!(files_below(&services), Vec::<std::path::PathBuf>::new());
    // A living node with the service's tag may be making it.
    let name = files[0].file_name().unwrap().to_str().unwrap();
    let tag = name.replace(".service", ".service_tag");
    let tag = node_folder(&place, std::process::id()).join(tag);
    put_in_the_making(&tag);
    put_in_the_making(&files[0]);
    drop(place.bus("next"));
    assert_eq!(files_below(&services), vec![files[0].clone()]);
    std::fs::remove_file(tag).unwrap();
    drop(place.bus("next"));
    assert_eq!(files_below(&services), Vec::<std::path::PathBuf>::new());
}

/// A process that closes a service last marks it as being removed, takes its tag away, and removes
/// the service's files one after the other. It can be killed between any two of these steps.
#[test]
fn a_service_whose_remover_was_killed_can_be_made_again() {
    const TOPIC: &str = "ego/front/rgb";
    for keeps_all in [true, false] {
        let place = Place::new("remover");
        {
            let bus = place.bus("one");
            let before = place.files();
            let service = bus.frame_service(TOPIC, RGB).unwrap();
            // Open, so that they are still there when they have been removed.
            let files: Vec<(PathBuf, std::fs::File)> = place
                .files()
                .difference(&before)
                .filter(|path| !path.to_string_lossy().contains("/nodes/"))
                .map(|path| (path.clone(), std::fs::File::open(path).unwrap()))
                .collect();
            assert_eq!(files.len(), 2, "a description and its state: {files:?}");
            drop(service);
            for (path, mut file) in files {
                assert!(!path.exists(), "{}", path.display());
                if keeps_all || !path.starts_with("/dev/shm") {
                    let mut bytes = Vec::new();
                    file.read_to_end(&mut bytes).unwrap();
                    std::fs::write(&path, bytes).unwrap();
                    let mode = file.metadata().unwrap().permissions();
                    std::fs::set_permissions(&path, mode).unwrap();
                }
            }
        }
        let bus = place.bus("two");
        let publisher = bus.frame_service(TOPIC, RGB).unwrap().publisher().unwrap();
        let mut reader = bus.frame_reader(TOPIC).unwrap();
        assert_eq!(send(&publisher, 1, 1, 7), 1);
        assert!(reader.next().unwrap().is_some());
        drop((reader, publisher, bus));
        assert_eq!(place.left_over(), Vec::<String>::new());
    }
}
