//! `gantry-record convert`: hands a recording to the viewer's program, which writes it in rerun's
//! format with the viewer's own drawing.

use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, ensure};

/// The program that knows rerun.
const VIEWER: &str = "gantry-view";

/// Writes `input` as the rerun recording `output`.
///
/// # Errors
/// If `output` is no `.rrd` or exists, or the viewer is missing or fails.
pub fn convert(input: &Path, output: &Path) -> anyhow::Result<()> {
    ensure!(
        output.extension().is_some_and(|it| it == "rrd"),
        "{} must end in .rrd, the only format that recordings are converted to; for data sets see gantry export",
        output.display()
    );
    ensure!(
        !output.exists(),
        "{} exists already; choose another name or remove it first",
        output.display()
    );
    launch_cli::files::open_plain(input)
        .with_context(|| format!("cannot open {}", input.display()))?;
    // Beside this program as installed, else wherever programs are looked for.
    let beside = std::env::current_exe()
        .ok()
        .map(|own| own.with_file_name(VIEWER))
        .filter(|path| path.is_file());
    let program = beside.unwrap_or_else(|| VIEWER.into());
    let status = Command::new(&program)
        .arg("--convert")
        .args([input, output])
        .status()
        .with_context(|| {
            format!("cannot start {VIEWER}, which converts to rerun's format; install it beside gantry-record")
        })?;
    ensure!(
        status.success(),
        "{VIEWER} could not convert {}",
        input.display()
    );
    Ok(())
}
