//! A viewing from start to end: shows the newest frame of every topic at a limited rate, with a new
//! rerun recording for every run of the simulator.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use consumer_kit::items::ResultParts;
use consumer_kit::{
    FollowedDocument, FollowedResult, Follower, MAX_WAIT, Take, TopicId, WorldAt, file_of_run,
};
use rerun::RecordingStreamBuilder;
use schema_bus::{Bus, BusOptions, ResultSample, TopicDetails, mono_now, names};
use schema_frames::{ActorList, ResultType, WorldInfo};

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

/// Results of one topic that are shown in one turn at most.
const MAX_RESULTS_A_TURN: usize = 32;
/// Most results per second that are shown of topics whose every result counts.
const EVERY_HZ: f64 = 200.0;

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
    /// Whether to show the spectator's image too, which is rendered only for its readers.
    pub spectator: bool,
}

/// What was shown.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Shown {
    /// Frames per topic.
    pub frames: BTreeMap<String, u64>,
    /// Results of users' programs per topic.
    pub results: BTreeMap<String, u64>,
    /// Items of results that could not be drawn, per topic: boxes that are not finite, masks beyond
    /// their image.
    pub bad_items: BTreeMap<String, u64>,
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
        results: BTreeMap::new(),
        full: BTreeSet::new(),
        max_hz: options.max_hz,
        spectator: options.spectator,
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
    session.count_bad_items();
    session.stage.flush(FLUSH_TIMEOUT)?;
    Ok(session.shown)
}

/// Time from the oldest frame behind a result to now, or from its own publication without one.
fn age_nanos(result: &ResultSample) -> u64 {
    let header = result.header();
    let since = match header.origin_mono_nanos {
        0 => header.published_mono_nanos,
        origin => origin,
    };
    result.taken().0.saturating_sub(since)
}

struct Session {
    // Dropped in this order: ports before the node that made them.
    results: BTreeMap<String, Results>,
    documents: [(&'static str, FollowedDocument); 3],
    follower: Follower,
    stage: Stage,
    target: Target,
    topics: BTreeMap<String, Topic>,
    /// Topics of results without a place for us, which was said.
    full: BTreeSet<String>,
    max_hz: f64,
    spectator: bool,
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

/// A topic of results.
struct Results {
    followed: FollowedResult,
    pace: Pace,
    alive: Instant,
    has_writer: bool,
    /// Whether it cannot be read, which was said.
    given_up: bool,
}

impl Session {
    fn turn(&mut self) -> anyhow::Result<()> {
        self.discover()?;
        self.follower.wait(MAX_WAIT)?;
        self.take_documents()?;
        self.take_frames()?;
        self.take_results()?;
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
            if let Some(kind) = found.result {
                self.discover_result(&found, kind)?;
                continue;
            }
            let is_unwanted = found.name == names::SPECTATOR_RGB && !self.spectator;
            if found.modality.is_none() || is_unwanted || Place::new(&found.name).is_none() {
                continue;
            }
            let fresh = || Topic {
                id: None,
                pace: Pace::new(self.max_hz),
                alive: Instant::now(),
            };
            let full = found.subscribers >= found.max_subscribers;
            if full && !self.topics.contains_key(&found.name) {
                self.say_full(&found)?;
            }
            let topic = self.topics.entry(found.name.clone()).or_insert_with(fresh);
            if topic.id.is_none() && !full {
                topic.id = Some(self.follower.follow(&found.name, Take::Newest));
            }
            if found.publishers > 0 {
                topic.alive = Instant::now();
            }
        }
        let results = &self.results;
        let is_visible = |topic: &str| {
            let known = results.get(topic);
            known.is_some_and(|topic| topic.alive.elapsed() < KEEP_VIEW)
        };
        self.stage.keep_results(is_visible)?;
        let visible = self
            .topics
            .iter()
            .filter(|(_, topic)| topic.id.is_some() && topic.alive.elapsed() < KEEP_VIEW);
        self.stage
            .set_topics(visible.map(|(name, _)| name.as_str()))
    }

    /// Follows a topic of results that is new; clears what a writer that has ended left drawn.
    fn discover_result(&mut self, found: &TopicDetails, kind: ResultType) -> anyhow::Result<()> {
        if let Some(topic) = self.results.get_mut(&found.name) {
            let had_writer = std::mem::replace(&mut topic.has_writer, found.publishers > 0);
            if found.publishers > 0 {
                topic.alive = Instant::now();
            } else if had_writer {
                self.stage.clear_result(&found.name)?;
            }
            return Ok(());
        }
        if found.subscribers >= found.max_subscribers {
            if self.full.insert(found.name.clone()) {
                self.say_full(found)?;
            }
            return Ok(());
        }
        // Curves and lines show every result, all others the newest.
        let (take, max_hz) = match kind {
            ResultType::Scalars | ResultType::Control | ResultType::Text | ResultType::Bytes => {
                (Take::All, self.max_hz.max(EVERY_HZ))
            }
            _ => (Take::Newest, self.max_hz),
        };
        self.follower.listen(&found.name)?;
        let topic = Results {
            followed: FollowedResult::new(&found.name, take),
            pace: Pace::new(max_hz),
            alive: Instant::now(),
            has_writer: found.publishers > 0,
            given_up: false,
        };
        self.results.insert(found.name.clone(), topic);
        Ok(())
    }

    fn say_full(&self, found: &TopicDetails) -> anyhow::Result<()> {
        let sentence = format!(
            "{} is not shown: all its {} reader places are taken",
            found.name, found.max_subscribers
        );
        tracing::warn!("{sentence}");
        self.stage.say(rerun::TextLogLevel::WARN, &sentence)
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
            self.count_bad_items();
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

    /// Takes results and shows them, at most so many of a topic in one turn that a flood of one
    /// holds up nothing else.
    fn take_results(&mut self) -> anyhow::Result<()> {
        for (name, topic) in &mut self.results {
            if topic.given_up {
                continue;
            }
            // A topic that another program has spoilt must not end the viewing of all others.
            if let Err(error) = topic.followed.look(self.follower.bus()) {
                let sentence = format!("{name} is not shown: {error}");
                tracing::warn!("{sentence}");
                self.stage.say(rerun::TextLogLevel::WARN, &sentence)?;
                topic.given_up = true;
                continue;
            }
            for _ in 0..MAX_RESULTS_A_TURN {
                let Some(result) = topic.followed.take()? else {
                    break;
                };
                topic.alive = Instant::now();
                let epoch = result.header().epoch;
                // A result about another run of the simulator has no place in this recording.
                let is_foreign = epoch != 0 && self.epoch != 0 && epoch != self.epoch;
                if is_foreign || !topic.pace.admits(Instant::now()) {
                    continue;
                }
                let parts = ResultParts::of(&result, topic.followed.about());
                self.stage.show_result(&parts, age_nanos(&result))?;
                *self.shown.results.entry(name.clone()).or_insert(0) += 1;
            }
        }
        Ok(())
    }

    /// Adds up what the stage could not draw, before it is replaced.
    fn count_bad_items(&mut self) {
        for (topic, n) in self.stage.bad_items() {
            *self.shown.bad_items.entry(topic.clone()).or_insert(0) += n;
        }
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
