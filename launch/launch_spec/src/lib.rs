//! Launch files: what is simulated and which processes run.
//!
//! A launch file is TOML. It computes nothing, its keys carry their units, and unknown keys are
//! refused. All errors are reported together, each with its file and place. The crate turns texts
//! into a checked [`Launch`] and back into a text with every default; except for
//! [`FileText::read`], which callers hand to [`Launch::load`], it reads no file, and no clock.
//!
//! In reading order: [`model`] (what a launch file says), [`process`] and [`period`] (its
//! processes), [`topic`] (limits and types of topics), [`batch`] (cameras whose images come as one
//! frame), [`presets`] (weathers by name), `files` (several files as one), [`profiles`] (sensors as
//! they are sold), `parse`
//! (checking, one file per section), `tree` and `fill` (keys with their places, and how they are
//! applied to a value), [`error`], `write`, and [`budget`] (the topics that the sensors will have).
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

pub mod batch;
pub mod budget;
pub mod error;
mod files;
mod fill;
pub mod model;
mod parse;
pub mod period;
pub mod presets;
pub mod process;
pub mod profiles;
pub mod topic;
mod tree;
mod write;

pub use batch::Batch;
pub use budget::TopicBudget;
pub use error::{LaunchError, LaunchErrors};
pub use files::{FileText, ReadFile};
pub use model::{Ego, FreePose, Launch, LidarsOn, PlacedSensor, Rig, Scenario, Sensor, Spectator};
pub use period::{BadPeriod, Period};
pub use process::{
    Process, READY_WITHIN, Ready, ReadyWhen, Restart, RestartPolicy, Stop, StopSignal,
};
pub use profiles::Profile;
pub use topic::{Topic, TopicLimits};
