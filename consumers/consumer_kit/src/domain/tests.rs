//! A domain on real shared memory in a private place, listed by hand and by its thread.

use std::time::{Duration, Instant};

use schema_bus::{Bus, BusOptions, FramePublisher, FrameTopic, ResultTopic, TopicKind};
use schema_frames::{Modality, ResultType};

use super::{Change, Domain, ListedTopic, Listing, Rhythm, Wish};
use crate::{Take, TopicId};

const IMU: &str = "ego/imu/imu";
const SEARCHED: Duration = Duration::from_secs(20);

struct Place(tempfile::TempDir, String);

impl Place {
    fn new(name: &str) -> Place {
        let folder = tempfile::tempdir().expect("a folder for the test");
        Place(folder, format!("gd{}_{name}_", std::process::id()))
    }

    fn bus(&self, program: &str) -> Bus {
        let options = BusOptions {
            iceoryx_root: Some(self.0.path().join("iox")),
            prefix: Some(self.1.clone()),
        };
        Bus::open_with("d", program, &options).unwrap()
    }

    fn domain(&self, rhythm: Rhythm) -> Domain {
        let listing = Listing::start(self.bus("look"), rhythm).unwrap();
        Domain::on(self.bus("consumer"), listing)
    }
}

impl Drop for Place {
    /// Removes the one file that iceoryx2 keeps for ever; the prefix is never used again.
    fn drop(&mut self) {
        for entry in std::fs::read_dir("/dev/shm").unwrap().flatten() {
            if entry.file_name().to_string_lossy().starts_with(&self.1) {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }
}

/// Lists so seldom that a test lists by itself.
const SELDOM: Rhythm = Rhythm::steady(Duration::from_secs(3600));

fn imu(bus: &Bus) -> FramePublisher {
    bus.frame_publisher(IMU, FrameTopic::new(Modality::Imu, 72))
        .unwrap()
}

fn send(imu: &FramePublisher, seq: u64) {
    let mut loan = imu.loan(72).unwrap();
    let header = loan.header_mut();
    header.set_list(1);
    (header.tick, header.seq, header.epoch) = (seq, seq, 1);
    loan.send().unwrap();
}

fn frames_only(listed: ListedTopic<'_>) -> Option<Wish> {
    (listed.details.kind == TopicKind::Frames).then(|| Wish::follow(Take::All))
}

fn changes(domain: &mut Domain) -> Vec<Change> {
    std::iter::from_fn(|| domain.change()).collect()
}

fn found(domain: &mut Domain) -> TopicId {
    match changes(domain).as_slice() {
        [Change::Found { id, .. }] => *id,
        other => panic!("one topic should be new: {other:?}"),
    }
}

#[test]
fn the_thread_finds_a_topic_and_its_frames_are_taken_from_the_first_on() {
    let place = Place::new("thread");
    let mut domain = place.domain(Rhythm::steady(Duration::from_millis(10)));
    let daemon = place.bus("simd");
    let imu = imu(&daemon);
    let deadline = Instant::now() + SEARCHED;
    while imu.n_readers() == 0 {
        assert!(Instant::now() < deadline, "the topic was not found");
        domain.look(frames_only).unwrap();
        domain.wait(Duration::from_millis(10)).unwrap();
    }
    let id = found(&mut domain);
    (1..=3).for_each(|seq| send(&imu, seq));
    let taken: Vec<u64> = std::iter::from_fn(|| domain.take_frame(id).unwrap())
        .map(|frame| frame.header().seq)
        .collect();
    assert_eq!(taken, [1, 2, 3]);
    assert_eq!(domain.topics().collect::<Vec<_>>(), [(id, IMU)]);
}

#[test]
fn a_topic_on_demand_is_read_only_while_it_is_wanted() {
    let place = Place::new("demand");
    let daemon = place.bus("simd");
    let imu = imu(&daemon);
    let mut domain = place.domain(SELDOM);
    domain
        .look_now(|_| Some(Wish::on_demand(Take::All)))
        .unwrap();
    let id = found(&mut domain);
    domain.open().unwrap();
    assert_eq!(imu.n_readers(), 0, "nobody wants it");
    assert!(domain.want(id, true).is_none());
    assert!(domain.open().unwrap());
    assert_eq!(imu.n_readers(), 1);
    send(&imu, 1);
    assert!(domain.take_frame(id).unwrap().is_some());
    let report = domain.want(id, false).expect("it was closed");
    assert_eq!((imu.n_readers(), report.counts.taken), (0, 1));
    assert!(domain.take_frame(id).unwrap().is_none());
}

#[test]
fn a_topic_that_is_wanted_no_more_ends_and_may_be_found_again() {
    let place = Place::new("end");
    let daemon = place.bus("simd");
    let imu = imu(&daemon);
    let mut domain = place.domain(SELDOM);
    domain.look_now(frames_only).unwrap();
    let id = found(&mut domain);
    domain.open().unwrap();
    send(&imu, 1);
    domain.look_now(|_| None).unwrap();
    assert!(matches!(changes(&mut domain).as_slice(), [Change::Ended(ended)] if *ended == id));
    // What waits can still be taken.
    assert!(domain.take_frame(id).unwrap().is_some());
    assert_eq!(domain.leave(id).expect("it was followed").counts.taken, 1);
    assert!(domain.leave(id).is_none());
    domain.look_now(frames_only).unwrap();
    found(&mut domain);
}

#[test]
fn a_result_whose_writer_has_ended_is_silent_and_not_followed_again_without_one() {
    let place = Place::new("silent");
    let daemon = place.bus("detector");
    let publisher = daemon
        .result_publisher("detector/words", &ResultTopic::new(ResultType::Text))
        .unwrap();
    let other = place.bus("other");
    let _reader = other.result_reader("detector/words").unwrap();
    let results = |listed: ListedTopic<'_>| {
        (listed.details.kind == TopicKind::Results).then(|| Wish::follow(Take::All))
    };
    let mut domain = place.domain(SELDOM);
    domain.look_now(results).unwrap();
    let id = found(&mut domain);
    domain.open().unwrap();
    drop(publisher);
    domain.look_now(results).unwrap();
    assert!(matches!(changes(&mut domain).as_slice(), [Change::Silent(silent)] if *silent == id));
    domain.leave(id);
    domain.look_now(results).unwrap();
    assert!(changes(&mut domain).is_empty(), "it has ended");
}

#[test]
fn a_topic_without_a_free_place_is_told_once() {
    let place = Place::new("full");
    let daemon = place.bus("simd");
    let _imu = imu(&daemon);
    let other = place.bus("other");
    let limit = other.topics().unwrap()[0].max_subscribers;
    let mut readers: Vec<_> = (0..limit)
        .map(|_| other.frame_reader(IMU).unwrap())
        .collect();
    let mut domain = place.domain(SELDOM);
    domain.look_now(frames_only).unwrap();
    domain.look_now(frames_only).unwrap();
    assert!(matches!(changes(&mut domain).as_slice(), [Change::Full(_)]));
    readers.pop();
    domain.look_now(frames_only).unwrap();
    found(&mut domain);
}
