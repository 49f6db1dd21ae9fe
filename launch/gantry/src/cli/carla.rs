//! The words of `gantry carla-root` and of the servers that its script starts.

use std::net::{IpAddr, Ipv4Addr};
use std::path::PathBuf;

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
