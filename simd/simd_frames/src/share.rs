//! What a process that owns a world and processes that render for it tell each other: scenes, still
//! scenery, lists of cameras, and who renders what. `schema_frames::scene` and `SPEC.md` have the
//! bytes; nothing here sends any.
//!
//! Every number arrives as it was, to the bit, because the bytes of a frame must not depend on who
//! renders it.

mod bytes;
mod cameras;
mod divide;
mod exact;
mod message;
mod question;
mod scenery;

pub use cameras::{Camera, CameraList};
pub use divide::{Group, divide};
pub use message::{SentScene, scene_of};
pub use question::{AnswerError, Joined, Question, accepted, answer_of, refused};
pub use scenery::{Scenery, SceneryCopy, SceneryList};
