//! One running process: it is started in a process group of its own, ends if the launcher dies, is
//! signalled as a group, and is reaped last.

use std::process::ExitStatus;
use std::sync::mpsc::Sender;
use std::time::Instant;

use anyhow::Context as _;
use launch_run::Program;
use nix::errno::Errno;
use nix::sys::signal::{Signal, killpg};
use nix::sys::wait::{Id, WaitPidFlag, waitid};
use nix::unistd::Pid;

use super::output::{Sink, Stream};
use super::plan::{Plan, ReadySign};

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
    let surroundings = &plan.surroundings;
    let mut program = Program::new(&plan.name, &plan.program)
        .words(&plan.args)
        .words(further_args)
        .variables(&surroundings.env)
        .in_own_group();
    for variable in &surroundings.without {
        program = program.without_variable(variable);
    }
    if let Some(cwd) = &surroundings.cwd {
        program = program.in_folder(cwd);
    }
    sink.note(&format!(
        "--- start {start}: {} {}",
        plan.program.display(),
        [&plan.args, further_args].concat().join(" ")
    ));
    let mut child = program
        .tied_to_thread(&surroundings.cores, surroundings.nice)
        .spawn_piped()?;
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
