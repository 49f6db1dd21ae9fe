//! The perception benchmark: runs anyone's programs through scenarios, and says how late and how
//! right they are, against exact truth.
//!
//! In reading order: [`suite`] and [`scenario`] (what is shown and asked), [`truth_pass`] (a
//! recording of it with the exact truth), [`up`] (processes of launch files), [`run`] (a program in one mode and
//! scenario), [`capture`] (what it did), [`score`] with [`tasks`], [`evidence`] and [`picture`] (how
//! right and how late that was), [`report`] (what is said about all of them), [`cli`] (from the
//! command line to the report, and a report's frames made again), [`reaction`] (live trials).

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod capture;
pub mod cli;
pub mod evidence;
pub mod picture;
pub mod reaction;
pub mod report;
pub mod run;
pub mod scenario;
pub mod score;
pub mod suite;
mod suite_check;
pub mod tasks;
pub mod truth_pass;
pub mod up;

pub use report::{compare, show};
