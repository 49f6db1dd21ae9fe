//! Recordings: the bytes of an MCAP file as Gantry writes it, for every program that writes or reads
//! one. `docs/how-to/recording.md` describes the same for people and other languages.
//!
//! Modules in reading order: [`messages`] (what a channel carries), [`mod@write`] (a file that
//! grows), [`read`] (whole samples of a file of any length), [`pattern`] (which topics), [`walk`] (records
//! one after another, whole or damaged), [`wire`] (protocol buffers by
//! hand), [`bag`] (files whose schemas are not ours), [`codec`] (payloads
//! that are stored smaller), [`journal`] (what acted on the world),
//! [`scenery`] (objects of the map).

#![forbid(unsafe_code)]
// Numbers of files may be any: sums of them are checked, or cannot overflow.
#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]
#![warn(missing_docs)]

pub mod bag;
#[allow(
    clippy::arithmetic_side_effects,
    reason = "the shape of a payload is checked once, before loops over every byte of it"
)]
pub mod codec;
pub mod journal;
pub mod messages;
pub mod pattern;
pub mod read;
pub mod scenery;
pub mod walk;
pub mod wire;
pub mod write;
