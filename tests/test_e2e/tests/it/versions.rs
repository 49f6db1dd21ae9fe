//! A topic of another version is refused by every kind of reader and by the simulator, each with a
//! sentence that says what to do.

use schema_frames::SCHEMA_VERSION;
use test_e2e::{SMALL_RIG, join_bus, python_package, spawn_consumer, spawn_daemon, venv_program};
use test_kit::sandbox::binary_path;
use test_kit::{Process, Sandbox};

const TOPIC: &str = "ego/front/rgb";

/// A process that announces [`TOPIC`] with the schema of the future.
fn other_version(sandbox: &Sandbox) -> Process {
    let program = binary_path("examples/other_version");
    let mut process = sandbox.spawn_program(
        "other_version",
        &program,
        &[sandbox.domain(), TOPIC, "99"],
        &[],
    );
    process.wait_line("announces schema 99");
    process
}

fn sentence(sandbox: &Sandbox) -> String {
    format!(
        "cannot join service \"{}/{TOPIC}\": it carries schema 99, this binary reads {SCHEMA_VERSION}; rebuild the consumer",
        sandbox.domain()
    )
}

#[test]
fn readers_refuse_another_version_with_a_sentence() {
    let sandbox = Sandbox::new("skew");
    let _other = other_version(&sandbox);
    let error = join_bus(&sandbox, "test")
        .frame_reader(TOPIC)
        .map(drop)
        .unwrap_err();
    assert_eq!(error.to_string(), sentence(&sandbox));
    let ended = spawn_consumer(&sandbox, "gantry", &["topic", "hz", TOPIC])
        .wait()
        .expect_code(1);
    assert!(ended.says(&sentence(&sandbox)), "{:?}", ended.lines);
}

#[test]
fn python_refuses_another_version_with_a_sentence() {
    let sandbox = Sandbox::new("skew-python");
    let _other = other_version(&sandbox);
    let code = format!(
        "import gantry\ntry:\n    gantry.open({TOPIC:?}, domain={:?})\nexcept gantry.SchemaVersionError as error:\n    print(error)",
        sandbox.domain()
    );
    let source = python_package();
    let env = [
        ("PYTHONPATH", source.to_str().unwrap()),
        ("PYTHONDONTWRITEBYTECODE", "1"),
    ];
    let ended = sandbox
        .spawn_program("python", &venv_program("python"), &["-c", &code], &env)
        .wait()
        .expect_code(0);
    assert!(
        ended.says(&format!(
            "it carries schema 99, this package reads {SCHEMA_VERSION}; install the gantry package"
        )),
        "{:?}",
        ended.lines
    );
}

#[test]
fn the_simulator_does_not_write_to_a_topic_of_another_version() {
    let sandbox = Sandbox::new("skew-simd");
    let _other = other_version(&sandbox);
    let ended = spawn_daemon(&sandbox, SMALL_RIG, &["--ticks", "1"]).wait();
    assert_ne!(ended.code(), 0, "{:?}", ended.lines);
    assert!(ended.says("it carries schema 99"), "{:?}", ended.lines);
}
