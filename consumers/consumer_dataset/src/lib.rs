//! Makes data sets: runs every scenario of a recipe (a matrix of maps, weathers, times of day, rigs
//! and seeds), records it in lockstep, exports all recordings in the recipe's formats, and writes a
//! page that sums up what is in the set.
//!
//! In reading order: [`recipe`] (what is asked), [`matrix`] (its scenarios), [`launch`] (a
//! scenario's launch file), [`estimate`] (what it will cost), [`state`] (the folder, and how far it
//! is), [`take`] (one scenario from its start to its recording), [`statistics`] (what a recording
//! shows), [`exports`], [`make`] (everything together), [`digest`] (hashes of all files), [`page`]
//! (the summary).
//!
//! Every scenario has a domain, a prefix in shared memory and processes of its own, so several run
//! beside one another, and one that dies is begun anew without the others noticing.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod digest;
pub mod estimate;
pub mod exports;
pub mod launch;
pub mod make;
pub mod matrix;
pub mod page;
mod program;
pub mod recipe;
pub mod state;
pub mod statistics;
pub mod take;

pub use program::main;
