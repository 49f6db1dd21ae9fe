//! `gantry-bridge` between two domains that share nothing but a socket of the loopback: the same
//! topics with the same bytes, both ways; late joiners, slow links, and deaths of either side.

use std::collections::BTreeMap;
use std::io::{Read as _, Write as _};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use bytemuck::bytes_of;
use consumer_kit::Publisher;
use nix::sys::signal::Signal;
use schema_bus::{Bus, CommandClient, FrameReader, ResultTopic, names};
use schema_frames::{
    Box2d, Command, CommandBatch, CommandReply, FrameHeader, InputRecord, ResultHeader, ResultType,
    VehicleControl, VehicleControlRecord, WorldInfo,
};
use test_e2e::carla::free_port;
use test_e2e::{
    SMALL_RIG, SMALL_RIG_TOPICS, ask, assert_nothing_left, document, join_bus, reader,
    spawn_consumer, spawn_daemon, start_daemon, step, venv_program, wait_readers,
};
use test_kit::sandbox::repository;
use test_kit::{PATIENCE, Process, Sandbox, eventually};

/// A simulator that stands still until it is told to step.
fn stepped() -> String {
    SMALL_RIG.replace("tick_hz = 20", "tick_hz = 20\nmode = \"stepped\"")
}

/// A simulator that runs by itself, with one camera.
const ONE_CAMERA: &str = r#"version = 1
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 20
[sensor.front]
kind = "camera"
modalities = ["rgb"]
rate_hz = 20
width_px = 64
height_px = 48
"#;

/// Two machines: the one with the simulator, and the one that is far from it.
struct Machines {
    near: Sandbox,
    far: Sandbox,
    endpoint: String,
}

impl Machines {
    fn new(name: &str) -> Machines {
        Machines {
            near: Sandbox::new(&format!("{name}-near")),
            far: Sandbox::new(&format!("{name}-far")),
            endpoint: format!("tcp/127.0.0.1:{}", free_port()),
        }
    }

    fn near_bridge(&self, args: &[&str]) -> Process {
        let own = ["--listen", &self.endpoint];
        let mut bridge = spawn_consumer(&self.near, "gantry-bridge", &[&own, args].concat());
        bridge.wait_line("ready");
        bridge
    }

    fn far_bridge(&self, args: &[&str]) -> Process {
        let own = ["--connect", &self.endpoint];
        let mut bridge = spawn_consumer(&self.far, "gantry-bridge", &[&own, args].concat());
        bridge.wait_line("ready");
        bridge
    }

    /// Commands from the far machine.
    fn commands(&self, bus: &Bus, bridge: &mut Process) -> CommandClient {
        bridge.wait_line("its world appears here");
        let mut client = bus.command_client("far-test").unwrap();
        eventually("commands cross", || {
            matches!(ask(&mut client, Command::Ping), CommandReply::Pong { .. }).then_some(())
        });
        client
    }
}

/// What of a frame must be the same on both machines: all but the moment of publishing.
fn same_bytes(header: &FrameHeader) -> FrameHeader {
    FrameHeader {
        published_mono_nanos: 0,
        ..*header
    }
}

fn next(frames: &mut FrameReader) -> (FrameHeader, Vec<u8>) {
    let topic = frames.topic().to_owned();
    let frame = eventually(&format!("a frame of {topic}"), || frames.next().unwrap());
    (same_bytes(frame.header()), frame.to_vec())
}

#[test]
fn every_topic_is_the_same_on_the_other_machine() {
    let machines = Machines::new("bridge");
    let _daemon = start_daemon(&machines.near, &stepped(), &[]);
    let near_bridge = machines.near_bridge(&[]);
    let mut far_bridge = machines.far_bridge(&[]);
    let (near, far) = (
        join_bus(&machines.near, "test"),
        join_bus(&machines.far, "test"),
    );
    let mut client = machines.commands(&far, &mut far_bridge);
    for name in [names::WORLD_INFO, names::WORLD_MAP, names::WORLD_CATALOGUE] {
        assert_eq!(document(&near, name), document(&far, name), "{name}");
    }
    let info: WorldInfo = document(&far, names::WORLD_INFO).json().unwrap();
    assert_eq!(info.map, "Town10HD");

    let mut near_frames: Vec<_> = SMALL_RIG_TOPICS.map(|topic| reader(&near, topic)).into();
    let mut far_frames: Vec<_> = SMALL_RIG_TOPICS.map(|topic| reader(&far, topic)).into();
    for topic in SMALL_RIG_TOPICS {
        wait_readers(&near, topic, 2);
    }
    let mut snapshots = [&near, &far].map(|bus| bus.snapshot_reader().unwrap());
    for tick in 1..=4u64 {
        assert_eq!(step(&mut client, 1), tick);
        let [near_world, far_world] = snapshots.each_mut().map(|reader| {
            eventually("a snapshot", || {
                let newest = reader.latest().unwrap();
                newest.filter(|snapshot| snapshot.header().tick == tick)
            })
        });
        assert_eq!(near_world.records(), far_world.records());
        for (near, far) in near_frames.iter_mut().zip(&mut far_frames) {
            // Lidars, labels and GNSS fire every second tick.
            let every = match near.topic() {
                "ego/roof/lidar" | "ego/labels/semantic_lidar" | "ego/gnss/gnss" => 2,
                _ => 1,
            };
            if (tick - 1).is_multiple_of(every) {
                let (near_frame, far_frame) = (next(near), next(far));
                assert_eq!(near_frame, far_frame, "{} at tick {tick}", near.topic());
                assert_eq!(far_frame.0.tick, tick);
            }
        }
    }
    for frames in far_frames.iter().chain(&near_frames) {
        assert_eq!(frames.counts().lost, 0, "{}", frames.topic());
    }
    drop((near_frames, far_frames, snapshots));
    // What nobody reads there is not read here either.
    let read = |topic: &str| {
        let topics = near.topics().unwrap();
        let found = topics.iter().find(|found| found.name == topic);
        found.map_or(0, |found| found.subscribers)
    };
    eventually("the bridge gives the camera up", || {
        (read("ego/front/rgb") == 0).then_some(())
    });
    let ended = far_bridge.stop().expect_code(0);
    assert!(ended.says("ego/front/rgb: received 4"), "{ended:?}");
    near_bridge.stop().expect_code(0);
}

/// A bridge may list its domain while the simulator is still opening its topics: what comes after
/// `world/info` is announced later.
#[test]
fn a_document_that_is_announced_after_its_world_crosses() {
    let machines = Machines::new("bridge-late");
    let (near, far) = (
        join_bus(&machines.near, "test"),
        join_bus(&machines.far, "test"),
    );
    let claim = near.claim_world().unwrap().expect("nobody else is there");
    let mut info = near.document_publisher(names::WORLD_INFO).unwrap();
    info.send("{}", 1, 0).unwrap();
    let near_bridge = machines.near_bridge(&[]);
    let mut far_bridge = machines.far_bridge(&[]);
    far_bridge.wait_line("its world appears here");
    let mut catalogue = near.document_publisher(names::WORLD_CATALOGUE).unwrap();
    catalogue.send("late", 1, 0).unwrap();
    let mut reader = far.document_reader(names::WORLD_CATALOGUE).unwrap();
    let text = eventually("the catalogue crosses", || {
        info.greet();
        catalogue.greet();
        reader.latest().unwrap().map(|document| document.text)
    });
    assert_eq!(text, "late");
    far_bridge.stop().expect_code(0);
    near_bridge.stop().expect_code(0);
    drop((info, catalogue, claim));
}

/// What a result says, without the moment of publishing.
fn said(header: &ResultHeader, inputs: &[InputRecord], body: &[u8]) -> (Vec<u8>, Vec<u8>) {
    let header = ResultHeader {
        published_mono_nanos: 0,
        ..*header
    };
    (
        [bytes_of(&header), bytemuck::cast_slice(inputs)].concat(),
        body.to_vec(),
    )
}

/// A detector on the far machine answers the camera of the near one, whose programs read its boxes.
#[test]
fn results_and_controls_of_the_other_machine_come_back() {
    let machines = Machines::new("back");
    let _daemon = start_daemon(&machines.near, &stepped(), &[]);
    let near_bridge = machines.near_bridge(&[]);
    let mut far_bridge = machines.far_bridge(&[]);
    let (near, far) = (
        join_bus(&machines.near, "test"),
        join_bus(&machines.far, "detector"),
    );
    let mut client = machines.commands(&far, &mut far_bridge);
    let mut camera = reader(&far, "ego/front/rgb");
    wait_readers(&near, "ego/front/rgb", 1);
    let mut spec = ResultTopic::new(ResultType::Boxes2d);
    spec.about.classes = vec!["car".into(), "person".into()];
    spec.about.note = "made far away".into();
    let boxes = Publisher::<Box2d>::open_with(&far, "detector/boxes", spec).unwrap();
    let mut own = far.result_reader("detector/boxes").unwrap();
    let mut there = eventually("the boxes appear beside the simulator", || {
        near.result_reader("detector/boxes").ok()
    });
    // The test itself, and the bridge once it knows that somebody reads.
    wait_readers(&far, "detector/boxes", 2);
    for tick in 1..=3u64 {
        step(&mut client, 1);
        let image = eventually("an image", || camera.next().unwrap());
        let found: Vec<Box2d> = (0..tick)
            .map(|n| Box2d {
                min_px: [n as f32, 2.0],
                max_px: [n as f32 + 5.0, 9.0],
                score: 0.5,
                class: 1,
                ..bytemuck::Zeroable::zeroed()
            })
            .collect();
        boxes.send(&found, &[&image]).unwrap();
        let sent = eventually("the result itself", || own.next().unwrap());
        let came = eventually("the result beside the simulator", || there.next().unwrap());
        assert_eq!(
            said(came.header(), came.inputs(), &came),
            said(sent.header(), sent.inputs(), &sent)
        );
        assert_eq!(came.header().tick, tick);
        assert_eq!(came.inputs()[0].topic(), "ego/front/rgb");
        assert_eq!(came.records::<Box2d>().unwrap().len() as u64, tick);
    }
    let about: schema_frames::About = document(&near, "detector/boxes/about").json().unwrap();
    assert_eq!(about.classes, ["car", "person"]);
    assert_eq!(about.note, "made far away");

    // A driver far away drives: its controls reach the vehicle.
    let snapshot = document(&far, names::WORLD_ACTORS);
    let actors: schema_frames::ActorList = snapshot.json().unwrap();
    let ego = actors
        .actors
        .iter()
        .find(|actor| actor.kind == "vehicle" && actor.role.starts_with("ego"))
        .expect("the ego vehicle")
        .id;
    let mut worlds = near.snapshot_reader().unwrap();
    let mut driver = far.control_writer("far-driver").unwrap();
    let control = VehicleControl {
        throttle_ratio: 0.75,
        steer_ratio: -0.25,
        ..VehicleControl::default()
    };
    eventually("the vehicle obeys", || {
        let record = VehicleControlRecord::new(ego, control);
        driver.send(0, &[record]).unwrap();
        step(&mut client, 1);
        let world = worlds.latest().unwrap()?;
        let part = world.actor(ego)?.vehicle()?;
        ((part.throttle_ratio, part.steer_ratio) == (0.75, -0.25)).then_some(())
    });
    far_bridge.stop().expect_code(0);
    near_bridge.stop().expect_code(0);
}

/// Reads until a frame comes whose epoch `is_good` accepts.
fn frame_of(frames: &mut FrameReader, what: &str, is_good: impl Fn(u64) -> bool) -> u64 {
    eventually(what, || {
        let frame = frames.latest().unwrap()?;
        is_good(frame.header().epoch).then_some(frame.header().epoch)
    })
}

/// The simulator, then each bridge is killed and comes back; a reader on the far machine keeps its
/// port and goes on.
#[test]
fn readers_far_away_survive_the_death_of_simulator_and_bridges() {
    let machines = Machines::new("deaths");
    let daemon = start_daemon(&machines.near, ONE_CAMERA, &[]);
    let near_bridge = machines.near_bridge(&[]);
    let mut far_bridge = machines.far_bridge(&[]);
    far_bridge.wait_line("its world appears here");
    let far = join_bus(&machines.far, "test");
    let mut camera = reader(&far, "ego/front/rgb");
    let first = frame_of(&mut camera, "a frame", |_| true);

    daemon.kill9();
    let daemon = start_daemon(&machines.near, ONE_CAMERA, &[]);
    let second = frame_of(&mut camera, "a frame of the new simulator", |epoch| {
        epoch != first
    });

    near_bridge.kill9();
    far_bridge.wait_line("another bridge is gone");
    while camera.latest().unwrap().is_some() {}
    let near_bridge = machines.near_bridge(&[]);
    frame_of(&mut camera, "a frame through the new bridge", |epoch| {
        epoch == second
    });

    far_bridge.kill9();
    while camera.latest().unwrap().is_some() {}
    let mut far_bridge = machines.far_bridge(&[]);
    frame_of(&mut camera, "a frame of the new far bridge", |epoch| {
        epoch == second
    });
    far_bridge.wait_line("its world appears here");
    let info: WorldInfo = document(&far, names::WORLD_INFO).json().unwrap();
    assert_eq!(info.epoch, second.to_string());

    drop((camera, far));
    far_bridge.stop().expect_code(0);
    near_bridge.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&machines.near);
    assert_nothing_left(&machines.far);
}

/// The far bridge stops taking anything: the simulator goes on, frames are dropped and counted, and
/// afterwards the newest come first.
#[test]
fn a_link_that_takes_nothing_holds_nobody_up_and_drops_the_oldest() {
    let machines = Machines::new("slow");
    let launch = ONE_CAMERA.replace("64", "640").replace("48", "480");
    let daemon = start_daemon(&machines.near, &launch, &[]);
    let near_bridge = machines.near_bridge(&[]);
    let far_bridge = machines.far_bridge(&[]);
    let (near, far) = (
        join_bus(&machines.near, "test"),
        join_bus(&machines.far, "test"),
    );
    let mut camera = reader(&far, "ego/front/rgb");
    eventually("a frame", || camera.latest().unwrap());
    far_bridge.signal(Signal::SIGSTOP);
    let mut worlds = near.snapshot_reader().unwrap();
    let tick_now = |worlds: &mut schema_bus::SnapshotReader| {
        eventually("a snapshot", || worlds.latest().unwrap())
            .header()
            .tick
    };
    // Longer than the sockets can hold: 40 frames of 1.2 MB.
    let began = tick_now(&mut worlds);
    eventually("the simulator goes on", || {
        (tick_now(&mut worlds) > began + 40).then_some(())
    });
    let stopped_until = tick_now(&mut worlds);
    far_bridge.signal(Signal::SIGCONT);
    let newest = eventually("a frame from after the stop", || {
        let frame = camera.latest().unwrap()?;
        (frame.header().tick > stopped_until).then_some(*frame.header())
    });
    assert!(newest.seq > 40);
    assert!(camera.counts().lost > 0, "{:?}", camera.counts());
    drop(camera);
    far_bridge.stop().expect_code(0);
    let ended = near_bridge.stop().expect_code(0);
    // Where frames come so slowly that they do not fill the sockets within 10 s, the link is taken for
    // dead meanwhile; else it ends only now.
    let ends = |line: &&String| line.contains("another bridge is gone");
    let was_given_up = ended.lines.iter().filter(ends).count() > 1;
    assert!(
        was_given_up || ended.says("dropped for newer ones"),
        "{ended:?}"
    );
    daemon.stop().expect_code(0);
}

/// A machine of its own keeps its world; topics of users still cross, and commands are not passed
/// on when they are not to be.
#[test]
fn a_domain_with_a_simulator_keeps_its_own_world() {
    let machines = Machines::new("two");
    let _daemon = start_daemon(&machines.near, &stepped(), &[]);
    let _other = start_daemon(&machines.far, ONE_CAMERA, &[]);
    let near_bridge = machines.near_bridge(&[]);
    let mut far_bridge = machines.far_bridge(&[]);
    far_bridge.wait_line("has a simulator of its own");
    let (near, far) = (
        join_bus(&machines.near, "test"),
        join_bus(&machines.far, "test"),
    );
    let infos = [&near, &far].map(|bus| {
        let info: WorldInfo = document(bus, names::WORLD_INFO).json().unwrap();
        info.epoch
    });
    assert_ne!(infos[0], infos[1]);
    // The lidar is no sensor of the far simulator, the camera is.
    eventually("the lidar crosses", || {
        far.frame_reader("ego/roof/lidar").ok()
    });
    far_bridge.wait_line("\"ego/front/rgb\"");
    far_bridge.stop().expect_code(0);
    near_bridge.stop().expect_code(0);

    let near_bridge = machines.near_bridge(&["--no-control"]);
    let third = Sandbox::new("two-third");
    let own = ["--connect", machines.endpoint.as_str()];
    let mut far_bridge = spawn_consumer(&third, "gantry-bridge", &own);
    far_bridge.wait_line("its world appears here");
    let bus = join_bus(&third, "test");
    let mut client = bus.command_client("test").unwrap();
    let refused = eventually("an answer", || {
        match ask(&mut client, Command::Step { n: 1 }) {
            CommandReply::Refused { error } => Some(error),
            other => panic!("{other:?}"),
        }
    });
    assert!(refused.contains("--no-control"), "{refused}");
    far_bridge.stop().expect_code(0);
    near_bridge.stop().expect_code(0);
}

/// The world waits for a participant on the far machine, which answers each frame; without its bridge
/// it goes on.
#[test]
fn the_world_waits_for_a_participant_far_away() {
    let machines = Machines::new("lockstep");
    let args = ["--unpaced", "--await-participant", "far"];
    let mut daemon = spawn_daemon(&machines.near, ONE_CAMERA, &args);
    let near_bridge = machines.near_bridge(&["--lockstep"]);
    let mut far_bridge = machines.far_bridge(&["--lockstep"]);
    let (near, far) = (
        join_bus(&machines.near, "test"),
        join_bus(&machines.far, "far"),
    );
    let mut client = machines.commands(&far, &mut far_bridge);
    let mut camera = reader(&far, "ego/front/rgb");
    wait_readers(&near, "ego/front/rgb", 1);
    let acks = far.ack_writer("far").unwrap();
    let name = "far".to_owned();
    let join = CommandBatch::new(vec![Command::JoinLockstep { name }]);
    let answer = client.request(&join, Duration::from_secs(60)).unwrap();
    let CommandReply::Joined { participant, .. } = answer.replies[0] else {
        panic!("{answer:?}")
    };
    let epoch = answer.epoch.parse().unwrap();
    for tick in 1..=20u64 {
        let frame = eventually("the frame of the tick", || camera.next().unwrap());
        assert_eq!(frame.header().tick, tick, "none is left out");
        let mut worlds = near.snapshot_reader().unwrap();
        let now = eventually("a snapshot", || worlds.latest().unwrap());
        assert_eq!(now.header().tick, tick, "the world waits");
        acks.send(participant, epoch, tick).unwrap();
    }
    far_bridge.kill9();
    daemon.wait_line("going on without it");
    let mut worlds = near.snapshot_reader().unwrap();
    eventually("the world goes on", || {
        let world = worlds.latest().unwrap()?;
        (world.header().tick > 30).then_some(())
    });
    near_bridge.stop().expect_code(0);
}

/// A wire between the machines that delays every byte and can be cut.
struct Wire {
    endpoint: String,
    open: Arc<Mutex<Vec<TcpStream>>>,
    is_cut: Arc<AtomicBool>,
}

impl Wire {
    /// A wire to `to` (`tcp/HOST:PORT`) that takes `delay` each way.
    fn new(to: &str, delay: Duration) -> Wire {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port of the loopback");
        let endpoint = format!("tcp/{}", listener.local_addr().unwrap());
        let to = to.trim_start_matches("tcp/").to_owned();
        let (open, is_cut) = (Arc::new(Mutex::new(Vec::new())), Arc::default());
        let (kept, cut): (_, Arc<AtomicBool>) = (Arc::clone(&open), Arc::clone(&is_cut));
        std::thread::spawn(move || {
            for near in listener.incoming().flatten() {
                // Without the other end it is like a cable without a machine.
                let far = TcpStream::connect(&to).ok().filter(|_| !cut.load(Relaxed));
                let Some(far) = far else { continue };
                for (from, to) in [(&near, &far), (&far, &near)] {
                    carry(from.try_clone().unwrap(), to.try_clone().unwrap(), delay);
                }
                kept.lock().unwrap().extend([near, far]);
            }
        });
        Wire {
            endpoint,
            open,
            is_cut,
        }
    }

    fn cut(&self) {
        self.is_cut.store(true, Relaxed);
        for end in self.open.lock().unwrap().drain(..) {
            let _ = end.shutdown(Shutdown::Both);
        }
    }

    fn mend(&self) {
        self.is_cut.store(false, Relaxed);
    }
}

/// Carries bytes one way, each `delay` later.
fn carry(mut from: TcpStream, mut to: TcpStream, delay: Duration) {
    let (sender, pieces) = std::sync::mpsc::sync_channel::<(Instant, Vec<u8>)>(1024);
    std::thread::spawn(move || {
        let mut bytes = vec![0; 65_536];
        while let Ok(n @ 1..) = from.read(&mut bytes) {
            if sender.send((Instant::now(), bytes[..n].to_vec())).is_err() {
                return;
            }
        }
    });
    std::thread::spawn(move || {
        for (at, piece) in pieces {
            std::thread::sleep((at + delay).saturating_duration_since(Instant::now()));
            if to.write_all(&piece).is_err() {
                return;
            }
        }
    });
}

/// Over a wire of 60 ms there and back every frame still comes, and after a cut the reader goes on.
#[test]
fn a_long_wire_loses_nothing_and_a_cut_one_comes_back() {
    let machines = Machines::new("wire");
    let _daemon = start_daemon(&machines.near, &stepped(), &[]);
    let near_bridge = machines.near_bridge(&[]);
    let wire = Wire::new(&machines.endpoint, Duration::from_millis(30));
    let own = ["--connect", wire.endpoint.as_str()];
    let mut far_bridge = spawn_consumer(&machines.far, "gantry-bridge", &own);
    let (near, far) = (
        join_bus(&machines.near, "test"),
        join_bus(&machines.far, "test"),
    );
    let mut client = machines.commands(&far, &mut far_bridge);
    let mut frames = ["ego/front/rgb", "ego/imu/imu"].map(|topic| reader(&far, topic));
    for topic in ["ego/front/rgb", "ego/imu/imu"] {
        wait_readers(&near, topic, 1);
    }
    for tick in 1..=5u64 {
        step(&mut client, 1);
        for frames in &mut frames {
            assert_eq!(next(frames).0.tick, tick, "{}", frames.topic());
        }
    }
    wire.cut();
    far_bridge.wait_line("another bridge is gone");
    wire.mend();
    let mut near_client = near.command_client("near-test").unwrap();
    eventually("frames after the cut", || {
        step(&mut near_client, 1);
        let [camera, _] = &mut frames;
        let frame = camera.latest().unwrap()?;
        (frame.header().tick > 5).then_some(())
    });
    far_bridge.stop().expect_code(0);
    near_bridge.stop().expect_code(0);
}

/// Compressed payloads come out as they were; JPEG keeps the look.
#[test]
fn compressed_topics_come_out_as_they_were() {
    let machines = Machines::new("small");
    let _daemon = start_daemon(&machines.near, &stepped(), &[]);
    let rules = [
        "--compress",
        "*/depth=lossless",
        "*/semantic=zstd",
        "*/rgb=jpeg:95",
        "*=lz4",
        "--direction",
        "out",
    ];
    let near_bridge = machines.near_bridge(&rules);
    let mut far_bridge = machines.far_bridge(&["--topics", "ego/front/*", "ego/roof/*"]);
    let (near, far) = (
        join_bus(&machines.near, "test"),
        join_bus(&machines.far, "test"),
    );
    let mut client = machines.commands(&far, &mut far_bridge);
    let topics = [
        "ego/front/depth",
        "ego/front/semantic",
        "ego/front/rgb",
        "ego/roof/lidar",
    ];
    let mut near_frames = topics.map(|topic| reader(&near, topic));
    let mut far_frames = topics.map(|topic| reader(&far, topic));
    for topic in topics {
        wait_readers(&near, topic, 2);
    }
    step(&mut client, 1);
    for (near, far) in near_frames.iter_mut().zip(&mut far_frames) {
        let ((near_header, near_bytes), (far_header, far_bytes)) = (next(near), next(far));
        assert_eq!(near_header, far_header);
        if near.topic().ends_with("rgb") {
            let error: u64 = near_bytes
                .iter()
                .zip(&far_bytes)
                .map(|(a, b)| u64::from(a.abs_diff(*b)))
                .sum();
            let mean = error as f64 / near_bytes.len() as f64;
            assert!(near_bytes != far_bytes && mean < 6.0, "{mean}");
        } else {
            assert!(near_bytes == far_bytes, "{}", near.topic());
        }
    }
    assert!(!far.exists("ego/imu/imu"), "it was not asked for");
    let ended = far_bridge.stop().expect_code(0);
    assert!(ended.says(" as "), "what was compressed is said: {ended:?}");
    near_bridge.stop().expect_code(0);
}

/// A bridge that also speaks to other programs of this machine, and the port of one of them.
fn speaking_bridge(sandbox: &Sandbox, args: impl Fn(&str) -> Vec<String>) -> (Process, String) {
    let port = free_port().to_string();
    let args = args(&port);
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    let mut bridge = spawn_consumer(sandbox, "gantry-bridge", &args);
    bridge.wait_line("ready");
    (bridge, port)
}

fn ros2_bridge(sandbox: &Sandbox) -> (Process, String) {
    speaking_bridge(sandbox, |port| {
        let endpoint = format!("tcp/127.0.0.1:{port}");
        ["--ros2", "--listen", &endpoint].map(str::to_owned).into()
    })
}

/// A script of another implementation, beside the simulator.
fn script(sandbox: &Sandbox, name: &str, args: &[&str]) -> Process {
    let file = repository().join("tests/test_e2e/python").join(name);
    let file = file.to_str().expect("paths are text");
    sandbox.spawn_program(
        name,
        &venv_program("python"),
        &[&["-u", file], args].concat(),
        &[],
    )
}

fn fnv(bytes: &[u8]) -> String {
    let fold = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    format!("{:016x}", bytes.iter().fold(0xcbf2_9ce4_8422_2325, fold))
}

/// Messages that the script printed of a topic, by their simulated time.
fn messages(node: &Process, topic: &str) -> BTreeMap<u64, serde_json::Value> {
    let nanos = |stamp: &serde_json::Value| {
        Some(stamp["sec"].as_u64()? * 1_000_000_000 + stamp["nanosec"].as_u64()?)
    };
    let of_line = |line: String| {
        let line: serde_json::Value = serde_json::from_str(&line).ok()?;
        let message = line["message"].clone();
        let stamp = [
            &message["header"]["stamp"],
            &message["clock"],
            &message["transforms"][0]["header"]["stamp"],
        ];
        let stamp = stamp.into_iter().find_map(nanos)?;
        (line["topic"] == topic).then_some((stamp, message))
    };
    node.lines().into_iter().filter_map(of_line).collect()
}

/// Topics that a node of ROS 2 looks at.
const ROS2_TOPICS: [&str; 13] = [
    "/clock",
    "/tf",
    "/carla/ego/odometry",
    "/carla/ego/vehicle_status",
    "/carla/ego/front/image",
    "/carla/ego/front/image/compressed",
    "/carla/ego/front/camera_info",
    "/carla/ego/front/depth/image",
    "/carla/ego/front/semantic/image",
    "/carla/ego/roof",
    "/carla/ego/imu",
    "/carla/ego/gnss",
    "/carla/detector/boxes",
];

/// Every message, as another implementation of zenoh and of CDR reads it, says what the frame says.
#[test]
fn a_node_of_ros_2_sees_what_the_topics_carry() {
    let sandbox = Sandbox::new("ros2");
    let _daemon = start_daemon(&sandbox, &stepped(), &[]);
    let (bridge, port) = ros2_bridge(&sandbox);
    let bus = join_bus(&sandbox, "detector");
    let mut spec = ResultTopic::new(ResultType::Boxes2d);
    spec.about.classes = vec!["car".into(), "tram".into()];
    let boxes = Publisher::<Box2d>::open_with(&bus, "detector/boxes", spec).unwrap();
    let mut node = script(&sandbox, "bridge_ros2.py", &[&port, "look"]);
    node.wait_line("ready");
    let topics = [
        "ego/front/rgb",
        "ego/front/depth",
        "ego/front/semantic",
        "ego/roof/lidar",
        "ego/imu/imu",
        "ego/gnss/gnss",
    ];
    let mut frames = topics.map(|topic| reader(&bus, topic));
    for topic in topics {
        wait_readers(&bus, topic, 2);
    }
    wait_readers(&bus, "detector/boxes", 1);
    wait_readers(&bus, names::WORLD_SNAPSHOT, 1);
    let mut worlds = bus.snapshot_reader().unwrap();
    let mut client = bus.command_client("test").unwrap();
    step(&mut client, 1);
    // As between nodes of ROS 2, what a busy link does not take at once is dropped: what is compared is
    // a tick of which every message has come. Lidars and GNSS fire every second tick.
    let (world, [rgb, depth, semantic, lidar, imu, gnss]) =
        eventually("a tick of which every message comes", || {
            let tick = step(&mut client, 2);
            let world = eventually("the snapshot", || {
                worlds
                    .latest()
                    .unwrap()
                    .filter(|world| world.header().tick == tick)
            });
            let now = world.header().sim_nanos;
            let seen = frames.each_mut().map(|frames| {
                eventually("the frame", || {
                    let frame = frames.next().unwrap()?;
                    (frame.header().tick == tick).then(|| (*frame.header(), frame.to_vec()))
                })
            });
            let header = seen[0].0;
            let found = Box2d {
                min_px: [10.0, 20.0],
                max_px: [30.0, 60.0],
                score: 0.5,
                class: 1,
                id: 9,
                reserved: 0,
            };
            let mut loan = boxes.publisher().loan(size_of::<Box2d>()).unwrap();
            loan.write(&[found]).unwrap();
            loan.header_mut().space = schema_frames::Space::Image as u32;
            loan.header_mut().sim_nanos = now;
            let mut input = InputRecord::new("ego/front/rgb");
            (input.tick, input.sim_nanos) = (header.tick, header.sim_nanos);
            loan.add_input(input);
            loan.send().unwrap();
            let sent = Instant::now();
            let mut missing = ROS2_TOPICS.to_vec();
            while sent.elapsed() < Duration::from_secs(3) {
                missing.retain(|topic| !messages(&node, topic).contains_key(&now));
                if missing.is_empty() {
                    return Some((world, seen));
                }
                std::thread::sleep(Duration::from_millis(20));
            }
            println!("nothing of tick {tick} on {missing:?}");
            None
        });
    let now = world.header().sim_nanos;
    let header = rgb.0;
    let said = |topic: &str| {
        let message = messages(&node, topic).remove(&now);
        message.unwrap_or_else(|| panic!("no message on {topic}"))
    };
    let close = |found: &serde_json::Value, expected: f64| {
        let found = found.as_f64().unwrap_or(f64::NAN);
        assert!((found - expected).abs() < 1e-6, "{found} is not {expected}");
    };
    for (topic, (header, payload), encoding) in [
        ("/carla/ego/front/image", &rgb, "bgra8"),
        ("/carla/ego/front/depth/image", &depth, "32FC1"),
        ("/carla/ego/front/semantic/image", &semantic, "mono8"),
    ] {
        let image = said(topic);
        assert_eq!(image["encoding"], encoding);
        assert_eq!(image["header"]["frame_id"], "ego/front_optical");
        assert_eq!(
            (image["width"].as_u64(), image["height"].as_u64()),
            (Some(96), Some(64))
        );
        assert_eq!(image["step"].as_u64(), Some(u64::from(header.row_stride)));
        assert_eq!(image["data"]["hash"], fnv(payload).as_str(), "{topic}");
    }
    let info = said("/carla/ego/front/camera_info");
    let [fx, fy, cx, cy] = header.intrinsics_px;
    for (at, expected) in [(0, fx), (2, cx - 0.5), (4, fy), (5, cy - 0.5), (8, 1.0)] {
        close(&info["k"][at], expected);
    }
    assert!(said("/carla/ego/front/image/compressed")["data"]["length"].is_u64());
    let cloud = said("/carla/ego/roof");
    let n_points = lidar.1.len() / 16;
    assert_eq!(cloud["width"].as_u64(), Some(n_points as u64));
    assert_eq!(cloud["fields"][4]["name"], "ring");
    let points: Vec<u8> = lidar
        .1
        .chunks_exact(16)
        .flat_map(|point| {
            let intensity = f32::from(u16::from_le_bytes([point[12], point[13]])) / 65_535.0;
            [
                &point[..12],
                &intensity.to_le_bytes(),
                &point[14..16],
                &[0, 0],
            ]
            .concat()
        })
        .collect();
    assert_eq!(cloud["data"]["hash"], fnv(&points).as_str());
    let sample: schema_frames::ImuSample = bytemuck::pod_read_unaligned(&imu.1);
    let motion = said("/carla/ego/imu");
    close(
        &motion["linear_acceleration"]["z"],
        sample.specific_force_mps2[2],
    );
    close(
        &motion["angular_velocity"]["x"],
        sample.angular_velocity_radps[0],
    );
    let sample: schema_frames::GnssSample = bytemuck::pod_read_unaligned(&gnss.1);
    let fix = said("/carla/ego/gnss");
    close(&fix["latitude"], sample.latitude_deg);
    close(&fix["altitude"], sample.altitude_m);
    let ego = world.actor(header.parent_id).expect("the vehicle");
    let odometry = said("/carla/ego/odometry");
    assert_eq!(odometry["child_frame_id"], "ego");
    close(
        &odometry["pose"]["pose"]["position"]["x"],
        ego.world_from_actor.translation_m[0],
    );
    close(
        &said("/carla/ego/vehicle_status")["velocity"],
        f64::from(ego.speed_mps() as f32),
    );
    assert!(said("/clock")["clock"]["nanosec"].is_u64());
    // map → ego → ego/front → ego/front_optical leads to where the camera's own header is.
    let links = said("/tf")["transforms"].clone();
    let place = |frame: &str| {
        let links = links.as_array().expect("a list");
        let link = links.iter().find(|link| link["child_frame_id"] == frame);
        let at = &link.unwrap_or_else(|| panic!("no {frame} in {links:?}"))["transform"];
        let number = |part: &str, axis: &str| at[part][axis].as_f64().unwrap();
        schema_types::Pose {
            translation_m: ["x", "y", "z"].map(|axis| number("translation", axis)),
            rotation_xyzw: ["x", "y", "z", "w"].map(|axis| number("rotation", axis)),
        }
        .isometry()
    };
    let camera = place("ego") * place("ego/front");
    let expected = header.world_from_sensor.isometry();
    assert!((camera.translation.vector - expected.translation.vector).norm() < 1e-6);
    let optical = camera * place("ego/front_optical");
    let forward = optical.rotation * nalgebra::Vector3::z();
    assert!((forward - expected.rotation * nalgebra::Vector3::x()).norm() < 1e-6);
    let detections = said("/carla/detector/boxes");
    assert_eq!(detections["header"]["frame_id"], "ego/front_optical");
    let detection = &detections["detections"][0];
    assert_eq!(detection["results"][0]["hypothesis"]["class_id"], "tram");
    assert_eq!(detection["id"], "9");
    close(&detection["bbox"]["center"]["position"]["x"], 19.5);
    close(&detection["bbox"]["size_y"], 40.0);
    drop(node);
    bridge.stop().expect_code(0);
}

#[test]
fn a_node_of_ros_2_drives() {
    let sandbox = Sandbox::new("ros2-drive");
    let _daemon = start_daemon(&sandbox, ONE_CAMERA, &[]);
    let (mut bridge, port) = ros2_bridge(&sandbox);
    bridge.wait_line("ROS 2 nodes see it as /carla/ego");
    let ended = script(&sandbox, "bridge_ros2.py", &[&port, "drive"]).wait_longer(PATIENCE * 3);
    let ended = ended.expect_code(0);
    assert!(ended.says("vehicle_control_cmd: "), "{ended:?}");
    bridge.stop().expect_code(0);
}

#[test]
fn a_client_of_foxglove_looks_sets_and_steps() {
    let sandbox = Sandbox::new("foxglove");
    let _daemon = start_daemon(&sandbox, &stepped(), &[]);
    let (bridge, port) = speaking_bridge(&sandbox, |port| {
        let (address, endpoint) = (
            format!("127.0.0.1:{port}"),
            format!("tcp/127.0.0.1:{}", free_port()),
        );
        ["--foxglove", &address, "--listen", &endpoint]
            .map(str::to_owned)
            .into()
    });
    let ended = script(&sandbox, "bridge_foxglove.py", &[&port]).wait_longer(PATIENCE * 3);
    let ended = ended.expect_code(0);
    assert!(ended.says("saw 96x64 images"), "{ended:?}");
    bridge.stop().expect_code(0);
}

#[test]
fn wrong_arguments_are_said_in_one_sentence() {
    let sandbox = Sandbox::new("bridge-wrong");
    for (args, sentence) in [
        (&["--connect", "udp/host:1"][..], "tcp/HOST:PORT"),
        (&["--compress", "*=gzip"], "no compression"),
        (&["--compress", "lz4"], "GLOB=HOW"),
        (&["--network", "a b"], "names no network"),
    ] {
        let ended = spawn_consumer(&sandbox, "gantry-bridge", args).wait();
        let ended = ended.expect_code(2);
        assert!(ended.says(sentence), "{ended:?}");
    }
    let port = free_port();
    let taken = TcpListener::bind(("127.0.0.1", port)).unwrap();
    let endpoint = format!("tcp/127.0.0.1:{port}");
    let ended = spawn_consumer(&sandbox, "gantry-bridge", &["--listen", &endpoint])
        .wait()
        .expect_code(1);
    assert!(ended.says("taken"), "{ended:?}");
    drop(taken);
    sandbox.write("wrong.json5", "{ mode: \"captain\" }");
    let ended = spawn_consumer(
        &sandbox,
        "gantry-bridge",
        &["--zenoh-config", "wrong.json5"],
    )
    .wait()
    .expect_code(1);
    assert!(ended.says("no configuration of zenoh"), "{ended:?}");
}
