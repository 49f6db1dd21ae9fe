//! The geometry pass: what a view sees is drawn once, into the targets that have readers.

mod attributes;
mod pass;
mod pipelines;
mod variant;

pub(crate) use pass::{GeometryPass, ViewPass};
pub(crate) use variant::{GeometryShader, Instances, SceneryLamps};
