//! Where people walk: a mesh of convex faces over pavements, crosswalks and, at a price, roads.
//!
//! Pavements keep [`CLEAR_M`] from kerb and wall, so that whoever follows the mesh with a body
//! stays on them. Around junctions, where maps seldom have pavement lanes, the pavements of
//! neighbouring arms are joined by a curve. Crosswalks reach over the kerb onto the pavement. The
//! outlines go into a constrained Delaunay triangulation, whose triangles are named by what they
//! lie in and merged to convex faces.

mod arrange;
mod faces;
mod mesh;
mod outlines;

use crate::map::RoadMap;

pub use mesh::{Ground, WalkFace, WalkMesh};
pub use outlines::CLEAR_M;

impl RoadMap {
    /// The walkable mesh; empty for a map without pavements. `with_roads` adds the carriageways
    /// beside pavements.
    pub fn walkable(&self, with_roads: bool) -> WalkMesh {
        let outlines = outlines::outlines(self, with_roads);
        faces::mesh(&outlines)
    }
}
