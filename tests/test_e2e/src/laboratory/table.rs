//! What can happen: the processes, what they are struck with, and the moments at which each process
//! has it.

use std::collections::BTreeMap;

use nix::libc;
use nix::sys::signal::Signal;

/// A process of the laboratory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// `simd`.
    Daemon,
    /// `gantry-carla`.
    Gateway,
    /// `gantry-drive`.
    Driver,
    /// `gantry-view --save`.
    Viewer,
    /// `gantry-record`.
    Recorder,
    /// `gantry topic hz`.
    Reader,
    /// A user's program with the package `gantry`.
    Node,
    /// A program in lockstep, for which the world waits.
    Participant,
    /// `gantry-render`, which makes the images of a share of the cameras.
    Worker,
    /// `gantry-bridge` beside the simulator.
    Bridge,
    /// The same on a domain of its own, as on another machine.
    FarBridge,
    /// `gantry topic hz` there.
    FarReader,
    /// CARLA's own client with a car and sensors; a guest that comes for one fault.
    Client,
    /// A program that publishes results and dies with two loans in hand; a guest.
    Publisher,
    /// `gantry-replay` of a short recording, on a domain of its own; a guest.
    Replay,
}

/// Where in its life a process is struck.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Moment {
    /// While it starts, at any of its first system calls.
    Start,
    /// At any time.
    Any,
    /// While frames are on loan and the GPU works on them: the daemon waits for its fence. Of a
    /// publisher, between its loans and its send.
    Loan,
    /// When a sample is sent and its readers are about to be woken.
    Wake,
    /// While another map is loaded.
    MapLoad,
    /// When the recorder writes or syncs its file.
    Flush,
    /// While the world waits for a participant that does not answer.
    LockstepWait,
    /// After SIGTERM, before the end.
    Shutdown,
    /// While any of its threads makes a system call that waits, reads or writes.
    Call,
}

/// What a process is struck with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Blow {
    /// A signal.
    Signal(Signal),
    /// A system call that is not made and returns EINTR, as after a signal that has a handler.
    Interrupt,
    /// A system call that takes long, as on a slow disk or behind a busy peer.
    Delay,
}

impl std::fmt::Display for Blow {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Blow::Signal(signal) => signal.fmt(f),
            Blow::Interrupt => f.write_str("EINTR"),
            Blow::Delay => f.write_str("delay"),
        }
    }
}

/// System calls of a thread that mark a moment.
#[derive(Clone, Copy, Debug)]
pub struct Mark {
    /// Name of the thread; empty for the first one, `*` for any.
    pub thread: &'static str,
    /// Numbers of the calls; any call if empty.
    pub calls: &'static [libc::c_long],
    /// The first up to this many such calls are let pass.
    pub max_passed: u32,
}

const FIRST: &str = "";
/// Stands for any thread.
pub const ANY: &str = "*";

/// Calls that may be interrupted or take long.
const SLOW_CALLS: [libc::c_long; 15] = [
    libc::SYS_read,
    libc::SYS_write,
    libc::SYS_writev,
    libc::SYS_pwrite64,
    libc::SYS_fsync,
    libc::SYS_fdatasync,
    libc::SYS_futex,
    libc::SYS_ppoll,
    libc::SYS_epoll_pwait,
    libc::SYS_recvfrom,
    libc::SYS_recvmsg,
    libc::SYS_sendto,
    libc::SYS_sendmsg,
    libc::SYS_accept4,
    libc::SYS_clock_nanosleep,
];

impl Moment {
    /// The calls that mark the moment; `None` where a time after an event is all that there is.
    pub fn mark(self, role: Role) -> Option<Mark> {
        let mark = |thread, calls, max_passed| Mark {
            thread,
            calls,
            max_passed,
        };
        match (self, role) {
            (Moment::Start, _) => Some(mark(FIRST, &[], 3000)),
            (Moment::Loan, Role::Daemon | Role::Worker) => {
                Some(mark(FIRST, &[libc::SYS_futex], 20))
            }
            (Moment::Wake, _) => Some(mark(FIRST, &[libc::SYS_sendto], 20)),
            (Moment::Flush, _) => Some(mark(
                "writer",
                &[libc::SYS_write, libc::SYS_writev, libc::SYS_pwrite64],
                3,
            )),
            (Moment::Shutdown, _) => Some(mark(FIRST, &[], 200)),
            (Moment::Call, _) => Some(mark(ANY, &SLOW_CALLS, 40)),
            (Moment::LockstepWait, Role::Daemon) => Some(mark(FIRST, &[libc::SYS_ppoll], 3)),
            _ => None,
        }
    }
}

/// The signals that a process is struck with.
pub const SIGNALS: [Signal; 4] = [
    Signal::SIGKILL,
    Signal::SIGSTOP,
    Signal::SIGTERM,
    Signal::SIGSEGV,
];

/// One row: a process, how often it is chosen beside the others, and its moments.
pub type Row = (Role, u32, &'static [Moment]);

/// Who is struck, and when.
pub const TABLE: [Row; 14] = [
    (
        Role::Daemon,
        5,
        &[
            Moment::Start,
            Moment::Any,
            Moment::Loan,
            Moment::Loan,
            Moment::Wake,
            Moment::MapLoad,
            Moment::LockstepWait,
            Moment::Shutdown,
            Moment::Call,
        ],
    ),
    (
        Role::Gateway,
        3,
        &[
            Moment::Start,
            Moment::Any,
            Moment::MapLoad,
            Moment::Shutdown,
            Moment::Call,
        ],
    ),
    (
        Role::Driver,
        3,
        &[
            Moment::Start,
            Moment::Any,
            Moment::Wake,
            Moment::Shutdown,
            Moment::Call,
        ],
    ),
    (
        Role::Viewer,
        3,
        &[Moment::Start, Moment::Any, Moment::Shutdown, Moment::Call],
    ),
    (
        Role::Recorder,
        5,
        &[
            Moment::Start,
            Moment::Any,
            Moment::Flush,
            Moment::Shutdown,
            Moment::Call,
        ],
    ),
    (
        Role::Reader,
        2,
        &[Moment::Start, Moment::Any, Moment::Shutdown, Moment::Call],
    ),
    (Role::Node, 3, &[Moment::Start, Moment::Any, Moment::Call]),
    (
        Role::Participant,
        3,
        &[
            Moment::Start,
            Moment::Any,
            Moment::LockstepWait,
            Moment::Call,
        ],
    ),
    (
        Role::Worker,
        4,
        &[
            Moment::Start,
            Moment::Any,
            Moment::Loan,
            Moment::MapLoad,
            Moment::Shutdown,
            Moment::Call,
        ],
    ),
    (
        Role::Bridge,
        3,
        &[
            Moment::Start,
            Moment::Any,
            Moment::MapLoad,
            Moment::Shutdown,
            Moment::Call,
        ],
    ),
    (
        Role::FarBridge,
        3,
        &[
            Moment::Start,
            Moment::Any,
            Moment::MapLoad,
            Moment::Shutdown,
            Moment::Call,
        ],
    ),
    (Role::Client, 2, &[Moment::Any, Moment::MapLoad]),
    (Role::Publisher, 2, &[Moment::Loan]),
    (
        Role::Replay,
        2,
        &[Moment::Start, Moment::Any, Moment::Wake, Moment::Shutdown],
    ),
];

/// One fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Fault {
    /// Who is struck.
    pub role: Role,
    /// With what.
    pub blow: Blow,
    /// When.
    pub moment: Moment,
}

impl Fault {
    /// Draws a fault.
    pub fn draw(random: &mut fastrand::Rng) -> Fault {
        let total: u32 = TABLE.iter().map(|(_, weight, _)| weight).sum();
        let mut at = random.u32(0..total);
        let row = TABLE.iter().find(|(_, weight, _)| {
            let is_it = at < *weight;
            at = at.saturating_sub(*weight);
            is_it
        });
        let (role, _, moments) = row.expect("the number is below the sum");
        let moment = moments[random.usize(0..moments.len())];
        let blow = match moment {
            Moment::Call if random.u32(0..3) == 0 => Blow::Delay,
            Moment::Call => Blow::Interrupt,
            _ => Blow::Signal(SIGNALS[random.usize(0..SIGNALS.len())]),
        };
        Fault {
            role: *role,
            moment,
            blow,
        }
    }
}

/// What episodes have done.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    /// Episodes that ended.
    pub n_episodes: u64,
    faults: BTreeMap<Fault, Count>,
}

/// How often something happened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Count {
    /// Faults.
    pub n_faults: u64,
    /// Those at the very system call that was waited for.
    pub n_at_their_moment: u64,
}

impl Tally {
    /// Counts a fault.
    pub fn add(&mut self, fault: Fault, is_at_moment: bool) {
        let count = self.faults.entry(fault).or_default();
        count.n_faults += 1;
        count.n_at_their_moment += u64::from(is_at_moment);
    }

    /// Counts what another tally has.
    pub fn add_all(&mut self, other: &Tally) {
        self.n_episodes += other.n_episodes;
        for (fault, count) in &other.faults {
            let ours = self.faults.entry(*fault).or_default();
            ours.n_faults += count.n_faults;
            ours.n_at_their_moment += count.n_at_their_moment;
        }
    }

    /// Every fault that happened, and how often.
    pub fn faults(&self) -> impl Iterator<Item = (&Fault, &Count)> {
        self.faults.iter()
    }

    /// All faults together.
    pub fn total(&self) -> Count {
        let mut total = Count::default();
        for count in self.faults.values() {
            total.n_faults += count.n_faults;
            total.n_at_their_moment += count.n_at_their_moment;
        }
        total
    }
}
