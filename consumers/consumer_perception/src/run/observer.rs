//! What the benchmark sees on the bus while a program runs: results, frames of the inputs, and
//! snapshots. It only looks; no writer waits for it or wakes it.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;
use std::time::{Duration, Instant};

use schema_bus::{
    Bus, BusError, DocumentReader, FrameReader, ResultReader, SnapshotReader, TopicKind, names,
};
use schema_frames::{About, ResultType};

use crate::capture::{Body, BodyStore, CapturedResult, Clock, SentFrame};
use crate::suite::{Program, Suite};

/// Time between two looks for new topics while some are missing, and afterwards.
const LOOK_FOR_TOPICS: [Duration; 2] = [Duration::from_millis(100), Duration::from_secs(1)];
/// Results of a topic that are taken in one look, so that a program that floods it cannot hold the
/// benchmark there.
const MAX_AT_ONCE: usize = 256;
/// Most topics of results of one program.
const MAX_TOPICS: usize = 64;
/// Sentences about broken results that are kept.
const MAX_SENTENCES: usize = 3;

/// A topic of results.
#[derive(Debug)]
struct ResultTopic {
    topic: Arc<str>,
    kind: ResultType,
    reader: ResultReader,
    /// Its description. The writer hands it to readers with its next result, so it must be open
    /// before the last one.
    about: Option<DocumentReader>,
    /// Name of the task that it is scored as; `None` if nobody asked for it.
    task: Option<String>,
    /// Whether the task was found by a result, and not only by the topic's type.
    is_settled: bool,
    /// Ticks that were answered in the epoch at hand.
    answered: BTreeSet<u64>,
    n_refused_said: usize,
}

/// Everything that is followed.
#[derive(Debug)]
pub struct Observer<'a> {
    suite: &'a Suite,
    program: &'a Program,
    /// Topics of frames and results that the program gets.
    inputs: BTreeMap<String, Option<Input>>,
    results: Vec<ResultTopic>,
    snapshots: Option<SnapshotReader>,
    next_search: Instant,
    next_abouts: Instant,
    bodies: BodyStore,
    keep_bodies: bool,
    max_results: usize,
    /// Epoch and tick of the newest snapshot.
    pub newest: Option<(u64, u64)>,
    /// Simulated time of that snapshot, and of its tick's end from its begin, nanoseconds.
    pub newest_nanos: (u64, u64),
    /// Results so far.
    pub captured: Vec<CapturedResult>,
    /// Frames that were seen, by topic, epoch and tick, with their number, simulated time and time
    /// of publication.
    pub seen: HashMap<(Arc<str>, u64, u64), SentFrame>,
    /// Frames of [`Observer::count`]'s topic so far.
    pub n_counted: u64,
    counted: Option<(String, u64)>,
    /// Whether time runs.
    pub has_begun: bool,
    /// Simulated time over the monotonic clock.
    pub clock: Clock,
    /// What topics say about themselves.
    pub abouts: BTreeMap<Arc<str>, About>,
    /// Results that were not kept.
    pub n_unkept: u64,
    /// What is wrong with results, a sentence each.
    pub faults: Vec<String>,
    /// Longest time from a frame's publication to its answer's.
    pub longest_answer: Duration,
    /// The same of answers that came while their tick was held, so without those that were late.
    pub longest_held: Duration,
}

/// A topic that the program gets.
#[derive(Debug)]
enum Input {
    Frames(Arc<str>, FrameReader),
    Results(Arc<str>, ResultReader),
}

impl Input {
    fn next(&mut self) -> anyhow::Result<Option<SentFrame>> {
        Ok(match self {
            Input::Frames(topic, reader) => reader.next()?.map(|frame| {
                let header = frame.header();
                SentFrame {
                    topic: topic.clone(),
                    tick: header.tick,
                    seq: header.seq,
                    epoch: header.epoch,
                    sim_nanos: header.sim_nanos,
                    published_mono_nanos: header.published_mono_nanos,
                }
            }),
            Input::Results(topic, reader) => reader.next()?.map(|result| {
                let header = result.header();
                SentFrame {
                    topic: topic.clone(),
                    tick: header.tick,
                    seq: header.seq,
                    epoch: header.epoch,
                    sim_nanos: header.sim_nanos,
                    published_mono_nanos: header.published_mono_nanos,
                }
            }),
        })
    }
}

impl<'a> Observer<'a> {
    /// Follows the inputs and every topic of results that is none of them.
    pub fn new(
        suite: &'a Suite,
        program: &'a Program,
        inputs: impl IntoIterator<Item = String>,
        keep_bodies: bool,
        max_results: usize,
    ) -> Observer<'a> {
        Observer {
            suite,
            program,
            inputs: inputs.into_iter().map(|topic| (topic, None)).collect(),
            results: Vec::new(),
            snapshots: None,
            next_search: Instant::now(),
            next_abouts: Instant::now(),
            bodies: BodyStore::default(),
            keep_bodies,
            max_results,
            newest: None,
            newest_nanos: (0, 0),
            captured: Vec::new(),
            seen: HashMap::new(),
            n_counted: 0,
            counted: None,
            has_begun: false,
            clock: Clock::default(),
            abouts: BTreeMap::new(),
            n_unkept: 0,
            faults: Vec::new(),
            longest_answer: Duration::ZERO,
            longest_held: Duration::ZERO,
        }
    }

    /// Looks for topics that are missing. Returns whether there are new ones.
    ///
    /// # Errors
    /// If the bus fails.
    pub fn search(&mut self, bus: &Bus) -> anyhow::Result<bool> {
        if Instant::now() < self.next_search {
            return Ok(false);
        }
        let n_before = self.results.len();
        if self.snapshots.is_none() && bus.exists(names::WORLD_SNAPSHOT) {
            self.snapshots = Some(bus.snapshot_reader()?);
        }
        for details in bus.topics()? {
            let name: Arc<str> = details.name.as_str().into();
            match (details.kind, details.result) {
                (TopicKind::Frames, _) => {
                    if let Some(input @ None) = self.inputs.get_mut(&*name) {
                        *input = may_come(bus.frame_reader(&name))?
                            .map(|reader| Input::Frames(name, reader));
                    }
                }
                (TopicKind::Results, Some(kind)) => match self.inputs.get_mut(&*name) {
                    Some(input @ None) => {
                        *input = may_come(bus.result_reader(&name))?
                            .map(|reader| Input::Results(name, reader));
                    }
                    Some(_) => {}
                    None => self.follow(bus, name, kind)?,
                },
                _ => {}
            }
        }
        let is_whole = self.inputs.values().all(Option::is_some) && self.has_all_results();
        self.next_search = Instant::now() + LOOK_FOR_TOPICS[usize::from(is_whole)];
        Ok(self.results.len() > n_before)
    }

    fn follow(&mut self, bus: &Bus, topic: Arc<str>, kind: ResultType) -> anyhow::Result<()> {
        if self.results.len() >= MAX_TOPICS || self.results.iter().any(|it| it.topic == topic) {
            return Ok(());
        }
        let Some(reader) = may_come(bus.result_reader(&topic))? else {
            return Ok(());
        };
        let task = self.suite.task_of(self.program, &topic, kind, &[]);
        self.results.push(ResultTopic {
            about: None,
            task: task.map(|task| task.name.clone()),
            is_settled: false,
            answered: BTreeSet::new(),
            n_refused_said: 0,
            topic,
            kind,
            reader,
        });
        Ok(())
    }

    /// Whether every topic of results that the suite names has a writer; without names, whether one
    /// that fits a task has.
    pub fn has_all_results(&self) -> bool {
        let has = |topic: &str| {
            let found = self.results.iter().find(|it| &*it.topic == topic);
            found.is_some_and(|it| it.reader.has_writer())
        };
        match self.program.results.is_empty() {
            false => self.program.results.keys().all(|topic| has(topic)),
            // Whoever drives need not say anything.
            true if self.suite.is_closed_loop() => true,
            true => self
                .results
                .iter()
                .any(|it| it.task.is_some() && it.reader.has_writer()),
        }
    }

    /// Topics of results that are there.
    pub fn result_topics(&self) -> impl Iterator<Item = &str> {
        self.results.iter().map(|it| &*it.topic)
    }

    /// Topics that are scored, with the names of their tasks: those that the suite names, whether
    /// they are there or not, or those that were found.
    pub fn awaited(&self) -> Vec<(String, String)> {
        match self.program.results.is_empty() {
            false => self.program.results.clone().into_iter().collect(),
            true => self
                .results
                .iter()
                .filter_map(|it| Some((it.topic.to_string(), it.task.clone()?)))
                .collect(),
        }
    }

    /// Whether a topic has answered a tick of the epoch at hand.
    pub fn has_answered(&self, topic: &str, tick: u64) -> bool {
        let found = self.results.iter().find(|it| &*it.topic == topic);
        found.is_some_and(|it| it.answered.contains(&tick))
    }

    /// Whether a frame of one of these topics was seen in this epoch and tick.
    pub fn has_seen(&self, topics: &[String], epoch: u64, tick: u64) -> bool {
        topics.iter().any(|topic| {
            let topic: Arc<str> = topic.as_str().into();
            self.seen.contains_key(&(topic, epoch, tick))
        })
    }

    /// Takes everything that waits.
    ///
    /// # Errors
    /// If the bus or the disk fails.
    pub fn look(&mut self, bus: &Bus) -> anyhow::Result<()> {
        self.take_snapshots()?;
        self.take_inputs()?;
        for at in 0..self.results.len() {
            self.take_results(at)?;
        }
        if Instant::now() >= self.next_abouts {
            self.next_abouts = Instant::now() + LOOK_FOR_TOPICS[1];
            self.take_abouts(bus);
        }
        Ok(())
    }

    fn take_snapshots(&mut self) -> anyhow::Result<()> {
        let Some(reader) = &mut self.snapshots else {
            return Ok(());
        };
        for _ in 0..MAX_AT_ONCE {
            let Some(snapshot) = reader.next()? else {
                break;
            };
            let header = snapshot.header();
            let now = (header.epoch, header.tick);
            if self.newest.is_none_or(|(epoch, _)| epoch != header.epoch) {
                for topic in &mut self.results {
                    topic.answered.clear();
                }
            }
            self.newest = Some(now);
            self.newest_nanos = (header.sim_nanos, header.period_nanos);
            // What is shown before time begins says nothing about its pace.
            if self.has_begun {
                self.clock
                    .push(header.sim_nanos, header.published_mono_nanos);
            }
        }
        Ok(())
    }

    /// Counts frames of a topic from a simulated time on.
    pub fn count(&mut self, topic: String, from_nanos: u64) {
        self.counted = Some((topic, from_nanos));
    }

    fn take_inputs(&mut self) -> anyhow::Result<()> {
        for input in self.inputs.values_mut().flatten() {
            for _ in 0..MAX_AT_ONCE {
                let Some(sent) = input.next()? else { break };
                let counts = self.counted.as_ref().is_some_and(|(topic, from_nanos)| {
                    *sent.topic == **topic && sent.sim_nanos >= *from_nanos
                });
                let key = (sent.topic.clone(), sent.epoch, sent.tick);
                let is_new = self.seen.insert(key, sent).is_none();
                self.n_counted += u64::from(counts && is_new);
            }
        }
        Ok(())
    }

    fn take_results(&mut self, at: usize) -> anyhow::Result<()> {
        for _ in 0..MAX_AT_ONCE {
            let topic = &mut self.results[at];
            let result = match topic.reader.next() {
                Ok(Some(result)) => result,
                Ok(None) => return Ok(()),
                Err(error @ BusError::BadResult { .. }) => {
                    if topic.n_refused_said < MAX_SENTENCES {
                        topic.n_refused_said += 1;
                        self.faults
                            .push(format!("a result cannot be read: {error}"));
                    }
                    continue;
                }
                Err(other) => return Err(other.into()),
            };
            let header = *result.header();
            let inputs = result.inputs();
            if !topic.is_settled {
                topic.is_settled = true;
                let (suite, program) = (self.suite, self.program);
                let task = suite.task_of(program, &topic.topic, topic.kind, inputs);
                topic.task = task.map(|task| task.name.clone());
            }
            // What a program says about ticks that have not begun cannot be an answer.
            if self.newest.is_some_and(|(_, tick)| header.tick <= tick) {
                topic.answered.insert(header.tick);
            }
            if header.origin_mono_nanos > 0 {
                let nanos = header
                    .published_mono_nanos
                    .saturating_sub(header.origin_mono_nanos);
                let took = Duration::from_nanos(nanos);
                self.longest_answer = self.longest_answer.max(took);
                if self.newest.is_some_and(|(_, tick)| tick == header.tick) {
                    self.longest_held = self.longest_held.max(took);
                }
            }
            if self.captured.len() >= self.max_results {
                self.n_unkept += 1;
                continue;
            }
            let body = match self.keep_bodies {
                true => self.bodies.keep(&result)?,
                false => Some(Body::Dropped),
            };
            let Some(body) = body else {
                self.n_unkept += 1;
                continue;
            };
            self.captured.push(CapturedResult {
                topic: topic.topic.clone(),
                header,
                body,
                inputs: inputs.to_vec(),
                held_mono_nanos: result.taken().0,
            });
        }
        Ok(())
    }

    /// Whether the description of every topic that has one is open. Writers make its service before
    /// they can be found, so ask after [`Observer::has_all_results`].
    pub fn is_described(&mut self, bus: &Bus) -> bool {
        self.take_abouts(bus);
        self.results
            .iter()
            .all(|it| it.about.is_some() || !bus.exists(&names::about(&it.topic)))
    }

    fn take_abouts(&mut self, bus: &Bus) {
        for topic in &mut self.results {
            let name = names::about(&topic.topic);
            if topic.about.is_none() && bus.exists(&name) {
                // What is being made at this moment is opened at the next look.
                topic.about = bus.document_reader(&name).ok();
            }
            let Some(reader) = &mut topic.about else {
                continue;
            };
            let read = match reader.latest() {
                Ok(Some(document)) => document.json::<About>().map(Some),
                Ok(None) => Ok(None),
                Err(error) => Err(error),
            };
            match read {
                Ok(Some(about)) => drop(self.abouts.insert(topic.topic.clone(), about)),
                Ok(None) => {}
                Err(error) => {
                    tracing::debug!(topic = %topic.topic, %error, "cannot read the description");
                }
            }
        }
    }

    /// Takes the last descriptions.
    pub fn finish(&mut self, bus: &Bus) {
        self.take_abouts(bus);
    }

    /// Results that were lost because they came faster than they were taken, and those that break
    /// the contract.
    pub fn counts(&self) -> (u64, u64) {
        let counts = self.results.iter().map(|it| it.reader.counts());
        counts.fold((self.n_unkept, 0), |(lost, refused), one| {
            (lost + one.lost, refused + one.refused)
        })
    }
}

/// A topic that is being made or removed is looked for again later.
fn may_come<T>(opened: Result<T, BusError>) -> anyhow::Result<Option<T>> {
    match opened {
        Ok(port) => Ok(Some(port)),
        Err(BusError::NoSuchTopic { .. } | BusError::Service { .. }) => Ok(None),
        Err(other) => Err(other.into()),
    }
}
