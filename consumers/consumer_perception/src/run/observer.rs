//! What the benchmark sees on the bus while a program runs: results, frames of the inputs, and
//! snapshots. It only looks; no writer waits for it or wakes it.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use consumer_kit::{Change, Domain, FollowedResult, Listing, Rhythm, Take, TopicId, Wish};
use schema_bus::{Bus, BusError, ResultSample, TopicKind};
use schema_frames::{About, ResultType};

use crate::capture::{Body, BodyStore, CapturedResult, Clock, SentFrame};
use crate::suite::{Program, Suite};

/// How often topics are listed while some are missing, and afterwards.
const LIST: [Rhythm; 2] = [
    Rhythm::steady(Duration::from_millis(100)),
    Rhythm::steady(Duration::from_secs(1)),
];
/// Time between two looks at the descriptions of results.
const LOOK_AT_ABOUTS: Duration = Duration::from_secs(1);
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
    id: TopicId,
    topic: Arc<str>,
    kind: ResultType,
    /// Name of the task that it is scored as; `None` if nobody asked for it.
    task: Option<String>,
    /// Whether the task was found by a result, and not only by the topic's type.
    is_settled: bool,
    /// Ticks that were answered in the epoch at hand.
    answered: BTreeSet<u64>,
    n_refused_said: usize,
}

/// What is kept of results.
#[derive(Clone, Copy, Debug)]
pub struct Keeps {
    /// Whether their bodies are.
    pub bodies: bool,
    /// Most of them.
    pub results: usize,
}

/// Everything that is followed.
#[derive(Debug)]
pub struct Observer<'a> {
    suite: &'a Suite,
    program: &'a Program,
    domain: Domain,
    /// Topics of frames and results that the program gets.
    inputs: BTreeMap<String, Option<Input>>,
    results: Vec<ResultTopic>,
    snapshots: TopicId,
    next_abouts: Instant,
    bodies: BodyStore,
    keeps: Keeps,
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
#[derive(Clone, Debug)]
struct Input {
    id: TopicId,
    topic: Arc<str>,
    kind: TopicKind,
}

impl Input {
    fn next(&self, domain: &mut Domain) -> anyhow::Result<Option<SentFrame>> {
        Ok(match self.kind {
            TopicKind::Frames => domain.take_frame(self.id)?.map(|frame| {
                let header = frame.header();
                SentFrame {
                    topic: self.topic.clone(),
                    tick: header.tick,
                    seq: header.seq,
                    epoch: header.epoch,
                    sim_nanos: header.sim_nanos,
                    published_mono_nanos: header.published_mono_nanos,
                }
            }),
            _ => domain.take_result_strictly(self.id)?.map(|result| {
                let header = result.header();
                SentFrame {
                    topic: self.topic.clone(),
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
    ///
    /// # Errors
    /// If the domain cannot be joined.
    pub fn open(
        domain: &str,
        suite: &'a Suite,
        program: &'a Program,
        inputs: impl IntoIterator<Item = String>,
        keeps: Keeps,
    ) -> anyhow::Result<Observer<'a>> {
        let join = || Bus::open(domain, "gantry-bench");
        let listing = Listing::start(join()?, LIST[0])
            .context("cannot start the thread that looks for topics")?;
        let mut domain = Domain::on(join()?, listing);
        Ok(Observer {
            suite,
            program,
            snapshots: domain.follow_snapshots(),
            domain,
            inputs: inputs.into_iter().map(|topic| (topic, None)).collect(),
            results: Vec::new(),
            next_abouts: Instant::now(),
            bodies: BodyStore::default(),
            keeps,
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
        })
    }

    /// Follows topics that are new.
    ///
    /// # Errors
    /// If the bus fails.
    pub fn search(&mut self) -> anyhow::Result<()> {
        let (inputs, n_results) = (&self.inputs, self.results.len());
        let mut rest = MAX_TOPICS.saturating_sub(n_results);
        let is_new = self.domain.look(|listed| {
            let topic = listed.details;
            let is_wanted = listed.is_known
                || match topic.kind {
                    TopicKind::Frames => inputs.contains_key(&topic.name),
                    TopicKind::Results if topic.result.is_none() => false,
                    TopicKind::Results if inputs.contains_key(&topic.name) => true,
                    TopicKind::Results => {
                        let has_place = rest > 0;
                        rest -= usize::from(has_place);
                        has_place
                    }
                    _ => false,
                };
            // Its losses and faults are the benchmark's to tell.
            let wish = Wish::on_demand(Take::All).quietly().also_left_over();
            is_wanted.then_some(wish)
        })?;
        self.take_over()?;
        self.domain.open()?;
        self.take_over()?;
        if is_new {
            let is_whole = self.inputs.values().all(Option::is_some) && self.has_all_results();
            self.domain.set_rhythm(LIST[usize::from(is_whole)]);
        }
        Ok(())
    }

    fn take_over(&mut self) -> anyhow::Result<()> {
        while let Some(change) = self.domain.change() {
            match change {
                Change::Found { id, details } => {
                    self.domain.want(id, true);
                    let topic: Arc<str> = details.name.as_str().into();
                    match (self.inputs.get_mut(&details.name), details.result) {
                        (Some(input), _) => {
                            let kind = details.kind;
                            *input = Some(Input { id, topic, kind });
                        }
                        (None, Some(kind)) => self.follow(id, topic, kind),
                        (None, None) => {}
                    }
                }
                Change::Refused { error, .. } => return Err(error.into()),
                // Writers that have ended may come back until the run is over.
                Change::Full(_) | Change::Silent(_) | Change::Unlisted(_) | Change::Ended(_) => {}
            }
        }
        Ok(())
    }

    fn follow(&mut self, id: TopicId, topic: Arc<str>, kind: ResultType) {
        let task = self.suite.task_of(self.program, &topic, kind, &[]);
        self.results.push(ResultTopic {
            id,
            task: task.map(|task| task.name.clone()),
            is_settled: false,
            answered: BTreeSet::new(),
            n_refused_said: 0,
            topic,
            kind,
        });
    }

    fn has_writer(&self, topic: &ResultTopic) -> bool {
        let results = self.domain.results(topic.id);
        results.is_some_and(FollowedResult::has_writer)
    }

    /// Whether every topic of results that the suite names has a writer; without names, whether one
    /// that fits a task has.
    pub fn has_all_results(&self) -> bool {
        let has = |topic: &str| {
            let found = self.results.iter().find(|it| &*it.topic == topic);
            found.is_some_and(|it| self.has_writer(it))
        };
        match self.program.results.is_empty() {
            false => self.program.results.keys().all(|topic| has(topic)),
            // Whoever drives need not say anything.
            true if self.suite.is_closed_loop() => true,
            true => self
                .results
                .iter()
                .any(|it| it.task.is_some() && self.has_writer(it)),
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
    pub fn look(&mut self) -> anyhow::Result<()> {
        self.take_snapshots()?;
        self.take_inputs()?;
        for at in 0..self.results.len() {
            self.take_results(at)?;
        }
        if Instant::now() >= self.next_abouts {
            self.next_abouts = Instant::now() + LOOK_AT_ABOUTS;
            self.take_abouts();
        }
        Ok(())
    }

    fn take_snapshots(&mut self) -> anyhow::Result<()> {
        for _ in 0..MAX_AT_ONCE {
            let Some(snapshot) = self.domain.take_snapshot(self.snapshots)? else {
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
        for input in self.inputs.values().flatten() {
            for _ in 0..MAX_AT_ONCE {
                let Some(sent) = input.next(&mut self.domain)? else {
                    break;
                };
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
            let result: ResultSample = match self.domain.take_result_strictly(topic.id) {
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
            if self.captured.len() >= self.keeps.results {
                self.n_unkept += 1;
                continue;
            }
            let body = match self.keeps.bodies {
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
    pub fn is_described(&mut self) -> bool {
        self.take_abouts();
        self.results.iter().all(|it| {
            let results = self.domain.results(it.id);
            results.is_some_and(|results| results.is_described(self.domain.bus()))
        })
    }

    fn take_abouts(&mut self) {
        for topic in &self.results {
            self.domain.describe(topic.id);
            let results = self.domain.results(topic.id);
            if let Some(results) = results.filter(|it| it.description().is_some()) {
                self.abouts
                    .insert(topic.topic.clone(), results.about().clone());
            }
        }
    }

    /// Takes the last descriptions.
    pub fn finish(&mut self) {
        self.take_abouts();
    }

    /// Results that were lost because they came faster than they were taken, and those that break
    /// the contract.
    pub fn counts(&self) -> (u64, u64) {
        let counts = self.results.iter().map(|it| self.domain.counts(it.id));
        counts.fold((self.n_unkept, 0), |(lost, refused), one| {
            (lost + one.lost, refused + one.refused)
        })
    }
}
