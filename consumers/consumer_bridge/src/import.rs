//! From the link to the bus: publishes what other machines offer under the same names, with the
//! same bytes, so that every consumer here works as beside the simulator.
//!
//! A topic is asked for only while somebody here reads it. When the other machine is gone its
//! topics have no writer here, like those of a simulator that ended; readers wait, and go on when
//! it is back.

pub mod events;
pub mod inbox;
mod ports;
mod topic;
mod world;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use schema_bus::{Bus, ServicePorts, WaitSet, names};
use zenoh::{Session, Wait as _};

use crate::announce::{Announcement, Kind, Offer};
use crate::clock::{Clock, Due};
use crate::counts::Counts;
use crate::export::Imported as Names;
use crate::keys::Keys;
use crate::options::Options;
use events::{Event, Events, News, ask_clock, ask_topics};
use inbox::{Inbox, Waker};
use ports::Rigs;
use topic::{Context, Topic};
use world::{Controls, MirroredWorld};

/// Longest wait for anything from the link.
const WAIT: Duration = Duration::from_millis(20);
/// How often the numbers of readers are looked at.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// How often a bridge that has not said what it offers is asked, and a place that was taken is
/// tried.
const TRY_EVERY: Duration = Duration::from_secs(1);
/// How often another machine's clock is asked for.
const CLOCK_EVERY: Duration = Duration::from_secs(5);
/// Other bridges at a time.
const MAX_PEERS: usize = 64;
/// What all other bridges may announce together, bytes.
const MAX_ANNOUNCED_BYTES: usize = 64 << 20;
/// Sentences about topics that are not taken; further ones are not said.
const MAX_SAID: usize = 1000;
/// Snapshots and documents that wait to be published.
const WORLD_INBOX: usize = 32;

/// Another bridge.
#[derive(Debug, Default)]
struct Peer {
    announcement: Option<Announcement>,
    /// Length of what it announced.
    n_bytes: usize,
    clock: Clock,
    ask: Due,
    ask_clock: Due,
}

/// Snapshots or a document of the world, as they arrive.
#[derive(Debug)]
struct Feed {
    name: String,
    inbox: Arc<Inbox>,
    _subscriber: zenoh::pubsub::Subscriber<()>,
}

/// Publishes what other machines offer.
#[derive(Debug)]
pub struct Importer {
    // Ports go before their node.
    topics: BTreeMap<String, Topic>,
    world: Option<MirroredWorld>,
    feeds: Vec<Feed>,
    rigs: Rigs,
    wait_set: WaitSet,
    bus: Bus,
    session: Session,
    keys: Keys,
    options: Options,
    names: Names,
    counts: Counts,
    events: Arc<Events>,
    waker: Arc<Waker>,
    peers: BTreeMap<String, Peer>,
    look: Due,
    try_again: Due,
    /// Why topics are not taken, each said once.
    said: std::collections::BTreeSet<String>,
    _news: News,
}

impl Importer {
    /// Joins the domain and begins to look for other bridges.
    ///
    /// # Errors
    /// [`schema_bus::BusError`], and what zenoh says.
    pub fn open(
        session: &Session,
        keys: &Keys,
        options: &Options,
        names: Names,
        counts: Counts,
    ) -> anyhow::Result<Importer> {
        let bus = Bus::open_with(&options.domain, "gantry-bridge", &options.bus)?;
        let waker = Waker::new()?;
        let events = Events::new(&waker);
        let mut wait_set = WaitSet::new();
        wait_set.add(bus.listener(names::CONTROL_WAKE)?);
        Ok(Importer {
            topics: BTreeMap::new(),
            world: None,
            feeds: Vec::new(),
            rigs: Rigs::default(),
            wait_set,
            _news: News::subscribe(session, keys, &events)?,
            bus,
            session: session.clone(),
            keys: keys.clone(),
            options: options.clone(),
            names,
            counts,
            events,
            waker,
            peers: BTreeMap::new(),
            look: Due::default(),
            try_again: Due::default(),
            said: std::collections::BTreeSet::new(),
        })
    }

    /// One turn: publishes what has arrived and passes on what is asked here, then waits for more,
    /// never longer than a fiftieth of a second.
    ///
    /// # Errors
    /// What going on cannot heal.
    pub fn turn(&mut self) -> anyhow::Result<()> {
        self.waker.drain();
        for event in self.events.take() {
            self.handle(event);
        }
        self.publish_world();
        self.publish_topics();
        if let Some(world) = &mut self.world {
            world.greet();
            world.serve()?;
        }
        if self.look.is_due(LOOK_EVERY) {
            self.look_after_topics();
        }
        if self.try_again.is_due(TRY_EVERY) {
            self.settle()?;
        }
        self.wait_set.wait_beside(&[self.waker.as_fd()], WAIT)?;
        Ok(())
    }

    fn handle(&mut self, event: Event) {
        match event {
            Event::Came(id) => {
                tracing::debug!(bridge = id, "another bridge is there");
                if self.peer(id).is_some() {
                    self.try_again.hurry();
                }
            }
            Event::Went(id) => {
                if let Some(peer) = self.peers.remove(&id) {
                    let host = peer.announcement.map(|of| of.host).unwrap_or_default();
                    tracing::info!(bridge = id, host, "another bridge is gone; its topics wait");
                    self.forget(&id);
                }
            }
            Event::Announced {
                id,
                announcement,
                n_bytes,
            } => self.take_announcement(id, *announcement, n_bytes),
            Event::Clock {
                id,
                answer,
                asked_nanos,
                answered_nanos,
            } => {
                if let Some(peer) = self.peers.get_mut(&id) {
                    peer.clock.note(&answer, asked_nanos, answered_nanos);
                }
            }
            Event::Answer(number, answer) => {
                if let Some(world) = &mut self.world {
                    world.answer(number, answer);
                }
            }
        }
    }

    /// The bridge of this id, which is a new one if there is room for it.
    fn peer(&mut self, id: String) -> Option<&mut Peer> {
        if self.peers.len() >= MAX_PEERS && !self.peers.contains_key(&id) {
            self.say_once(format!(
                "this bridge is linked with {MAX_PEERS} others, the most that there may be; what further ones offer does not appear here"
            ));
            return None;
        }
        Some(self.peers.entry(id).or_default())
    }

    fn take_announcement(&mut self, id: String, announcement: Announcement, n_bytes: usize) {
        let others = self.peers.iter().filter(|(of, _)| **of != id);
        let of_others: usize = others.map(|(_, peer)| peer.n_bytes).sum();
        if of_others + n_bytes > MAX_ANNOUNCED_BYTES {
            self.say_once(format!(
                "all other bridges together announce more than {} MiB; what the last ones offer does not appear here",
                MAX_ANNOUNCED_BYTES >> 20
            ));
            return;
        }
        let Some(peer) = self.peer(id.clone()) else {
            return;
        };
        peer.n_bytes = n_bytes;
        let is_first = peer.announcement.is_none();
        if is_first {
            tracing::info!(
                bridge = id,
                host = announcement.host,
                domain = announcement.domain,
                topics = announcement.topics.len(),
                "linked with another bridge"
            );
        }
        peer.announcement = Some(announcement);
        self.try_again.hurry();
    }

    /// Ends all that came from a bridge.
    fn forget(&mut self, id: &str) {
        self.topics.retain(|_, topic| topic.peer() != id);
        if self.world.as_ref().is_some_and(|world| world.peer == id) {
            self.feeds.clear();
            self.world = None;
        }
        self.keep_names();
    }

    /// Brings topics and world in line with what the other bridges offer.
    fn settle(&mut self) -> anyhow::Result<()> {
        for (id, peer) in &mut self.peers {
            if peer.announcement.is_none() && peer.ask.is_due(TRY_EVERY) {
                ask_topics(&self.session, &self.keys, id, &self.events);
            }
            if peer.ask_clock.is_due(CLOCK_EVERY) {
                ask_clock(&self.session, &self.keys, id, &self.events);
            }
        }
        let announced: Vec<(String, Announcement)> = self
            .peers
            .iter()
            .filter_map(|(id, peer)| Some((id.clone(), peer.announcement.clone()?)))
            .collect();
        for (id, announcement) in &announced {
            let is_offered = |topic: &Topic| {
                topic.peer() != id || announcement.topics.iter().any(|offer| topic.is_of(offer))
            };
            self.topics.retain(|_, topic| is_offered(topic));
            self.settle_world(id, announcement)?;
        }
        self.keep_names();
        for (id, announcement) in &announced {
            self.add_topics(id, announcement)?;
        }
        if let Some(world) = &mut self.world {
            world.look_after_participants(&self.bus)?;
        }
        Ok(())
    }

    fn settle_world(&mut self, id: &str, announcement: &Announcement) -> anyhow::Result<()> {
        let is_wanted = announcement.has_world() && self.options.has(names::WORLD_INFO);
        let is_ours = self.world.as_ref().is_some_and(|world| world.peer == id);
        if is_ours && !is_wanted {
            tracing::info!(host = announcement.host, "its simulator has ended");
            self.feeds.clear();
            self.world = None;
        }
        if is_wanted && self.world.is_none() {
            let world =
                MirroredWorld::open(&self.bus, &self.session, &self.keys, &self.events, id)?;
            let Some(world) = world else {
                let sentence = format!(
                    "domain {:?} has a simulator of its own, so the world of {} does not appear here; its other topics do",
                    self.options.domain, announcement.host
                );
                self.say_once(sentence);
                return Ok(());
            };
            tracing::info!(host = announcement.host, "its world appears here");
            self.world = Some(world);
        }
        if self.world.as_ref().is_some_and(|world| world.peer == id) {
            self.feed_world(id, announcement)?;
        }
        if let Some(world) = self.world.as_mut().filter(|world| world.peer == id) {
            world.lockstep = self.options.lockstep && announcement.lockstep;
            world.passes = match (self.options.control, announcement.control) {
                (false, _) => Controls::RefusedHere,
                (_, false) => Controls::RefusedThere,
                _ => Controls::PassedOn,
            };
        }
        Ok(())
    }

    /// Subscribes to the snapshots and documents that are offered and not fed yet, and asks for the
    /// newest of each. The other bridge may list its domain while the simulator opens its topics:
    /// documents may be announced later than the world itself.
    fn feed_world(&mut self, id: &str, announcement: &Announcement) -> anyhow::Result<()> {
        let is_missing = |offer: &&Offer| {
            matches!(offer.kind, Kind::Snapshot | Kind::Document)
                && !self.feeds.iter().any(|feed| feed.name == offer.name)
        };
        let missing: Vec<&Offer> = announcement.topics.iter().filter(is_missing).collect();
        for offer in missing {
            let inbox = Inbox::new(WORLD_INBOX, &self.waker);
            let key = self.keys.from(id, &offer.name);
            let to = inbox.clone();
            let failed = |error: zenoh::Error| {
                anyhow::anyhow!("cannot subscribe to {:?}: {error}", offer.name)
            };
            let subscriber = self
                .session
                .declare_subscriber(key.clone())
                .callback(move |sample| to.push(sample))
                .wait()
                .map_err(failed)?;
            let to = inbox.clone();
            self.session
                .get(key)
                .callback(move |reply| {
                    if let Ok(sample) = reply.into_result() {
                        to.push(sample);
                    }
                })
                .wait()
                .map_err(failed)?;
            self.feeds.push(Feed {
                name: offer.name.clone(),
                inbox,
                _subscriber: subscriber,
            });
        }
        // `world/info` says that a world is there, so it comes last of the documents.
        self.feeds.sort_by_key(|feed| {
            (
                feed.name == names::WORLD_INFO,
                feed.name == names::WORLD_SNAPSHOT,
            )
        });
        Ok(())
    }

    fn add_topics(&mut self, id: &str, announcement: &Announcement) -> anyhow::Result<()> {
        let mut services: Option<Vec<ServicePorts>> = None;
        for offer in &announcement.topics {
            let is_topic = matches!(offer.kind, Kind::Frames | Kind::Results);
            if !is_topic || !self.options.has(&offer.name) {
                continue;
            }
            if let Some(known) = self.topics.get_mut(&offer.name) {
                if known.peer() == id
                    && let Err(error) = known.describe(&self.bus, offer)
                {
                    tracing::debug!(topic = offer.name, "cannot be described: {error:#}");
                }
                continue;
            }
            let services = match &mut services {
                Some(services) => services,
                empty => match self.bus.services() {
                    Ok(services) => empty.insert(services),
                    Err(error) => {
                        tracing::debug!(%error, "cannot list the services; trying again");
                        return Ok(());
                    }
                },
            };
            let has_simulator = self.world.is_none() && self.bus.daemon_alive()?;
            if let Some(why) = topic::conflict(offer, services, has_simulator) {
                self.say_once(format!(
                    "{:?} of {} does not appear here: {why}",
                    offer.name, announcement.host
                ));
                continue;
            }
            self.names.lock().insert(offer.name.clone());
            match Topic::open(&self.bus, offer, id, &self.waker) {
                Ok(topic) => {
                    self.rigs.add(&self.bus, &offer.name)?;
                    self.topics.insert(offer.name.clone(), topic);
                }
                Err(error) => {
                    self.names.lock().remove(&offer.name);
                    self.say_once(format!(
                        "{:?} of {} does not appear here: {error:#}",
                        offer.name, announcement.host
                    ));
                }
            }
        }
        Ok(())
    }

    /// Tells the exporting side what is published here by this bridge, and closes what belonged to
    /// topics that are published no longer.
    fn keep_names(&mut self) {
        self.rigs.keep(self.topics.keys().map(String::as_str));
        let mut names = self.names.lock();
        names.clear();
        names.extend(self.topics.keys().cloned());
        if self.world.is_some() {
            names.insert(names::WORLD_SNAPSHOT.to_owned());
            names.extend(crate::announce::DOCUMENTS.map(str::to_owned));
        }
    }

    fn publish_world(&mut self) {
        let Some(world) = &mut self.world else { return };
        for feed in &self.feeds {
            while let Some(arrived) = feed.inbox.pop() {
                let published = match feed.name == names::WORLD_SNAPSHOT {
                    true => world.publish_snapshot(&arrived),
                    false => world.publish_document(&feed.name, &arrived),
                };
                topic::count(&self.counts, &feed.name, &arrived, &published);
                if let Err(error) = published {
                    tracing::debug!(topic = feed.name, "cannot be published: {error:#}");
                }
            }
            topic::count_inbox(&self.counts, &feed.name, &feed.inbox);
        }
    }

    fn publish_topics(&mut self) {
        let unknown = Clock::default();
        for (name, topic) in &mut self.topics {
            let clock = self.peers.get(topic.peer()).map(|peer| &peer.clock);
            let world = self.world.as_ref();
            let context = Context {
                bus: &self.bus,
                clock: clock.unwrap_or(&unknown),
                world: world.filter(|world| world.peer == topic.peer()),
                counts: &self.counts,
            };
            if topic.publish(name, &context) {
                self.rigs.note(name);
            }
        }
        self.rigs.notify();
    }

    fn look_after_topics(&mut self) {
        for (name, topic) in &mut self.topics {
            let key = self.keys.from(topic.peer(), name);
            if let Err(error) = topic.look(&self.bus, &self.session, key) {
                tracing::warn!(topic = name, "{error:#}");
            }
        }
    }

    fn say_once(&mut self, sentence: String) {
        if self.said.len() < MAX_SAID && !self.said.contains(&sentence) {
            tracing::warn!("{sentence}");
            self.said.insert(sentence);
        }
    }
}
