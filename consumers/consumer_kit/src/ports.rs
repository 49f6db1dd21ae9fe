//! Ports of several topics of any kind: opened when their topics appear, closed when they are not
//! needed, and awaited together.

use std::sync::Arc;
use std::time::{Duration, Instant};

use schema_bus::{Bus, BusError, Frame, ReaderCounts, ResultSample, names};

use crate::document::FollowedDocument;
use crate::followed::{Take, TopicReport};
use crate::result::FollowedResult;
use crate::snapshots::{FollowedSnapshots, SnapshotTrail, WorldAt};
use crate::topic::FollowedTopic;
use crate::wake::WakeUps;

/// Longest wait, so that a consumer can look at its shutdown flag ten times a second.
pub const MAX_WAIT: Duration = Duration::from_millis(100);

/// Number of a topic in a [`crate::Follower`] or a [`crate::Domain`]. After the topic was left it
/// belongs to a later one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TopicId(usize);

/// One topic that is followed.
#[derive(Debug)]
pub(crate) enum Port {
    Frames(Box<FollowedTopic>),
    Results(Box<FollowedResult>),
    Snapshots(Box<FollowedSnapshots>),
    Document(Box<FollowedDocument>),
}

impl Port {
    pub(crate) fn name(&self) -> &str {
        match self {
            Port::Frames(frames) => frames.topic(),
            Port::Results(results) => results.topic(),
            Port::Snapshots(_) => names::WORLD_SNAPSHOT,
            Port::Document(document) => document.name(),
        }
    }

    pub(crate) fn found(&self) -> bool {
        match self {
            Port::Frames(frames) => frames.found(),
            Port::Results(results) => results.found(),
            Port::Snapshots(snapshots) => snapshots.found(),
            Port::Document(document) => document.found(),
        }
    }

    fn look(&mut self, bus: &Bus) -> Result<bool, BusError> {
        match self {
            Port::Frames(frames) => frames.look(bus),
            Port::Results(results) => results.look(bus),
            Port::Snapshots(snapshots) => snapshots.look(bus),
            Port::Document(document) => document.look(bus),
        }
    }

    /// Looks for its topic with the next look, whenever the last one was.
    fn hurry(&mut self) {
        match self {
            Port::Frames(frames) => frames.hurry(),
            Port::Results(results) => results.hurry(),
            Port::Snapshots(snapshots) => snapshots.search.hurry(),
            Port::Document(document) => document.search.hurry(),
        }
    }

    /// Closes it for as long as it is not wanted.
    fn close(&mut self) {
        match self {
            Port::Frames(frames) => frames.close(),
            Port::Results(results) => results.close(),
            Port::Snapshots(snapshots) => **snapshots = FollowedSnapshots::optional(),
            Port::Document(document) => {
                **document = FollowedDocument::optional(document.name());
            }
        }
    }

    pub(crate) fn counts(&self) -> ReaderCounts {
        match self {
            Port::Frames(frames) => frames.counts(),
            Port::Results(results) => results.counts(),
            Port::Snapshots(snapshots) => ReaderCounts {
                lost: snapshots.lost(),
                ..ReaderCounts::default()
            },
            Port::Document(_) => ReaderCounts::default(),
        }
    }

    fn report(&self) -> TopicReport {
        TopicReport {
            topic: self.name().to_owned(),
            found: self.found(),
            counts: self.counts(),
        }
    }
}

/// A port, and whether it is to be open.
#[derive(Debug)]
struct Place {
    port: Port,
    is_wanted: bool,
    /// Whether its samples wake the reader.
    wakes: bool,
    /// When something was last taken from it.
    taken: Option<Instant>,
}

/// A place on the bus with the ports of several topics.
#[derive(Debug)]
pub(crate) struct Ports {
    // Before `bus`: ports go before their node.
    places: Vec<Option<Place>>,
    /// Events beside those of the topics.
    events: Vec<String>,
    trail: SnapshotTrail,
    wake_ups: WakeUps,
    /// Whether ports were closed, so that what wakes the reader is put together anew.
    is_changed: bool,
    bus: Bus,
}

impl Ports {
    pub(crate) fn on(bus: Bus) -> Ports {
        Ports {
            places: Vec::new(),
            events: Vec::new(),
            trail: SnapshotTrail::new(),
            wake_ups: WakeUps::new(),
            is_changed: false,
            bus,
        }
    }

    pub(crate) fn bus(&self) -> &Bus {
        &self.bus
    }

    /// Adds a port, which is opened by the next [`Ports::open`] if it is wanted.
    pub(crate) fn add(&mut self, port: Port, is_wanted: bool) -> TopicId {
        self.put(Place {
            port,
            is_wanted,
            wakes: true,
            taken: None,
        })
    }

    /// Adds a port that is wanted, but whose samples wake nobody.
    pub(crate) fn add_unheard(&mut self, port: Port) -> TopicId {
        self.put(Place {
            port,
            is_wanted: true,
            wakes: false,
            taken: None,
        })
    }

    fn put(&mut self, place: Place) -> TopicId {
        let place = Some(place);
        match self.places.iter().position(Option::is_none) {
            Some(free) => {
                self.places[free] = place;
                TopicId(free)
            }
            None => {
                self.places.push(place);
                TopicId(self.places.len() - 1)
            }
        }
    }

    /// Closes a port for good; its number belongs to a later topic.
    pub(crate) fn remove(&mut self, id: TopicId) -> Option<TopicReport> {
        let place = self.places.get_mut(id.0)?.take()?;
        self.is_changed |= place.port.found();
        Some(place.port.report())
    }

    /// Opens a port with the next [`Ports::open`], or closes it. Returns what one that was closed
    /// now had counted.
    pub(crate) fn want(&mut self, id: TopicId, is_wanted: bool) -> Option<TopicReport> {
        let place = self.places.get_mut(id.0)?.as_mut()?;
        if place.is_wanted == is_wanted {
            return None;
        }
        place.is_wanted = is_wanted;
        self.is_changed = true;
        let report = (!is_wanted).then(|| place.port.report());
        if !is_wanted {
            place.port.close();
        }
        report
    }

    pub(crate) fn is_wanted(&self, id: TopicId) -> bool {
        self.place(id).is_some_and(|place| place.is_wanted)
    }

    fn place(&self, id: TopicId) -> Option<&Place> {
        self.places.get(id.0)?.as_ref()
    }

    pub(crate) fn get(&self, id: TopicId) -> Option<&Port> {
        self.place(id).map(|place| &place.port)
    }

    pub(crate) fn get_mut(&mut self, id: TopicId) -> Option<(&mut Port, &Bus)> {
        let place = self.places.get_mut(id.0)?.as_mut()?;
        Some((&mut place.port, &self.bus))
    }

    /// Takes other frames of `id` from now on.
    pub(crate) fn set_take(&mut self, id: TopicId, take: Take) {
        if let Some((Port::Frames(frames), _)) = self.get_mut(id) {
            frames.set_take(take);
        }
    }

    /// Whether a topic is followed.
    pub(crate) fn has(&self, topic: &str) -> bool {
        let mut places = self.places.iter().flatten();
        places.any(|place| place.port.name() == topic)
    }

    /// When something was last taken from a topic.
    pub(crate) fn taken(&self, id: TopicId) -> Option<Instant> {
        self.place(id)?.taken
    }

    /// Notes that something was taken.
    pub(crate) fn note_taken(&mut self, id: TopicId) {
        if let Some(place) = self.places.get_mut(id.0).and_then(Option::as_mut) {
            place.taken = Some(Instant::now());
        }
    }

    pub(crate) fn ids(&self) -> Vec<TopicId> {
        let places = self.places.iter().enumerate();
        places
            .filter(|(_, place)| place.is_some())
            .map(|(idx, _)| TopicId(idx))
            .collect()
    }

    pub(crate) fn report(&self, id: TopicId) -> Option<TopicReport> {
        self.get(id).map(Port::report)
    }

    /// Wakes [`Ports::wait`] also by `event`.
    pub(crate) fn listen(&mut self, event: &str) -> Result<(), BusError> {
        if !self.events.iter().any(|known| known == event) {
            self.events.push(event.to_owned());
        }
        self.wake_ups.listen(&self.bus, event).map(drop)
    }

    /// Lets the next [`Ports::open`] look for all that is missing, whenever it last did.
    pub(crate) fn hurry(&mut self) {
        let places = self.places.iter_mut().flatten();
        places.for_each(|place| place.port.hurry());
    }

    /// Opens ports that are wanted and whose topics exist by now. Returns whether any was opened; a
    /// sample may have come between opening a topic and listening to its event.
    ///
    /// # Errors
    /// What `failed` makes of errors of single topics; [`BusError`] if an event cannot be opened.
    pub(crate) fn open(
        &mut self,
        mut failed: impl FnMut(TopicId, BusError) -> Result<(), BusError>,
    ) -> Result<bool, BusError> {
        if std::mem::take(&mut self.is_changed) {
            self.wake_ups = WakeUps::new();
            for event in &self.events {
                self.wake_ups.listen(&self.bus, event)?;
            }
            for idx in 0..self.places.len() {
                self.attach(idx)?;
            }
        }
        let mut is_new = false;
        for idx in 0..self.places.len() {
            let Some(place) = &mut self.places[idx] else {
                continue;
            };
            if !place.is_wanted || place.port.found() {
                continue;
            }
            match place.port.look(&self.bus) {
                Ok(true) => {
                    is_new = true;
                    self.attach(idx)?;
                }
                Ok(false) => {}
                Err(error) => failed(TopicId(idx), error)?,
            }
        }
        Ok(is_new)
    }

    /// Listens to what announces the samples of an open port.
    fn attach(&mut self, idx: usize) -> Result<(), BusError> {
        let is_heard = |place: &&Place| place.wakes && place.port.found();
        let Some(place) = self.places[idx].as_ref().filter(is_heard) else {
            return Ok(());
        };
        match &place.port {
            Port::Frames(frames) => {
                let followed = self.places.iter().flatten().filter(|it| it.is_wanted);
                let topics = followed.filter_map(|it| match &it.port {
                    Port::Frames(frames) => Some(frames.topic()),
                    _ => None,
                });
                self.wake_ups.attach(&self.bus, frames.topic(), topics)?;
            }
            Port::Results(_) | Port::Snapshots(_) => {
                self.wake_ups.listen(&self.bus, place.port.name())?;
            }
            // They change rarely, and nobody is woken for them.
            Port::Document(_) => {}
        }
        Ok(())
    }

    /// Waits for a wake-up, at most `timeout` and never longer than [`MAX_WAIT`].
    pub(crate) fn wait(&mut self, timeout: Duration) -> Result<bool, BusError> {
        self.wake_ups.wait(timeout.min(MAX_WAIT))
    }

    /// The next frame of `id` to handle, if one waits.
    pub(crate) fn take_frame(&mut self, id: TopicId) -> Result<Option<Frame>, BusError> {
        match self.get_mut(id) {
            Some((Port::Frames(frames), _)) => frames.take(),
            _ => Ok(None),
        }
    }

    /// The next result of `id` to handle, if one waits.
    pub(crate) fn take_result(&mut self, id: TopicId) -> Result<Option<ResultSample>, BusError> {
        match self.get_mut(id) {
            Some((Port::Results(results), _)) => results.take(),
            _ => Ok(None),
        }
    }

    pub(crate) fn world_at(&mut self, tick: u64) -> Result<Option<Arc<WorldAt>>, BusError> {
        self.trail.at(&self.bus, tick)
    }

    pub(crate) fn newest_world(&mut self) -> Result<Option<Arc<WorldAt>>, BusError> {
        self.trail.newest(&self.bus)
    }
}
