//! The command line of `gantry`.

mod carla;
mod look;
mod make;
mod sensor;

use std::ffi::OsString;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

use clap::{Parser, Subcommand};
use launch_cli::CommonArgs;
use launch_spec::Period;

use crate::external;

pub use carla::{
    CarlaRootArgs, CarlaServerArgs, CheckArgs, ExportArgs, ImportArgs, MapArgs, MapWord, WithCarla,
};
pub use look::{Column, EchoArgs, GraphArgs, TopArgs, TopicArgs, TopicWord, WindowArgs};
pub use make::{ConsumerArgs, Lang, NewArgs, NewWord};
pub use sensor::{
    SensorArgs, SensorCheckArgs, SensorExportArgs, SensorImportArgs, SensorWord, SizePx,
};

const EXAMPLES: &str = "\
Examples:
  gantry up                                              the quickstart: town, car, sensors, traffic, viewer
  gantry up launch/two_rigs.toml --for 20s --view none --record drive.mcap
  gantry top
  gantry topic hz ego/front/rgb
  gantry graph --svg graph.svg";

/// Headless driving simulator: run it, look at what it publishes, find out why it does not run
#[derive(Parser, Debug)]
#[command(name = "gantry", version, after_help = external::help() + EXAMPLES, arg_required_else_help = true)]
pub struct Args {
    #[command(subcommand)]
    pub word: Word,
    #[command(flatten)]
    pub common: CommonArgs,
}

/// First word after `gantry`.
#[derive(Subcommand, Debug)]
pub enum Word {
    /// Start the processes of a launch file and watch them until Ctrl-C
    Up(UpArgs),
    /// List and measure what is published
    Topic(TopicArgs),
    /// Watch processes and topics on a screen: load, rates, ages, losses, who reads what
    Top(TopArgs),
    /// Draw processes and topics
    Graph(GraphArgs),
    /// Examine graphics driver, shared memory, ports and limits, and say what to repair
    Doctor(DoctorArgs),
    /// Take OpenDRIVE files over from CARLA or elsewhere, check them, or write out a map's
    Map(MapArgs),
    /// Show and judge profiles of sensors as they are sold, and read and write calibrations
    Sensor(SensorArgs),
    /// Make a project of your own that runs with the simulator
    New(NewArgs),
    /// Make a folder for CARLA_ROOT, whose CarlaUE4.sh starts a server that is Gantry
    CarlaRoot(CarlaRootArgs),
    /// The launcher behind CarlaUE4.sh
    #[command(hide = true)]
    CarlaServer(CarlaServerArgs),
    /// Any other word runs the program gantry-WORD
    #[command(external_subcommand)]
    External(Vec<OsString>),
}

const UP_EXAMPLES: &str = "\
Ctrl-C stops the processes in order, readers first; a second Ctrl-C kills them at once.
The exit code of a required process is passed on.

Examples:
  gantry up
  gantry up --for 30s --record drive.mcap --view save:drive.rrd
  gantry up town.toml my_pipeline.toml
  gantry up launch/people.toml --replay drive.mcap --rate max
  gantry up launch/two_rigs.toml --set scenario.seed=9 --set sensor.front.width_px=640 --dry-run";

/// `gantry up`.
#[derive(clap::Args, Debug, Clone, Default)]
#[command(after_help = UP_EXAMPLES)]
pub struct UpArgs {
    /// Launch files, each laid over those before it [default: launch/quickstart.toml; that one,
    /// launch/minimal.toml, launch/two_rigs.toml and launch/carla.toml are also built in]
    #[arg(value_name = "FILE")]
    pub files: Vec<PathBuf>,

    /// Stop after this time, e.g. 20s or 2m, counted from when all processes are ready [default:
    /// run until Ctrl-C]
    #[arg(long = "for", value_name = "TIME", value_parser = Period::from_str)]
    pub for_period: Option<Period>,

    /// Record every topic into this MCAP file with gantry-record [default: only if the launch file
    /// has a recorder]
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,

    /// Run on this recording in place of the simulator: gantry-replay publishes its frames, and waits
    /// for the processes that take part in lockstep. Results that were recorded are left out, because
    /// the processes make their own, and so are processes that drive the world
    #[arg(long, value_name = "FILE")]
    pub replay: Option<PathBuf>,

    /// Speed of the recording: a factor of real time, or max
    #[arg(long, value_name = "SPEED", requires = "replay")]
    pub rate: Option<String>,

    /// Show it: auto, native, web, fly, none or save:FILE.rrd; auto is native on a desktop, else web,
    /// and fly a window in which the spectator is flown [default: what the launch file has]
    #[arg(long, value_name = "HOW")]
    pub view: Option<ViewMode>,

    /// Where the machine cannot keep real time, let cameras and lidars fire less often; the simulator
    /// says so, and frames tell the time since the one before
    #[arg(long, conflicts_with = "replay")]
    pub keep_up: bool,

    /// Add a page for the browser from which the world is ruled: pause, step, speed, weather, spawn,
    /// follow (gantry-desk)
    #[arg(long)]
    pub desk: bool,

    /// Override a value of the launch file, in TOML syntax; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,

    /// Print what the files say together with every default filled in and the shared memory it
    /// needs, and start nothing
    #[arg(long)]
    pub dry_run: bool,

    /// Print the JSON schema of launch files, with which editors complete and check them, and start
    /// nothing
    #[arg(long, conflicts_with_all = ["dry_run", "record", "replay", "view", "desk", "keep_up", "for_period", "files"])]
    pub schema: bool,

    /// Folder for maps, logs and runs [default: gantry in the XDG data folder]
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
}

/// Form of what is printed to stdout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// For people.
    Text,
    /// One object per line (`--json`).
    Json,
}

impl Form {
    /// What the flag `--json` asks for.
    pub fn of(json: bool) -> Form {
        if json { Form::Json } else { Form::Text }
    }
}

/// How to show a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ViewMode {
    /// A window if there is a display, else the browser page.
    Auto,
    /// rerun's window.
    Native,
    /// A page for the browser.
    Web,
    /// A window in which the spectator is flown.
    Fly,
    /// Not at all.
    None,
    /// Into a file.
    Save(PathBuf),
}

impl FromStr for ViewMode {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(ViewMode::Auto),
            "native" => Ok(ViewMode::Native),
            "web" => Ok(ViewMode::Web),
            "fly" => Ok(ViewMode::Fly),
            "none" => Ok(ViewMode::None),
            _ => match text.strip_prefix("save:") {
                Some(file) if !file.is_empty() => Ok(ViewMode::Save(file.into())),
                _ => Err("must be auto, native, web, fly, none or save:FILE.rrd".into()),
            },
        }
    }
}

/// `gantry doctor`.
#[derive(clap::Args, Debug, Clone)]
#[command(
    after_help = "Examples:\n  gantry doctor\n  gantry doctor --json\n  gantry doctor --domain lab2"
)]
pub struct DoctorArgs {
    /// Print one JSON object per finding
    #[arg(long)]
    pub json: bool,
}

impl UpArgs {
    /// `--for` as a standard duration.
    pub fn run_for(&self) -> Option<Duration> {
        self.for_period.map(Period::duration)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_well_formed() {
        launch_cli::command::<Args>().debug_assert();
    }

    #[test]
    fn view_modes_read_as_documented() {
        assert_eq!("save:a.rrd".parse(), Ok(ViewMode::Save("a.rrd".into())));
        assert_eq!("auto".parse(), Ok(ViewMode::Auto));
        assert_eq!("fly".parse(), Ok(ViewMode::Fly));
        assert!("save:".parse::<ViewMode>().is_err() && "window".parse::<ViewMode>().is_err());
    }

    #[test]
    fn a_foreign_word_is_handed_on_with_its_flags() {
        let args = <Args as Parser>::try_parse_from(["gantry", "view", "--web", "x"]).unwrap();
        let Word::External(words) = args.word else {
            panic!("{:?}", args.word)
        };
        assert_eq!(words, ["view", "--web", "x"]);
    }
}
