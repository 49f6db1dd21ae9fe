//! The parts of a report, for every program that measures: numbers and words, distributions of
//! times, intervals, tables on a terminal, plots, pages of HTML, and the folder they are written to.
//!
//! In reading order: [`numbers`] and [`words`] (how a value and a text are written), [`times`] and
//! [`spread`] (distributions), [`hgrm`] (their files), [`interval`] (quantiles and the bootstrap),
//! [`terminal`] (tables of text), [`plot`] (SVG), [`page`] (HTML), [`folder`] (files).
//!
//! The crate knows nothing of what is measured: which tables a report has, and what they mean, stands
//! in the program that makes it.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod folder;
pub mod hgrm;
pub mod interval;
pub mod numbers;
pub mod page;
pub mod plot;
pub mod spread;
pub mod terminal;
pub mod times;
pub mod words;

pub use folder::{Folder, FolderError};
pub use spread::Spread;
pub use times::{HistogramError, Summary, Times};
