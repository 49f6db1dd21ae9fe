//! Follows one topic of frames.

use std::time::Duration;

use schema_bus::{Bus, BusError, Frame, Frames, ReaderCounts};

use crate::followed::{Followed, Take, TopicReport};

/// One topic, followed across restarts of its writer.
#[derive(Debug)]
pub struct FollowedTopic {
    followed: Followed<Frames>,
    epoch: Option<u64>,
}

impl FollowedTopic {
    /// Follows `topic` (without the domain); it need not exist yet.
    pub fn new(topic: impl Into<String>, take: Take) -> Self {
        FollowedTopic {
            followed: Followed::new(topic.into(), take),
            epoch: None,
        }
    }

    /// The same, but nothing is logged about it: whoever follows it tells its losses elsewhere.
    pub fn quietly(mut self) -> Self {
        self.followed.be_quiet();
        self
    }

    /// Closes its port and forgets its counters; the next look opens it again.
    pub(crate) fn close(&mut self) {
        self.followed.close();
        self.epoch = None;
    }

    /// Takes other frames from now on.
    pub(crate) fn set_take(&mut self, take: Take) {
        self.followed.set_take(take);
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
    /// Errors that waiting does not heal: another schema, no place left, another user's topic.
    pub fn look(&mut self, bus: &Bus) -> Result<bool, BusError> {
        self.followed.look(bus)
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
        let waited = self.followed.wait(bus, timeout, || ())?;
        Ok(self.noticed(waited))
    }

    /// The next frame to handle, if one waits. A frame that breaks the contract is counted, logged
    /// once, and skipped.
    ///
    /// # Errors
    /// [`BusError::BorrowLimit`] if the caller holds too many frames, [`BusError::Service`].
    pub fn take(&mut self) -> Result<Option<Frame>, BusError> {
        let taken = self.followed.take()?;
        Ok(self.noticed(taken))
    }

    /// Whether the topic was found.
    pub fn found(&self) -> bool {
        self.followed.found()
    }

    /// Epoch of the newest frame: another number than before means that the simulator was
    /// restarted.
    pub fn epoch(&self) -> Option<u64> {
        self.epoch
    }

    /// Counters so far.
    pub fn counts(&self) -> ReaderCounts {
        self.followed.counts()
    }

    /// Its counters.
    pub fn report(&self) -> TopicReport {
        self.followed.report()
    }

    /// The same frame; logs that the simulator was restarted.
    fn noticed(&mut self, frame: Option<Frame>) -> Option<Frame> {
        let epoch = frame.as_ref()?.header().epoch;
        let before = self.epoch.replace(epoch);
        if !self.followed.is_quiet() && before.is_some_and(|before| before != epoch) {
            tracing::info!(
                topic = self.topic(),
                "the simulator was restarted; following its new run"
            );
        }
        frame
    }
}
