//! What a town's scenery is collected in: objects, lamps, cells of meshes, solids, heights of the
//! ground.

mod builder;
mod chunk;
mod collision;
mod lamp;
mod object;
mod terrain;

pub use builder::{Builder, Scenery, Standing};
pub use chunk::{ALL, Chunks, Key, Layer, Levels, bound, place};
pub use collision::{CollisionMesh, Floor};
pub use lamp::{LampGroup, LightSite, SceneryLamp};
pub use object::{MapLayer, SceneryObject, measure};
pub use terrain::{Grid, Terrain};
