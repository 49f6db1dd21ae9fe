//! `gantry map`: reads OpenDRIVE files as the simulator does, says what is in them, and compares
//! with CARLA's client.

mod carla;
mod check;
mod compare;
mod report;

use anyhow::Context as _;
use launch_cli::{CommonArgs, Exit, wrong_usage};

use crate::cli::{ExportArgs, MapArgs, MapWord};
use crate::programs;

/// Runs the word.
pub fn run(args: &MapArgs, _: &CommonArgs) -> anyhow::Result<Exit> {
    match &args.word {
        MapWord::Check(args) => check::run(args),
        MapWord::Export(args) => export(args),
    }
}

/// The OpenDRIVE text of a name: the daemon knows its towns and the map folder.
fn text_of_name(name: &str, data: Option<&std::path::Path>, seed: u64) -> anyhow::Result<String> {
    let simd = programs::find("simd")?;
    let mut command = std::process::Command::new(simd);
    command.args([
        "--map",
        name,
        "--set",
        &format!("scenario.seed={seed}"),
        "--export-map",
        "-",
    ]);
    if let Some(data) = data {
        command.arg("--data").arg(data);
    }
    let output = command.output().context("cannot start simd")?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        let sentence = said
            .lines()
            .find_map(|line| line.split_once("error: "))
            .map_or(said.trim(), |(_, sentence)| sentence);
        return Err(wrong_usage(sentence.to_owned()));
    }
    String::from_utf8(output.stdout)
        .with_context(|| format!("the text of map {name:?} is not UTF-8"))
}

fn export(args: &ExportArgs) -> anyhow::Result<Exit> {
    let text = text_of_name(&args.name, args.data.as_deref(), args.seed)?;
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
