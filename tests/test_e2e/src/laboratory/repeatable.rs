//! An episode in lockstep: whoever only looks on may be struck, and whoever takes part may be
//! stopped for a while; every frame of the world stays the same to the last bit.

use std::sync::OnceLock;
use std::time::Duration;

use nix::sys::signal::Signal;
use test_kit::client::assert_nothing_left;
use test_kit::programs::{spawn_consumer, spawn_daemon};
use test_kit::{Process, Sandbox};

use super::cast::RIG;
use super::table::{Blow, Fault, Moment, Role, Tally};

const N_TICKS: &str = "60";

/// Who is struck: onlookers by anything, those that take part only by being stopped.
const ONLOOKERS: [(Role, &str, &[&str]); 3] = [
    (Role::Viewer, "gantry-view", &["--save"]),
    (Role::Recorder, "gantry-record", &["--out"]),
    (Role::Reader, "gantry", &["topic", "hz", "ego/imu/imu"]),
];

/// Runs it and compares it with a run that nobody disturbed.
///
/// # Panics
/// If a frame differs, or something is left.
pub fn run(seed: u64, n_steps: usize, story: &mut Vec<String>, tally: &mut Tally) {
    static UNDISTURBED: OnceLock<Vec<String>> = OnceLock::new();
    let wanted = UNDISTURBED.get_or_init(|| hashes(|_, _, _| {}));
    let mut random = fastrand::Rng::with_seed(seed);
    let found = hashes(|sandbox, daemon, driver| {
        for n in 0..n_steps {
            let (fault, sentence) = disturb(sandbox, daemon, driver, n, &mut random);
            story.push(sentence);
            tally.add(fault, true);
        }
    });
    let differs = wanted.iter().zip(&found).find(|(a, b)| a != b);
    assert!(differs.is_none(), "the world differs: {differs:?}");
    assert_eq!(wanted.len(), found.len(), "as many frames");
}

fn disturb(
    sandbox: &Sandbox,
    daemon: &Process,
    driver: &Process,
    n: usize,
    random: &mut fastrand::Rng,
) -> (Fault, String) {
    let fault = |role, signal| Fault {
        role,
        blow: Blow::Signal(signal),
        moment: Moment::Any,
    };
    let pause = Duration::from_millis(random.u64(5..200));
    let stopped = match random.u32(0..5) {
        0 => Some((Role::Daemon, "the daemon", daemon)),
        1 => Some((Role::Driver, "the driver, which is waited for,", driver)),
        _ => None,
    };
    if let Some((role, name, process)) = stopped {
        process.signal(Signal::SIGSTOP);
        std::thread::sleep(pause);
        process.signal(Signal::SIGCONT);
        let sentence = format!("{name} is stopped for {pause:?}");
        return (fault(role, Signal::SIGSTOP), sentence);
    }
    let (role, program, words) = ONLOOKERS[random.usize(0..ONLOOKERS.len())];
    let file = format!("{program}{n}.out");
    let mut args = words.to_vec();
    if words.len() == 1 {
        args.push(&file);
    }
    let onlooker = spawn_consumer(sandbox, program, &args);
    std::thread::sleep(pause);
    let signal = [Signal::SIGKILL, Signal::SIGTERM][random.usize(0..2)];
    onlooker.signal(signal);
    onlooker.wait();
    let sentence = format!("{program} gets {signal} after {pause:?}");
    (fault(role, signal), sentence)
}

/// The lines `TICK TOPIC HASH` of one run.
fn hashes(disturb: impl FnOnce(&Sandbox, &Process, &Process)) -> Vec<String> {
    let sandbox = Sandbox::new("laboratory-lockstep");
    let args = [
        "--hash",
        "--ticks",
        N_TICKS,
        "--await-participant",
        "driver",
    ];
    let mut daemon = spawn_daemon(&sandbox, RIG, &args);
    daemon.wait_line("ready");
    let driver = spawn_consumer(&sandbox, "gantry-drive", &["--lockstep=driver"]);
    disturb(&sandbox, &daemon, &driver);
    let ended = daemon.wait().expect_code(0);
    driver.stop().expect_code(0);
    assert_nothing_left(&sandbox);
    let is_hash = |line: &String| {
        line.split(' ').nth(2).is_some_and(|hash| hash.len() == 16)
            && line.starts_with(|first: char| first.is_ascii_digit())
    };
    ended.lines.into_iter().filter(is_hash).collect()
}
