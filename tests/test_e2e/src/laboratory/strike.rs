//! Strikes a process at one of its system calls.
//!
//! The laboratory traces one thread of the process until it makes the call, and sends the signal while
//! that thread stands there, holds the thread back, or lets the call return EINTR in place of being
//! made. Where the kernel forbids tracing, a signal comes at a random time instead, and the fault is
//! not counted as one at its moment.

use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::libc;
use nix::sys::ptrace;
use nix::sys::signal::{Signal, kill};
use nix::sys::wait::{Id, WaitPidFlag, WaitStatus, waitid, waitpid};
use nix::unistd::Pid;
use test_kit::eventually;

use super::table::{ANY, Blow, Mark};

/// How long a thread may take to its call. A thread that makes no such call is struck then.
const LONGEST_WATCH: Duration = Duration::from_secs(3);

/// How long a call is held back.
const DELAY: Duration = Duration::from_millis(700);

/// Strikes when the thread of `mark` makes its call; returns whether it was at it. `pick` chooses
/// among the threads if any will do.
pub fn at_call(pid: u32, mark: Mark, passed: u32, pick: usize, blow: Blow) -> bool {
    let process = Pid::from_raw(pid as i32);
    let caught = thread_of(pid, mark.thread, pick).and_then(|thread| {
        let is_there = wait_for_call(thread, mark.calls, passed);
        let is_struck = match blow {
            Blow::Signal(signal) => {
                send(process, signal);
                is_there
            }
            Blow::Delay => is_there.inspect(|_| std::thread::sleep(DELAY)),
            Blow::Interrupt => is_there.map(|is_there| is_there && interrupt(thread).is_ok()),
        };
        let_go(process, thread);
        is_struck.ok()
    });
    if let (None, Blow::Signal(signal)) = (caught, blow) {
        std::thread::sleep(Duration::from_millis(u64::from(passed) % 50));
        send(process, signal);
    }
    caught.unwrap_or(false)
}

/// A thread of another process that stands still until this is dropped, by the thread that held it.
#[derive(Debug)]
pub struct HeldThread {
    process: Pid,
    thread: Pid,
}

/// Stops one thread of a process, whatever it does, and lets the others run; `None` where the
/// kernel forbids tracing.
///
/// # Panics
/// If the process has no thread of this name.
pub fn hold(pid: u32, name: &str) -> Option<HeldThread> {
    // A thread gives itself its name when it first runs.
    let thread = eventually(&format!("a thread {name:?} in {pid}"), || {
        thread_of(pid, name, 0)
    });
    ptrace::seize(thread, ptrace::Options::empty()).ok()?;
    let held = HeldThread {
        process: Pid::from_raw(pid as i32),
        thread,
    };
    ptrace::interrupt(thread).ok()?;
    let flags = WaitPidFlag::__WALL | WaitPidFlag::WNOHANG;
    let stopped = eventually(
        &format!("{name:?} in {pid} stands still"),
        || match waitpid(thread, Some(flags)) {
            Ok(WaitStatus::StillAlive) => None,
            stopped => Some(stopped),
        },
    );
    stopped.is_ok().then_some(held)
}

impl Drop for HeldThread {
    fn drop(&mut self) {
        let_go(self.process, self.thread);
    }
}

/// Lets a thread that stands at the entry of a call return from it with EINTR; the call is not made.
#[cfg(target_arch = "x86_64")]
fn interrupt(thread: Pid) -> Result<(), Errno> {
    let mut registers = ptrace::getregs(thread)?;
    if never_waits(thread, &registers) {
        return Err(Errno::EAGAIN);
    }
    // No call has this number.
    registers.orig_rax = u64::MAX;
    ptrace::setregs(thread, registers)?;
    ptrace::syscall(thread, None)?;
    let began = Instant::now();
    let flags = WaitPidFlag::__WALL | WaitPidFlag::WNOHANG;
    loop {
        match waitpid(thread, Some(flags))? {
            WaitStatus::StillAlive if began.elapsed() < LONGEST_WATCH => {
                std::thread::sleep(Duration::from_micros(50));
            }
            WaitStatus::PtraceSyscall(_) => break,
            _ => return Err(Errno::ESRCH),
        }
    }
    let mut registers = ptrace::getregs(thread)?;
    registers.rax = -i64::from(libc::EINTR) as u64;
    ptrace::setregs(thread, registers)
}

/// Whether the call at whose entry the thread stands goes to a file, pipe or socket that was told
/// not to wait: the kernel has nothing to interrupt there, and never returns EINTR.
#[cfg(target_arch = "x86_64")]
fn never_waits(thread: Pid, registers: &libc::user_regs_struct) -> bool {
    let flags = match registers.orig_rax as libc::c_long {
        libc::SYS_sendto | libc::SYS_recvfrom => registers.r10,
        libc::SYS_sendmsg | libc::SYS_recvmsg => registers.rdx,
        libc::SYS_read | libc::SYS_write | libc::SYS_writev | libc::SYS_accept4 => 0,
        _ => return false,
    };
    flags & libc::MSG_DONTWAIT as u64 != 0 || is_nonblocking(thread, registers.rdi)
}

/// By what `/proc` says of the descriptor; one that is gone blocks nobody.
#[cfg(target_arch = "x86_64")]
fn is_nonblocking(thread: Pid, descriptor: u64) -> bool {
    let Ok(about) = std::fs::read_to_string(format!("/proc/{thread}/fdinfo/{descriptor}")) else {
        return true;
    };
    let flags = about.lines().find_map(|line| line.strip_prefix("flags:"));
    let flags = flags.and_then(|octal| i32::from_str_radix(octal.trim(), 8).ok());
    flags.is_some_and(|flags| flags & libc::O_NONBLOCK != 0)
}

/// Elsewhere the registers have other names.
#[cfg(not(target_arch = "x86_64"))]
fn interrupt(_thread: Pid) -> Result<(), Errno> {
    Err(Errno::ENOSYS)
}

/// Ends the tracing of a thread, in whatever state it is. A thread that has ended while it was
/// traced stays a zombie, and its process with it, until its tracer has seen that.
fn let_go(process: Pid, thread: Pid) {
    let looked = WaitPidFlag::__WALL
        | WaitPidFlag::WNOHANG
        | WaitPidFlag::WEXITED
        | WaitPidFlag::WSTOPPED
        | WaitPidFlag::WNOWAIT;
    let began = Instant::now();
    while ptrace::detach(thread, None).is_err() && began.elapsed() < LONGEST_WATCH * 4 {
        match waitid(Id::Pid(thread), looked) {
            Err(_) => return,
            Ok(WaitStatus::Exited(..) | WaitStatus::Signaled(..)) => {
                // The end of the first thread is for who started the process.
                if thread != process {
                    let _ = waitpid(thread, Some(WaitPidFlag::__WALL));
                }
                return;
            }
            Ok(WaitStatus::StillAlive) => drop(ptrace::interrupt(thread)),
            Ok(_) => {}
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Sends a signal to a process that may have ended.
pub fn send(process: Pid, signal: Signal) {
    let _ = kill(process, signal);
}

fn thread_of(pid: u32, name: &str, pick: usize) -> Option<Pid> {
    if name.is_empty() {
        return Some(Pid::from_raw(pid as i32));
    }
    let tasks = std::fs::read_dir(format!("/proc/{pid}/task")).ok()?;
    let is_it = |path: &std::path::Path| {
        std::fs::read_to_string(path.join("comm"))
            .is_ok_and(|comm| name == ANY || comm.trim() == name)
    };
    let mut found: Vec<i32> = tasks
        .flatten()
        .filter(|task| is_it(&task.path()))
        .filter_map(|task| task.file_name().to_str()?.parse().ok())
        .collect();
    found.sort_unstable();
    let n = found.len().max(1);
    found.get(pick % n).copied().map(Pid::from_raw)
}

/// Leaves the thread traced and stopped, at the call if it returns true.
fn wait_for_call(thread: Pid, calls: &[libc::c_long], mut passed: u32) -> Result<bool, Errno> {
    ptrace::seize(thread, ptrace::Options::PTRACE_O_TRACESYSGOOD)?;
    ptrace::interrupt(thread)?;
    let began = Instant::now();
    let mut is_stopping = false;
    loop {
        let flags = WaitPidFlag::__WALL | WaitPidFlag::WNOHANG;
        let is_late = began.elapsed() > LONGEST_WATCH;
        // An end is only looked at: who started the process is to learn of it.
        let looked = flags | WaitPidFlag::WEXITED | WaitPidFlag::WSTOPPED | WaitPidFlag::WNOWAIT;
        match waitid(Id::Pid(thread), looked)? {
            WaitStatus::Exited(..) | WaitStatus::Signaled(..) => return Err(Errno::ESRCH),
            _ => {}
        }
        let pass_on = match waitpid(thread, Some(flags))? {
            WaitStatus::StillAlive => {
                if is_late && !is_stopping {
                    // A stopped thread can be let go; a running one cannot.
                    ptrace::interrupt(thread)?;
                    is_stopping = true;
                } else if began.elapsed() > LONGEST_WATCH * 2 {
                    return Ok(false);
                }
                std::thread::sleep(Duration::from_micros(50));
                continue;
            }
            WaitStatus::PtraceSyscall(_) => {
                if is_wanted(thread, calls) {
                    if passed == 0 {
                        return Ok(true);
                    }
                    passed -= 1;
                }
                None
            }
            WaitStatus::Stopped(_, signal) => Some(signal),
            WaitStatus::PtraceEvent(..) => None,
            _ => return Err(Errno::ESRCH),
        };
        if is_late {
            return Ok(false);
        }
        // The stop of PTRACE_INTERRUPT reads as SIGTRAP, which must not be passed on.
        let pass_on = pass_on.filter(|signal| *signal != Signal::SIGTRAP);
        ptrace::syscall(thread, pass_on)?;
    }
}

/// Whether a thread that is stopped at a system call is about to make one of `calls`.
fn is_wanted(thread: Pid, calls: &[libc::c_long]) -> bool {
    let Ok(text) = std::fs::read_to_string(format!("/proc/{thread}/syscall")) else {
        return false;
    };
    let number = text.split(' ').next().and_then(|word| word.parse().ok());
    number.is_some_and(|number: libc::c_long| {
        is_entry(thread)
            && (calls.is_empty() || calls.contains(&number))
            && (calls.is_empty() || number != libc::SYS_futex || waits(&text))
    })
}

/// Whether a futex call waits; those that wake others never fail.
fn waits(text: &str) -> bool {
    let operation = text.split(' ').nth(2).and_then(|word| {
        let digits = word.trim_start_matches("0x");
        i32::from_str_radix(digits, 16).ok()
    });
    let of = |operation: i32| operation & !(libc::FUTEX_PRIVATE_FLAG | libc::FUTEX_CLOCK_REALTIME);
    operation.is_some_and(|it| [libc::FUTEX_WAIT, libc::FUTEX_WAIT_BITSET].contains(&of(it)))
}

/// On x86-64 the kernel keeps -ENOSYS as the result until the call has been made. Elsewhere the
/// stop after a call counts as well.
#[cfg(target_arch = "x86_64")]
fn is_entry(thread: Pid) -> bool {
    ptrace::getregs(thread).is_ok_and(|registers| registers.rax as i64 == -i64::from(libc::ENOSYS))
}

#[cfg(not(target_arch = "x86_64"))]
fn is_entry(_thread: Pid) -> bool {
    true
}
