//! Gantry in rerun: what frames look like, where they hang in the tree, how the window is laid out,
//! and the viewer process.
//!
//! The binary `gantry-view` is a thin shell around this library, so that pictures can be made from
//! plain memory.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod images;
pub mod layout;
pub mod pace;
pub mod session;
pub mod stage;
pub mod viewer;
