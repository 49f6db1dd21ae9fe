//! `Program` against a small stand-in for the daemon, on real shared memory in a private place.

use std::time::{Duration, Instant};

use consumer_kit::{FollowedResult, Program, ProgramError, Publisher, Take};
use schema_bus::{Bus, FramePublisher, FrameReader, FrameTopic, Notifier};
use schema_frames::{Box2d, Modality, ResultType};

use crate::place::Place;

/// A sensor of the daemon.
struct Sensor {
    frames: FramePublisher,
    event: Notifier,
}

impl Sensor {
    fn open(bus: &Bus, topic: &str) -> Sensor {
        let spec = FrameTopic::new(Modality::Imu, 72);
        Sensor {
            frames: bus.frame_publisher(topic, spec).unwrap(),
            event: bus.notifier(topic).unwrap(),
        }
    }

    fn fire(&self, epoch: u64, tick: u64) {
        let mut loan = self.frames.loan(72).unwrap();
        let header = loan.header_mut();
        header.set_list(1);
        (header.tick, header.seq, header.epoch) = (tick, tick, epoch);
        loan.send().unwrap();
        self.event.notify();
    }
}

#[test]
fn the_newest_frames_of_one_tick_come_together() {
    let place = Place::new("pair");
    let daemon = place.bus("simd");
    let (left, right) = (
        Sensor::open(&daemon, "ego/left/imu"),
        Sensor::open(&daemon, "ego/right/imu"),
    );
    let mut program = Program::on(place.bus("pair"), Take::Newest, "{}").unwrap();
    let (a, b) = (
        program.input("ego/left/imu"),
        program.input("ego/right/imu"),
    );
    let out = program.output::<Box2d>("pair/boxes", &["car"]).unwrap();
    assert_eq!(left.frames.n_readers(), 1, "inputs stand before the output");

    // Tick 3 is whole, tick 4 has only one half yet.
    for tick in 1..=3 {
        left.fire(1, tick);
        right.fire(1, tick);
    }
    left.fire(1, 4);
    right.fire(1, 4);
    let frames = program.next().unwrap().unwrap();
    assert_eq!(
        (
            frames.tick(),
            frames[a].header().seq,
            frames[b].header().seq
        ),
        (4, 4, 4)
    );
    let reader_bus = place.bus("reader");
    let mut reader = reader_bus.result_reader("pair/boxes").unwrap();
    out.send(&[], &frames.all()).unwrap();
    let answer = reader.next().unwrap().unwrap();
    let topics: Vec<String> = answer.inputs().iter().map(|input| input.topic()).collect();
    assert_eq!(
        (answer.header().tick, topics),
        (4, vec!["ego/left/imu".into(), "ego/right/imu".into()])
    );
    drop((frames, answer));

    // The right one missed ticks 5 and 6; the run that began anew at tick 1 holds after that.
    left.fire(1, 5);
    left.fire(1, 6);
    for sensor in [&left, &right] {
        sensor.fire(2, 1);
    }
    let frames = program.next().unwrap().unwrap();
    assert_eq!(
        (
            frames.tick(),
            frames[a].header().epoch,
            frames[b].header().epoch
        ),
        (1, 2, 2)
    );
}

#[test]
fn every_frame_is_taken_if_the_program_asks_for_it() {
    let place = Place::new("all");
    let daemon = place.bus("simd");
    let imu = Sensor::open(&daemon, "ego/imu/imu");
    let mut program = Program::on(place.bus("all"), Take::All, "{}").unwrap();
    program.input("ego/imu/imu");
    program.output_of("all/text", ResultType::Text).unwrap();
    (1..=5).for_each(|tick| imu.fire(1, tick));
    let ticks: Vec<u64> = (0..5)
        .map(|_| program.next().unwrap().unwrap().tick())
        .collect();
    assert_eq!(ticks, [1, 2, 3, 4, 5]);
}

#[test]
fn settings_are_checked_and_handed_on_without_the_place_in_lockstep() {
    #[derive(Debug, PartialEq, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Settings {
        cell_m: f64,
    }
    let place = Place::new("settings");
    let open = |text: &str| Program::on(place.bus("settings"), Take::Newest, text);
    let program = open(r#"{"cell_m": 0.5, "lockstep": "me"}"#).unwrap();
    assert_eq!(
        program.params::<Settings>().unwrap(),
        Settings { cell_m: 0.5 }
    );
    for (text, sentence) in [
        ("{\"a\": ", "settings in the last argument cannot be read"),
        ("{\"lockstep\": 3}", "params.lockstep is 3; it is the name"),
    ] {
        let error = open(text).unwrap_err().to_string();
        assert!(error.contains(sentence), "{error}");
    }
    let unknown = open(r#"{"cell": 1}"#)
        .unwrap()
        .params::<Settings>()
        .unwrap_err();
    assert!(
        unknown.to_string().contains("unknown field `cell`"),
        "{unknown}"
    );
    let mut blind = open("{}").unwrap();
    assert!(matches!(blind.next(), Err(ProgramError::NoInputs)));
}

#[test]
fn a_place_in_lockstep_that_nobody_gives_ends_with_a_sentence() {
    let place = Place::new("alone");
    let daemon = place.bus("simd");
    let _imu = Sensor::open(&daemon, "ego/imu/imu");
    let mut program =
        Program::on(place.bus("alone"), Take::Newest, r#"{"lockstep": "me"}"#).unwrap();
    program.input("ego/imu/imu");
    let began = Instant::now();
    assert!(matches!(program.next(), Err(ProgramError::Lockstep(_))));
    assert!(began.elapsed() < Duration::from_secs(600));
}

/// Another program, which answers frames of `ego/imu/imu`.
struct Detector {
    boxes: Publisher<Box2d>,
    imu: FrameReader,
}

impl Detector {
    fn open(bus: &Bus) -> Detector {
        Detector {
            boxes: Publisher::open(bus, "other/boxes").unwrap(),
            imu: bus.frame_reader("ego/imu/imu").unwrap(),
        }
    }

    /// Answers the frame of `tick`, and none before.
    fn answer(&mut self, tick: u64) {
        loop {
            let frame = self.imu.next().unwrap().expect("the frame was sent");
            if frame.header().tick == tick {
                self.boxes.send(&[], &[&frame]).unwrap();
                return;
            }
        }
    }
}

#[test]
fn a_frame_comes_with_what_another_program_said_of_its_tick() {
    let place = Place::new("chain");
    let daemon = place.bus("simd");
    let imu = Sensor::open(&daemon, "ego/imu/imu");
    let other = place.bus("other");
    let mut detector = Detector::open(&other);
    let mut program = Program::on(place.bus("chain"), Take::Newest, "{}").unwrap();
    let (frame, boxes) = (program.input("ego/imu/imu"), program.results("other/boxes"));
    let out = program.output::<Box2d>("chain/boxes", &[]).unwrap();
    for tick in 1..=3 {
        imu.fire(1, tick);
    }
    // The first frame stays without an answer, and the second is no longer the newest when its own
    // comes.
    detector.answer(2);
    let found = program.next().unwrap().unwrap();
    let ticks = (found[frame].header().tick, found[boxes].header().tick);
    assert_eq!((found.tick(), ticks), (2, (2, 2)));
    let reader_bus = place.bus("reader");
    let mut reader = reader_bus.result_reader("chain/boxes").unwrap();
    out.send(&[], &found.all()).unwrap();
    let answer = reader.next().unwrap().unwrap();
    let topics: Vec<String> = answer.inputs().iter().map(|input| input.topic()).collect();
    assert_eq!(topics, ["ego/imu/imu", "other/boxes"]);
    drop((found, answer));

    // Of a simulator that was restarted both come again.
    imu.fire(2, 1);
    detector.answer(1);
    let found = program.next().unwrap().unwrap();
    assert_eq!((found.tick(), found[frame].header().epoch), (1, 2));
}

#[test]
fn a_result_of_a_tick_is_waited_for_and_earlier_ones_are_dropped() {
    let place = Place::new("wait_for");
    let daemon = place.bus("simd");
    let imu = Sensor::open(&daemon, "ego/imu/imu");
    let bus = place.bus("reader");
    let mut boxes = FollowedResult::new("other/boxes", Take::All);
    let none = boxes.wait(&bus, Duration::from_millis(1)).unwrap();
    assert!(none.is_none(), "the topic does not exist yet");
    let other = place.bus("other");
    let mut detector = Detector::open(&other);
    while !boxes.look(&bus).unwrap() {
        std::thread::sleep(Duration::from_millis(1));
    }
    for tick in 1..=2 {
        imu.fire(1, tick);
        detector.answer(tick);
    }
    let minute = Duration::from_secs(60);
    let found = boxes.wait_for(&bus, 2, minute).unwrap().unwrap();
    assert_eq!((found.header().tick, found.header().seq), (2, 2));
    let none = boxes.wait_for(&bus, 3, Duration::from_millis(1)).unwrap();
    assert!(none.is_none());
    let late = std::thread::scope(|scope| {
        scope.spawn(|| {
            std::thread::sleep(Duration::from_millis(20));
            imu.fire(1, 3);
            detector.answer(3);
        });
        boxes.wait_for(&bus, 3, minute).unwrap()
    });
    assert_eq!(
        late.unwrap().header().tick,
        3,
        "it was sent during the wait"
    );
}
