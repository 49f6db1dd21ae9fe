//! Streams: who hears what, and who waits for whom.
//!
//! [`world_stream`] sends one message per tick to every client. A sensor has a [`feed::Feed`], a
//! reader of the bus, for the first client that listens, and one [`relay::Relay`] for all others of
//! the same sensor together; what the gateway makes itself (radio messages) goes through relays too.
//! [`expected`] keeps what was made ready for clients that are about to connect, and [`progress`]
//! says how far each reader is, so that a step can wait for it.

pub mod events;
pub mod expected;
pub mod feed;
pub mod places;
pub mod progress;
pub mod relay;
pub mod world_stream;

use std::collections::BTreeMap;
use std::net::TcpStream;
use std::os::fd::AsFd as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::time::{Duration, Instant};

use schema_bus::Bus;

use crate::lock::lock;
use crate::state::known_world::World;
use crate::wire::streams::{actor_of, has_ended, wait_for_end};
use expected::{Expected, MAX_EXPECTED};
use feed::{Feed, Outlet, Shared};
use progress::Readers;
use relay::{Listener, Relay, Stations};
use world_stream::WorldStream;

/// Messages that wait for each listener of a sensor but the first.
const BACKLOG: usize = 4;
/// How long a relay goes on without listeners.
const IDLE: Duration = Duration::from_secs(2);

/// All streams.
#[derive(Debug)]
pub struct Feeds {
    shared: Shared,
    /// For listeners of a sensor but the first, by stream.
    relays: Mutex<BTreeMap<u32, Arc<Relay>>>,
    stations: Stations,
    expected: Expected<Source>,
}

/// What serves one client.
#[derive(Debug)]
enum Source {
    Feed(Feed),
    Listener(Arc<Listener>),
}

impl Feeds {
    /// No streams, and no bus: nothing can be read before [`Feeds::join`].
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

    /// The world stream, whose snapshots go before sensors' messages.
    pub fn world_stream(&self) -> &WorldStream {
        &self.shared.world_stream
    }

    /// Listeners of radio stations, whose messages the gateway makes itself.
    pub fn stations(&self) -> &Stations {
        &self.stations
    }

    /// Reads from this bus.
    pub fn join(&self, bus: Bus) {
        // Called once, at the start.
        let _ = self.shared.bus.set(bus);
    }

    /// A client is about to connect to this stream: reads for it from now on.
    pub fn expect(self: &Arc<Self>, stream: u32) {
        self.sweep();
        if self.expected.is_full() {
            tracing::warn!(
                stream,
                "{MAX_EXPECTED} streams were asked for and nobody came for them; this one starts when its client connects"
            );
            return;
        }
        if let Some(source) = self.source(stream) {
            self.expected.add(stream, source);
        }
    }

    /// Forgets clients that never came.
    pub fn sweep(&self) {
        self.expected.sweep();
    }

    /// What serves one more client of a stream from now on; `None` if there is no such stream.
    fn source(self: &Arc<Self>, stream: u32) -> Option<Source> {
        if let Some(station) = self.station(stream) {
            return Some(Source::Listener(self.stations.join(station)));
        }
        let beside = self.beside(stream).map(Source::Listener);
        beside.or_else(|| Feed::open(stream, &self.shared).map(Source::Feed))
    }

    /// The station whose messages a stream has, if it is one's.
    fn station(&self, stream: u32) -> Option<u32> {
        let known = self.shared.world.known();
        let actor = actor_of(stream)?;
        let (kind, _) = known.sensor(actor)?;
        kind.modalities.is_empty().then_some(actor)
    }

    /// If somebody reads this stream already: takes a place in the relay that sends to all others.
    fn beside(self: &Arc<Self>, stream: u32) -> Option<Arc<Listener>> {
        let mut relays = lock(&self.relays);
        let relay = match relays.get(&stream) {
            Some(relay) => relay.clone(),
            None => {
                if !self.shared.readers.has_reader(stream) {
                    return None;
                }
                let feed = Feed::open(stream, &self.shared)?;
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
        // Before the lock is given back: a relay without listeners ends.
        let progress = self.shared.readers.add_listener(stream)?;
        Some(relay.join(Some(progress)))
    }

    /// Reads for all listeners of a stream but the first, until there are none.
    fn relay(&self, stream: u32, mut feed: Feed, relay: &Relay) {
        let mut last_heard = Instant::now();
        while !feed.is_over(&self.shared) {
            if relay.has_listeners() {
                last_heard = Instant::now();
            } else if last_heard.elapsed() > IDLE {
                let mut relays = lock(&self.relays);
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
        lock(&self.relays).remove(&stream);
        relay.close();
    }

    /// Sends a sensor's messages to a client until it goes.
    pub(crate) fn serve(
        self: &Arc<Self>,
        stream: u32,
        connection: TcpStream,
    ) -> std::io::Result<()> {
        let expected = self.expected.take(stream);
        match expected.or_else(|| self.source(stream)) {
            Some(Source::Feed(feed)) => self.serve_feed(feed, connection),
            Some(Source::Listener(listener)) => {
                listener.serve(connection, self.world_stream(), &|| {
                    self.shared.readers.ring();
                })
            }
            None => {
                tracing::debug!(stream, "a client waits for a stream that does not exist");
                wait_for_end(&connection)
            }
        }
    }

    fn serve_feed(&self, mut feed: Feed, mut connection: TcpStream) -> std::io::Result<()> {
        feed.connect();
        while !feed.is_over(&self.shared) {
            feed.pass_on(&self.shared, &mut Outlet::Client(&mut connection))?;
            if feed.wait(Some(connection.as_fd()))? && has_ended(&connection)? {
                return Ok(());
            }
        }
        drop(feed);
        wait_for_end(&connection)
    }

    /// Waits until every reader has taken what was published before `since_nanos`; see
    /// [`Readers::settle`].
    pub fn settle(&self, since_nanos: u64) {
        self.shared.readers.settle(since_nanos);
    }

    /// Whether cameras stay dark: then nobody reads them, and nothing is rendered for them. Returns
    /// when all have changed.
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
