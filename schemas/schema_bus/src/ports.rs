//! What a process can open to send and receive: one module per kind of topic.

pub(crate) mod command;
pub(crate) mod complete;
pub(crate) mod control;
pub(crate) mod document;
pub(crate) mod drain;
pub(crate) mod frames;
pub(crate) mod gpu;
pub(crate) mod reader;
pub(crate) mod records;
pub(crate) mod render;
pub(crate) mod requests;
pub(crate) mod results;
pub(crate) mod scene;
pub(crate) mod snapshot;
pub(crate) mod writer;
