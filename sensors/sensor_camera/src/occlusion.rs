//! What large walls hide: instances of which no pixel can be seen are not drawn at all.
//!
//! A software rasteriser spends most of a street's time on what stands behind its houses. Large
//! flat polygons of the static scenery, nearest first, are drawn into blocks of 8 × 8 pixels of
//! which each knows how far its farthest point is; a box that lies behind all blocks it may touch
//! is hidden. Images stay the same: blocks count only when each of their pixels is covered, boxes
//! are widened by more than a rasteriser may round, and depths are compared with a margin.

mod blocks;
mod occluder;

pub(crate) use blocks::Blocks;
pub(crate) use occluder::{Occluder, occluders_of};
