//! Looks for topics on a thread of its own, because listing a domain opens every service and takes
//! longer than a fast sensor's buffer lasts.

use std::time::{Duration, Instant};

use anyhow::Context;
use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded};
use schema_bus::{Bus, BusError, BusOptions, TopicDetails};

/// How often topics are listed.
const LIST_EVERY: Duration = Duration::from_millis(500);
/// Where listing is slow, because much else is on this machine's bus, it is done less often: it takes
/// at most one part in so many of the time, and comes every [`LONGEST`] at least.
const SHARE: u32 = 50;
/// Longest time between lists.
const LONGEST: Duration = Duration::from_secs(2);

/// A thread that lists the topics of a domain until it is dropped.
#[derive(Debug)]
pub struct Discovery {
    found: Receiver<Result<Vec<TopicDetails>, BusError>>,
    _stop: Sender<()>,
}

impl Discovery {
    /// Starts listing.
    ///
    /// # Errors
    /// If the bus cannot be joined or the thread not be started.
    pub fn start(domain: &str, program: &str, options: &BusOptions) -> anyhow::Result<Discovery> {
        let bus = Bus::open_with(domain, program, options)?;
        let (sender, found) = bounded(1);
        let (stop, stopped) = bounded::<()>(0);
        std::thread::Builder::new()
            .name("discover".to_string())
            .spawn(move || list(&bus, &sender, &stopped))
            .context("cannot start the thread that looks for topics")?;
        Ok(Discovery { found, _stop: stop })
    }

    /// The newest list, if there is one since the last call.
    ///
    /// # Errors
    /// [`BusError`] if the domain cannot be listed.
    pub fn newest(&self) -> Result<Option<Vec<TopicDetails>>, BusError> {
        self.found.try_recv().ok().transpose()
    }
}

fn list(bus: &Bus, found: &Sender<Result<Vec<TopicDetails>, BusError>>, stopped: &Receiver<()>) {
    loop {
        let began = Instant::now();
        let topics = bus.topics();
        let wait = (SHARE * began.elapsed()).clamp(LIST_EVERY, LONGEST);
        // If the previous list was not taken yet, it is as good as a new one.
        let _ = found.try_send(topics);
        if stopped.recv_timeout(wait) == Err(RecvTimeoutError::Disconnected) {
            return;
        }
    }
}
