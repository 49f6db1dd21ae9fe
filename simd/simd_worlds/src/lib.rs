//! Many worlds in one process, with tasks and rewards; no GPU and no bus. A member is a world with
//! its task; all members step side by side.
//!
//! A [`Course`] is a [`Task`] in its town, prepared once and shared by all members. [`Worlds`] holds
//! N of them: actions go in, and states, rewards, ends and figures come out as flat arrays, a row
//! per world. A world that goes back costs what its actors cost, whatever the size of the town.
//!
//! World k of N is, to the byte, the world that has its seed and actions alone: neighbours, forks,
//! resets and the number of threads change nothing.
//!
//! ```
//! use std::sync::Arc;
//!
//! use simd_worlds::{Autoreset, Course, Task, Worlds};
//!
//! let task = Task::built_in("LaneKeeping")?;
//! let course = Arc::new(Course::new(task, 1)?);
//! let mut worlds = Worlds::new(course, 4, 1, Autoreset::SameStep)?;
//! worlds.reset_all(7)?;
//! worlds.step(&[0.0, 0.5].repeat(4))?;
//! assert_eq!(worlds.outputs().reward.len(), 4);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Modules in reading order: `task` (what a task may say), `route` (the way ahead of a member),
//! `course` (what is prepared), `actors` (what moves beside the ego), `member` (one world) and
//! `worlds` (all of them).

#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod actors;
mod course;
mod error;
mod member;
mod route;
mod task;
mod worlds;

pub use course::Course;
pub use error::{CourseError, TaskError, WorldsError};
pub use member::{ACTION_NAMES, INFO_NAMES, STATE_NAMES};
pub use task::{EmergencyBrake, LaneKeeping, Rules, Solved, Start, Task};
pub use worlds::{Autoreset, MAX_WORLDS, Outputs, Worlds};
