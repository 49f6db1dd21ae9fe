//! Readers of top's own, for topics whose losses, jitter and delay were asked for. They read in a
//! thread of their own, so that a slow terminal loses no samples.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::Context as _;
use hdrhistogram::Histogram;
use parking_lot::Mutex;
use schema_bus::{Bus, mono_now};

use super::view::Measured;
use crate::look::reading::meter::{Meter, Previous};
use crate::look::reading::source::Source;

/// Sleep between two looks: short enough for a topic of which two samples wait at a time.
const NAP: Duration = Duration::from_millis(1);
/// Sleep while nothing is measured.
const IDLE: Duration = Duration::from_millis(20);

/// The readers and their figures.
pub struct Measurer {
    shared: Arc<Shared>,
    thread: Option<std::thread::JoinHandle<()>>,
}

#[derive(Default)]
struct Shared {
    figures: Mutex<BTreeMap<String, Measured>>,
    ended: AtomicBool,
}

struct Reading {
    source: Source,
    meter: Meter,
    previous: Previous,
}

impl Measurer {
    /// Starts the thread, with a place of its own on the bus.
    pub fn start(domain: &str) -> anyhow::Result<Measurer> {
        let bus = Bus::open(domain, "gantry-top")?;
        let shared = Arc::new(Shared::default());
        let theirs = shared.clone();
        let thread = std::thread::Builder::new()
            .name("measure".into())
            .spawn(move || theirs.run(&bus))
            .context("cannot start the thread that reads topics")?;
        Ok(Measurer {
            shared,
            thread: Some(thread),
        })
    }

    /// Begins to read a topic.
    pub fn add(&self, topic: &str) {
        self.shared
            .figures
            .lock()
            .entry(topic.to_owned())
            .or_default();
    }

    /// Gives the topic's place back.
    pub fn remove(&self, topic: &str) {
        self.shared.figures.lock().remove(topic);
    }

    /// Whether the topic is read.
    pub fn has(&self, topic: &str) -> bool {
        self.shared.figures.lock().contains_key(topic)
    }

    /// The figures by topic.
    pub fn figures(&self) -> BTreeMap<String, Measured> {
        self.shared.figures.lock().clone()
    }
}

impl Drop for Measurer {
    fn drop(&mut self) {
        self.shared.ended.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Shared {
    fn run(&self, bus: &Bus) {
        let mut readings: BTreeMap<String, Option<Reading>> = BTreeMap::new();
        while !self.ended.load(Ordering::Acquire) {
            let wanted: Vec<String> = self.figures.lock().keys().cloned().collect();
            readings.retain(|topic, _| wanted.contains(topic));
            for topic in wanted {
                let reading = readings
                    .entry(topic.clone())
                    .or_insert_with(|| self.begin(bus, &topic));
                let Some(ours) = reading else { continue };
                match ours.drain() {
                    Ok(0) => {}
                    Ok(_) => self.tell(&topic, ours.measured(String::new())),
                    Err(error) => {
                        self.tell(&topic, ours.measured(format!("{error:#}")));
                        *reading = None;
                    }
                }
            }
            let idle = readings.values().all(Option::is_none);
            std::thread::sleep(if idle { IDLE } else { NAP });
        }
    }

    fn begin(&self, bus: &Bus, topic: &str) -> Option<Reading> {
        let open = || {
            Ok::<Reading, anyhow::Error>(Reading {
                source: Source::open(bus, topic)?,
                meter: Meter::new()?,
                previous: Previous::default(),
            })
        };
        match open() {
            Ok(reading) => Some(reading),
            Err(error) => {
                let fault = format!("{error:#}");
                self.tell(
                    topic,
                    Measured {
                        fault,
                        ..Measured::default()
                    },
                );
                None
            }
        }
    }

    fn tell(&self, topic: &str, measured: Measured) {
        if let Some(place) = self.figures.lock().get_mut(topic) {
            *place = measured;
        }
    }
}

impl Reading {
    /// Takes what waits. Returns how many samples came.
    fn drain(&mut self) -> anyhow::Result<usize> {
        let mut n = 0;
        while let Some(sample) = self.source.next()? {
            let now = mono_now().0;
            let stamp = sample.stamp();
            self.meter.count(&stamp, &mut self.previous, now)?;
            n += 1;
        }
        Ok(n)
    }

    fn measured(&self, fault: String) -> Measured {
        let meter = &self.meter;
        let at = |times: &Histogram<u64>, quantile: f64| {
            (!times.is_empty()).then(|| times.value_at_quantile(quantile))
        };
        Measured {
            samples: meter.samples,
            lost: meter.lost,
            refused: self.source.n_refused(),
            jitter_nanos: (!meter.intervals.is_empty()).then(|| meter.intervals.stdev() as u64),
            delay_nanos_p50: at(&meter.ages, 0.5),
            delay_nanos_p99: at(&meter.ages, 0.99),
            fault,
        }
    }
}
