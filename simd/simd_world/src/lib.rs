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

#[path = "vehicles/ackermann.rs"]
mod ackermann;
#[path = "vehicles/body_actions.rs"]
mod actions;
#[path = "booms.rs"]
mod boom;
mod catalogue;
mod checkpoint;
#[path = "commands.rs"]
mod command;
#[path = "vehicles/doors.rs"]
mod doors;
#[path = "vehicles/powertrain.rs"]
mod drive;
#[path = "vehicles/footing.rs"]
mod footing;
#[path = "friction_areas.rs"]
mod friction;
#[path = "signals/traffic_lights.rs"]
mod lights;
#[path = "map_data.rs"]
mod map;
#[path = "vehicles/model.rs"]
mod models;
#[path = "vehicles/sub_step.rs"]
mod motion;
#[path = "vehicles/factory_data.rs"]
mod physical;
mod physics;
#[path = "serde_forms.rs"]
mod plain;
#[path = "props/model.rs"]
mod props;
mod records;
mod scenario;
#[path = "actor_scene.rs"]
mod scene;
mod scenery;
#[path = "signals/trigger_boxes.rs"]
mod signs;
#[path = "physics/solids.rs"]
mod solids;
#[path = "vehicles/wheel_solver.rs"]
mod solver;
mod spawn;
#[path = "vehicles/vehicle.rs"]
mod vehicle;
#[path = "walkers/walker.rs"]
mod walkers;
mod weather;
#[path = "vehicles/wheel.rs"]
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
