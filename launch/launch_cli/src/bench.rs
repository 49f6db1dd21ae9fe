//! Results of a benchmark as JSON, in the form that `gantry-bench report` reads.
//!
//! A benchmark takes `--json FILE` out of its arguments, collects a named row per figure that it
//! prints, and writes the file at its end:
//!
//! ```
//! use launch_cli::bench::{BenchResult, take_json_argument};
//! let (words, json) = take_json_argument(["six".to_owned(), "frames=60".to_owned()]);
//! assert_eq!((words.len(), json), (2, None));
//! let mut result = BenchResult::new("example", None);
//! result.row("rgb", &[("p50_ms", 1.5), ("n_draws", 600.0)]);
//! result.write(None).expect("nothing was asked for");
//! ```

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use serde::Serialize;
use serde_json::{Map, Value};

use crate::machine::Machine;

/// What one run of a benchmark found.
#[derive(Debug, Serialize)]
pub struct BenchResult {
    bench: String,
    machine: MachineWithGpu,
    rows: Vec<Map<String, Value>>,
}

#[derive(Debug, Serialize)]
struct MachineWithGpu {
    #[serde(flatten)]
    machine: Machine,
    #[serde(skip_serializing_if = "Option::is_none")]
    gpu: Option<String>,
}

impl BenchResult {
    /// Reads the machine now; `gpu` is the adapter if the benchmark uses one.
    pub fn new(bench: &str, gpu: Option<&str>) -> Self {
        BenchResult {
            bench: bench.to_owned(),
            machine: MachineWithGpu {
                machine: Machine::read(),
                gpu: gpu.map(str::to_owned),
            },
            rows: Vec::new(),
        }
    }

    /// Adds a row; units stand at the end of the figures' names. Whole numbers are written as such.
    pub fn row(&mut self, name: &str, figures: &[(&str, f64)]) {
        let mut row = Map::new();
        row.insert("name".to_owned(), Value::from(name));
        for (key, figure) in figures {
            let is_whole = figure.fract() == 0.0 && figure.abs() < 1e15;
            let value = if is_whole {
                Value::from(*figure as i64)
            } else {
                Value::from(*figure)
            };
            row.insert((*key).to_owned(), value);
        }
        self.rows.push(row);
    }

    /// Writes the result if a file was asked for.
    pub fn write(&self, file: Option<&Path>) -> anyhow::Result<()> {
        let Some(file) = file else { return Ok(()) };
        let text = serde_json::to_string_pretty(self).context("cannot write the result as JSON")?;
        std::fs::write(file, text + "\n")
            .with_context(|| format!("cannot write the result to {}", file.display()))
    }
}

/// Arguments without `--json FILE`, and that file.
pub fn take_json_argument(
    words: impl IntoIterator<Item = String>,
) -> (Vec<String>, Option<PathBuf>) {
    let (mut rest, mut file) = (Vec::new(), None);
    let mut words = words.into_iter();
    while let Some(word) = words.next() {
        match word.strip_prefix("--json") {
            Some("") => file = words.next().map(PathBuf::from),
            Some(path) if path.starts_with('=') => file = Some(PathBuf::from(&path[1..])),
            _ => rest.push(word),
        }
    }
    (rest, file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_is_taken_out_of_the_arguments() {
        let words = |text: &str| text.split(' ').map(str::to_owned).collect::<Vec<_>>();
        let file = Some(PathBuf::from("a.json"));
        assert_eq!(
            take_json_argument(words("six --json a.json rgb")),
            (words("six rgb"), file.clone())
        );
        assert_eq!(
            take_json_argument(words("six --json=a.json")),
            (words("six"), file)
        );
        assert_eq!(take_json_argument(words("six")), (words("six"), None));
    }

    #[test]
    fn a_result_names_its_machine_and_its_rows() {
        let mut result = BenchResult::new("some_bench", Some("some GPU"));
        result.row("rgb", &[("p50_ms", 1.25), ("n_draws", 600.0)]);
        let value = serde_json::to_value(&result).expect("it is plain data");
        assert_eq!(value["bench"], "some_bench");
        assert_eq!(value["machine"]["gpu"], "some GPU");
        assert!(value["machine"]["n_cores"].as_u64() >= Some(1));
        assert_eq!(value["rows"][0]["n_draws"], 600);
        assert_eq!(value["rows"][0]["p50_ms"], 1.25);
    }
}
