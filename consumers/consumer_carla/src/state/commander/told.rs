//! Commands on their way that nobody waits for, counted by the thread that queued them.
//!
//! A connection is served by one thread, so its own count says whether the calls before an answer
//! have been carried out.

use std::sync::Arc;
use std::time::Duration;

use parking_lot::{Condvar, Mutex};

#[derive(Debug, Default)]
struct Told {
    n_on_their_way: Mutex<usize>,
    all_run: Condvar,
}

thread_local! {
    static TOLD: Arc<Told> = Arc::default();
}

/// Commands that a thread queued without waiting; they are on their way until this is dropped.
#[derive(Debug)]
pub(super) struct OnItsWay(Arc<Told>);

impl OnItsWay {
    /// Commands of the calling thread.
    pub fn from_here() -> OnItsWay {
        let told = TOLD.with(Arc::clone);
        *told.n_on_their_way.lock() += 1;
        OnItsWay(told)
    }
}

impl Drop for OnItsWay {
    fn drop(&mut self) {
        let mut n = self.0.n_on_their_way.lock();
        *n -= 1;
        if *n == 0 {
            self.0.all_run.notify_all();
        }
    }
}

/// Waits for so long until nothing of the calling thread is on its way; false if something still is.
pub(super) fn settled(patience: Duration) -> bool {
    let told = TOLD.with(Arc::clone);
    let mut n = told.n_on_their_way.lock();
    if *n > 0 {
        told.all_run.wait_while_for(&mut n, |n| *n > 0, patience);
    }
    *n == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOON: Duration = Duration::from_millis(5);

    #[test]
    fn a_thread_waits_for_its_own_commands_only() {
        assert!(settled(SOON));
        let one = OnItsWay::from_here();
        let other = OnItsWay::from_here();
        assert!(!settled(SOON));
        assert!(std::thread::spawn(|| settled(SOON)).join().unwrap());
        drop(one);
        assert!(!settled(SOON));
        let runner = std::thread::spawn(move || drop(other));
        assert!(settled(Duration::from_secs(60)));
        runner.join().unwrap();
    }
}
