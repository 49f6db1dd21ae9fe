//! `kill -9`, SIGSTOP and full memory: survivors go on, memory comes back, a message says what
//! happened.

use nix::sys::signal::Signal;
use test_e2e::{SMALL_RIG, ask, counter, join_bus, reader, spawn_daemon, start_daemon, step};
use test_kit::{Sandbox, eventually};

use schema_frames::{Command, CommandReply};

/// A reader holds a frame while the daemon is killed: its bytes stay, and after a restart the same
/// reader goes on by itself.
#[test]
fn daemon_killed_while_a_reader_holds_a_frame() {
    let sandbox = Sandbox::new("kill-daemon");
    let daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    let bus = join_bus(&sandbox, "test");
    let mut rgb = reader(&bus, "ego/front/rgb");
    let held = eventually("a frame", || rgb.next().unwrap());
    let bytes = held.to_vec();
    let epoch = held.header().epoch;
    daemon.kill9();
    assert_eq!(*held, bytes[..], "a held frame outlives its publisher");
    let _daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    let frame = eventually("a frame of the new daemon", || {
        rgb.next()
            .unwrap()
            .filter(|frame| frame.header().epoch != epoch)
    });
    assert!(frame.header().seq >= 1);
    assert_eq!(*held, bytes[..], "and the new publisher as well");
}

#[test]
fn nothing_is_left_in_shared_memory_after_everybody_was_killed() {
    let sandbox = Sandbox::new("left");
    let daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    let mut watcher = sandbox.spawn(
        "gantry",
        &["topic", "hz", "ego/front/rgb", "--domain", sandbox.domain()],
    );
    let bus = join_bus(&sandbox, "test");
    eventually("gantry reads", || {
        bus.topics()
            .unwrap()
            .iter()
            .find(|t| t.name == "ego/front/rgb" && t.subscribers > 0)
            .map(drop)
    });
    assert!(watcher.is_running());
    daemon.kill9();
    watcher.kill9();
    drop(bus);
    let bus = join_bus(&sandbox, "cleaner");
    bus.clean_dead_nodes();
    drop(bus);
    assert_eq!(sandbox.leftovers(), Vec::<String>::new());
}

#[test]
fn daemon_stopped_by_sigterm_leaves_nothing() {
    let sandbox = Sandbox::new("term");
    let daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    let bus = join_bus(&sandbox, "test");
    let mut rgb = reader(&bus, "ego/front/rgb");
    eventually("a frame", || rgb.next().unwrap());
    drop(rgb);
    drop(bus);
    daemon.stop().expect_code(0);
    assert_eq!(sandbox.leftovers(), Vec::<String>::new());
}

/// A reader that was stopped does not hold the tick: the daemon's ticks go on, and the reader finds
/// the newest frames afterwards.
#[test]
fn a_paused_reader_does_not_slow_the_daemon() {
    let sandbox = Sandbox::new("pause");
    let _daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let watcher = sandbox.spawn(
        "gantry",
        &["topic", "hz", "ego/imu/imu", "--domain", sandbox.domain()],
    );
    eventually("gantry reads", || {
        bus.topics()
            .unwrap()
            .iter()
            .find(|t| t.name == "ego/imu/imu" && t.subscribers > 0)
            .map(drop)
    });
    watcher.signal(Signal::SIGSTOP);
    let before = counter(&mut client, "sent ego/imu/imu");
    eventually("twenty more frames are sent", || {
        (counter(&mut client, "sent ego/imu/imu") > before + 20).then_some(())
    });
    assert_eq!(
        counter(&mut client, "dropped ego/imu/imu"),
        0,
        "the reader loses frames, the daemon does not"
    );
    watcher.signal(Signal::SIGCONT);
}

/// A lockstep participant dies without leaving: the daemon says so and goes on.
#[test]
fn a_lockstep_participant_that_is_killed_is_removed() {
    let sandbox = Sandbox::new("lockstep");
    let mut daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let driver = sandbox.spawn(
        "gantry-drive",
        &["--lockstep", "--domain", sandbox.domain()],
    );
    daemon.wait_line("joined the lockstep");
    let before = counter(&mut client, "ticks");
    eventually("ticks with the participant", || {
        (counter(&mut client, "ticks") > before + 5).then_some(())
    });
    driver.signal(Signal::SIGSTOP);
    let stopped = eventually("the gate closes", || {
        let ticks = counter(&mut client, "ticks");
        std::thread::sleep(std::time::Duration::from_millis(300));
        (counter(&mut client, "ticks") == ticks).then_some(ticks)
    });
    driver.kill9();
    eventually("ticks without it", || {
        (counter(&mut client, "ticks") > stopped + 5).then_some(())
    });
    daemon.wait_line("lockstep participant is gone");
}

#[test]
fn a_client_that_dies_in_stepped_mode_does_not_halt_the_world_for_ever() {
    let sandbox = Sandbox::new("lost-client");
    let text = SMALL_RIG.replace("tick_hz = 20", "tick_hz = 20\nmode = \"stepped\"");
    let mut daemon = start_daemon(&sandbox, &text, &[]);
    {
        let bus = join_bus(&sandbox, "test");
        let mut client = bus.command_client("test").unwrap();
        step(&mut client, 2);
    }
    daemon.wait_line("running on by itself until the next cue");
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    eventually("ticks without a cue", || {
        (counter(&mut client, "ticks") > 4).then_some(())
    });
    assert!(matches!(
        ask(&mut client, Command::Step { n: 1 }),
        CommandReply::Stepping { .. }
    ));
    daemon.wait_line("a client steps again");
}

#[test]
fn too_little_shared_memory_is_one_sentence_before_anything_starts() {
    let sandbox = Sandbox::new("memory");
    let mut text = String::from("version = 1\n[scenario]\nvehicles = 0\n");
    for i in 0..64 {
        text.push_str(&format!(
            "[sensor.c{i}]\nkind = \"camera\"\nwidth_px = 4096\nheight_px = 4096\nmodalities = [\"rgb\", \"depth\", \"instance\", \"flow\", \"normals\"]\n"
        ));
    }
    let ended = spawn_daemon(&sandbox, &text, &[]).wait().expect_code(2);
    assert!(
        ended.says("MiB of shared memory, but /dev/shm has"),
        "{:?}",
        ended.lines
    );
    assert_eq!(sandbox.leftovers(), Vec::<String>::new());
}

/// A GPU that fails ends the daemon with a sentence and a code of its own, and nothing is left; the
/// same readers go on with the daemon that comes next.
#[test]
fn a_lost_gpu_ends_the_daemon_with_a_sentence_and_its_own_code() {
    let sandbox = Sandbox::new("lost-gpu");
    let file = sandbox.path("lose");
    let words = ["--lose-gpu-when", file.to_str().unwrap()];
    let daemon = start_daemon(&sandbox, SMALL_RIG, &words);
    let bus = join_bus(&sandbox, "test");
    let mut rgb = reader(&bus, "ego/front/rgb");
    let epoch = eventually("a frame", || rgb.next().unwrap()).header().epoch;
    sandbox.write("lose", "");
    let ended = daemon.wait().expect_code(4);
    // Graphics drivers print lines of their own, some of which begin with "error:" too.
    let sentences = ended.lines.iter().filter(|line| {
        line.starts_with("error: ") && line.contains("failed while working on a frame")
    });
    assert_eq!(sentences.count(), 1, "{:?}", ended.lines);
    assert!(!ended.says("panicked"), "{:?}", ended.lines);
    let _daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    eventually("a frame of the new daemon", || {
        let frame = rgb.next().unwrap()?;
        (frame.header().epoch != epoch).then_some(())
    });
    drop((rgb, bus));
    _daemon.stop().expect_code(0);
    assert_eq!(sandbox.leftovers(), Vec::<String>::new());
}

/// A camera that does not fit the GPU's memory is refused; the others go on.
#[test]
fn a_camera_that_does_not_fit_the_gpu_is_refused() {
    let sandbox = Sandbox::new("gpu-memory");
    let _daemon = start_daemon(&sandbox, SMALL_RIG, &["--gpu-memory", "16"]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut rgb = reader(&bus, "ego/front/rgb");
    let first = eventually("a frame", || rgb.latest().unwrap()).header().seq;
    let spawn = |side_px: u32| {
        Command::SpawnSensor {
        type_id: "sensor.camera.view".into(),
        pose: schema_types::Pose::from_xyz_yaw(0.5, 0.0, 2.0, 0.3).into(),
        parent_id: None,
        attachment: Default::default(),
        interval_nanos: 0,
        spec: serde_json::from_str(&format!(
            r#"{{"kind": "camera", "width_px": {side_px}, "height_px": {side_px}, "modalities": ["rgb"]}}"#
        ))
        .unwrap(),
        attributes: Default::default(),
    }
    };
    let CommandReply::Refused { error } = ask(&mut client, spawn(1024)) else {
        panic!("a camera of 1024 x 1024 pixels fits 16 MiB")
    };
    assert!(
        error.contains("1024 x 1024") && error.contains("16 MiB"),
        "{error}"
    );
    let CommandReply::Spawned { topics, .. } = ask(&mut client, spawn(32)) else {
        panic!("a small camera was refused")
    };
    let mut small = reader(&bus, &topics[0]);
    eventually("a frame of the small camera", || small.latest().unwrap());
    eventually("frames go on", || {
        let frame = rgb.latest().unwrap()?;
        (frame.header().seq > first + 5).then_some(())
    });
    // A launch file that asks for too much is refused as a whole.
    let other = Sandbox::new("gpu-memory-file");
    let large = SMALL_RIG
        .replace("width_px = 96", "width_px = 256")
        .replace("height_px = 64", "height_px = 256");
    let ended = spawn_daemon(&other, &large, &["--gpu-memory", "1"])
        .wait()
        .expect_code(2);
    assert!(
        ended.says("\"front\"") && ended.says("has no memory for"),
        "{:?}",
        ended.lines
    );
}

#[test]
fn a_second_daemon_on_one_domain_is_refused() {
    let sandbox = Sandbox::new("second");
    let mut first = start_daemon(&sandbox, SMALL_RIG, &[]);
    let ended = spawn_daemon(&sandbox, SMALL_RIG, &[]).wait().expect_code(2);
    assert!(ended.says("already has a daemon"), "{:?}", ended.lines);
    assert!(first.is_running());
}

#[test]
fn a_broken_launch_file_is_reported_with_its_place() {
    let sandbox = Sandbox::new("broken");
    let text = SMALL_RIG.replace("channels = 8", "chanels = 8");
    let ended = spawn_daemon(&sandbox, &text, &[]).wait().expect_code(2);
    assert!(
        ended.says("unknown key \"chanels\" in [sensor.roof], did you mean \"channels\"?"),
        "{:?}",
        ended.lines
    );
    assert!(ended.says("launch.toml:"), "{:?}", ended.lines);
    let ended = sandbox
        .spawn("simd", &["--launch", "no-such-file.toml"])
        .wait()
        .expect_code(2);
    assert!(ended.says("no-such-file.toml"), "{:?}", ended.lines);
    let ended = spawn_daemon(&sandbox, &SMALL_RIG.replace("Town10HD", "Town99"), &[])
        .wait()
        .expect_code(2);
    assert!(
        ended.says("Town99") && ended.says("Town10HD"),
        "{:?}",
        ended.lines
    );
}
