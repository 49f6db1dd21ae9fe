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
mod plan;
mod planting;
mod props;
mod random;
mod ring;
mod roadside;
mod scenery;
mod sketch;
mod spawn;
mod town;
mod wear;

pub use object::{LampGroup, MapLayer, SceneryLamp, SceneryObject};
pub use town::{CollisionMesh, LightSite, Town, TownError};
