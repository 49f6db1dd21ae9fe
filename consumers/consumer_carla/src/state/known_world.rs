//! What the gateway knows of the simulator: documents and the newest snapshot, written by one
//! thread and read by all connections.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;
use std::time::{Duration, Instant};

use consumer_kit::WorldAt;
use consumer_rpc::budget::Holding;
use parking_lot::{Condvar, Mutex, MutexGuard};
use schema_frames::{ActorInfo, Catalogue, CatalogueEntry, SpawnPoints, WorldInfo};

use crate::wire::description::Description;
use crate::wire::lenient;
use crate::wire::sensor_kinds::{self, Kind};

/// The newest state of everything that is known.
#[derive(Debug, Default)]
pub struct Known {
    /// `world/info`.
    pub info: Option<WorldInfo>,
    /// `world/catalogue`.
    pub catalogue: Arc<Catalogue>,
    /// `world/actors` by id.
    pub actors: BTreeMap<u32, ActorInfo>,
    /// Actors that clients of this gateway spawned.
    pub own: HashMap<u32, Own>,
    /// Actors that were destroyed together with their parents; scripts may still ask to destroy
    /// them.
    pub gone_along: BTreeSet<u32>,
    /// Latitude and longitude of the map's origin.
    pub geo_reference_deg: Option<[f64; 2]>,
    /// `world/map`, padded with blank lines.
    pub map: Arc<str>,
    /// `world/spawn_points`.
    pub spawn_points: Arc<SpawnPoints>,
    /// Gravity that IMUs measure if a client set one, m/s².
    pub imu_gravity_mps2: Option<f64>,
    /// The newest snapshot.
    pub snapshot: Option<Arc<WorldAt>>,
}

/// What a client said about an actor that it spawned: known before the actor is listed, and more
/// than what is listed.
#[derive(Clone, Debug)]
pub struct Own {
    /// The client's description, including attributes that the simulator does not keep.
    pub description: Description,
    /// The actor that it is attached to; 0 if none.
    pub parent: u32,
    /// Its topics, if it is a sensor.
    pub topics: Vec<String>,
    /// What it costs of the memory for all descriptions.
    pub cost: Option<Arc<Holding>>,
}

impl Known {
    /// Forgets a destroyed actor and everything that was attached to it.
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

    /// Takes over a new list of actors. Whoever was listed and is not any more is gone.
    pub fn list(&mut self, actors: BTreeMap<u32, ActorInfo>) {
        for id in self.actors.keys().filter(|id| !actors.contains_key(id)) {
            self.own.remove(id);
        }
        self.actors = actors;
    }

    /// A copy of the actors, the catalogue and the snapshot, for work that takes longer than the lock
    /// may be held.
    pub fn excerpt(&self) -> Known {
        Known {
            catalogue: self.catalogue.clone(),
            actors: self.actors.clone(),
            snapshot: self.snapshot.clone(),
            ..Known::default()
        }
    }

    /// CARLA's id of the running episode, once a simulator was seen.
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

    /// The kind of a sensor, and the topics that its messages are made of; `None` if the actor is
    /// no sensor with a stream.
    pub fn sensor(&self, id: u32) -> Option<(&'static Kind, Vec<String>)> {
        let listed = self.actors.get(&id);
        let type_id = self
            .own
            .get(&id)
            .map(|own| own.description.type_id.as_str())
            .or(listed.map(|actor| actor.type_id.as_str()))?;
        let kind = sensor_kinds::kind(type_id)?;
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

    /// Number of wheels of a type of vehicle.
    pub fn n_wheels_of(&self, type_id: &str) -> Option<usize> {
        let (_, entry) = self.entry(type_id)?;
        entry.attributes.get("number_of_wheels")?.parse().ok()
    }

    /// Number of wheels of a vehicle.
    pub fn n_wheels(&self, id: u32) -> Option<usize> {
        let own = self.own.get(&id).map(|own| &own.description.type_id);
        let listed = self.actors.get(&id).map(|actor| &actor.type_id);
        self.n_wheels_of(own.or(listed)?)
    }

    /// Whether an actor with this id is known.
    pub fn has_actor(&self, id: u32) -> bool {
        self.actors.contains_key(&id) || self.own.contains_key(&id)
    }
}

/// [`Known`] behind a lock, with a condition variable for changes.
#[derive(Debug, Default)]
pub struct World {
    known: Mutex<Known>,
    changed: Condvar,
}

impl World {
    /// Locks what is known. Hold the lock briefly: the next snapshot waits for it.
    pub fn known(&self) -> MutexGuard<'_, Known> {
        self.known.lock()
    }

    /// Changes something and wakes everyone who waits for changes.
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
            self.changed.wait_for(&mut known, left);
        }
    }

    /// Whether an episode after `episode` is known, as after another map was loaded; waits for it at
    /// most `timeout`. The new episode's first `world/info` has the mode and period of the one before.
    #[must_use]
    pub fn knows_episode_after(&self, episode: u32, timeout: Duration) -> bool {
        self.wait_for(timeout, |known| {
            let info = known.info.as_ref()?;
            (info.episode > episode).then_some(())
        })
        .is_some()
    }

    /// The tick of the newest snapshot.
    pub fn tick(&self) -> u64 {
        self.known()
            .snapshot
            .as_ref()
            .map_or(0, |snapshot| snapshot.header.tick)
    }
}
