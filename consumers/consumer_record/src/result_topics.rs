//! The topics of results that are recorded: followed, taken in order, converted.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

use consumer_kit::items::ResultParts;
use consumer_kit::{FollowedResult, Take, TopicReport};
use schema_bus::{Bus, Document, ResultSample, names};

use crate::results::ResultConverter;
use crate::snapshots::document;
use schema_recording::messages::Entry;

/// Results of one topic that are taken before the other topics have their turn.
pub(crate) const MAX_A_TURN: usize = 64;

/// All topics of results of a recording.
pub(crate) struct ResultTopics {
    topics: Vec<ResultTopic>,
    /// Topics that are followed no longer, because their writers have ended.
    ended: BTreeSet<String>,
    converter: ResultConverter,
    /// What the converters of earlier files could not show.
    bad_items: BTreeMap<String, u64>,
    began: Instant,
}

struct ResultTopic {
    followed: FollowedResult,
    source: Arc<str>,
    /// Name of its description, for counting.
    about: Arc<str>,
    /// Epoch and revision of the description that is in the file.
    described: Option<(u64, u64)>,
    /// Whether it cannot be read, which was said.
    given_up: bool,
    /// When it was last listed with a writer.
    alive: Option<Instant>,
}

impl ResultTopics {
    pub(crate) fn new() -> Self {
        ResultTopics {
            topics: Vec::new(),
            ended: BTreeSet::new(),
            converter: ResultConverter::default(),
            bad_items: BTreeMap::new(),
            began: Instant::now(),
        }
    }

    pub(crate) fn knows(&self, topic: &str) -> bool {
        self.topics.iter().any(|known| &*known.source == topic)
    }

    /// Follows a topic, which had a writer at `alive`.
    pub(crate) fn follow(&mut self, topic: &str, alive: Option<Instant>) {
        self.topics.push(ResultTopic {
            followed: FollowedResult::new(topic, Take::All),
            source: topic.into(),
            about: names::about(topic).into(),
            described: None,
            given_up: false,
            alive,
        });
        self.ended.remove(topic);
    }

    /// Whether the topic's writer has ended and none has come since.
    pub(crate) fn has_ended(&self, topic: &str) -> bool {
        self.ended.contains(topic)
    }

    /// Notes that a topic has a writer.
    pub(crate) fn is_alive(&mut self, topic: &str, now: Instant) {
        let known = self.topics.iter_mut().find(|t| &*t.source == topic);
        if let Some(known) = known {
            known.alive = Some(now);
        }
    }

    /// Takes out topics that had a writer and have been without one for `kept`, and returns what was
    /// counted of them.
    pub(crate) fn leave_gone(&mut self, now: Instant, kept: Duration) -> Vec<TopicReport> {
        let is_gone = |topic: &mut ResultTopic| {
            topic
                .alive
                .is_some_and(|alive| now.duration_since(alive) >= kept)
        };
        let gone = self.topics.extract_if(.., is_gone);
        let reports: Vec<TopicReport> = gone.map(|topic| topic.followed.report()).collect();
        let names = reports.iter().map(|report| report.topic.clone());
        self.ended.extend(names);
        reports
    }

    /// Whether a call of [`ResultTopics::leave_gone`] would take topics out.
    pub(crate) fn has_gone(&self, now: Instant, kept: Duration) -> bool {
        let mut alive = self.topics.iter().filter_map(|topic| topic.alive);
        alive.any(|alive| now.duration_since(alive) >= kept)
    }

    pub(crate) fn len(&self) -> usize {
        self.topics.len()
    }

    /// The next result of the topic, and the source that it counts for.
    pub(crate) fn take(
        &mut self,
        idx: usize,
        bus: &Bus,
    ) -> anyhow::Result<Option<(ResultSample, Arc<str>)>> {
        let topic = &mut self.topics[idx];
        if topic.given_up {
            return Ok(None);
        }
        // A topic that another program has spoilt must not end the recording of all others.
        if let Err(error) = topic.followed.look(bus) {
            tracing::error!(topic = &*topic.source, %error, "cannot record the topic");
            topic.given_up = true;
            return Ok(None);
        }
        let result = topic.followed.take()?;
        Ok(result.map(|result| (result, topic.source.clone())))
    }

    /// The topic's description if this file does not hold it yet: source, document, message.
    pub(crate) fn description(&mut self, idx: usize) -> Option<(Arc<str>, Document, Entry)> {
        let topic = &mut self.topics[idx];
        let found = topic.followed.description()?;
        let revision = (found.header.epoch, found.header.revision);
        if topic.described == Some(revision) {
            return None;
        }
        topic.described = Some(revision);
        let entry = document(&topic.about, &found.header, &found.text);
        Some((topic.about.clone(), found.clone(), entry))
    }

    /// The messages of a result of the topic.
    pub(crate) fn entries(
        &mut self,
        idx: usize,
        result: &ResultSample,
        sim_nanos: u64,
        reuse: &mut dyn FnMut(usize) -> Vec<u8>,
    ) -> Vec<Entry> {
        let parts = ResultParts::of(result, self.topics[idx].followed.about());
        self.converter.entries(&parts, sim_nanos, reuse)
    }

    /// Simulated time of a result: its own; if it has none, that of the newest snapshot; without a
    /// simulator the time since the recording began.
    pub(crate) fn sim_nanos(&self, result: &ResultSample, newest: Option<u64>) -> u64 {
        let header = result.header();
        match (header.tick, header.sim_nanos) {
            (0, 0) => newest.unwrap_or_else(|| self.began.elapsed().as_nanos() as u64),
            (_, sim_nanos) => sim_nanos,
        }
    }

    /// Prepares for a new file, which must hold every description again.
    pub(crate) fn begin_file(&mut self) {
        let converter = std::mem::take(&mut self.converter);
        for (topic, n) in converter.bad_items() {
            *self.bad_items.entry(topic.clone()).or_insert(0) += n;
        }
        self.topics
            .iter_mut()
            .for_each(|topic| topic.described = None);
    }

    /// Items that are only in lossless messages because they are broken, by topic.
    pub(crate) fn bad_items(&mut self) -> BTreeMap<String, u64> {
        self.begin_file();
        std::mem::take(&mut self.bad_items)
    }

    pub(crate) fn reports(&self) -> impl Iterator<Item = TopicReport> + '_ {
        self.topics.iter().map(|topic| topic.followed.report())
    }
}
