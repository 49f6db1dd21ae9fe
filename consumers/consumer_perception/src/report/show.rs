//! `gantry bench show`: the tables of a report again, its files again, and the schema of reports.

use std::path::{Component, Path, PathBuf};

use anyhow::Context as _;
use launch_cli::{ColorWhen, Exit, wrong_usage};

use super::types::Report;
use super::write::{Files, read, write_all};
use super::{schema, terminal};

const EXAMPLES: &str = "Examples:
  gantry bench show report.json                 the tables again
  gantry bench show report.json --to again      page, .hgrm and all other files again
  gantry bench show --schema                    the JSON schema of report.json";

/// Tables and page of a report again
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct ShowArgs {
    /// The report: report.json or its folder
    #[arg(value_name = "REPORT.json")]
    pub report: Option<PathBuf>,

    /// Write everything that is made from the report into this folder, with its pictures
    #[arg(long, value_name = "DIR")]
    pub to: Option<PathBuf>,

    /// Print the JSON schema of report.json
    #[arg(long, conflicts_with_all = ["report", "to"])]
    pub schema: bool,
}

/// Prints a report's tables, and writes its files again if asked for.
///
/// # Errors
///
/// The file is no report, or a file cannot be written.
pub fn run(args: &ShowArgs, color: ColorWhen) -> anyhow::Result<Exit> {
    if args.schema {
        print!("{}", schema::text());
        return Ok(Exit::Done);
    }
    let path = args.report.as_ref().ok_or_else(|| {
        wrong_usage("which report? say its report.json or its folder, or --schema for the schema")
    })?;
    let report = read(path)?;
    print!("{}", terminal::terminal(&report, terminal::colours(color)));
    if let Some(folder) = &args.to {
        copy_pictures(&report, path, folder)?;
        println!("\n{}", write_all(&report, folder, &Files::default())?);
    }
    Ok(Exit::Done)
}

/// Copies the pictures of worst frames that lie beside the report; those that are not there are left
/// out, as they are on the page.
fn copy_pictures(report: &Report, path: &Path, to: &Path) -> anyhow::Result<()> {
    let from = if path.is_dir() {
        path
    } else {
        path.parent().unwrap_or(path)
    };
    let frames = report
        .runs
        .iter()
        .flat_map(|run| &run.scenarios)
        .flat_map(|it| &it.worst);
    for name in frames.flat_map(|frame| [&frame.truth_image, &frame.result_image]) {
        let name = Path::new(name);
        let is_inside = name
            .components()
            .all(|part| matches!(part, Component::Normal(_)));
        let (source, target) = (from.join(name), to.join(name));
        if !is_inside || !source.is_file() || source == target {
            continue;
        }
        std::fs::create_dir_all(target.parent().unwrap_or(to))
            .and_then(|()| std::fs::copy(&source, &target))
            .with_context(|| format!("cannot copy {} to {}", source.display(), target.display()))?;
    }
    Ok(())
}
