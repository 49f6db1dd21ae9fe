//! One reader of the benches of wake-ups: the process itself, and its handle in the parent. It
//! sleeps on the events it is told, takes what waits, and ends when its input is closed.

use std::collections::BTreeMap;
use std::time::Duration;

use launch_cli::Exit;
use schema_bus::{Bus, FrameReader, WaitSet, mono_now};
use schema_types::MonoTime;
use serde::{Deserialize, Serialize};

use crate::part::{Parent, Part};

/// Longest sleep, after which the reader looks whether it is to end.
const LOOK_EVERY: Duration = Duration::from_millis(50);

#[derive(Debug, clap::Args)]
pub struct WakeReaderArgs {
    /// Topics to read
    #[arg(long, value_delimiter = ',')]
    topics: Vec<String>,
    /// Events to sleep on
    #[arg(long, value_delimiter = ',')]
    events: Vec<String>,
}

/// What one reader saw.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct Seen {
    /// From the writer's stamp to the frame in hand, nanoseconds, by topic.
    pub ages_nanos: BTreeMap<String, Vec<u64>>,
    /// How often it was woken.
    pub n_wakes: u64,
    /// Frames that never came.
    pub lost: u64,
}

/// Reads until stdin ends and prints what it saw as one line of JSON.
pub fn run(args: &WakeReaderArgs, domain: &str) -> anyhow::Result<Exit> {
    let bus = Bus::open(domain, "gantry-bench-reader")?;
    let mut events = WaitSet::new();
    for event in &args.events {
        events.add(bus.listener(event)?);
    }
    let open = |topic: &String| bus.frame_reader(topic);
    let mut readers: Vec<FrameReader> = args.topics.iter().map(open).collect::<Result<_, _>>()?;
    let parent = Parent::tell_ready()?;
    let mut seen = Seen::default();
    while !parent.is_over() {
        seen.n_wakes += u64::from(events.wait(LOOK_EVERY)?);
        for reader in &mut readers {
            while let Some(frame) = reader.next()? {
                let held = mono_now();
                let sent = MonoTime(frame.header().published_mono_nanos);
                let ages = seen.ages_nanos.entry(reader.topic().to_owned());
                ages.or_default().push(held.nanos_since(sent));
            }
        }
    }
    seen.lost = readers.iter().map(|reader| reader.counts().lost).sum();
    parent.answer(&seen)?;
    Ok(Exit::Done)
}

/// The parent's handle of a reader.
pub struct WakeReader(Part);

impl WakeReader {
    /// Starts this program again as a reader, and waits until it listens.
    pub fn start(domain: &str, topics: &[String], events: &[String]) -> anyhow::Result<Self> {
        let (topics, events) = (topics.join(","), events.join(","));
        let args = ["wake-reader", "--domain", domain, "--topics", &topics];
        Part::start(&[&args[..], &["--events", &events]].concat()).map(WakeReader)
    }

    /// Ends the reader and takes what it saw.
    pub fn finish(self) -> anyhow::Result<Seen> {
        self.0.finish()
    }
}
