//! A feed: the readers of one sensor's topics, and the encoder that turns frames into messages.

use std::io::Read as _;
use std::os::fd::{AsFd as _, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use schema_bus::{Bus, BusError, Frame, FrameReader, WaitSet, mono_now};

use crate::feeds::events;
use crate::feeds::progress::{Progress, Readers};
use crate::feeds::relay::Relay;
use crate::feeds::world_stream::WorldStream;
use crate::stages;
use crate::state::known_world::World;
use crate::wire::geolocation::geo_reference_deg;
use crate::wire::sensor_message::records::GRAVITY_MPS2;
use crate::wire::sensor_message::{Context, Encoder};
use crate::wire::streams::{Recipient, StreamMessage, actor_of};

/// How often a stream without new frames checks its connection and its sensor.
const LOOK: Duration = Duration::from_millis(500);

/// What all feeds share.
#[derive(Debug)]
pub struct Shared {
    /// Tells which sensors exist and which topics they have.
    pub world: Arc<World>,
    /// A tick's snapshot is sent to clients before that tick's sensor messages.
    pub world_stream: WorldStream,
    /// The bus that feeds read from; set once.
    pub bus: OnceLock<Bus>,
    /// CARLA's no-rendering mode: no camera is read, so the simulator renders nothing.
    pub no_rendering: AtomicBool,
    /// How far each reader is.
    pub readers: Readers,
}

impl Shared {
    fn no_rendering(&self) -> bool {
        self.no_rendering.load(Ordering::Acquire)
    }

    /// What the encoder needs beside the frame; `None` for a frame of an earlier episode.
    fn context(&self, frame: &Frame) -> Option<Context> {
        let known = self.world.known();
        let at = &known.snapshot.as_ref()?.header;
        (at.episode == frame.header().episode).then(|| Context {
            episode_start_nanos: at.episode_start_nanos,
            imu_gravity_mps2: known.imu_gravity_mps2.unwrap_or(GRAVITY_MPS2),
            geo_reference_deg: known
                .geo_reference_deg
                .unwrap_or_else(|| geo_reference_deg("")),
        })
    }
}

/// Where a feed sends its messages.
pub enum Outlet<'a> {
    /// One client.
    Client(&'a Recipient),
    /// All listeners of a relay.
    Relay(&'a Relay),
}

impl Outlet<'_> {
    fn send(&mut self, tick: u64, head: &[u8], body: &[u8]) -> std::io::Result<()> {
        match self {
            Outlet::Client(client) => client.send(head, body),
            Outlet::Relay(relay) => {
                relay.send(&StreamMessage {
                    tick,
                    bytes: [head, body].concat().into(),
                });
                Ok(())
            }
        }
    }
}

/// Reads one sensor and encodes its messages.
pub struct Feed {
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

impl std::fmt::Debug for Feed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Feed")
            .field("actor", &self.actor)
            .finish_non_exhaustive()
    }
}

impl Feed {
    /// Starts to read the sensor of a stream; `None` if there is no such sensor. `owner` is the RPC
    /// connection of a client that is about to connect.
    pub fn open(stream: u32, owner: Option<u64>, shared: &Shared) -> Option<Feed> {
        let (bus, actor) = (shared.bus.get()?, actor_of(stream)?);
        let ((kind, topics), fov_rad) = {
            let known = shared.world.known();
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
            let shut = is_camera && shared.no_rendering();
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
                progress: Arc::new(Progress::new(
                    stream,
                    owner,
                    is_camera.then_some(shut),
                    poke,
                )),
            };
            if !shut {
                feed.read_topics(bus)?;
            }
            Ok(feed)
        };
        match opened() {
            Ok(feed) => {
                shared.readers.add(feed.progress.clone());
                Some(feed)
            }
            Err(error) => {
                tracing::warn!(actor, %error, "cannot read a sensor for a client");
                None
            }
        }
    }

    /// Notes that the client has connected.
    pub fn connect(&self) {
        self.progress.connect();
    }

    /// Whether the sensor was destroyed: it was listed among the actors and is not any more.
    pub fn is_over(&mut self, shared: &Shared) -> bool {
        let is_listed = shared.world.known().actors.contains_key(&self.actor);
        self.was_listed |= is_listed;
        self.was_listed && !is_listed
    }

    /// Sends all frames that wait. Returns a time on `CLOCK_MONOTONIC`: every frame published
    /// before it was taken.
    pub fn pass_on(&mut self, shared: &Shared, outlet: &mut Outlet<'_>) -> std::io::Result<u64> {
        self.shut_or_open(shared);
        let began_nanos = mono_now().0;
        while let Some(frames) = self.next()? {
            if self.is_camera && shared.no_rendering() {
                continue;
            }
            let tick = frames[0].header().tick;
            shared.world_stream.await_snapshot(tick);
            let Some(context) = shared.context(&frames[0]) else {
                continue;
            };
            let convert = stages::CONVERT.span();
            let events = events::bodies(&shared.world.known(), &frames[0]);
            if let Some(bodies) = events {
                drop(convert);
                for body in bodies {
                    let message = self.encoder.event(frames[0].header(), &body, &context);
                    outlet.send(tick, message.head, message.body)?;
                }
            } else if let Some(message) = self.encoder.encode(&frames, &context) {
                drop(convert);
                outlet.send(tick, message.head, message.body)?;
            }
        }
        self.progress.take(began_nanos);
        shared.readers.ring();
        Ok(began_nanos)
    }

    /// Waits for new frames, for a wake-up through the pipe, or for input on `connection`. The
    /// result states whether `connection` has input.
    pub fn wait(&mut self, connection: Option<BorrowedFd<'_>>) -> std::io::Result<bool> {
        let poked = self.poked.as_fd();
        let both = [poked, connection.unwrap_or(poked)];
        let beside = &both[..1 + usize::from(connection.is_some())];
        let ready = self
            .wake
            .wait_beside(beside, LOOK)
            .map_err(std::io::Error::other)?;
        if ready[0] {
            // The bytes carry nothing; only their arrival matters.
            let _ = self.poked.read(&mut [0; 64]);
        }
        Ok(ready.get(1).copied().unwrap_or(false))
    }

    /// Closes a camera's readers in no-rendering mode and opens them again afterwards.
    pub fn shut_or_open(&mut self, shared: &Shared) {
        let shut = shared.no_rendering();
        if self
            .progress
            .is_shut()
            .is_none_or(|is_shut| is_shut == shut)
        {
            return;
        }
        if shut {
            self.waiting.clear();
            self.readers.clear();
            self.wake = WaitSet::new();
        } else if let Some(Err(error)) = shared.bus.get().map(|bus| self.read_topics(bus)) {
            tracing::warn!(actor = self.actor, %error, "cannot read a camera again");
        }
        self.progress.set_shut(shut);
        shared.readers.ring();
    }

    /// Opens a reader for each topic.
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

    /// The oldest tick for which every topic has a frame, as one frame per topic.
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
            // A topic lost its frame of an older tick: drop the other topics' frames of that tick.
            self.waiting
                .iter_mut()
                .filter(|slot| tick(slot) < newest)
                .for_each(|slot| *slot = None);
        }
    }
}

impl Drop for Feed {
    /// Steps must not wait for a reader that has ended.
    fn drop(&mut self) {
        self.progress.finish();
    }
}
