//! What the gateway knows of the simulator: documents and the newest snapshot, kept by one thread
//! and read by all connections.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use anyhow::Context as _;
use consumer_kit::{FollowedDocument, WorldAt};
use schema_bus::{Bus, BusError, Document, Listener, Snapshot, SnapshotReader, names};
use schema_frames::{
    ActorInfo, ActorList, Catalogue, CatalogueEntry, SnapshotHeader, SpawnPoints, WorldInfo,
};

use crate::episode;
use crate::fields::Description;
use crate::sensors::{self, Kind, lenient, records};
use crate::stream::{Streams, WorldMessage};

/// Longest wait for a snapshot: documents change without one too.
const LOOK_EVERY: Duration = Duration::from_millis(10);
/// How long a snapshot waits for the list of its actors.
const LIST_WAIT: Duration = Duration::from_millis(200);

/// The newest of everything.
#[derive(Debug, Default)]
pub struct Known {
    /// `world/info`.
    pub info: Option<WorldInfo>,
    /// `world/catalogue`.
    pub catalogue: Arc<Catalogue>,
    /// `world/actors` by id.
    pub actors: BTreeMap<u32, ActorInfo>,
    /// Actors that clients made.
    pub own: HashMap<u32, Own>,
    /// Actors that went with what they were attached to, and that scripts may still want to
    /// destroy.
    pub gone_along: BTreeSet<u32>,
    /// Latitude and longitude of the map's origin.
    pub geo_reference_deg: Option<[f64; 2]>,
    /// `world/map`, and blank lines.
    pub map: Arc<str>,
    /// `world/spawn_points`.
    pub spawn_points: Arc<SpawnPoints>,
    /// The newest snapshot.
    pub snapshot: Option<Arc<WorldAt>>,
}

/// What is known of an actor that a client made, before it is on the list and beside what is
/// listed.
#[derive(Clone, Debug)]
pub struct Own {
    /// As the client described it: also what the simulator does not keep.
    pub description: Description,
    /// What it is attached to; 0 if nothing.
    pub parent: u32,
    /// Its topics, if it is a sensor.
    pub topics: Vec<String>,
}

impl Known {
    /// Forgets an actor that was destroyed; what was attached to it went along.
    pub fn forget(&mut self, id: u32) {
        let mut gone = vec![id];
        while let Some(parent) = gone.pop() {
            self.own.remove(&parent);
            let listed = self
                .actors
                .values()
                .filter(|actor| actor.parent_id == parent)
                .map(|actor| actor.id);
            let own = self
                .own
                .iter()
                .filter(|(_, own)| own.parent == parent)
                .map(|(id, _)| *id);
            let along: Vec<u32> = listed
                .chain(own)
                .filter(|child| !self.gone_along.contains(child))
                .collect();
            self.gone_along.extend(&along);
            gone.extend(along);
        }
    }

    /// Id of the running episode for clients, once a simulator was seen.
    pub fn episode_id(&self) -> Option<u64> {
        let info = self.info.as_ref()?;
        let epoch: u64 = info.epoch.parse().ok()?;
        Some(epoch.wrapping_add(u64::from(info.episode)))
    }

    /// The catalogue's entry of a type, with its index.
    pub fn entry(&self, type_id: &str) -> Option<(usize, &CatalogueEntry)> {
        self.catalogue
            .entries
            .iter()
            .enumerate()
            .find(|(_, entry)| entry.type_id == type_id)
    }

    /// What a client that listens to this actor is sent: the kind of sensor, and the topics that
    /// its messages are made of.
    pub fn sensor(&self, id: u32) -> Option<(&'static Kind, Vec<String>)> {
        let listed = self.actors.get(&id);
        let type_id = self
            .own
            .get(&id)
            .map(|own| own.description.type_id.as_str())
            .or(listed.map(|actor| actor.type_id.as_str()))?;
        let kind = sensors::kind(type_id)?;
        let topics: Vec<&str> = match (self.own.get(&id), listed) {
            (Some(own), _) => own.topics.iter().map(String::as_str).collect(),
            (None, Some(actor)) => actor
                .topics
                .iter()
                .map(|info| info.topic.as_str())
                .collect(),
            (None, None) => return None,
        };
        let found = kind.modalities.iter().map(|modality| {
            topics
                .iter()
                .find(|topic| topic.rsplit('/').next() == Some(modality.name()))
        });
        Some((
            kind,
            found
                .map(|topic| topic.map(|topic| (*topic).to_owned()))
                .collect::<Option<_>>()?,
        ))
    }

    /// A lidar's horizontal field of view.
    pub fn fov_rad(&self, id: u32) -> f32 {
        let own = self
            .own
            .get(&id)
            .and_then(|own| own.description.attribute("horizontal_fov"));
        let listed = self
            .actors
            .get(&id)
            .and_then(|actor| actor.attributes.get("horizontal_fov"))
            .map(String::as_str);
        own.or(listed).map_or(std::f64::consts::TAU, |degrees| {
            lenient::float(degrees).to_radians()
        }) as f32
    }

    /// Whether a vehicle keeps its control until it is given another.
    pub fn is_sticky(&self, id: u32) -> bool {
        let own = self
            .own
            .get(&id)
            .and_then(|own| own.description.attribute("sticky_control"));
        let listed = self
            .actors
            .get(&id)
            .and_then(|actor| actor.attributes.get("sticky_control"))
            .map(String::as_str);
        own.or(listed)
            .is_none_or(|value| value.eq_ignore_ascii_case("true"))
    }

    /// Whether there is such an actor, as far as is known.
    pub fn has_actor(&self, id: u32) -> bool {
        self.actors.contains_key(&id) || self.own.contains_key(&id)
    }
}

/// [`Known`] with a lock and a bell.
#[derive(Debug, Default)]
pub struct World {
    known: Mutex<Known>,
    changed: Condvar,
    after_snapshot: AfterSnapshot,
}

/// What runs after each snapshot and before clients see it.
#[derive(Default)]
struct AfterSnapshot(OnceLock<Box<dyn Fn() + Send + Sync>>);

impl std::fmt::Debug for AfterSnapshot {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("AfterSnapshot")
            .field(&self.0.get().is_some())
            .finish()
    }
}

impl World {
    /// Runs something after each snapshot, before clients see it; set once.
    pub fn after_each_snapshot(&self, run: impl Fn() + Send + Sync + 'static) {
        let _ = self.after_snapshot.0.set(Box::new(run));
    }

    /// Looks at everything. Hold it briefly: the snapshot waits for it.
    pub fn known(&self) -> MutexGuard<'_, Known> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes something and rings the bell.
    pub fn change<R>(&self, change: impl FnOnce(&mut Known) -> R) -> R {
        let result = change(&mut self.known());
        self.changed.notify_all();
        result
    }

    /// Waits until `look` finds something, at most `timeout`.
    pub fn wait_for<R>(
        &self,
        timeout: Duration,
        mut look: impl FnMut(&Known) -> Option<R>,
    ) -> Option<R> {
        let deadline = Instant::now() + timeout;
        let mut known = self.known();
        loop {
            if let Some(found) = look(&known) {
                return Some(found);
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return None;
            }
            known = self
                .changed
                .wait_timeout(known, left)
                .unwrap_or_else(PoisonError::into_inner)
                .0;
        }
    }

    /// Number of the newest tick seen.
    pub fn tick(&self) -> u64 {
        self.known()
            .snapshot
            .as_ref()
            .map_or(0, |snapshot| snapshot.header.tick)
    }
}

/// Keeps a [`World`] up to date and feeds the world stream, until `stop`.
///
/// # Errors
/// What waiting cannot heal: another schema, no place on the bus.
pub fn follow(
    domain: &str,
    world: &World,
    streams: &Streams,
    stop: &AtomicBool,
) -> anyhow::Result<()> {
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
        world,
        streams,
    };
    while !stop.load(Ordering::Acquire) {
        follower.turn()?;
    }
    Ok(())
}

struct Follower<'w> {
    // Ports go before their node.
    snapshots: Option<SnapshotReader>,
    wake: Listener,
    info: FollowedDocument,
    /// The newest `world/info`, with the epoch of its header, until everything that it tells about
    /// is known.
    next_info: Option<(u64, WorldInfo)>,
    map: FollowedDocument,
    actors: FollowedDocument,
    catalogue: FollowedDocument,
    spawn_points: FollowedDocument,
    next_open: Instant,
    sent_episode: Option<u64>,
    bus: Bus,
    world: &'w World,
    streams: &'w Streams,
}

impl Follower<'_> {
    fn turn(&mut self) -> anyhow::Result<()> {
        self.wake.wait(LOOK_EVERY)?;
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
        // First: the daemon sends it last, so that the others of its episode are there by now.
        if let Some(document) = heal(self.info.changed(&self.bus))? {
            self.next_info = Some((
                document.header.epoch,
                document.json().context("world/info")?,
            ));
        }
        if let Some(document) = heal(self.map.changed(&self.bus))? {
            let geo_reference_deg = Some(records::geo_reference_deg(&document.text));
            let text: Arc<str> = roomy(&document.text).into();
            self.world
                .change(|known| (known.map, known.geo_reference_deg) = (text, geo_reference_deg));
        }
        if let Some(document) = heal(self.catalogue.changed(&self.bus))? {
            let catalogue: Catalogue = document.json().context("world/catalogue")?;
            self.world
                .change(|known| known.catalogue = Arc::new(catalogue));
        }
        if let Some(document) = heal(self.spawn_points.changed(&self.bus))? {
            let points: SpawnPoints = document.json().context("world/spawn_points")?;
            self.world
                .change(|known| known.spawn_points = Arc::new(points));
        }
        self.read_actors()?;
        self.adopt_info();
        Ok(())
    }

    /// Last of all: who waits for an episode looks at its info, and asks for the rest at once. A
    /// daemon's first texts come in any order.
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
            .world
            .known()
            .info
            .as_ref()
            .map(|info| (info.epoch.clone(), info.episode));
        let begins = before.as_ref() != Some(&(info.epoch.clone(), info.episode));
        if begins {
            tracing::info!(map = info.map, episode = info.episode, "episode begins");
            self.streams.forget();
        }
        self.world.change(|known| {
            if begins {
                known.own.clear();
                known.gone_along.clear();
            }
            known.info = Some(info);
        });
    }

    fn read_actors(&mut self) -> anyhow::Result<()> {
        if let Some(document) = heal(self.actors.changed(&self.bus))? {
            let list: ActorList = document.json().context("world/actors")?;
            let actors = list
                .actors
                .into_iter()
                .map(|actor| (actor.id, actor))
                .collect();
            self.world.change(|known| known.actors = actors);
        }
        Ok(())
    }

    /// Whoever sees a snapshot can ask for all of its actors.
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
        let id = episode::episode_id(header);
        let mut state_bits = if self.sent_episode.replace(id) == Some(id) {
            0
        } else {
            episode::MAP_CHANGED
        };
        if header.flags & SnapshotHeader::SCENERY_CHANGED != 0 {
            state_bits |= episode::MAP_CHANGED;
        }
        if header.flags & SnapshotHeader::LAMPS_CHANGED != 0 {
            state_bits |= episode::LIGHTS_CHANGED;
        }
        let wall_secs = SystemTime::now()
            .duration_since(SystemTime::UNIX_EPOCH)
            .map_or(0.0, |since| since.as_secs_f64());
        let message = episode::encode(header, snapshot.records(), state_bits, wall_secs);
        let at = WorldAt {
            header: *header,
            records: snapshot.records().to_vec(),
        };
        self.world
            .change(|known| known.snapshot = Some(Arc::new(at)));
        if let Some(run) = self.world.after_snapshot.0.get() {
            run();
        }
        self.streams.send(WorldMessage {
            tick: header.tick,
            bytes: message.into(),
        });
        Ok(())
    }
}

/// The map's text, with blank lines behind it up to the size of CARLA's own towns.
///
/// Scripts show `get_color_coded_flow().raw_data` after the picture is gone (a tutorial does). That
/// goes well only if the C library does not
/// hand memory of that size back to the system, which it no longer does once a client has freed a
/// block as large as CARLA's map texts are.
fn roomy(map: &str) -> String {
    const BYTES: usize = 4 << 20;
    let mut text = String::with_capacity(BYTES.max(map.len()));
    text.push_str(map);
    text.extend(std::iter::repeat_n('\n', BYTES.saturating_sub(map.len())));
    text
}

/// A document that breaks the contract is passed over; anything else is an error.
fn heal<T>(result: Result<Option<T>, BusError>) -> Result<Option<T>, BusError> {
    match result {
        Err(error @ BusError::BadSample { .. }) => {
            tracing::warn!(%error, "passed over a document");
            Ok(None)
        }
        other => other,
    }
}
