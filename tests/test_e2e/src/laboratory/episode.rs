//! An episode: the company begins, is struck several times, and ends. After every fault all who were
//! not struck are alive and get on, and keep no more than before; after the end nothing is left.

use std::collections::BTreeMap;
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Duration;

use nix::sys::signal::Signal;
use nix::unistd::Pid;
use test_kit::client::assert_nothing_left;
use test_kit::{Ended, Process, Sandbox, eventually};

use super::cast::{COMPANY, Cast, RIG};
use super::strike;
use super::table::{Blow, Fault, Moment, Role, Tally};
use crate::kept::Kept;
use crate::recording::sequences;

/// Descriptors and threads that come and go with a look round the bus or a cleaning.
const FEW: usize = 6;
/// Threads that the viewer's library keeps of its layouts, two of each; the viewer makes at most 256
/// layouts, and far fewer in an episode.
const OF_LAYOUTS: usize = 64;
/// Memory that a survivor may take in an episode: caches fill and allocators keep what was freed.
const MAX_GROWTH_KIB: u64 = 96 << 10;
/// A recording of this size holds its map and some frames, and so must be recoverable.
const WORTH_RECOVERING_BYTES: u64 = 3_000_000;

const TERM: Blow = Blow::Signal(Signal::SIGTERM);
const STOP: Blow = Blow::Signal(Signal::SIGSTOP);

/// Runs it.
///
/// # Panics
/// With what did not hold.
pub fn run(seed: u64, n_steps: usize, story: &mut Vec<String>, tally: &mut Tally) {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut episode = Episode {
        cast: Cast::new("laboratory"),
        kept: BTreeMap::new(),
    };
    std::fs::write(episode.cast.sandbox.path("replay.mcap"), replay_file())
        .expect("the sandbox can be written");
    for role in COMPANY {
        episode.cast.begin(role);
    }
    for _ in 0..n_steps {
        let fault = Fault::draw(&mut random);
        story.push(format!("{fault:?}"));
        let is_at_moment = episode.suffer(fault, &mut random);
        tally.add(fault, is_at_moment);
        episode.all_get_on();
    }
    story.push("the end".into());
    episode.end(&mut random);
}

struct Episode {
    cast: Cast,
    /// What each kept when it was last begun.
    kept: BTreeMap<Role, Kept>,
}

impl Episode {
    /// Lets a fault happen and brings back who died of it. Returns whether it was exactly at its
    /// moment.
    fn suffer(&mut self, fault: Fault, random: &mut fastrand::Rng) -> bool {
        let Fault { role, moment, .. } = fault;
        if !COMPANY.contains(&role) {
            let is_at_moment = self.guest(fault, random);
            if role == Role::Client {
                // As with CARLA, what a killed client made stays. Another map ends it, and with it the
                // comparison of what the daemon keeps; the first client makes the gateway open ports.
                self.cast.load_map();
                self.kept.remove(&Role::Daemon);
                self.kept.remove(&Role::Worker);
                self.kept.remove(&Role::Gateway);
            }
            return is_at_moment;
        }
        if moment == Moment::Start {
            let old = self.cast.take(role);
            let ended = old.stop();
            fair_end(role, TERM, moment, &ended);
            let fresh = self.cast.spawn(role);
            self.cast.put(role, fresh);
        }
        if moment == Moment::MapLoad {
            self.cast.load_map();
            self.kept.remove(&Role::Daemon);
            // It has the scenery, too.
            self.kept.remove(&Role::Worker);
        }
        if moment == Moment::LockstepWait {
            self.cast.signal(Role::Participant, Signal::SIGSTOP);
            self.cast.world_waits();
        }
        let process = self.cast.take(role);
        if moment == Moment::Shutdown {
            process.signal(Signal::SIGTERM);
        }
        let is_at_moment = hit(&process, fault, random);
        let mut is_gone = moment != Moment::Call;
        if fault.blow == STOP {
            std::thread::sleep(Duration::from_millis(random.u64(10..300)));
            process.signal(Signal::SIGCONT);
            is_gone = moment == Moment::Shutdown;
        } else if moment == Moment::LockstepWait && role == Role::Participant {
            process.signal(Signal::SIGCONT);
        }
        if is_gone {
            let ended = end_of(process, fault.blow);
            fair_end(role, fault.blow, moment, &ended);
        } else {
            self.cast.put(role, process);
        }
        if moment == Moment::LockstepWait && role != Role::Participant {
            self.cast.signal(Role::Participant, Signal::SIGCONT);
        }
        if is_gone || moment == Moment::Start {
            self.bring_back(role, is_gone);
        }
        is_at_moment
    }

    /// Begins a process anew, and with the simulator the participant, which belongs to its run.
    fn bring_back(&mut self, role: Role, is_gone: bool) {
        self.kept.remove(&role);
        if is_gone {
            if role == Role::Recorder {
                recover(&self.cast.sandbox);
            }
            self.cast.begin(role);
        }
        if role == Role::Daemon {
            drop(self.cast.take(Role::Participant).kill9());
            // All others find the new run by themselves, and keep other things of it.
            self.kept.clear();
            if !is_gone {
                self.cast.gets_on(Role::Daemon);
            }
            self.cast.begin(Role::Participant);
        }
    }

    /// A process that comes for one fault.
    fn guest(&mut self, fault: Fault, random: &mut fastrand::Rng) -> bool {
        let mut process = self.cast.spawn(fault.role);
        match (fault.role, fault.moment) {
            (Role::Publisher, _) => {
                let ended = process.wait();
                assert_eq!(ended.status.signal(), Some(Signal::SIGKILL as i32));
                return true;
            }
            (Role::Client, Moment::Any) => {
                let is_over = eventually("the client sees its sensors, or gives up", || {
                    let sees = process.lines().iter().any(|line| line == "seen");
                    (sees || !process.is_running()).then_some(!sees)
                });
                if is_over {
                    return gave_up(process);
                }
            }
            (Role::Replay, Moment::Any | Moment::Wake | Moment::Shutdown) => {
                drop(process.wait_line("ready"));
            }
            _ => {}
        }
        if fault.moment == Moment::Shutdown {
            process.signal(Signal::SIGTERM);
        }
        let is_at_moment = hit(&process, fault, random);
        if fault.blow == STOP {
            std::thread::sleep(Duration::from_millis(random.u64(10..300)));
            process.signal(Signal::SIGCONT);
            if fault.moment != Moment::Shutdown {
                process.kill9();
                return is_at_moment;
            }
        }
        fair_end(
            fault.role,
            fault.blow,
            fault.moment,
            &end_of(process, fault.blow),
        );
        is_at_moment
    }

    fn all_get_on(&mut self) {
        // All at once: most of the time of a step is spent here.
        let marks = COMPANY.map(|role| (role, self.cast.mark(role)));
        for (role, mark) in marks {
            self.cast.got_on_since(role, mark);
        }
        for (role, process) in self.cast.processes() {
            let Some(before) = self.kept.get(&role) else {
                let kept = Kept::of(process.pid()).expect("it was alive just now");
                self.kept.insert(role, kept);
                continue;
            };
            let pid = process.pid();
            let mut last = *before;
            let of_layouts = if role == Role::Viewer { OF_LAYOUTS } else { 0 };
            // Longer than ports of topics without a writer are kept.
            let is_back = (0..1200).any(|_| {
                last = Kept::of(pid).expect("it was alive just now");
                let is_small = last.descriptors <= before.descriptors + FEW
                    && last.threads <= before.threads + FEW + of_layouts
                    && last.own_kib <= before.own_kib + MAX_GROWTH_KIB;
                if !is_small {
                    std::thread::sleep(Duration::from_millis(25));
                }
                is_small
            });
            assert!(is_back, "{role:?} grew from {before:?} to {last:?}");
        }
    }

    /// All end, in any order, and leave nothing.
    fn end(mut self, random: &mut fastrand::Rng) {
        let mut order = COMPANY;
        random.shuffle(&mut order);
        for role in order {
            let ended = self.cast.take(role).stop();
            fair_end(role, TERM, Moment::Any, &ended);
        }
        self.cast.leave();
        let sandbox = &self.cast.sandbox;
        assert_nothing_left(sandbox);
        let left = files_below(&sandbox.path("tmp"));
        assert!(left.is_empty(), "tmp keeps {left:?}");
        let whole = std::fs::read_dir(sandbox.dir()).expect("the sandbox is there");
        for entry in whole.flatten() {
            if entry.file_name().to_string_lossy().ends_with(".mcap") {
                sequences(&entry.path());
            }
        }
    }
}

/// Strikes a process; returns whether it was exactly at its moment.
fn hit(process: &Process, fault: Fault, random: &mut fastrand::Rng) -> bool {
    let pid = process.pid();
    if let Some(mark) = fault.moment.mark(fault.role) {
        let passed = random.u32(0..=mark.max_passed);
        let pick = random.usize(0..1024);
        return strike::at_call(pid, mark, passed, pick, fault.blow);
    }
    let longest_millis = match fault.moment {
        Moment::MapLoad => 2000,
        Moment::Start => 1500,
        _ => 150,
    };
    std::thread::sleep(Duration::from_millis(random.u64(0..longest_millis)));
    if let Blow::Signal(signal) = fault.blow {
        strike::send(Pid::from_raw(pid as i32), signal);
    }
    fault.moment == Moment::Any
}

/// Asserts that a client ended because it was not answered in its time: on a machine that is busy
/// with other things a camera may take a minute. Returns that it was not struck at its moment.
fn gave_up(process: Process) -> bool {
    let ended = process.wait();
    assert!(
        ended.says("did not answer within"),
        "the client ended by itself ({}):\n{}",
        ended.status,
        ended.lines.join("\n")
    );
    false
}

/// Waits for the end. A first SIGSEGV from outside is taken for an overflow of the stack that was
/// none, and only a second one ends a program of Rust.
fn end_of(mut process: Process, blow: Blow) -> Ended {
    if blow == Blow::Signal(Signal::SIGSEGV) {
        eventually("it ends on SIGSEGV", || {
            if process.is_running() {
                process.signal(Signal::SIGSEGV);
                return None;
            }
            Some(())
        });
    }
    process.wait()
}

/// Asserts that a process ended as its signal says, or by itself and in order.
fn fair_end(role: Role, blow: Blow, moment: Moment, ended: &Ended) {
    let panicked = ended.lines.iter().find(|line| line.contains("panicked at"));
    assert!(panicked.is_none(), "{role:?}: {:#?}", ended.lines);
    let (code, by) = (ended.status.code(), ended.status.signal());
    // It may have ended in order just before the signal came.
    let in_order = match (role, code) {
        // A recorder on a busy machine may lose frames and say so.
        (Role::Recorder, Some(3)) => true,
        // The second SIGTERM ends a program at once.
        (_, Some(1)) => moment == Moment::Shutdown && blow == TERM,
        (_, code) => code == Some(0),
    };
    let has_handler = !matches!(role, Role::Node | Role::Participant | Role::Client);
    let is_blow = matches!(blow, Blow::Signal(signal) if by == Some(signal as i32));
    let by_signal = is_blow && (blow != TERM || !has_handler || moment == Moment::Start);
    assert!(
        in_order || by_signal,
        "{role:?} ended with code {code:?}, signal {by:?} on {blow} at {moment:?}:\n{}",
        ended.lines.join("\n")
    );
}

/// Recovers what a recorder left behind unfinished.
fn recover(sandbox: &Sandbox) {
    let entries = std::fs::read_dir(sandbox.dir()).expect("the sandbox is there");
    let parts = entries.flatten().map(|entry| entry.path());
    for part in parts.filter(|path| path.extension().is_some_and(|end| end == "part")) {
        let n_bytes = std::fs::metadata(&part).map_or(0, |file| file.len());
        let name = part.file_name().expect("a file").to_string_lossy();
        let rescued = format!("{name}.rescued.mcap");
        let ended = sandbox
            .spawn("gantry-record", &["recover", &name, &rescued])
            .wait();
        let lines = ended.lines.join("\n");
        assert!(!lines.contains("panicked at"), "recover {name}: {lines}");
        if ended.status.success() {
            sequences(&sandbox.path(&rescued));
        } else {
            assert!(
                n_bytes < WORTH_RECOVERING_BYTES,
                "{name} of {n_bytes} bytes cannot be recovered: {lines}"
            );
        }
        std::fs::remove_file(&part).expect("own files can be removed");
    }
}

fn files_below(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return Vec::new();
    };
    let mut found = Vec::new();
    for entry in entries.flatten().map(|entry| entry.path()) {
        if entry.is_dir() {
            found.extend(files_below(&entry));
        } else {
            found.push(entry);
        }
    }
    found
}

/// Two seconds of the rig, recorded once for all episodes.
fn replay_file() -> &'static [u8] {
    static FILE: OnceLock<Vec<u8>> = OnceLock::new();
    FILE.get_or_init(|| {
        let sandbox = Sandbox::new("laboratory-tape");
        let args = ["--unpaced", "--ticks", "40", "--await-participant", "rec"];
        let mut daemon = crate::spawn_daemon(&sandbox, RIG, &args);
        daemon.wait_line("ready");
        let args = ["--out", "replay.mcap", "--lockstep=rec"];
        let recorder = crate::spawn_consumer(&sandbox, "gantry-record", &args);
        daemon.wait().expect_code(0);
        recorder.stop().expect_code(0);
        std::fs::read(sandbox.path("replay.mcap")).expect("the recorder wrote it")
    })
}
