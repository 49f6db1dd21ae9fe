//! `gantry sensor check`: what a profile measures, judged by a program that is not Gantry's, and the
//! same with planted errors, which it must find.

use std::path::{Path, PathBuf};

use launch_cli::Exit;
use launch_spec::profiles;
use sensor_spec::{LidarSpec, SensorSpec};
use serde::{Deserialize, Serialize};

use super::{inertial, judge, profile, scan};
use crate::cli::SensorCheckArgs;

/// A program that judges the returns of a maker's lidars.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Judge {
    tool: &'static str,
    /// Greatest distance between both points, millimetres.
    limit_mm: f64,
    /// Whether it reads times and rings.
    reads_times: bool,
}

/// Greatest difference between both times, microseconds.
const LIMIT_US: f64 = 1.0;

/// The judge of a profile; `None` if no outside program reads that maker's packets.
fn judge_of(name: &str) -> Option<Judge> {
    match name.split_once('/')?.0 {
        "velodyne" => Some(Judge {
            tool: "velodyne-decoder",
            limit_mm: 2.0,
            reads_times: true,
        }),
        "ouster" => Some(Judge {
            tool: "ouster-sdk",
            limit_mm: 1.0,
            reads_times: false,
        }),
        _ => None,
    }
}

/// An error that the judge must find.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Planted {
    Nothing,
    /// One ring looks 0.1° too high.
    Ring,
    /// One channel fires 5 µs too late.
    Time,
    /// Beams begin 20 mm farther from the axis.
    Lever,
}

impl Planted {
    const ALL: [Planted; 4] = [
        Planted::Nothing,
        Planted::Ring,
        Planted::Time,
        Planted::Lever,
    ];

    fn name(self) -> &'static str {
        match self {
            Planted::Nothing => "none",
            Planted::Ring => "ring 0.1°",
            Planted::Time => "time 5 µs",
            Planted::Lever => "lever arm 20 mm",
        }
    }

    /// The lidar with this error.
    fn plant(self, spec: &LidarSpec) -> LidarSpec {
        let mut wrong = spec.clone();
        let channels = 0..spec.channels;
        match self {
            Planted::Nothing => {}
            Planted::Ring => {
                let elevations = channels.map(|it| spec.elevation_rad(it).to_degrees());
                wrong.elevations_deg = elevations.collect();
                wrong.elevations_deg[0] += 0.1;
            }
            Planted::Time => {
                wrong.fire_offsets_ns = fire_offsets_ns(spec);
                // Not the last one, to which all times refer.
                let n = wrong.fire_offsets_ns.len();
                wrong.fire_offsets_ns[n - 1] += 5000.0;
            }
            Planted::Lever => wrong.origin_offset_m += 0.02,
        }
        wrong
    }
}

/// When each channel of a column fires, from the first on.
fn fire_offsets_ns(spec: &LidarSpec) -> Vec<f64> {
    let last = spec.columns.saturating_sub(1);
    let fires_ns = || (0..spec.channels).map(|it| spec.firing_nanos(it, last));
    let first_ns = fires_ns().fold(0.0, f64::min);
    fires_ns().map(|it| it - first_ns).collect()
}

/// What the script is told of a case, in a line before the returns.
#[derive(Serialize)]
struct Case {
    tool: &'static str,
    columns: u32,
    column_ns: f64,
    fire_offsets_ns: Vec<f64>,
    elevations_deg: Vec<f64>,
    azimuth_offsets_deg: Vec<f64>,
    rings: Vec<u16>,
    origin_offset_m: f64,
}

/// What the script answers of a case.
#[derive(Debug, Deserialize)]
struct Verdict {
    version: String,
    /// Points that both have, of those that were packed.
    n_points: u64,
    n_missing: u64,
    max_mm: f64,
    max_us: Option<f64>,
    n_wrong_rings: Option<u64>,
}

impl Verdict {
    fn is_good(&self, judge: Judge) -> bool {
        self.n_points > 0
            && self.n_missing == 0
            && self.max_mm <= judge.limit_mm
            && self.max_us.is_none_or(|us| us <= LIMIT_US)
            && self.n_wrong_rings.is_none_or(|n| n == 0)
    }
}

/// Runs `gantry sensor check`.
pub fn run(args: &SensorCheckArgs) -> anyhow::Result<Exit> {
    let python = args.python.clone().unwrap_or_else(|| {
        let own = PathBuf::from(".venv/bin/python");
        if own.exists() { own } else { "python3".into() }
    });
    let names: Vec<&str> = match args.all {
        true => profiles::names().collect(),
        false => args.profiles.iter().map(String::as_str).collect(),
    };
    let (mut lidars, mut imus, mut others) = (Vec::new(), Vec::new(), Vec::new());
    for name in names {
        match profile::read(name)?.1 {
            SensorSpec::Lidar(spec) => lidars.push((name, spec)),
            SensorSpec::Imu(spec) => imus.push((name, spec)),
            _ => others.push(name),
        }
    }
    let mut is_good = true;
    if !lidars.is_empty() {
        println!(
            "| profile | outside tool | planted error | points | missing | xyz, mm | time, µs | wrong rings | verdict |"
        );
        println!("|---|---|---|---|---|---|---|---|---|");
    }
    for (name, spec) in &lidars {
        is_good &= check(name, spec, &python)?;
    }
    if !imus.is_empty() {
        println!(
            "{}",
            if lidars.is_empty() {
                inertial::HEAD.trim_start()
            } else {
                inertial::HEAD
            }
        );
    }
    for (name, spec) in &imus {
        is_good &= inertial::check(name, spec, &python)?;
    }
    for name in others {
        println!("`{name}`: not judged, no outside tool reads what this kind of sensor measures");
    }
    Ok(if is_good { Exit::Done } else { Exit::Failed })
}

/// Prints the rows of one lidar; `false` if one is not as it must be.
fn check(name: &str, spec: &LidarSpec, python: &Path) -> anyhow::Result<bool> {
    let Some(judge) = judge_of(name) else {
        println!("| `{name}` | none |  |  |  |  |  |  | not judged |");
        return Ok(true);
    };
    let mut is_good = true;
    for planted in Planted::ALL {
        if planted == Planted::Time && !judge.reads_times {
            continue;
        }
        let verdict = ask(python, judge, spec, &planted.plant(spec))?;
        let is_right = verdict.is_good(judge) == (planted == Planted::Nothing);
        is_good &= is_right;
        let or_dash = |text: Option<String>| text.unwrap_or_else(|| "–".into());
        println!(
            "| `{name}` | {} {} | {} | {} | {} | {:.3} | {} | {} | {} |",
            judge.tool,
            verdict.version,
            planted.name(),
            verdict.n_points,
            verdict.n_missing,
            verdict.max_mm,
            or_dash(verdict.max_us.map(|us| format!("{us:.3}"))),
            or_dash(verdict.n_wrong_rings.map(|n| n.to_string())),
            match (is_right, planted) {
                (true, Planted::Nothing) => "within the limits",
                (true, _) => "found",
                (false, Planted::Nothing) => "**beyond the limits**",
                (false, _) => "**not found**",
            }
        );
    }
    Ok(is_good)
}

/// What the judge says of the returns of `scanned`, packed as those of `nominal`.
fn ask(
    python: &Path,
    judge: Judge,
    nominal: &LidarSpec,
    scanned: &LidarSpec,
) -> anyhow::Result<Verdict> {
    let (returns, _) = scan::returns_in_a_room(scanned);
    let channels = || 0..nominal.channels;
    let case = Case {
        tool: judge.tool,
        columns: nominal.columns,
        column_ns: nominal.column_nanos(),
        fire_offsets_ns: fire_offsets_ns(nominal),
        elevations_deg: channels()
            .map(|it| nominal.elevation_rad(it).to_degrees())
            .collect(),
        azimuth_offsets_deg: channels()
            .map(|it| nominal.aside_rad(it).to_degrees())
            .collect(),
        rings: channels().map(|it| nominal.ring(it)).collect(),
        origin_offset_m: nominal.origin_offset_m,
    };
    judge::ask(python, &case, &returns)
}
