//! Renders generated towns without a daemon: what the rendering benchmark, the gallery and their
//! tests share.

#![warn(missing_docs)]

pub mod exact;
pub mod measure;
pub mod oracle;
pub mod peer;
pub mod separate;
pub mod sheet;
mod shot;
pub mod stage;
pub mod tiles;
pub mod weathers;

pub use measure::{Cameras, Figures};
pub use shot::shot;
pub use stage::Stage;
