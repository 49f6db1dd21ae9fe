//! The words of `gantry map`, of `gantry carla-root`, and of the servers that its script starts.

use std::net::{IpAddr, Ipv4Addr};
use std::path::PathBuf;

use clap::Subcommand;

const MAP_EXAMPLES: &str = "\
Examples:
  gantry map import ~/CARLA_0.9.16
  gantry map check crossing.xodr
  gantry map check ~/maps Town03 --carla always
  gantry map export Town03 town03.xodr";

/// `gantry map`.
#[derive(clap::Args, Debug, Clone)]
#[command(after_help = MAP_EXAMPLES)]
pub struct MapArgs {
    #[command(subcommand)]
    pub word: MapWord,
}

/// What to do with maps.
#[derive(Subcommand, Debug, Clone)]
pub enum MapWord {
    /// Read maps as the simulator does: what they hold, what is odd or broken, how CARLA's client
    /// reads them
    Check(CheckArgs),
    /// Make maps of the data folder from OpenDRIVE files of a CARLA installation or of any folder
    Import(ImportArgs),
    /// Write the OpenDRIVE text of a map into a file
    Export(ExportArgs),
}

const CHECK_NOTES: &str = "\
Exit code 1 if a map is broken, or read otherwise than by CARLA's client. The comparison needs a Python with the package
carla (0.9.16): lane links, places every 2 m within 1 cm, headings, lane types and widths, junctions, landmarks with speed
limits, nearest lanes. A file on which the client's own reader fails is not compared, and that is no failure.

Examples:
  gantry map check crossing.xodr
  gantry map check ~/maps --all
  gantry map check Town01 Town02 --carla always --json";

/// `gantry map check`.
#[derive(clap::Args, Debug, Clone)]
#[command(after_help = CHECK_NOTES)]
pub struct CheckArgs {
    /// Files, folders with .xodr files, names of towns or of files in the map folder
    #[arg(value_name = "PATH|DIR|NAME", required = true)]
    pub what: Vec<String>,
    /// Compare with CARLA's client: auto does if a Python with its package is there
    #[arg(long, value_enum, value_name = "WHEN", default_value_t = WithCarla::Auto)]
    pub carla: WithCarla,
    /// Python that has the package carla [default: .venv here, else python3 on PATH]
    #[arg(long, value_name = "PROGRAM")]
    pub python: Option<PathBuf>,
    /// Print every warning instead of the first 12
    #[arg(long)]
    pub all: bool,
    /// Print one JSON object per map
    #[arg(long)]
    pub json: bool,
    /// Seed of generated towns
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Data folder; maps by name are in its folder maps/ [default: gantry in the XDG data folder]
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
}

/// Whether to ask CARLA's client.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum WithCarla {
    /// If it is there.
    Auto,
    /// Its absence is an error.
    Always,
    /// Not at all.
    Never,
}

const IMPORT_NOTES: &str = "\
Folders are searched to their end; a CARLA installation has its maps in CarlaUE4/Content/Carla/Maps.
Every map is read before any is written, and takes its place in the folder maps/ of the data folder in one step.
A map called as one of Gantry's own towns is loaded in its place from then on; remove the file to have the own town back.
Exit code 1 if a map was refused; the others are imported all the same.

Examples:
  gantry map import ~/CARLA_0.9.16
  gantry map import Town01.xodr Town04.xodr ~/roadrunner/exports
  gantry map import downtown_v3.xodr --name Downtown --replace";

/// `gantry map import`.
#[derive(clap::Args, Debug, Clone)]
#[command(after_help = IMPORT_NOTES)]
pub struct ImportArgs {
    /// Files, and folders in which .xodr files are looked for
    #[arg(value_name = "DIR|FILE", required = true)]
    pub what: Vec<PathBuf>,
    /// Name of the map, if one file is given [default: the file's, without .xodr and _Opt]
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// Put maps in the place of others of the same name
    #[arg(long)]
    pub replace: bool,
    /// Read and report, and write nothing
    #[arg(long)]
    pub dry_run: bool,
    /// Print every warning instead of the first 3
    #[arg(long)]
    pub all: bool,
    /// Print one JSON object per map
    #[arg(long)]
    pub json: bool,
    /// Data folder; the maps go into its folder maps/ [default: gantry in the XDG data folder]
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
}

/// `gantry map export`.
#[derive(clap::Args, Debug, Clone)]
#[command(
    after_help = "Examples:\n  gantry map export Town03 town03.xodr\n  gantry map export Town10HD centre.xodr --seed 7"
)]
pub struct ExportArgs {
    /// Town, or file of the map folder
    pub name: String,
    /// File to write
    pub file: PathBuf,
    /// Seed of a generated town
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Data folder; maps by name are in its folder maps/ [default: gantry in the XDG data folder]
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
}

const ROOT_NOTES: &str = "\
The script understands CARLA's arguments: ports (-carla-rpc-port=N and its older names,
-carla-streaming-port=N), the map, -quality-level=Low|Epic, -graphicsadapter=K, -benchmark, -fps=N,
-no-rendering. It ignores those that are about windows and sound, and warns of the others.
Each server has a domain of its own, carla_N for port N, so several run beside each other.
DIR/launch.toml says what a server is, and may be changed.
When the script is killed, alone or with its process group, everything that it started ends and
nothing is left behind.

Examples:
  gantry carla-root ~/gantry-carla && export CARLA_ROOT=~/gantry-carla
  ~/gantry-carla/CarlaUE4.sh -RenderOffScreen -nosound -carla-rpc-port=3000 -graphicsadapter=1
  gantry carla-root ~/gantry-carla --data ~/maps_and_runs --python-api ~/CARLA_0.9.16/PythonAPI";

/// `gantry carla-root`.
#[derive(clap::Args, Debug, Clone)]
#[command(after_help = ROOT_NOTES)]
pub struct CarlaRootArgs {
    /// Folder to make; one that this word made before is made again, and keeps its launch.toml
    #[arg(value_name = "DIR")]
    pub dir: PathBuf,
    /// Data folder of the servers: their maps are in its folder maps/ [default: gantry in the XDG
    /// data folder of whoever starts a server]
    #[arg(long, value_name = "DATA")]
    pub data: Option<PathBuf>,
    /// Folder PythonAPI of a CARLA, to which DIR/PythonAPI becomes a link: programs look there for
    /// the package agents [default: none]
    #[arg(long, value_name = "FOLDER")]
    pub python_api: Option<PathBuf>,
    /// Address on which servers listen; 0.0.0.0, as CARLA has it, lets clients of other machines
    /// in, and there is no password
    #[arg(long, value_name = "ADDRESS", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    pub bind: IpAddr,

    /// Servers let programs of all users of this machine in, not only those of their own user and
    /// root's
    #[arg(long)]
    pub any_user: bool,
}

/// What the script of a CARLA folder hands to the launcher behind it.
#[derive(clap::Args, Debug, Clone, PartialEq)]
pub struct CarlaServerArgs {
    /// Launch file
    #[arg(long)]
    pub launch: PathBuf,
    /// Port of the RPC server
    #[arg(long)]
    pub port: u16,
    /// Port of the streams; 0: any
    #[arg(long)]
    pub stream_port: u16,
    /// Map instead of the launch file's
    #[arg(long)]
    pub map: Option<String>,
    /// Fixed step as ticks per second
    #[arg(long)]
    pub tick_hz: Option<f64>,
    /// As fast as possible
    #[arg(long)]
    pub unpaced: bool,
    /// Without pictures
    #[arg(long)]
    pub no_rendering: bool,
    /// Picture quality
    #[arg(long)]
    pub quality: Option<String>,
    /// Index of the GPU
    #[arg(long)]
    pub adapter: Option<usize>,
    /// Only leave the session of the caller and start the launcher there
    #[arg(long)]
    pub detach: bool,
}
