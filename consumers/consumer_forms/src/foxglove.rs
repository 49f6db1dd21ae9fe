//! Frames, results, snapshots and documents as the messages of recordings: always one that keeps
//! every byte, and beside it what Foxglove shows.
//!
//! [`frames`] is for sensors, [`previews`] for small pictures of what is kept coded, [`results`] for
//! users' programs, [`snapshots`] for the world.
//!
//! ```
//! use consumer_forms::foxglove::frames::{TopicName, frame_entries};
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

pub mod frames;
pub mod previews;
pub mod results;
pub mod snapshots;
