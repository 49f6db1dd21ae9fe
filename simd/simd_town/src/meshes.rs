//! Meshes that stand in many places of a town: trees, lamps, signals, furniture, parked cars.

pub mod furniture;
mod leaves;
mod parked_cars;
pub mod power_line;
mod shared;
pub mod signals;
pub mod street_lamps;
pub mod trees;

pub use shared::{Lamp, SharedMeshes};
