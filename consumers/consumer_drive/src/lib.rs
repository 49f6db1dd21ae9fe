//! Drives vehicles along lanes: paths, steering, pedals, right of way. Nothing here knows the bus
//! or reads a clock.
//!
//! [`Fleet`] takes the [`Traffic`] of a tick and answers with one control record per vehicle that
//! it drives. The same traffic and seed give the same records.
//!
//! Modules in reading order: [`traffic`] (what drivers see), `network` (the lanes of the map),
//! [`plane`] (points, sides, distances), [`path`] (the way ahead of one vehicle), [`steer`] and [`speed`] (its controllers), [`driver`]
//! (one driver), [`crossing`] (whose turn it is at junctions), `overtaking` (lane changes, ways
//! round what stands), `upkeep` (driving without physics, respawn, removal), [`fleet`] (all
//! drivers), [`share`] (which of several processes drives whom), [`crowd`] (people on foot),
//! [`parameters`] (what may be set).
//!
//! ```
//! use consumer_drive::speed;
//!
//! // At 14 m/s, 120 m before a line: no braking yet. 20 m before it: braking harder than 4 m/s².
//! assert!(speed::stop_before(14.0, 120.0) > 0.0);
//! assert!(speed::stop_before(14.0, 20.0) < -4.0);
//! ```

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod crossing;
pub mod crowd;
pub mod desk;
pub mod driver;
pub mod fleet;
mod lanes;
mod network;
mod overtaking;
pub mod parameters;
pub mod path;
mod peers;
mod people;
pub mod plane;
mod program;
pub mod requests;
mod route;
pub mod selection;
pub mod served;
pub mod session;
pub mod share;
pub mod speed;
pub mod steer;
mod strangers;
pub mod traffic;
mod upkeep;

pub use desk::Desk;
pub use driver::Driver;
pub use fleet::{Fleet, Step};
pub use parameters::{Action, Parameters, RoadOption, Settings, SpeedRule, VehicleParameters};
pub use program::main;
pub use steer::Geometry;
pub use traffic::{Mover, Traffic};
