//! Streams of sensors: a reader of the bus for the first client that listens, and one for all
//! others of the same sensor together.
//!
//! A client asks for a stream's place right before it connects, and may step the world in between.
//! So the reader is opened with the question
//! and waits for its connection: what the sensor sees from then on is not lost.
//!
//! A frame that cannot be written waits in shared memory, where newer ones push it out (two fit): a
//! slow client loses frames. In synchronous
//! mode nothing may be lost, so [`Feeds::settle`] holds the next step back until every reader has
//! taken what there was.

mod dark;
mod sharing;

use std::collections::{BTreeMap, VecDeque};
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::os::fd::AsFd as _;
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use schema_bus::{Bus, BusError, Frame, FrameReader, WaitSet, mono_now};

use crate::gateway::lock;
use crate::relay::{Relay, Sent};
use crate::sensors::message::{Context, Encoder};
use crate::sensors::{actor_of, events, records};
use crate::stream::{Streams, has_ended, send, wait_for_end};
use crate::v2x::V2x;
use crate::world::World;

/// How long a reader waits for the connection it was opened for.
const CONNECT: Duration = Duration::from_secs(10);
/// How long a step waits for a reader whose client has not connected yet.
const CONNECT_STEP: Duration = Duration::from_secs(1);
/// How long a step waits for a client that does not take its messages.
const WRITE_STEP: Duration = Duration::from_secs(5);
/// Readers that may wait for connections at a time.
const MAX_WAITING: usize = 256;
/// How often a quiet stream is looked at.
const LOOK: Duration = Duration::from_millis(500);

/// How far a reader is, for those who wait for it.
#[derive(Debug)]
pub struct Progress {
    stream: u32,
    /// Everything published before this `CLOCK_MONOTONIC` was taken.
    taken_nanos: AtomicU64,
    is_connected: AtomicBool,
    /// Found too slow to wait for; until it has caught up.
    lags: AtomicBool,
    /// A camera's that is not to be read; `None` for what has no readers of its own.
    is_shut: Option<AtomicBool>,
    poke: UnixStream,
}

impl Progress {
    /// Its client has come.
    pub(crate) fn connect(&self) {
        self.is_connected.store(true, Ordering::Release);
    }

    /// Everything published before was taken.
    pub(crate) fn take(&self, nanos: u64) {
        self.taken_nanos.store(nanos, Ordering::Release);
        self.lags.store(false, Ordering::Release);
    }

    /// Nobody waits for what has ended.
    pub(crate) fn finish(&self) {
        self.taken_nanos.store(u64::MAX, Ordering::Release);
    }
}

/// Where a feed's messages go.
enum Outlet<'a> {
    Client(&'a mut TcpStream),
    Relay(&'a Relay),
}

impl Outlet<'_> {
    fn send(&mut self, tick: u64, head: &[u8], body: &[u8]) -> std::io::Result<()> {
        match self {
            Outlet::Client(connection) => send(connection, head, body),
            Outlet::Relay(relay) => {
                relay.send(&Sent {
                    tick,
                    bytes: [head, body].concat().into(),
                });
                Ok(())
            }
        }
    }
}

/// A reader with what it takes to write messages.
struct Feed {
    actor: u32,
    was_listed: bool,
    is_camera: bool,
    topics: Vec<String>,
    readers: Vec<FrameReader>,
    waiting: Vec<Option<Frame>>,
    wake: WaitSet,
    poked: UnixStream,
    encoder: Encoder,
    progress: Arc<Progress>,
}

/// All streams of sensors.
#[derive(Debug)]
pub struct Feeds {
    world: Arc<World>,
    streams: Arc<Streams>,
    bus: OnceLock<Bus>,
    /// Stations, whose messages the gateway makes itself.
    pub v2x: V2x,
    /// Whether cameras stay dark.
    no_rendering: AtomicBool,
    relays: Mutex<BTreeMap<u32, Arc<Relay>>>,
    waiting: Mutex<BTreeMap<u32, VecDeque<(Instant, Feed)>>>,
    active: Mutex<Vec<Arc<Progress>>>,
    taken: Condvar,
}

impl std::fmt::Debug for Feed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Feed")
            .field("actor", &self.actor)
            .finish_non_exhaustive()
    }
}

impl Feeds {
    /// No streams, and no bus: nothing can be read before [`Feeds::join`].
    pub fn new(world: Arc<World>, streams: Arc<Streams>) -> Self {
        Feeds {
            world,
            streams,
            bus: OnceLock::new(),
            v2x: V2x::default(),
            no_rendering: AtomicBool::new(false),
            relays: Mutex::default(),
            waiting: Mutex::default(),
            active: Mutex::default(),
            taken: Condvar::new(),
        }
    }

    /// The world stream, whose snapshots go before sensors' messages.
    pub fn streams(&self) -> &Streams {
        &self.streams
    }

    /// Reads from this bus.
    pub fn join(&self, bus: Bus) {
        // Called once, at the start.
        let _ = self.bus.set(bus);
    }

    /// A client is about to connect to this stream: reads for it from now on.
    pub fn expect(self: &Arc<Self>, stream: u32) {
        self.sweep();
        if self.is_station(stream) {
            return self.v2x.expect(stream);
        }
        if self
            .beside(stream, |relay, progress| relay.expect(Some(progress)))
            .is_some()
        {
            return;
        }
        if lock(&self.waiting)
            .values()
            .map(VecDeque::len)
            .sum::<usize>()
            >= MAX_WAITING
        {
            tracing::warn!(
                stream,
                "{MAX_WAITING} streams were asked for and nobody came for them; this one starts when its client connects"
            );
            return;
        }
        if let Some(feed) = self.open(stream) {
            lock(&self.waiting)
                .entry(stream)
                .or_default()
                .push_back((Instant::now(), feed));
        }
    }

    fn is_station(&self, stream: u32) -> bool {
        let known = self.world.known();
        actor_of(stream)
            .and_then(|actor| known.sensor(actor))
            .is_some_and(|(kind, _)| kind.modalities.is_empty())
    }

    /// Forgets readers whose clients never came.
    pub fn sweep(&self) {
        let mut waiting = lock(&self.waiting);
        for feeds in waiting.values_mut() {
            while feeds
                .front()
                .is_some_and(|(since, _)| since.elapsed() > CONNECT)
            {
                feeds.pop_front();
            }
        }
        waiting.retain(|_, feeds| !feeds.is_empty());
    }

    fn open(&self, stream: u32) -> Option<Feed> {
        let (bus, actor) = (self.bus.get()?, actor_of(stream)?);
        let ((kind, topics), fov_rad) = {
            let known = self.world.known();
            (known.sensor(actor)?, known.fov_rad(actor))
        };
        let is_camera = kind.type_id.starts_with("sensor.camera.");
        let opened = || -> Result<Feed, BusError> {
            let pipe = |error: std::io::Error| BusError::Service {
                action: "wake up",
                service: topics.first().cloned().unwrap_or_default(),
                cause: error.to_string(),
            };
            let (poke, poked) = UnixStream::pair().map_err(pipe)?;
            poke.set_nonblocking(true)
                .and_then(|()| poked.set_nonblocking(true))
                .map_err(pipe)?;
            let shut = is_camera && self.no_rendering.load(Ordering::Acquire);
            let progress = Arc::new(Progress {
                stream,
                taken_nanos: AtomicU64::new(mono_now().0),
                is_connected: AtomicBool::new(false),
                lags: AtomicBool::new(false),
                is_shut: is_camera.then_some(AtomicBool::new(shut)),
                poke,
            });
            let mut feed = Feed {
                actor,
                was_listed: false,
                is_camera,
                topics,
                readers: Vec::new(),
                waiting: Vec::new(),
                wake: WaitSet::new(),
                poked,
                encoder: Encoder::new(kind, fov_rad),
                progress,
            };
            if !shut {
                feed.read_topics(bus)?;
            }
            Ok(feed)
        };
        match opened() {
            Ok(feed) => {
                lock(&self.active).push(feed.progress.clone());
                Some(feed)
            }
            Err(error) => {
                tracing::warn!(actor, %error, "cannot read a sensor for a client");
                None
            }
        }
    }

    /// Sends a sensor's messages to a client until it goes.
    pub(crate) fn serve(
        self: &Arc<Self>,
        stream: u32,
        mut connection: TcpStream,
    ) -> std::io::Result<()> {
        if self.is_station(stream) {
            return self.v2x.serve(stream, connection, &self.streams);
        }
        let expected = lock(&self.waiting)
            .get_mut(&stream)
            .and_then(VecDeque::pop_front)
            .map(|(_, feed)| feed);
        if expected.is_none()
            && let Some(listener) =
                self.beside(stream, |relay, progress| relay.listener(Some(progress)))
        {
            return listener.serve(connection, &self.streams, &|| self.tell_taken());
        }
        let Some(mut feed) = expected.or_else(|| self.open(stream)) else {
            tracing::debug!(stream, "a client waits for a stream that does not exist");
            return wait_for_end(&connection);
        };
        feed.progress.connect();
        while !self.is_over(&mut feed) {
            self.pass_on(&mut feed, &mut Outlet::Client(&mut connection))?;
            let ready = feed
                .wake
                .wait_beside(&[connection.as_fd(), feed.poked.as_fd()], LOOK)
                .map_err(std::io::Error::other)?;
            if ready[0] && has_ended(&connection)? {
                return Ok(());
            }
            if ready[1] {
                // All that matters is that something came.
                let _ = feed.poked.read(&mut [0; 64]);
            }
        }
        drop(feed);
        wait_for_end(&connection)
    }

    fn tell_taken(&self) {
        drop(lock(&self.active));
        self.taken.notify_all();
    }

    /// Whether the sensor is gone: it was on the list of actors and is no longer.
    fn is_over(&self, feed: &mut Feed) -> bool {
        let is_listed = self.world.known().actors.contains_key(&feed.actor);
        feed.was_listed |= is_listed;
        feed.was_listed && !is_listed
    }

    /// Takes everything that waits and writes it. Returns the moment before which everything
    /// published was taken.
    fn pass_on(&self, feed: &mut Feed, outlet: &mut Outlet<'_>) -> std::io::Result<u64> {
        self.shut_or_open(feed);
        let began_nanos = mono_now().0;
        while let Some(frames) = feed.next()? {
            if feed.is_camera && self.no_rendering.load(Ordering::Acquire) {
                continue;
            }
            let tick = frames[0].header().tick;
            self.streams.await_snapshot(tick);
            let Some(context) = self.context(&frames[0]) else {
                continue;
            };
            let events = events::bodies(&self.world.known(), &frames[0]);
            if let Some(bodies) = events {
                for body in bodies {
                    let message = feed.encoder.event(frames[0].header(), &body, &context);
                    outlet.send(tick, message.head, message.body)?;
                }
            } else if let Some(message) = feed.encoder.encode(&frames, &context) {
                outlet.send(tick, message.head, message.body)?;
            }
        }
        feed.progress.take(began_nanos);
        self.tell_taken();
        Ok(began_nanos)
    }

    /// What a frame's message needs to know; `None` for a frame of an episode that is over.
    fn context(&self, frame: &Frame) -> Option<Context> {
        let known = self.world.known();
        let at = &known.snapshot.as_ref()?.header;
        (at.episode == frame.header().episode).then(|| Context {
            episode_start_nanos: at.episode_start_nanos,
            geo_reference_deg: known
                .geo_reference_deg
                .unwrap_or_else(|| records::geo_reference_deg("")),
        })
    }

    /// Waits until every reader has taken what was published before `since_nanos`. A client that
    /// does not take its messages is waited for
    /// once; it then loses frames until it has caught up.
    pub fn settle(&self, since_nanos: u64) {
        let began = Instant::now();
        let is_behind = |progress: &&Arc<Progress>| {
            progress.taken_nanos.load(Ordering::Acquire) < since_nanos
                && !progress.lags.load(Ordering::Acquire)
        };
        let mut active = lock(&self.active);
        for behind in active.iter().filter(is_behind) {
            // A full pipe wakes as well as one byte more.
            let _ = (&behind.poke).write(&[1]);
        }
        while let Some(behind) = active.iter().find(is_behind) {
            let is_connected = behind.is_connected.load(Ordering::Acquire);
            if began.elapsed()
                >= if is_connected {
                    WRITE_STEP
                } else {
                    CONNECT_STEP
                }
            {
                let fault = if is_connected {
                    "does not take its sensor's messages"
                } else {
                    "asked for a sensor's stream and does not connect"
                };
                tracing::warn!(
                    stream = behind.stream,
                    "a client {fault}; it loses frames until it does"
                );
                behind.lags.store(true, Ordering::Release);
                continue;
            }
            active = self
                .taken
                .wait_timeout(active, Duration::from_millis(20))
                .unwrap_or_else(PoisonError::into_inner)
                .0;
        }
        active.retain(|progress| Arc::strong_count(progress) > 1);
    }
}

impl Feed {
    /// Opens a reader of each topic.
    fn read_topics(&mut self, bus: &Bus) -> Result<(), BusError> {
        let mut wake = WaitSet::new();
        let mut readers = Vec::new();
        for topic in &self.topics {
            wake.add(bus.listener(topic)?);
            readers.push(bus.frame_reader(topic)?);
        }
        self.waiting = readers.iter().map(|_| None).collect();
        (self.readers, self.wake) = (readers, wake);
        Ok(())
    }

    /// The oldest frames of one tick, one of each topic.
    fn next(&mut self) -> std::io::Result<Option<Vec<Frame>>> {
        if self.readers.is_empty() {
            return Ok(None);
        }
        loop {
            for (slot, reader) in self.waiting.iter_mut().zip(&mut self.readers) {
                while slot.is_none() {
                    match reader.next() {
                        Ok(Some(frame)) => *slot = Some(frame),
                        Ok(None) => return Ok(None),
                        Err(error @ BusError::BadFrame { .. }) => {
                            tracing::warn!(%error, "passed over a frame")
                        }
                        Err(error) => return Err(std::io::Error::other(error)),
                    }
                }
            }
            let tick = |slot: &Option<Frame>| slot.as_ref().map_or(0, |frame| frame.header().tick);
            let newest = self.waiting.iter().map(tick).max().unwrap_or(0);
            if self.waiting.iter().all(|slot| tick(slot) == newest) {
                return Ok(Some(
                    self.waiting.iter_mut().filter_map(Option::take).collect(),
                ));
            }
            // One topic lost a frame that the others have.
            self.waiting
                .iter_mut()
                .filter(|slot| tick(slot) < newest)
                .for_each(|slot| *slot = None);
        }
    }
}

impl Drop for Feed {
    /// Nobody waits for what has ended.
    fn drop(&mut self) {
        self.progress.finish();
    }
}
