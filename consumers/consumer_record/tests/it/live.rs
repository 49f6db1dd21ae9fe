//! The recorder on a real bus, against a small stand-in for the daemon that publishes the made-up
//! frames of `sample`.

use crate::sample;

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Barrier;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use consumer_record::options::{Coding, Options};
use consumer_record::session::{Report, record};
use sample::PERIOD_NANOS;
use schema_bus::{
    AckReader, Bus, BusOptions, CommandServer, DocumentPublisher, FramePublisher, FrameTopic,
    Listener, Notifier, SnapshotPublisher, names,
};
use schema_frames::{
    ActorKind, ActorRecord, Command, CommandReply, FrameHeader, Modality, ReplyBatch,
    SnapshotHeader, WorldInfo,
};
use schema_recording::write::ChunkCompression;
use schema_types::Pose;

const EPOCH: u64 = 77;

/// Publishes a tick's frames; waits for acknowledgements once somebody joined.
struct Daemon {
    frames: Vec<(String, FramePublisher)>,
    snapshot: SnapshotPublisher,
    snapshot_wake: Notifier,
    events: Vec<Notifier>,
    documents: Vec<DocumentPublisher>,
    commands: CommandServer,
    acks: AckReader,
    wake: Listener,
    tick: u64,
    joined: bool,
    acked: u64,
    epoch: u64,
    _bus: Bus,
}

impl Daemon {
    fn new(options: &BusOptions, epoch: u64) -> Daemon {
        let bus = Bus::open_with("test", "daemon", options).unwrap();
        let publisher = |topic: String| {
            let modality = Modality::from_name(topic.rsplit('/').next().unwrap()).unwrap();
            let publisher = bus
                .frame_publisher(&topic, FrameTopic::new(modality, 64 * 48 * 8))
                .unwrap();
            (topic, publisher)
        };
        let info = WorldInfo {
            source: "live".into(),
            version: "0".into(),
            epoch: epoch.to_string(),
            episode: 1,
            map: "Gantry/Sample".into(),
            seed: 5,
            mode: Default::default(),
            period_nanos: PERIOD_NANOS,
            episode_start_nanos: 0,
            lockstep: vec![],
            weather: Default::default(),
            adapter: String::new(),
            cpu_copies: 0,
            batches: Vec::new(),
            cameras: Vec::new(),
        };
        let mut documents: Vec<DocumentPublisher> = [names::WORLD_INFO, names::WORLD_MAP]
            .map(|name| bus.document_publisher(name).unwrap())
            .into();
        documents[0].send_json(&info, epoch, 0).unwrap();
        documents[1].send("<OpenDRIVE/>", epoch, 0).unwrap();
        Daemon {
            frames: sample::topics().into_iter().map(publisher).collect(),
            snapshot: bus.snapshot_publisher(8).unwrap(),
            snapshot_wake: bus.notifier(names::WORLD_SNAPSHOT).unwrap(),
            events: sample::topics()
                .into_iter()
                .chain([names::rig_tick("ego")])
                .map(|event| bus.notifier(&event).unwrap())
                .collect(),
            documents,
            commands: bus.command_server().unwrap(),
            acks: bus.ack_reader().unwrap(),
            wake: bus.listener(names::CONTROL_WAKE).unwrap(),
            tick: 0,
            joined: false,
            acked: 0,
            epoch,
            _bus: bus,
        }
    }

    fn serve(&mut self) {
        self.documents.iter().for_each(DocumentPublisher::greet);
        self.snapshot.greet();
        self.acked = self
            .acks
            .drain()
            .unwrap()
            .iter()
            .map(|ack| ack.tick)
            .max()
            .unwrap_or(0)
            .max(self.acked);
        while let Some(request) = self.commands.take().unwrap() {
            let reply = |command: &Command| match command {
                Command::JoinLockstep { .. } => CommandReply::Joined {
                    participant: 1,
                    first_tick: self.tick + 1,
                },
                Command::LeaveLockstep { .. } => CommandReply::Done,
                _ => CommandReply::Pong {
                    version: "0".into(),
                },
            };
            let commands = request.batch.clone().unwrap().commands;
            self.joined |= commands
                .iter()
                .any(|command| matches!(command, Command::JoinLockstep { .. }));
            self.joined &= !commands
                .iter()
                .any(|command| matches!(command, Command::LeaveLockstep { .. }));
            let answer = ReplyBatch {
                v: 1,
                epoch: self.epoch.to_string(),
                tick: self.tick,
                replies: commands.iter().map(reply).collect(),
            };
            self.commands.reply(request, &answer).unwrap();
        }
    }

    /// Whether every participant is done with the last tick.
    fn gate_is_open(&mut self) -> bool {
        self.serve();
        !self.joined || self.acked >= self.tick
    }

    fn run_tick(&mut self) {
        self.tick += 1;
        let tick = self.tick;
        let ego = ActorRecord {
            id: 7,
            kind: ActorKind::Vehicle as u16,
            class: 14,
            world_from_actor: Pose::from_xyz_yaw(tick as f64, 2.0, 0.0, 0.1),
            half_box_m: [2.0, 1.0, 0.8],
            ..bytemuck::Zeroable::zeroed()
        };
        let header = SnapshotHeader {
            tick,
            sim_nanos: tick * PERIOD_NANOS,
            epoch: self.epoch,
            ..bytemuck::Zeroable::zeroed()
        };
        self.snapshot.send(header, &[ego]).unwrap();
        self.snapshot_wake.notify();
        self.publish_frames(tick);
    }

    fn publish_frames(&mut self, tick: u64) {
        for (topic, publisher) in &self.frames {
            let (header, payload) = sample::frame(topic, tick);
            if publisher.n_readers() > 0 {
                let mut loan = publisher.loan(payload.len()).unwrap();
                loan.payload_mut().copy_from_slice(&payload);
                *loan.header_mut() = FrameHeader {
                    epoch: self.epoch,
                    ..header
                };
                loan.send().unwrap();
            }
        }
        self.events.iter().for_each(|event| {
            event.notify_listeners();
        });
    }
}

fn private(folder: &Path) -> BusOptions {
    BusOptions {
        iceoryx_root: Some(folder.join("iox")),
        prefix: Some(format!(
            "{}_",
            folder
                .file_name()
                .unwrap()
                .to_string_lossy()
                .trim_start_matches('.')
        )),
    }
}

/// Runs daemon and recorder until `n_ticks` ticks were published with the recorder present. Returns
/// its report and the first and last tick.
fn record_live(
    folder: &Path,
    lockstep: bool,
    coding: Coding,
    n_ticks: u64,
    pause: Duration,
) -> (Report, u64, u64) {
    let bus = private(folder);
    let mut daemon = Daemon::new(&bus, EPOCH);
    let options = Options {
        domain: "test".into(),
        bus,
        select: Default::default(),
        out: folder.join("live.mcap"),
        compression: ChunkCompression::Lz4,
        queue_bytes: 64 << 20,
        lockstep,
        coding,
        ..Options::new("test", "unused".into())
    };
    let (stop, first) = (AtomicBool::new(false), AtomicU64::new(0));
    let report = std::thread::scope(|scope| {
        let recorder = scope.spawn(|| record(&options, &|| stop.load(Ordering::Acquire)));
        let deadline = Instant::now() + Duration::from_secs(60);
        let present = |daemon: &Daemon| {
            daemon
                .frames
                .iter()
                .all(|(_, publisher)| publisher.n_readers() > 0)
        };
        while !(present(&daemon) && (!lockstep || daemon.joined)) {
            daemon.serve();
            daemon.wake.wait(Duration::from_millis(5)).unwrap();
            assert!(Instant::now() < deadline, "the recorder never came");
        }
        first.store(daemon.tick + 1, Ordering::Release);
        for _ in 0..n_ticks {
            daemon.run_tick();
            while !daemon.gate_is_open() {
                daemon.wake.wait(Duration::from_millis(100)).unwrap();
                assert!(
                    Instant::now() < deadline,
                    "the recorder did not acknowledge tick {}",
                    daemon.tick
                );
            }
            std::thread::sleep(pause);
        }
        stop.store(true, Ordering::Release);
        while !recorder.is_finished() {
            daemon.serve();
            std::thread::sleep(Duration::from_millis(2));
        }
        recorder.join().unwrap().unwrap()
    });
    (report, first.load(Ordering::Acquire), daemon.tick)
}

/// Every frame and snapshot of every tick in the range is in the file, whole.
fn assert_complete(path: &Path, first: u64, last: u64) {
    let bytes = std::fs::read(path).unwrap();
    let snapshots: BTreeSet<u64> = mcap::MessageStream::new(&bytes)
        .unwrap()
        .map(Result::unwrap)
        .filter(|message| message.channel.topic == "/world/snapshot")
        .map(|message| message.log_time / PERIOD_NANOS)
        .collect();
    for tick in first..=last {
        assert!(snapshots.contains(&tick), "snapshot {tick}");
    }
    sample::assert_frames(path, first..=last);
}

#[test]
fn lockstep_loses_nothing_however_fast_the_simulator_runs() {
    for coding in [Coding::none(), Coding::default()] {
        lockstep_loses_nothing(coding);
    }
}

fn lockstep_loses_nothing(coding: Coding) {
    let folder = tempfile::tempdir().unwrap();
    let (report, first, last) = record_live(folder.path(), true, coding, 200, Duration::ZERO);
    assert!(report.lost.is_empty(), "{:?}", report.lost);
    assert_complete(&folder.path().join("live.mcap"), first, last);
    let info = consumer_record::info::file_info(&folder.path().join("live.mcap")).unwrap();
    assert_eq!(info.attachments, ["Sample.xodr"]);
    assert_eq!(info.metadata["world/info"]["map"], "Gantry/Sample");
    assert!(info.metadata["losses"].is_empty());
}

#[test]
fn free_running_at_fifty_hertz_is_recorded_or_its_losses_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let (report, first, last) = record_live(
        folder.path(),
        false,
        Coding::default(),
        100,
        Duration::from_millis(20),
    );
    // Between the first and the last frame of a topic nothing vanishes without being counted,
    // however slow the machine is.
    let path = folder.path().join("live.mcap");
    let found = sample::frames_of(&path);
    let (mut begin, mut end) = (first, last);
    for topic in sample::topics() {
        let ticks: Vec<u64> = found
            .keys()
            .filter(|(of, _)| *of == topic)
            .map(|(_, tick)| *tick)
            .collect();
        let (Some(from), Some(to)) = (ticks.first(), ticks.last()) else {
            panic!("nothing of {topic} was recorded");
        };
        let n_lost = report.lost.get(&topic).map_or(0, |loss| loss.total());
        assert!(
            ticks.len() as u64 + n_lost > to - from,
            "{topic}: {} recorded and {n_lost} lost of ticks {from} to {to}",
            ticks.len()
        );
        assert_eq!(ticks.len() as u64, report.recorded[&topic], "{topic}");
        (begin, end) = (begin.max(*from), end.min(*to));
    }
    if report.lost.is_empty() && begin <= end {
        assert_complete(&path, begin, end);
    }
}

/// The simulator goes on while the recorder, told to stop, takes what is left of one topic after the
/// other.
#[test]
fn every_topic_ends_with_the_same_tick() {
    let folder = tempfile::tempdir().unwrap();
    let bus = private(folder.path());
    let mut daemon = Daemon::new(&bus, EPOCH);
    let options = Options {
        bus,
        coding: Coding::none(),
        lockstep: false,
        ..Options::new("test", folder.path().join("live.mcap"))
    };
    let (stop, turn) = (AtomicBool::new(false), Barrier::new(2));
    let stopped_while_frames_come = || {
        let is_told = stop.load(Ordering::Acquire);
        if is_told {
            turn.wait();
            turn.wait();
        }
        is_told
    };
    std::thread::scope(|scope| {
        let recorder = scope.spawn(|| record(&options, &stopped_while_frames_come));
        let deadline = Instant::now() + Duration::from_secs(60);
        while (daemon.frames.iter()).any(|(_, publisher)| publisher.n_readers() == 0) {
            daemon.serve();
            std::thread::sleep(Duration::from_millis(5));
            assert!(Instant::now() < deadline, "the recorder never came");
        }
        daemon.run_tick();
        stop.store(true, Ordering::Release);
        turn.wait();
        daemon.run_tick();
        daemon.publish_frames(3);
        turn.wait();
        while !recorder.is_finished() {
            daemon.serve();
            std::thread::sleep(Duration::from_millis(2));
        }
        recorder.join().unwrap().unwrap();
    });
    let found = sample::frames_of(&options.out);
    let ticks: BTreeSet<u64> = found.keys().map(|(_, tick)| *tick).collect();
    assert_eq!(ticks, [1, 2].into());
    assert_complete(&options.out, 1, 2);
}

#[test]
fn a_restarted_simulator_gets_a_file_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let bus = private(folder.path());
    let options = Options {
        domain: "test".into(),
        bus: bus.clone(),
        select: Default::default(),
        out: folder.path().join("live.mcap"),
        compression: ChunkCompression::None,
        queue_bytes: 64 << 20,
        lockstep: false,
        coding: Coding::none(),
        ..Options::new("test", "unused".into())
    };
    let stop = AtomicBool::new(false);
    let report = std::thread::scope(|scope| {
        let recorder = scope.spawn(|| record(&options, &|| stop.load(Ordering::Acquire)));
        let deadline = Instant::now() + Duration::from_secs(60);
        for epoch in [EPOCH, EPOCH + 1] {
            let mut daemon = Daemon::new(&bus, epoch);
            while daemon
                .frames
                .iter()
                .any(|(_, publisher)| publisher.n_readers() == 0)
            {
                daemon.serve();
                std::thread::sleep(Duration::from_millis(5));
                assert!(Instant::now() < deadline, "the recorder never came");
            }
            for _ in 0..40 {
                daemon.run_tick();
                daemon.serve();
                std::thread::sleep(Duration::from_millis(20));
            }
        }
        stop.store(true, Ordering::Release);
        recorder.join().unwrap().unwrap()
    });
    let files: Vec<_> = report
        .files
        .iter()
        .map(|(file, _)| file.file_name().unwrap().to_str().unwrap())
        .collect();
    assert_eq!(files, ["live.mcap", "live.2.mcap"]);
    for file in files {
        let info = consumer_record::info::file_info(&folder.path().join(file)).unwrap();
        assert!(
            info.complete && info.attachments == ["Sample.xodr"],
            "{file}: {info:?}"
        );
        assert!(
            info.end_sim_nanos >= 38 * PERIOD_NANOS && info.end_sim_nanos <= 40 * PERIOD_NANOS,
            "{file} ends at {}",
            info.end_sim_nanos
        );
        assert_eq!(
            info.channels
                .iter()
                .filter(|channel| channel.topic.ends_with("/gantry") && channel.n_messages >= 20)
                .count(),
            sample::topics().len(),
            "{file}"
        );
    }
}
