//! The harness of all benchmarks: arguments, processor time, repeated measurements, and results as
//! JSON in the form that `gantry-bench report` reads.
//!
//! A benchmark is a program whose arguments clap reads; every one of them takes `--json FILE` too. It
//! adds a named row per figure that it prints, and the file is written at its end:
//!
//! ```
//! use launch_cli::bench::{self, Samples, clap};
//!
//! /// Measures an example.
//! #[derive(clap::Args)]
//! struct Args {
//!     /// Turns
//!     #[arg(default_value_t = 3)]
//!     turns: usize,
//! }
//!
//! fn main() -> std::process::ExitCode {
//!     bench::run("example", |args: &Args, result| {
//!         let millis = Samples::of(args.turns, || 1.5);
//!         result.row("rgb", &[("best_ms", millis.best()), ("median_ms", millis.median())]);
//!         Ok(())
//!     })
//! }
//! ```

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;
use nix::time::{ClockId, clock_gettime};
use serde::Serialize;
use serde_json::{Map, Value};

use crate::exit::{Exit, run_main};
use crate::machine::Machine;

/// For a benchmark's arguments and errors: its crate need not name them.
pub use {anyhow, clap};

/// Arguments of one benchmark, and those of all of them.
#[derive(Debug, clap::Parser)]
struct Words<A: clap::Args> {
    #[command(flatten)]
    own: A,
    /// Write the result as JSON too
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// A benchmark without arguments of its own.
#[derive(Debug, clap::Args)]
pub struct NoArgs {}

/// The program of a benchmark: reads its arguments, measures, and writes the result if a file was
/// asked for.
pub fn run<A: clap::Args>(
    name: &str,
    measure: impl FnOnce(&A, &mut BenchResult) -> anyhow::Result<()>,
) -> ExitCode {
    run_main(|| {
        let words = <Words<A> as clap::Parser>::parse();
        let mut result = BenchResult::new(name, words.json);
        measure(&words.own, &mut result)?;
        result.write()?;
        Ok(Exit::Done)
    })
}

/// The result of one run of a benchmark.
#[derive(Debug, Serialize)]
pub struct BenchResult {
    bench: String,
    machine: MachineWithGpu,
    rows: Vec<Map<String, Value>>,
    #[serde(skip)]
    file: Option<PathBuf>,
}

#[derive(Debug, Serialize)]
struct MachineWithGpu {
    #[serde(flatten)]
    machine: Machine,
    #[serde(skip_serializing_if = "Option::is_none")]
    gpu: Option<String>,
}

impl BenchResult {
    /// Reads the machine now; the result goes into `file`.
    pub fn new(bench: &str, file: Option<PathBuf>) -> Self {
        BenchResult {
            bench: bench.to_owned(),
            machine: MachineWithGpu {
                machine: Machine::read(),
                gpu: None,
            },
            rows: Vec::new(),
            file,
        }
    }

    /// Names the adapter that the benchmark uses.
    pub fn set_gpu(&mut self, name: &str) {
        self.machine.gpu = Some(name.to_owned());
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

    /// Takes all rows away, for a benchmark that writes its figures again and again.
    pub fn clear(&mut self) {
        self.rows.clear();
    }

    /// Writes the rows so far if a file was asked for; a benchmark that can be broken off calls this
    /// before its end.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn write(&self) -> anyhow::Result<()> {
        write_json(self.file.as_deref(), self)
    }
}

/// Writes the report of a benchmark as JSON if a file was asked for.
///
/// # Errors
///
/// The file cannot be written.
pub fn write_json(file: Option<&Path>, report: &impl Serialize) -> anyhow::Result<()> {
    let Some(file) = file else { return Ok(()) };
    let text = serde_json::to_string_pretty(report).context("cannot write the report as JSON")?;
    std::fs::write(file, text + "\n")
        .with_context(|| format!("cannot write the report to {}", file.display()))
}

/// The same work measured several times, in order of size.
#[derive(Clone, Debug)]
pub struct Samples(Vec<f64>);

impl Samples {
    /// Measures `turns` times, once at least.
    pub fn of(turns: usize, measure: impl FnMut() -> f64) -> Samples {
        std::iter::repeat_with(measure).take(turns.max(1)).collect()
    }

    /// The smallest.
    pub fn best(&self) -> f64 {
        self.at(0.0)
    }

    /// The middle one; of an even number the upper of the two.
    pub fn median(&self) -> f64 {
        self.0.get(self.0.len() / 2).copied().unwrap_or(f64::NAN)
    }

    /// The one below which this share of the others lies.
    pub fn at(&self, share: f64) -> f64 {
        let place = (self.0.len().saturating_sub(1) as f64 * share) as usize;
        self.0.get(place).copied().unwrap_or(f64::NAN)
    }
}

impl FromIterator<f64> for Samples {
    fn from_iter<I: IntoIterator<Item = f64>>(values: I) -> Self {
        let mut values: Vec<f64> = values.into_iter().collect();
        values.sort_by(f64::total_cmp);
        Samples(values)
    }
}

/// Processor time of this process so far, all threads, seconds: it does not count what neighbours
/// take.
pub fn process_cpu_secs() -> f64 {
    cpu_secs(ClockId::CLOCK_PROCESS_CPUTIME_ID)
}

/// Processor time of this thread so far, seconds.
pub fn thread_cpu_secs() -> f64 {
    cpu_secs(ClockId::CLOCK_THREAD_CPUTIME_ID)
}

fn cpu_secs(clock: ClockId) -> f64 {
    let time = clock_gettime(clock).expect("Linux has clocks of processes and threads");
    time.tv_sec() as f64 + time.tv_nsec() as f64 * 1e-9
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, clap::Args)]
    struct Args {
        rows: Vec<String>,
    }

    fn read(words: &str) -> (Vec<String>, Option<PathBuf>) {
        let words = ["bench"].into_iter().chain(words.split(' '));
        let read = <Words<Args> as clap::Parser>::try_parse_from(words).expect("they are right");
        (read.own.rows, read.json)
    }

    #[test]
    fn every_benchmark_takes_a_file() {
        let file = Some(PathBuf::from("a.json"));
        let six = vec!["six".to_owned()];
        assert_eq!(read("six --json a.json"), (six.clone(), file.clone()));
        assert_eq!(read("--json=a.json six"), (six.clone(), file));
        assert_eq!(read("six"), (six, None));
    }

    #[test]
    fn a_result_names_its_machine_and_its_rows() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("a.json");
        let mut result = BenchResult::new("some_bench", Some(file.clone()));
        result.set_gpu("some GPU");
        result.row("old", &[]);
        result.clear();
        result.row("rgb", &[("p50_ms", 1.25), ("n_draws", 600.0)]);
        result.write().expect("the folder is there");
        let text = std::fs::read_to_string(&file).expect("it was written");
        let value: Value = serde_json::from_str(&text).expect("it is JSON");
        assert_eq!(value["bench"], "some_bench");
        assert_eq!(value["machine"]["gpu"], "some GPU");
        assert!(value["machine"]["n_cores"].as_u64() >= Some(1));
        assert_eq!(value["rows"][0]["n_draws"], 600);
        assert_eq!(value["rows"][0]["p50_ms"], 1.25);
    }

    #[test]
    fn samples_have_a_best_and_a_middle() {
        let mut next = [4.0, 1.0, 3.0, 2.0].into_iter();
        let samples = Samples::of(4, || next.next().unwrap_or_default());
        assert_eq!((samples.best(), samples.median()), (1.0, 3.0));
        assert_eq!((samples.at(0.5), samples.at(1.0)), (2.0, 4.0));
        let began = (process_cpu_secs(), thread_cpu_secs());
        assert!(process_cpu_secs() >= began.0 && thread_cpu_secs() >= began.1);
    }
}
