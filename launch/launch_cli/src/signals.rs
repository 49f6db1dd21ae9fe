//! Ctrl-C: the first SIGINT or SIGTERM asks the program to finish, the second ends it at once.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::Context as _;
use parking_lot::{Condvar, Mutex};
use signal_hook::consts::{SIGINT, SIGTERM};

/// A flag that says whether this process was asked to finish. Clones share the flag.
#[derive(Clone, Debug, Default)]
pub struct Shutdown {
    shared: Arc<Shared>,
}

#[derive(Debug, Default)]
struct Shared {
    requested: Arc<AtomicBool>,
    gate: Mutex<()>,
    changed: Condvar,
}

impl Shutdown {
    /// A flag that only [`Shutdown::request`] sets, for tests and for parts of a program that their
    /// owner stops.
    pub fn new() -> Self {
        Self::default()
    }

    /// A flag set by SIGINT and SIGTERM. A second signal ends the process at once with exit code 1.
    ///
    /// # Errors
    /// When the handlers cannot be installed.
    pub fn install() -> anyhow::Result<Self> {
        let shutdown = Shutdown::new();
        for signal in [SIGINT, SIGTERM] {
            // Handlers run in the order in which they are registered. The conditional shutdown
            // comes first, so the first signal finds the flag unset and only the second ends the
            // process.
            signal_hook::flag::register_conditional_shutdown(
                signal,
                1,
                shutdown.shared.requested.clone(),
            )
            .and_then(|_| signal_hook::flag::register(signal, shutdown.shared.requested.clone()))
            .with_context(|| format!("cannot listen for signal {signal}"))?;
        }
        let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM])
            .context("cannot listen for signals")?;
        let waker = shutdown.clone();
        std::thread::Builder::new()
            .name("signals".into())
            .spawn(move || signals.forever().for_each(|_| waker.request()))
            .context("cannot start the thread that waits for signals")?;
        Ok(shutdown)
    }

    /// Whether the program should finish.
    pub fn requested(&self) -> bool {
        self.shared.requested.load(Ordering::Acquire)
    }

    /// Asks the program to finish, as a signal would.
    pub fn request(&self) {
        let gate = self.shared.gate.lock();
        self.shared.requested.store(true, Ordering::Release);
        drop(gate);
        self.shared.changed.notify_all();
    }

    /// Sleeps for `timeout`, or until the program should finish; returns whether it should.
    pub fn wait(&self, timeout: Duration) -> bool {
        let mut gate = self.shared.gate.lock();
        self.shared
            .changed
            .wait_while_for(&mut gate, |()| !self.requested(), timeout);
        self.requested()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_wakes_a_sleeper() {
        let shutdown = Shutdown::new();
        assert!(!shutdown.wait(Duration::from_millis(1)));
        let sleeper = shutdown.clone();
        let thread = std::thread::spawn(move || sleeper.wait(Duration::from_secs(60)));
        shutdown.request();
        assert!(thread.join().unwrap());
        assert!(shutdown.requested());
    }

    #[test]
    fn the_first_signal_asks() {
        let shutdown = Shutdown::install().unwrap();
        signal_hook::low_level::raise(SIGTERM).unwrap();
        assert!(shutdown.wait(Duration::from_secs(60)));
    }
}
