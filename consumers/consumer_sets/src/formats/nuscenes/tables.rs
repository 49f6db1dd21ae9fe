//! nuScenes' tables: rows that a scenario adds, kept as lines until the end joins them.

use std::collections::BTreeMap;
use std::io::Write as _;

use anyhow::Context as _;
use nalgebra::Isometry3;
use serde_json::{Value, json};

use crate::options::hash;
use crate::tree::{PartFile, Tree};

/// Tables whose rows come from scenarios.
pub const TABLES: [&str; 9] = [
    "log",
    "calibrated_sensor",
    "sample",
    "sample_data",
    "ego_pose",
    "sample_annotation",
    "instance",
    "scene",
    "lidarseg",
];

/// A token: 32 hexadecimal digits that follow from what is named.
pub fn token(words: &[&str]) -> String {
    let text = words.join("\u{1f}");
    format!("{:016x}{:016x}", hash(1, &text), hash(2, &text))
}

/// Translation and rotation (w, x, y, z) of a pose.
pub fn pose_json(pose: &Isometry3<f64>) -> (Value, Value) {
    let at = pose.translation.vector;
    let turn = pose.rotation.quaternion();
    (
        json!([at.x, at.y, at.z]),
        json!([turn.w, turn.i, turn.j, turn.k]),
    )
}

/// The rows of a scenario.
pub struct Tables(BTreeMap<&'static str, PartFile>);

fn state(table: &str, scenario: usize) -> String {
    Tree::state(&format!("{scenario:04}_{table}.jsonl"))
}

impl Tables {
    /// Empty tables of a scenario.
    ///
    /// # Errors
    /// A sentence if the disk refuses.
    pub fn begin(scenario: usize, tree: &Tree) -> anyhow::Result<Tables> {
        let files = TABLES.map(|table| Ok((table, tree.begin(&state(table, scenario))?)));
        files.into_iter().collect::<anyhow::Result<_>>().map(Tables)
    }

    /// Adds a row.
    ///
    /// # Errors
    /// A sentence if the disk refuses.
    pub fn write(&mut self, table: &str, row: &Value) -> anyhow::Result<()> {
        let file = self.0.get_mut(table).expect("tables are named in the list");
        writeln!(file, "{row}").with_context(|| format!("cannot write the table {table}"))
    }

    /// All rows are there.
    ///
    /// # Errors
    /// A sentence if the disk refuses.
    pub fn finish(self) -> anyhow::Result<()> {
        self.0.into_values().try_for_each(PartFile::finish)
    }
}

/// Joins the rows of all scenarios into one JSON list.
///
/// # Errors
/// A sentence if the disk refuses.
pub fn join(table: &str, n_scenarios: usize, path: &str, tree: &Tree) -> anyhow::Result<()> {
    let mut file = tree.begin(path)?;
    let cannot = || format!("cannot write {}", tree.path(path).display());
    file.write_all(b"[").with_context(cannot)?;
    let mut first = true;
    for scenario in 0..n_scenarios {
        tree.each_line(&state(table, scenario), &mut |line| {
            let comma = if std::mem::take(&mut first) { "" } else { "," };
            write!(file, "{comma}\n{line}").with_context(cannot)
        })?;
    }
    file.write_all(b"\n]\n").with_context(cannot)?;
    file.finish()
}

/// A row of sample_data before its sample and its successor are known.
#[derive(Clone, Debug)]
pub struct Record {
    /// Its token.
    pub token: String,
    /// Its sample; of a sweep the next one.
    pub sample: Option<String>,
    /// Token of the one before it.
    pub prev: String,
    /// Token of the one behind it; `None` while it is not known.
    pub next: Option<String>,
    /// The other fields.
    pub row: Value,
}

/// Rows of sample_data that wait for their sample or successor: those since the last keyframe, and
/// the last one of each channel.
#[derive(Debug, Default)]
pub struct Sweeps(BTreeMap<String, Vec<Record>>);

impl Sweeps {
    /// Adds the next row of a channel.
    pub fn push(&mut self, channel: &str, mut record: Record) {
        let records = self.0.entry(channel.to_string()).or_default();
        if let Some(last) = records.last_mut() {
            last.next = Some(record.token.clone());
            record.prev = last.token.clone();
        }
        records.push(record);
    }

    /// Rows without a sample belong to this one.
    pub fn assign(&mut self, sample: &str) {
        for record in self.0.values_mut().flatten() {
            record.sample.get_or_insert_with(|| sample.to_string());
        }
    }

    /// Writes the rows of which everything is known.
    ///
    /// # Errors
    /// A sentence if the disk refuses.
    pub fn flush(&mut self, tables: &mut Tables) -> anyhow::Result<()> {
        for records in self.0.values_mut() {
            let is_ready = |record: &Record| record.sample.is_some() && record.next.is_some();
            let n_ready = records.iter().take_while(|record| is_ready(record)).count();
            for record in records.drain(..n_ready) {
                write_record(record, tables)?;
            }
        }
        Ok(())
    }

    /// Writes the rest; nothing comes behind.
    ///
    /// # Errors
    /// A sentence if the disk refuses.
    pub fn finish(&mut self, tables: &mut Tables) -> anyhow::Result<()> {
        for records in std::mem::take(&mut self.0).into_values() {
            for record in records {
                write_record(record, tables)?;
            }
        }
        Ok(())
    }
}

fn write_record(record: Record, tables: &mut Tables) -> anyhow::Result<()> {
    let mut row = record.row;
    row["sample_token"] = json!(record.sample.unwrap_or_default());
    row["prev"] = json!(record.prev);
    row["next"] = json!(record.next.unwrap_or_default());
    tables.write("sample_data", &row)
}
