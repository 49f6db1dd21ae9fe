//! Launch files: what is simulated and which processes run, read from TOML, checked, and written
//! back with every default.
//!
//! A launch file computes nothing. Units are in its keys, unknown keys are refused, and all errors
//! of a file are reported together,
//! each with its place: `unknown key "chanels" in [sensor.roof], did you mean "channels"? at
//! launch/town.toml:14:1`.
//! This crate reads no file and no clock: text in, values out.
//!
//! ```
//! let launch = launch_spec::Launch::parse("version = 1\n[scenario]\nseed = 7\n", "small.toml").unwrap();
//! assert_eq!((launch.scenario.seed, launch.scenario.tick_hz), (7, 20.0));
//! ```

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod budget;
pub mod error;
mod fill;
pub mod model;
mod parse;
pub mod period;
pub mod process;
mod tree;
mod write;

pub use budget::TopicBudget;
pub use error::{LaunchError, LaunchErrors};
pub use model::{Ego, FreePose, Launch, LidarsOn, PlacedSensor, Rig, Scenario, Sensor};
pub use period::Period;
pub use process::{Process, Ready, ReadyWhen, Restart, RestartPolicy, Stop, StopSignal};
