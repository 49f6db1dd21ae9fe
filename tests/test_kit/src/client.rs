//! The test itself as a client on the sandbox's bus: it reads topics and documents, and sends
//! commands.

use std::time::{Duration, Instant};

use schema_bus::{Bus, BusOptions, CommandClient, Document, FrameReader};
use schema_frames::{Command, CommandBatch, CommandReply};

use crate::patience::{PATIENCE, eventually};
use crate::sandbox::Sandbox;

/// Joins the sandbox's bus from this process.
pub fn join_bus(sandbox: &Sandbox, name: &str) -> Bus {
    let options = BusOptions {
        iceoryx_root: Some(sandbox.iceoryx_root()),
        prefix: Some(sandbox.prefix().to_owned()),
    };
    Bus::open_with(sandbox.domain(), name, &options).unwrap_or_else(|error| panic!("{error}"))
}

/// Waits until a topic has `n` readers.
pub fn wait_readers(bus: &Bus, topic: &str, n: usize) {
    eventually(&format!("{topic} has {n} readers"), || {
        bus.topics()
            .ok()?
            .iter()
            .find(|found| found.name == topic && found.subscribers >= n)
            .map(drop)
    });
}

/// Waits until a topic exists, and opens a reader.
pub fn reader(bus: &Bus, topic: &str) -> FrameReader {
    eventually(&format!("topic {topic} appears"), || {
        bus.frame_reader(topic).ok()
    })
}

/// Waits for a document, and returns its newest revision.
pub fn document(bus: &Bus, name: &str) -> Document {
    let mut reader = eventually(&format!("document {name} appears"), || {
        bus.document_reader(name).ok()
    });
    eventually(&format!("document {name} arrives"), || {
        reader.latest().unwrap_or_else(|error| panic!("{error}"))
    })
}

/// Sends one command and returns its answer.
pub fn ask(client: &mut CommandClient, command: Command) -> CommandReply {
    let answer = client
        .request(&CommandBatch::new(vec![command]), PATIENCE)
        .unwrap_or_else(|error| panic!("{error}"));
    answer
        .replies
        .into_iter()
        .next()
        .expect("one answer per command")
}

/// Value of one of the daemon's counters.
pub fn counter(client: &mut CommandClient, name: &str) -> u64 {
    match ask(client, Command::Counters) {
        CommandReply::Counters { counters } => *counters
            .get(name)
            .unwrap_or_else(|| panic!("no counter {name:?} in {counters:?}")),
        other => panic!("{other:?}"),
    }
}

/// Cues a tick without waiting for it, and returns its number.
pub fn cue(client: &mut CommandClient) -> u64 {
    cue_ticks(client, 1)
}

fn cue_ticks(client: &mut CommandClient, n: u64) -> u64 {
    match ask(client, Command::Step { n }) {
        CommandReply::Stepping { last_tick } => last_tick,
        other => panic!("{other:?}"),
    }
}

/// Joins the lockstep under this name, and returns the participant's number.
pub fn join_lockstep(client: &mut CommandClient, name: &str) -> u32 {
    let name = name.to_owned();
    match ask(client, Command::JoinLockstep { name }) {
        CommandReply::Joined { participant, .. } => participant,
        other => panic!("{other:?}"),
    }
}

/// Waits until so many render workers have a share.
pub fn wait_workers(client: &mut CommandClient, n: u64) {
    eventually(&format!("{n} workers"), || {
        (counter(client, "render_workers") == n).then_some(())
    });
}

/// Cues `n` ticks and waits until they are done.
pub fn step(client: &mut CommandClient, n: u64) -> u64 {
    let last_tick = cue_ticks(client, n);
    eventually(&format!("tick {last_tick} is done"), || {
        (counter(client, "ticks") >= last_tick).then_some(last_tick)
    })
}

/// How long what a killed process left of its bookkeeping may stay: of a process that was killed
/// while it joined the bus, or while it removed a service, files are removed once they are a few
/// seconds old.
const BOOKKEEPING: Duration = Duration::from_secs(30);

/// How the names of services' states in shared memory end.
const STATE: &str = ".dynamic";

/// Cleans up after killed processes as a program that joins the bus does, and asserts that nothing
/// of the sandbox is left in shared memory and in iceoryx2's folder.
///
/// # Panics
/// With the names of the files that are left.
pub fn assert_nothing_left(sandbox: &Sandbox) {
    let began = Instant::now();
    loop {
        let bus = join_bus(sandbox, "cleaner");
        bus.clean_dead_nodes();
        drop(bus);
        let is_state = |name: &String| name.ends_with(STATE);
        let (states, others): (Vec<_>, Vec<_>) =
            sandbox.leftovers().into_iter().partition(is_state);
        assert_eq!(others, Vec::<String>::new());
        let mut kept = sandbox.bookkeeping();
        kept.extend(states);
        if kept.is_empty() {
            return;
        }
        assert!(began.elapsed() < BOOKKEEPING, "iceoryx2 keeps {kept:#?}");
        std::thread::sleep(Duration::from_millis(250));
    }
}
