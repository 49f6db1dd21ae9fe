//! Copies of one submission out of textures and buffers to where readers are.

mod batch;
mod in_flight;
mod item;
mod place;
mod raw;
mod upload;

pub use batch::CopyBatch;
pub use in_flight::{CopyOutcome, InFlight, Mapped, PaddedRows};
pub use place::{Place, ShmPlace};
