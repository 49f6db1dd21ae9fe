//! The Python package against a real daemon, with the interpreter of the repository's own
//! environment.

use test_e2e::{
    SMALL_RIG, assert_nothing_left, python_package, spawn_consumer, start_daemon, venv_program,
};
use test_kit::Sandbox;
use test_kit::sandbox::{binary_path, repository};

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
        .wait()
        .expect_code(0);
    assert!(
        ended.says(" passed") && !ended.says("skipped"),
        "{:?}",
        ended.lines
    );
}
