//! What a benchmark says: the whole of `report.json`, of which terminal, page and comparison show
//! parts.
//!
//! In reading order: [`types`] and [`throughput`] (how they are made), [`metrics`] (what is better),
//! [`rows`] (the lines of the tables), [`terminal`], [`write`] (the folder of a report), [`schema`],
//! [`coco`], [`ros2`], [`bench`] (files for others' programs), [`page`] (HTML), [`compare`] and
//! [`show`] (subcommands). Numbers, plots, tables and pages are drawn by `consumer_report`.

pub mod bench;
pub mod coco;
pub mod compare;
pub mod metrics;
pub mod page;
pub mod ros2;
pub mod rows;
pub mod schema;
pub mod show;
pub mod terminal;
pub mod throughput;
pub mod types;
pub mod write;

pub use coco::CocoFiles;
pub use consumer_report::Spread;
pub use terminal::terminal;
pub use throughput::Throughput;
pub use types::{
    Counts, CurvePoint, Latency, Machine, ProcessUsage, REPORT_VERSION, Report, ResultEvent, Run,
    ScenarioInfo, ScenarioRun, Stratum, TaskScore, WorstFrame, suite_hash,
};
pub use write::{Files, Written, read, write_all};
