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

mod geometry;
mod random;

mod plan;

mod network;

mod scenery;

mod ground;

mod meshes;

mod roads;

mod buildings;

mod greenery;

mod roadside;

mod assembly;
pub mod imported;
mod town;

pub use network::guide;
pub use scenery::{CollisionMesh, LampGroup, LightSite, MapLayer, SceneryLamp, SceneryObject};
pub use town::{Town, TownError};
