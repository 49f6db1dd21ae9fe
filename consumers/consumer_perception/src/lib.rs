//! The perception benchmark: runs anyone's programs through scenarios, and says how late and how
//! right they are, against exact truth.
//!
//! In reading order: [`capture`] (what a program did in one run), [`report`] (what is said about
//! all of them).

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod capture;
pub mod report;
