//! The perception benchmark: runs anyone's programs through scenarios, and says how late and how
//! right they are, against exact truth.
//!
//! In reading order: [`capture`] (what a program did in one run), [`report`] (what is said about
//! all of them).

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod assemble;
pub mod capture;
pub mod cli;
pub mod coco_keep;
pub mod ignore;
pub mod latency;
pub mod moment;
pub mod picture;
pub mod queries;
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
