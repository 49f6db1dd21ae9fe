//! Looks at the domain's services again and again on a thread of its own, because a look takes long
//! enough on a busy machine for frames to be lost meanwhile.

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::Context as _;
use schema_bus::{Bus, ServicePorts};

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
                        Ok(services) => {
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
