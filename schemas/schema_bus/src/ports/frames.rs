//! Sensor frames.

pub(crate) mod pages;
pub(crate) mod reader;
pub(crate) mod writer;
