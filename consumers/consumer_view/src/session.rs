//! A viewing from start to end: shows the newest frame of every topic at a limited rate, with a new
//! rerun recording for every run of the simulator.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use consumer_kit::{FollowedDocument, Follower, MAX_WAIT, Take, TopicId, WorldAt, file_of_run};
use rerun::RecordingStreamBuilder;
use schema_bus::{Bus, BusOptions, mono_now, names};
use schema_frames::{ActorList, WorldInfo};

use crate::layout::{APPLICATION, Place};
use crate::pace::Pace;
use crate::stage::Stage;

/// How often topics are listed.
const DISCOVER_EVERY: Duration = Duration::from_secs(1);
/// How long a topic without a writer keeps its view; a restarting simulator comes back sooner.
const KEEP_VIEW: Duration = Duration::from_secs(15);
/// How often small messages are sent although they fill no batch.
const HURRY_EVERY: Duration = Duration::from_millis(250);
/// How long sending the last data may take.
const FLUSH_TIMEOUT: Duration = Duration::from_secs(20);

/// Where the recording goes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Target {
    /// A viewer that listens at this address: `rerun+http://127.0.0.1:9876/proxy`.
    Connect(String),
    /// A new file.
    Save(PathBuf),
}

impl Target {
    /// The stage of a run of the simulator; runs are counted from 1.
    fn open(&self, run: u32) -> anyhow::Result<Stage> {
        let builder = RecordingStreamBuilder::new(APPLICATION);
        let rec = match self {
            Target::Connect(url) => builder.connect_grpc_opts(url.as_str())?,
            Target::Save(path) => {
                let path = file_of_run(path, run);
                anyhow::ensure!(
                    !path.exists(),
                    "{} exists already; choose another name or remove it first",
                    path.display()
                );
                builder.save(path)?
            }
        };
        Stage::new(rec)
    }
}

/// What to show.
#[derive(Clone, Debug)]
pub struct Options {
    /// First segment of the service names.
    pub domain: String,
    /// Where iceoryx2 keeps its files.
    pub bus: BusOptions,
    /// Most frames per second and topic.
    pub max_hz: f64,
    /// Where to.
    pub target: Target,
}

/// What was shown.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Shown {
    /// Frames per topic.
    pub frames: BTreeMap<String, u64>,
    /// Runs of the simulator.
    pub n_runs: u32,
}

/// Shows until `stop` says so.
///
/// # Errors
/// If the bus cannot be joined or the target refuses.
pub fn show(options: &Options, stop: &mut dyn FnMut() -> bool) -> anyhow::Result<Shown> {
    let bus = Bus::open_with(
        &options.domain,
        &format!("gantry-view-{}", std::process::id()),
        &options.bus,
    )?;
    let documents = [names::WORLD_INFO, names::WORLD_MAP, names::WORLD_ACTORS]
        .map(|name| (name, FollowedDocument::new(name)));
    let mut session = Session {
        documents,
        follower: Follower::on(bus),
        stage: options.target.open(1)?,
        target: options.target.clone(),
        topics: BTreeMap::new(),
        max_hz: options.max_hz,
        world_pace: Pace::new(options.max_hz),
        shown_tick: 0,
        epoch: 0,
        discovered: None,
        hurried: Instant::now(),
        shown: Shown {
            n_runs: 1,
            ..Default::default()
        },
    };
    while !stop() {
        session.turn()?;
    }
    session.stage.flush(FLUSH_TIMEOUT)?;
    Ok(session.shown)
}

struct Session {
    // Dropped in this order: ports before the node that made them.
    documents: [(&'static str, FollowedDocument); 3],
    follower: Follower,
    stage: Stage,
    target: Target,
    topics: BTreeMap<String, Topic>,
    max_hz: f64,
    world_pace: Pace,
    shown_tick: u64,
    epoch: u64,
    discovered: Option<Instant>,
    hurried: Instant,
    shown: Shown,
}

struct Topic {
    /// `None` while all its reader places are taken.
    id: Option<TopicId>,
    pace: Pace,
    alive: Instant,
}

impl Session {
    fn turn(&mut self) -> anyhow::Result<()> {
        self.discover()?;
        self.follower.wait(MAX_WAIT)?;
        self.take_documents()?;
        self.take_frames()?;
        self.take_world()?;
        if self.hurried.elapsed() >= HURRY_EVERY {
            self.hurried = Instant::now();
            self.stage.hurry()?;
        }
        Ok(())
    }

    /// Follows topics that are new and forgets the views of those that have gone.
    fn discover(&mut self) -> anyhow::Result<()> {
        if self
            .discovered
            .is_some_and(|at| at.elapsed() < DISCOVER_EVERY)
        {
            return Ok(());
        }
        self.discovered = Some(Instant::now());
        for found in self.follower.bus().topics()? {
            if found.modality.is_none() || Place::new(&found.name).is_none() {
                continue;
            }
            let fresh = || Topic {
                id: None,
                pace: Pace::new(self.max_hz),
                alive: Instant::now(),
            };
            let full = found.subscribers >= found.max_subscribers;
            if full && !self.topics.contains_key(&found.name) {
                let sentence = format!(
                    "{} is not shown: all its {} reader places are taken",
                    found.name, found.max_subscribers
                );
                tracing::warn!("{sentence}");
                self.stage.say(rerun::TextLogLevel::WARN, &sentence)?;
            }
            let topic = self.topics.entry(found.name.clone()).or_insert_with(fresh);
            if topic.id.is_none() && !full {
                topic.id = Some(self.follower.follow(&found.name, Take::Newest));
            }
            if found.publishers > 0 {
                topic.alive = Instant::now();
            }
        }
        let visible = self
            .topics
            .iter()
            .filter(|(_, topic)| topic.id.is_some() && topic.alive.elapsed() < KEEP_VIEW);
        self.stage
            .set_topics(visible.map(|(name, _)| name.as_str()))
    }

    /// Begins a new recording for a new epoch: that is a new run of the simulator, whose clock
    /// starts again.
    fn meet(&mut self, epoch: u64) -> anyhow::Result<()> {
        if self.epoch == epoch || epoch == 0 {
            return Ok(());
        }
        if self.epoch != 0 {
            self.shown.n_runs += 1;
            tracing::info!(
                run = self.shown.n_runs,
                "the simulator was restarted; its new run is a new recording"
            );
            self.stage.flush(FLUSH_TIMEOUT)?;
            self.stage = self.target.open(self.shown.n_runs)?;
            self.shown_tick = 0;
            self.discovered = None;
        }
        self.epoch = epoch;
        Ok(())
    }

    fn take_documents(&mut self) -> anyhow::Result<()> {
        for idx in 0..self.documents.len() {
            let (name, followed) = &mut self.documents[idx];
            let Some(document) = followed.changed(self.follower.bus())?.cloned() else {
                continue;
            };
            let name = *name;
            self.meet(document.header.epoch)?;
            match name {
                names::WORLD_MAP => self.stage.set_map(&document.text)?,
                names::WORLD_ACTORS => self.stage.set_actors(&document.json::<ActorList>()?),
                _ => {
                    let info = document.json::<WorldInfo>()?;
                    self.stage.say(
                        rerun::TextLogLevel::INFO,
                        &format!(
                            "{} on {}, seed {}, {} run",
                            info.map, info.adapter, info.seed, info.source
                        ),
                    )?;
                }
            }
        }
        Ok(())
    }

    /// Takes the newest frame of every topic, then shows them all, so that the time for showing one
    /// frame does not count as latency of the next.
    fn take_frames(&mut self) -> anyhow::Result<()> {
        let mut taken = Vec::new();
        for (name, topic) in &mut self.topics {
            let Some(id) = topic.id else { continue };
            let Some(frame) = self.follower.take(id)? else {
                continue;
            };
            topic.alive = Instant::now();
            if topic.pace.admits(Instant::now()) {
                let latency_nanos = mono_now()
                    .0
                    .saturating_sub(frame.header().published_mono_nanos);
                taken.push((name.clone(), frame, latency_nanos));
            }
        }
        for (name, frame, latency_nanos) in taken {
            let header = *frame.header();
            self.meet(header.epoch)?;
            if let Some(world) = self.follower.world_at(header.tick)? {
                self.stage.remember(&world.header, &world.records);
                self.show_world(&world)?;
            }
            self.stage
                .show_frame(&name, &header, &frame, latency_nanos)?;
            *self.shown.frames.entry(name).or_insert(0) += 1;
        }
        Ok(())
    }

    /// Shows the world of a tick once, with the first frame of that tick, so that both agree.
    fn show_world(&mut self, world: &Arc<WorldAt>) -> anyhow::Result<()> {
        if world.header.epoch == self.epoch && world.header.tick > self.shown_tick {
            self.shown_tick = world.header.tick;
            self.world_pace.admits(Instant::now());
            self.stage.show_snapshot(&world.header, &world.records)?;
        }
        Ok(())
    }

    /// Shows the newest world between frames and when there are no frames.
    fn take_world(&mut self) -> anyhow::Result<()> {
        let Some(world) = self.follower.newest_world()? else {
            return Ok(());
        };
        self.meet(world.header.epoch)?;
        if world.header.tick > self.shown_tick && self.world_pace.admits(Instant::now()) {
            self.stage.remember(&world.header, &world.records);
            self.show_world(&world)?;
        }
        Ok(())
    }
}
