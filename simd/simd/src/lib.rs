//! `simd`: owns the world and the clock, renders the sensors, and writes their frames into shared
//! memory.
//!
//! The modules in reading order: `settings` say what is asked, `setup` brings it up as a `daemon`, and
//! the `tick_loop` says in which order the daemon's steps are made. The daemon has no state but its
//! parts, each with fields of its own: the `world` with its map and episode; `sensing`, what sensors
//! see and which process makes their frames; the `ports` for all that is no frame; the `clock`; the
//! `participants` that ticks wait for; the `history` of what acted; the `files` that commands name, on
//! a thread beside the ticks; and the `faults` that it met. `commands` are handed the parts that they
//! touch.

mod clock;
mod commands;
mod daemon;
mod faults;
mod files;
mod history;
mod participants;
mod ports;
mod sensing;
mod settings;
mod setup;
mod tick_loop;
mod world;

use std::io::Write as _;
use std::process::ExitCode;

use anyhow::Context as _;
use launch_cli::{Exit, Shutdown};
use sensor_gpu::Gpu;

// Journals come from recordings of others, so their reader is tried beside the daemon.
pub use history::{Act, Entry, JournalReader, Stretch};
use settings::{Settings, cli};
use world::maps::Maps;

/// The program `simd`, from its arguments to its exit code.
pub fn main() -> ExitCode {
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
        tick_loop::run(setup::start(Settings::resolve(&args)?)?, &shutdown)?;
        Ok(Exit::Done)
    })
}

/// `--export-map`: writes the map's OpenDRIVE text.
fn export_map(args: &cli::Args, file: &std::path::Path) -> anyhow::Result<Exit> {
    let settings = Settings::resolve(args)?;
    let scenario = &settings.launch.scenario;
    let maps = Maps::new(&settings.data_folder, settings.launch_folder.clone());
    let text = maps.text(&scenario.map, scenario.seed)?;
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
                serde_json::json!({ "index": adapter.index, "uuid": adapter.uuid, "name": adapter.name, "software": adapter.is_software, "driver": adapter.driver, "import": adapter.can_import })
            );
        } else {
            let import = if adapter.can_import {
                "writes into shared memory"
            } else {
                "needs one copy per frame"
            };
            println!(
                "{} {} {} ({}): {import}",
                adapter.index, adapter.uuid, adapter.name, adapter.driver
            );
        }
    }
    Ok(if adapters.is_empty() {
        Exit::Failed
    } else {
        Exit::Done
    })
}
