//! Several topics of frames and of results followed at once by their names, each of which wakes its
//! reader by itself.

use std::sync::Arc;
use std::time::Duration;

use schema_bus::{Bus, BusError, Frame, ResultSample, names};

use crate::ports::{Port, Ports, TopicId};
use crate::{FollowedResult, FollowedTopic, Take, TopicReport, WorldAt};

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

    /// Follows a topic of results (`detector/boxes`).
    pub fn follow_results(&mut self, topic: &str, take: Take) -> TopicId {
        let results = Box::new(FollowedResult::new(topic, take));
        self.ports.add(Port::Results(results), true)
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
                && !self.ports.has(&topic.name)
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

    /// The topic of results with this number.
    ///
    /// # Panics
    /// If another follower gave the number, or it is that of a topic of frames.
    pub fn results(&self, id: TopicId) -> &FollowedResult {
        match self.ports.get(id) {
            Some(Port::Results(results)) => results,
            _ => panic!("no topic of results of this follower has the number {id:?}"),
        }
    }

    /// Takes other frames of `id` from now on.
    pub(crate) fn set_take(&mut self, id: TopicId, take: Take) {
        self.ports.set_take(id, take);
    }

    /// Its name, whatever it carries; empty for a number of another follower.
    pub(crate) fn name(&self, id: TopicId) -> &str {
        self.ports.get(id).map_or("", Port::name)
    }

    /// Whether it was found, whatever it carries.
    pub(crate) fn found(&self, id: TopicId) -> bool {
        self.ports.get(id).is_some_and(Port::found)
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

    /// The next result of `id` to handle, if one waits.
    ///
    /// # Errors
    /// As [`FollowedResult::take`].
    pub fn take_result(&mut self, id: TopicId) -> Result<Option<ResultSample>, BusError> {
        self.ports.take_result(id)
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
