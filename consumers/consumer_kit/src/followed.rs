//! Follows one topic of any kind: opens it when it appears, takes the newest sample or every sample,
//! waits for the next, and counts losses. Frames and results stand on it.

use std::time::{Duration, Instant};

use schema_bus::{Bus, BusError, Frames, Listener, Reader, ReaderCounts, Results, SampleKind};

/// How often a missing topic is looked for.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// Samples in a row that are refused before a reader looks at its other work. A process that floods
/// a topic with garbage would otherwise hold it here.
const MAX_REFUSED: usize = 64;

/// Which samples to take when several wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Take {
    /// Only the newest, for viewers and drivers.
    Newest,
    /// Every frame in order, for recorders.
    All,
}

/// The counters of one topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TopicReport {
    /// Name without the domain.
    pub topic: String,
    /// Whether it was ever there.
    pub found: bool,
    /// Counters of its reader.
    pub counts: ReaderCounts,
}

impl std::fmt::Display for TopicReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if !self.found {
            return write!(f, "{}: never appeared", self.topic);
        }
        let ReaderCounts {
            taken,
            skipped,
            lost,
            refused,
            restarts,
        } = self.counts;
        write!(f, "{}: {taken} frames, {lost} lost", self.topic)?;
        for (n, what) in [
            (skipped, "skipped"),
            (refused, "refused"),
            (restarts, "restarts of the simulator"),
        ] {
            if n > 0 {
                write!(f, ", {n} {what}")?;
            }
        }
        Ok(())
    }
}

/// When to look again for a service that did not exist, and what was already logged about it.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Search {
    next_look: Option<Instant>,
    said: bool,
}

impl Search {
    /// A search for something that need not exist, so that nothing is said while it does not.
    pub fn of_optional() -> Search {
        Search {
            next_look: None,
            said: true,
        }
    }

    /// Looks with the next call, whenever the last one was.
    pub fn hurry(&mut self) {
        self.next_look = None;
    }

    /// Opens the service if it is time to look and the service exists. Errors that may go away with
    /// time are logged once and swallowed; others are returned.
    pub fn open<T>(
        &mut self,
        bus: &Bus,
        topic: &str,
        open: impl FnOnce() -> Result<T, BusError>,
    ) -> Result<Option<T>, BusError> {
        let now = Instant::now();
        if self.next_look.is_some_and(|at| now < at) {
            return Ok(None);
        }
        self.next_look = Some(now + LOOK_EVERY);
        if !bus.exists(topic) {
            self.say_waiting(topic);
            return Ok(None);
        }
        match open() {
            Ok(port) => Ok(Some(port)),
            // It disappeared between the two calls.
            Err(BusError::NoSuchTopic { .. }) => {
                self.say_waiting(topic);
                Ok(None)
            }
            // The service is being created or removed.
            Err(error @ BusError::Service { .. }) => {
                if !std::mem::replace(&mut self.said, true) {
                    tracing::warn!(topic, %error, "cannot open the topic yet, trying again");
                }
                Ok(None)
            }
            Err(other) => Err(other),
        }
    }

    fn say_waiting(&mut self, topic: &str) {
        if !std::mem::replace(&mut self.said, true) {
            tracing::info!(topic, "waiting for the topic to appear");
        }
    }
}

/// What a kind of samples has of its own for those who follow it.
pub(crate) trait Kind: SampleKind {
    /// One of them, as messages call it.
    const NAME: &str;

    /// Opens a reading port.
    fn open(bus: &Bus, topic: &str) -> Result<Reader<Self>, BusError>;
}

impl Kind for Frames {
    const NAME: &str = "frame";

    fn open(bus: &Bus, topic: &str) -> Result<Reader<Frames>, BusError> {
        bus.frame_reader(topic)
    }
}

impl Kind for Results {
    const NAME: &str = "result";

    fn open(bus: &Bus, topic: &str) -> Result<Reader<Results>, BusError> {
        bus.result_reader(topic)
    }
}

/// One topic, followed across restarts of its writer.
#[derive(Debug)]
pub(crate) struct Followed<K: Kind> {
    topic: String,
    take: Take,
    reader: Option<Reader<K>>,
    /// Opened by the first [`Followed::wait`].
    listener: Option<Listener>,
    search: Search,
    is_quiet: bool,
    refusal_said: bool,
    loss_said: u64,
}

impl<K: Kind> Followed<K> {
    /// Follows `topic`; it need not exist yet.
    pub fn new(topic: String, take: Take) -> Self {
        Followed {
            topic,
            take,
            reader: None,
            listener: None,
            search: Search::default(),
            is_quiet: false,
            refusal_said: false,
            loss_said: 0,
        }
    }

    /// Nothing is logged about it from now on.
    pub fn be_quiet(&mut self) {
        self.is_quiet = true;
        self.search = Search::of_optional();
    }

    /// Whether nothing is logged about it.
    pub fn is_quiet(&self) -> bool {
        self.is_quiet
    }

    /// Closes its port and forgets its counters; the next look opens it again.
    pub fn close(&mut self) {
        let topic = std::mem::take(&mut self.topic);
        let mut closed = Followed::new(topic, self.take);
        if self.is_quiet {
            closed.be_quiet();
        }
        *self = closed;
    }

    /// Takes other samples from now on.
    pub fn set_take(&mut self, take: Take) {
        self.take = take;
    }

    /// Looks for the topic with the next call, whenever the last one was.
    pub fn hurry(&mut self) {
        self.search.hurry();
    }

    /// Name without the domain.
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Its port, if it is open.
    pub fn reader(&self) -> Option<&Reader<K>> {
        self.reader.as_ref()
    }

    /// Opens the topic if it exists; returns whether it is open.
    pub fn look(&mut self, bus: &Bus) -> Result<bool, BusError> {
        if self.reader.is_none() {
            self.reader = self
                .search
                .open(bus, &self.topic, || K::open(bus, &self.topic))?;
        }
        Ok(self.reader.is_some())
    }

    /// Waits for the next sample, at most `timeout`; `None` after it. `beside` is done with each look
    /// at an open topic.
    pub fn wait(
        &mut self,
        bus: &Bus,
        timeout: Duration,
        mut beside: impl FnMut(),
    ) -> Result<Option<K::Sample>, BusError> {
        let deadline = Instant::now() + timeout;
        loop {
            if let Some(sample) = self.take()? {
                return Ok(Some(sample));
            }
            let rest = deadline.saturating_duration_since(Instant::now());
            if !self.look(bus)? {
                if rest.is_zero() {
                    return Ok(None);
                }
                std::thread::sleep(rest.min(LOOK_EVERY));
                continue;
            }
            beside();
            let Some(listener) = &self.listener else {
                self.listener = Some(bus.listener(&self.topic)?);
                continue;
            };
            // What was announced before this look is taken back, so that it does not end the wait
            // for the next sample.
            listener.drain()?;
            if let Some(sample) = self.take()? {
                return Ok(Some(sample));
            }
            if rest.is_zero() {
                return Ok(None);
            }
            if let Some(listener) = &self.listener {
                listener.wait_pending(rest);
            }
        }
    }

    /// The next sample, if one waits. One that breaks the contract is counted, logged once, and
    /// skipped.
    pub fn take(&mut self) -> Result<Option<K::Sample>, BusError> {
        for _ in 0..MAX_REFUSED {
            match self.take_strictly() {
                Err(error @ (BusError::BadFrame { .. } | BusError::BadResult { .. })) => {
                    if !self.is_quiet && !std::mem::replace(&mut self.refusal_said, true) {
                        tracing::warn!(
                            topic = self.topic,
                            %error,
                            "refused a {}; further ones are only counted",
                            K::NAME
                        );
                    }
                }
                taken => return taken,
            }
        }
        Ok(None)
    }

    /// The next sample, if one waits; one that breaks the contract is an error.
    pub fn take_strictly(&mut self) -> Result<Option<K::Sample>, BusError> {
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

    /// Counters so far.
    pub fn counts(&self) -> ReaderCounts {
        self.reader.as_ref().map(Reader::counts).unwrap_or_default()
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
                "this reader is too slow: {}s were lost",
                K::NAME
            );
            self.loss_said = lost.max(1);
        }
    }
}
