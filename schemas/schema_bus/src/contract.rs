//! What both ends of the bus must agree on: names, capacities, types and the sentences of errors.

pub(crate) mod error;
pub mod names;
pub(crate) mod origin;
pub mod qos;
pub(crate) mod wire;
