//! Programs of users that do one thing wrong: they flood, send garbage, lie about lengths, stop, or
//! die with shared memory in hand. In each test the simulator's ticks go on, another client is
//! served, a line names the process once, and nothing is left in shared memory.
//!
//! The wrong is done by the example `misbehave`, a process of its own.

use nix::sys::signal::Signal;
use schema_bus::ResultTopic;
use schema_frames::{Command, CommandReply, ResultType};
use test_e2e::{SMALL_RIG, Stage, ask, counter, reader, spawn_consumer, step};
use test_kit::{Process, eventually};

/// What the tests here do beside [`Stage`].
trait WithFaults {
    /// Starts a program with a fault.
    fn start(&self, fault: &str, word: &str) -> Process;
    /// As [`WithFaults::start`], and waits until the program is at work.
    fn misbehave(&self, fault: &str, word: &str) -> Process;
    /// An actor that is a vehicle.
    fn vehicle(&self) -> u32;
    /// Waits until one of the daemon's counters is above a number.
    fn counts(&mut self, name: &str, above: u64);
    /// Ends both, the wrongdoer by `kill -9`, and asserts that nothing is left.
    fn end_with(self, wrongdoer: Process);
}

impl WithFaults for Stage {
    fn start(&self, fault: &str, word: &str) -> Process {
        let program = test_kit::sandbox::binary_path("examples/misbehave");
        let args = [self.sandbox.domain(), fault, word];
        self.sandbox
            .spawn_program("misbehave", &program, &args, &[])
    }

    fn misbehave(&self, fault: &str, word: &str) -> Process {
        let mut process = self.start(fault, word);
        process.wait_line("at work");
        process
    }

    fn vehicle(&self) -> u32 {
        let mut snapshots = self.bus.snapshot_reader().unwrap();
        let snapshot = eventually("a snapshot", || snapshots.latest().unwrap());
        let is_vehicle = |record: &&schema_frames::ActorRecord| {
            record.kind() == Some(schema_frames::ActorKind::Vehicle)
        };
        let vehicle = snapshot.records().iter().find(is_vehicle);
        vehicle.expect("the small rig has vehicles").id
    }

    fn counts(&mut self, name: &str, above: u64) {
        eventually(&format!("{name} is above {above}"), || {
            (counter(&mut self.client, name) > above).then_some(())
        });
    }

    fn end_with(self, wrongdoer: Process) {
        wrongdoer.kill9();
        self.end();
    }
}

/// A simulator that ticks on its own.
fn begin(name: &str, extra: &[&str]) -> Stage {
    Stage::new(name, SMALL_RIG, extra)
}

/// A simulator that ticks when it is asked to.
fn begin_stepped(name: &str) -> Stage {
    let launch = SMALL_RIG.replace("tick_hz = 20", "tick_hz = 20\nmode = \"stepped\"");
    assert_ne!(launch, SMALL_RIG);
    Stage::new(name, &launch, &[])
}

/// How the daemon calls a process.
fn named(process: &Process) -> String {
    format!("process {} (misbehave)", process.pid())
}

#[test]
fn a_flood_of_controls_starves_neither_ticks_nor_other_writers() {
    let mut stage = begin("flood-vehicles", &[]);
    let vehicle = stage.vehicle();
    let flooder = stage.misbehave("flood-vehicles", &vehicle.to_string());
    stage.is_said_once(&[&named(&flooder), "floods control/vehicles", "lost"]);
    stage.counts("control_samples_lost", 100);
    // Another writer's control is applied in the midst of it: names are sorted, the last counts.
    let mut other = stage.bus.control_writer("zealous").unwrap();
    let mut snapshots = stage.bus.snapshot_reader().unwrap();
    eventually("another writer's control is seen", || {
        let control = schema_frames::VehicleControl {
            brake_ratio: 0.375,
            ..Default::default()
        };
        let record = schema_frames::VehicleControlRecord::new(vehicle, control);
        other.send(1, &[record]).unwrap();
        let snapshot = snapshots.latest().unwrap()?;
        let part = snapshot.actor(vehicle)?.vehicle()?;
        (part.brake_ratio == 0.375).then_some(())
    });
    let before = stage.daemon.resident_bytes();
    stage.ticks_go_on(40);
    let grown = stage.daemon.resident_bytes().saturating_sub(before);
    assert!(grown < 64 << 20, "the daemon grew by {grown} bytes");
    drop((other, snapshots));
    stage.end_with(flooder);
}

#[test]
fn a_flood_of_requests_starves_neither_ticks_nor_other_clients() {
    let mut stage = begin("flood-requests", &[]);
    let flooder = stage.misbehave("flood-requests", "");
    stage.is_said_once(&[&named(&flooder), "floods control/world", "lost"]);
    let mut imu = reader(&stage.bus, "ego/imu/imu");
    eventually("a frame", || imu.next().unwrap());
    drop(imu);
    stage.end_with(flooder);
}

/// Samples of as many records as are read, as fast as they can be sent: a tick takes a bounded
/// part of them.
#[test]
fn a_flood_of_long_controls_starves_neither_ticks_nor_other_writers() {
    let mut stage = begin("flood-long-vehicles", &[]);
    let vehicle = stage.vehicle();
    let flooder = stage.misbehave("flood-long-vehicles", &vehicle.to_string());
    stage.is_said_once(&[&named(&flooder), "floods control/vehicles", "lost"]);
    let before = stage.daemon.resident_bytes();
    stage.ticks_go_on(20);
    let grown = stage.daemon.resident_bytes().saturating_sub(before);
    assert!(grown < 512 << 20, "the daemon grew by {grown} bytes");
    stage.end_with(flooder);
}

/// Requests of megabytes, each sent before the one before is answered: of one client one has its
/// turn, and others are answered in the same turn.
#[test]
fn a_flood_of_long_requests_starves_neither_ticks_nor_other_clients() {
    let mut stage = begin("flood-long-requests", &[]);
    let flooder = stage.misbehave("flood-long-requests", "");
    stage.is_said_once(&[&named(&flooder), "floods control/world", "lost"]);
    stage.ticks_go_on(5);
    stage.end_with(flooder);
}

#[test]
fn requests_of_garbage_are_refused_and_their_process_is_named() {
    let mut stage = begin("garbage-requests", &[]);
    let wrongdoer = stage.misbehave("garbage-requests", "");
    stage.is_said_once(&[&named(&wrongdoer), "on control/world", "refused"]);
    stage.end_with(wrongdoer);
}

#[test]
fn acknowledgements_of_nobody_are_named_and_counted() {
    let mut stage = begin("flood-acks", &[]);
    let wrongdoer = stage.misbehave("flood-acks", "");
    stage.is_said_once(&[&named(&wrongdoer), "never joined"]);
    stage.counts("acks_refused", 100);
    stage.end_with(wrongdoer);
}

/// A writer that acknowledges for a participant that is not itself: the gate waits on for the
/// participant.
#[test]
fn nobody_acknowledges_for_another() {
    let mut stage = begin("acks-of-others", &[]);
    let participant = consumer_kit::Lockstep::join(&stage.bus, "slow", test_kit::PATIENCE).unwrap();
    let first = participant.first_tick();
    // The first participant of a run is number 1.
    let wrongdoer = stage.misbehave("acks-of-others", "1");
    let words = [named(&wrongdoer), "which is \"slow\"".to_owned()];
    let has_all = |line: &String| words.iter().all(|word| line.contains(word));
    eventually("the daemon names it", || {
        stage.daemon.lines().iter().any(has_all).then_some(())
    });
    eventually("the participant's first tick", || {
        (counter(&mut stage.client, "ticks") == first).then_some(())
    });
    // Each question takes turns of the daemon, in which it would have gone on.
    for _ in 0..20 {
        assert_eq!(
            counter(&mut stage.client, "ticks"),
            first,
            "the world waits for the real participant"
        );
    }
    participant.ack(first).unwrap();
    eventually("the next tick", || {
        (counter(&mut stage.client, "ticks") == first + 1).then_some(())
    });
    drop(participant);
    stage.ticks_go_on(5);
    stage.end_with(wrongdoer);
}

#[test]
fn nobody_acknowledges_the_future() {
    let mut stage = begin("future-acks", &[]);
    let wrongdoer = stage.misbehave("future-acks", "");
    let words = [named(&wrongdoer), "has only begun tick".to_owned()];
    let has_all = |line: &String| words.iter().all(|word| line.contains(word));
    eventually("the daemon names it", || {
        stage.daemon.lines().iter().any(has_all).then_some(())
    });
    let ticks = counter(&mut stage.client, "ticks");
    let lines = stage.daemon.lines();
    assert_eq!(lines.iter().filter(|line| has_all(line)).count(), 1);
    assert!(counter(&mut stage.client, "ticks") <= ticks + 1, "it waits");
    let wrongdoer_name = named(&wrongdoer);
    wrongdoer.kill9();
    stage.daemon.wait_line("lockstep participant is gone");
    stage.ticks_go_on(5);
    let next = stage.misbehave("lockstep", "");
    assert_ne!(named(&next), wrongdoer_name);
    stage.ticks_go_on(5);
    stage.end_with(next);
}

#[test]
fn controls_of_garbage_are_dropped_and_their_process_is_named() {
    let mut stage = begin("garbage-vehicles", &[]);
    let wrongdoer = stage.misbehave("garbage-vehicles", "");
    stage.is_said_once(&[&named(&wrongdoer), "on control/vehicles", "dropped"]);
    stage.counts("control_samples_refused", 100);
    stage.end_with(wrongdoer);
}

/// Not a number in a control: the vehicle keeps the control that it has, and its place stays a
/// number.
#[test]
fn a_control_that_is_not_a_number_is_refused() {
    let mut stage = begin("wild-controls", &[]);
    let vehicle = stage.vehicle();
    let wrongdoer = stage.misbehave("wild-controls", &vehicle.to_string());
    stage.is_said_once(&[&named(&wrongdoer), "steer_ratio", "NaN", "finite"]);
    let mut snapshots = stage.bus.snapshot_reader().unwrap();
    let snapshot = eventually("a snapshot", || snapshots.latest().unwrap());
    let record = snapshot.actor(vehicle).expect("the vehicle is there");
    let part = record.vehicle().expect("it is a vehicle");
    assert_eq!(part.throttle_ratio, 0.0, "nothing of the record is applied");
    assert!(record.speed_mps().is_finite());
    drop((snapshot, snapshots));
    stage.end_with(wrongdoer);
}

#[test]
fn a_control_for_an_actor_that_is_not_there_is_refused() {
    let mut stage = begin("unknown-vehicle", &[]);
    let wrongdoer = stage.misbehave("unknown-vehicle", "");
    stage.is_said_once(&[&named(&wrongdoer), "999999", "refused"]);
    stage.counts("controls_refused", 10);
    stage.end_with(wrongdoer);
}

/// A second writer on a sensor's topic sends headers with wrong magic, version and lengths. The
/// recorder refuses them, names the process, and keeps the sensor's own frames.
#[test]
fn garbage_on_a_sensors_topic_is_refused_by_its_readers() {
    let mut stage = begin("garbage-frames", &[]);
    let mut recorder = spawn_consumer(&stage.sandbox, "gantry-record", &["--out", "a.mcap"]);
    eventually("the recorder reads", || {
        let topics = stage.bus.topics().ok()?;
        let imu = topics.iter().find(|t| t.name == "ego/imu/imu")?;
        (imu.subscribers > 0).then_some(())
    });
    let wrongdoer = stage.misbehave("garbage-frames", "ego/imu/imu");
    let line = recorder.wait_line("refused a frame");
    assert!(line.contains(&named(&wrongdoer)), "{line}");
    stage.ticks_go_on(20);
    let refusals = recorder.lines().into_iter();
    let refusals = refusals.filter(|line| line.contains("refused a frame"));
    assert_eq!(refusals.count(), 1, "it is said once");
    // Losses are told by the exit code; a flooded topic loses frames.
    assert!([0, 3].contains(&recorder.stop().code()));
    let found = test_e2e::recording::sequences(&stage.sandbox.path("a.mcap"));
    assert!(!found["/ego/front/rgb/gantry"].is_empty());
    stage.end_with(wrongdoer);
}

/// Snapshots that claim more actors than they have: a driver refuses them and goes on driving.
#[test]
fn garbage_snapshots_are_refused_by_their_readers() {
    let mut stage = begin("garbage-snapshots", &[]);
    let mut driver = spawn_consumer(&stage.sandbox, "gantry-drive", &[]);
    driver.wait_line("driving vehicles=");
    let wrongdoer = stage.misbehave("garbage-snapshots", "");
    let line = eventually("the driver names it", || {
        let lines = driver.lines();
        lines
            .into_iter()
            .find(|line| line.contains(&named(&wrongdoer)))
    });
    assert!(line.contains("world/snapshot"), "{line}");
    stage.ticks_go_on(20);
    assert!(driver.is_running());
    let wrongdoer_gone = wrongdoer.kill9();
    assert!(!wrongdoer_gone.status.success());
    driver.stop().expect_code(0);
    let bystander = stage.misbehave("unknown-vehicle", "");
    stage.end_with(bystander);
}

/// A reader that keeps every frame it may hold: the sensor has slots for all its readers, so it
/// loses nothing, and another reader gets every frame.
#[test]
fn a_reader_that_holds_all_it_may_takes_nothing_from_others() {
    let mut stage = begin_stepped("hold-frames");
    let mut imu = reader(&stage.bus, "ego/imu/imu");
    let holder = stage.start("hold-frames", "ego/imu/imu");
    let mut last: Option<u64> = None;
    let mut frame_of_a_tick = |stage: &mut Stage| {
        step(&mut stage.client, 1);
        let frame = eventually("the tick's frame", || imu.next().unwrap());
        let seq = frame.header().seq;
        assert!(last.is_none_or(|last| seq == last + 1), "{last:?}, {seq}");
        last = Some(seq);
    };
    eventually("it holds all it may", || {
        frame_of_a_tick(&mut stage);
        let lines = holder.lines();
        let is_it = lines.iter().any(|line| line.contains("holds 4 frames"));
        is_it.then_some(())
    });
    for _ in 0..40 {
        frame_of_a_tick(&mut stage);
    }
    assert_eq!(counter(&mut stage.client, "dropped ego/imu/imu"), 0);
    drop(imu);
    stage.end_with(holder);
}

/// A killed reader is noticed while the world runs on and no other process comes or goes: what it
/// alone read is no longer rendered.
#[test]
fn nothing_is_rendered_for_a_killed_reader() {
    let mut stage = begin("dead-reader", &[]);
    let mut holder = stage.misbehave("hold-frames", "ego/front/depth");
    holder.wait_line("holds 3 frames");
    let sent = |stage: &mut Stage| counter(&mut stage.client, "sent ego/front/depth");
    let before = sent(&mut stage);
    eventually("it is rendered for", || {
        (sent(&mut stage) > before + 3).then_some(())
    });
    holder.kill9();
    eventually("it is rendered for no more", || {
        let before = sent(&mut stage);
        stage.ticks_go_on(10);
        (sent(&mut stage) == before).then_some(())
    });
    let bystander = stage.misbehave("unknown-vehicle", "");
    stage.end_with(bystander);
}

/// Results of which the headers lie about what they carry: whoever reads them refuses them and goes
/// on with everything else.
#[test]
fn garbage_results_are_refused_by_their_readers() {
    let mut stage = begin("garbage-results", &[]);
    let wrongdoer = stage.misbehave("garbage-results", "own/boxes");
    let mut recorder = spawn_consumer(&stage.sandbox, "gantry-record", &["--out", "a.mcap"]);
    let mut viewer = spawn_consumer(&stage.sandbox, "gantry-view", &["--save", "a.rrd"]);
    for reader in [&mut recorder, &mut viewer] {
        let line = reader.wait_line("refused a result");
        assert!(line.contains(&named(&wrongdoer)), "{line}");
    }
    stage.ticks_go_on(20);
    for reader in [recorder, viewer] {
        let refusals = reader.lines().into_iter();
        let refusals = refusals.filter(|line| line.contains("refused a result"));
        assert_eq!(refusals.count(), 1, "it is said once");
        assert!([0, 3].contains(&reader.stop().code()));
    }
    stage.end_with(wrongdoer);
}

/// A process is killed while it fills samples of two topics: nobody sees them, and its places and
/// memory come back.
#[test]
fn a_process_that_dies_inside_a_loan_leaves_no_trace() {
    let mut stage = begin("die-in-loan", &[]);
    for _ in 0..4 {
        let ended = stage.start("die-in-loan", "own/boxes").wait();
        assert!(ended.says("at work"), "{:?}", ended.lines);
        assert_eq!(
            std::os::unix::process::ExitStatusExt::signal(&ended.status),
            Some(Signal::SIGKILL as i32)
        );
        stage.ticks_go_on(3);
    }
    // The daemon may be cleaning up just now, and only one process at a time does.
    eventually("its topic is gone", || {
        stage.bus.clean_dead_nodes();
        let topics = stage.bus.topics().unwrap();
        let is_there = topics.iter().any(|topic| topic.name == "own/boxes");
        (!is_there).then_some(())
    });
    let bystander = stage.misbehave("unknown-vehicle", "");
    stage.end_with(bystander);
}

/// A participant that is stopped holds the world, which is what lockstep promises. A line says for
/// whom the world waits, and why; once the process goes on, so does the world.
#[test]
fn a_stopped_participant_is_named_while_the_world_waits() {
    let mut stage = begin("stopped", &[]);
    let participant = stage.misbehave("lockstep", "");
    stage.ticks_go_on(5);
    participant.signal(Signal::SIGSTOP);
    let line = stage.daemon.wait_line("the world waits for");
    assert!(line.contains(&named(&participant)), "{line}");
    assert!(line.contains("which is stopped"), "{line}");
    // Commands are served meanwhile.
    assert!(matches!(
        ask(&mut stage.client, Command::Ping),
        CommandReply::Pong { .. }
    ));
    participant.signal(Signal::SIGCONT);
    stage.ticks_go_on(5);
    stage.end_with(participant);
}

#[test]
fn a_stopped_participant_is_removed_after_the_time_out() {
    is_removed_after("timed-out", &["--lockstep-timeout", "1"]);
}

#[test]
fn a_stopped_participant_is_removed_after_the_launch_files_time_out() {
    is_removed_after(
        "timed-out-file",
        &["--set", "scenario.lockstep_timeout_s=1.5"],
    );
}

fn is_removed_after(name: &str, extra: &[&str]) {
    let mut stage = begin(name, extra);
    let participant = stage.misbehave("lockstep", "");
    stage.ticks_go_on(5);
    participant.signal(Signal::SIGSTOP);
    let line = stage.daemon.wait_line("idle for longer than");
    assert!(line.contains(&named(&participant)), "{line}");
    stage.ticks_go_on(5);
    // What it acknowledges when it wakes up no longer counts, and it is told once.
    participant.signal(Signal::SIGCONT);
    stage.is_said_once(&[&named(&participant), "was removed from it"]);
    stage.end_with(participant);
}

/// A participant that was killed comes back under its name before the daemon noticed its death.
#[test]
fn a_killed_participant_may_come_back_at_once() {
    let mut stage = begin("comes-back", &[]);
    let first = stage.misbehave("lockstep", "");
    stage.ticks_go_on(5);
    let second = {
        first.kill9();
        stage.misbehave("lockstep", "")
    };
    stage.ticks_go_on(10);
    // While it lives, nobody else may join under its name.
    let refused = consumer_kit::Lockstep::join(&stage.bus, "misbehave", test_kit::PATIENCE);
    let sentence = refused.expect_err("the name is taken").to_string();
    assert!(sentence.contains(&named(&second)), "{sentence}");
    stage.ticks_go_on(10);
    stage.end_with(second);
}

/// In stepped mode a flood of wake-ups and requests causes no tick that nobody asked for.
#[test]
fn a_flood_in_stepped_mode_causes_no_ticks() {
    let mut stage = begin_stepped("stepped-flood");
    let flooder = stage.misbehave("flood-requests", "");
    assert_eq!(step(&mut stage.client, 3), 3);
    assert_eq!(counter(&mut stage.client, "ticks"), 3);
    assert_eq!(step(&mut stage.client, 2), 5);
    stage.end_with(flooder);
}

/// A result's topic stays in the list while somebody reads it. The recorder reads it no longer some
/// time after its writer has ended, so two recorders do not keep it for each other, and reads it
/// again when there is a writer again.
#[test]
fn a_recorder_leaves_results_whose_writer_has_ended() {
    let stage = begin("ended-writer", &[]);
    let spec = ResultTopic::new(ResultType::Text);
    let writer = stage.bus.result_publisher("own/words", &spec).unwrap();
    let reader = stage.bus.result_reader("own/words").unwrap();
    let recorder = spawn_consumer(&stage.sandbox, "gantry-record", &["--out", "a.mcap"]);
    let has_readers = |n: usize| {
        eventually(&format!("{n} readers"), || {
            let topics = stage.bus.topics().ok()?;
            let words = topics.iter().find(|topic| topic.name == "own/words")?;
            (words.subscribers == n).then_some(())
        });
    };
    has_readers(2);
    drop(writer);
    has_readers(1);
    let writer = stage.bus.result_publisher("own/words", &spec).unwrap();
    has_readers(2);
    let mut loan = writer.loan(5).unwrap();
    loan.body_mut().copy_from_slice(b"again");
    loan.set_list(5, 1, 0).unwrap();
    assert_eq!(loan.send().unwrap(), 2);
    assert!([0, 3].contains(&recorder.stop().code()));
    let found = test_e2e::recording::sequences(&stage.sandbox.path("a.mcap"));
    let mut topics = found.keys();
    assert!(
        topics.any(|topic| topic.starts_with("/own/words")),
        "{found:?}"
    );
    drop((reader, writer));
    stage.end();
}
