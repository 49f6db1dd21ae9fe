//! `gantry-record` beside a real daemon: nothing lost in lockstep, whole files after SIGTERM,
//! rescue after `kill -9`, restarts.

use std::path::Path;

use nix::sys::signal::Signal;
use schema_recording::scenery::tick_of;
use test_e2e::recording::{Sequences, gapless, sequences};
use test_e2e::{
    SMALL_RIG, SMALL_RIG_TOPICS, assert_nothing_left, counter, join_bus, spawn_consumer,
    start_daemon,
};
use test_kit::{Sandbox, eventually};

const WAIT_FOR_ONE: [&str; 3] = ["--unpaced", "--await-lockstep", "1"];

fn is_slow(topic: &str) -> bool {
    topic.contains("lidar") || topic.contains("gnss")
}

/// Every topic of the small rig from its first frame to that of `last_tick`.
fn assert_whole(found: &Sequences, last_tick: u64) {
    let (first, last) = gapless(found, "/world/snapshot");
    assert!(first <= 1, "snapshots begin at {first}");
    assert!(
        last >= last_tick,
        "snapshots end at {last}, not after {last_tick}"
    );
    for topic in SMALL_RIG_TOPICS {
        let (first, last) = gapless(found, &format!("/{topic}/gantry"));
        let due = if is_slow(topic) {
            last_tick.div_ceil(2)
        } else {
            last_tick
        };
        assert_eq!(first, 1, "{topic}");
        assert!(last >= due, "{topic} ends at {last}, not after {due}");
        let is_standard = !topic.ends_with("flow") && !topic.ends_with("normals");
        assert_eq!(
            found.contains_key(&format!("/{topic}")),
            is_standard,
            "{topic} has a channel that other tools read"
        );
    }
}

fn size(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |file| file.len())
}

#[test]
fn lockstep_records_every_frame_of_every_topic_and_sigterm_completes_the_file() {
    let sandbox = Sandbox::new("record");
    let _daemon = start_daemon(&sandbox, SMALL_RIG, &WAIT_FOR_ONE);
    let recorder = spawn_consumer(
        &sandbox,
        "gantry-record",
        &["--out", "drive.mcap", "--lockstep"],
    );
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    eventually("sixty ticks", || {
        (counter(&mut client, "ticks") >= 60).then_some(())
    });
    assert!(
        sandbox.path("drive.mcap.part").exists() && !sandbox.path("drive.mcap").exists(),
        "a file in the making is called .part"
    );
    recorder.stop().expect_code(0);
    assert!(
        sandbox.path("drive.mcap").exists() && !sandbox.path("drive.mcap.part").exists(),
        "a finished file has its own name"
    );
    assert_whole(&sequences(&sandbox.path("drive.mcap")), 60);
    let info = sandbox
        .spawn("gantry-record", &["info", "drive.mcap", "--json"])
        .wait()
        .expect_code(0);
    let info: serde_json::Value = serde_json::from_str(&info.lines.join("\n")).unwrap();
    assert_eq!(info["complete"], true);
    let mut attachments: Vec<String> = serde_json::from_value(info["attachments"].clone()).unwrap();
    attachments.sort();
    let scenery = attachments.pop().unwrap_or_default();
    assert!(tick_of(&scenery).is_some_and(|tick| tick <= 1), "{scenery}");
    assert_eq!(attachments, ["Town10HD.xodr", "launch.toml"]);
    assert_eq!(info["metadata"]["losses"], serde_json::json!({}));
    let again = spawn_consumer(&sandbox, "gantry-record", &["--out", "drive.mcap"])
        .wait()
        .expect_code(1);
    assert!(
        again.says("drive.mcap"),
        "a file that is there is named and left alone: {:?}",
        again.lines
    );
}

#[test]
fn a_killed_recorder_leaves_a_part_file_that_is_rescued_and_the_simulator_goes_on() {
    let sandbox = Sandbox::new("rescue");
    let mut daemon = start_daemon(&sandbox, SMALL_RIG, &WAIT_FOR_ONE);
    let recorder = spawn_consumer(
        &sandbox,
        "gantry-record",
        &[
            "--out",
            "drive.mcap",
            "--lockstep",
            "--compression",
            "none",
            "--codec",
            "none",
        ],
    );
    // A chunk is 4 MiB; at 14 MB three are whole and a fourth is begun.
    eventually("three chunks on disk", || {
        (size(&sandbox.path("drive.mcap.part")) > 14_000_000).then_some(())
    });
    recorder.kill9();
    daemon.wait_line("lockstep participant is gone");
    assert!(!sandbox.path("drive.mcap").exists());
    let cut = sandbox
        .spawn("gantry-record", &["info", "drive.mcap.part"])
        .wait()
        .expect_code(3);
    assert!(!cut.lines.is_empty());
    sandbox
        .spawn(
            "gantry-record",
            &["recover", "drive.mcap.part", "rescued.mcap"],
        )
        .wait()
        .expect_code(0);
    let rescued = sequences(&sandbox.path("rescued.mcap"));
    // A chunk ends between two frames, so the last tick may be there in part; 12 MB hold the map
    // and more than ten ticks.
    assert_whole(&rescued, 10);
    let _again = spawn_consumer(
        &sandbox,
        "gantry-record",
        &["--out", "again.mcap", "--lockstep"],
    );
    eventually("a new recorder records", || {
        (size(&sandbox.path("again.mcap.part")) > 4_000_000).then_some(())
    });
    assert!(daemon.is_running());
}

#[test]
fn a_restart_of_the_simulator_does_not_stop_the_recorder() {
    let sandbox = Sandbox::new("record-restart");
    let daemon = start_daemon(&sandbox, SMALL_RIG, &WAIT_FOR_ONE);
    let mut recorder = spawn_consumer(
        &sandbox,
        "gantry-record",
        &["--out", "drive.mcap", "--lockstep"],
    );
    // The map and the other documents are 2 MB of it.
    eventually("something is recorded", || {
        (size(&sandbox.path("drive.mcap.part")) > 6_000_000).then_some(())
    });
    daemon.kill9();
    let daemon = start_daemon(&sandbox, SMALL_RIG, &WAIT_FOR_ONE);
    eventually("the second run is recorded", || {
        (size(&sandbox.path("drive.2.mcap.part")) > 6_000_000).then_some(())
    });
    assert!(recorder.is_running());
    recorder.stop().expect_code(0);
    // The recording of the killed run ends where it was killed; before that both are complete.
    for file in ["drive.mcap", "drive.2.mcap"] {
        assert_whole(&sequences(&sandbox.path(file)), 4);
    }
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

/// Without lockstep a recorder that cannot keep up loses frames, counts them, and says so with its
/// exit code.
#[test]
fn what_is_lost_without_lockstep_is_counted() {
    let sandbox = Sandbox::new("lossy");
    let _daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    let recorder = spawn_consumer(
        &sandbox,
        "gantry-record",
        &[
            "--out",
            "drive.mcap",
            "--compression",
            "none",
            "--codec",
            "none",
        ],
    );
    // The map is some 2 MB of it.
    eventually("frames are recorded", || {
        (size(&sandbox.path("drive.mcap.part")) > 8_000_000).then_some(())
    });
    recorder.signal(Signal::SIGSTOP);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let before = counter(&mut client, "ticks");
    eventually("thirty ticks that it misses", || {
        (counter(&mut client, "ticks") > before + 30).then_some(())
    });
    recorder.signal(Signal::SIGCONT);
    eventually("ticks that it sees", || {
        (counter(&mut client, "ticks") > before + 50).then_some(())
    });
    let ended = recorder.stop().expect_code(3);
    assert!(ended.says("lost of ego/front/rgb"), "{:?}", ended.lines);
    let found = sequences(&sandbox.path("drive.mcap"));
    let numbers = &found["/ego/front/rgb/gantry"];
    let n_missing: u64 = numbers.windows(2).map(|pair| pair[1] - pair[0] - 1).sum();
    let line = ended
        .lines
        .iter()
        .find(|line| line.starts_with("lost of ego/front/rgb:"))
        .unwrap();
    let counted: u64 = line.split_whitespace().nth(3).unwrap().parse().unwrap();
    assert_eq!(counted, n_missing, "{line}");
}
