//! Several topics followed at once, each of which wakes its reader by itself.

use std::sync::Arc;
use std::time::Duration;

use schema_bus::{Bus, BusError, Frame, TopicDetails, names};

use crate::{FollowedTopic, SnapshotTrail, Take, TopicReport, WakeUps, WorldAt};

/// Longest wait, so that a consumer can look at its shutdown flag ten times a second.
pub const MAX_WAIT: Duration = Duration::from_millis(100);

/// Number of a topic in a [`Follower`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TopicId(usize);

/// A consumer's place on the bus with the topics it follows.
#[derive(Debug)]
pub struct Follower {
    // Before `bus`: ports go before their node.
    topics: Vec<FollowedTopic>,
    /// Places of topics that were left, for new ones.
    left: Vec<TopicId>,
    /// Events beside those of the topics.
    events: Vec<String>,
    trail: SnapshotTrail,
    wake_ups: WakeUps,
    bus: Bus,
}

/// How long a topic may be without a writer before who follows everything leaves it: longer than a
/// simulator takes to start again.
pub const LEAVE_AFTER: Duration = Duration::from_secs(15);

/// Whether a topic has no writer and is in the list only because others still read it: its sensor
/// has ended. A topic without a writer that nobody reads is none: its writer may wait for a reader.
pub fn is_left_over(topic: &TopicDetails) -> bool {
    topic.publishers == 0 && topic.subscribers > 0
}

impl Follower {
    /// Joins `domain` as `program`. The simulator need not run yet.
    ///
    /// # Errors
    /// As [`Bus::open`].
    pub fn open(domain: &str, program: &str) -> Result<Follower, BusError> {
        Ok(Follower::on(Bus::open(domain, program)?))
    }

    /// As [`Follower::open`] on a bus that is already open.
    pub fn on(bus: Bus) -> Follower {
        Follower {
            topics: Vec::new(),
            left: Vec::new(),
            events: Vec::new(),
            trail: SnapshotTrail::new(),
            wake_ups: WakeUps::new(),
            bus,
        }
    }

    /// The bus, for other ports.
    pub fn bus(&self) -> &Bus {
        &self.bus
    }

    /// Follows `topic` (without the domain, `ego/front/rgb`).
    pub fn follow(&mut self, topic: &str, take: Take) -> TopicId {
        if let Some(id) = self.left.pop() {
            self.topics[id.0] = FollowedTopic::new(topic, take);
            return id;
        }
        self.topics.push(FollowedTopic::new(topic, take));
        TopicId(self.topics.len() - 1)
    }

    /// Follows every sensor's topic that exists and is not followed yet, and returns the new ones.
    /// Call it from time to time to find new sensors. The spectator is no sensor, and a batch only
    /// repeats the images of its cameras: follow these by their names.
    ///
    /// # Errors
    /// As [`Bus::topics`].
    pub fn follow_all(&mut self, take: Take) -> Result<Vec<TopicId>, BusError> {
        let mut new = Vec::new();
        for topic in self.bus.topics()? {
            if topic.modality.is_some()
                && topic.name != names::SPECTATOR_RGB
                && !names::is_batch(&topic.name)
                && !self
                    .topics
                    .iter()
                    .any(|followed| followed.topic() == topic.name)
            {
                new.push(self.follow(&topic.name, take));
            }
        }
        Ok(new)
    }

    /// The topic with this number.
    pub fn topic(&self, id: TopicId) -> &FollowedTopic {
        &self.topics[id.0]
    }

    /// Numbers of all topics, in the order of `follow`.
    pub fn ids(&self) -> impl Iterator<Item = TopicId> + use<> {
        let left = self.left.clone();
        let all = (0..self.topics.len()).map(TopicId);
        all.filter(move |id| !left.contains(id))
    }

    /// Wakes [`Follower::wait`] also by `event`, for example a topic of results that is read beside
    /// the followed ones.
    ///
    /// # Errors
    /// [`BusError`] if the event cannot be opened.
    pub fn listen(&mut self, event: &str) -> Result<(), BusError> {
        if !self.events.iter().any(|known| known == event) {
            self.events.push(event.to_owned());
        }
        self.wake_ups.listen(&self.bus, event).map(drop)
    }

    /// Follows some topics no longer and hears some events of [`Follower::listen`] no longer: their
    /// ports are closed, and their numbers and counters belong to later topics.
    ///
    /// # Errors
    /// [`BusError`] if the event of a topic that is kept cannot be opened anew.
    pub fn leave(&mut self, topics: &[TopicId], events: &[String]) -> Result<(), BusError> {
        for id in topics {
            if !self.left.contains(id) {
                self.topics[id.0] = FollowedTopic::new("", Take::Newest);
                self.left.push(*id);
            }
        }
        self.events.retain(|event| !events.contains(event));
        self.wake_ups = WakeUps::new();
        for event in &self.events {
            self.wake_ups.listen(&self.bus, event)?;
        }
        let kept = |topic: &&FollowedTopic| topic.found();
        for topic in self.topics.iter().filter(kept) {
            let followed = self.topics.iter().map(FollowedTopic::topic);
            self.wake_ups.attach(&self.bus, topic.topic(), followed)?;
        }
        Ok(())
    }

    /// Looks for topics that are missing, then waits for a frame of any topic, at most `timeout` and
    /// never longer than [`MAX_WAIT`]. Returns whether there may be one; drain the topics in any
    /// case. A frame is announced as soon as it is sent, see [`WakeUps`].
    ///
    /// # Errors
    /// What waiting cannot heal, see [`FollowedTopic::look`].
    pub fn wait(&mut self, timeout: Duration) -> Result<bool, BusError> {
        let mut is_new = false;
        for idx in 0..self.topics.len() {
            if self.left.contains(&TopicId(idx)) {
                continue;
            }
            if self.topics[idx].found() || !self.topics[idx].look(&self.bus)? {
                continue;
            }
            is_new = true;
            let followed = self.topics.iter().map(FollowedTopic::topic);
            let topic = self.topics[idx].topic();
            self.wake_ups.attach(&self.bus, topic, followed)?;
        }
        // A frame may have come between opening a topic and listening to its event.
        if is_new {
            return Ok(true);
        }
        self.wake_ups.wait(timeout.min(MAX_WAIT))
    }

    /// The next frame of `id` to handle, if one waits.
    ///
    /// # Errors
    /// As [`FollowedTopic::take`].
    pub fn take(&mut self, id: TopicId) -> Result<Option<Frame>, BusError> {
        self.topics[id.0].take()
    }

    /// The world that a frame of `tick` shows. `None` if this consumer joined after that tick or
    /// fell more than 32 ticks behind.
    ///
    /// # Errors
    /// As [`SnapshotTrail::at`].
    pub fn world_at(&mut self, tick: u64) -> Result<Option<Arc<WorldAt>>, BusError> {
        self.trail.at(&self.bus, tick)
    }

    /// The newest world, if there is one.
    ///
    /// # Errors
    /// As [`SnapshotTrail::at`].
    pub fn newest_world(&mut self) -> Result<Option<Arc<WorldAt>>, BusError> {
        self.trail.newest(&self.bus)
    }

    /// The counters of every topic, for a consumer's last output.
    pub fn reports(&self) -> Vec<TopicReport> {
        self.ids().map(|id| self.topic(id).report()).collect()
    }
}
