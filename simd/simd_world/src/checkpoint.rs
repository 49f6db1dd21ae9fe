//! Checkpoints: copies of the whole world, in memory or as bytes, from which a run continues bit
//! for bit.
//!
//! A checkpoint is the [`World`] itself, so a field that is added to the world, to a vehicle or to
//! a light is in it at once. Its bytes are postcard, which needs plain serde: no `flatten`, no
//! `untagged` or tagged enums, no `skip_serializing_if`. The engine's contacts and their impulses
//! are included, because a solver that starts warm ends elsewhere than one that starts cold. The
//! map's solid geometry is not: its colliders are written with a stand-in for their shape and take
//! the shape back from the living world, whose map must be the same.
//!
//! Sensors are not part of the world's state. Sensors that exist stay, and sensors of the
//! checkpoint come back only if they still exist. Ids go on counting, so no id ever names two
//! actors.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

mod checks;
mod error;
mod stack;

use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use schema_frames::ActorKind;
use schema_types::ActorId;
use schema_types::noise::mix;
use serde::Serialize;

use crate::actors::{Actor, Actors};
use crate::booms::Booms;
use crate::map_data::MapData;
use crate::physics::engine_state;
use crate::world::{World, WorldOptions};

use error::VERSION;

pub use checks::MAX_EPISODE_NANOS;
pub use error::CheckpointError;

/// "GCKP" read as a little-endian `u32`.
const MAGIC: u32 = u32::from_le_bytes(*b"GCKP");
/// Bytes before the body.
const HEAD_BYTES: usize = 48;
/// Bytes of the head that are under the checksum, which is its last word.
const SUMMED_HEAD_BYTES: usize = HEAD_BYTES - 8;
/// Steps that a checkpoint from bytes must survive before it is restored.
const TRIAL_STEPS: usize = 2;
/// Length of such a step.
const TRIAL_STEP_NANOS: u64 = 50_000_000;
/// Hash of everything that decides the body's layout: this crate's sources and the versions it is
/// built with.
const LAYOUT: &str = env!("GANTRY_WORLD_LAYOUT");

/// The world at one moment.
#[derive(Clone)]
pub struct Checkpoint {
    world: World,
    elapsed_nanos: u64,
}

impl Checkpoint {
    /// Simulated time since the beginning of the episode.
    pub fn elapsed_nanos(&self) -> u64 {
        self.elapsed_nanos
    }

    /// Its bytes for a file: a head of 48 bytes and the body. `docs/how-to/checkpoints.md` describes the
    /// layout.
    ///
    /// # Errors
    /// [`CheckpointError::Body`] if something in the world cannot be written.
    pub fn to_bytes(&self) -> Result<Vec<u8>, CheckpointError> {
        let body = Body {
            map: self.world.map.name.clone(),
            world: &self.world,
        };
        let body = postcard::to_allocvec(&body)
            .map_err(|error| CheckpointError::Body(error.to_string()))?;
        let mut bytes = Vec::with_capacity(body.len().saturating_add(HEAD_BYTES));
        bytes.extend(MAGIC.to_le_bytes());
        bytes.extend(VERSION.to_le_bytes());
        for word in [
            layout(),
            map_hash(&self.world.map),
            self.elapsed_nanos,
            body.len() as u64,
        ] {
            bytes.extend(word.to_le_bytes());
        }
        let sum = checksum(&bytes, &body);
        bytes.extend(sum.to_le_bytes());
        bytes.extend(body);
        Ok(bytes)
    }

    /// Reads what [`Checkpoint::to_bytes`] wrote; the map's geometry comes from `living`.
    ///
    /// # Errors
    /// [`CheckpointError`] if the bytes are foreign, damaged, of another build or of another map.
    pub fn from_bytes(bytes: &[u8], living: &World) -> Result<Checkpoint, CheckpointError> {
        if bytes.get(..4) != Some(&MAGIC.to_le_bytes()) {
            return Err(CheckpointError::Foreign);
        }
        let version = bytes.get(4..8).map_or(0, |word| {
            u32::from_le_bytes(word.try_into().expect("four bytes"))
        });
        if version != VERSION {
            return Err(CheckpointError::Version(version));
        }
        let Some((head, body)) = bytes.split_at_checked(HEAD_BYTES) else {
            return Err(CheckpointError::Length {
                found: 0,
                said: HEAD_BYTES as u64,
            });
        };
        // The words behind magic and version.
        let (words, _) = head[8..].as_chunks::<8>();
        let word = |idx: usize| words.get(idx).map_or(0, |word| u64::from_le_bytes(*word));
        if word(0) != layout() {
            return Err(CheckpointError::Layout);
        }
        if body.len() as u64 != word(3) {
            return Err(CheckpointError::Length {
                found: body.len() as u64,
                said: word(3),
            });
        }
        if checksum(&head[..SUMMED_HEAD_BYTES], body) != word(4) {
            return Err(CheckpointError::Checksum);
        }
        checks::check_elapsed(word(2))?;
        let (map, rest): (String, &[u8]) = postcard::take_from_bytes(body).map_err(broken)?;
        if map != living.map.name {
            return Err(CheckpointError::OtherMap {
                of: map,
                loaded: living.map.name.clone(),
            });
        }
        if word(1) != map_hash(&living.map) {
            return Err(CheckpointError::ChangedMap(map));
        }
        let checkpoint = unless_it_panics(|| {
            let checkpoint = Checkpoint {
                world: read_world(rest, living)?,
                elapsed_nanos: word(2),
            };
            checkpoint.try_in(living)?;
            Ok(checkpoint)
        })?;
        Ok(checkpoint)
    }

    /// Restores it in a copy of the world that runs, steps there, and ends every actor: whatever the
    /// checks before have not seen must come to light here and not in the world.
    fn try_in(&self, living: &World) -> Result<(), CheckpointError> {
        let mut copy = living.clone();
        copy.restore(self)?;
        (0..TRIAL_STEPS).for_each(|_| copy.step(TRIAL_STEP_NANOS));
        copy.physics.try_to_grow();
        copy.step(TRIAL_STEP_NANOS);
        let all: Vec<ActorId> = copy.actors.by_id.keys().copied().collect();
        for id in all {
            // A part goes with its whole, and is not there any more when its turn comes.
            let _ = copy.destroy(id);
        }
        copy.step(TRIAL_STEP_NANOS);
        Ok(())
    }
}

/// The world of a body, checked.
fn read_world(bytes: &[u8], living: &World) -> Result<World, CheckpointError> {
    let mut world: World = stack::read(bytes).map_err(broken)?;
    engine_state::take_geometry(&mut world.physics.engine, &living.physics.engine)
        .map_err(|error| CheckpointError::Body(error.to_string()))?;
    world.take_constants(living);
    world.actors.recount();
    world
        .actors
        .check()
        .map_err(|error| CheckpointError::Body(error.to_string()))?;
    world.check_values(living)?;
    Ok(world)
}

fn broken(error: postcard::Error) -> CheckpointError {
    CheckpointError::Body(error.to_string())
}

/// Runs the reading of bytes that may be anybody's. The engine takes the numbers of its own state
/// on trust and panics where they do not fit together.
fn unless_it_panics<T>(
    read: impl FnOnce() -> Result<T, CheckpointError>,
) -> Result<T, CheckpointError> {
    catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| {
        let what = "its parts do not fit together";
        Err(CheckpointError::Body(what.to_owned()))
    })
}

/// What follows the head.
#[derive(Serialize)]
struct Body<'w> {
    map: String,
    world: &'w World,
}

impl World {
    /// A copy of everything that changes. `elapsed_nanos` is the simulated time since the episode
    /// began.
    pub fn checkpoint(&self, elapsed_nanos: u64) -> Checkpoint {
        Checkpoint {
            world: self.clone(),
            elapsed_nanos,
        }
    }

    /// Goes back to a checkpoint of this map. Returns the sensors that were removed because their
    /// parent does not exist there.
    ///
    /// Counts of actors and of episodes never go back. The records are those of the checkpoint, so
    /// a snapshot can be sent at once.
    ///
    /// # Errors
    /// [`CheckpointError::OtherMap`], [`CheckpointError::ChangedMap`] or
    /// [`CheckpointError::NoRoom`]; the world is then as before.
    pub fn restore(&mut self, checkpoint: &Checkpoint) -> Result<Vec<ActorId>, CheckpointError> {
        let of = &checkpoint.world.map;
        if !Arc::ptr_eq(of, &self.map) {
            if of.name != self.map.name {
                return Err(CheckpointError::OtherMap {
                    of: of.name.clone(),
                    loaded: self.map.name.clone(),
                });
            }
            if map_hash(of) != map_hash(&self.map) {
                return Err(CheckpointError::ChangedMap(of.name.clone()));
            }
        }
        let mut merged = Merged::of(&checkpoint.world);
        let gone = merged.take_sensors(self);
        merged.actors.check().map_err(CheckpointError::NoRoom)?;
        self.become_copy(&checkpoint.world, merged);
        self.actors_changed();
        Ok(gone)
    }

    /// Takes everything that changes from a world of the same map; its memory is used again, and
    /// nothing is done that takes longer on a larger map. What follows from the map and the program
    /// stays, and so do settings such as the length of a sub-step.
    fn become_copy(&mut self, other: &World, merged: Merged) {
        let World {
            options,
            map,
            roads: _,
            physics,
            solids: _,
            lights,
            catalogue: _,
            actors: _,
            vehicles,
            walkers,
            props,
            records,
            booms: _,
            meshes: _,
            weather,
            trigger_boxes,
            posted: _,
            friction,
            collisions,
            counts,
            spectator,
            jumps,
            scenery,
        } = other;
        self.options = WorldOptions {
            physics_substep_secs: self.options.physics_substep_secs,
            ..*options
        };
        self.physics.clone_from(physics);
        let hidden = self.scenery.hidden_objects();
        if !Arc::ptr_eq(map, &self.map) || scenery.hidden_objects() != hidden {
            self.physics.show_only(&self.map, hidden);
        }
        let has_same_lights = self.lights.has_actors_of(lights);
        self.lights.clone_from(lights);
        if !has_same_lights {
            Arc::make_mut(&mut self.meshes).find_light_heads(&self.map, &self.lights);
        }
        self.actors = merged.actors;
        self.booms = merged.booms;
        self.vehicles.clone_from(vehicles);
        self.walkers.clone_from(walkers);
        self.props.clone_from(props);
        self.records.clone_from(records);
        self.weather = *weather;
        self.trigger_boxes.clone_from(trigger_boxes);
        self.friction.clone_from(friction);
        self.collisions.clone_from(collisions);
        self.counts = counts.after_restore(self.counts);
        self.spectator = *spectator;
        self.jumps.clone_from(jumps);
    }

    /// Takes over what a checkpoint does not contain: what follows from the map and the program,
    /// and settings such as the length of a sub-step.
    fn take_constants(&mut self, living: &World) {
        self.map = living.map.clone();
        self.roads = living.roads.clone();
        self.posted = living.posted.clone();
        self.catalogue = living.catalogue.clone();
        self.meshes = living.meshes.clone();
        self.options.physics_substep_secs = living.options.physics_substep_secs;
        self.scenery = living.scenery.clone();
        self.physics
            .show_only(&self.map, self.scenery.hidden_objects());
    }
}

/// The actors of a checkpoint with the sensors of the living world.
struct Merged {
    actors: Actors,
    booms: Booms,
}

impl Merged {
    fn of(world: &World) -> Merged {
        Merged {
            actors: world.actors.clone(),
            booms: world.booms.clone(),
        }
    }

    /// Replaces the sensors by those of `living`. Returns those without a place.
    fn take_sensors(&mut self, living: &World) -> Vec<ActorId> {
        let sensors = |actors: &Actors| -> BTreeSet<ActorId> {
            let all = actors.by_id.values();
            let sensors = all.filter(|actor| actor.kind == ActorKind::Sensor);
            sensors.map(|actor| actor.id).collect()
        };
        let alive = sensors(&living.actors);
        let lost = sensors(&self.actors)
            .into_iter()
            .filter(|id| !alive.contains(id));
        for id in lost {
            self.actors.remove(id);
            self.booms.by_id.remove(&id);
        }
        let mut gone = Vec::new();
        // Parents have smaller ids, so the parent of a sensor is already settled.
        for id in alive {
            let sensor = &living.actors.by_id[&id];
            let has_parent = sensor
                .parent
                .is_none_or(|parent| self.actors.contains(parent));
            match self.actors.by_id.get_mut(&id) {
                Some(own) if own.kind == ActorKind::Sensor => {
                    Arc::make_mut(own).topics = sensor.topics.clone();
                }
                None if has_parent => {
                    self.actors.add(Actor::clone(sensor));
                    self.booms
                        .by_id
                        .extend(living.booms.by_id.get(&id).map(|boom| (id, *boom)));
                }
                _ => gone.push(id),
            }
        }
        gone
    }
}

/// Checksum of everything but itself.
fn checksum(head: &[u8], body: &[u8]) -> u64 {
    mix(hash(head) ^ mix(hash(body)))
}

/// [`LAYOUT`] as a number.
fn layout() -> u64 {
    hash(LAYOUT.as_bytes())
}

/// Hash of everything in a map that influences the world's course.
fn map_hash(map: &MapData) -> u64 {
    let mut sum = hash(map.open_drive.as_bytes());
    let mut add = |bytes: &[u8]| sum = mix(sum ^ hash(bytes));
    add(bytemuck::cast_slice(&map.origin_m));
    add(bytemuck::cast_slice(&map.spawn_points));
    for mesh in &map.collision {
        add(bytemuck::cast_slice(&mesh.vertices_m));
        add(bytemuck::cast_slice(&mesh.triangles));
    }
    sum
}

/// A 64-bit checksum that changes with any flipped bit or moved word: two lanes of SplitMix64. It
/// is not cryptographic.
fn hash(bytes: &[u8]) -> u64 {
    let mut lanes = [0x243f_6a88_85a3_08d3u64, 0x1319_8a2e_0370_7344];
    for (idx, chunk) in bytes.chunks(8).enumerate() {
        let mut word = [0; 8];
        word[..chunk.len()].copy_from_slice(chunk);
        let lane = &mut lanes[idx % 2];
        *lane = mix(*lane ^ u64::from_le_bytes(word));
    }
    mix(mix(lanes[0] ^ bytes.len() as u64) ^ lanes[1])
}
