//! `gantry-bench tick`: what a tick of the running simulator costs the processors, process by
//! process and, with `--profile`, stage by stage.
//!
//! It reads no topic, so it adds nothing to a tick: stages are counted by the processes themselves
//! all the time, the rest is the kernel's.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use launch_cli::values::some_span;
use launch_cli::{Exit, Machine, Shutdown, bench};
use schema_bus::names::WORLD_SNAPSHOT;
use schema_bus::{Bus, ServicePorts, Watch};
use schema_stages::read::{Look, Process};
use serde::Serialize;

use crate::output;

/// Time between two looks at the newest snapshot.
const GLANCE: Duration = Duration::from_millis(10);

#[derive(Debug, clap::Args)]
pub struct TickArgs {
    /// How long
    #[arg(long = "for", value_name = "TIME", default_value = "10s", value_parser = some_span)]
    length: Duration,

    /// The stages of each process, too
    #[arg(long)]
    profile: bool,

    /// Write the tables as JSON too, always with stages
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// A stage of a process.
#[derive(Debug, Serialize)]
struct StageRow {
    stage: String,
    /// Processor time of a tick, milliseconds.
    cpu_ms: f64,
    /// Time on the wall of a tick, milliseconds; 0 of what no span measured.
    wall_ms: f64,
    /// Spans in a tick.
    spans: f64,
}

/// A process.
#[derive(Debug, Serialize)]
struct ProcessRow {
    pid: u32,
    name: String,
    /// Processor time of a tick, milliseconds, of all its threads.
    cpu_ms: f64,
    /// Its stages, the most expensive first.
    stages: Vec<StageRow>,
}

#[derive(Debug, Serialize)]
struct Report {
    bench: &'static str,
    machine: Machine,
    domain: String,
    secs: f64,
    n_ticks: u64,
    simulated_secs: f64,
    ticks_per_sec: f64,
    /// Processor time of a tick, milliseconds, of all processes.
    cpu_ms: f64,
    processes: Vec<ProcessRow>,
}

/// Looks twice and prints what lies between.
pub fn run(args: &TickArgs, domain: &str) -> anyhow::Result<Exit> {
    let (machine, shutdown) = (Machine::read(), Shutdown::install()?);
    let bus = Bus::open(domain, "gantry-bench")?;
    let mut watch = bus.watch();
    let first = Census::take(&bus, &mut BTreeMap::new())?;
    let mut processes = first.processes;
    let begin = loop {
        if let Some(clock) = Clock::read(&bus, &mut watch)? {
            break clock;
        }
        anyhow::ensure!(
            !shutdown.wait(GLANCE) && first.at.elapsed() < Duration::from_secs(2),
            "no simulator has sent a snapshot on domain {domain:?}; start one with `gantry up`"
        );
    };
    let before: BTreeMap<u32, Look> = looks(&mut processes);
    let began = Instant::now();
    while began.elapsed() < args.length && !shutdown.wait(GLANCE) {}
    let last = Census::take(&bus, &mut processes)?;
    let end = Clock::read(&bus, &mut watch)?.unwrap_or(begin);
    let mut processes = last.processes;
    let after = looks(&mut processes);
    let secs = began.elapsed().as_secs_f64();
    let n_ticks = end.tick.saturating_sub(begin.tick);
    anyhow::ensure!(
        n_ticks > 0,
        "the world stood still for {secs:.1} s, so there is no tick to divide by; let it run, or measure longer with --for"
    );
    let row = |(pid, look): (&u32, &Look)| {
        let took = look.since(before.get(pid).unwrap_or(&Look::default()));
        ProcessRow::new(*pid, last.names[pid].clone(), &took, n_ticks)
    };
    let mut rows: Vec<ProcessRow> = after.iter().map(row).collect();
    rows.sort_by(|a, b| b.cpu_ms.total_cmp(&a.cpu_ms));
    let report = Report {
        bench: "tick",
        machine,
        domain: domain.to_owned(),
        secs,
        n_ticks,
        simulated_secs: end.sim_nanos.saturating_sub(begin.sim_nanos) as f64 / 1e9,
        ticks_per_sec: n_ticks as f64 / secs,
        cpu_ms: rows.iter().map(|row| row.cpu_ms).sum(),
        processes: rows,
    };
    print!(
        "{}\n{}",
        report.machine.heading(),
        text(&report, args.profile)
    );
    bench::write_json(args.json.as_deref(), &report)?;
    Ok(Exit::Done)
}

/// The simulator's clock.
#[derive(Clone, Copy, Debug)]
struct Clock {
    tick: u64,
    sim_nanos: u64,
}

impl Clock {
    /// What the newest snapshot says; `None` before the first one.
    fn read(bus: &Bus, watch: &mut Watch) -> anyhow::Result<Option<Clock>> {
        let services = bus.services()?;
        let services: Vec<ServicePorts> = services
            .into_iter()
            .filter(|service| service.name == WORLD_SNAPSHOT)
            .collect();
        watch.follow(&services);
        let writers = services.iter().flat_map(|service| &service.writers);
        let newest = writers.filter_map(|port| watch.newest(port.id));
        let newest = newest.max_by_key(|sample| sample.published_mono_nanos);
        Ok(newest.and_then(|sample| {
            Some(Clock {
                tick: sample.tick,
                sim_nanos: sample.sim_nanos?,
            })
        }))
    }
}

/// The processes on a domain.
struct Census {
    at: Instant,
    names: BTreeMap<u32, String>,
    processes: BTreeMap<u32, Process>,
}

impl Census {
    /// Who has a port on the domain, except this process; those of `known` are kept.
    fn take(bus: &Bus, known: &mut BTreeMap<u32, Process>) -> anyhow::Result<Census> {
        let mut names = BTreeMap::new();
        for service in bus.services()? {
            for port in service.writers.into_iter().chain(service.readers) {
                if let Some(pid) = port.pid.filter(|pid| *pid != std::process::id()) {
                    names.insert(pid, port.program);
                }
            }
        }
        let process = |pid: &u32| {
            (
                *pid,
                known.remove(pid).unwrap_or_else(|| Process::new(*pid)),
            )
        };
        Ok(Census {
            at: Instant::now(),
            processes: names.keys().map(process).collect(),
            names,
        })
    }
}

/// What those that live have done so far.
fn looks(processes: &mut BTreeMap<u32, Process>) -> BTreeMap<u32, Look> {
    let look = |(pid, process): (&u32, &mut Process)| Some((*pid, process.look()?));
    processes.iter_mut().filter_map(look).collect()
}

impl ProcessRow {
    fn new(pid: u32, name: String, took: &Look, n_ticks: u64) -> ProcessRow {
        let a_tick = |nanos: u64| nanos as f64 / n_ticks as f64 / 1e6;
        let stage = |(name, sums): (&String, &schema_stages::Sums)| StageRow {
            stage: name.clone(),
            cpu_ms: a_tick(sums.cpu_nanos),
            wall_ms: a_tick(sums.wall_nanos),
            spans: sums.n_spans as f64 / n_ticks as f64,
        };
        let mut stages: Vec<StageRow> = took.stages.iter().map(stage).collect();
        stages.sort_by(|a, b| b.cpu_ms.total_cmp(&a.cpu_ms));
        ProcessRow {
            pid,
            name,
            cpu_ms: a_tick(took.cpu_nanos),
            stages,
        }
    }
}

fn text(report: &Report, with_stages: bool) -> String {
    let head = format!(
        "{} ticks in {:.1} s: {:.1} a second, {:.2} × real time, {:.1} ms of processors a tick\n",
        report.n_ticks,
        report.secs,
        report.ticks_per_sec,
        report.simulated_secs / report.secs,
        report.cpu_ms,
    );
    let ms = |value: f64| format!("{value:.2}");
    let mut rows = Vec::new();
    for process in &report.processes {
        let mut row = vec![process.name.clone(), ms(process.cpu_ms)];
        if with_stages {
            row.extend([String::new(), String::new()]);
        }
        rows.push(row);
        for stage in process.stages.iter().filter(|_| with_stages) {
            let is_measured = stage.spans > 0.0;
            let cell = |text: String| if is_measured { text } else { String::new() };
            rows.push(vec![
                format!("  {}", stage.stage),
                ms(stage.cpu_ms),
                cell(ms(stage.wall_ms)),
                cell(format!("{:.1}", stage.spans)),
            ]);
        }
    }
    let heads = ["process", "CPU ms/tick", "wall ms/tick", "times/tick"];
    let heads = if with_stages { &heads[..] } else { &heads[..2] };
    head + &output::table(heads, &rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use schema_stages::Sums;

    #[test]
    fn a_tick_is_the_sum_of_the_stages() {
        let sums = |cpu_nanos, n_spans| Sums {
            cpu_nanos,
            wall_nanos: 2 * cpu_nanos,
            n_spans,
        };
        let took = Look {
            tick: None,
            cpu_nanos: 100_000_000,
            stages: [
                ("physics".to_owned(), sums(30_000_000, 10)),
                ("rest".to_owned(), sums(70_000_000, 0)),
            ]
            .into(),
        };
        let row = ProcessRow::new(7, "simd".to_owned(), &took, 10);
        assert_eq!(row.cpu_ms, 10.0);
        let stages: Vec<_> = row
            .stages
            .iter()
            .map(|s| (s.stage.as_str(), s.cpu_ms))
            .collect();
        assert_eq!(stages, [("rest", 7.0), ("physics", 3.0)]);
        let report = Report {
            bench: "tick",
            machine: Machine::read(),
            domain: "gantry".into(),
            secs: 1.0,
            n_ticks: 10,
            simulated_secs: 0.5,
            ticks_per_sec: 10.0,
            cpu_ms: 10.0,
            processes: vec![row],
        };
        let table = text(&report, true);
        assert!(table.contains("0.50 × real time"), "{table}");
        assert!(
            table.contains("  physics         3.00          6.00         1.0"),
            "{table}"
        );
        assert!(!text(&report, false).contains("physics"));
    }
}
