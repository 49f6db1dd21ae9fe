//! Generated towns: a street network written as OpenDRIVE, the scenery that belongs to it, and
//! vehicle bodies.
//!
//! Everything is a function of (name, seed): the same pair gives the same bytes. No GPU, no
//! physics, no I/O.
//!
//! ```text
//!   plan (nodes, streets) ─► network (roads, junctions, lanes, signals) ─► OpenDRIVE text, spawn points
//!                                     └─► ground, buildings, greenery, furniture ─► meshes, collision
//! ```

#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod barrier;
mod bridge;
mod building;
mod carriageway;
mod chunk;
mod drive;
mod elevation;
mod entrance;
mod fill;
mod forest;
mod furniture;
mod gantry;
mod garden;
mod geometry;
mod greenery;
mod ground;
pub mod guide;
pub mod imported;
mod kerb;
mod kit;
mod leaves;
mod motorway;
mod network;
mod object;
mod open_drive;
pub mod person;
mod plan;
mod planting;
pub mod prop;
mod props;
mod random;
mod ring;
mod roadside;
mod scenery;
mod sketch;
mod spawn;
mod town;
pub mod vehicle;
mod wear;

pub use object::{LampGroup, MapLayer, SceneryLamp, SceneryObject};
pub use person::{PersonMeshes, PersonShape, person_meshes};
pub use town::{CollisionMesh, LightSite, Town, TownError};
pub use vehicle::door::{Door, DoorMeshes, DoorMotion, door_meshes, outfitted_door_meshes};
pub use vehicle::outfit::Outfit;
pub use vehicle::{
    BodyStyle, VehicleMeshes, VehicleShape, WheelSite, outfitted_meshes, vehicle_meshes,
};
