//! Recordings of driven worlds, and the Python programs that read them or what was made of them.

use std::time::Duration;

use test_kit::Sandbox;
use test_kit::client::{counter, join_bus};
use test_kit::patience::eventually;
use test_kit::process::Ended;
use test_kit::programs::{spawn_consumer, start_daemon};
use test_kit::sandbox::repository;

use crate::processes::venv_program;

/// Far beyond what a script takes on any machine.
const LIMIT: Duration = Duration::from_secs(1800);

/// Records so many ticks of a driven world into `drive.mcap`, payloads as they are.
pub fn record_drive(sandbox: &Sandbox, launch: &str, n_ticks: u64) {
    let daemon = start_daemon(sandbox, launch, &["--unpaced", "--await-lockstep", "2"]);
    let driver = spawn_consumer(sandbox, "gantry-drive", &["--lockstep"]);
    let recorder = spawn_consumer(
        sandbox,
        "gantry-record",
        &["--out", "drive.mcap", "--lockstep", "--codec", "none"],
    );
    let bus = join_bus(sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut n_done = 0;
    while n_done < n_ticks {
        n_done = eventually("the next ticks", || {
            let n_now = counter(&mut client, "ticks");
            (n_now > n_done).then_some(n_now)
        });
    }
    drop(client);
    drop(bus);
    recorder.stop().expect_code(0);
    driver.stop().expect_code(0);
    daemon.stop().expect_code(0);
}

/// Runs a script of `python/` in the sandbox, which must succeed.
pub fn run_python(sandbox: &Sandbox, script: &str, words: &[&str]) -> Ended {
    let script = repository().join("tests/test_e2e/python").join(script);
    let words = [&[script.to_str().unwrap()], words].concat();
    let checked = sandbox.spawn_program("python", &venv_program("python"), &words, &[]);
    checked.wait_longer(LIMIT).expect_code(0)
}
