//! Follows one topic: opens it when it appears, takes the newest frame or every frame, and counts
//! losses.

use std::time::{Duration, Instant};

use schema_bus::{Bus, BusError, Frame, FrameReader, Listener, ReaderCounts};

/// How often a missing topic is looked for.
pub(crate) const LOOK_EVERY: Duration = Duration::from_millis(200);

/// Frames in a row that are refused before a reader looks at its other work. A process that floods
/// a topic with garbage would otherwise hold it here.
pub(crate) const MAX_REFUSED: usize = 64;

/// Which frames to take when several wait.
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

/// One topic, followed across restarts of its writer.
#[derive(Debug)]
pub struct FollowedTopic {
    topic: String,
    take: Take,
    reader: Option<FrameReader>,
    /// Opened by the first [`FollowedTopic::wait`].
    listener: Option<Listener>,
    pub(crate) search: Search,
    epoch: Option<u64>,
    is_quiet: bool,
    refusal_said: bool,
    loss_said: u64,
}

impl FollowedTopic {
    /// Follows `topic` (without the domain); it need not exist yet.
    pub fn new(topic: impl Into<String>, take: Take) -> Self {
        FollowedTopic {
            topic: topic.into(),
            take,
            reader: None,
            listener: None,
            search: Search::default(),
            epoch: None,
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

    /// Closes its port and forgets its counters; the next look opens it again.
    pub(crate) fn close(&mut self) {
        let topic = std::mem::take(&mut self.topic);
        let closed = FollowedTopic::new(topic, self.take);
        *self = match self.is_quiet {
            true => closed.quietly(),
            false => closed,
        };
    }

    /// Takes other frames from now on.
    pub(crate) fn set_take(&mut self, take: Take) {
        self.take = take;
    }

    /// Name without the domain.
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Opens the topic if it exists; returns whether it is open. Looks at most five times a second.
    ///
    /// # Errors
    /// Errors that waiting does not heal: another schema, no place left, another user's topic.
    pub fn look(&mut self, bus: &Bus) -> Result<bool, BusError> {
        if self.reader.is_none() {
            self.reader = self
                .search
                .open(bus, &self.topic, || bus.frame_reader(&self.topic))?;
        }
        Ok(self.reader.is_some())
    }

    /// Waits for the next frame to handle, at most `timeout`: the whole loop of a program that
    /// reads one topic. `None` after `timeout`, also if the topic does not exist yet. The frame is
    /// in hand as soon as it is sent, whatever else the simulator still works on.
    ///
    /// ```no_run
    /// use std::time::Duration;
    /// use consumer_kit::{FollowedTopic, Take};
    /// let bus = schema_bus::Bus::open("gantry", "my-odometry")?;
    /// let mut imu = FollowedTopic::new("ego/imu/imu", Take::All);
    /// while let Some(frame) = imu.wait(&bus, Duration::from_secs(10))? {
    ///     println!("tick {}: {} bytes", frame.header().tick, frame.len());
    /// }
    /// # Ok::<(), schema_bus::BusError>(())
    /// ```
    ///
    /// # Errors
    /// As [`FollowedTopic::look`] and [`FollowedTopic::take`].
    pub fn wait(&mut self, bus: &Bus, timeout: Duration) -> Result<Option<Frame>, BusError> {
        let deadline = Instant::now() + timeout;
        loop {
            if let Some(frame) = self.take()? {
                return Ok(Some(frame));
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
            // for the next frame.
            listener.drain()?;
            if let Some(frame) = self.take()? {
                return Ok(Some(frame));
            }
            if rest.is_zero() {
                return Ok(None);
            }
            if let Some(listener) = &self.listener {
                listener.wait_pending(rest);
            }
        }
    }

    /// The next frame to handle, if one waits. A frame that breaks the contract is counted, logged
    /// once, and skipped.
    ///
    /// # Errors
    /// [`BusError::BorrowLimit`] if the caller holds too many frames, [`BusError::Service`].
    pub fn take(&mut self) -> Result<Option<Frame>, BusError> {
        let Some(reader) = &mut self.reader else {
            return Ok(None);
        };
        for _ in 0..MAX_REFUSED {
            let taken = match self.take {
                Take::Newest => reader.latest(),
                Take::All => reader.next(),
            };
            match taken {
                Ok(Some(frame)) => {
                    self.notice(&frame);
                    return Ok(Some(frame));
                }
                Ok(None) => return Ok(None),
                Err(error @ BusError::BadFrame { .. }) => {
                    if !self.is_quiet && !std::mem::replace(&mut self.refusal_said, true) {
                        tracing::warn!(topic = self.topic, error = %error, "refused a frame; further ones are only counted");
                    }
                }
                Err(other) => return Err(other),
            }
        }
        Ok(None)
    }

    /// Whether the topic was found.
    pub fn found(&self) -> bool {
        self.reader.is_some()
    }

    /// Epoch of the newest frame: another number than before means that the simulator was
    /// restarted.
    pub fn epoch(&self) -> Option<u64> {
        self.epoch
    }

    /// Counters so far.
    pub fn counts(&self) -> ReaderCounts {
        self.reader
            .as_ref()
            .map(FrameReader::counts)
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

    /// Logs restarts, and losses whenever their number has doubled since they were last logged.
    fn notice(&mut self, frame: &Frame) {
        let epoch = frame.header().epoch;
        let before = self.epoch.replace(epoch);
        if self.is_quiet {
            return;
        }
        if before.is_some_and(|before| before != epoch) {
            tracing::info!(
                topic = self.topic,
                "the simulator was restarted; following its new run"
            );
        }
        let lost = self.counts().lost;
        if lost > 0 && lost >= self.loss_said.saturating_mul(2) {
            tracing::warn!(
                topic = self.topic,
                lost,
                "this reader is too slow: frames were lost"
            );
            self.loss_said = lost.max(1);
        }
    }
}
