//! An episode of render workers: a world that is stepped shares its cameras among two of them and
//! itself, and they are struck while a tick is made. Every frame of every tick comes, with the bytes
//! of a run without workers.

use std::collections::BTreeMap;
use std::sync::OnceLock;
use std::time::Duration;

use nix::sys::signal::Signal;
use schema_bus::FrameReader;
use schema_frames::{Command, CommandReply};
use test_kit::client::{ask, assert_nothing_left, counter, join_bus, reader};
use test_kit::programs::{spawn_consumer, start_daemon};
use test_kit::{Process, Sandbox, eventually};

use super::cast::RIG;
use super::table::{Blow, Fault, Moment, Role, Tally};

/// Ticks of a run; a step is one of them, and there is time behind the last one to be brought back.
const N_TICKS: u64 = 60;
const TOPICS: [&str; 3] = ["ego/front/rgb", "ego/front/depth", "ego/rear/rgb"];
const NAMES: [&str; 2] = ["one", "two"];

/// Payloads of a tick by topic.
type Frames = BTreeMap<&'static str, Vec<u8>>;

/// Runs it and compares it with a run without workers.
///
/// # Panics
/// If a frame is missing or differs, or something is left.
pub fn run(seed: u64, n_steps: usize, story: &mut Vec<String>, tally: &mut Tally) {
    static ALONE: OnceLock<Vec<Frames>> = OnceLock::new();
    let wanted = ALONE.get_or_init(|| frames(false, |_, _, _| {}));
    let mut random = fastrand::Rng::with_seed(seed);
    let mut struck_at: Vec<u64> = (0..n_steps).map(|_| random.u64(2..N_TICKS)).collect();
    struck_at.sort_unstable();
    let found = frames(true, |tick, sandbox, workers| {
        for _ in struck_at.iter().filter(|at| **at == tick) {
            let idx = random.usize(0..workers.len());
            let signal = [
                Signal::SIGKILL,
                Signal::SIGSTOP,
                Signal::SIGTERM,
                Signal::SIGSEGV,
            ][random.usize(0..4)];
            let pause = Duration::from_micros(random.u64(0..30_000));
            story.push(format!(
                "tick {tick}: worker {} gets {signal} after {pause:?}",
                NAMES[idx]
            ));
            std::thread::sleep(pause);
            strike(sandbox, workers, idx, signal, random.u64(10..300));
            let fault = Fault {
                role: Role::Worker,
                blow: Blow::Signal(signal),
                moment: Moment::Any,
            };
            tally.add(fault, true);
        }
    });
    for (idx, (alone, shared)) in wanted.iter().zip(&found).enumerate() {
        for topic in TOPICS {
            assert!(
                alone[topic] == shared[topic],
                "{topic} at tick {} is not what the simulator alone makes",
                idx + 1
            );
        }
    }
}

fn worker(sandbox: &Sandbox, idx: usize) -> Process {
    let mut worker = spawn_consumer(sandbox, "gantry-render", &["--name", NAMES[idx]]);
    worker.wait_line("joined");
    worker
}

/// Strikes a worker, and starts it again if that is its end.
fn strike(
    sandbox: &Sandbox,
    workers: &mut [Process],
    idx: usize,
    signal: Signal,
    pause_millis: u64,
) {
    let process = &mut workers[idx];
    process.signal(signal);
    if signal == Signal::SIGSTOP {
        std::thread::sleep(Duration::from_millis(pause_millis));
        process.signal(Signal::SIGCONT);
        return;
    }
    eventually("the worker ends", || {
        // The first SIGSEGV from outside is taken for an overflow of the stack that was none.
        match process.is_running() {
            true if signal == Signal::SIGSEGV => process.signal(signal),
            true => {}
            false => return Some(()),
        }
        None
    });
    let ended = std::mem::replace(process, worker(sandbox, idx)).wait();
    let panicked = ended.lines.iter().find(|line| line.contains("panicked at"));
    assert!(panicked.is_none(), "a worker: {:#?}", ended.lines);
    if signal == Signal::SIGTERM {
        ended.expect_code(0);
    }
}

/// All frames of a run. `during` is told each tick when it has been asked for, before its frames are
/// looked at.
fn frames(has_workers: bool, mut during: impl FnMut(u64, &Sandbox, &mut [Process])) -> Vec<Frames> {
    let sandbox = Sandbox::new("laboratory-shared");
    let launch = RIG.replace("tick_hz = 20", "tick_hz = 20\nmode = \"stepped\"");
    let daemon = start_daemon(&sandbox, &launch, &[]);
    let mut workers: Vec<Process> = match has_workers {
        true => (0..NAMES.len()).map(|idx| worker(&sandbox, idx)).collect(),
        false => Vec::new(),
    };
    let bus = join_bus(&sandbox, "laboratory");
    let mut client = bus.command_client("laboratory").expect("a daemon");
    let mut readers = TOPICS.map(|topic| reader(&bus, topic));
    let mut ticks = Vec::new();
    for tick in 1..=N_TICKS {
        let stepped = ask(&mut client, Command::Step { n: 1 });
        assert_eq!(stepped, CommandReply::Stepping { last_tick: tick });
        during(tick, &sandbox, &mut workers);
        ticks.push(frames_of(&mut readers, tick));
    }
    assert_eq!(counter(&mut client, "sent_by_workers") > 0, has_workers);
    drop((readers, client, bus));
    for worker in workers {
        worker.stop().expect_code(0);
    }
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
    ticks
}

fn frames_of(readers: &mut [FrameReader], tick: u64) -> Frames {
    let mut frames = Frames::new();
    for (topic, reader) in TOPICS.into_iter().zip(readers) {
        let frame = eventually(&format!("{topic} at tick {tick}"), || {
            reader.next().unwrap_or_else(|error| panic!("{error}"))
        });
        assert_eq!(frame.header().tick, tick, "{topic} misses a tick");
        frames.insert(topic, frame.to_vec());
    }
    frames
}
