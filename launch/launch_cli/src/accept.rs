//! Accepting connections when something is short: an accept loop pauses instead of spinning, and
//! what would be said for every connection is said seldom.

use std::io;
use std::time::{Duration, Instant};

use parking_lot::Mutex;

/// First pause after a connection could not be accepted; each further one is twice as long.
const FIRST_PAUSE: Duration = Duration::from_millis(10);
/// Longest pause between two tries to accept a connection.
pub const LONGEST_ACCEPT_PAUSE: Duration = Duration::from_secs(1);
/// Time between two log lines about the same thing.
const SAY_EVERY: Duration = Duration::from_secs(10);

/// Lets something be said once in ten seconds, or a few times, whatever happens in between.
#[derive(Debug)]
pub struct Seldom {
    most: u64,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    since: Option<Instant>,
    n_said: u64,
    n_unsaid: u64,
}

impl Default for Seldom {
    fn default() -> Self {
        Seldom::of(1)
    }
}

impl Seldom {
    /// Lets something be said so many times in ten seconds.
    pub fn of(most: u64) -> Seldom {
        Seldom {
            most,
            state: Mutex::default(),
        }
    }

    /// Whether it is time to say it; then with the number of times that it was left unsaid.
    pub fn is_due(&self) -> Option<u64> {
        let mut state = self.state.lock();
        if state.since.is_none_or(|since| since.elapsed() >= SAY_EVERY) {
            (state.since, state.n_said) = (Some(Instant::now()), 0);
        }
        if state.n_said >= self.most {
            state.n_unsaid += 1;
            return None;
        }
        state.n_said += 1;
        Some(std::mem::take(&mut state.n_unsaid))
    }
}

/// The pauses of one accept loop.
#[derive(Debug)]
pub struct AcceptPause {
    what: &'static str,
    next: Duration,
    says: Seldom,
}

impl AcceptPause {
    /// For a loop that accepts `what`, as a sentence names it ("RPC connections").
    pub fn new(what: &'static str) -> AcceptPause {
        AcceptPause {
            what,
            next: FIRST_PAUSE,
            says: Seldom::default(),
        }
    }

    /// A connection was accepted: the next pause is a short one.
    pub fn over(&mut self) {
        self.next = FIRST_PAUSE;
    }

    /// One could not be accepted: waits before the next try.
    pub fn wait(&mut self, error: &io::Error) {
        if let Some(n_unsaid) = self.says.is_due() {
            let what = self.what;
            let hint = if is_out_of_files(error) {
                "; close clients or sensors, or raise the limit of open files (ulimit -n)"
            } else {
                ""
            };
            tracing::warn!(n_unsaid, "cannot accept {what} now ({error}){hint}");
        }
        std::thread::sleep(self.next);
        self.next = (self.next * 2).min(LONGEST_ACCEPT_PAUSE);
    }
}

/// Whether the process or the machine has no file descriptor left.
pub fn is_out_of_files(error: &io::Error) -> bool {
    let code = error.raw_os_error().map(nix::errno::Errno::from_raw);
    matches!(
        code,
        Some(nix::errno::Errno::EMFILE | nix::errno::Errno::ENFILE)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_grow_and_begin_anew() {
        let mut pause = AcceptPause::new("test connections");
        let full = io::Error::from_raw_os_error(nix::errno::Errno::EMFILE as i32);
        assert!(is_out_of_files(&full));
        let began = Instant::now();
        (0..3).for_each(|_| pause.wait(&full));
        assert!(began.elapsed() >= 7 * FIRST_PAUSE);
        for _ in 0..12 {
            pause.next = (pause.next * 2).min(LONGEST_ACCEPT_PAUSE);
        }
        assert_eq!(pause.next, LONGEST_ACCEPT_PAUSE);
        pause.over();
        assert_eq!(pause.next, FIRST_PAUSE);
    }

    #[test]
    fn what_happens_often_is_said_once() {
        let seldom = Seldom::default();
        let said: Vec<_> = (0..3).map(|_| seldom.is_due()).collect();
        assert_eq!(said, [Some(0), None, None]);
        let few = Seldom::of(2);
        let said: Vec<_> = (0..3).map(|_| few.is_due()).collect();
        assert_eq!(said, [Some(0), Some(0), None]);
    }
}
