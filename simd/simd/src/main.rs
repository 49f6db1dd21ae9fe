//! `simd`: owns the world and the clock, renders the sensors, and writes their frames into shared
//! memory.

mod checkpoints;
mod cli;
mod commands;
mod daemon;
mod debug_shapes;
mod documents;
mod frames;
mod gate;
mod hash;
mod import;
mod maps;
mod pace;
mod queries;
mod rig;
mod runtime;
mod scene;
mod setup;

use std::io::Write as _;
use std::process::ExitCode;

use anyhow::Context as _;

use launch_cli::{Exit, Shutdown};
use sensor_gpu::Gpu;

fn main() -> ExitCode {
    launch_cli::run(|args: cli::Args| {
        args.common.init_logging();
        if args.adapters {
            return list_adapters(args.json);
        }
        if let Some(file) = &args.export_map {
            return export_map(&args, file);
        }
        let shutdown = Shutdown::install()?;
        if let Err(error) = launch_cli::raise_file_limit() {
            tracing::warn!(%error, "the limit of open files stays as it is; many sensors may not fit");
        }
        setup::start(args, shutdown)?.run()?;
        Ok(Exit::Done)
    })
}

/// `--export-map`: the text and nothing else.
fn export_map(args: &cli::Args, file: &std::path::Path) -> anyhow::Result<Exit> {
    let launch = setup::read_launch(args)?;
    let maps = maps::Maps::new(
        &launch_cli::data_dir(args.data.as_deref())?,
        args.launch.as_deref(),
    );
    let text = maps.text(&launch.scenario.map, launch.scenario.seed)?;
    if file.as_os_str() == "-" {
        std::io::stdout().write_all(text.as_bytes())?;
    } else {
        std::fs::write(file, &text).with_context(|| format!("cannot write {}", file.display()))?;
    }
    Ok(Exit::Done)
}

/// `--adapters`: one line, or one JSON object, per GPU.
fn list_adapters(json: bool) -> anyhow::Result<Exit> {
    let adapters = Gpu::adapters();
    for adapter in &adapters {
        if json {
            println!(
                "{}",
                serde_json::json!({ "name": adapter.name, "software": adapter.is_software, "driver": adapter.driver, "import": adapter.can_import })
            );
        } else {
            let import = if adapter.can_import {
                "writes into shared memory"
            } else {
                "needs one copy per frame"
            };
            println!("{} ({}): {import}", adapter.name, adapter.driver);
        }
    }
    Ok(if adapters.is_empty() {
        Exit::Failed
    } else {
        Exit::Done
    })
}
