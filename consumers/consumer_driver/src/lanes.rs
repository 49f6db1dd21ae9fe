//! The lanes of a map as drivers use them, and who is on which lane.
//!
//! Modules in reading order: `network` (points, neighbours, junctions), [`path`] (the way ahead of
//! one vehicle), `route` (the lanes from one place to another), `strangers` (the lanes of vehicles
//! that this fleet does not drive), `table` (the vehicles before and behind a place).

pub(crate) mod network;
pub mod path;
pub(crate) mod route;
pub(crate) mod strangers;
pub(crate) mod table;
