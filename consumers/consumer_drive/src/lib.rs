//! The program `gantry-drive`: connects the pure driver of `consumer_driver` to a simulator.
//!
//! Modules in reading order: [`session`] (documents and snapshots in, controls out), [`desk`] (what
//! other programs may set), [`requests`] (how they ask), [`served`] (CARLA's Traffic Manager),
//! [`selection`] and [`share`] (which of several processes drives whom), `peers` (who else is at
//! work), `people` (who comes and goes on foot), `program` (the command line).

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod desk;
mod peers;
mod people;
mod program;
pub mod requests;
pub mod selection;
pub mod served;
pub mod session;
pub mod share;

pub use desk::Desk;
pub use program::main;
