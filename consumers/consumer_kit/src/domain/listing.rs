//! The list of a domain's topics, made again and again on a thread of its own: listing opens every
//! service, which takes longer than a fast sensor's buffer lasts.

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex};
use schema_bus::{Bus, BusError, TopicDetails};

/// Where listing is slow, because much else is on this machine's bus, it is done less often: it
/// takes at most one part in so many of the time, as far as [`Rhythm::longest`] allows.
const SHARE: u32 = 50;

/// How often topics are listed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rhythm {
    /// Rest after a list.
    pub rest: Duration,
    /// Longest rest where listing is slow.
    pub longest: Duration,
}

impl Rhythm {
    /// The same rest after every list.
    pub const fn steady(rest: Duration) -> Rhythm {
        Rhythm {
            rest,
            longest: rest,
        }
    }

    fn after(self, took: Duration) -> Duration {
        (SHARE * took).clamp(self.rest, self.longest)
    }
}

/// The newest list of a domain's topics. Clones share the thread that makes it, which ends with the
/// last of them; each clone is told of every list once.
#[derive(Clone, Debug)]
pub struct Listing {
    worker: Arc<Worker>,
    n_known: u64,
}

/// The thread and what it shares.
#[derive(Debug)]
struct Worker {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug)]
struct Shared {
    state: Mutex<State>,
    /// Notified when the thread is to look at the state.
    changed: Condvar,
}

#[derive(Debug)]
struct State {
    rhythm: Rhythm,
    n_lists: u64,
    topics: Arc<Vec<TopicDetails>>,
    /// Why the last list could not be made, until somebody was told.
    error: Option<BusError>,
    ends: bool,
}

impl Listing {
    /// Starts to list the topics of the domain that `bus` has joined.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn start(bus: Bus, rhythm: Rhythm) -> std::io::Result<Listing> {
        let shared = Arc::new(Shared {
            state: Mutex::new(State {
                rhythm,
                n_lists: 0,
                topics: Arc::default(),
                error: None,
                ends: false,
            }),
            changed: Condvar::new(),
        });
        let own = shared.clone();
        let thread = std::thread::Builder::new()
            .name("discover".to_owned())
            .spawn(move || list(&bus, &own))?;
        Ok(Listing {
            worker: Arc::new(Worker {
                shared,
                thread: Some(thread),
            }),
            n_known: 0,
        })
    }

    /// Lists in another rhythm from now on; a rest that is shorter than before begins at once.
    pub fn set_rhythm(&self, rhythm: Rhythm) {
        let mut state = self.worker.shared.state.lock();
        if state.rhythm != rhythm {
            state.rhythm = rhythm;
            self.worker.shared.changed.notify_one();
        }
    }

    /// The newest list, if there is one since the last call.
    ///
    /// # Errors
    /// [`BusError`] if the domain could not be listed; of several clones one is told.
    pub fn changed(&mut self) -> Result<Option<Arc<Vec<TopicDetails>>>, BusError> {
        let mut state = self.worker.shared.state.lock();
        if let Some(error) = state.error.take() {
            return Err(error);
        }
        if state.n_lists == self.n_known {
            return Ok(None);
        }
        self.n_known = state.n_lists;
        Ok(Some(state.topics.clone()))
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.shared.state.lock().ends = true;
        self.shared.changed.notify_one();
        if let Some(thread) = self.thread.take() {
            // What it had to say is in the state.
            let _ = thread.join();
        }
    }
}

fn list(bus: &Bus, shared: &Shared) {
    loop {
        let began = Instant::now();
        let topics = bus.topics();
        let took = began.elapsed();
        let listed = Instant::now();
        let mut state = shared.state.lock();
        match topics {
            Ok(topics) => {
                state.topics = Arc::new(topics);
                state.n_lists += 1;
            }
            Err(error) => state.error = Some(error),
        }
        while !state.ends {
            let due = listed + state.rhythm.after(took);
            if shared.changed.wait_until(&mut state, due).timed_out() {
                break;
            }
        }
        if state.ends {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_lists_are_made_less_often_but_within_the_longest_rest() {
        let rhythm = Rhythm {
            rest: Duration::from_millis(500),
            longest: Duration::from_secs(2),
        };
        let rest = |took_ms| rhythm.after(Duration::from_millis(took_ms)).as_millis();
        assert_eq!([rest(1), rest(20), rest(500)], [500, 1000, 2000]);
        let steady = Rhythm::steady(Duration::from_secs(1));
        assert_eq!(steady.after(Duration::from_secs(9)), steady.rest);
    }
}
