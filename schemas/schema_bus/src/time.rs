//! Time in a domain: the clock of stamps, who may publish a world's ticks, and what must have
//! happened before the next one.

pub(crate) mod claim;
pub(crate) mod clock;
pub(crate) mod gate;
