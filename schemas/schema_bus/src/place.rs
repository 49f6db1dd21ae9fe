//! A process's place on the bus: its node, the services that it opens there, wake-ups, and which
//! processes the others are.

pub(crate) mod complaints;
pub(crate) mod declared;
pub(crate) mod event;
pub(crate) mod gpu_socket;
pub(crate) mod iceoryx_error;
pub(crate) mod node;
pub(crate) mod origins;
pub(crate) mod service;
pub(crate) mod topics;
