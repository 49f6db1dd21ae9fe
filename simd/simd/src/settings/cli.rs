//! Command line of `simd`. Flags override the launch file.

use std::path::PathBuf;

use clap::{Parser, ValueEnum};
use launch_cli::CommonArgs;
use schema_frames::Seal;

/// Simulation daemon: owns the world and the clock, renders the sensors and writes their frames
/// straight into shared memory.
#[derive(Parser, Clone, Debug)]
#[command(name = "simd", version, after_help = EXAMPLES)]
pub struct Args {
    /// Launch file whose scenario and sensors to run [default: a town with one car, 20 others and
    /// no sensors]
    #[arg(long, value_name = "FILE")]
    pub launch: Option<PathBuf>,

    /// Override a value of the launch file, in TOML syntax; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,

    /// Map to load instead of the launch file's: a town, the name of a file in the map folder, or
    /// the path of an .xodr file
    #[arg(long, value_name = "MAP")]
    pub map: Option<String>,

    /// Data folder: maps/ holds .xodr files by name, checkpoints/ saved worlds [default: gantry in
    /// the XDG data folder]
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,

    /// Write the map's OpenDRIVE text into this file (- is stdout) and stop
    #[arg(long, value_name = "FILE")]
    pub export_map: Option<PathBuf>,

    /// GPU to render with: its number or its UUID as --adapters lists them, or a part of its name,
    /// e.g. 1 or "llvmpipe" or "H200" [default: a real GPU if there is one]
    #[arg(long, value_name = "GPU")]
    pub adapter: Option<String>,

    /// List the GPUs that can render, with numbers and UUIDs, and stop
    #[arg(long)]
    pub adapters: bool,

    /// Print lists as JSON
    #[arg(long)]
    pub json: bool,

    /// Picture quality: changes colour only, never depth, labels, flow or rays [default: low on
    /// software adapters, else high]
    #[arg(long, value_enum)]
    pub quality: Option<QualityArg>,

    /// What casts the rays of lidars; points are the same but for rounding [default:
    /// scenario.lidars_on of the launch file; there, a real GPU if its shaders have 64-bit numbers,
    /// else cpu]
    #[arg(long, value_enum)]
    pub lidars_on: Option<LidarsOnArg>,

    /// Most memory of the GPU for the images of all cameras, MiB; a camera that does not fit is
    /// refused [default: what the driver gives]
    #[arg(long, value_name = "MIB", value_parser = clap::value_parser!(u32).range(1..))]
    pub gpu_memory: Option<u32>,

    /// End the GPU as a failing driver would, once, when this file appears, which is then removed;
    /// for tests of what follows
    #[arg(long, value_name = "FILE", hide = true)]
    pub lose_gpu_when: Option<PathBuf>,

    /// Copy frames once on the CPU instead of letting the GPU write into shared memory
    #[arg(long)]
    pub staged: bool,

    /// Copy frames on the queue that draws, behind their drawing, and not beside the drawing of the
    /// next ones where the GPU has a queue for copies
    #[arg(long)]
    pub one_queue: bool,

    /// Ticks that the world may go on while a camera's frame is on the GPU, in free-running mode: 1
    /// to 4
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=4))]
    pub frames_in_flight: u32,

    /// Render every sensor, read or not, and print one line "TICK TOPIC HASH" per frame to stdout
    #[arg(long)]
    pub hash: bool,

    /// Stop after this many ticks
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub ticks: Option<u64>,

    /// Run as fast as possible instead of in real time (free-running mode only)
    #[arg(long)]
    pub unpaced: bool,

    /// Once the world falls behind real time, let cameras and lidars fire at every 2nd tick, or 3rd,
    /// up to the 20th; what comes of it depends on the machine
    #[arg(long, conflicts_with_all = ["unpaced", "hash", "journal"])]
    pub keep_up: bool,

    /// What to do in stepped mode when no client is left for 10 seconds
    #[arg(long, value_enum, default_value_t = OnLostClient::Resume)]
    pub on_lost_client: OnLostClient,

    /// Remove a lockstep participant that has been idle for this many seconds although it lives
    /// [default: scenario.lockstep_timeout_s of the launch file; there, wait for ever]
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u32).range(1..))]
    pub lockstep_timeout: Option<u32>,

    /// Wait for this many lockstep participants before the first tick
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub await_lockstep: u32,

    /// Wait for the lockstep participant of this name before the first tick; may be repeated. A
    /// launch file's `lockstep = true` does this
    #[arg(long, value_name = "NAME")]
    pub await_participant: Vec<String>,

    /// Open no GPU: render workers make all images (gantry-render), and the processor casts lidars
    #[arg(long, conflicts_with_all = ["adapter", "adapters", "hash", "gpu_memory", "quality"])]
    pub no_gpu: bool,

    /// Wait for this many render workers (gantry-render) before the first tick
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(..=16), conflicts_with = "hash")]
    pub await_workers: u32,

    /// Run a journal again: entries act at their ticks, and until it ends other clients may ask but
    /// not change the world. `gantry rerun` takes it out of a recording
    #[arg(long, value_name = "FILE")]
    pub journal: Option<PathBuf>,

    /// Simulated time up to which the journal holds, nanoseconds [default: up to its last entry]
    #[arg(long, value_name = "NANOS", requires = "journal")]
    pub journal_until: Option<u64>,

    /// Sensor of the launch file that was not in the recorded run: its actor id is one of a range of
    /// its own, so that all other ids stay as they were; may be repeated
    #[arg(long, value_name = "NAME")]
    pub added_sensor: Vec<String>,

    /// Show what sensors measure and nothing else of the world, and obey one process: a seal as
    /// JSON, see the chapter on sealed worlds in the frame contract
    #[arg(long, value_name = "JSON", value_parser = Seal::from_json, hide = true, conflicts_with_all = ["await_workers", "no_gpu"])]
    pub sealed: Option<Seal>,

    /// Most memory for what acted on the world so far, MiB; beyond it the oldest is forgotten, and
    /// recordings that begin later cannot be run again
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub journal_mb: u32,

    #[command(flatten)]
    pub common: CommonArgs,
}

/// Choice for `--quality`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum QualityArg {
    /// For software adapters.
    Low,
    /// For GPUs.
    High,
}

/// Choice for `--lidars-on`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LidarsOnArg {
    /// Bundles of rays on the processor.
    Cpu,
    /// A compute shader of the adapter that renders.
    Gpu,
}

/// Choice for `--on-lost-client`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum OnLostClient {
    /// Tick in real time until the next cue; settings stay.
    Resume,
    /// Wait for ever, as CARLA does.
    Wait,
}

const EXAMPLES: &str = "Examples:
  simd --launch launch/quickstart.toml
  simd --launch launch/quickstart.toml --ticks 200 --unpaced --hash > hashes.txt
  simd --map crossing.xodr
  simd --adapters";
