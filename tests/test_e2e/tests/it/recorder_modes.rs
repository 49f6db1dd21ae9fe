//! `gantry-record` beside a real daemon: sets of files, rings that are written on request, and disks
//! that are full or closed.

use std::path::{Path, PathBuf};

use nix::sys::signal::Signal;
use schema_frames::{Command, CommandReply};
use schema_recording::read::RecordingFile;
use schema_recording::scenery::{SceneryList, tick_of};
use test_e2e::recording::{gapless, sequences};
use test_e2e::{
    SMALL_RIG, SMALL_RIG_TOPICS, ask, assert_nothing_left, counter, join_bus, spawn_consumer,
    start_daemon,
};
use test_kit::sandbox::binary_path;
use test_kit::{Sandbox, eventually};

const WAIT_FOR_ONE: [&str; 3] = ["--unpaced", "--await-lockstep", "1"];

fn files(sandbox: &Sandbox, stem: &str) -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = std::fs::read_dir(sandbox.dir())
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| {
            let name = path.file_name().unwrap().to_string_lossy();
            name.starts_with(stem) && name.ends_with(".mcap")
        })
        .collect();
    found.sort();
    found
}

/// The lists of what stands on the map in a recording, in the order of their ticks.
fn scenery(path: &Path) -> Vec<SceneryList> {
    let file = RecordingFile::open(path).unwrap();
    let names = file.attachment_names();
    let of_scenery = names.into_iter().filter(|it| tick_of(it).is_some());
    let read = |name| file.attachment(name).unwrap().expect("it is listed");
    let mut lists: Vec<SceneryList> = of_scenery
        .map(|name| serde_json::from_slice(&read(name)).unwrap())
        .collect();
    lists.sort_by_key(|list| list.tick);
    lists
}

#[test]
fn a_set_of_files_has_every_tick_once_and_can_be_joined() {
    let sandbox = Sandbox::new("record-set");
    let _daemon = start_daemon(&sandbox, SMALL_RIG, &WAIT_FOR_ONE);
    let words = [
        "--out",
        "drive.mcap",
        "--lockstep",
        "--split-duration",
        "1s",
    ];
    let recorder = spawn_consumer(&sandbox, "gantry-record", &words);
    let n_files = |n: usize| {
        eventually("another file", || {
            (files(&sandbox, "drive_").len() >= n).then_some(())
        });
    };
    n_files(2);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let hide = Command::ShowLayers {
        layers: 16,
        shown: false,
    };
    assert!(matches!(ask(&mut client, hide), CommandReply::Done));
    n_files(4);
    recorder.stop().expect_code(0);
    let names = files(&sandbox, "drive_");
    let mut last = 0;
    for path in &names {
        let found = sequences(path);
        let (first, end) = gapless(&found, "/world/snapshot");
        assert!(
            first <= 1 || first == last + 1,
            "{} begins at {first}",
            path.display()
        );
        last = end;
        for document in [
            "/world/info",
            "/world/map",
            "/world/actors",
            "/control/journal",
        ] {
            assert!(
                found.contains_key(document),
                "{} lacks {document}",
                path.display()
            );
        }
    }
    let mut words = vec!["merge"];
    words.extend(names.iter().map(|path| path.to_str().unwrap()));
    words.push("whole.mcap");
    sandbox.spawn("gantry-record", &words).wait().expect_code(0);
    // What stands on the map is kept in each file and all that is made of them: parked cars until
    // they are hidden.
    let until = format!("{}s", last / 40);
    let trimmed = ["trim", "whole.mcap", "half.mcap", "--to", &until];
    sandbox
        .spawn("gantry-record", &trimmed)
        .wait()
        .expect_code(0);
    let latest = names.last().expect("four files");
    for path in [
        latest,
        &sandbox.path("whole.mcap"),
        &sandbox.path("half.mcap"),
    ] {
        let lists = scenery(path);
        let n_cars = |list: &SceneryList, shown: bool| {
            let cars = list.objects.iter().filter(|it| it.class == 14);
            cars.filter(|car| car.shown == shown).count()
        };
        let [before, after] = &lists[..] else {
            panic!("{} lists in {}", lists.len(), path.display());
        };
        assert!(before.tick <= 1 && after.tick > 20, "{}", after.tick);
        assert!(n_cars(before, true) > 50 && n_cars(before, false) == 0);
        assert_eq!(n_cars(after, false), n_cars(before, true));
    }
    let whole = sequences(&sandbox.path("whole.mcap"));
    assert_eq!(gapless(&whole, "/world/snapshot").1, last);
    for topic in SMALL_RIG_TOPICS {
        gapless(&whole, &format!("/{topic}/gantry"));
    }
}

#[test]
fn a_ring_is_written_by_command_and_by_signal_and_leaves_nothing_behind() {
    let sandbox = Sandbox::new("record-ring");
    let daemon = start_daemon(&sandbox, SMALL_RIG, &WAIT_FOR_ONE);
    let words = ["--out", "crash.mcap", "--lockstep", "--keep", "1s"];
    let mut recorder = spawn_consumer(&sandbox, "gantry-record", &words);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    eventually("three seconds", || {
        (counter(&mut client, "ticks") >= 60).then_some(())
    });
    assert!(
        files(&sandbox, "crash").is_empty(),
        "nothing is written unasked"
    );
    let dumped = spawn_consumer(&sandbox, "gantry-record", &["dump", "--note", "a test"])
        .wait()
        .expect_code(0);
    assert!(dumped.says("crash_0001.mcap"), "{:?}", dumped.lines);
    let found = sequences(&sandbox.path("crash_0001.mcap"));
    let (first, last) = gapless(&found, "/world/snapshot");
    assert!(
        first > 20 && (19..=22).contains(&(last - first)),
        "ticks {first} to {last}"
    );
    for document in [
        "/world/info",
        "/world/map",
        "/world/actors",
        "/control/journal",
    ] {
        assert!(found.contains_key(document), "{document}");
    }
    assert_eq!(scenery(&sandbox.path("crash_0001.mcap")).len(), 1);
    recorder.signal(Signal::SIGUSR1);
    eventually("a second file", || {
        sandbox.path("crash_0002.mcap").exists().then_some(())
    });
    assert!(recorder.is_running());
    recorder.stop().expect_code(0);
    assert_eq!(
        files(&sandbox, "crash").len(),
        2,
        "--dump-at-end was not given"
    );
    let alone = spawn_consumer(&sandbox, "gantry-record", &["dump"])
        .wait()
        .expect_code(1);
    assert!(alone.says("keeps a ring"), "{:?}", alone.lines);
    daemon.stop().expect_code(0);
    drop((client, bus));
    assert_nothing_left(&sandbox);
}

/// A limit on the size of files stands for a full disk: the write fails in the same place.
#[test]
fn a_full_disk_ends_the_recording_with_a_sentence_and_what_was_written_stays() {
    let sandbox = Sandbox::new("record-full");
    let mut daemon = start_daemon(&sandbox, SMALL_RIG, &WAIT_FOR_ONE);
    let recorder = binary_path("gantry-record");
    let line = format!(
        "trap '' XFSZ; ulimit -f 24000; exec {} --domain {} --out drive.mcap --lockstep --codec none --compression none",
        recorder.display(),
        sandbox.domain()
    );
    let ended = sandbox
        .spawn_program("recorder", "/bin/sh".as_ref(), &["-c", &line], &[])
        .wait()
        .expect_code(1);
    assert!(
        ended.says("could not be written to its end") && ended.says("drive.mcap"),
        "{:?}",
        ended.lines
    );
    assert!(!sandbox.path("drive.mcap").exists());
    sandbox
        .spawn(
            "gantry-record",
            &["recover", "drive.mcap.part", "rescued.mcap"],
        )
        .wait()
        .expect_code(0);
    let (_, last) = gapless(&sequences(&sandbox.path("rescued.mcap")), "/world/snapshot");
    assert!(last > 10, "only {last} ticks were rescued");
    daemon.wait_line("left the lockstep");
    assert!(daemon.is_running());
}

#[test]
fn a_folder_that_cannot_be_written_is_named() {
    let sandbox = Sandbox::new("record-closed");
    let ended = spawn_consumer(&sandbox, "gantry-record", &["--out", "/proc/drive.mcap"])
        .wait()
        .expect_code(1);
    assert!(
        ended.says("cannot create /proc/drive.mcap.part"),
        "{:?}",
        ended.lines
    );
    let wrong = spawn_consumer(
        &sandbox,
        "gantry-record",
        &["--out", "a.mcap", "--split-size", "ten"],
    )
    .wait()
    .expect_code(2);
    assert!(wrong.says("it like 500MB"), "{:?}", wrong.lines);
}

#[test]
fn a_recording_becomes_a_file_of_rerun_with_every_frame() {
    let sandbox = Sandbox::new("record-convert");
    let _daemon = start_daemon(&sandbox, SMALL_RIG, &WAIT_FOR_ONE);
    let words = ["--out", "drive.mcap", "--lockstep"];
    let recorder = spawn_consumer(&sandbox, "gantry-record", &words);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    eventually("ten ticks", || {
        (counter(&mut client, "ticks") >= 10).then_some(())
    });
    recorder.stop().expect_code(0);
    let recorded = sequences(&sandbox.path("drive.mcap"));
    let of_sensor = |channel: &&String| channel.ends_with("/gantry");
    let n_frames: usize = recorded
        .keys()
        .filter(of_sensor)
        .map(|channel| recorded[channel].len())
        .sum();
    let words = ["convert", "drive.mcap", "drive.rrd"];
    let converted = sandbox.spawn("gantry-record", &words).wait().expect_code(0);
    let said = format!(
        "drive.rrd: {n_frames} frames of {} topics",
        SMALL_RIG_TOPICS.len()
    );
    assert!(converted.says(&said), "not {said:?}: {:?}", converted.lines);
    let bytes = std::fs::read(sandbox.path("drive.rrd")).unwrap();
    assert!(bytes.starts_with(b"RRF2"), "{:?}", &bytes[..4]);
    let again = sandbox.spawn("gantry-record", &words).wait().expect_code(1);
    assert!(again.says("exists already"), "{:?}", again.lines);
    let words = ["convert", "drive.mcap", "drive.bag"];
    let other = sandbox.spawn("gantry-record", &words).wait().expect_code(1);
    assert!(other.says("must end in .rrd"), "{:?}", other.lines);
}
