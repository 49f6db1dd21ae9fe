//! `gantry-bench report`: builds the tables of the benchmark pages from the results in `raw/`.
//!
//! `tables.toml` says which figure stands where, pages mark where each table goes. A page can thus
//! show no figure that no result has, and a goal is met or missed by comparison.

mod cell;
mod figures;
mod region;
mod table;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use launch_cli::Exit;
use launch_cli::files::{MAX_NOTES_BYTES, read_text};

use figures::Figures;

#[derive(Debug, clap::Args)]
pub struct ReportArgs {
    /// Folder of the pages, with `tables.toml` and `raw/`
    #[arg(long, value_name = "DIR", default_value = "docs/benchmarks")]
    pages: PathBuf,

    /// Change nothing; fail if a page differs from its results
    #[arg(long)]
    check: bool,
}

/// A page whose tables differ from the results.
struct Change {
    path: PathBuf,
    text: String,
}

/// Fills the tables of all pages, or only compares them.
pub fn run(args: &ReportArgs) -> anyhow::Result<Exit> {
    let changes = changes(&args.pages)?;
    for change in &changes {
        if args.check {
            println!("{} differs from its results", change.path.display());
        } else {
            std::fs::write(&change.path, &change.text)
                .with_context(|| format!("cannot write {}", change.path.display()))?;
            println!("{} written", change.path.display());
        }
    }
    if changes.is_empty() {
        println!("all pages agree with their results");
    } else if args.check {
        println!("`gantry-bench report` writes them again");
        return Ok(Exit::Failed);
    }
    Ok(Exit::Done)
}

/// Pages that would change. Every table and every result must be used by a page.
fn changes(folder: &Path) -> anyhow::Result<Vec<Change>> {
    ensure!(
        folder.join("tables.toml").exists(),
        "{} has no tables.toml; run this in the root of the repository, or say --pages DIR",
        folder.display()
    );
    let figures = Figures::read(&folder.join("raw"))?;
    let description = folder.join("tables.toml");
    let text = read_text(&description, MAX_NOTES_BYTES)
        .with_context(|| format!("cannot read {}", description.display()))?;
    let tables = table::parse(&text)?;
    let mut pages: Vec<PathBuf> = std::fs::read_dir(folder)?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|end| end == "md"))
        .collect();
    pages.sort();
    let mut changes = Vec::new();
    let (mut shown, mut used) = (BTreeSet::new(), BTreeSet::new());
    for path in pages {
        let page = read_text(&path, MAX_NOTES_BYTES)
            .with_context(|| format!("cannot read {}", path.display()))?;
        let text = region::fill(&page, |name| {
            shown.insert(name.to_owned());
            tables
                .get(name)
                .context("tables.toml does not describe it")?
                .markdown(&figures, &mut used)
        })
        .with_context(|| format!("{}", path.display()))?;
        if text != page {
            changes.push(Change { path, text });
        }
    }
    let not_shown: Vec<&String> = tables
        .keys()
        .filter(|name| !shown.contains(*name))
        .collect();
    ensure!(
        not_shown.is_empty(),
        "no page shows the tables {not_shown:?}"
    );
    let not_used: Vec<&str> = figures
        .names()
        .filter(|name| !used.contains(*name))
        .collect();
    ensure!(
        not_used.is_empty(),
        "no table uses the results {not_used:?}"
    );
    Ok(changes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_agree_with_their_results() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/benchmarks");
        let changes = changes(&folder).unwrap_or_else(|error| panic!("{error:#}"));
        let paths: Vec<&PathBuf> = changes.iter().map(|change| &change.path).collect();
        assert!(paths.is_empty(), "run `./gantry bench report`: {paths:?}");
    }
}
