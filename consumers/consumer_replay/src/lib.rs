//! Replay: publishes a recording into the services of a domain, as the simulator did.
//!
//! Every consumer works on it as on a live simulator: frames with their own ticks and times, the
//! snapshots and documents of the world, and results of users' programs. What would change the world
//! is refused, because a recording only goes on, stands still, or is somewhere else.
//!
//! Modules in reading order: [`options`] (what is asked for), `plan` (what the file has and what it
//! needs), `ports` (the services), `feed` (the file as
//! things to publish), `foreign` (files of other programs),
//! `tape` (ticks in
//! their slots), `pace` (when one is due), `session` (its state), `playback` (the loop), `world` (what is said about the world),
//! `commands` (what is asked of it), `keys` (the terminal).

#![forbid(unsafe_code)]
// Numbers of files may be any: sums of them are checked, or cannot overflow.
#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]
#![warn(missing_docs)]

mod commands;
mod feed;
mod foreign;
mod keys;
pub mod options;
mod pace;
mod plan;
mod playback;
mod ports;
mod program;
mod session;
mod tape;
mod world;

pub use playback::replay;
pub use program::main;
pub use session::Report;
