//! Command line of `gantry-render`.

use clap::{Parser, ValueEnum};
use launch_cli::CommonArgs;
use launch_cli::values::number;

/// Renders a share of a simulator's cameras, beside other workers or in place of the simulator's own
/// GPU.
#[derive(Parser, Clone, Debug)]
#[command(name = "gantry-render", version, after_help = EXAMPLES)]
pub struct Args {
    /// Name of this worker, which no other of the domain has [default: render- and the number of the
    /// process]
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,

    /// GPU to render with: its number or its UUID as simd --adapters lists them, or a part of its
    /// name, e.g. 1 or "llvmpipe" or "H200" [default: a real GPU if there is one]
    #[arg(long, value_name = "GPU")]
    pub adapter: Option<String>,

    /// Size of the share beside the others': a worker of weight 2 gets twice the pixels of one of
    /// weight 1
    #[arg(long, value_name = "NUMBER", default_value_t = 1.0, value_parser = number("weight", 1e-6..=1e6))]
    pub weight: f64,

    /// Picture quality: changes colour only, never depth, labels or flow; workers of one simulator
    /// should have the same [default: low on software adapters, else high]
    #[arg(long, value_enum)]
    pub quality: Option<QualityArg>,

    /// Copy frames once on the CPU instead of letting the GPU write into shared memory
    #[arg(long)]
    pub staged: bool,

    /// Copy frames on the queue that draws, behind their drawing, and not beside the drawing of the
    /// next ones where the GPU has a queue for copies
    #[arg(long)]
    pub one_queue: bool,

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

const EXAMPLES: &str = "Examples:
  simd --launch launch/quickstart.toml --no-gpu --await-workers 2
  gantry-render --adapter 0 --name left
  gantry-render --adapter 1 --name right";
