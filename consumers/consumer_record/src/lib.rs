//! Records a domain into MCAP files, reads recordings back, and recovers damaged ones.
//!
//! Frames, snapshots and documents become encoded messages, which wait in a bounded queue for the
//! writer thread. If the disk is too slow, frames are dropped and counted; in lockstep the
//! simulator waits instead. The binary `gantry-record` is a thin shell around this library, so that
//! every part is tested on plain memory.
//!
//! Modules in reading order: [`options`] and [`session`] (a recording from start to end), [`sink`],
//! [`queue`], [`coder`], [`video`], [`writer`] and [`files`] (into the file), [`dump`] (a ring on
//! request); [`info`], [`cat`], [`edit`], [`recover`] and [`convert`] (from the file). What a frame, a
//! result or a snapshot becomes is `consumer_forms::foxglove`.

// Numbers of files may be any: sums of them are checked, or cannot overflow.
#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]
#![warn(missing_docs)]

mod asker;
pub mod cat;
pub mod coder;
mod context;
pub mod convert;
mod copier;
mod documents;
pub mod dump;
pub mod edit;
pub mod files;
mod in_step;
pub mod info;
mod journal;
pub mod options;
mod program;
mod proto;
mod pull;
pub mod queue;
pub mod recover;
mod result_topics;
pub mod ring;
mod scenery;
pub mod select;
pub mod session;
pub mod sink;
mod stages;
pub mod video;
pub mod writer;

pub use program::main;
