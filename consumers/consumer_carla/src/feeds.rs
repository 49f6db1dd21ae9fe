//! Streams: what each client is sent, and who waits for whom.
//!
//! [`world_stream`] sends one message per tick to every client. The first client of a sensor gets a
//! [`feed::Feed`], which reads the bus for it alone; all further clients of the same sensor share
//! one more feed through a [`relay::Relay`]. Messages that the gateway makes itself (radio) go
//! through relays, too. [`expected`] keeps sources for clients that are about to connect, and
//! [`progress`] knows how far each reader is, so that a step can wait for it. [`held_answers`] keeps
//! answers back until a client's Traffic Manager can bear what the script does next.

pub mod client_streams;
pub mod events;
pub mod expected;
pub mod feed;
pub mod held_answers;
pub mod lost_managers;
pub mod progress;
pub mod relay;
pub mod world_stream;

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use parking_lot::Mutex;
use schema_bus::Bus;

use crate::state::known_world::World;
use crate::wire::streams::{Recipient, actor_of};
use expected::Expected;
use feed::{Feed, Outlet, Shared};
use progress::Readers;
use relay::{Listener, Relay, Stations};
use world_stream::WorldStream;

/// Longest queue of each further listener of a sensor, messages.
const BACKLOG: usize = 4;
/// How long a relay continues without listeners.
const IDLE: Duration = Duration::from_secs(2);

/// All streams.
#[derive(Debug)]
pub struct Feeds {
    shared: Shared,
    /// By stream, for all clients of a sensor but the first.
    relays: Mutex<BTreeMap<u32, Arc<Relay>>>,
    stations: Stations,
    expected: Expected<Source>,
}

/// What serves one client's stream.
#[derive(Debug)]
enum Source {
    Feed(Feed),
    Listener(Arc<Listener>),
}

impl Feeds {
    /// Streams without a bus: no sensor can be read before [`Feeds::join`].
    pub fn new(world: Arc<World>) -> Self {
        Feeds {
            shared: Shared {
                world,
                world_stream: WorldStream::default(),
                bus: OnceLock::new(),
                no_rendering: AtomicBool::new(false),
                readers: Readers::default(),
            },
            relays: Mutex::default(),
            stations: Stations::default(),
            expected: Expected::default(),
        }
    }

    /// The world stream, which sends a tick's snapshot before its sensor messages.
    pub fn world_stream(&self) -> &WorldStream {
        &self.shared.world_stream
    }

    /// The relays of radio stations.
    pub fn stations(&self) -> &Stations {
        &self.stations
    }

    /// Sets the bus that sensors are read from.
    pub fn join(&self, bus: Bus) {
        // Called once, at start-up; a second bus would be ignored.
        let _ = self.shared.bus.set(bus);
    }

    /// The bus that sensors are read from, if it was set.
    pub fn bus(&self) -> Option<&Bus> {
        self.shared.bus.get()
    }

    /// The client with the RPC connection `owner` is about to connect to this stream: opens its
    /// source now. Only that client's own steps wait for it.
    pub fn expect(self: &Arc<Self>, stream: u32, owner: u64) {
        self.sweep();
        let Some(source) = self.source(stream, Some(owner)) else {
            return;
        };
        if let Some((stream, _)) = self.expected.add(stream, owner, source) {
            tracing::debug!(
                stream,
                "a client asks for very many streams and connects to none; this one starts when it connects"
            );
        }
    }

    /// Drops the sources of clients that did not connect in time, and readers that have ended.
    pub fn sweep(&self) {
        self.expected.sweep();
        self.shared.readers.sweep();
    }

    /// Opens a source for one more client of a stream; `None` if there is no such stream. `owner` is
    /// the RPC connection of the client if it has asked for the stream and not connected to it yet.
    fn source(self: &Arc<Self>, stream: u32, owner: Option<u64>) -> Option<Source> {
        if let Some(station) = self.station(stream) {
            return Some(Source::Listener(self.stations.join(station)));
        }
        let beside = self.beside(stream, owner).map(Source::Listener);
        beside.or_else(|| Feed::open(stream, owner, &self.shared).map(Source::Feed))
    }

    /// The radio station that a stream belongs to, if it is one's.
    fn station(&self, stream: u32) -> Option<u32> {
        let known = self.shared.world.known();
        let actor = actor_of(stream)?;
        let (kind, _) = known.sensor(actor)?;
        kind.modalities.is_empty().then_some(actor)
    }

    /// Joins the relay of a stream that has a reader already, and starts the relay if need be;
    /// `None` if nobody reads the stream.
    fn beside(self: &Arc<Self>, stream: u32, owner: Option<u64>) -> Option<Arc<Listener>> {
        let mut relays = self.relays.lock();
        let relay = match relays.get(&stream) {
            Some(relay) => relay.clone(),
            None => {
                if !self.shared.readers.has_reader(stream) {
                    return None;
                }
                let feed = Feed::open(stream, None, &self.shared)?;
                feed.connect();
                let relay = Arc::new(Relay::new(BACKLOG));
                let (feeds, to) = (self.clone(), relay.clone());
                let spawned = std::thread::Builder::new()
                    .name("relay".into())
                    .spawn(move || feeds.relay(stream, feed, &to));
                if let Err(error) = spawned {
                    tracing::warn!(stream, %error, "cannot start a thread for the listeners of a stream");
                    return None;
                }
                relays.insert(stream, relay.clone());
                relay
            }
        };
        // The map of relays stays locked until the listener has joined, because a relay without
        // listeners ends.
        let progress = self.shared.readers.add_listener(stream, owner)?;
        Some(relay.join(Some(progress)))
    }

    /// Reads a sensor for the listeners of a relay until there are none left.
    fn relay(&self, stream: u32, mut feed: Feed, relay: &Relay) {
        let mut last_heard = Instant::now();
        while !feed.is_over(&self.shared) {
            if relay.has_listeners() {
                last_heard = Instant::now();
            } else if last_heard.elapsed() > IDLE {
                let mut relays = self.relays.lock();
                if !relay.has_listeners() {
                    relays.remove(&stream);
                    return;
                }
            }
            let passed = feed.pass_on(&self.shared, &mut Outlet::Relay(relay));
            let waited = passed.and_then(|nanos| {
                relay.promise(nanos);
                feed.wait(None)
            });
            if let Err(error) = waited {
                tracing::warn!(stream, %error, "the listeners of a stream end");
                break;
            }
        }
        self.relays.lock().remove(&stream);
        relay.close();
    }

    /// Sends a stream's messages to a client until it disconnects.
    pub(crate) fn serve(self: &Arc<Self>, stream: u32, client: &Recipient) -> std::io::Result<()> {
        let expected = self.expected.take(stream);
        match expected.or_else(|| self.source(stream, None)) {
            Some(Source::Feed(feed)) => self.serve_feed(feed, client),
            Some(Source::Listener(listener)) => {
                listener.serve(client, self.world_stream(), &|| {
                    self.shared.readers.ring();
                })
            }
            None => {
                tracing::debug!(stream, "a client waits for a stream that does not exist");
                client.wait_for_end()
            }
        }
    }

    fn serve_feed(&self, mut feed: Feed, client: &Recipient) -> std::io::Result<()> {
        feed.connect();
        while !feed.is_over(&self.shared) {
            feed.pass_on(&self.shared, &mut Outlet::Client(client))?;
            if feed.wait(Some(client.as_fd()))? && client.has_ended()? {
                return Ok(());
            }
        }
        drop(feed);
        client.wait_for_end()
    }

    /// Before a step of the client with this RPC connection: waits until every reader has taken
    /// everything published before `since_nanos`; see [`Readers::settle`].
    pub fn settle(&self, since_nanos: u64, connection: u64) {
        self.shared.readers.settle(since_nanos, connection);
    }

    /// Switches CARLA's no-rendering mode, in which no camera is read and nothing is rendered for
    /// one. Returns when all cameras have followed.
    pub fn set_no_rendering(&self, on: bool) {
        if self.shared.no_rendering.swap(on, Ordering::AcqRel) == on {
            return;
        }
        self.expected.for_each(|source| {
            if let Source::Feed(feed) = source {
                feed.shut_or_open(&self.shared);
            }
        });
        self.shared.readers.await_cameras(on);
    }
}
