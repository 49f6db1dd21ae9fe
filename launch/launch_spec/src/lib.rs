//! Launch files: what is simulated and which processes run.
//!
//! A launch file is TOML. It computes nothing, its keys carry their units, and unknown keys are
//! refused. All errors of a file are reported together, each with its place. The crate reads no file
//! and no clock: it turns text into a checked [`Launch`] and back into text with every default.
//!
//! In reading order: [`model`] (what a launch file says), [`process`] and [`period`] (its
//! processes), `parse` (reading and checking, one file per section), `tree` and `fill` (keys with
//! their places, and how they are applied to a value), [`error`], `write`, and [`budget`] (the
//! topics that the sensors will have).
//!
//! ```
//! use launch_spec::Launch;
//!
//! let launch = Launch::parse("version = 1\n[scenario]\nseed = 7\n", "small.toml").unwrap();
//! assert_eq!((launch.scenario.seed, launch.scenario.tick_hz), (7, 20.0));
//! assert_eq!(Launch::parse(&launch.to_toml_with_defaults(), "full.toml"), Ok(launch));
//!
//! let text = "version = 1\n[sensor.roof]\nkind = \"lidar\"\nchanels = 8\n";
//! assert_eq!(
//!     Launch::parse(text, "town.toml").unwrap_err().to_string(),
//!     "unknown key \"chanels\" in [sensor.roof], did you mean \"channels\"? at town.toml:4:1"
//! );
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
