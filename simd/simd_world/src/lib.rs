//! The world: actors, vehicle physics, traffic lights, commands that change them, and what the
//! snapshot says about them.
//!
//! Knows no sensors and no bus: a sensor is a passive actor that rides on another one. Time comes
//! in as whole nanoseconds per step.
//! Everything is a function of (map, seed, commands, steps): nothing reads a clock and nothing
//! iterates over a hash map.
//!
//! ```text
//!   commands ─► World ─► step: drive train ─► wheels ─► rapier ─► lights ─► records ─► snapshot, scene
//! ```

#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod serde_forms;

mod errors;
mod map_data;
mod pose_check;

mod actors;
mod booms;
mod friction_areas;
mod physics;
mod props;
mod scenery;
mod signals;
mod vehicles;
mod walkers;
mod weather;

mod actor_scene;
mod catalogue;
mod map_actors;
mod obstacles;
mod records;
mod spawn;

mod world;

mod checkpoint;
mod commands;
mod reading;
mod scenario;

pub use catalogue::PASSIVE_SENSORS;
pub use checkpoint::{Checkpoint, CheckpointError};
pub use errors::{ActionError, ActorError, DestroyError, SpawnError};
pub use map_data::{CollisionMesh, LightHeads, LoadError, MapData};
pub use physics::Collision;
pub use props::{PropModel, prop_models};
pub use scenario::{EgoSpawn, Scenario};
pub use vehicles::{EngineSpec, VehicleModel, vehicle_models};
pub use walkers::{MAX_SPEED_MPS, WalkerModel, walker_models};
pub use world::{World, WorldOptions};
