//! Results of one process that another reads on the same GPU, with a driver for tests in the place
//! of NVIDIA's (`fake_cuda.c`): copies on a stream are done when the stream is waited for, and
//! readers' memory cannot be written to. Every writer and reader on the GPU is a process of its own;
//! the parent reads in shared memory, and kills.

use crate::common;

use std::collections::BTreeSet;
use std::path::PathBuf;

use common::{RESULT_SHAPE, RESULT_TOPIC, child, fake_driver, n_bytes, pattern};
use schema_frames::ResultHeader;
use test_kit::client::{assert_nothing_left, join_bus};
use test_kit::{Process, Sandbox, eventually};

const UUID: &str = "00112233445566778899aabbccddeeff";

/// A sandbox with a driver, and the children in it.
struct Stage {
    sandbox: Sandbox,
    driver: PathBuf,
}

impl Stage {
    fn new(name: &str) -> Stage {
        let sandbox = Sandbox::new(name);
        let driver = fake_driver(&sandbox);
        Stage { sandbox, driver }
    }

    fn log(&self, name: &str) -> PathBuf {
        self.sandbox.path(&format!("{name}.log"))
    }

    /// Lines of a child's work that begin so.
    fn n_noted(&self, name: &str, what: &str) -> usize {
        let noted = std::fs::read_to_string(self.log(name)).unwrap_or_default();
        noted.lines().filter(|line| line.starts_with(what)).count()
    }

    fn start(&self, name: &str, env: &[(&str, &str)]) -> Process {
        let log = self.log(name);
        let mut all = vec![
            ("LD_LIBRARY_PATH", self.driver.to_str().unwrap()),
            ("FAKE_CUDA_LOG", log.to_str().unwrap()),
            ("FAKE_CUDA_UUID", UUID),
        ];
        // The last of a name counts.
        all.retain(|(key, _)| env.iter().all(|(given, _)| given != key));
        all.extend(env);
        child(&self.sandbox, name, &all)
    }
}

/// The newest tick that a reader says it has read, once it is after `tick`.
fn read_after(reader: &mut Process, tick: u64) -> u64 {
    eventually("a later result", || {
        let lines = reader.lines();
        assert!(reader.is_running(), "{lines:?}");
        let newest = lines.iter().rev().find_map(|line| {
            let (_, tick) = line.rsplit_once("read tick ")?;
            tick.trim().parse().ok()
        });
        newest.filter(|found| *found > tick)
    })
}

#[test]
fn a_result_is_read_on_the_gpu_and_beside_it_in_shared_memory() {
    let stage = Stage::new("results-same");
    let mut writer = stage.start("publish", &[]);
    writer.wait_line("publishing");
    let mut reader = stage.start("read_results", &[]);
    read_after(&mut reader, 20);
    assert!(stage.n_noted("publish", "copy 4224") > 0);
    assert_eq!(
        stage.n_noted("publish", "to host"),
        0,
        "nobody reads in shared memory"
    );
    assert_eq!(stage.n_noted("publish", "create"), 1);
    assert_eq!(stage.n_noted("read_results", "take over"), 1);
    let bus = join_bus(&stage.sandbox, "test");
    let mut host = bus.result_reader(RESULT_TOPIC).unwrap();
    for _ in 0..20 {
        let result = eventually("a copy", || host.next().unwrap());
        let header = result.header();
        assert_eq!(
            (header.shape(), header.payload_place),
            (&RESULT_SHAPE[..], ResultHeader::IN_SAMPLE)
        );
        assert!(*result == pattern(header.tick, n_bytes(&RESULT_SHAPE))[..]);
    }
    assert!(stage.n_noted("publish", "to host 4224") >= 20);
    // One topic, with a side on the GPU.
    let topics = bus.topics().unwrap();
    let [topic] = &topics[..] else {
        panic!("{topics:?}")
    };
    assert_eq!(topic.name, RESULT_TOPIC);
    assert_eq!(topic.on_gpu.unwrap().subscribers, 1);
    drop(host);
    let before = read_after(&mut reader, 0);
    read_after(&mut reader, before + 10);
    writer.kill9();
    reader.kill9();
    bus.clean_dead_nodes();
    drop(bus);
    assert_nothing_left(&stage.sandbox);
}

#[test]
fn kills_of_either_side_leave_the_other_whole() {
    let stage = Stage::new("results-kills");
    let bus = join_bus(&stage.sandbox, "test");
    let mut writer = stage.start("publish", &[]);
    writer.wait_line("publishing");
    let n_open = |pid: u32| {
        std::fs::read_dir(format!("/proc/{pid}/fd"))
            .unwrap()
            .count()
    };
    let mut reader = stage.start("read_results", &[]);
    let mut tick = read_after(&mut reader, 0);
    let mut counts = Vec::new();
    for _ in 0..10 {
        // Two places: the third reader finds room because the dead one's is removed.
        let mut victim = stage.start("read_results", &[]);
        victim.wait_line("read tick");
        victim.kill9();
        tick = read_after(&mut reader, tick);
        counts.push(n_open(writer.pid()));
    }
    // Sockets are open for moments; what leaks stays open, ten times.
    bus.clean_dead_nodes();
    let usual = counts[..3].iter().max().copied();
    eventually("the descriptors of ten readers are closed", || {
        (Some(n_open(writer.pid())) <= usual).then_some(())
    });
    let mut epochs = BTreeSet::new();
    let mut descriptors = Vec::new();
    for turn in 1..=6u64 {
        writer.kill9();
        // The reader goes on with the next writer's memory.
        let first = (turn * 1_000_000).to_string();
        writer = stage.start("publish", &[("FIRST_TICK", &first)]);
        writer.wait_line("publishing");
        tick = read_after(&mut reader, turn * 1_000_000);
        descriptors.push(n_open(reader.pid()));
        let folder = stage.sandbox.iceoryx_root().join("gantry-gpu");
        epochs.insert(std::fs::read_dir(folder).unwrap().count());
    }
    assert_eq!(epochs, BTreeSet::from([1]), "dead sockets are swept");
    bus.clean_dead_nodes();
    let usual = descriptors[..2].iter().max().copied();
    eventually("the descriptors of six writers are closed", || {
        (Some(n_open(reader.pid())) <= usual).then_some(())
    });
    assert_eq!(stage.n_noted("read_results", "take over"), 10 + 7);
    assert!(tick > 6_000_000);
    reader.kill9();
    writer.kill9();
    bus.clean_dead_nodes();
    drop(bus);
    assert_nothing_left(&stage.sandbox);
}

#[test]
fn what_is_held_keeps_its_bytes_and_a_fourth_is_refused() {
    let stage = Stage::new("results-held");
    let mut writer = stage.start("publish", &[]);
    writer.wait_line("publishing");
    stage.start("hold", &[]).wait().expect_code(0);
    writer.kill9();
}

#[test]
fn longer_results_get_longer_slots() {
    let stage = Stage::new("results-grow");
    let mut writer = stage.start("grow", &[]);
    writer.wait_line("publishing");
    let reader = stage.start("read_all", &[]);
    reader.wait().expect_code(0);
    let ended = writer.wait().expect_code(0);
    // 1, 9, 100, 4000 and 100 000 rows of 32 bytes.
    assert_eq!(stage.n_noted("grow", "create"), 5);
    assert_eq!(stage.n_noted("grow", "unmap"), 5, "none is left");
    assert!(ended.says("device bytes"));
    assert_nothing_left(&stage.sandbox);
}

#[test]
fn a_loan_is_filled_in_place() {
    let stage = Stage::new("results-loan");
    let mut writer = stage.start("lend", &[]);
    writer.wait_line("publishing");
    let bus = join_bus(&stage.sandbox, "test");
    let mut host = bus.result_reader(RESULT_TOPIC).unwrap();
    let reader = stage.start("read_whole", &[]);
    let last = eventually("the last copy", || {
        let found = host.next().unwrap()?;
        let tick = found.header().tick;
        assert!(
            *found == pattern(tick, n_bytes(&RESULT_SHAPE))[..],
            "tick {tick}"
        );
        (tick == 1000).then_some(found.header().seq)
    });
    assert!(last > 30);
    reader.wait().expect_code(0);
    writer.wait().expect_code(0);
    assert_eq!(stage.n_noted("lend", "copy"), 1, "of the last");
}

#[test]
fn inputs_travel_with_results_on_the_gpu() {
    let stage = Stage::new("results-chain");
    stage.start("chain", &[]).wait().expect_code(0);
    assert_nothing_left(&stage.sandbox);
}

#[test]
fn another_gpu_and_a_writer_without_one_are_uploaded() {
    for (writer, uuid, wanted) in [
        (
            "publish",
            "ff112233445566778899aabbccddeeff",
            "its writer is on GPU 00112233445566778899aabbccddeeff",
        ),
        (
            "publish_on_host",
            UUID,
            "no process of this domain keeps it on a GPU",
        ),
    ] {
        let stage = Stage::new("results-upload");
        let mut writer = stage.start(writer, &[]);
        writer.wait_line("publishing");
        let env = [("FAKE_CUDA_UUID", uuid), ("WANTED", wanted)];
        let reader = stage.start("upload_results", &env);
        reader.wait().expect_code(0);
        assert!(stage.n_noted("upload_results", "upload 4224") >= 10);
        assert_eq!(stage.n_noted("upload_results", "take over"), 0);
        writer.kill9();
    }
}

#[test]
fn what_cannot_be_is_said() {
    let stage = Stage::new("results-refused");
    let free = (100u64 << 20).to_string();
    let env = [("FAKE_CUDA_FREE", free.as_str())];
    stage.start("lack_room", &env).wait().expect_code(0);
    let refused = stage.start("be_refused", &[]);
    refused.wait().expect_code(0);
    assert_nothing_left(&stage.sandbox);
}
