//! Readers on a GPU while their topics move from one process to another: render workers come, go and
//! are killed, and the simulator draws itself. The same reader goes on, with the bytes of shared
//! memory.

use crate::common;

use common::{BATCH, gpu_rig, on_gpu, take};
use consumer_gpu::GpuTopic;
use schema_bus::{Bus, CommandClient, FrameReader};
use test_kit::client::{assert_nothing_left, counter, cue, join_bus, reader, step, wait_workers};
use test_kit::programs::{spawn_consumer, start_daemon};
use test_kit::{Process, Sandbox, eventually};

const TOPICS: [&str; 9] = [
    "batch/pair/depth",
    "ego/front/rgb",
    "ego/front/depth",
    "ego/front/flow",
    "ego/front/dvs",
    "ego/rear/rgb",
    "ego/rear/instance",
    "ego/roof/lidar",
    "ego/labels/semantic_lidar",
];

/// A second place to look from, so that two workers share.
const REAR: &str = r#"
[sensor.rear]
kind = "camera"
modalities = ["rgb", "instance"]
rate_hz = 20
width_px = 96
height_px = 64
mount.position_m = [-1.5, 0.0, 1.6]
mount.rpy_deg = [0.0, 0.0, 180.0]
"#;

fn worker(sandbox: &Sandbox, name: &str) -> Process {
    spawn_consumer(sandbox, "gantry-render", &["--name", name])
}

/// Both kinds of readers of all topics.
struct Readers {
    bus: Bus,
    hosts: Vec<FrameReader>,
    gpus: Vec<GpuTopic>,
}

impl Readers {
    fn open(bus: Bus) -> Readers {
        Readers {
            hosts: TOPICS.iter().map(|topic| reader(&bus, topic)).collect(),
            gpus: TOPICS.iter().map(|topic| on_gpu(&bus, topic)).collect(),
            bus,
        }
    }

    /// The next frames on both sides are those of a tick, and the same.
    fn see(&mut self, tick: u64) {
        for ((host, gpu), topic) in self.hosts.iter_mut().zip(&mut self.gpus).zip(TOPICS) {
            let what = format!("{topic} at tick {tick}");
            let host = eventually(&what, || host.next().unwrap());
            let gpu = eventually(&format!("{what} on the GPU"), || take(gpu, &self.bus));
            assert_eq!((host.header().tick, gpu.header().tick), (tick, tick));
            let hashed = |header: &schema_frames::FrameHeader| header.hashed_bytes().to_vec();
            assert_eq!(hashed(host.header()), hashed(gpu.header()), "{what}");
            assert!(*host == gpu.to_bytes().unwrap()[..], "{what}");
        }
    }

    /// Runs ticks, and sees all of their frames.
    fn run(&mut self, client: &mut CommandClient, ticks: std::ops::RangeInclusive<u64>) {
        for tick in ticks {
            assert_eq!(step(client, 1), tick);
            self.see(tick);
        }
    }

    /// Nothing was lost, refused or uploaded.
    fn assert_sound(&self) {
        for (gpu, topic) in self.gpus.iter().zip(TOPICS) {
            let counts = gpu.counts();
            assert_eq!((counts.lost, counts.refused), (0, 0), "{topic}");
            assert_eq!(gpu.fallback(), None, "{topic}");
        }
    }
}

fn rig() -> String {
    format!("{}{REAR}{BATCH}", gpu_rig())
}

#[test]
fn workers_keep_frames_on_their_gpus_and_readers_outlive_them() {
    let sandbox = Sandbox::new("gpu-moves");
    let args = ["--no-gpu", "--await-workers", "2"];
    let daemon = start_daemon(&sandbox, &rig(), &args);
    let (one, two) = (worker(&sandbox, "one"), worker(&sandbox, "two"));
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    wait_workers(&mut client, 2);
    // Before the first tick the cameras have no place yet.
    step(&mut client, 1);
    let mut readers = Readers::open(bus);
    readers.run(&mut client, 2..=4);
    one.kill9();
    readers.run(&mut client, 5..=7);
    let three = worker(&sandbox, "three");
    wait_workers(&mut client, 2);
    readers.run(&mut client, 8..=10);
    // In the middle of a tick, as likely as not.
    assert_eq!(cue(&mut client), 11);
    two.kill9();
    readers.see(11);
    readers.run(&mut client, 12..=13);
    three.stop().expect_code(0);
    wait_workers(&mut client, 0);
    // Nobody draws; what comes next does.
    let four = worker(&sandbox, "four");
    wait_workers(&mut client, 1);
    readers.run(&mut client, 14..=16);
    readers.assert_sound();
    drop((readers, client));
    four.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn a_simulator_that_draws_itself_gives_its_readers_away_and_takes_them_back() {
    let sandbox = Sandbox::new("gpu-own");
    let daemon = start_daemon(&sandbox, &rig(), &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut readers = Readers::open(bus);
    readers.run(&mut client, 1..=3);
    for (n, first) in [4, 10].into_iter().enumerate() {
        let one = worker(&sandbox, "one");
        wait_workers(&mut client, 1);
        let before = counter(&mut client, "sent_by_workers");
        readers.run(&mut client, first..=first + 2);
        eventually("frames of the worker", || {
            (counter(&mut client, "sent_by_workers") > before).then_some(())
        });
        match n {
            0 => drop(one.kill9()),
            _ => drop(one.stop().expect_code(0)),
        }
        wait_workers(&mut client, 0);
        readers.run(&mut client, first + 3..=first + 5);
    }
    readers.assert_sound();
    drop((readers, client));
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

/// Whoever decides which frames are made counts readers on the GPU of whoever makes them.
#[test]
fn readers_on_a_workers_gpu_alone_are_enough() {
    let sandbox = Sandbox::new("gpu-alone");
    let kept = format!(
        "{}[topic.\"ego/front/rgb\"]\ngpu = true\ngpu_readers = 1\n",
        gpu_rig()
    );
    let daemon = start_daemon(&sandbox, &kept, &["--no-gpu", "--await-workers", "1"]);
    let one = worker(&sandbox, "one");
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    wait_workers(&mut client, 1);
    assert_eq!(step(&mut client, 1), 1);
    let mut gpus = ["ego/front/rgb", "ego/front/dvs", "ego/roof/lidar"].map(|it| on_gpu(&bus, it));
    for tick in 2..=4 {
        assert_eq!(step(&mut client, 1), tick);
        for gpu in &mut gpus {
            let frame = eventually("a frame", || take(gpu, &bus));
            assert_eq!(frame.header().tick, tick);
        }
    }
    let full = GpuTopic::open(&bus, "ego/front/rgb", consumer_gpu::Device::Mapped);
    let full = full.expect_err("it has one place").to_string();
    assert!(full.contains("already has 1 readers"), "{full}");
    drop(gpus);
    let sent = counter(&mut client, "sent_by_workers");
    step(&mut client, 3);
    assert_eq!(counter(&mut client, "sent_by_workers"), sent);
    drop((client, bus));
    one.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}
