//! The topics of results that are recorded: their names in the file, and their conversion.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use consumer_kit::items::ResultParts;
use consumer_kit::{Domain, TopicId};
use schema_bus::{Document, ResultSample, names};

use consumer_forms::foxglove::results::ResultConverter;
use consumer_forms::foxglove::snapshots::document;
use schema_recording::messages::Entry;

/// Results of one topic that are taken before the other topics have their turn.
pub(crate) const MAX_A_TURN: usize = 64;

/// All topics of results of a recording.
pub(crate) struct ResultTopics {
    topics: BTreeMap<TopicId, ResultTopic>,
    converter: ResultConverter,
    /// What the converters of earlier files could not show.
    bad_items: BTreeMap<String, u64>,
    began: Instant,
}

struct ResultTopic {
    source: Arc<str>,
    /// Name of its description, for counting.
    about: Arc<str>,
    /// Epoch and revision of the description that is in the file.
    described: Option<(u64, u64)>,
}

impl ResultTopics {
    pub(crate) fn new() -> Self {
        ResultTopics {
            topics: BTreeMap::new(),
            converter: ResultConverter::default(),
            bad_items: BTreeMap::new(),
            began: Instant::now(),
        }
    }

    /// The source that a topic counts for; `None` if it is no topic of results.
    pub(crate) fn source(&self, id: TopicId) -> Option<&Arc<str>> {
        self.topics.get(&id).map(|topic| &topic.source)
    }

    pub(crate) fn begin(&mut self, id: TopicId, topic: &str) {
        let topic = ResultTopic {
            source: topic.into(),
            about: names::about(topic).into(),
            described: None,
        };
        self.topics.insert(id, topic);
    }

    pub(crate) fn end(&mut self, id: TopicId) {
        self.topics.remove(&id);
    }

    pub(crate) fn ids(&self) -> Vec<TopicId> {
        self.topics.keys().copied().collect()
    }

    /// The topic's description if this file does not hold it yet: source, document, message.
    pub(crate) fn description<'a>(
        &mut self,
        id: TopicId,
        domain: &'a Domain,
    ) -> Option<(Arc<str>, &'a Document, Entry)> {
        let topic = self.topics.get_mut(&id)?;
        let found = domain.results(id)?.description()?;
        let revision = (found.header.epoch, found.header.revision);
        if topic.described == Some(revision) {
            return None;
        }
        topic.described = Some(revision);
        let entry = document(&topic.about, &found.header, &found.text);
        Some((topic.about.clone(), found, entry))
    }

    /// The messages of a result of the topic.
    pub(crate) fn entries(
        &mut self,
        id: TopicId,
        domain: &Domain,
        result: &ResultSample,
        sim_nanos: u64,
        reuse: &mut dyn FnMut(usize) -> Vec<u8>,
    ) -> Vec<Entry> {
        let Some(topic) = domain.results(id) else {
            return Vec::new();
        };
        let parts = ResultParts::of(result, topic.about());
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
            let sum = self.bad_items.entry(topic.clone()).or_insert(0);
            *sum = sum.saturating_add(*n);
        }
        self.topics
            .values_mut()
            .for_each(|topic| topic.described = None);
    }

    /// Items that are only in lossless messages because they are broken, by topic.
    pub(crate) fn bad_items(&mut self) -> BTreeMap<String, u64> {
        self.begin_file();
        std::mem::take(&mut self.bad_items)
    }
}
