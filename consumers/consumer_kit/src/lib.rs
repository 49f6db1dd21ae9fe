//! What every consumer needs: it finds topics and waits for them, survives restarts of the daemon,
//! takes frames and counts lost ones, pairs a frame with the snapshot of its tick, publishes and
//! reads results, and takes part in lockstep.
//!
//! A consumer is a loop around [`Follower::wait`], which never waits longer than [`MAX_WAIT`], so
//! that the loop sees a shutdown flag in time. Nothing here renders, stores or drives.
//!
//! Modules in reading order: `follower` (several topics at once), `domain` (all topics of a
//! domain), `ports` (what both stand on), `followed` (one topic of any kind), `topic` (of frames),
//! `wake` (events), `publish` (results of a program's own), `result` (those of others), [`items`]
//! (what is in them), `reader` (frames or results), `snapshots` (the world of a frame's tick),
//! `document` (texts such as the list of actors), `calibrations` (what pixels show), `lockstep`, `steps` (every tick in lockstep),
//! `program` (the base of a program that answers frames), `run_files`.
//!
//! ```no_run
//! use consumer_kit::{Follower, Take};
//! let mut follower = Follower::open("gantry", "my-consumer")?;
//! let camera = follower.follow("ego/front/rgb", Take::Newest);
//! loop {
//!     follower.wait(consumer_kit::MAX_WAIT)?;
//!     while let Some(frame) = follower.take(camera)? {
//!         let world = follower.world_at(frame.header().tick)?;
//!         let n_actors = world.map_or(0, |world| world.records.len());
//!         println!("{} bytes, {n_actors} actors", frame.len());
//!     }
//! }
//! # #[allow(unreachable_code)]
//! # Ok::<(), schema_bus::BusError>(())
//! ```

#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod calibrations;
mod document;
mod domain;
mod followed;
mod follower;
pub mod items;
mod lockstep;
mod ports;
mod program;
mod publish;
mod reader;
mod result;
mod run_files;
mod snapshots;
mod steps;
mod topic;
mod wake;

pub use calibrations::Calibrations;
pub use document::FollowedDocument;
pub use domain::{Change, Domain, LEAVE_AFTER, ListedTopic, Listing, Rhythm, Wish, is_left_over};
pub use followed::{Take, TopicReport};
pub use follower::Follower;
pub use lockstep::{Lockstep, LockstepError};
pub use ports::{MAX_WAIT, TopicId};
pub use program::{Frames, InputId, Program, ProgramError, ResultId};
pub use publish::{ListLoan, PublishError, Publisher};
pub use reader::{Sample, SampleReader};
pub use result::FollowedResult;
pub use run_files::file_of_run;
pub use schema_bus::names::default_domain;
pub use snapshots::{FollowedSnapshots, KEPT_SNAPSHOTS, SnapshotTrail, WorldAt};
pub use steps::{Ready, Steps};
pub use topic::FollowedTopic;
pub use wake::{WakeUps, event_of};
// A consumer elsewhere depends on this crate only.
pub use {schema_bus, schema_frames, schema_types};
