//! Looks at the domain's services again and again on a thread of its own, because a look takes long
//! enough on a busy machine for frames to be lost meanwhile.

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use consumer_kit::LEAVE_AFTER;
use schema_bus::{Bus, ServicePorts, names};

use crate::locked::lock;
use crate::options::Options;

/// Pause between two looks.
const PAUSE: Duration = Duration::from_millis(500);
/// Longest sleep, so that the end is not waited for.
const NAP: Duration = Duration::from_millis(50);

/// Services of the domain as they were at the last look.
#[derive(Debug)]
pub struct Lookout {
    seen: Arc<Mutex<Seen>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

/// What was seen, and how often was looked.
#[derive(Clone, Debug, Default)]
struct Seen {
    n_looks: u64,
    services: Arc<Vec<ServicePorts>>,
}

/// What a reader of the lookout has seen so far.
#[derive(Clone, Debug)]
pub struct View {
    seen: Arc<Mutex<Seen>>,
    known: u64,
}

impl Lookout {
    /// Joins the domain and begins to look.
    ///
    /// # Errors
    /// [`schema_bus::BusError`], or if the system gives no thread.
    pub fn start(options: &Options) -> anyhow::Result<Lookout> {
        let bus = Bus::open_with(&options.domain, "gantry-bridge", &options.bus)?;
        let (seen, stop) = (Arc::new(Mutex::new(Seen::default())), Arc::default());
        let (to, until): (_, Arc<AtomicBool>) = (seen.clone(), Arc::clone(&stop));
        let thread = std::thread::Builder::new()
            .name("look".into())
            .spawn(move || {
                while !until.load(Relaxed) {
                    match bus.services() {
                        Ok(mut services) => {
                            // Memory of a GPU stays on its machine.
                            services.retain(|service| !names::is_gpu_topic(&service.name));
                            let mut seen = lock(&to);
                            seen.n_looks += 1;
                            seen.services = Arc::new(services);
                        }
                        Err(error) => tracing::debug!(%error, "cannot list the services"),
                    }
                    let mut rest = PAUSE;
                    while !rest.is_zero() && !until.load(Relaxed) {
                        std::thread::sleep(NAP.min(rest));
                        rest = rest.saturating_sub(NAP);
                    }
                }
            })
            .context("the system gives no thread")?;
        Ok(Lookout {
            seen,
            stop,
            thread: Some(thread),
        })
    }

    /// A view of one reader.
    pub fn view(&self) -> View {
        View {
            seen: self.seen.clone(),
            known: 0,
        }
    }
}

impl View {
    /// The services, if there was a look since the last call.
    pub fn changed(&mut self) -> Option<Arc<Vec<ServicePorts>>> {
        let seen = lock(&self.seen);
        if seen.n_looks == self.known {
            return None;
        }
        self.known = seen.n_looks;
        Some(seen.services.clone())
    }
}

impl Drop for Lookout {
    fn drop(&mut self) {
        self.stop.store(true, Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Whether a topic has no writer and is there only because others still read it.
pub fn is_left_over(service: &ServicePorts) -> bool {
    service.writers.is_empty() && !service.readers.is_empty()
}

/// Since when a topic has no writer.
#[derive(Debug, Default)]
pub struct Left(Option<Instant>);

impl Left {
    /// Whether it has had none for so long that it is left. Our own reader would otherwise keep the
    /// topic of a sensor that has ended.
    pub fn is_over(&mut self, has_writer: bool) -> bool {
        self.is_over_at(has_writer, Instant::now())
    }

    fn is_over_at(&mut self, has_writer: bool, now: Instant) -> bool {
        if has_writer {
            self.0 = None;
            return false;
        }
        now - *self.0.get_or_insert(now) > LEAVE_AFTER
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_topic_is_left_once_it_has_had_no_writer_for_long() {
        let (mut left, began) = (Left::default(), Instant::now());
        let long = LEAVE_AFTER + NAP;
        assert!(!left.is_over_at(false, began));
        assert!(!left.is_over_at(true, began + long), "it came back");
        assert!(!left.is_over_at(false, began + 2 * long));
        assert!(left.is_over_at(false, began + 3 * long));
    }
}
