//! `gantry-render`: makes the frames of a share of a simulator's cameras, on a GPU of its own or on
//! one that it shares, into the same topics with the same bytes.
//!
//! It follows the scenes that the simulator sends (`inbox`), asks for what it lacks of them
//! (`source`), and keeps its cameras as the simulator lists them (`cameras`); `worker` joins these.
//! When the simulator ends, it waits for the next one.

mod cameras;
mod cli;
mod inbox;
mod source;
mod worker;

use std::process::ExitCode;

use launch_cli::{Exit, Shutdown};
use sensor_camera::Quality;
use sensor_gpu::{CopyPath, Gpu, GpuOptions};
use simd_frames::gpu_end::of_gpu;
use simd_frames::topic::Transfer;

use worker::{Drawing, Ended};

/// The program.
pub fn main() -> ExitCode {
    launch_cli::run(|args: cli::Args| {
        args.common.init_logging();
        let shutdown = Shutdown::install()?;
        if let Err(error) = launch_cli::raise_file_limit() {
            tracing::warn!(%error, "the limit of open files stays as it is; many cameras may not fit");
        }
        run(&args, &shutdown).map_err(of_gpu)?;
        Ok(Exit::Done)
    })
}

fn run(args: &cli::Args, shutdown: &Shutdown) -> anyhow::Result<()> {
    let options = GpuOptions {
        adapter: args.adapter.clone(),
        allow_import: !args.staged,
        copies: match args.one_queue {
            true => CopyPath::Behind,
            false => CopyPath::Beside,
        },
    };
    let gpu = Gpu::open(&options)?;
    let quality = match args.quality {
        Some(cli::QualityArg::Low) => Quality::Low,
        Some(cli::QualityArg::High) => Quality::High,
        None => Quality::default_for(&gpu),
    };
    let transfer = match args.staged {
        true => Transfer::Staged,
        false => Transfer::Imported,
    };
    let name = args
        .name
        .clone()
        .unwrap_or_else(|| format!("render-{}", std::process::id()));
    tracing::info!(name, adapter = gpu.name(), ?quality, "rendering");
    let drawing = Drawing {
        gpu,
        quality,
        transfer,
        name,
        weight: args.weight,
    };
    // One simulator after the other.
    loop {
        match worker::follow(&args.common.domain, &drawing, shutdown)? {
            Ended::Simulator => {
                tracing::info!("the simulator is gone; waiting for the next one");
            }
            Ended::Asked => return Ok(()),
        }
    }
}
