//! `gantry map`: reads OpenDRIVE files as the simulator does, says what is in them, compares with
//! CARLA's client, and takes them into the data folder.

mod check;
mod client;
mod compare;
mod import;
mod refusal;
mod report;
mod source;

use anyhow::Context as _;
use launch_cli::{CommonArgs, Exit};

use crate::cli::{ExportArgs, MapArgs, MapWord};

/// Runs `gantry map`.
pub fn run(args: &MapArgs, common: &CommonArgs) -> anyhow::Result<Exit> {
    match &args.word {
        MapWord::Check(args) => check::run(args, common),
        MapWord::Import(args) => import::run(args, common),
        MapWord::Export(args) => export(args),
    }
}

fn export(args: &ExportArgs) -> anyhow::Result<Exit> {
    let text = source::text_of_name(&args.name, args.data.as_deref(), args.seed)?;
    std::fs::write(&args.file, &text)
        .with_context(|| format!("cannot write {}", args.file.display()))?;
    println!(
        "{}: {} bytes of map {}",
        args.file.display(),
        text.len(),
        args.name
    );
    Ok(Exit::Done)
}
