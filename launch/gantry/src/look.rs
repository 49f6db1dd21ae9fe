//! Looks at the bus: what is published, by which processes, how often, and what is in it.
//!
//! Modules in reading order: [`census`] (topics and the processes at both ends), [`reading`] (any
//! topic, read as a consumer does), and the words `gantry` [`topic`], [`top`] and [`graph`].

mod census;
pub mod graph;
mod reading;
pub mod top;
pub mod topic;
