//! Results of users' programs.

pub(crate) mod draft;
pub(crate) mod reader;
pub(crate) mod service;
pub(crate) mod writer;
