//! Frames on the GPU across processes. On a software adapter the exported memory is a file, which
//! this process maps in the place of CUDA: the same socket, descriptors, slots and headers as on a
//! GPU, and bytes that can be compared with those of shared memory.

use crate::common;

use std::collections::BTreeMap;
use std::path::Path;

use common::{gpu_rig, on_gpu, take};
use consumer_gpu::{Device, GpuTopic};
use schema_bus::{Bus, Frame, FrameReader, GpuSample as _};
use schema_frames::{FrameHeader, GpuAnswer, Modality};
use test_kit::client::{assert_nothing_left, counter, join_bus, reader, step};
use test_kit::programs::start_daemon;
use test_kit::{Sandbox, eventually};

const TOPICS: [&str; 9] = [
    "ego/front/rgb",
    "ego/front/depth",
    "ego/front/semantic",
    "ego/front/instance",
    "ego/front/flow",
    "ego/front/normals",
    "ego/front/dvs",
    "ego/roof/lidar",
    "ego/labels/semantic_lidar",
];

fn sockets(root: &Path) -> usize {
    std::fs::read_dir(root.join("gantry-gpu")).map_or(0, Iterator::count)
}

/// Both kinds of readers step by step: the same frames, byte for byte.
#[test]
fn every_modality_has_the_bytes_of_shared_memory_on_the_gpu() {
    for extra in [&[][..], &["--one-queue"][..], &["--staged"][..]] {
        let sandbox = Sandbox::new("on-gpu");
        let daemon = start_daemon(&sandbox, &gpu_rig(), extra);
        let bus = join_bus(&sandbox, "test");
        let mut client = bus.command_client("test").unwrap();
        let mut hosts: Vec<FrameReader> = TOPICS.iter().map(|topic| reader(&bus, topic)).collect();
        let mut gpus: Vec<GpuTopic> = TOPICS.iter().map(|topic| on_gpu(&bus, topic)).collect();
        let mut n_bytes: BTreeMap<&str, usize> = BTreeMap::new();
        for _ in 0..4 {
            let tick = step(&mut client, 1);
            for ((host, gpu), topic) in hosts.iter_mut().zip(&mut gpus).zip(TOPICS) {
                let host: Frame = eventually(topic, || host.next().unwrap());
                let gpu = eventually(topic, || take(gpu, &bus));
                assert_eq!(host.header().tick, tick);
                assert_eq!(
                    host.header().hashed_bytes(),
                    gpu.header().hashed_bytes(),
                    "{topic}"
                );
                assert_eq!(host.header().epoch, gpu.header().epoch);
                assert_eq!(gpu.header().payload_place, FrameHeader::ON_GPU);
                let is_upload = !gpu.modality().is_image();
                assert_eq!(gpu.header().cpu_copies > 0, is_upload, "{topic}");
                assert!(
                    *host == gpu.to_bytes().unwrap()[..],
                    "{topic} at tick {tick}"
                );
                *n_bytes.entry(topic).or_default() += host.len();
            }
        }
        assert!(n_bytes.values().all(|n| *n > 0), "{n_bytes:?}");
        drop((hosts, gpus, client, bus));
        daemon.stop().expect_code(0);
        assert_eq!(
            sockets(&sandbox.iceoryx_root()),
            0,
            "the socket goes with its process"
        );
        assert_nothing_left(&sandbox);
    }
}

/// A reader of one kind costs nothing of the other kind.
#[test]
fn each_place_is_filled_only_while_it_is_read() {
    let sandbox = Sandbox::new("sides");
    let _daemon = start_daemon(&sandbox, &gpu_rig(), &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let topic = "ego/front/rgb";
    let side = |bus: &Bus| {
        let topics = bus.topics().unwrap();
        assert!(
            topics.iter().all(|topic| !topic.name.ends_with("/gpu")),
            "hidden"
        );
        topics
            .into_iter()
            .find(|found| found.name == topic)
            .unwrap()
            .on_gpu
    };
    assert_eq!(side(&bus), None, "nobody asked");
    let mut copies = {
        let mut last = counter(&mut client, "gpu_copies");
        move |client: &mut _| {
            step(client, 1);
            let now = counter(client, "gpu_copies");
            now - std::mem::replace(&mut last, now)
        }
    };
    assert_eq!(copies(&mut client), 0);
    let mut gpu = on_gpu(&bus, topic);
    assert_eq!(copies(&mut client), 1, "to the GPU alone");
    let on_gpu = side(&bus).unwrap();
    assert_eq!((on_gpu.publishers, on_gpu.subscribers), (1, 1));
    let host = reader(&bus, topic);
    assert_eq!(copies(&mut client), 2, "to both");
    while take(&mut gpu, &bus).is_some() {}
    drop(gpu);
    assert_eq!(copies(&mut client), 1, "to shared memory alone");
    drop(host);
    assert_eq!(copies(&mut client), 0);
}

/// What a reader holds is not written to, however many frames follow.
#[test]
fn a_frame_that_is_held_keeps_its_bytes() {
    let sandbox = Sandbox::new("held");
    let _daemon = start_daemon(&sandbox, &gpu_rig(), &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut gpu = on_gpu(&bus, "ego/front/instance");
    let mut held = Vec::new();
    for _ in 0..3 {
        step(&mut client, 1);
        let frame = eventually("a frame", || take(&mut gpu, &bus));
        held.push((frame.to_bytes().unwrap(), frame));
    }
    for _ in 0..30 {
        step(&mut client, 1);
    }
    let slots: Vec<u64> = held.iter().map(|(_, frame)| frame.address()).collect();
    for (bytes, frame) in &held {
        assert!(frame.to_bytes().unwrap() == *bytes);
        assert_eq!(
            slots
                .iter()
                .filter(|slot| **slot == frame.address())
                .count(),
            1
        );
    }
    let full = gpu.next(&bus).unwrap_err().to_string();
    assert!(full.contains("already holds 3"), "{full}");
    held.clear();
    assert!(take(&mut gpu, &bus).is_some());
}

/// Readers and then writers are killed many times: the others go on, and nothing is left.
#[test]
fn kills_of_readers_and_of_writers_leak_nothing() {
    let sandbox = Sandbox::new("gpu-kills");
    let free = gpu_rig().replace("mode = \"stepped\"\n", "");
    let topic = "ego/front/rgb";
    let mut daemon = start_daemon(&sandbox, &free, &[]);
    let bus = join_bus(&sandbox, "test");
    let mut gpu = on_gpu(&bus, topic);
    let fresh_frame = |gpu: &mut GpuTopic| {
        while take(gpu, &bus).is_some() {}
        eventually("a frame after the kill", || take(gpu, &bus))
            .to_bytes()
            .unwrap()
    };
    let n_open = |pid: u32| {
        std::fs::read_dir(format!("/proc/{pid}/fd"))
            .unwrap()
            .count()
    };
    let mut counts = Vec::new();
    for _ in 0..20 {
        let mut child = common::child(&sandbox, "read_frames", &[]);
        child.wait_line("read tick");
        child.kill9();
        bus.clean_dead_nodes();
        assert_eq!(fresh_frame(&mut gpu).len(), 96 * 64 * 4);
        counts.push(n_open(daemon.pid()));
    }
    assert!(
        counts.last() <= counts.first(),
        "the daemon's descriptors: {counts:?}"
    );
    // A reader of its own: other tests of this process open and close descriptors meanwhile.
    let mut witness = common::child(&sandbox, "read_frames", &[]);
    witness.wait_line("read tick");
    let mut counts = Vec::new();
    for _ in 0..5 {
        daemon.kill9();
        bus.clean_dead_nodes();
        daemon = start_daemon(&sandbox, &free, &[]);
        assert_eq!(fresh_frame(&mut gpu).len(), 96 * 64 * 4);
        assert_eq!(
            sockets(&sandbox.iceoryx_root()),
            1,
            "the dead one's is swept"
        );
        let n_read = witness.lines().len();
        eventually("the witness reads on", || {
            assert!(witness.is_running(), "{:?}", witness.lines());
            (witness.lines().len() > n_read + 3).then_some(())
        });
        counts.push(n_open(witness.pid()));
    }
    assert!(
        counts[4] <= counts[0] + 3,
        "a reader's descriptors: {counts:?}"
    );
    witness.kill9();
    bus.clean_dead_nodes();
    assert_eq!(gpu.counts().refused, 0);
    drop(gpu);
    drop(bus);
    daemon.stop().expect_code(0);
    assert_eq!(sockets(&sandbox.iceoryx_root()), 0);
    assert_nothing_left(&sandbox);
}

/// What does not fit is refused with a sentence.
#[test]
fn what_is_not_there_or_does_not_fit_is_refused() {
    let sandbox = Sandbox::new("gpu-refused");
    let kept = format!(
        "{}[topic.\"ego/front/rgb\"]\ngpu = true\ngpu_readers = 1\n",
        gpu_rig()
    );
    let _daemon = start_daemon(&sandbox, &kept, &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let sentence = |topic: &str| {
        let opened = GpuTopic::open(&bus, topic, Device::Mapped);
        opened.expect_err("it is refused").to_string()
    };
    assert!(sentence("ego/imu/imu").contains("no process of this domain keeps it on a GPU"));
    assert!(sentence("ego/nobody/rgb").contains("there is no topic"));
    let mut gpu = on_gpu(&bus, "ego/front/rgb");
    assert!(sentence("ego/front/rgb").contains("already has 1 readers"));
    // A reader of shared memory meets a sentence on the GPU's service, not garbage.
    drop(take(&mut gpu, &bus));
    step(&mut client, 1);
    let frame = eventually("a frame", || take(&mut gpu, &bus));
    drop(frame);
    drop(gpu);
    let offer = bus.gpu_offer("ego/front/rgb").unwrap();
    assert!(offer.is_mappable && offer.device_uuid != [0; 16]);
    let mut raw = bus.gpu_reader("ego/front/rgb", &offer).unwrap();
    step(&mut client, 1);
    let frame = eventually("a frame", || raw.next().unwrap());
    let memory = bus.gpu_memory(&frame).unwrap();
    assert_eq!(memory.handle_kind, GpuAnswer::VULKAN);
    assert!(frame.place().memory_bytes == memory.n_bytes && memory.generation != 0);
    assert_eq!(frame.modality(), Modality::Rgb);
    let wrong = schema_bus::GpuMemory {
        n_bytes: memory.n_bytes + 1,
        ..memory
    };
    let fault = frame.check_memory(&wrong).unwrap_err().to_string();
    assert!(fault.contains("the writer is broken"), "{fault}");
    let other = schema_bus::GpuMemory {
        generation: 1,
        ..wrong
    };
    let fault = frame.check_memory(&other).unwrap_err().to_string();
    assert!(fault.contains("another memory"), "{fault}");
}

/// A launch file that asks for more than the GPU has ends with 2 and a sentence.
#[test]
fn slots_that_do_not_fit_the_gpu_are_refused_before_anything_starts() {
    let sandbox = Sandbox::new("gpu-budget");
    let many: String = (0..12)
        .map(|i| {
            format!(
                "[sensor.big{i}]\nkind = \"camera\"\nmodalities = [\"normals\"]\nrate_hz = 1\nwidth_px = 4096\nheight_px = 4096\n[topic.\"ego/big{i}/normals\"]\nreaders = 1\nbuffer = 1\nborrowed = 1\ngpu = true\ngpu_readers = 32\n"
            )
        })
        .collect();
    let file = sandbox.write(
        "launch.toml",
        &format!("version = 1\n[scenario]\nmap = \"Town10HD\"\n{many}"),
    );
    let arguments = [
        "--launch",
        file.to_str().unwrap(),
        "--domain",
        sandbox.domain(),
    ];
    let ended = sandbox.spawn("simd", &arguments).wait();
    let ended = ended.expect_code(2);
    // Shared memory is counted first; on a machine with much of it the GPU's is what is missing.
    assert!(ended.says("fewer gpu_readers") || ended.says("of shared memory"));
}
