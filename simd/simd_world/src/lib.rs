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

mod ackermann;
mod actions;
mod boom;
mod catalogue;
mod checkpoint;
mod command;
mod doors;
mod drive;
mod footing;
mod friction;
mod lights;
mod map;
mod models;
mod motion;
mod physical;
mod physics;
mod plain;
mod props;
mod records;
mod scenario;
mod scene;
mod scenery;
mod signs;
mod solids;
mod solver;
mod spawn;
mod vehicle;
mod walkers;
mod weather;
mod wheel;
mod world;

pub use catalogue::PASSIVE_SENSORS;
pub use checkpoint::{Checkpoint, CheckpointError};
pub use drive::{DriveInput, DriveOutput, DriveTrain, EngineSpec};
pub use map::{CollisionMesh, LightHeads, LoadError, MapData};
pub use models::{VehicleModel, vehicle_models};
pub use physics::Collision;
pub use props::{PropModel, prop_models};
pub use scenario::{EgoSpawn, Scenario};
pub use spawn::{DestroyError, SpawnError};
pub use walkers::{MAX_SPEED_MPS, WalkerModel, walker_models};
pub use world::{ActorError, World, WorldOptions};
