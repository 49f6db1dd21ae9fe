//! What all calls share: the world as far as it is known, the way to the simulator, and what
//! clients set that the simulator does not keep.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::commander::Commander;
use crate::feeds::Feeds;
use crate::list;
use crate::msgpack::Value;
use crate::recorder::Recorder;
use crate::rpc::managers::TrafficManager;
use crate::rpc::session::Settings;
use crate::stream;
use crate::world::World;

/// The version this gateway speaks; clients compare it with theirs.
pub const CARLA_VERSION: &str = "0.9.16";

/// What a call gives back.
#[derive(Clone, Debug, PartialEq)]
pub enum Answer {
    /// A value in a response record.
    Value(Value),
    /// Success without a value.
    Void,
    /// A value without a record round it.
    Bare(Value),
}

/// Why a call failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Failure {
    /// A sentence for the script.
    Refused(String),
    /// There is no such method.
    Unknown(String),
}

impl From<String> for Failure {
    fn from(error: String) -> Self {
        Failure::Refused(error)
    }
}

/// Result of a call.
pub type Outcome = Result<Answer, Failure>;

/// Everything that calls need.
#[derive(Debug)]
pub struct Gateway {
    pub(crate) world: Arc<World>,
    pub(crate) commander: Commander,
    pub(crate) feeds: Arc<Feeds>,
    /// Held while a step is asked for: when the last one was answered, `CLOCK_MONOTONIC`.
    pub(crate) last_step_nanos: Mutex<u64>,
    /// Connections whose clients step the world.
    drivers: Mutex<BTreeSet<u64>>,
    pub(crate) settings: Mutex<Settings>,
    pub(crate) navigation: Mutex<crate::rpc::files::NavigationFile>,
    /// Recorder and replayer.
    pub recorder: Recorder,
    pub(crate) stream_port: u16,
    pub(crate) traffic_managers: Mutex<BTreeMap<u16, TrafficManager>>,
    said: Mutex<BTreeSet<String>>,
}

pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Gateway {
    /// A gateway that tells clients to fetch streams at `stream_port`.
    pub fn new(
        world: Arc<World>,
        commander: Commander,
        feeds: Arc<Feeds>,
        stream_port: u16,
    ) -> Gateway {
        Gateway {
            world,
            commander,
            feeds,
            last_step_nanos: Mutex::default(),
            drivers: Mutex::default(),
            settings: Mutex::default(),
            navigation: Mutex::default(),
            recorder: Recorder::default(),
            stream_port,
            traffic_managers: Mutex::default(),
            said: Mutex::default(),
        }
    }

    /// After each snapshot, before clients see it.
    pub fn after_snapshot(&self) {
        self.recorder.step(&self.world, &self.commander);
        self.feeds.v2x.step(&self.world, &self.commander);
    }

    /// Forgets a connection: a Traffic Manager whose process has ended would make later clients
    /// wait for it, and a world whose driver has
    /// ended may have to go on by itself.
    pub fn closed(&self, connection: u64) {
        if let Some(place) = self.feeds.streams().retire(connection) {
            place.leave();
        }
        lock(&self.traffic_managers).retain(|_, manager| manager.connection != connection);
        let mut drivers = lock(&self.drivers);
        if drivers.remove(&connection) && drivers.is_empty() {
            tracing::info!(
                "the client that stepped the world has gone; the simulator does as its --on-lost-client says"
            );
            self.commander.set_lost(true);
        }
    }

    /// Notes that this connection's client steps the world.
    pub(crate) fn drives(&self, connection: u64) {
        if lock(&self.drivers).insert(connection) {
            self.commander.set_lost(false);
        }
    }

    /// Says once per run that a call is accepted and does nothing.
    pub(crate) fn no_effect(&self, what: &str) {
        if lock(&self.said).insert(what.to_owned()) {
            tracing::warn!("{what} is accepted and has no effect; see docs/carla-compatibility.md");
        }
    }

    /// Where a stream is.
    pub(crate) fn token(&self, stream: u32) -> Value {
        list![Value::Bin(stream::token(stream, self.stream_port))]
    }

    /// Where a client's world stream is.
    pub(crate) fn world_token(&self, connection: u64) -> Value {
        self.token(self.feeds.streams().stream_of(connection))
    }
}
