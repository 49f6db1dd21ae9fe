//! Follows one topic of results, and knows the topic's description.

use std::time::{Duration, Instant};

use schema_bus::{Bus, BusError, Document, Reader, ReaderCounts, ResultSample, Results, names};
use schema_frames::{About, ResultType};

use crate::document::FollowedDocument;
use crate::followed::{Followed, Take, TopicReport};

/// One topic of results, followed across restarts of its writer.
#[derive(Debug)]
pub struct FollowedResult {
    followed: Followed<Results>,
    description: Description,
}

/// What a topic of results says about itself, as far as it is known.
#[derive(Debug)]
struct Description {
    document: FollowedDocument,
    about: About,
}

impl Description {
    /// One that cannot be read leaves the one before.
    fn look(&mut self, bus: &Bus) {
        let read = match self.document.changed(bus) {
            Ok(Some(document)) => document.json::<About>().map(Some),
            Ok(None) => Ok(None),
            Err(error) => Err(error),
        };
        match read {
            Ok(Some(about)) => self.about = about,
            Ok(None) => {}
            Err(error) => {
                let document = self.document.name();
                tracing::debug!(document, %error, "cannot read the description");
            }
        }
    }
}

impl FollowedResult {
    /// Follows `topic` (without the domain); it need not exist yet.
    pub fn new(topic: impl Into<String>, take: Take) -> Self {
        let topic = topic.into();
        FollowedResult {
            description: Description {
                document: FollowedDocument::optional(names::about(&topic)),
                about: About::default(),
            },
            followed: Followed::new(topic, take),
        }
    }

    /// The same, but nothing is logged about it: whoever follows it tells its losses elsewhere.
    pub fn quietly(mut self) -> Self {
        self.followed.be_quiet();
        self
    }

    /// Closes its port and forgets its counters; the next look opens it again. Its description
    /// stays known.
    pub(crate) fn close(&mut self) {
        self.followed.close();
    }

    /// Looks for the topic with the next call, whenever the last one was.
    pub(crate) fn hurry(&mut self) {
        self.followed.hurry();
    }

    /// Name without the domain.
    pub fn topic(&self) -> &str {
        self.followed.topic()
    }

    /// Opens the topic if it exists; returns whether it is open. Looks at most five times a second.
    ///
    /// # Errors
    /// Errors that waiting does not heal: another schema, no place left, a topic of another kind.
    pub fn look(&mut self, bus: &Bus) -> Result<bool, BusError> {
        let is_open = self.followed.look(bus)?;
        if is_open {
            self.description.look(bus);
        }
        Ok(is_open)
    }

    /// Looks at the description alone, for those who do not read the topic now.
    pub fn describe(&mut self, bus: &Bus) -> &About {
        self.description.look(bus);
        self.about()
    }

    /// Whether the description is open, or the topic has none.
    pub fn is_described(&self, bus: &Bus) -> bool {
        let document = &self.description.document;
        document.found() || !bus.exists(document.name())
    }

    /// What the topic says about itself, as far as it is known: names of classes, fields of points,
    /// the schema of bytes.
    pub fn about(&self) -> &About {
        &self.description.about
    }

    /// The same as the document that it came in, for those who keep it.
    pub fn description(&self) -> Option<&Document> {
        self.description.document.newest()
    }

    /// Type of the results; `None` before the topic was found.
    pub fn kind(&self) -> Option<ResultType> {
        self.followed.reader().map(Reader::<Results>::kind)
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
        let FollowedResult {
            followed,
            description,
        } = self;
        followed.wait(bus, timeout, || description.look(bus))
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
        self.followed.take()
    }

    /// As [`FollowedResult::take`], but a result that breaks the contract is an error; the next
    /// call goes on after it.
    ///
    /// # Errors
    /// [`BusError::BadResult`], and as [`FollowedResult::take`].
    pub fn take_strictly(&mut self) -> Result<Option<ResultSample>, BusError> {
        self.followed.take_strictly()
    }

    /// Whether the topic was found.
    pub fn found(&self) -> bool {
        self.followed.found()
    }

    /// Whether a writer has the topic open now.
    pub fn has_writer(&self) -> bool {
        self.followed.reader().is_some_and(Reader::has_writer)
    }

    /// Counters so far.
    pub fn counts(&self) -> ReaderCounts {
        self.followed.counts()
    }

    /// Its counters.
    pub fn report(&self) -> TopicReport {
        self.followed.report()
    }
}
