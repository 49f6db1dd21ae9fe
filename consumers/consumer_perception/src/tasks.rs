//! Tasks: what is true, what a result says, and how both are compared.
//!
//! A task is a [`Measure`]: it turns a result into an estimate, an estimate and the truth of a moment
//! into a part, and adds parts up. [`TaskRun`] does with it what all tasks have in common: results
//! against the frames that they answer, queries against the newest result, at every added delay, by
//! strata, scenario by scenario.

pub mod classes;
pub mod dense;
pub mod measure;
pub mod motion;
pub mod objects;
mod run;
pub mod spaces;
mod tally;

#[cfg(test)]
mod tests;

pub use measure::{
    AnyTask, Bad, Context, Drawn, Headline, Measure, Options, Plan, Reading, Scored, Spec,
    Unreadable, Worst,
};
pub use run::{MAX_CURVE_QUERIES, TaskRun};
pub use tally::Tally;
