//! How a process ended, and whether it ended as it was asked to.

use std::os::unix::process::ExitStatusExt as _;
use std::process::ExitStatus;
use std::time::Instant;

use launch_spec::StopSignal;
use nix::sys::signal::Signal;

/// The signals with which a process was asked to end, and when the next, harder one is due.
#[derive(Clone, Copy)]
pub struct Asked {
    pub first: Signal,
    pub last: Signal,
    pub until: Instant,
}

/// How a process ended for good; the worst comes last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Outcome {
    Fine,
    DataLost,
    Failed,
}

pub fn signal_of(signal: StopSignal) -> Signal {
    match signal {
        StopSignal::Int => Signal::SIGINT,
        StopSignal::Term => Signal::SIGTERM,
        StopSignal::Hup => Signal::SIGHUP,
        StopSignal::Quit => Signal::SIGQUIT,
        StopSignal::Kill => Signal::SIGKILL,
    }
}

/// The exit code as a shell reports it: the process's own, or 128 + the signal.
pub fn code_of(status: ExitStatus) -> u8 {
    let code = status
        .code()
        .unwrap_or_else(|| 128 + status.signal().unwrap_or(0));
    u8::try_from(code).unwrap_or(1)
}

/// A process that ends by a signal it was sent has done as asked. KILL counts only if the launch
/// file asks for it.
pub fn outcome_of(status: ExitStatus, asked: Option<Asked>) -> Outcome {
    let obeyed = asked.is_some_and(|asked| {
        let polite = [
            Signal::SIGINT,
            Signal::SIGTERM,
            Signal::SIGHUP,
            Signal::SIGQUIT,
            asked.first,
        ];
        polite
            .iter()
            .any(|signal| code_of(status) == 128 + *signal as u8)
    });
    match status.code() {
        Some(0) => Outcome::Fine,
        _ if obeyed => Outcome::Fine,
        Some(3) => Outcome::DataLost,
        _ => Outcome::Failed,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(first: Signal) -> Option<Asked> {
        Some(Asked {
            first,
            last: first,
            until: Instant::now(),
        })
    }

    #[test]
    fn obeying_a_signal_is_fine_and_dying_of_another_is_not() {
        let code = |code: i32| ExitStatus::from_raw(code << 8);
        let by = |signal: Signal| ExitStatus::from_raw(signal as i32);
        assert_eq!(outcome_of(code(0), None), Outcome::Fine);
        assert_eq!(
            outcome_of(code(3), asked(Signal::SIGINT)),
            Outcome::DataLost
        );
        assert_eq!(outcome_of(code(1), asked(Signal::SIGINT)), Outcome::Failed);
        assert_eq!(
            outcome_of(by(Signal::SIGINT), asked(Signal::SIGINT)),
            Outcome::Fine
        );
        assert_eq!(outcome_of(code(130), asked(Signal::SIGTERM)), Outcome::Fine);
        assert_eq!(outcome_of(by(Signal::SIGINT), None), Outcome::Failed);
        assert_eq!(
            outcome_of(by(Signal::SIGKILL), asked(Signal::SIGINT)),
            Outcome::Failed
        );
        assert_eq!(
            outcome_of(by(Signal::SIGKILL), asked(Signal::SIGKILL)),
            Outcome::Fine
        );
        assert_eq!(
            outcome_of(by(Signal::SIGSEGV), asked(Signal::SIGINT)),
            Outcome::Failed
        );
        assert_eq!(code_of(by(Signal::SIGKILL)), 137);
    }
}
