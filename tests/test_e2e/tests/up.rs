//! `gantry up` with the real programs, as a user starts it: files that are whole, exit codes,
//! nothing left behind.

use std::path::Path;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use test_e2e::recording::{gapless, sequences};
use test_e2e::{SMALL_RIG, SMALL_RIG_TOPICS, assert_nothing_left};
use test_kit::{Process, Sandbox, eventually};

/// The small rig and the processes of the quickstart.
fn pipeline() -> String {
    format!(
        "{SMALL_RIG}
[defaults]
env = {{ DO_NOT_TRACK = \"1\" }}
[process.simd]
cmd = [\"simd\"]
required = true
ready = {{ service = \"world/snapshot\" }}
[process.drive]
cmd = [\"gantry-drive\"]
after = [\"simd\"]
restart = {{ policy = \"on-failure\" }}
"
    )
}

fn up(sandbox: &Sandbox, launch: &str, more: &[&str]) -> Process {
    let file = sandbox.write("test.toml", launch);
    let data = sandbox.path("data");
    let words = [
        "up",
        file.to_str().unwrap(),
        "--data",
        data.to_str().unwrap(),
        "--domain",
        sandbox.domain(),
    ];
    sandbox.spawn("gantry", &[&words[..], more].concat())
}

/// Processes whose command line names the sandbox's domain.
fn processes_of(sandbox: &Sandbox) -> Vec<(i32, String)> {
    let entries = std::fs::read_dir("/proc").expect("proc is there");
    let with_command = entries.filter_map(|entry| {
        let pid = entry.ok()?.file_name().to_str()?.parse().ok()?;
        let command = std::fs::read(format!("/proc/{pid}/cmdline")).ok()?;
        Some((pid, String::from_utf8_lossy(&command).replace('\0', " ")))
    });
    let named =
        |(_, command): &(i32, String)| command.split(' ').any(|word| word == sandbox.domain());
    with_command.filter(named).collect()
}

fn pid_of(sandbox: &Sandbox, program: &str) -> Pid {
    let is_it = |command: &str| {
        command
            .split(' ')
            .next()
            .is_some_and(|first| first.rsplit('/').next() == Some(program))
    };
    eventually(&format!("{program} runs"), || {
        processes_of(sandbox)
            .into_iter()
            .find(|(_, command)| is_it(command))
            .map(|(pid, _)| Pid::from_raw(pid))
    })
}

fn assert_clean(sandbox: &Sandbox) {
    assert_eq!(processes_of(sandbox), Vec::new());
    assert_nothing_left(sandbox);
}

fn assert_whole_files(sandbox: &Sandbox) {
    let found = sequences(&sandbox.path("drive.mcap"));
    assert!(gapless(&found, "/world/snapshot").1 > 5);
    for topic in SMALL_RIG_TOPICS {
        let (first, last) = gapless(&found, &format!("/{topic}/gantry"));
        assert!(
            first == 1 && last > 3,
            "{topic} goes from {first} to {last}"
        );
    }
    let bytes = std::fs::read(sandbox.path("drive.rrd")).unwrap();
    assert!(
        bytes.starts_with(b"RRF2") && bytes.len() > 100_000,
        "{} bytes",
        bytes.len()
    );
    let parts = std::fs::read_dir(sandbox.dir())
        .unwrap()
        .flatten()
        .filter(|entry| entry.file_name().to_string_lossy().ends_with(".part"));
    assert_eq!(parts.count(), 0);
}

fn size(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |file| file.len())
}

#[test]
fn some_seconds_give_a_recording_and_a_view_and_leave_nothing() {
    let sandbox = Sandbox::new("up");
    up(
        &sandbox,
        &pipeline(),
        &[
            "--for",
            "5s",
            "--record",
            "drive.mcap",
            "--view",
            "save:drive.rrd",
        ],
    )
    .wait()
    .expect_code(0);
    assert_whole_files(&sandbox);
    assert_clean(&sandbox);
}

#[test]
fn ctrl_c_in_the_middle_ends_well_with_whole_files() {
    let sandbox = Sandbox::new("ctrl-c");
    let gantry = up(
        &sandbox,
        &pipeline(),
        &["--record", "drive.mcap", "--view", "save:drive.rrd"],
    );
    // The map and some frames; the viewer writes as it goes.
    eventually("files grow", || {
        (size(&sandbox.path("drive.mcap.part")) > 5_000_000
            && size(&sandbox.path("drive.rrd")) > 500_000)
            .then_some(())
    });
    gantry.signal(Signal::SIGINT);
    gantry.wait().expect_code(0);
    assert_whole_files(&sandbox);
    assert_clean(&sandbox);
}

#[test]
fn a_killed_simulator_ends_the_pipeline_with_a_failure_and_no_leftovers() {
    let sandbox = Sandbox::new("up-kill");
    let mut gantry = up(&sandbox, &pipeline(), &["--view", "save:drive.rrd"]);
    gantry.wait_line("processes are up");
    kill(pid_of(&sandbox, "simd"), Signal::SIGKILL).unwrap();
    let ended = gantry.wait();
    assert_ne!(ended.code(), 0, "{:?}", ended.lines);
    assert!(ended.says("simd is required"), "{:?}", ended.lines);
    assert_clean(&sandbox);
}

#[test]
fn a_killed_driver_is_restarted_and_drives_on() {
    let sandbox = Sandbox::new("up-driver");
    let mut gantry = up(&sandbox, &pipeline(), &["--view", "none"]);
    gantry.wait_line("driving vehicles=5");
    let first = pid_of(&sandbox, "gantry-drive");
    kill(first, Signal::SIGKILL).unwrap();
    gantry.wait_line("drive ended with signal SIGKILL");
    eventually("it drives again", || {
        (gantry
            .lines()
            .iter()
            .filter(|line| line.contains("driving vehicles=5"))
            .count()
            >= 2)
            .then_some(())
    });
    assert_ne!(pid_of(&sandbox, "gantry-drive"), first);
    gantry.stop().expect_code(0);
    assert_clean(&sandbox);
}

#[test]
fn a_dry_run_tells_everything_and_starts_nothing() {
    let sandbox = Sandbox::new("up-dry");
    let ended = up(
        &sandbox,
        &pipeline(),
        &[
            "--dry-run",
            "--record",
            "drive.mcap",
            "--set",
            "scenario.seed=9",
        ],
    )
    .wait()
    .expect_code(0);
    for text in [
        "seed = 9",
        "[sensor.roof]",
        "Shared memory",
        "ego/front/rgb (frames of up to 24576 bytes; 8 readers, 2 wait and 3 are held)",
    ] {
        assert!(ended.says(text), "{text:?} is not in {:?}", ended.lines);
    }
    assert!(!sandbox.path("drive.mcap.part").exists() && !sandbox.path("drive.mcap").exists());
    assert_eq!(sandbox.leftovers(), Vec::<String>::new());
}

#[test]
fn what_is_wrong_is_said_before_anything_starts() {
    let sandbox = Sandbox::new("up-wrong");
    let ended = up(
        &sandbox,
        &pipeline().replace("rate_hz = 10", "rate_hs = 10"),
        &[],
    )
    .wait()
    .expect_code(2);
    assert!(
        ended.says("unknown key \"rate_hs\"") && ended.says("did you mean \"rate_hz\"?"),
        "{:?}",
        ended.lines
    );
    let ended = up(
        &sandbox,
        &pipeline().replace("\"gantry-drive\"", "\"gantry-drove\""),
        &[],
    )
    .wait()
    .expect_code(2);
    assert!(
        ended.says("there is no program \"gantry-drove\""),
        "{:?}",
        ended.lines
    );
    let ended = up(&sandbox, &pipeline(), &["--set", "sensor.front.rate_hz=7"])
        .wait()
        .expect_code(2);
    assert!(ended.says("rate_hz"), "{:?}", ended.lines);
    std::fs::write(sandbox.path("there.mcap"), "mine").unwrap();
    let ended = up(
        &sandbox,
        &pipeline(),
        &["--record", "there.mcap", "--for", "1s"],
    )
    .wait();
    assert_ne!(ended.code(), 0, "{:?}", ended.lines);
    assert_eq!(
        std::fs::read_to_string(sandbox.path("there.mcap")).unwrap(),
        "mine",
        "nobody's file is overwritten"
    );
    assert_clean(&sandbox);
}
