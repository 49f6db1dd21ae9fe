//! Where a process spends its time: counters of stages that are always on, and how others read
//! them.
//!
//! A stage is a `static` with a name; a [`Span`] adds the processor time of its thread and the time
//! on the wall to it. Spans may lie in one another and on any thread: what an inner one took does
//! not count for the outer one, so stages add up. [`post`], called in a program's main loop, writes
//! the sums ten times a second into a file in memory that has no name in any folder: others find it
//! among the process's descriptors, and it is gone with the process, however that ends.
//! A span costs two reads of the thread's clock, about a microsecond.
//!
//! ```
//! use schema_stages::Stage;
//!
//! static PHYSICS: Stage = Stage::new("physics");
//!
//! for tick in 1..=3 {
//!     {
//!         let _span = PHYSICS.span();
//!         // … the work
//!     }
//!     schema_stages::post(tick);
//! }
//! assert_eq!(PHYSICS.sums().n_spans, 3);
//! ```
//!
//! [`read`] is the other end: what a process of some id has posted, and what the kernel says about
//! its threads.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod block;
pub mod read;
mod span;

pub use block::post;
pub use span::{Span, Stage, Sums};
