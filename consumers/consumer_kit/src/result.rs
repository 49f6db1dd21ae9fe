//! Follows one topic of results: opens it when it appears, takes the newest or every result, counts
//! losses, and knows the topic's description.

use std::time::{Duration, Instant};

use schema_bus::{
    Bus, BusError, Document, Listener, ReaderCounts, ResultReader, ResultSample, names,
};
use schema_frames::{About, ResultType};

use crate::document::FollowedDocument;
use crate::topic::{LOOK_EVERY, MAX_REFUSED, Search, Take, TopicReport};

/// One topic of results, followed across restarts of its writer.
#[derive(Debug)]
pub struct FollowedResult {
    topic: String,
    take: Take,
    reader: Option<ResultReader>,
    /// Opened by the first [`FollowedResult::wait`].
    listener: Option<Listener>,
    pub(crate) search: Search,
    document: FollowedDocument,
    about: About,
    is_quiet: bool,
    refusal_said: bool,
    loss_said: u64,
}

impl FollowedResult {
    /// Follows `topic` (without the domain); it need not exist yet.
    pub fn new(topic: impl Into<String>, take: Take) -> Self {
        let topic = topic.into();
        FollowedResult {
            document: FollowedDocument::optional(names::about(&topic)),
            topic,
            take,
            reader: None,
            listener: None,
            search: Search::default(),
            about: About::default(),
            is_quiet: false,
            refusal_said: false,
            loss_said: 0,
        }
    }

    /// The same, but nothing is logged about it: whoever follows it tells its losses elsewhere.
    pub fn quietly(mut self) -> Self {
        self.is_quiet = true;
        self.search = Search::of_optional();
        self
    }

    /// Closes its port and forgets its counters; the next look opens it again. Its description
    /// stays known.
    pub(crate) fn close(&mut self) {
        (self.reader, self.listener) = (None, None);
        self.search = match self.is_quiet {
            true => Search::of_optional(),
            false => Search::default(),
        };
        (self.refusal_said, self.loss_said) = (false, 0);
    }

    /// Name without the domain.
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Opens the topic if it exists; returns whether it is open. Looks at most five times a second.
    ///
    /// # Errors
    /// Errors that waiting does not heal: another schema, no place left, a topic of another kind.
    pub fn look(&mut self, bus: &Bus) -> Result<bool, BusError> {
        if self.reader.is_none() {
            self.reader = self
                .search
                .open(bus, &self.topic, || bus.result_reader(&self.topic))?;
        }
        if self.reader.is_some() {
            self.look_at_description(bus);
        }
        Ok(self.reader.is_some())
    }

    /// A description that cannot be read leaves the one before.
    fn look_at_description(&mut self, bus: &Bus) {
        let read = match self.document.changed(bus) {
            Ok(Some(document)) => document.json::<About>().map(Some),
            Ok(None) => Ok(None),
            Err(error) => Err(error),
        };
        match read {
            Ok(Some(about)) => self.about = about,
            Ok(None) => {}
            Err(error) => {
                tracing::debug!(topic = self.topic, %error, "cannot read the description")
            }
        }
    }

    /// Looks at the description alone, for those who do not read the topic now.
    pub fn describe(&mut self, bus: &Bus) -> &About {
        self.look_at_description(bus);
        &self.about
    }

    /// Whether the description is open, or the topic has none.
    pub fn is_described(&self, bus: &Bus) -> bool {
        self.document.found() || !bus.exists(self.document.name())
    }

    /// What the topic says about itself, as far as it is known: names of classes, fields of points,
    /// the schema of bytes.
    pub fn about(&self) -> &About {
        &self.about
    }

    /// The same as the document that it came in, for those who keep it.
    pub fn description(&self) -> Option<&Document> {
        self.document.newest()
    }

    /// Type of the results; `None` before the topic was found.
    pub fn kind(&self) -> Option<ResultType> {
        self.reader.as_ref().map(ResultReader::kind)
    }

    /// Waits for the next result to handle, at most `timeout`: the whole loop of a program that
    /// reads one topic. `None` after `timeout`, also if the topic does not exist yet.
    ///
    /// ```no_run
    /// use std::time::Duration;
    /// use consumer_kit::{FollowedResult, Take};
    /// use schema_frames::Box3d;
    /// let bus = schema_bus::Bus::open("gantry", "my-tracker")?;
    /// let mut boxes = FollowedResult::new("detector/boxes", Take::All);
    /// while let Some(found) = boxes.wait(&bus, Duration::from_secs(10))? {
    ///     let n = found.records::<Box3d>().map_or(0, <[Box3d]>::len);
    ///     println!("tick {}: {n} boxes", found.header().tick);
    /// }
    /// # Ok::<(), schema_bus::BusError>(())
    /// ```
    ///
    /// # Errors
    /// As [`FollowedResult::look`] and [`FollowedResult::take`].
    pub fn wait(&mut self, bus: &Bus, timeout: Duration) -> Result<Option<ResultSample>, BusError> {
        let deadline = Instant::now() + timeout;
        loop {
            if let Some(result) = self.take()? {
                return Ok(Some(result));
            }
            let rest = deadline.saturating_duration_since(Instant::now());
            if !self.look(bus)? {
                if rest.is_zero() {
                    return Ok(None);
                }
                std::thread::sleep(rest.min(LOOK_EVERY));
                continue;
            }
            let Some(listener) = &self.listener else {
                self.listener = Some(bus.listener(&self.topic)?);
                continue;
            };
            // What was announced before this look is taken back, so that it does not end the wait
            // for the next result.
            listener.drain()?;
            if let Some(result) = self.take()? {
                return Ok(Some(result));
            }
            if rest.is_zero() {
                return Ok(None);
            }
            if let Some(listener) = &self.listener {
                listener.wait_pending(rest);
            }
        }
    }

    /// Waits for the result that is about `tick` or a later one, at most `timeout`: in lockstep what
    /// another participant says of the tick that the simulator waits with. Results of earlier ticks
    /// are dropped. `None` after `timeout`.
    ///
    /// # Errors
    /// As [`FollowedResult::wait`].
    pub fn wait_for(
        &mut self,
        bus: &Bus,
        tick: u64,
        timeout: Duration,
    ) -> Result<Option<ResultSample>, BusError> {
        let deadline = Instant::now() + timeout;
        loop {
            let rest = deadline.saturating_duration_since(Instant::now());
            match self.wait(bus, rest)? {
                Some(result) if result.header().tick < tick => {}
                found => return Ok(found),
            }
        }
    }

    /// The next result to handle, if one waits. A result that breaks the contract is counted,
    /// logged once, and skipped.
    ///
    /// # Errors
    /// [`BusError::BorrowLimit`] if the caller holds too many results, [`BusError::Service`].
    pub fn take(&mut self) -> Result<Option<ResultSample>, BusError> {
        for _ in 0..MAX_REFUSED {
            match self.take_strictly() {
                Err(error @ BusError::BadResult { .. }) => {
                    if !self.is_quiet && !std::mem::replace(&mut self.refusal_said, true) {
                        tracing::warn!(topic = self.topic, %error, "refused a result; further ones are only counted");
                    }
                }
                taken => return taken,
            }
        }
        Ok(None)
    }

    /// As [`FollowedResult::take`], but a result that breaks the contract is an error; the next
    /// call goes on after it.
    ///
    /// # Errors
    /// [`BusError::BadResult`], and as [`FollowedResult::take`].
    pub fn take_strictly(&mut self) -> Result<Option<ResultSample>, BusError> {
        let Some(reader) = &mut self.reader else {
            return Ok(None);
        };
        let taken = match self.take {
            Take::Newest => reader.latest(),
            Take::All => reader.next(),
        }?;
        if taken.is_some() {
            self.notice_losses();
        }
        Ok(taken)
    }

    /// Whether the topic was found.
    pub fn found(&self) -> bool {
        self.reader.is_some()
    }

    /// Whether a writer has the topic open now.
    pub fn has_writer(&self) -> bool {
        self.reader.as_ref().is_some_and(ResultReader::has_writer)
    }

    /// Counters so far.
    pub fn counts(&self) -> ReaderCounts {
        self.reader
            .as_ref()
            .map(ResultReader::counts)
            .unwrap_or_default()
    }

    /// Its counters.
    pub fn report(&self) -> TopicReport {
        TopicReport {
            topic: self.topic.clone(),
            found: self.found(),
            counts: self.counts(),
        }
    }

    /// Logs losses whenever their number has doubled since they were last logged.
    fn notice_losses(&mut self) {
        let lost = self.counts().lost;
        if !self.is_quiet && lost > 0 && lost >= self.loss_said.saturating_mul(2) {
            tracing::warn!(
                topic = self.topic,
                lost,
                "this reader is too slow: results were lost"
            );
            self.loss_said = lost.max(1);
        }
    }
}
