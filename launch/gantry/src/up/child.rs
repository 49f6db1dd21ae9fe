//! One running process: it is started in a process group of its own, ends if the launcher dies, is
//! signalled as a group, and is reaped last.

#![expect(
    unsafe_code,
    reason = "work between fork and exec; each block proves itself"
)]

use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::mpsc::Sender;
use std::time::Instant;

use anyhow::Context as _;
use nix::errno::Errno;
use nix::sys::signal::{Signal, killpg};
use nix::sys::wait::{Id, WaitPidFlag, waitid};
use nix::unistd::Pid;

use super::output::{Sink, Stream};
use super::plan::{Plan, ReadySign};
use super::surroundings::Surroundings;

/// What the threads around a process report. `start` is the number of the start within the slot, so
/// that a late report about an earlier start can be recognised.
#[derive(Debug)]
pub enum Event {
    /// The process ended; it has not been reaped.
    Ended { idx: usize, start: u64 },
    /// A line of its output is the sign that it is ready.
    SaidReady { idx: usize, start: u64 },
    /// One of its two pipes closed.
    PipeClosed,
    /// The launcher was asked to end.
    Signal,
}

/// A process that has been started and not been reaped.
#[derive(Debug)]
pub struct Running {
    child: std::process::Child,
    group: Pid,
    pub since: Instant,
    pub start: u64,
}

/// Starts a process. Call it from the main thread only: the kernel ties the child's life to the
/// *thread* that made it.
pub fn start(
    idx: usize,
    start: u64,
    plan: &Plan,
    further_args: &[String],
    sink: &Sink,
    events: &Sender<Event>,
) -> anyhow::Result<Running> {
    let mut command = Command::new(&plan.program);
    command
        .args(&plan.args)
        .args(further_args)
        .envs(&plan.surroundings.env)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .process_group(0);
    for variable in &plan.surroundings.without {
        command.env_remove(variable);
    }
    if let Some(cwd) = &plan.surroundings.cwd {
        command.current_dir(cwd);
    }
    prepare(&mut command, &plan.surroundings);
    sink.note(&format!(
        "--- start {start}: {} {}",
        plan.program.display(),
        [&plan.args, further_args].concat().join(" ")
    ));
    let mut child = command.spawn().with_context(|| {
        let program = plan.program.display();
        match &plan.surroundings.cores[..] {
            [] => format!("cannot start {program}"),
            cores => format!("cannot start {program} on cores {cores:?}"),
        }
    })?;
    let group = Pid::from_raw(child.id().cast_signed());
    let line = match &plan.ready {
        Some(ReadySign::Line(pattern)) => Some(pattern.clone()),
        _ => None,
    };
    let out = child.stdout.take().expect("stdout is piped");
    let err = child.stderr.take().expect("stderr is piped");
    let copy = |pipe: Box<dyn std::io::Read + Send>, stream| {
        let (sink, events, line) = (sink.clone(), events.clone(), line.clone());
        std::thread::spawn(move || {
            let mut said = false;
            sink.pump(pipe, stream, |text| {
                if !said && line.as_ref().is_some_and(|pattern| pattern.is_match(text)) {
                    said = true;
                    // Nobody receives any more once the supervisor has ended; the report is lost
                    // then, which is fine.
                    let _ = events.send(Event::SaidReady { idx, start });
                }
            });
            let _ = events.send(Event::PipeClosed);
        });
    };
    copy(Box::new(out), Stream::Stdout);
    copy(Box::new(err), Stream::Stderr);
    let events = events.clone();
    std::thread::spawn(move || {
        // NOWAIT leaves the process unreaped. Its id and its group cannot be reused before the
        // rest of the group has been signalled.
        while waitid(Id::Pid(group), WaitPidFlag::WEXITED | WaitPidFlag::WNOWAIT)
            == Err(Errno::EINTR)
        {}
        let _ = events.send(Event::Ended { idx, start });
    });
    Ok(Running {
        child,
        group,
        since: Instant::now(),
        start,
    })
}

/// If the launcher is killed, its children get SIGTERM. Pins them to their cores, and sets their
/// priority.
fn prepare(command: &mut Command, surroundings: &Surroundings) {
    let parent = nix::unistd::getpid();
    let mask = core_mask(&surroundings.cores);
    let nice = surroundings.nice;
    let prepare = move || {
        nix::sys::prctl::set_pdeathsig(Signal::SIGTERM)?;
        if nix::unistd::getppid() != parent {
            // Without this check, a launcher that dies between fork and prctl would leave the
            // child running.
            return Err(Errno::ESRCH.into());
        }
        if let Some(nice) = nice {
            // SAFETY: the call takes three numbers; 0 means the calling process.
            let failed = unsafe { libc::setpriority(libc::PRIO_PROCESS, 0, nice) } != 0;
            if failed {
                return Err(std::io::Error::last_os_error());
            }
        }
        match mask {
            // SAFETY: the set is a live value of the size given; 0 means the calling process.
            Some(mask)
                if unsafe { libc::sched_setaffinity(0, size_of::<libc::cpu_set_t>(), &mask) }
                    != 0 =>
            {
                Err(std::io::Error::last_os_error())
            }
            _ => Ok(()),
        }
    };
    // SAFETY: `prepare` runs in the child between fork and exec. It makes only the system calls
    // prctl, getppid, setpriority and sched_setaffinity, which are async-signal-safe; it allocates
    // nothing and takes no lock.
    unsafe { command.pre_exec(prepare) };
}

fn core_mask(cores: &[u32]) -> Option<libc::cpu_set_t> {
    if cores.is_empty() {
        return None;
    }
    // SAFETY: a CPU set is an array of integers; all zero is the empty set.
    let mut mask: libc::cpu_set_t = unsafe { std::mem::zeroed() };
    for core in cores
        .iter()
        .map(|core| *core as usize)
        .filter(|core| *core < libc::CPU_SETSIZE as usize)
    {
        // SAFETY: the index was checked against the size of the set.
        unsafe { libc::CPU_SET(core, &mut mask) };
    }
    Some(mask)
}

impl Running {
    /// Process id.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Signals the whole group. It is no error if the group has ended.
    pub fn signal(&self, signal: Signal) {
        let _ = killpg(self.group, signal);
    }

    /// Kills what is left of the group and reaps the process. Call after [`Event::Ended`].
    pub fn reap(mut self) -> anyhow::Result<ExitStatus> {
        self.signal(Signal::SIGKILL);
        self.child
            .wait()
            .context("cannot learn how a process ended")
    }
}

/// A status in words: `exit code 3`, `signal SIGKILL`.
pub fn describe(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("exit code {code}"),
        (_, Some(number)) => Signal::try_from(number).map_or_else(
            |_| format!("signal {number}"),
            |signal| format!("signal {signal}"),
        ),
        _ => status.to_string(),
    }
}
