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

#[path = "roads/tunnel.rs"]
mod barrier;
#[path = "roads/bridge.rs"]
mod bridge;
#[path = "buildings/house.rs"]
mod building;
#[path = "network/lane_lines.rs"]
mod carriageway;
#[path = "scenery/chunk.rs"]
mod chunk;
#[path = "buildings/driveway.rs"]
mod drive;
#[path = "network/elevation.rs"]
mod elevation;
#[path = "buildings/entrance.rs"]
mod entrance;
#[path = "ground/fill.rs"]
mod fill;
#[path = "greenery/forest.rs"]
mod forest;
#[path = "meshes/signals.rs"]
mod furniture;
#[path = "roads/sign_bridge.rs"]
mod gantry;
#[path = "buildings/garden.rs"]
mod garden;
mod geometry;
#[path = "meshes/trees.rs"]
mod greenery;
#[path = "roads/surface.rs"]
mod ground;
#[path = "network/guide.rs"]
pub mod guide;
pub mod imported;
#[path = "network/kerb.rs"]
mod kerb;
#[path = "meshes/shared.rs"]
mod kit;
#[path = "meshes/leaves.rs"]
mod leaves;
#[path = "plan/motorways.rs"]
mod motorway;
#[path = "network/model.rs"]
mod network;
#[path = "scenery/object.rs"]
mod object;
#[path = "network/open_drive.rs"]
mod open_drive;
#[path = "plan/layout.rs"]
mod plan;
#[path = "greenery/planting.rs"]
mod planting;
#[path = "meshes/furniture.rs"]
mod props;
mod random;
#[path = "ground/ring.rs"]
mod ring;
#[path = "roadside/kerbside.rs"]
mod roadside;
#[path = "scenery/builder.rs"]
mod scenery;
#[path = "plan/small_towns.rs"]
mod sketch;
#[path = "network/spawn_points.rs"]
mod spawn;
mod town;
#[path = "roads/wear.rs"]
mod wear;

pub use object::{LampGroup, MapLayer, SceneryLamp, SceneryObject};
pub use town::{CollisionMesh, LightSite, Town, TownError};
