//! Reading any topic as a consumer does, and counting what comes.

pub mod meter;
pub mod source;
