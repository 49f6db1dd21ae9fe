//! Bounding-volume hierarchies over triangles and over moving instances. Nothing here knows a scene
//! or a ray.

mod moving_tree;
mod packed;
mod tree;
mod triangle_tree;

pub(crate) use moving_tree::{Bounds, moving_tree};
pub(crate) use packed::{FIRST_CHILD, NODE_WORDS, Packed, empty_node};
pub(crate) use tree::{LEAF, Node, Tree, WIDTH};
pub(crate) use triangle_tree::{Block, MARGIN, NO_TRIANGLE, TriangleTree};
