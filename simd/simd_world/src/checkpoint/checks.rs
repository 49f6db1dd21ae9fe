//! What a checkpoint from bytes must be like before anything uses it. Its checksum only detects
//! damage, so whoever wrote the file may have written any number: each is held against its limit,
//! each reference against what it refers to, and whatever follows from the map or the program is
//! taken from the living world.

use std::collections::BTreeSet;
use std::fmt::Display;

use rapier3d::prelude::{ColliderHandle, RigidBodyHandle};
use schema_frames::ActorKind;
use schema_frames::journal::FIRST_ADDED_ID;
use schema_frames::limits::check_actor_texts;
use schema_types::{ActorId, Pose};

use super::error::CheckpointError;
use crate::actors::Actor;
use crate::physics::engine_state;
use crate::props::prop_models;
use crate::vehicles::check_vehicle;
use crate::walkers::walker_models;
use crate::world::World;

/// Longest time since the beginning of the episode, nanoseconds: ten years. Clocks of 64 bits have
/// room for fifty times as much, so no sum of it and of the time that a simulator runs overflows.
pub const MAX_EPISODE_NANOS: u64 = 10 * 365 * 86_400 * 1_000_000_000;
/// Greatest id that the next actor may get: as many again are left for those to come.
const MAX_NEXT_ACTOR: u32 = FIRST_ADDED_ID / 2;
/// Greatest distance of an actor from the middle of the map, or from its parent, metres.
const MAX_DISTANCE_M: f64 = 1e7;

/// A value that no world has.
pub(super) fn refuse(
    what: impl Display,
    value: impl Display,
    allowed: impl Display,
) -> CheckpointError {
    CheckpointError::Value {
        what: what.to_string(),
        value: value.to_string(),
        allowed: allowed.to_string(),
    }
}

/// Whether the time since the beginning of the episode can be true.
pub(super) fn check_elapsed(elapsed_nanos: u64) -> Result<(), CheckpointError> {
    match elapsed_nanos > MAX_EPISODE_NANOS {
        true => Err(refuse(
            "the time since the episode began",
            format!("{elapsed_nanos} ns"),
            format!("at most {MAX_EPISODE_NANOS} ns (ten years)"),
        )),
        false => Ok(()),
    }
}

impl World {
    /// Checks everything that was read, for a world that can take the place of `living`.
    pub(super) fn check_values(&mut self, living: &World) -> Result<(), CheckpointError> {
        self.check_actors()?;
        self.check_signals(living)?;
        self.check_bodies(living)?;
        let mut weather = self.weather;
        weather
            .set(self.weather.now)
            .map_err(|error| CheckpointError::Body(error.to_string()))?;
        self.walkers
            .crowd
            .check()
            .map_err(|ways| refuse("the number of ways of a walker", ways, "less than 2^62"))?;
        // These follow from the actors and the program, so they need not be believed.
        let spectator = living.actors.by_id.get(&living.spectator);
        let topics = spectator.map(|it| it.topics.clone());
        if let Ok(own) = self.actors.get_mut(self.spectator) {
            own.topics = topics.unwrap_or_default();
        }
        self.friction.refresh(&self.actors, &self.catalogue);
        engine_state::take_constants(&mut self.physics.engine, &living.physics.engine);
        Ok(())
    }

    fn check_actors(&self) -> Result<(), CheckpointError> {
        let next = self.counts.next_actor();
        if next > MAX_NEXT_ACTOR {
            let allowed = format!("at most {MAX_NEXT_ACTOR}");
            return Err(refuse("the id of the next actor", next, allowed));
        }
        for (id, actor) in &self.actors.by_id {
            self.check_actor(*id, actor)?;
        }
        let is_of = |id: &ActorId, kind| {
            let actor = self.actors.by_id.get(id);
            actor.is_some_and(|actor| actor.kind == kind)
        };
        if !is_of(&self.spectator, ActorKind::Spectator) {
            let allowed = "the id of an actor of that kind";
            return Err(refuse("the spectator", self.spectator, allowed));
        }
        let vehicles = self.vehicles.by_id.keys();
        let parts = vehicles
            .map(|id| (id, ActorKind::Vehicle))
            .chain(self.walkers.by_id.keys().map(|id| (id, ActorKind::Walker)))
            .chain(self.props.all().map(|(id, _)| (id, ActorKind::Prop)));
        for (id, kind) in parts {
            if !is_of(id, kind) {
                let what = format!("the body of actor {id}");
                return Err(refuse(
                    what,
                    format!("{kind:?}"),
                    "that of its actor's kind",
                ));
            }
        }
        for (id, actor) in &self.actors.by_id {
            let has_body = match actor.kind {
                ActorKind::Vehicle => self.vehicles.by_id.contains_key(id),
                ActorKind::Walker => self.walkers.by_id.contains_key(id),
                _ => true,
            };
            if !has_body {
                return Err(refuse(
                    format!("the body of actor {id}"),
                    "missing",
                    "there",
                ));
            }
        }
        for id in self.trigger_boxes.keys().chain(self.booms.by_id.keys()) {
            if !self.actors.contains(*id) {
                let what = "the actor of a trigger box or spring arm";
                return Err(refuse(what, id, "an actor of the checkpoint"));
            }
        }
        Ok(())
    }

    fn check_actor(&self, id: ActorId, actor: &Actor) -> Result<(), CheckpointError> {
        let of = |what: &str| format!("{what} of actor {id}");
        if actor.id != id {
            return Err(refuse(of("the id"), actor.id, "the one it is filed under"));
        }
        let is_added = id.0 >= FIRST_ADDED_ID && actor.kind == ActorKind::Sensor;
        if id.0 == 0 || (id.0 >= self.counts.next_actor() && !is_added) {
            let allowed = format!("1 to {}", self.counts.next_actor().saturating_sub(1));
            return Err(refuse("the id of an actor", id, allowed));
        }
        let entries = &self.catalogue.entries;
        let Some(entry) = entries.get(actor.catalogue_idx as usize) else {
            let allowed = format!("less than {}", entries.len());
            return Err(refuse(of("the type"), actor.catalogue_idx, allowed));
        };
        let is_known = match actor.kind {
            ActorKind::Vehicle => self.vehicles.by_id.get(&id).is_some_and(|vehicle| {
                // A vehicle's body says for itself which model it is of.
                vehicle.model.type_id == entry.type_id
            }),
            kind => entry.kind == kind_name(kind),
        };
        if !is_known {
            let allowed = format!("that of {:?}", entry.type_id);
            return Err(refuse(of("the kind"), format!("{:?}", actor.kind), allowed));
        }
        // A parent comes before what is attached to it, so there are no circles.
        if let Some(parent) = actor.parent
            && (parent >= id || !self.actors.contains(parent))
        {
            let allowed = "an actor with a smaller id";
            return Err(refuse(of("the parent"), parent, allowed));
        }
        let origin_m = match actor.parent {
            Some(_) => [0.0; 3],
            None => self.map.origin_m,
        };
        if !is_near(&actor.pose, origin_m) {
            let value = format!("{:?}", actor.pose);
            let allowed = "finite, within 10 000 km, with a unit quaternion";
            return Err(refuse(of("the pose"), value, allowed));
        }
        let texts = actor
            .attributes
            .iter()
            .map(|(k, v)| (k.as_str(), v.as_str()));
        check_actor_texts(&actor.role, texts)
            .map_err(|limit| CheckpointError::Body(format!("actor {id}: {limit}")))?;
        // The spectator's topics are those of the living one, as a sensor's are.
        let has_topics = matches!(actor.kind, ActorKind::Sensor | ActorKind::Spectator);
        if !has_topics && !actor.topics.is_empty() {
            let n = actor.topics.len();
            return Err(refuse(
                of("the number of topics"),
                n,
                "0, as it is no sensor",
            ));
        }
        Ok(())
    }

    /// The lights and signs are those of the map, whose boxes and groups need not be believed.
    fn check_signals(&mut self, living: &World) -> Result<(), CheckpointError> {
        let of_map = |world: &World| -> Vec<(ActorId, ActorKind, u32, String)> {
            let actors = world.actors.by_id.values();
            let of_map = actors.filter(|actor| {
                matches!(
                    actor.kind,
                    ActorKind::TrafficLight | ActorKind::TrafficSign | ActorKind::Spectator
                )
            });
            of_map
                .map(|actor| {
                    let signal = actor.attributes.get("opendrive_id");
                    let signal = signal.cloned().unwrap_or_default();
                    (actor.id, actor.kind, actor.catalogue_idx, signal)
                })
                .collect()
        };
        let (own, expected) = (of_map(self), of_map(living));
        let same = own.len() == expected.len()
            && own
                .iter()
                .zip(&expected)
                .all(|(a, b)| (a.1, a.2, &a.3) == (b.1, b.2, &b.3));
        if !same {
            let (found, needed) = (own.len(), expected.len());
            return Err(refuse(
                "the spectator with the map's lights and signs",
                format!("{found} actors"),
                format!("the {needed} of the map, in its order"),
            ));
        }
        let lights = own.iter().filter(|of| of.1 == ActorKind::TrafficLight);
        let lights: Vec<ActorId> = lights.map(|of| of.0).collect();
        self.lights
            .check(&living.lights, &lights, MAX_EPISODE_NANOS)
            .map_err(|wrong| refuse(wrong.what, wrong.value, wrong.allowed))
    }

    /// Every body of the engine is one of the map or of one actor, and of a kind that there is.
    fn check_bodies(&self, living: &World) -> Result<(), CheckpointError> {
        let engine = &self.physics.engine;
        let mut owned: BTreeSet<(u32, u32)> = BTreeSet::new();
        let mut take = |what: String, body: RigidBodyHandle| {
            let is_new = owned.insert(body.into_raw_parts());
            match is_new && engine.bodies.get(body).is_some() {
                true => Ok(()),
                false => Err(refuse(
                    what,
                    format!("{:?}", body.into_raw_parts()),
                    "one of its own",
                )),
            }
        };
        for body in engine_state::map_bodies(&living.physics.engine) {
            take("a body of the map".to_owned(), body)?;
        }
        for (id, vehicle) in &self.vehicles.by_id {
            take(format!("the body of vehicle {id}"), vehicle.body)?;
            check_vehicle(vehicle, engine)
                .map_err(|error| CheckpointError::Body(format!("vehicle {id}: {error}")))?;
        }
        for (id, prop) in self.props.all() {
            if usize::from(prop.model_idx) >= prop_models().len() {
                let what = format!("the model of prop {id}");
                let allowed = format!("less than {}", prop_models().len());
                return Err(refuse(what, prop.model_idx, allowed));
            }
            if let Some(body) = prop.body {
                take(format!("the body of prop {id}"), body)?;
            }
        }
        for (id, walker) in &self.walkers.by_id {
            if usize::from(walker.model_idx) >= walker_models().len() {
                let what = format!("the model of walker {id}");
                let allowed = format!("less than {}", walker_models().len());
                return Err(refuse(what, walker.model_idx, allowed));
            }
        }
        if engine.bodies.len() != owned.len() {
            let allowed = format!("{}, one for each that has one", owned.len());
            return Err(refuse("the number of bodies", engine.bodies.len(), allowed));
        }
        engine_state::check(engine, |collider: ColliderHandle| {
            living.physics.engine.colliders.get(collider)
        })
        .map_err(|error| CheckpointError::Body(error.to_string()))
    }
}

fn is_near(pose: &Pose, origin_m: [f64; 3]) -> bool {
    let place = pose.translation_m.iter().zip(origin_m);
    let norm = pose.rotation_xyzw.iter().map(|x| x * x).sum::<f64>().sqrt();
    // Comparisons with a number that is none are false.
    place
        .into_iter()
        .all(|(x, origin)| (x - origin).abs() <= MAX_DISTANCE_M)
        && (0.5..=2.0).contains(&norm)
}

/// The word that the catalogue has for a kind.
fn kind_name(kind: ActorKind) -> &'static str {
    match kind {
        ActorKind::Vehicle => "vehicle",
        ActorKind::Walker => "walker",
        ActorKind::TrafficLight => "traffic_light",
        ActorKind::TrafficSign => "traffic_sign",
        ActorKind::Prop => "prop",
        ActorKind::Sensor => "sensor",
        ActorKind::Spectator => "spectator",
        ActorKind::Controller => "controller",
    }
}
