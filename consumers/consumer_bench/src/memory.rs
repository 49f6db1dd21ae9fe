//! `gantry-bench memory`: resident memory of processes over time, and whether it grows.
//!
//! `RssAnon` is memory of the process alone; `RssShmem` is the part of shared memory that it has
//! touched, which counts for every process that maps it. Growth is the slope of a straight line
//! through the second half of the samples, when start-up is over.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use launch_cli::values::some_span;
use launch_cli::{Exit, Machine, Shutdown, bench};
use serde::Serialize;

use crate::output;

#[derive(Debug, clap::Args)]
pub struct MemoryArgs {
    /// Processes to watch
    #[arg(long, value_name = "PID,…", value_delimiter = ',', required = true)]
    pids: Vec<u32>,

    /// How long
    #[arg(long = "for", value_name = "TIME", default_value = "60s", value_parser = some_span)]
    length: Duration,

    /// Time between two looks
    #[arg(long, value_name = "TIME", default_value = "1s", value_parser = some_span)]
    every: Duration,

    /// Write all samples as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// The memory of a process at one time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct Sample {
    secs: f64,
    rss_kib: u64,
    anon_kib: u64,
    shmem_kib: u64,
}

/// One process.
#[derive(Debug, Serialize)]
struct Watched {
    pid: u32,
    name: String,
    /// Whether it was there until the end.
    lived: bool,
    /// Growth of `RssAnon` in the second half, KiB per minute.
    anon_growth_kib_per_min: f64,
    samples: Vec<Sample>,
}

#[derive(Debug, Serialize)]
struct Report {
    machine: Machine,
    processes: Vec<Watched>,
}

/// Watches until the time is over, all processes have ended, or the user stops it. A process that
/// ended meanwhile makes the exit code 1.
pub fn run(args: &MemoryArgs) -> anyhow::Result<Exit> {
    let (machine, shutdown) = (Machine::read(), Shutdown::install()?);
    let mut processes: Vec<Watched> = args.pids.iter().map(|pid| Watched::new(*pid)).collect();
    let started = Instant::now();
    loop {
        let at = started.elapsed();
        processes
            .iter_mut()
            .filter(|process| process.lived)
            .for_each(|process| process.look(at));
        let next = at + args.every;
        if next > args.length || processes.iter().all(|process| !process.lived) {
            break;
        }
        if shutdown.wait(next.saturating_sub(started.elapsed())) {
            break;
        }
    }
    processes
        .iter_mut()
        .for_each(|process| process.anon_growth_kib_per_min = growth_kib_per_min(&process.samples));
    let all_lived = processes.iter().all(|process| process.lived);
    let report = Report { machine, processes };
    print!("{}\n{}", report.machine.heading(), text(&report.processes));
    bench::write_json(args.json.as_deref(), &report)?;
    Ok(if all_lived { Exit::Done } else { Exit::Failed })
}

impl Watched {
    fn new(pid: u32) -> Self {
        let name = std::fs::read_to_string(format!("/proc/{pid}/comm"))
            .unwrap_or_default()
            .trim()
            .to_owned();
        Watched {
            pid,
            name,
            lived: true,
            anon_growth_kib_per_min: 0.0,
            samples: Vec::new(),
        }
    }

    fn look(&mut self, at: Duration) {
        let status =
            std::fs::read_to_string(format!("/proc/{}/status", self.pid)).unwrap_or_default();
        match sample(&status, at.as_secs_f64()) {
            Some(sample) => self.samples.push(sample),
            None => self.lived = false,
        }
    }
}

/// The memory lines of `/proc/PID/status`; `None` for a process that is gone or a zombie.
fn sample(status: &str, secs: f64) -> Option<Sample> {
    let kib = |key: &str| {
        let line = status
            .lines()
            .find_map(|line| line.strip_prefix(key)?.strip_prefix(':'))?;
        line.trim().strip_suffix(" kB")?.parse().ok()
    };
    Some(Sample {
        secs,
        rss_kib: kib("VmRSS")?,
        anon_kib: kib("RssAnon")?,
        shmem_kib: kib("RssShmem")?,
    })
}

/// Slope of the least-squares line through `RssAnon` of the second half.
fn growth_kib_per_min(samples: &[Sample]) -> f64 {
    let half = &samples[samples.len() / 2..];
    let n = half.len() as f64;
    let mean = |of: fn(&Sample) -> f64| half.iter().map(of).sum::<f64>() / n;
    let (mean_secs, mean_kib) = (mean(|s| s.secs), mean(|s| s.anon_kib as f64));
    let spread: f64 = half.iter().map(|s| (s.secs - mean_secs).powi(2)).sum();
    let together: f64 = half
        .iter()
        .map(|s| (s.secs - mean_secs) * (s.anon_kib as f64 - mean_kib))
        .sum();
    if spread > 0.0 {
        together / spread * 60.0
    } else {
        0.0
    }
}

fn text(processes: &[Watched]) -> String {
    let mib = |kib: u64| format!("{:.1}", kib as f64 / 1024.0);
    let row = |process: &Watched| {
        let (first, last) = (process.samples.first(), process.samples.last());
        let cell = |sample: Option<&Sample>, of: fn(&Sample) -> u64| {
            sample.map_or("-".into(), |sample| mib(of(sample)))
        };
        vec![
            format!(
                "{} {}{}",
                process.pid,
                process.name,
                if process.lived { "" } else { " (ended)" }
            ),
            cell(first, |s| s.rss_kib),
            cell(last, |s| s.rss_kib),
            process
                .samples
                .iter()
                .map(|s| s.rss_kib)
                .max()
                .map_or("-".into(), mib),
            cell(first, |s| s.anon_kib),
            cell(last, |s| s.anon_kib),
            cell(last, |s| s.shmem_kib),
            format!("{:+.0}", process.anon_growth_kib_per_min),
            process.samples.len().to_string(),
        ]
    };
    let heads = [
        "process (MiB)",
        "rss first",
        "rss last",
        "rss max",
        "own first",
        "own last",
        "shared",
        "own KiB/min",
        "looks",
    ];
    output::table(&heads, &processes.iter().map(row).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(secs: f64, anon_kib: u64) -> Sample {
        Sample {
            secs,
            rss_kib: anon_kib,
            anon_kib,
            shmem_kib: 0,
        }
    }

    #[test]
    fn this_process_has_memory_and_a_missing_one_has_none() {
        let mut own = Watched::new(std::process::id());
        own.look(Duration::ZERO);
        assert!(own.lived && own.samples[0].rss_kib > 100);
        let mut nobody = Watched::new(u32::MAX);
        nobody.look(Duration::ZERO);
        assert!(!nobody.lived && text(&[nobody]).contains("ended"));
    }

    #[test]
    fn start_up_does_not_count_as_growth_and_a_leak_does() {
        let settled: Vec<_> = (0..100)
            .map(|i| at(i as f64, 1000 + (i * 100).min(3000)))
            .collect();
        assert_eq!(growth_kib_per_min(&settled), 0.0);
        let leaking: Vec<_> = (0..100).map(|i| at(i as f64, 1000 + 2 * i)).collect();
        assert!((growth_kib_per_min(&leaking) - 120.0).abs() < 1e-6);
        assert_eq!(growth_kib_per_min(&[at(0.0, 5)]), 0.0);
    }
}
