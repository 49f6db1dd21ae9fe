//! The OpenDRIVE text of a map: from a file, or from the daemon by name.

use std::path::Path;

use anyhow::Context as _;
use launch_cli::files::{open_plain, read_plain};
use launch_cli::wrong_usage;
use schema_roads::MAX_TEXT_BYTES;

use super::refusal::Refusal;
use crate::programs;

/// The OpenDRIVE text of a map by name. The daemon is asked, which knows the towns and the map
/// folder.
pub fn text_of_name(name: &str, data: Option<&Path>, seed: u64) -> anyhow::Result<String> {
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

/// The text of a file that is not too long.
pub fn text_of_file(path: &Path) -> Result<String, Refusal> {
    let (_, n_bytes) = open_plain(path).map_err(Refusal::Unreadable)?;
    if n_bytes > MAX_TEXT_BYTES as u64 {
        return Err(Refusal::TooLarge { n_bytes });
    }
    let bytes = read_plain(path, MAX_TEXT_BYTES as u64).map_err(Refusal::Unreadable)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}
