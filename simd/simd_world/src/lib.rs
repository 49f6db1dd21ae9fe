//! The simulated world: actors, their physics, traffic lights, weather, and the commands that
//! change them.
//!
//! The world is a function of (map, seed, commands, steps): nothing reads a clock, nothing iterates
//! over a hash map, and the number of threads changes no bit. Time comes in as whole nanoseconds
//! per step. The world knows no sensors and no bus: a sensor is an actor that is attached to its
//! carrier and has a pose; the daemon turns the world into scenes and snapshots.
//!
//! Each subsystem owns its state and its step and is given what it needs of the others. [`World`]
//! keeps them and says in which order they take a step:
//!
//! ```text
//! commands ─► World::step ─► vehicles plan ─► engine ─► vehicles meet walkers   (per sub-step)
//!                        ─► walkers ─► traffic lights ─► records ─► snapshot, scene
//! ```
//!
//! ```
//! use std::collections::BTreeMap;
//!
//! use schema_frames::{Command, VehicleControl};
//! use schema_types::Pose;
//! use simd_world::{MapData, World, WorldOptions};
//!
//! let mut world = World::new(WorldOptions::default());
//! world.load(&MapData::flat(500.0))?;
//! let place = Pose::from_xyz_yaw(0.0, 0.0, 0.1, 0.0);
//! let car = world.spawn("vehicle.tesla.model3", place, None, "hero", &BTreeMap::new())?;
//! let control = VehicleControl {
//!     throttle_ratio: 1.0,
//!     ..Default::default()
//! };
//! world.apply(&Command::ControlVehicle { actor_id: car.0, control });
//! for _ in 0..100 {
//!     world.step(50_000_000);
//! }
//! let record = world.record(car).expect("it was spawned above");
//! assert!(record.world_from_actor.translation_m[0] > 10.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Reading order: `world` (the parts and their order), then one subsystem (`vehicles`, `walkers`,
//! `props`, `signals`, `weather`, `scenery`, `booms`), then `records` and `actor_scene` for what
//! comes out, `spawn` for what goes in, and `commands` and `checkpoint` for what is done with it.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

// The parts and their order; what is done with a world.
mod checkpoint;
mod commands;
mod reading;
mod scenario;
mod world;

// Subsystems.
mod booms;
mod friction_areas;
mod jumps;
mod physics;
mod props;
mod pushes;
mod scenery;
mod signals;
mod vehicles;
mod walkers;
mod weather;

// Across subsystems: what goes in and what comes out.
mod actor_scene;
mod catalogue;
mod map_actors;
mod obstacles;
mod records;
mod spawn;

// What all of them use.
mod actors;
mod errors;
mod map_data;
mod pose_check;
mod serde_forms;

pub use catalogue::PASSIVE_SENSORS;
pub use checkpoint::{Checkpoint, CheckpointError, MAX_EPISODE_NANOS};
pub use errors::{
    ActionError, ActorError, DestroyError, NoRoom, OutOfRange, PhysicsError, SpawnError,
};
pub use map_data::{CollisionMesh, LightHeads, LoadError, MapData};
pub use physics::Collision;
pub use props::{PropModel, prop_models};
pub use scenario::{EgoSpawn, Scenario};
pub use scenery::SceneryRevisions;
pub use vehicles::{EngineSpec, VehicleModel, vehicle_models};
pub use walkers::{MAX_SPEED_MPS, WalkerModel, walker_models};
pub use world::{World, WorldOptions};
