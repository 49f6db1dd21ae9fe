//! A domain followed as a whole: its topics are found by one thread, opened when they are wanted,
//! followed across restarts of the simulator, and left when their writers have ended.
//!
//! Programs say with a [`Wish`] which of the listed topics they want, are told of each [`Change`],
//! and take samples topic by topic in an order of their own. What each of them needs:
//!
//! - The **recorder** follows all selected topics with every sample. Nothing may be lost: what
//!   waits in a topic that has ended is taken before it is left ([`Change::Ended`] closes
//!   nothing), and in lockstep it lists by itself ([`Domain::look_now`]) whenever the journal
//!   tells of a new sensor, before it acknowledges the tick. Snapshots are drained before frames
//!   of a newer tick.
//! - The **viewer** takes the newest frame of each topic, or every one where it draws curves, and
//!   clears what a result has drawn once its writer has ended ([`Change::Silent`]).
//! - The **bridge** knows every topic but opens only what somebody elsewhere reads
//!   ([`Wish::on_demand`], [`Domain::want`]). Its threads share one [`Listing`], and each counts
//!   its own losses, so nothing is logged about them ([`Wish::quietly`]).
//! - The **benchmark's observer** takes every sample of a program's inputs and results with ticks
//!   and times as they were sent, follows them before the world's first tick
//!   ([`Wish::also_left_over`]), lists more often while topics are missing
//!   ([`Domain::set_rhythm`]), and judges broken results itself ([`Domain::take_result_strictly`]).
//!
//! A reader is woken by the events of its open topics and by nothing else; the listing thread wakes
//! nobody. The newest list is used with the next [`Domain::look`].

mod listing;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use schema_bus::{
    Bus, BusError, Document, Frame, ReaderCounts, ResultSample, Snapshot, TopicDetails, TopicKind,
};
use schema_frames::{About, ResultType};

pub use self::listing::{Listing, Rhythm};
use crate::document::FollowedDocument;
use crate::followed::{Take, TopicReport};
use crate::ports::{Port, Ports, TopicId};
use crate::result::FollowedResult;
use crate::snapshots::{FollowedSnapshots, WorldAt};
use crate::topic::FollowedTopic;

/// How long a topic may be without a writer before who follows everything leaves it: longer than a
/// simulator takes to start again.
pub const LEAVE_AFTER: Duration = Duration::from_secs(15);

/// Whether a topic has no writer and is in the list only because others still read it: its sensor
/// has ended. A topic without a writer that nobody reads is none: its writer may wait for a reader.
pub fn is_left_over(topic: &TopicDetails) -> bool {
    topic.publishers == 0 && topic.subscribers > 0
}

/// Whether a topic is written, or would be if somebody read it.
fn is_alive(topic: &TopicDetails) -> bool {
    topic.publishers > 0 || (topic.kind == TopicKind::Frames && topic.subscribers == 0)
}

/// How a topic that was listed is to be followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wish {
    take: Take,
    is_on_demand: bool,
    is_quiet: bool,
    takes_left_over: bool,
}

impl Wish {
    /// Follow it from now on.
    pub fn follow(take: Take) -> Wish {
        Wish {
            take,
            is_on_demand: false,
            is_quiet: false,
            takes_left_over: false,
        }
    }

    /// Know that it is there, and open it with [`Domain::want`].
    pub fn on_demand(take: Take) -> Wish {
        Wish {
            is_on_demand: true,
            ..Wish::follow(take)
        }
    }

    /// The same, but nothing is logged about lost or broken samples.
    pub fn quietly(self) -> Wish {
        Wish {
            is_quiet: true,
            ..self
        }
    }

    /// The same, also of sensors that are read but not written: before a world's first tick, its
    /// topics look as if they had ended.
    pub fn also_left_over(self) -> Wish {
        Wish {
            takes_left_over: true,
            ..self
        }
    }
}

/// A topic in the list, as a program is asked about it.
#[derive(Clone, Copy, Debug)]
pub struct ListedTopic<'a> {
    /// What the list says.
    pub details: &'a TopicDetails,
    /// Whether it is known from an earlier list.
    pub is_known: bool,
}

/// What has changed about the topics that a program wants.
#[derive(Debug)]
pub enum Change {
    /// A topic is wanted from now on.
    Found {
        /// Its number.
        id: TopicId,
        /// What the list says.
        details: TopicDetails,
    },
    /// A topic is not followed because all its reader places are taken. Told once, until there was
    /// room.
    Full(TopicDetails),
    /// A topic could not be opened. It is tried again until it is left or given up.
    Refused {
        /// Its number.
        id: TopicId,
        /// Why.
        error: BusError,
    },
    /// The writer of a topic has ended; another may come.
    Silent(TopicId),
    /// A topic is no longer in the list.
    Unlisted(TopicId),
    /// A topic has had no writer for [`LEAVE_AFTER`], or is wanted no more: take what waits, then
    /// [`Domain::leave`] it.
    Ended(TopicId),
}

/// A listed topic that is wanted.
#[derive(Debug)]
struct Known {
    id: TopicId,
    kind: TopicKind,
    result: Option<ResultType>,
    /// When it was last listed with a writer; `None` before it ever was.
    alive: Option<Instant>,
    has_writer: bool,
    is_listed: bool,
}

impl Known {
    fn is(&self, topic: &TopicDetails) -> bool {
        (self.kind, self.result) == (topic.kind, topic.result)
    }
}

/// The topics of a domain that a program wants, with their ports.
#[derive(Debug)]
pub struct Domain {
    topics: BTreeMap<String, Known>,
    ports: Ports,
    listing: Listing,
    changes: VecDeque<Change>,
    /// Topics that were left and whose writers have not come back.
    left: BTreeSet<String>,
    full: BTreeSet<String>,
}

impl Domain {
    /// Follows the domain that `bus` has joined, whose topics `listing` lists.
    pub fn on(bus: Bus, listing: Listing) -> Domain {
        Domain {
            topics: BTreeMap::new(),
            ports: Ports::on(bus),
            listing,
            changes: VecDeque::new(),
            left: BTreeSet::new(),
            full: BTreeSet::new(),
        }
    }

    /// The bus, for other ports.
    pub fn bus(&self) -> &Bus {
        self.ports.bus()
    }

    /// Lists in another rhythm from now on.
    pub fn set_rhythm(&self, rhythm: Rhythm) {
        self.listing.set_rhythm(rhythm);
    }

    /// Goes through the newest list if there is one since the last call, which it returns. `wants`
    /// is asked about every listed topic each time; `None` leaves it, or leaves it out.
    ///
    /// # Errors
    /// [`BusError`] if the domain could not be listed.
    pub fn look(
        &mut self,
        wants: impl FnMut(ListedTopic<'_>) -> Option<Wish>,
    ) -> Result<bool, BusError> {
        let Some(topics) = self.listing.changed()? else {
            return Ok(false);
        };
        self.go_through(&topics, wants);
        Ok(true)
    }

    /// Lists now and goes through that, as [`Domain::look`]; the next [`Domain::open`] opens all
    /// that there is by then.
    ///
    /// # Errors
    /// As [`Bus::topics`].
    pub fn look_now(
        &mut self,
        wants: impl FnMut(ListedTopic<'_>) -> Option<Wish>,
    ) -> Result<(), BusError> {
        let topics = self.bus().topics()?;
        self.go_through(&topics, wants);
        self.ports.hurry();
        Ok(())
    }

    fn go_through(
        &mut self,
        topics: &[TopicDetails],
        mut wants: impl FnMut(ListedTopic<'_>) -> Option<Wish>,
    ) {
        let now = Instant::now();
        let (mut listed, mut unwanted) = (BTreeSet::new(), BTreeSet::new());
        for details in topics {
            let is_known = self.topics.contains_key(&details.name);
            let wish = wants(ListedTopic { details, is_known });
            match (self.topics.get_mut(&details.name), wish) {
                (Some(known), Some(_)) if known.is(details) => {
                    listed.insert(details.name.as_str());
                    known.is_listed = true;
                    if is_alive(details) {
                        known.alive = Some(now);
                    }
                    let had_writer =
                        std::mem::replace(&mut known.has_writer, details.publishers > 0);
                    if had_writer && details.publishers == 0 {
                        self.changes.push_back(Change::Silent(known.id));
                    }
                }
                (Some(known), _) => {
                    unwanted.insert(details.name.as_str());
                    self.changes.push_back(Change::Ended(known.id));
                }
                (None, Some(wish)) => {
                    listed.insert(details.name.as_str());
                    self.find(details, wish, now);
                }
                (None, None) => {}
            }
        }
        for (name, known) in &mut self.topics {
            if unwanted.contains(name.as_str()) {
                continue;
            }
            if !listed.contains(name.as_str()) && std::mem::take(&mut known.is_listed) {
                self.changes.push_back(Change::Unlisted(known.id));
            }
            let seen = known.alive.max(self.ports.taken(known.id));
            if seen.is_some_and(|at| now.duration_since(at) >= LEAVE_AFTER) {
                self.changes.push_back(Change::Ended(known.id));
            }
        }
    }

    /// Follows a topic that is new, unless it has ended or has no place for another reader.
    fn find(&mut self, details: &TopicDetails, wish: Wish, now: Instant) {
        let has_ended = match details.kind {
            TopicKind::Frames => !wish.takes_left_over && is_left_over(details),
            // Other readers keep a topic in the list after its writer has ended.
            _ => details.publishers == 0 && self.left.contains(&details.name),
        };
        let name = details.name.as_str();
        if !wish.is_on_demand && details.subscribers >= details.max_subscribers {
            if self.full.insert(name.to_owned()) {
                self.changes.push_back(Change::Full(details.clone()));
            }
            return;
        }
        self.full.remove(name);
        if has_ended {
            return;
        }
        let port = match details.kind {
            TopicKind::Frames => {
                let frames = FollowedTopic::new(name, wish.take);
                Port::Frames(Box::new(match wish.is_quiet {
                    true => frames.quietly(),
                    false => frames,
                }))
            }
            TopicKind::Results => {
                let results = FollowedResult::new(name, wish.take);
                Port::Results(Box::new(match wish.is_quiet {
                    true => results.quietly(),
                    false => results,
                }))
            }
            TopicKind::Snapshot => Port::Snapshots(Box::new(FollowedSnapshots::optional())),
            TopicKind::Document => Port::Document(Box::new(FollowedDocument::optional(name))),
            TopicKind::Controls | TopicKind::Other => return,
        };
        let id = self.ports.add(port, !wish.is_on_demand);
        self.left.remove(name);
        let is_frames = details.kind == TopicKind::Frames;
        let known = Known {
            id,
            kind: details.kind,
            result: details.result,
            alive: (is_frames || details.publishers > 0).then_some(now),
            has_writer: details.publishers > 0,
            is_listed: true,
        };
        self.topics.insert(name.to_owned(), known);
        let details = details.clone();
        self.changes.push_back(Change::Found { id, details });
    }

    /// The next change that was not told yet. Take all of them after each look and each wait.
    pub fn change(&mut self) -> Option<Change> {
        self.changes.pop_front()
    }

    /// Follows the snapshots of the world, also before they exist. They do not wake
    /// the reader, because frames of their tick follow.
    pub fn follow_snapshots(&mut self) -> TopicId {
        let port = Port::Snapshots(Box::new(FollowedSnapshots::optional()));
        self.ports.add_unheard(port)
    }

    /// The snapshots of the world, also before they exist, opened with [`Domain::want`]. While they
    /// are open, they wake the reader.
    pub fn snapshots_on_demand(&mut self) -> TopicId {
        let port = Port::Snapshots(Box::new(FollowedSnapshots::optional()));
        self.ports.add(port, false)
    }

    /// Follows a document of the world by its name, also before it exists.
    pub fn follow_document(&mut self, name: &str) -> TopicId {
        let port = Port::Document(Box::new(FollowedDocument::new(name)));
        self.ports.add(port, true)
    }

    /// Opens a topic that is known with the next [`Domain::open`], or closes it. Returns what was
    /// counted of one that was closed now.
    pub fn want(&mut self, id: TopicId, is_wanted: bool) -> Option<TopicReport> {
        self.ports.want(id, is_wanted)
    }

    /// Whether a topic is open, or is opened as soon as it can be.
    pub fn is_wanted(&self, id: TopicId) -> bool {
        self.ports.is_wanted(id)
    }

    /// Closes a topic for good and returns what was counted of it. If it is listed with a writer
    /// later, it is found anew.
    pub fn leave(&mut self, id: TopicId) -> Option<TopicReport> {
        let report = self.ports.remove(id)?;
        if self.topics.remove(&report.topic).is_some() {
            self.left.insert(report.topic.clone());
        }
        Some(report)
    }

    /// Opens what is wanted and exists by now. Returns whether anything was opened.
    ///
    /// # Errors
    /// [`BusError`] if an event cannot be opened; what is wrong with single topics are changes.
    pub fn open(&mut self) -> Result<bool, BusError> {
        let changes = &mut self.changes;
        self.ports.open(|id, error| {
            changes.push_back(Change::Refused { id, error });
            Ok(())
        })
    }

    /// As [`Domain::open`], then waits for a sample of any topic, at most `timeout` and never
    /// longer than [`crate::MAX_WAIT`]. Returns whether there may be one; drain the topics in any
    /// case.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn wait(&mut self, timeout: Duration) -> Result<bool, BusError> {
        if self.open()? {
            return Ok(true);
        }
        self.ports.wait(timeout)
    }

    /// The next frame of a topic to handle, if one waits.
    ///
    /// # Errors
    /// As [`FollowedTopic::take`].
    pub fn take_frame(&mut self, id: TopicId) -> Result<Option<Frame>, BusError> {
        let frame = self.ports.take_frame(id)?;
        if frame.is_some() {
            self.ports.note_taken(id);
        }
        Ok(frame)
    }

    /// The next result of a topic to handle, if one waits; its description is looked at before.
    ///
    /// # Errors
    /// As [`FollowedResult::take`].
    pub fn take_result(&mut self, id: TopicId) -> Result<Option<ResultSample>, BusError> {
        self.take_result_with(id, FollowedResult::take)
    }

    /// As [`Domain::take_result`], but a result that breaks the contract is an error.
    ///
    /// # Errors
    /// As [`FollowedResult::take_strictly`].
    pub fn take_result_strictly(&mut self, id: TopicId) -> Result<Option<ResultSample>, BusError> {
        self.take_result_with(id, FollowedResult::take_strictly)
    }

    fn take_result_with(
        &mut self,
        id: TopicId,
        take: impl FnOnce(&mut FollowedResult) -> Result<Option<ResultSample>, BusError>,
    ) -> Result<Option<ResultSample>, BusError> {
        let Some((Port::Results(results), bus)) = self.ports.get_mut(id) else {
            return Ok(None);
        };
        if !results.found() {
            return Ok(None);
        }
        results.look(bus)?;
        let result = take(results)?;
        if result.is_some() {
            self.ports.note_taken(id);
        }
        Ok(result)
    }

    /// The next snapshot of the world, if one waits.
    ///
    /// # Errors
    /// As [`FollowedSnapshots::take`].
    pub fn take_snapshot(&mut self, id: TopicId) -> Result<Option<Snapshot>, BusError> {
        match self.ports.get_mut(id) {
            Some((Port::Snapshots(snapshots), _)) => snapshots.take(),
            _ => Ok(None),
        }
    }

    /// A document, if it has changed since the last call.
    ///
    /// # Errors
    /// As [`FollowedDocument::changed`].
    pub fn take_document(&mut self, id: TopicId) -> Result<Option<&Document>, BusError> {
        match self.ports.get_mut(id) {
            Some((Port::Document(document), bus)) => document.changed(bus),
            _ => Ok(None),
        }
    }

    /// The newest document that was seen.
    pub fn document(&self, id: TopicId) -> Option<&Document> {
        match self.ports.get(id)? {
            Port::Document(document) => document.newest(),
            _ => None,
        }
    }

    /// A topic of results: its description, its type, whether it has a writer.
    pub fn results(&self, id: TopicId) -> Option<&FollowedResult> {
        match self.ports.get(id)? {
            Port::Results(results) => Some(results),
            _ => None,
        }
    }

    /// Looks at the description of a topic of results, also while it is closed.
    pub fn describe(&mut self, id: TopicId) -> Option<&About> {
        match self.ports.get_mut(id)? {
            (Port::Results(results), bus) => Some(results.describe(bus)),
            _ => None,
        }
    }

    /// Numbers and names of the listed topics that are wanted, by name.
    pub fn topics(&self) -> impl Iterator<Item = (TopicId, &str)> {
        let topics = self.topics.iter();
        topics.map(|(name, known)| (known.id, name.as_str()))
    }

    /// The world of exactly `tick`, as [`crate::Follower::world_at`].
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

    /// What was counted of a topic since it was opened.
    pub fn counts(&self, id: TopicId) -> ReaderCounts {
        self.ports.get(id).map(Port::counts).unwrap_or_default()
    }

    /// What was counted of every listed topic that is wanted.
    pub fn reports(&self) -> impl Iterator<Item = TopicReport> {
        let topics = self.topics.values();
        topics.filter_map(|known| self.ports.report(known.id))
    }
}
