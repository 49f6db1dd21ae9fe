//! The run that is made now: a place in its lockstep, and readers of the topics to compare.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use consumer_kit::Lockstep;
use launch_cli::Shutdown;
use launch_run::Process;
use schema_bus::{Bus, BusError, Frame, FrameReader, Listener, Snapshot, SnapshotReader, names};
use schema_frames::FrameHeader;

/// Longest wait without a look at signals and the simulator.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// How long the simulator may take to answer.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(10);
/// How long a topic that a command makes may take to appear.
const TOPIC_TIMEOUT: Duration = Duration::from_secs(10);
/// Ticks that a frame waits for its recorded counterpart, which a free-running simulator sent up to
/// four ticks late.
const KEPT_TICKS: u64 = 8;

/// A frame of the new run.
#[derive(Debug)]
enum Held {
    /// Still in shared memory.
    Loan(Box<Frame>),
    /// Copied, because its counterpart comes late.
    Copy(Box<FrameHeader>, Vec<u8>),
}

/// A topic of the new run.
#[derive(Debug, Default)]
struct Reading {
    reader: Option<FrameReader>,
    frames: VecDeque<Held>,
}

/// The new run.
pub struct Live {
    // Dropped in this order: ports before the bus.
    lockstep: Option<Lockstep>,
    topics: BTreeMap<Arc<str>, Reading>,
    snapshots: SnapshotReader,
    wake: Listener,
    bus: Bus,
    /// Snapshots by tick that wait for their counterpart.
    held: VecDeque<Snapshot>,
    /// Frames that were dropped without a recorded counterpart, by topic.
    only_now: BTreeMap<Arc<str>, u64>,
}

impl Live {
    /// Waits until the simulator is up, opens the topics that exist, and joins its lockstep as
    /// `name`. `None` if this program is asked to end.
    pub fn join(
        bus: Bus,
        name: &str,
        topics: &[Arc<str>],
        simulator: &mut Process,
        shutdown: &Shutdown,
    ) -> anyhow::Result<Option<Live>> {
        while !bus.daemon_alive()? {
            if shutdown.wait(LOOK_EVERY) {
                return Ok(None);
            }
            simulator.must_run_while("before the run began")?;
        }
        let mut live = Live {
            lockstep: None,
            topics: topics
                .iter()
                .map(|topic| (topic.clone(), Reading::default()))
                .collect(),
            snapshots: bus.snapshot_reader()?,
            wake: bus.listener(names::WORLD_SNAPSHOT)?,
            bus,
            held: VecDeque::new(),
            only_now: BTreeMap::new(),
        };
        for topic in topics {
            live.open(topic)?;
        }
        let lockstep = Lockstep::join(&live.bus, name, ANSWER_TIMEOUT)?;
        live.wake = live.bus.listener(lockstep.event())?;
        live.lockstep = Some(lockstep);
        Ok(Some(live))
    }

    /// Opens a topic if it exists; returns whether it is open.
    fn open(&mut self, topic: &Arc<str>) -> anyhow::Result<bool> {
        let Some(reading) = self.topics.get_mut(topic) else {
            return Ok(true);
        };
        if reading.reader.is_none() {
            reading.reader = match self.bus.frame_reader(topic) {
                Ok(reader) => Some(reader),
                Err(BusError::NoSuchTopic { .. } | BusError::Service { .. }) => None,
                Err(other) => return Err(other.into()),
            };
        }
        Ok(reading.reader.is_some())
    }

    /// Waits for topics that commands made at this edge, so that no frame of them is missed;
    /// returns those that did not appear.
    pub fn await_topics(
        &mut self,
        wanted: &[String],
        simulator: &mut Process,
    ) -> anyhow::Result<Vec<String>> {
        let start = Instant::now();
        let mut missing = Vec::new();
        for topic in wanted {
            let topic: Arc<str> = topic.as_str().into();
            while !self.open(&topic)? {
                simulator.must_run_while("while the run was made again")?;
                if start.elapsed() > TOPIC_TIMEOUT {
                    missing.push(topic.to_string());
                    break;
                }
                std::thread::sleep(Duration::from_millis(1));
            }
        }
        Ok(missing)
    }

    /// Topics that are not open.
    pub fn missing(&self) -> impl Iterator<Item = &Arc<str>> {
        self.topics
            .iter()
            .filter(|(_, reading)| reading.reader.is_none())
            .map(|(topic, _)| topic)
    }

    /// Waits until everything of a tick after `tick` was sent, and takes it; the tick and its time,
    /// or `None` if this program is asked to end.
    pub fn next_tick(
        &mut self,
        tick: u64,
        simulator: &mut Process,
        shutdown: &Shutdown,
    ) -> anyhow::Result<Option<(u64, u64)>> {
        loop {
            if shutdown.requested() {
                return Ok(None);
            }
            simulator.must_run_while(&format!("after tick {tick}, before the run was complete"))?;
            self.take_snapshots()?;
            let newest = self
                .held
                .back()
                .map(|s| (s.header().tick, s.header().sim_nanos));
            if let Some((found, nanos)) = newest.filter(|(found, _)| *found > tick) {
                let lockstep = self.lockstep.as_mut().context("the lockstep was left")?;
                if lockstep.is_complete(found)? {
                    self.take()?;
                    return Ok(Some((found, nanos)));
                }
            }
            self.wake.wait(LOOK_EVERY)?;
        }
    }

    fn take_snapshots(&mut self) -> anyhow::Result<()> {
        while let Some(snapshot) = self.snapshots.next()? {
            self.held.push_back(snapshot);
            // A reader may hold four, one of which is the next.
            if self.held.len() > 3 {
                self.held.pop_front();
            }
        }
        Ok(())
    }

    /// Waits for the snapshot of the world before its first tick.
    pub fn await_world(
        &mut self,
        simulator: &mut Process,
        shutdown: &Shutdown,
    ) -> anyhow::Result<()> {
        loop {
            self.take_snapshots()?;
            if !self.held.is_empty() || shutdown.requested() {
                return Ok(());
            }
            simulator.must_run_while("before the run began")?;
            self.wake.wait(LOOK_EVERY)?;
        }
    }

    fn take(&mut self) -> anyhow::Result<()> {
        for reading in self.topics.values_mut() {
            let Some(reader) = &mut reading.reader else {
                continue;
            };
            while let Some(frame) = reader.next()? {
                // Only the frames of the newest tick stay in shared memory.
                for held in &mut reading.frames {
                    held.copy();
                }
                reading.frames.push_back(Held::Loan(Box::new(frame)));
            }
        }
        Ok(())
    }

    /// The snapshot of a tick.
    pub fn snapshot(&self, tick: u64) -> Option<&Snapshot> {
        self.held.iter().find(|held| held.header().tick == tick)
    }

    /// Whether a topic is open.
    pub fn reads(&self, topic: &str) -> bool {
        self.topics
            .get(topic)
            .is_some_and(|reading| reading.reader.is_some())
    }

    /// Hands the frame of a topic and tick to `compare` and lets it go; `None` if there is none.
    pub fn with_frame<T>(
        &mut self,
        topic: &str,
        tick: u64,
        compare: impl FnOnce(&FrameHeader, &[u8]) -> T,
    ) -> Option<T> {
        let frames = &mut self.topics.get_mut(topic)?.frames;
        let idx = frames.iter().position(|held| held.header().tick == tick)?;
        let held = frames.remove(idx)?;
        Some(compare(held.header(), held.payload()))
    }

    /// Forgets frames that are too old to have a recorded counterpart yet, and lets the simulator go
    /// on.
    pub fn acknowledge(&mut self, tick: u64) -> anyhow::Result<()> {
        for (topic, reading) in &mut self.topics {
            while let Some(held) = reading.frames.front()
                && held.header().tick + KEPT_TICKS < tick
            {
                reading.frames.pop_front();
                *self.only_now.entry(topic.clone()).or_insert(0) += 1;
            }
        }
        if let Some(lockstep) = &self.lockstep {
            lockstep.ack(tick)?;
        }
        Ok(())
    }

    /// Leaves the lockstep: the simulator goes on alone.
    pub fn leave(&mut self) {
        self.lockstep = None;
    }
}

impl Held {
    fn header(&self) -> &FrameHeader {
        match self {
            Held::Loan(frame) => frame.header(),
            Held::Copy(header, _) => header,
        }
    }

    fn payload(&self) -> &[u8] {
        match self {
            Held::Loan(frame) => frame,
            Held::Copy(_, bytes) => bytes,
        }
    }

    fn copy(&mut self) {
        if let Held::Loan(frame) = self {
            *self = Held::Copy(Box::new(*frame.header()), frame.to_vec());
        }
    }
}
