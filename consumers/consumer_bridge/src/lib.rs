//! The bridge to other machines: topics of one machine appear on another under the same names and
//! with the same bytes, over zenoh.
//!
//! Modules in reading order: [`options`] (what is asked for), `keys` and [`announce`] (what bridges
//! say to each other), [`wire`] and [`coding`] (what a sample is on the link), `link` (zenoh's
//! session), `lookout` (what there is here), `export` and `outbox` (from the bus to the link),
//! `import` (from the link to the bus), `serve` (what other machines ask of the simulator here),
//! [`ros2`] (the same for nodes of ROS 2), `people` (and for Foxglove, behind a gate), [`clock`], [`counts`],
//! [`bridge`] (the whole).

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod announce;
pub mod bridge;
pub mod clock;
pub mod coding;
pub mod counts;
mod export;
mod import;
pub mod keys;
mod link;
mod lookout;
pub mod options;
mod outbox;
mod people;
mod program;
pub mod ros2;
mod serve;
pub mod wire;

pub use program::main;
