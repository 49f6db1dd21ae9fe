//! Driving vehicles along lanes: paths, steering, pedals, right of way. No bus and no clock here.
//!
//! [`Fleet`] takes a [`Traffic`] per tick and answers with one control record per vehicle it
//! drives; the same traffic and seed give the same records.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod driver;
pub mod fleet;
pub mod path;
pub mod speed;
pub mod steer;
pub mod traffic;

pub use driver::Driver;
pub use fleet::Fleet;
pub use traffic::{Mover, Traffic};
