//! Looking at others without taking part: topics as bytes, services and their ports, the newest
//! sample of every writer.

pub(crate) mod any_reader;
pub(crate) mod introspect;
pub(crate) mod slot;
pub(crate) mod watch;
