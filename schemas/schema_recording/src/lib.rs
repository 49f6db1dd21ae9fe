//! Recordings: the bytes of an MCAP file as Gantry writes it, for every program that writes or reads
//! one. `docs/recording.md` describes the same for people and other languages.
//!
//! Modules in reading order: [`messages`] (what a channel carries), [`mod@write`] (a file that
//! grows), [`walk`] (its records one after another, whole or damaged), [`wire`] (protocol buffers by
//! hand), [`bag`] (files whose schemas are not ours).

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod bag;
pub mod messages;
pub mod walk;
pub mod wire;
pub mod write;
