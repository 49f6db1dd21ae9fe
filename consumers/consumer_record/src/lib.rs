//! Records a domain into MCAP files, reads recordings back, and recovers damaged ones.
//!
//! Frames, snapshots and documents become encoded messages, which wait in a bounded queue for the
//! writer thread. If the disk is too slow, frames are dropped and counted; in lockstep the
//! simulator waits instead. The binary `gantry-record` is a thin shell around this library, so that
//! every part is tested on plain memory.
//!
//! Modules in reading order: [`options`] and [`session`] (a recording from start to end),
//! [`discover`], [`frames`], [`results`] and [`snapshots`] (conversion to [`schema_recording::messages`]),
//! [`sink`], [`queue`], [`coder`], [`video`], [`writer`] and [`files`] (into the file), [`dump`] (a ring on
//! request); [`info`], [`cat`], [`edit`], [`recover`] and [`convert`]
//! (from the file).
//!
//! ```
//! use consumer_record::frames::{TopicName, frame_entries};
//! use schema_frames::{FrameHeader, Modality};
//!
//! let mut header = FrameHeader::new(Modality::Semantic);
//! header.set_image(4, 2);
//! let name = TopicName::new("ego/front/semantic").expect("a topic of a sensor");
//! let entries = frame_entries(&name, &header, &[7; 8], &mut |n| Vec::with_capacity(n));
//! // The lossless message, and the image that other programs show.
//! let topics: Vec<&str> = entries.iter().map(|entry| entry.topic.as_str()).collect();
//! assert_eq!(topics, ["/ego/front/semantic/gantry", "/ego/front/semantic"]);
//! ```

#![warn(missing_docs)]

pub mod amounts;
mod asker;
pub mod cat;
pub mod coder;
mod context;
pub mod convert;
mod copier;
pub mod discover;
mod documents;
pub mod dump;
pub mod edit;
pub mod files;
pub mod frames;
mod in_step;
pub mod info;
mod journal;
pub mod options;
mod previews;
mod program;
mod proto;
mod pull;
pub mod queue;
pub mod recover;
mod result_topics;
pub mod results;
pub mod ring;
mod scenery;
pub mod select;
pub mod session;
pub mod sink;
pub mod snapshots;
mod stages;
pub mod video;
pub mod writer;

pub use program::main;
