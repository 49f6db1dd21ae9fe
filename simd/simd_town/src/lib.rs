//! Towns: a street network as OpenDRIVE text, and the scenery that belongs to it.
//!
//! A town is a function of its name and a seed: the same pair gives the same bytes. There is no
//! GPU, no physics and no I/O here. Besides the generated towns, [`imported`] makes a world for any
//! OpenDRIVE map; the scenery of the large towns is made in that way too.
//!
//! The modules in the order of building; each uses only those above it:
//!
//! | Module | What it holds |
//! |---|---|
//! | `geometry`, `random` | points, headings, paths of lines and arcs; seeded random streams |
//! | `plan` | streets of each town as nodes and edges with cross-sections |
//! | `network` | roads, junctions, connecting lanes, signals; OpenDRIVE text, spawn points |
//! | `scenery` | what builders fill: objects, lamps, cells of meshes, solids, terrain heights |
//! | `ground` | blocks between the roads, their pavements, ponds, hills |
//! | `meshes` | meshes that are placed many times: trees, lamps, signals, furniture, parked cars |
//! | `roads` | asphalt, paint, wear, bridges, tunnels, guard rails, sign bridges |
//! | `buildings` | lots, houses, entrances, gardens, driveways |
//! | `greenery` | street trees, parks, hedges, distant woods |
//! | `roadside` | street lamps, furniture, power lines, signals, parked cars beside the roads |
//! | `assembly`, `town` | all of it in order; [`Town`] |
//! | [`imported`] | a world from the lanes of any map |
//! | `generate` | [`Town::generate`] by name |
//!
//! ```
//! let town = simd_town::Town::generate("Town02", 1)?;
//! assert!(town.open_drive.contains("<OpenDRIVE>"));
//! assert!(town.spawn_points.len() > 50);
//! assert!(town.objects.iter().any(|object| object.name.starts_with("street_lamp")));
//! # Ok::<(), simd_town::TownError>(())
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
mod town;

pub mod imported;

mod generate;

pub use network::guide;
pub use scenery::{CollisionMesh, LampGroup, LightSite, MapLayer, SceneryLamp, SceneryObject};
pub use town::{Town, TownError};
