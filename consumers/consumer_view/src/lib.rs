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
//! [`mod@rerun`] (its SDK),
//! [`rrd_file`] (a file that is written as data comes), [`screenshot`] (a picture of the window),
//! [`mod@convert`] (a recording as a file of rerun). The spectator in a window of our own is
//! `consumer_fly`'s.
//!
//! Below [`stage`]: [`look`] (what users choose), `pictures` (images, coded as chosen), `ids` and
//! `surface` (what images of ids and lists of events are made into), `senses` (sensors that make no
//! images), `traffic` (lights, trails, states), `geo` (places on Earth); below [`layout`]:
//! `blueprint` (how rerun is told of it).
//!
//! ```
//! use consumer_view::layout::Place;
//!
//! let place = Place::new("ego/front/rgb").expect("a topic of a sensor");
//! assert_eq!(place.frame_path(), "/world/ego/front/rgb");
//! ```

#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod blueprint;
pub mod convert;
mod geo;
mod ids;
pub mod images;
pub mod layout;
pub mod look;
pub mod pace;
mod pictures;
mod program;
pub mod rerun;
mod results;
pub mod rrd_file;
pub mod screenshot;
mod senses;
pub mod session;
pub mod stage;
mod surface;
mod traffic;
pub mod viewer;

pub use program::main;
