//! The program `gantry-export`: `live` (recordings of launch files that it runs first) and `program`
//! (from the command line to a finished set). What is written is `consumer_sets`'.

#![forbid(unsafe_code)]
// Numbers of files may be any: sums of them are checked, or cannot overflow.
#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]
#![warn(missing_docs)]

mod live;
mod program;

pub use program::main;
