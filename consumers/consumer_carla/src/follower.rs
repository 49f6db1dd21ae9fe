//! The thread that follows the simulator: it reads documents and snapshots into the known world and
//! feeds the world stream.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime};

use anyhow::Context as _;
use consumer_kit::{FollowedDocument, WorldAt};
use schema_bus::{Bus, BusError, Document, Listener, Snapshot, SnapshotReader, names};
use schema_frames::{ActorList, Catalogue, SnapshotHeader, SpawnPoints, WorldInfo};

use crate::gateway::Gateway;
use crate::stages;
use crate::wire::geolocation;
use crate::wire::streams::StreamMessage;
use crate::wire::world_message;

/// Longest wait for a snapshot; documents can change without one.
const LOOK_EVERY: Duration = Duration::from_millis(10);
/// How long a snapshot waits for the list of actors that belongs to it.
const LIST_WAIT: Duration = Duration::from_millis(200);

/// Keeps a gateway's known world up to date until `stop`.
///
/// # Errors
/// Fails for what waiting cannot cure: another schema version, no room on the bus.
pub fn follow(domain: &str, gateway: &Gateway, stop: &AtomicBool) -> anyhow::Result<()> {
    let bus = Bus::open(domain, "gantry-carla-world")?;
    let mut follower = Follower {
        snapshots: None,
        wake: bus.listener(names::WORLD_SNAPSHOT)?,
        info: FollowedDocument::new(names::WORLD_INFO),
        next_info: None,
        map: FollowedDocument::new(names::WORLD_MAP),
        actors: FollowedDocument::new(names::WORLD_ACTORS),
        catalogue: FollowedDocument::new(names::WORLD_CATALOGUE),
        spawn_points: FollowedDocument::new(names::WORLD_SPAWN_POINTS),
        next_open: Instant::now(),
        sent_episode: None,
        bus,
        gateway,
    };
    while !stop.load(Ordering::Acquire) {
        follower.turn()?;
    }
    Ok(())
}

struct Follower<'g> {
    // Fields are dropped in order: ports before their node.
    snapshots: Option<SnapshotReader>,
    wake: Listener,
    info: FollowedDocument,
    /// The newest `world/info` and the epoch of its header, held back until the other documents of
    /// that epoch are known.
    next_info: Option<(u64, WorldInfo)>,
    map: FollowedDocument,
    actors: FollowedDocument,
    catalogue: FollowedDocument,
    spawn_points: FollowedDocument,
    next_open: Instant,
    sent_episode: Option<u64>,
    bus: Bus,
    gateway: &'g Gateway,
}

impl Follower<'_> {
    fn turn(&mut self) -> anyhow::Result<()> {
        self.wake.wait(LOOK_EVERY)?;
        let tick = self
            .gateway
            .world
            .known()
            .snapshot
            .as_ref()
            .map(|at| at.header.tick);
        schema_stages::post(tick.unwrap_or(0));
        let _span = stages::SNAPSHOT.span();
        self.gateway.feeds.world_stream().held_answers.sweep();
        self.gateway.feeds.world_stream().lost_managers.sweep();
        self.read_documents()?;
        self.open_snapshots()?;
        while let Some(reader) = &mut self.snapshots {
            match reader.next() {
                Ok(Some(snapshot)) => self.pass_on(&snapshot)?,
                Ok(None) => break,
                Err(error @ BusError::BadSample { .. }) => {
                    tracing::warn!(%error, "passed over a snapshot")
                }
                Err(other) => return Err(other.into()),
            }
        }
        Ok(())
    }

    fn open_snapshots(&mut self) -> anyhow::Result<()> {
        if self.snapshots.is_some() || Instant::now() < self.next_open {
            return Ok(());
        }
        self.next_open = Instant::now() + Duration::from_millis(200);
        if self.bus.exists(names::WORLD_SNAPSHOT) {
            match self.bus.snapshot_reader() {
                Ok(reader) => self.snapshots = Some(reader),
                Err(BusError::NoSuchTopic { .. } | BusError::Service { .. }) => {}
                Err(other) => return Err(other.into()),
            }
        }
        Ok(())
    }

    fn read_documents(&mut self) -> anyhow::Result<()> {
        // `world/info` is read first: the daemon sends it last, so the other documents of its
        // episode are there by now.
        if let Some(document) = heal(self.info.changed(&self.bus))? {
            self.next_info = Some((
                document.header.epoch,
                document.json().context("world/info")?,
            ));
        }
        if let Some(document) = heal(self.map.changed(&self.bus))? {
            let geo_reference_deg = Some(geolocation::geo_reference_deg(&document.text));
            let text: Arc<str> = roomy(&document.text).into();
            self.gateway
                .world
                .change(|known| (known.map, known.geo_reference_deg) = (text, geo_reference_deg));
        }
        if let Some(document) = heal(self.catalogue.changed(&self.bus))? {
            let catalogue: Catalogue = document.json().context("world/catalogue")?;
            self.gateway
                .world
                .change(|known| known.catalogue = Arc::new(catalogue));
        }
        if let Some(document) = heal(self.spawn_points.changed(&self.bus))? {
            let points: SpawnPoints = document.json().context("world/spawn_points")?;
            self.gateway
                .world
                .change(|known| known.spawn_points = Arc::new(points));
        }
        self.read_actors()?;
        self.adopt_info();
        Ok(())
    }

    /// Makes the newest `world/info` known, last of all documents: whoever waits for an episode
    /// watches its info and asks for the rest at once. A daemon's first documents come in any
    /// order.
    fn adopt_info(&mut self) {
        let others = [&self.map, &self.catalogue, &self.spawn_points, &self.actors];
        let is_known = |epoch: u64| {
            others.iter().all(|other| {
                other
                    .newest()
                    .is_some_and(|text| text.header.epoch == epoch)
            })
        };
        let Some((_, info)) = self.next_info.take_if(|(epoch, _)| is_known(*epoch)) else {
            return;
        };
        let before = self
            .gateway
            .world
            .known()
            .info
            .as_ref()
            .map(|info| (info.epoch.clone(), info.episode));
        let begins = before.as_ref() != Some(&(info.epoch.clone(), info.episode));
        if begins {
            tracing::info!(map = info.map, episode = info.episode, "episode begins");
            self.gateway.feeds.world_stream().forget();
        }
        self.gateway.world.change(|known| {
            if begins {
                known.own.clear();
                known.gone_along.clear();
            }
            known.info = Some(info);
        });
        if begins {
            launch_cli::heap::give_back();
        }
    }

    fn read_actors(&mut self) -> anyhow::Result<()> {
        if let Some(document) = heal(self.actors.changed(&self.bus))? {
            let list: ActorList = document.json().context("world/actors")?;
            let actors = list
                .actors
                .into_iter()
                .map(|actor| (actor.id, actor))
                .collect();
            self.gateway.world.change(|known| known.list(actors));
        }
        Ok(())
    }

    /// Makes a snapshot known and sends it to clients, once its actors are listed: whoever sees a
    /// snapshot may ask for all of its actors.
    fn pass_on(&mut self, snapshot: &Snapshot) -> anyhow::Result<()> {
        let header = snapshot.header();
        let deadline = Instant::now() + LIST_WAIT;
        let is_listed = |newest: Option<&Document>| {
            newest.is_some_and(|list| {
                list.header.epoch == header.epoch && list.header.revision >= header.actors_revision
            })
        };
        while !is_listed(self.actors.newest()) && Instant::now() < deadline {
            self.read_actors()?;
            if !is_listed(self.actors.newest()) {
                std::thread::sleep(Duration::from_micros(200));
            }
        }
        let id = world_message::episode_id(header);
        let mut state_bits = if self.sent_episode.replace(id) == Some(id) {
            0
        } else {
            world_message::MAP_CHANGED
        };
        if header.flags & SnapshotHeader::SCENERY_CHANGED != 0 {
            state_bits |= world_message::MAP_CHANGED;
        }
        if header.flags & SnapshotHeader::LAMPS_CHANGED != 0 {
            state_bits |= world_message::LIGHTS_CHANGED;
        }
        let wall_secs = SystemTime::now()
            .duration_since(SystemTime::UNIX_EPOCH)
            .map_or(0.0, |since| since.as_secs_f64());
        let message = world_message::encode(header, snapshot.records(), state_bits, wall_secs);
        let at = WorldAt {
            header: *header,
            records: snapshot.records().to_vec(),
        };
        self.gateway
            .world
            .change(|known| known.snapshot = Some(Arc::new(at)));
        self.gateway.after_snapshot();
        self.gateway.feeds.world_stream().send(StreamMessage {
            tick: header.tick,
            bytes: message.into(),
        });
        Ok(())
    }
}

/// The map's text, padded with blank lines to the size of CARLA's own towns.
///
/// Scripts (one of CARLA's tutorials among them) use `get_color_coded_flow().raw_data` after its
/// image was freed. This works only while the C library does not return memory of that size to the
/// system, and it stops returning it once a client has freed a block as large as CARLA's map texts.
fn roomy(map: &str) -> String {
    const BYTES: usize = 4 << 20;
    let mut text = String::with_capacity(BYTES.max(map.len()));
    text.push_str(map);
    text.extend(std::iter::repeat_n('\n', BYTES.saturating_sub(map.len())));
    text
}

/// Skips a document that breaks the contract; any other error is passed on.
fn heal<T>(result: Result<Option<T>, BusError>) -> Result<Option<T>, BusError> {
    match result {
        Err(error @ BusError::BadSample { .. }) => {
            tracing::warn!(%error, "passed over a document");
            Ok(None)
        }
        other => other,
    }
}
