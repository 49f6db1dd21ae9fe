//! A recording from start to end: follows every topic, converts and queues what arrives. In
//! lockstep it acknowledges a tick when everything of it is queued.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use consumer_kit::{Change, Domain, Listing, Rhythm, Take, TopicId, Wish};
use schema_bus::{Bus, BusError, TopicDetails, mono_now, names};

use crate::asker::Asker;
use crate::documents::{Documents, Run};
use crate::in_step::InStep;
use crate::journal::Journal;
use crate::options::Options;
use crate::queue::{Hold, Payload};
use crate::result_topics::{MAX_A_TURN, ResultTopics};
use crate::scenery::Scenery;
use crate::select::Select;
use crate::sink::{Loss, Output, Sink, wall_minus_mono_nanos};
use crate::stages;
use consumer_forms::foxglove::frames::{TopicName, frame_entries};
use consumer_forms::foxglove::snapshots::SnapshotConverter;
use schema_recording::write::Written;

/// Longest wait for a wake-up: how often documents and the shutdown flag are checked.
const MAX_WAIT: Duration = Duration::from_millis(20);
/// How often joining lockstep is tried.
const JOIN_EVERY: Duration = Duration::from_millis(250);
/// How often topics are listed.
const LIST: Rhythm = Rhythm {
    rest: Duration::from_millis(500),
    longest: Duration::from_secs(2),
};

/// The outcome of a recording.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// The files: one per run of the simulator, whose clock starts again with each.
    pub files: Vec<(PathBuf, Written)>,
    /// Frames and results recorded per source.
    pub recorded: BTreeMap<String, u64>,
    /// Frames and results that are missing per source, and why.
    pub lost: BTreeMap<String, Loss>,
    /// Items of results per source that only the lossless messages hold, because they are broken:
    /// boxes that are not finite, masks beyond their image.
    pub bad_items: BTreeMap<String, u64>,
}

/// Records until `stop` says so.
///
/// # Errors
/// If a file cannot be made or written, or the bus cannot be joined.
pub fn record(options: &Options, stop: &dyn Fn() -> bool) -> anyhow::Result<Report> {
    let mut session = Session::open(options)?;
    let outcome = session.run(stop);
    // If the writer failed, its own error says more than the session's "the writer has ended".
    let report = session.close()?;
    outcome.map(|()| report)
}

/// A followed topic of frames: its names in the file, kept so that no frame has to build them.
#[derive(Debug)]
struct FrameTopic {
    name: Arc<TopicName>,
    source: Arc<str>,
    /// Its frames that coders have borrowed.
    held: Hold,
}

struct Session {
    // Dropped in this order: ports before the node that made them.
    lockstep: Option<InStep>,
    journal: Journal,
    scenery: Scenery,
    domain: Domain,
    frames: BTreeMap<TopicId, FrameTopic>,
    results: ResultTopics,
    snapshots: TopicId,
    documents: Documents,
    /// What was lost of topics that are followed no longer.
    left: BTreeMap<String, Loss>,
    /// Batches that were met, and are not recorded.
    batches: BTreeSet<String>,
    options: Options,
    snapshot_converter: SnapshotConverter,
    sink: Sink,
    run: Run,
    newest_tick: u64,
    /// Once it is told to stop: the tick with which the recording ends.
    last_tick: Option<u64>,
    /// Whether topics are listed once more before the next tick is acknowledged, as after a command
    /// that made some.
    list_before_ack: bool,
    /// Whether the first snapshot of this run has arrived. Before it, documents have no simulated
    /// time.
    has_snapshot: bool,
    waiting_said: bool,
    last_try: Option<Instant>,
    name: String,
}

impl Session {
    fn open(options: &Options) -> anyhow::Result<Session> {
        let name = format!("gantry-record-{}", std::process::id());
        let bus = Bus::open_with(&options.domain, &name, &options.bus)?;
        let sink = Sink {
            output: Some(Output::create(options, 1)?),
            n_runs: 1,
            finished: Vec::new(),
            wait: options.lockstep,
            wall_minus_mono_nanos: wall_minus_mono_nanos()?,
            recorded: BTreeMap::new(),
            full: BTreeMap::new(),
            full_said: false,
        };
        let asker =
            |what: &str| Asker::start(&options.domain, &format!("{name}-{what}"), &options.bus);
        let lister = Bus::open_with(&options.domain, &format!("{name}-look"), &options.bus)?;
        let listing = Listing::start(lister, LIST)
            .context("cannot start the thread that looks for topics")?;
        let mut domain = Domain::on(bus, listing);
        Ok(Session {
            lockstep: None,
            journal: Journal::new(asker("journal")?),
            scenery: Scenery::new(asker("scenery")?),
            snapshots: domain.follow_snapshots(),
            documents: Documents::follow(&mut domain),
            domain,
            frames: BTreeMap::new(),
            results: ResultTopics::new(),
            left: BTreeMap::new(),
            batches: BTreeSet::new(),
            options: options.clone(),
            snapshot_converter: SnapshotConverter::default(),
            sink,
            run: Run::default(),
            newest_tick: 0,
            last_tick: None,
            list_before_ack: false,
            has_snapshot: false,
            waiting_said: false,
            last_try: None,
            name,
        })
    }

    fn run(&mut self, stop: &dyn Fn() -> bool) -> anyhow::Result<()> {
        while !stop() {
            self.discover()?;
            self.wait()?;
            schema_stages::post(self.newest_tick);
            self.drain()?;
            self.fetch_scenery(self.lockstep.is_some())?;
            match self.lockstep {
                Some(_) => self.acknowledge()?,
                None => self.journal.fetch_if_due(self.run, &mut self.sink)?,
            }
        }
        self.drain_snapshots()?;
        self.acknowledge()?;
        self.journal.fetch(self.run, &mut self.sink)?;
        self.fetch_scenery(true)?;
        // Topics are taken one by one. Without a last tick, one would run ahead of the next by all that
        // the simulator makes meanwhile.
        self.last_tick = self.has_snapshot.then_some(self.newest_tick);
        // Leaving lockstep first lets the simulator go on while the file is finished.
        self.lockstep = None;
        self.drain()?;
        self.drain_documents(!self.has_snapshot)?;
        self.documents
            .attach_map(true, &self.domain, self.run, &mut self.sink)
    }

    /// Follows topics that are new.
    fn discover(&mut self) -> anyhow::Result<()> {
        let (select, batches) = (&self.options.select, &mut self.batches);
        self.domain
            .look(|listed| wish(select, batches, listed.details))?;
        self.take_over()?;
        self.join_lockstep()
    }

    /// Follows and opens what there is now; the list of the thread may be seconds old.
    fn discover_now(&mut self) -> anyhow::Result<()> {
        let (select, batches) = (&self.options.select, &mut self.batches);
        self.domain
            .look_now(|listed| wish(select, batches, listed.details))?;
        self.domain.open()?;
        self.take_over()
    }

    /// Begins and ends the recording of topics as they came and went.
    fn take_over(&mut self) -> anyhow::Result<()> {
        while let Some(change) = self.domain.change() {
            match change {
                Change::Found { id, details } => self.begin(id, &details),
                Change::Full(details) => tracing::error!(
                    topic = details.name,
                    limit = details.max_subscribers,
                    "cannot record the topic: all its reader places are taken; stop another reader"
                ),
                // A topic that another program has spoilt must not end the recording of all others.
                Change::Refused { id, error } => match self.results.source(id) {
                    Some(topic) => {
                        tracing::error!(topic = &**topic, %error, "cannot record the topic");
                        self.domain.want(id, false);
                    }
                    None => return Err(error.into()),
                },
                Change::Ended(id) => self.end(id)?,
                Change::Silent(_) | Change::Unlisted(_) => {}
            }
        }
        Ok(())
    }

    fn begin(&mut self, id: TopicId, details: &TopicDetails) {
        if details.result.is_some() {
            self.results.begin(id, &details.name);
        } else if let Some(name) = TopicName::new(&details.name) {
            let topic = FrameTopic {
                name: name.into(),
                source: details.name.as_str().into(),
                held: Hold::default(),
            };
            self.frames.insert(id, topic);
        }
    }

    /// Takes what waits in a topic whose writer has ended, closes it, and keeps what was lost of
    /// it.
    fn end(&mut self, id: TopicId) -> anyhow::Result<()> {
        self.drain()?;
        self.frames.remove(&id);
        self.results.end(id);
        if let Some(report) = self.domain.leave(id) {
            let loss = self.left.entry(report.topic).or_default();
            loss.on_bus(report.counts.lost, report.counts.refused);
        }
        Ok(())
    }

    fn join_lockstep(&mut self) -> anyhow::Result<()> {
        let lost = self
            .lockstep
            .as_ref()
            .is_some_and(|step| self.run.epoch != 0 && step.epoch() != self.run.epoch);
        let wait = self.last_try.is_some_and(|at| at.elapsed() < JOIN_EVERY);
        if !self.options.lockstep
            || (self.lockstep.is_some() && !lost)
            || wait
            || self.frames.is_empty()
        {
            return Ok(());
        }
        self.last_try = Some(Instant::now());
        self.lockstep = None;
        // All topics must be open before the simulator waits for this recorder, else the first tick
        // would be missed. Once the world has a publisher all its topics exist; a list from before
        // may lack some.
        if !self.domain.bus().daemon_alive()? {
            return Ok(());
        }
        self.discover_now()?;
        self.drain_results()?;
        let name = self.options.lockstep_name.as_ref().unwrap_or(&self.name);
        match InStep::join(self.domain.bus(), name, &format!("{}-end", self.name)) {
            Ok(step) => {
                self.lockstep = Some(step);
                self.list_before_ack = true;
            }
            Err(error) => {
                if !std::mem::replace(&mut self.waiting_said, true) {
                    tracing::info!(%error, "not in lockstep yet, trying on");
                }
            }
        }
        Ok(())
    }

    fn wait(&mut self) -> anyhow::Result<()> {
        match &self.lockstep {
            // In lockstep a tick begins with its snapshot; the domain only looks for topics here.
            Some(step) => {
                self.domain.wait(Duration::ZERO)?;
                step.wait(MAX_WAIT)?;
            }
            None => drop(self.domain.wait(MAX_WAIT)?),
        }
        self.take_over()
    }

    fn drain(&mut self) -> anyhow::Result<()> {
        let _span = stages::TAKE.span();
        // Before the first snapshot a document has no simulated time, so it waits on the bus.
        if self.has_snapshot {
            self.drain_documents(false)?;
        }
        self.drain_snapshots()?;
        let ids: Vec<TopicId> = self.frames.keys().copied().collect();
        for id in ids {
            while let Some(frame) = self.domain.take_frame(id)? {
                let (tick, epoch) = (frame.header().tick, frame.header().epoch);
                if (self.last_tick).is_some_and(|last| tick > last || epoch != self.run.epoch) {
                    break;
                }
                if tick > self.newest_tick || epoch != self.run.epoch {
                    // Its snapshot was sent before it.
                    self.drain_snapshots()?;
                }
                let Some(FrameTopic { name, source, held }) = self.frames.get(&id) else {
                    continue;
                };
                let header = *frame.header();
                if self.run.epoch != 0 && header.epoch != self.run.epoch {
                    tracing::debug!(
                        topic = &**source,
                        tick = header.tick,
                        "left out: a frame of a run whose file is finished"
                    );
                    continue;
                }
                let extras = self.snapshot_converter.frame_extras(name, &header);
                let sink = &self.sink;
                if !self.options.coding.is_plain() {
                    let payload = Payload::of(frame, held, |n_bytes| sink.buffer(n_bytes));
                    self.sink
                        .put_frame(source, name, &header, payload, extras)?;
                    continue;
                }
                let mut entries =
                    frame_entries(name, &header, &frame, &mut |n_bytes| sink.buffer(n_bytes));
                entries.extend(extras);
                self.sink.put(
                    source,
                    header.seq,
                    header.sim_nanos,
                    header.published_mono_nanos,
                    entries,
                )?;
            }
        }
        self.drain_results()
    }

    fn drain_results(&mut self) -> anyhow::Result<()> {
        for id in self.results.ids() {
            let Some(source) = self.results.source(id).cloned() else {
                continue;
            };
            for _ in 0..MAX_A_TURN {
                let Some(result) = self.domain.take_result(id)? else {
                    break;
                };
                let header = *result.header();
                if header.epoch != self.run.epoch && header.epoch != 0 {
                    // The snapshots of its run were sent before it.
                    self.drain_snapshots()?;
                }
                if self.run.epoch != 0 && header.epoch != 0 && header.epoch != self.run.epoch {
                    tracing::debug!(
                        topic = &*source,
                        tick = header.tick,
                        "left out: a result about a run whose file is finished"
                    );
                    continue;
                }
                let newest = self.has_snapshot.then_some(self.run.sim_nanos);
                let sim_nanos = self.results.sim_nanos(&result, newest);
                if let Some((about, found, entry)) = self.results.description(id, &self.domain) {
                    let revision = found.header.revision;
                    self.sink
                        .put(&about, revision, sim_nanos, mono_now().0, vec![entry])?;
                }
                let sink = &self.sink;
                let entries =
                    self.results
                        .entries(id, &self.domain, &result, sim_nanos, &mut |n_bytes| {
                            sink.buffer(n_bytes)
                        });
                let published = header.published_mono_nanos;
                self.sink
                    .put(&source, header.seq, sim_nanos, published, entries)?;
            }
        }
        Ok(())
    }

    fn drain_snapshots(&mut self) -> anyhow::Result<()> {
        if self.last_tick.is_some() {
            return Ok(());
        }
        let source: Arc<str> = names::WORLD_SNAPSHOT.into();
        loop {
            match self.domain.take_snapshot(self.snapshots) {
                Ok(Some(snapshot)) => {
                    let header = snapshot.header();
                    self.meet(header.epoch)?;
                    let is_first = !std::mem::replace(&mut self.has_snapshot, true);
                    (self.run.sim_nanos, self.newest_tick) = (header.sim_nanos, header.tick);
                    self.scenery.look(header);
                    if is_first {
                        self.drain_documents(true)?;
                    }
                    let _span = stages::SNAPSHOTS.span();
                    let entries = self
                        .snapshot_converter
                        .snapshot_entries(header, snapshot.records());
                    self.sink.put(
                        &source,
                        header.tick,
                        header.sim_nanos,
                        header.published_mono_nanos,
                        entries,
                    )?;
                }
                Ok(None) => return Ok(()),
                Err(error @ BusError::BadSample { .. }) => {
                    tracing::warn!(%error, "a snapshot is left out")
                }
                Err(other) => return Err(other.into()),
            }
        }
    }

    /// Begins a new file for a new epoch: that is a new run of the simulator, whose clock starts
    /// again.
    fn meet(&mut self, epoch: u64) -> anyhow::Result<()> {
        if epoch == self.run.epoch {
            return Ok(());
        }
        if self.run.epoch != 0 {
            self.documents
                .attach_map(true, &self.domain, self.run, &mut self.sink)?;
            self.sink.finish(&self.losses())?;
            self.sink.n_runs = self.sink.n_runs.saturating_add(1);
            let output = Output::create(&self.options, self.sink.n_runs)?;
            tracing::info!(file = %output.path.display(), "the simulator was restarted; its new run goes into a new file");
            self.sink.output = Some(output);
            self.snapshot_converter = SnapshotConverter::default();
            self.results.begin_file();
            self.lockstep = None;
            (self.newest_tick, self.run.sim_nanos, self.has_snapshot) = (0, 0, false);
            self.documents.begin_file();
            self.journal.begin_file();
            self.scenery.begin_file();
        }
        self.run.epoch = epoch;
        Ok(())
    }

    fn drain_documents(&mut self, all: bool) -> anyhow::Result<()> {
        self.documents.drain(
            all,
            &mut self.domain,
            self.run,
            &mut self.snapshot_converter,
            &mut self.sink,
        )
    }

    /// Files the map's objects if they have changed; `wait`: before the next tick, not a little
    /// later.
    fn fetch_scenery(&mut self, wait: bool) -> anyhow::Result<()> {
        self.scenery.fetch_if_due(wait, self.run, &self.sink)
    }

    /// In lockstep: acknowledges a tick after everything of it was taken.
    fn acknowledge(&mut self) -> anyhow::Result<()> {
        let (tick, epoch) = (self.newest_tick, self.run.epoch);
        let Some(step) = self.lockstep.as_mut().filter(|step| step.epoch() == epoch) else {
            return Ok(());
        };
        if !step.is_complete(tick, &mut self.journal, self.run, &mut self.sink)? {
            return Ok(());
        }
        if std::mem::take(&mut self.list_before_ack) | self.journal.made_topics() {
            // Others may have joined later, but before this tick, and brought topics of their own,
            // or a command has made a sensor. A fast run may be over before the next list.
            self.discover_now()?;
        }
        self.drain()?;
        match &mut self.lockstep {
            Some(step) => step.ack(tick),
            None => Ok(()),
        }
    }

    fn losses(&self) -> BTreeMap<String, Loss> {
        let mut lost = self.left.clone();
        for report in self.domain.reports() {
            let loss = lost.entry(report.topic).or_default();
            loss.on_bus(report.counts.lost, report.counts.refused);
        }
        for (topic, n) in &self.sink.full {
            lost.entry(topic.clone()).or_default().queue_full = *n;
        }
        lost.retain(|_, loss| loss.total() > 0);
        lost
    }

    fn close(mut self) -> anyhow::Result<Report> {
        let lost = self.losses();
        self.sink.finish(&lost)?;
        Ok(Report {
            files: self.sink.finished,
            recorded: self.sink.recorded,
            lost,
            bad_items: self.results.bad_items(),
        })
    }
}

/// Whether and how a topic is recorded.
fn wish(select: &Select, batches: &mut BTreeSet<String>, topic: &TopicDetails) -> Option<Wish> {
    let is_recorded = topic.modality.is_some() || topic.result.is_some();
    if !is_recorded || !select.takes(&topic.name) {
        return None;
    }
    if names::is_batch(&topic.name) {
        if batches.insert(topic.name.clone()) {
            tracing::info!(
                topic = topic.name,
                "a batch is not recorded: the topics of its cameras have the same images"
            );
        }
        return None;
    }
    let is_named = topic.result.is_some() || TopicName::new(&topic.name).is_some();
    is_named.then(|| Wish::follow(Take::All))
}
