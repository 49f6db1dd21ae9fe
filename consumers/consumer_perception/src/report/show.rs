//! `gantry bench show`: the tables of a report again, its files again, and the schema of reports.

use std::path::PathBuf;

use launch_cli::{ColorWhen, Exit, wrong_usage};

use super::{Files, read, schema, terminal, write_all};

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

    /// Write everything that is made from the report into this folder; pictures are taken from it
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
    print!("{}", terminal(&report, terminal::colours(color)));
    if let Some(folder) = &args.to {
        println!("\n{}", write_all(&report, folder, &Files::default())?);
    }
    Ok(Exit::Done)
}
