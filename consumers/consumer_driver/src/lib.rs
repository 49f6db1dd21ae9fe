//! The pure driver: roads and what is seen go in, controls come out; no bus, no clock, no thread and
//! no file.
//!
//! [`Fleet`] takes the [`Traffic`] of a tick and answers with one control record per vehicle that
//! it drives. The same traffic and seed give the same records. Positions are in world space, metres;
//! path lengths and lane places are metres; angles are radians, positive to the left.
//!
//! Modules in reading order: [`traffic`] (what drivers see), [`plane`] (points, sides, distances),
//! [`lanes`] (the lanes of the map, the way ahead of one vehicle, who is on which lane), [`idm`] and
//! [`mobil`] (the models of following and of changing lanes), [`steer`] and [`speed`] (controllers),
//! [`driver`] (one driver), [`crossing`] (whose turn it is at junctions), `overtaking` (lane changes,
//! ways round what stands) with `detour` (whether one has time), `upkeep` (driving without physics,
//! respawn, removal), [`fleet`] (all drivers), [`crowd`] (people on foot), [`parameters`] (what may be
//! set).
//!
//! ```
//! use consumer_driver::speed;
//!
//! // At 14 m/s, 120 m before a line: no braking yet. 20 m before it: braking harder than 4 m/s².
//! assert!(speed::stop_before(14.0, 120.0) > 0.0);
//! assert!(speed::stop_before(14.0, 20.0) < -4.0);
//! ```

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod crossing;
pub mod crowd;
mod detour;
pub mod driver;
pub mod fleet;
pub mod idm;
pub mod lanes;
pub mod mobil;
mod overtaking;
pub mod parameters;
pub mod plane;
pub mod speed;
pub mod steer;
pub mod traffic;
mod upkeep;

pub use driver::{Blocker, Driver};
pub use fleet::{Fleet, Step};
pub use parameters::{Action, Parameters, RoadOption, Settings, SpeedRule, VehicleParameters};
pub use steer::Geometry;
pub use traffic::{Mover, Snapshot, Traffic};
