//! Where people walk: a mesh of convex faces over pavements, crosswalks and, at a higher cost for a
//! path, roads.
//!
//! Pavements keep [`CLEAR_M`] from kerb and wall, so that a body that follows the mesh stays on the
//! pavement. Around junctions, where maps seldom have pavement lanes, the pavements of neighbouring
//! arms are joined by a curve. Crosswalks reach over the kerb onto the pavement. The outlines go
//! into a constrained Delaunay triangulation, whose triangles take the ground of the outline they
//! lie in and are merged into convex faces.

mod arrange;
pub mod detour;
mod faces;
mod mesh;
mod outlines;
pub mod pavements;
pub mod stroll;

use crate::map::RoadMap;

pub use mesh::{Ground, WalkFace, WalkMesh};
pub use outlines::CLEAR_M;
pub use pavements::Pavements;

impl RoadMap {
    /// The walkable mesh; empty for a map without pavements. `with_roads` adds the carriageways
    /// beside pavements.
    pub fn walkable(&self, with_roads: bool) -> WalkMesh {
        let outlines = outlines::outlines(self, with_roads);
        faces::mesh(&outlines)
    }
}
