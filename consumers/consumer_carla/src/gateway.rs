//! What all calls share: the known world, the commander, the streams, and what clients set and the
//! simulator does not keep.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use consumer_rpc::budget::Account;
use parking_lot::Mutex;
use schema_frames::WorldInfo;

use crate::feeds::Feeds;
use crate::list;
use crate::recorder::Recorder;
use crate::state::commander::Commander;
use crate::state::known_world::World;
use crate::state::navigation_file::NavigationFiles;
use crate::state::settings::Settings;
use crate::state::traffic_managers::TrafficManagers;
use crate::v2x::V2x;
use crate::wire::msgpack::Value;
use crate::wire::requests::Failure;
use crate::wire::streams;

/// Longest wait for `world/info` when the gateway has just started.
const SETTLE: Duration = Duration::from_secs(5);

/// Everything that calls work on.
#[derive(Debug)]
pub struct Gateway {
    pub(crate) world: Arc<World>,
    pub(crate) commander: Commander,
    pub(crate) feeds: Arc<Feeds>,
    pub(crate) v2x: V2x,
    /// Records and replays.
    pub recorder: Recorder,
    /// When the last step was answered (`CLOCK_MONOTONIC`). Locked during a step, so that steps
    /// come one by one.
    pub(crate) last_step_nanos: Mutex<u64>,
    pub(crate) settings: Mutex<Settings>,
    /// The map that was loaded by its name in layers (`Town01_Opt`), which it keeps for scripts.
    pub(crate) layered_map: Mutex<Option<String>>,
    pub(crate) navigation: NavigationFiles,
    pub(crate) traffic_managers: TrafficManagers,
    /// Memory for what clients said about the actors that they spawned, which outlive connections.
    pub(crate) descriptions: Account,
    pub(crate) stream_port: u16,
    /// Connections whose clients step the world.
    drivers: Mutex<BTreeSet<u64>>,
    said: Mutex<BTreeSet<String>>,
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
            v2x: V2x::default(),
            recorder: Recorder::default(),
            last_step_nanos: Mutex::default(),
            settings: Mutex::default(),
            layered_map: Mutex::default(),
            navigation: NavigationFiles::default(),
            traffic_managers: TrafficManagers::default(),
            descriptions: Account::of(0),
            stream_port,
            drivers: Mutex::default(),
            said: Mutex::default(),
        }
    }

    /// Begins in CARLA's no-rendering mode, until a client's settings say otherwise.
    pub fn begin_without_rendering(&self) {
        self.settings.lock().no_rendering = true;
        self.feeds.set_no_rendering(true);
    }

    /// Runs after each snapshot, before clients see it.
    pub fn after_snapshot(&self) {
        self.recorder.step(&self.world, &self.commander);
        self.v2x
            .step(&self.world, &self.commander, self.feeds.stations());
    }

    /// Cleans up after a connection. A Traffic Manager whose process has ended would make later
    /// clients wait for it, and a world whose stepping client has gone may have to continue by
    /// itself.
    pub fn closed(&self, connection: u64) {
        let streams = self.feeds.world_stream();
        if let Some(old) = streams.retire(connection) {
            old.leave();
        }
        streams.take_left(connection);
        streams.held_answers.forget(connection);
        self.traffic_managers.forget(connection);
        let mut drivers = self.drivers.lock();
        if drivers.remove(&connection) && drivers.is_empty() {
            tracing::info!(
                "the client that stepped the world has gone; the simulator does as its --on-lost-client says"
            );
            self.commander.set_lost(true);
        }
    }

    /// Notes that the client of this connection steps the world.
    pub(crate) fn drives(&self, connection: u64) {
        if self.drivers.lock().insert(connection) {
            self.commander.set_lost(false);
        }
    }

    /// `world/info`, for which a gateway that has just started may have to wait.
    pub(crate) fn info(&self) -> Result<WorldInfo, Failure> {
        let info = self.world.wait_for(SETTLE, |known| known.info.clone());
        info.ok_or_else(|| {
            Failure::Refused(
                "no simulator runs on this domain; start one with `gantry up`".to_owned(),
            )
        })
    }

    /// Logs once per run that a call is accepted and has no effect.
    pub(crate) fn no_effect(&self, what: &str) {
        if self.said.lock().insert(what.to_owned()) {
            tracing::warn!(
                "{what} is accepted and has no effect; see docs/reference/carla-compatibility.md"
            );
        }
    }

    /// The token of a stream, as calls return it.
    pub(crate) fn token(&self, stream: u32) -> Value {
        list![Value::Bin(streams::token(stream, self.stream_port))]
    }

    /// The token of a client's own world stream.
    pub(crate) fn world_token(&self, connection: u64) -> Value {
        self.token(self.feeds.world_stream().stream_of(connection))
    }
}
