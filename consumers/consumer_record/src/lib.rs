//! Recording of a domain into MCAP: conversion, bounded queue, writer thread, reading back and
//! recovery.
//!
//! The binary `gantry-record` is a thin shell around this library, so that every part is tested on
//! plain memory.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod discover;
pub mod frames;
pub mod info;
pub mod messages;
pub mod options;
pub mod queue;
pub mod reader;
pub mod recover;
pub mod session;
pub mod sink;
pub mod snapshots;
pub mod wire;
pub mod writer;
