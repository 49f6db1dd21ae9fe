//! Several topics of frames followed at once by their names, each of which wakes its reader by
//! itself.

use std::sync::Arc;
use std::time::Duration;

use schema_bus::{Bus, BusError, Frame, names};

use crate::ports::{Port, Ports, TopicId};
use crate::{FollowedTopic, Take, TopicReport, WorldAt};

/// A consumer's place on the bus with the topics it follows.
#[derive(Debug)]
pub struct Follower {
    ports: Ports,
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
            ports: Ports::on(bus),
        }
    }

    /// The bus, for other ports.
    pub fn bus(&self) -> &Bus {
        self.ports.bus()
    }

    /// Follows `topic` (without the domain, `ego/front/rgb`).
    pub fn follow(&mut self, topic: &str, take: Take) -> TopicId {
        let frames = Box::new(FollowedTopic::new(topic, take));
        self.ports.add(Port::Frames(frames), true)
    }

    /// Follows every sensor's topic that exists and is not followed yet, and returns the new ones.
    /// Call it from time to time to find new sensors. The spectator is no sensor, and a batch only
    /// repeats the images of its cameras: follow these by their names.
    ///
    /// # Errors
    /// As [`Bus::topics`].
    pub fn follow_all(&mut self, take: Take) -> Result<Vec<TopicId>, BusError> {
        let mut new = Vec::new();
        for topic in self.bus().topics()? {
            if topic.modality.is_some()
                && topic.name != names::SPECTATOR_RGB
                && !names::is_batch(&topic.name)
                && !self.ids().any(|id| self.topic(id).topic() == topic.name)
            {
                new.push(self.follow(&topic.name, take));
            }
        }
        Ok(new)
    }

    /// The topic with this number.
    ///
    /// # Panics
    /// If another follower gave the number.
    pub fn topic(&self, id: TopicId) -> &FollowedTopic {
        match self.ports.get(id) {
            Some(Port::Frames(frames)) => frames,
            _ => panic!("no topic of this follower has the number {id:?}"),
        }
    }

    /// Numbers of all topics, in the order of `follow`.
    pub fn ids(&self) -> impl Iterator<Item = TopicId> + use<> {
        self.ports.ids().into_iter()
    }

    /// Wakes [`Follower::wait`] also by `event`, for example a topic of results that is read beside
    /// the followed ones.
    ///
    /// # Errors
    /// [`BusError`] if the event cannot be opened.
    pub fn listen(&mut self, event: &str) -> Result<(), BusError> {
        self.ports.listen(event)
    }

    /// Looks for topics that are missing, then waits for a frame of any topic, at most `timeout`
    /// and never longer than [`crate::MAX_WAIT`]. Returns whether there may be one; drain the
    /// topics in any case. A frame is announced as soon as it is sent, see [`crate::WakeUps`].
    ///
    /// # Errors
    /// What waiting cannot heal, see [`FollowedTopic::look`].
    pub fn wait(&mut self, timeout: Duration) -> Result<bool, BusError> {
        if self.ports.open(|_, error| Err(error))? {
            return Ok(true);
        }
        self.ports.wait(timeout)
    }

    /// The next frame of `id` to handle, if one waits.
    ///
    /// # Errors
    /// As [`FollowedTopic::take`].
    pub fn take(&mut self, id: TopicId) -> Result<Option<Frame>, BusError> {
        self.ports.take_frame(id)
    }

    /// The world that a frame of `tick` shows. `None` if this consumer joined after that tick or
    /// fell more than 32 ticks behind.
    ///
    /// # Errors
    /// As [`crate::SnapshotTrail::at`].
    pub fn world_at(&mut self, tick: u64) -> Result<Option<Arc<WorldAt>>, BusError> {
        self.ports.world_at(tick)
    }

    /// The newest world, if there is one.
    ///
    /// # Errors
    /// As [`crate::SnapshotTrail::at`].
    pub fn newest_world(&mut self) -> Result<Option<Arc<WorldAt>>, BusError> {
        self.ports.newest_world()
    }

    /// The counters of every topic, for a consumer's last output.
    pub fn reports(&self) -> Vec<TopicReport> {
        let ids = self.ports.ids().into_iter();
        ids.filter_map(|id| self.ports.report(id)).collect()
    }
}
