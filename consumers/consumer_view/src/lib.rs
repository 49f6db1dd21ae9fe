//! Shows a domain in rerun: what frames look like, where they stand in the tree of entities, how
//! the window is laid out, and the viewer process.
//!
//! The binary `gantry-view` is a thin shell around this library, so that tests can make images from
//! plain memory.
//!
//! Modules in reading order: [`session`] (a viewing from start to end), [`stage`] (one rerun
//! recording and what it contains), [`layout`] (entities and the window), [`images`] (frames as
//! pixels and points), `results` (results of
//! users' programs), [`pace`] (how often a topic is shown), [`viewer`] (the rerun process),
//! [`mod@convert`] (a recording as a file of rerun), [`mod@fly`] (the spectator in a window of our own).
//!
//! ```
//! use consumer_view::layout::Place;
//!
//! let place = Place::new("ego/front/rgb").expect("a topic of a sensor");
//! assert_eq!(place.frame_path(), "/world/ego/front/rgb");
//! ```

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod convert;
pub mod fly;
pub mod images;
pub mod layout;
pub mod pace;
mod results;
pub mod session;
pub mod stage;
pub mod viewer;
