//! The Python package against a real daemon, with the interpreter of the repository's own
//! environment.

use nix::sys::signal::Signal;
use test_e2e::{
    SMALL_RIG, assert_nothing_left, join_bus, python_package, spawn_consumer, start_daemon,
    venv_program,
};
use test_kit::sandbox::{binary_path, repository};
use test_kit::{Process, Sandbox, eventually};

#[test]
fn every_kind_of_frame_is_read_in_place() {
    let sandbox = Sandbox::new("python");
    let daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    // Events and flow need something that moves.
    let driver = spawn_consumer(&sandbox, "gantry-drive", &[]);
    let script = repository().join("tests/test_e2e/python/every_frame.py");
    let package = python_package();
    let args = [script.to_str().unwrap(), sandbox.domain()];
    let env = [
        ("PYTHONPATH", package.to_str().unwrap()),
        ("PYTHONDONTWRITEBYTECODE", "1"),
    ];
    let ended = sandbox
        .spawn_program("python", &venv_program("python"), &args, &env)
        .wait()
        .expect_code(0);
    for check in [
        "check_every_kind",
        "check_sync",
        "check_world",
        "check_sentences",
    ] {
        assert!(ended.says(&format!("{check} passed")), "{:?}", ended.lines);
    }
    driver.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

/// The package's own tests, the live ones among them, and none of them skipped.
#[test]
fn the_package_passes_its_own_tests_without_skipping() {
    let sandbox = Sandbox::new("pytest");
    let (tests, source) = (
        repository().join("consumers/consumer_python/tests"),
        python_package(),
    );
    let card = binary_path("examples/test_card");
    let env = [
        ("PYTHONPATH", source.to_str().unwrap()),
        ("PYTHONDONTWRITEBYTECODE", "1"),
        ("GANTRY_TEST_CARD", card.to_str().unwrap()),
    ];
    let args = [
        "-m",
        "pytest",
        "-q",
        "-rs",
        "-p",
        "no:cacheprovider",
        tests.to_str().unwrap(),
    ];
    let ended = sandbox
        .spawn_program("pytest", &venv_program("python"), &args, &env)
        // Types alone take mypy most of a minute on two cores that do nothing else.
        .wait_longer(std::time::Duration::from_secs(900))
        .expect_code(0);
    assert!(
        ended.says(" passed") && !ended.says("skipped"),
        "{:?}",
        ended.lines
    );
}

/// The environment of a script with the package, whose domain is that of the sandbox.
fn program(sandbox: &Sandbox, words: &[&str]) -> Process {
    let script = repository().join("tests/test_e2e/python/own_program.py");
    let package = python_package();
    let args: Vec<&str> = [script.to_str().unwrap(), sandbox.domain()]
        .into_iter()
        .chain(words.iter().copied())
        .collect();
    let env = [
        ("PYTHONPATH", package.to_str().unwrap()),
        ("PYTHONDONTWRITEBYTECODE", "1"),
        ("GANTRY_DOMAIN", sandbox.domain()),
    ];
    sandbox.spawn_program("python", &venv_program("python"), &args, &env)
}

#[test]
fn a_program_of_the_users_own_steps_drives_and_publishes() {
    let sandbox = Sandbox::new("own-program");
    let daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    let ended = program(&sandbox, &[]).wait().expect_code(0);
    for check in [
        "check_lockstep",
        "check_rows",
        "check_actors",
        "check_two_participants",
        "check_event_loop",
        "check_control",
        "check_chain",
    ] {
        assert!(ended.says(&format!("{check} passed")), "{:?}", ended.lines);
    }
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn a_participant_in_python_that_is_killed_frees_the_world() {
    let sandbox = Sandbox::new("python-holder");
    let mut daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    let mut holder = program(&sandbox, &["hold"]);
    let line = holder.wait_line("holding ");
    let held: u64 = line.trim_start_matches("holding ").trim().parse().unwrap();
    let bus = join_bus(&sandbox, "test");
    let mut snapshots = bus.snapshot_reader().unwrap();
    let newest = eventually("a snapshot", || snapshots.latest().unwrap());
    assert_eq!(newest.header().tick, held);
    drop(newest);
    holder.signal(Signal::SIGKILL);
    holder.wait();
    daemon.wait_line("lockstep participant is gone");
    eventually("the world goes on", || {
        let newest = snapshots.latest().unwrap()?;
        (newest.header().tick > held + 2).then_some(())
    });
    drop((snapshots, bus));
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}
