//! Turns recordings into training sets: images, clouds, events, calibrations and labels in the
//! trees that the formats' own tools open.
//!
//! In reading order: [`options`] (what is asked), [`manifest`] (how far an export is), [`tree`] (the
//! folder that grows, whole files only), [`classes`] (CARLA's classes in each format's words),
//! [`exporter`] (what a format is), [`formats`] (one module per format), [`run`] (everything
//! together). What is true about a tick is `consumer_truth`'s. A format is an
//! [`exporter::Exporter`]; it is handed whole ticks, one after the other, and never a whole
//! recording. The program is `gantry-export`, in `consumer_export`.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod classes;
pub mod exporter;
pub mod formats;
pub mod manifest;
pub mod options;
pub mod picture;
pub mod run;
pub mod tree;
