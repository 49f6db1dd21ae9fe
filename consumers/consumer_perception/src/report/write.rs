//! The folder of a report: everything that is written at once, and how a report is read again.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use consumer_report::{Folder, FolderError};
use launch_cli::files::{MAX_NOTES_BYTES, read_text};
use launch_cli::wrong_usage;

use super::coco::CocoFiles;
use super::types::{REPORT_VERSION, Report, TaskScore};
use super::{bench, coco, page, ros2};

/// The report itself, within its folder.
pub const REPORT_FILE: &str = "report.json";
/// Its page.
const PAGE_FILE: &str = "report.html";

/// What is written beside the report but stands not in it.
#[derive(Clone, Debug, Default)]
pub struct Files {
    /// By task.
    pub coco: Vec<CocoFiles>,
}

/// What was written.
#[derive(Clone, Debug, Default)]
pub struct Written {
    /// The report.
    pub report: PathBuf,
    /// The page.
    pub page: PathBuf,
    /// Everything, these two among it.
    pub files: Vec<PathBuf>,
}

impl std::fmt::Display for Written {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{} and {} written, {} more files beside them",
            self.report.display(),
            self.page.display(),
            self.files.len() - 2
        )
    }
}

/// Writes a report into `folder`: `report.json`, `report.html`, `bench.json` (rows for tables),
/// `latency/*.hgrm`, `ros2_benchmark/*.json` and `coco/`. Pictures of worst frames must lie there
/// already.
///
/// # Errors
///
/// A file cannot be written.
pub fn write_all(report: &Report, folder: &Path, files: &Files) -> Result<Written, FolderError> {
    let mut out = Folder::make(folder)?;
    let mut report = report.clone();
    leave_out_what_is_no_number(&mut report);
    out.json(REPORT_FILE, &report)?;
    out.text(PAGE_FILE, &page::html(&report, folder))?;
    out.json("bench.json", &bench::value(&report))?;
    for run in &report.runs {
        for (kind, spread) in run.latency.named() {
            let name = format!("latency/{}-{kind}.hgrm", run.file_stem());
            out.percentiles(&name, spread)?;
        }
    }
    ros2::write(&report, &mut out)?;
    for set in &files.coco {
        coco::write(set, &mut out)?;
    }
    Ok(Written {
        report: folder.join(REPORT_FILE),
        page: folder.join(PAGE_FILE),
        files: out.into_written(),
    })
}

/// Reads a report from its file or its folder.
///
/// # Errors
///
/// There is none, it is no report, or of another version.
pub fn read(path: &Path) -> anyhow::Result<Report> {
    let path = if path.is_dir() {
        path.join(REPORT_FILE)
    } else {
        path.to_owned()
    };
    let name = path.display();
    let text = read_text(&path, MAX_NOTES_BYTES).map_err(|error| {
        wrong_usage(format!(
            "cannot read the report {name}: {error}; `gantry bench perception` writes one"
        ))
    })?;
    let no_report = |why: String| {
        wrong_usage(format!(
            "{name} is no report of the perception benchmark: {why}; it must be a report.json, or a folder with one"
        ))
    };
    let value: serde_json::Value =
        serde_json::from_str(&text).map_err(|error| no_report(error.to_string()))?;
    match value.get("version").and_then(serde_json::Value::as_u64) {
        Some(version) if version == u64::from(REPORT_VERSION) => {}
        Some(version) => {
            return Err(wrong_usage(format!(
                "{name} is a report of version {version}, this program reads version {REPORT_VERSION}; run the benchmark again, or use the gantry that wrote it"
            )));
        }
        None => return Err(no_report("it has no version".into())),
    }
    serde_json::from_value(value).map_err(|error| no_report(error.to_string()))
}

/// JSON has no NaN: metrics and points that are none are left out, with a warning.
fn leave_out_what_is_no_number(report: &mut Report) {
    let mut left_out: Vec<String> = Vec::new();
    for run in &mut report.runs {
        let label = run.label();
        let scores = run.scenarios.iter_mut().flat_map(|it| &mut it.scores);
        for score in scores.chain(&mut run.scores) {
            let mut names = clean(score);
            names.sort();
            names.dedup();
            for name in names {
                let text = format!("{label}, {} {name}", score.task);
                if !left_out.contains(&text) {
                    left_out.push(text);
                }
            }
        }
    }
    if !left_out.is_empty() {
        report.warnings.push(format!(
            "some values are no numbers and left out: {}",
            left_out.join("; ")
        ));
    }
}

fn clean(score: &mut TaskScore) -> Vec<String> {
    let mut names = Vec::new();
    let mut keep = |values: &mut BTreeMap<String, f64>| {
        values.retain(|name, value| {
            if !value.is_finite() {
                names.push(name.clone());
            }
            value.is_finite()
        });
    };
    keep(&mut score.offline);
    keep(&mut score.streaming);
    let n_points = score.curve.len();
    score
        .curve
        .retain(|it| it.value.is_finite() && it.delay_ms.is_finite());
    if score.curve.len() < n_points {
        names.push("delay curve".into());
    }
    for stratum in &mut score.strata {
        for value in [&mut stratum.offline, &mut stratum.streaming] {
            if value.is_some_and(|value| !value.is_finite()) {
                *value = None;
                names.push(format!("{} {}", stratum.by, stratum.part));
            }
        }
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::types::{CurvePoint, Stratum};

    #[test]
    fn what_is_no_number_is_left_out() {
        let mut score = TaskScore {
            offline: BTreeMap::from([("AP".into(), f64::NAN), ("AP50".into(), 0.5)]),
            curve: vec![CurvePoint {
                delay_ms: 0.0,
                value: f64::INFINITY,
            }],
            strata: vec![Stratum {
                by: "light".into(),
                part: "night".into(),
                n: 0,
                offline: Some(f64::NAN),
                streaming: None,
            }],
            ..TaskScore::default()
        };
        assert_eq!(clean(&mut score), ["AP", "delay curve", "light night"]);
        assert_eq!((score.offline.len(), score.curve.len()), (1, 0));
        assert_eq!(score.strata[0].offline, None);
        assert!(clean(&mut score).is_empty());
    }

    #[test]
    fn other_files_and_other_versions_are_refused_with_a_sentence() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("report.json");
        let said = |text: &str| {
            std::fs::write(&path, text).unwrap();
            read(folder.path()).unwrap_err().to_string()
        };
        assert!(said("[]").contains("it has no version"));
        assert!(said("{").contains("is no report of the perception benchmark"));
        assert!(said("{\"version\": 9}").contains("version 9, this program reads version 1"));
        assert!(said("{\"version\": 1}").contains("missing field"));
        let missing = read(&folder.path().join("x.json")).unwrap_err().to_string();
        assert!(missing.contains("cannot read the report"), "{missing}");
    }
}
