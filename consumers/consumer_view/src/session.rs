//! A viewing from start to end: shows the newest frame of every topic at a limited rate, with a new
//! rerun recording for every run of the simulator.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use consumer_kit::items::ResultParts;
use consumer_kit::{
    Change, Domain, ListedTopic, Listing, MAX_WAIT, Rhythm, Take, TopicId, Wish, WorldAt,
    file_of_run,
};
use rerun::RecordingStreamBuilder;
use schema_bus::{Bus, BusOptions, DocumentPublisher, ResultSample, TopicDetails, mono_now, names};
use schema_frames::{ActorList, Modality, ResultType, WorldInfo};
use schema_recording::pattern::matches;

use crate::layout::{APPLICATION, Place, SIM_TIME, TICK};
use crate::look::Look;
use crate::pace::Pace;
use crate::rerun;
use crate::rrd_file::{Health, record_into};
use crate::stage::Stage;
use crate::viewer::RERUN_VERSION;

/// How often topics are listed.
const LIST: Rhythm = Rhythm::steady(Duration::from_secs(1));
/// How often small messages are sent although they fill no batch.
const HURRY_EVERY: Duration = Duration::from_millis(250);
/// How long sending the last data may take.
const FLUSH_TIMEOUT: Duration = Duration::from_secs(20);

/// Document that says where the view is.
pub const VIEW: &str = "control/view";
/// How long topics may take to be found when the viewing ends by itself.
const SETTLE: Duration = Duration::from_secs(3);
/// Frames of one topic that are taken in one turn at most; as many as a reader may hold.
const MAX_FRAMES_A_TURN: usize = 2;
/// Results of one topic that are shown in one turn at most.
const MAX_RESULTS_A_TURN: usize = 32;
/// Most results per second that are shown of topics whose every result counts.
const EVERY_HZ: f64 = 200.0;

/// Where a view is: what another program needs to log into the same recording.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct ViewPlace {
    /// Address of the viewer, as rerun's SDKs take it; empty for a file.
    pub url: String,
    /// Name of the application in rerun.
    pub application_id: String,
    /// Name of the recording of this run of the simulator.
    pub recording_id: String,
    /// Version of rerun that the viewer has.
    pub rerun_version: String,
    /// Timeline of ticks.
    pub tick_timeline: String,
    /// Timeline of simulated time.
    pub time_timeline: String,
}

impl ViewPlace {
    fn new(options: &Options, run: u32) -> ViewPlace {
        let url = match &options.target {
            Target::Connect(url) => url.clone(),
            Target::Save(_) => String::new(),
        };
        // Two viewers of one domain into one window are two recordings.
        let process = std::process::id();
        ViewPlace {
            url,
            application_id: APPLICATION.to_owned(),
            recording_id: format!("{}-{process}-{run}", options.domain),
            rerun_version: RERUN_VERSION.to_owned(),
            tick_timeline: TICK.to_owned(),
            time_timeline: SIM_TIME.to_owned(),
        }
    }
}

/// How old frames are when they have been handed over, by milliseconds.
struct Ages {
    by_ms: Vec<u64>,
}

impl Default for Ages {
    fn default() -> Ages {
        // The last place is for all that are older.
        Ages {
            by_ms: vec![0; 2001],
        }
    }
}

impl Ages {
    fn note(&mut self, age_nanos: u64) {
        let at = (age_nanos / 1_000_000).min(self.by_ms.len() as u64 - 1);
        self.by_ms[at as usize] += 1;
    }

    /// The age that this share of frames does not exceed, milliseconds.
    fn percentile(&self, share: f64) -> usize {
        let n: u64 = self.by_ms.iter().sum();
        let mut rest = (n as f64 * share).ceil() as u64;
        let reached = self.by_ms.iter().position(|n| {
            rest = rest.saturating_sub(*n);
            rest == 0
        });
        reached.unwrap_or(0) + 1
    }

    fn say(&self) {
        let n: u64 = self.by_ms.iter().sum();
        if n > 0 {
            let [p50_ms, p99_ms] = [0.5, 0.99].map(|share| self.percentile(share));
            tracing::info!(
                frames = n,
                p50_ms,
                p99_ms,
                "age of frames when handed to rerun"
            );
        }
    }
}

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
    fn open(&self, place: &ViewPlace, run: u32, look: &Look) -> anyhow::Result<(Stage, Health)> {
        let builder =
            RecordingStreamBuilder::new(APPLICATION).recording_id(place.recording_id.as_str());
        let (rec, health) = match self {
            Target::Connect(url) => (builder.connect_grpc_opts(url.as_str())?, Health::default()),
            Target::Save(path) => {
                let path = file_of_run(path, run);
                anyhow::ensure!(
                    !path.exists(),
                    "{} exists already; choose another name or remove it first",
                    path.display()
                );
                record_into(builder, &path)?
            }
        };
        Ok((Stage::new(rec, look.clone())?, health))
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
    /// How things are drawn.
    pub look: Look,
    /// Patterns of the topics that are shown, with `*` and `?`; all if empty.
    pub topics: Vec<String>,
    /// Where to.
    pub target: Target,
    /// Whether to show the spectator's image too, which is rendered only for its readers.
    pub spectator: bool,
    /// Ends by itself after so many frames of every topic that has a writer.
    pub enough: Option<u64>,
}

impl Options {
    fn takes(&self, topic: &str) -> bool {
        let is_asked = self.topics.iter().any(|pattern| matches(pattern, topic));
        if topic == names::SPECTATOR_RGB {
            return self.spectator || is_asked;
        }
        is_asked || self.topics.is_empty()
    }

    /// How a listed topic is to be followed; `None` of one that is not shown.
    fn wish(&self, listed: ListedTopic<'_>, batches_said: &mut bool) -> Option<Wish> {
        let topic = listed.details;
        if !self.takes(&topic.name) {
            return None;
        }
        if names::is_batch(&topic.name) {
            if !std::mem::replace(batches_said, true) {
                tracing::info!(
                    topic = topic.name,
                    "batches are not shown: the topics of their cameras have the same images"
                );
            }
            return None;
        }
        // What the last result of a writer that has ended says is true no more.
        let is_old = topic.result.is_some() && topic.publishers == 0 && !listed.is_known;
        let rhythm = self.rhythm(topic).filter(|_| !is_old)?;
        Some(Wish::follow(rhythm.take))
    }

    /// How samples of a topic are taken, and how many are shown per second at most: of what happens
    /// seldom or makes a curve or a line every one, of all others the newest.
    fn rhythm(&self, topic: &TopicDetails) -> Option<Sampling> {
        let is_every = match (topic.result, topic.modality) {
            (Some(kind), _) => matches!(
                kind,
                ResultType::Scalars | ResultType::Control | ResultType::Text | ResultType::Bytes
            ),
            (None, Some(modality)) => {
                Place::new(&topic.name)?;
                if modality == Modality::Dvs && self.look.time_surface {
                    return Some(Sampling {
                        take: Take::All,
                        max_hz: self.max_hz,
                    });
                }
                modality == Modality::Imu || modality.is_event()
            }
            (None, None) => return None,
        };
        Some(match is_every {
            true => Sampling {
                take: Take::All,
                max_hz: self.max_hz.max(EVERY_HZ),
            },
            false => Sampling {
                take: Take::Newest,
                max_hz: self.max_hz,
            },
        })
    }
}

/// How samples of a topic are taken and shown.
struct Sampling {
    take: Take,
    max_hz: f64,
}

/// Name of a topic in a table of topics.
fn name_of(topics: &BTreeMap<String, Topic>, id: TopicId) -> Option<&str> {
    let mut topics = topics.iter();
    let found = topics.find(|(_, topic)| topic.id == id);
    found.map(|(name, _)| name.as_str())
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
    let name = format!("gantry-view-{}", std::process::id());
    let bus = Bus::open_with(&options.domain, &name, &options.bus)?;
    let lister = Bus::open_with(&options.domain, &format!("{name}-look"), &options.bus)?;
    let listing =
        Listing::start(lister, LIST).context("cannot start the thread that looks for topics")?;
    let mut domain = Domain::on(bus, listing);
    let documents = [names::WORLD_INFO, names::WORLD_MAP, names::WORLD_ACTORS]
        .map(|name| (name, domain.follow_document(name)));
    let view = ViewPlace::new(options, 1);
    let (stage, health) = options.target.open(&view, 1, &options.look)?;
    let mut session = Session {
        view,
        told: None,
        ages: Ages::default(),
        begun: Instant::now(),
        documents,
        domain,
        stage,
        health,
        options: options.clone(),
        frames: BTreeMap::new(),
        results: BTreeMap::new(),
        world_pace: Pace::new(options.max_hz),
        shown_tick: 0,
        epoch: 0,
        is_arranged: false,
        batches_said: false,
        hurried: Instant::now(),
        shown: Shown {
            n_runs: 1,
            ..Default::default()
        },
    };
    while !stop() && !session.has_enough() {
        session.turn()?;
    }
    session.ages.say();
    session.count_bad_items();
    session.finish_stage()?;
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
    /// The document that says where this view is; `None` while another viewer's is there.
    told: Option<DocumentPublisher>,
    domain: Domain,
    documents: [(&'static str, TopicId); 3],
    stage: Stage,
    health: Health,
    options: Options,
    view: ViewPlace,
    ages: Ages,
    begun: Instant,
    /// By topic.
    frames: BTreeMap<String, Topic>,
    /// By topic.
    results: BTreeMap<String, Topic>,
    world_pace: Pace,
    shown_tick: u64,
    epoch: u64,
    /// Whether the stage knows which topics there are.
    is_arranged: bool,
    batches_said: bool,
    hurried: Instant,
    shown: Shown,
}

/// A topic of frames or results that is shown.
struct Topic {
    id: TopicId,
    pace: Pace,
}

impl Session {
    fn turn(&mut self) -> anyhow::Result<()> {
        self.discover()?;
        self.domain.wait(MAX_WAIT)?;
        self.take_over()?;
        if let Some(told) = &self.told {
            told.greet();
        }
        schema_stages::post(self.shown_tick);
        self.take_documents()?;
        self.take_frames()?;
        self.take_results()?;
        self.take_world()?;
        if self.hurried.elapsed() >= HURRY_EVERY {
            self.hurried = Instant::now();
            self.stage.hurry()?;
            self.health.check()?;
        }
        Ok(())
    }

    /// Waits until all of this run's recording has left this process.
    fn finish_stage(&self) -> anyhow::Result<()> {
        let flushed = self.stage.flush(FLUSH_TIMEOUT);
        // Why a file could not be written says more than that it was not.
        self.health.check()?;
        flushed
    }

    /// Follows topics that are new and forgets the views of those that have gone.
    fn discover(&mut self) -> anyhow::Result<()> {
        let (options, batches_said) = (&self.options, &mut self.batches_said);
        let is_new = self
            .domain
            .look(|listed| options.wish(listed, batches_said))?;
        self.take_over()?;
        if is_new {
            self.tell_place();
        }
        if !is_new && self.is_arranged {
            return Ok(());
        }
        self.is_arranged = true;
        let results = &self.results;
        self.stage
            .keep_results(|topic| results.contains_key(topic))?;
        self.stage
            .set_topics(self.frames.keys().map(String::as_str))
    }

    /// Begins and ends to show topics as they came and went.
    fn take_over(&mut self) -> anyhow::Result<()> {
        while let Some(change) = self.domain.change() {
            match change {
                Change::Found { id, details } => {
                    let Some(rhythm) = self.options.rhythm(&details) else {
                        continue;
                    };
                    let topic = Topic {
                        id,
                        pace: Pace::new(rhythm.max_hz),
                    };
                    let topics = match details.result {
                        Some(_) => &mut self.results,
                        None => &mut self.frames,
                    };
                    topics.insert(details.name, topic);
                }
                Change::Full(details) => self.say_full(&details)?,
                // A topic that another program has spoilt must not end the viewing of all others.
                Change::Refused { id, error } => match name_of(&self.results, id) {
                    Some(topic) => {
                        let sentence = format!("{topic} is not shown: {error}");
                        tracing::warn!("{sentence}");
                        self.stage.say(rerun::TextLogLevel::WARN, &sentence)?;
                        self.domain.want(id, false);
                    }
                    None => return Err(error.into()),
                },
                Change::Silent(id) => {
                    if let Some(topic) = name_of(&self.results, id) {
                        self.stage.clear_result(topic)?;
                    }
                }
                // Sensors that come and go would otherwise leave a port each.
                Change::Ended(id) => {
                    self.domain.leave(id);
                    self.frames.retain(|_, topic| topic.id != id);
                    self.results.retain(|_, topic| topic.id != id);
                }
                Change::Unlisted(_) => {}
            }
        }
        Ok(())
    }

    /// Says on the bus where this view is, for programs that log into it, too; not while another
    /// viewer of the domain does.
    fn tell_place(&mut self) {
        if self.told.is_some() || self.view.url.is_empty() {
            return;
        }
        if let Ok(told) = self.domain.bus().document_publisher(VIEW) {
            self.told = Some(told);
            self.send_place();
        }
    }

    fn send_place(&mut self) {
        if let Some(told) = &mut self.told
            && let Err(error) = told.send_json(&self.view, self.epoch, self.shown_tick)
        {
            tracing::warn!(%error, "other programs cannot find this view");
        }
    }

    /// Whether what was asked for has been shown.
    fn has_enough(&self) -> bool {
        let Some(enough) = self.options.enough else {
            return false;
        };
        let is_due = |(name, topic): (&String, &Topic)| {
            let is_seldom = Place::new(name).is_some_and(|place| place.modality.is_event());
            self.domain.is_wanted(topic.id) && !is_seldom
        };
        let mut due = self.frames.iter().filter(|it| is_due(*it));
        let has = |name: &String| self.shown.frames.get(name).is_some_and(|n| *n >= enough);
        let is_settled = self.begun.elapsed() >= SETTLE && self.shown_tick > 0;
        is_settled && due.all(|(name, _)| has(name))
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
            self.finish_stage()?;
            self.view = ViewPlace::new(&self.options, self.shown.n_runs);
            let run = self.shown.n_runs;
            (self.stage, self.health) =
                self.options
                    .target
                    .open(&self.view, run, &self.options.look)?;
            self.send_place();
            self.shown_tick = 0;
            self.is_arranged = false;
        }
        self.epoch = epoch;
        Ok(())
    }

    fn take_documents(&mut self) -> anyhow::Result<()> {
        for idx in 0..self.documents.len() {
            let (name, id) = self.documents[idx];
            let Some(document) = self.domain.take_document(id)?.cloned() else {
                continue;
            };
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
        static TAKE: schema_stages::Stage = schema_stages::Stage::new("take");
        let mut taken = Vec::new();
        for (name, topic) in &mut self.frames {
            let _span = TAKE.span();
            for _ in 0..MAX_FRAMES_A_TURN {
                let Some(frame) = self.domain.take_frame(topic.id)? else {
                    break;
                };
                if topic.pace.admits(Instant::now()) {
                    let latency_nanos = mono_now()
                        .0
                        .saturating_sub(frame.header().published_mono_nanos);
                    taken.push((name.clone(), frame, latency_nanos));
                } else {
                    self.stage.pass(name, frame.header(), &frame);
                }
            }
        }
        for (name, frame, latency_nanos) in taken {
            let header = *frame.header();
            self.meet(header.epoch)?;
            if let Some(world) = self.domain.world_at(header.tick)? {
                self.stage.remember(&world.header, &world.records);
                self.show_world(&world)?;
            }
            self.stage
                .show_frame(&name, &header, &frame, latency_nanos)?;
            self.ages
                .note(mono_now().0.saturating_sub(header.published_mono_nanos));
            *self.shown.frames.entry(name).or_insert(0) += 1;
        }
        Ok(())
    }

    /// Takes results and shows them, at most so many of a topic in one turn that a flood of one
    /// holds up nothing else.
    fn take_results(&mut self) -> anyhow::Result<()> {
        for (name, topic) in &mut self.results {
            for _ in 0..MAX_RESULTS_A_TURN {
                let Some(result) = self.domain.take_result(topic.id)? else {
                    break;
                };
                let Some(results) = self.domain.results(topic.id) else {
                    break;
                };
                let epoch = result.header().epoch;
                // A result about another run of the simulator has no place in this recording.
                let is_foreign = epoch != 0 && self.epoch != 0 && epoch != self.epoch;
                if is_foreign || !topic.pace.admits(Instant::now()) {
                    continue;
                }
                let parts = ResultParts::of(&result, results.about());
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
        let Some(world) = self.domain.newest_world()? else {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ages_are_told_as_the_millisecond_that_they_do_not_exceed() {
        let mut ages = Ages::default();
        (0..100).for_each(|ms| ages.note(ms * 1_000_000 + 5));
        assert_eq!((ages.percentile(0.5), ages.percentile(0.99)), (50, 99));
        ages.note(u64::MAX);
        assert_eq!(ages.percentile(1.0), 2001);
    }
}
