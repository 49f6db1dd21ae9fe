//! The command line.

use std::path::PathBuf;

use clap::{Parser, ValueEnum};
use launch_cli::CommonArgs;
use launch_cli::values::span_nanos;

/// Runs the simulator through a recorded run again, tick by tick with the same commands and
/// controls, and compares every frame with the recording.
#[derive(Parser, Debug)]
#[command(name = "gantry-rerun", version, after_help = EXAMPLES)]
pub struct Args {
    /// The recording
    pub file: PathBuf,

    /// Run up to this simulated time only, e.g. 12s or 1m30s [default: to the end of the recording]
    #[arg(long, value_name = "TIME", value_parser = span_nanos)]
    pub until: Option<u64>,

    /// What comes after that
    #[arg(long, value_enum, default_value_t = Then::Stop)]
    pub then: Then,

    /// Change a value of the recorded launch file, in TOML syntax, and report from which tick on
    /// the runs part; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,

    /// Send a command of one's own at this simulated time, e.g. 12s='{"do":"reset"}'; may be
    /// repeated
    #[arg(long, value_name = "TIME=JSON", value_parser = timed_command)]
    pub command: Vec<TimedCommand>,

    /// Add a sensor to the old run, e.g. roof='{kind="lidar", channels=64}', or those of a launch
    /// file FILE.toml; may be repeated. Everything else stays as it was
    #[arg(long, value_name = "NAME=SPEC|FILE")]
    pub sensor: Vec<String>,

    /// Record the new run into this file
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,

    /// Print the report as one JSON object
    #[arg(long)]
    pub json: bool,

    #[command(flatten)]
    pub common: CommonArgs,
}

/// What comes after the last tick that is run again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Then {
    /// End the simulator
    Stop,
    /// Hand it over: it runs on in real time until Ctrl-C, for every client
    Live,
    /// The same, but each tick waits for a client's cue
    Stepped,
}

/// A command at a time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TimedCommand {
    /// Simulated time, nanoseconds.
    pub at_nanos: u64,
    /// The command.
    pub json: String,
}

fn timed_command(text: &str) -> Result<TimedCommand, String> {
    let (at, json) = text.split_once('=').ok_or_else(|| {
        format!("{text:?} has no '='; write for example 12s='{{\"do\":\"reset\"}}'")
    })?;
    let command: schema_frames::Command = serde_json::from_str(json)
        .map_err(|error| format!("{json:?} is no command of control/world: {error}"))?;
    if !command.acts_on_world() {
        return Err(format!(
            "{json:?} does not act on the world, so it changes no run"
        ));
    }
    Ok(TimedCommand {
        at_nanos: span_nanos(at).map_err(|error| error.to_string())?,
        json: json.to_owned(),
    })
}

const EXAMPLES: &str =
    "Exit code 0: every frame is equal. 1: the runs differ, or the run could not be made or was broken off.
3: what is left of a damaged recording is equal.

Examples:
  gantry rerun drive.mcap
  gantry rerun drive.mcap --until 12s --then live
  gantry rerun drive.mcap --set scenario.weather.fog_density=60
  gantry rerun drive.mcap --sensor roof='{kind=\"lidar\", channels=64}' --record with_lidar.mcap";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_needs_a_time_and_must_act() {
        let found = timed_command(r#"2s={"do":"reset"}"#).unwrap();
        assert_eq!(found.at_nanos, 2_000_000_000);
        assert!(timed_command(r#"{"do":"reset"}"#).is_err());
        assert!(
            timed_command(r#"2s={"do":"ping"}"#)
                .unwrap_err()
                .contains("does not act")
        );
        assert!(
            timed_command(r#"2s={"do":"fly"}"#)
                .unwrap_err()
                .contains("no command")
        );
    }
}
