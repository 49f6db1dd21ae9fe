//! Tasks: what is true, what a result says, and how both are compared.
//!
//! A task is a [`Measure`]: it turns a result into an estimate, an estimate and the truth of a moment
//! into a part, and adds parts up. [`TaskRun`] does with it what all tasks have in common: results
//! against the frames that they answer, queries against the newest result, at every added delay, by
//! strata, scenario by scenario.

pub mod boxes2d;
pub mod boxes3d;
pub mod classes;
pub mod depth;
pub mod detect;
pub mod driving;
pub mod event_flow;
pub mod flow;
pub mod lanes;
pub mod lidar_semantic;
pub mod masks;
pub mod measure;
pub mod odometry;
pub mod pixels;
mod run;
pub mod semantic;
pub mod spaces;
pub mod stereo;
pub mod tracking;

#[cfg(test)]
mod tests;

pub use measure::{
    AnyTask, Bad, Context, Drawn, Headline, Measure, Options, Plan, Reading, Scored, Spec, Worst,
};
pub use run::{MAX_CURVE_QUERIES, TaskRun};
