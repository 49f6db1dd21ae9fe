//! The ground between the roads: blocks with their pavements, ponds, heights.

mod fill;
mod heights;
mod ring;
mod surface;

pub use fill::{Border, Fill};
pub use heights::terrain;
pub use ring::{ABUTMENT_M, Ring, rings};
pub use surface::{block, pavement, pond};
