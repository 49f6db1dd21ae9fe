//! The report as one page of HTML. Beside every plot its values stand in a table.

use std::fmt::Write as _;
use std::path::Path;

use super::rows::{programs, tables, unanswered};
use super::types::Report;
use consumer_report::numbers::grouped;
use consumer_report::page;
use consumer_report::words::{anchor, escape};

mod about;
mod latency;
mod legend;
mod names;
mod pictures;
mod strata;
mod tasks;
mod timeline;

/// The page; pictures of worst frames are read from `folder`.
pub fn html(report: &Report, folder: &Path) -> String {
    let title = format!("Perception benchmark: {}", report.suite);
    let mut body = format!("<h1>{}</h1>\n", escape(&title));
    body += &figures(report);
    body += &contents(report);
    body += &warnings(report);
    let mut pictures = pictures::Pictures::new(folder);
    for table in tables(report) {
        body += &tasks::section(report, &table, &mut pictures);
    }
    let unanswered = unanswered(report);
    if !unanswered.is_empty() {
        let names = escape(&unanswered.join(", "));
        let _ = writeln!(
            body,
            "<p class=\"soft\">Not answered by any program: {names}.</p>"
        );
    }
    body += &latency::section(report);
    body += &timeline::section(report);
    body += &about::frames(report);
    body += &about::usage(report);
    body += &about::scenarios(report);
    body += &about::how(report);
    body += &about::words();
    page::document(&title, "", &body)
}

fn figures(report: &Report) -> String {
    let simulated: f64 = report.scenarios.iter().map(|it| it.secs).sum();
    let frames: u64 = report.runs.iter().map(|run| run.counts.n_frames).sum();
    let results: u64 = report.runs.iter().map(|run| run.counts.n_results).sum();
    let began = report.began.replace('T', " ");
    let rows = [
        ("programs", grouped(programs(report).len() as u64)),
        ("tasks", grouped(tables(report).len() as u64)),
        ("scenarios", grouped(report.scenarios.len() as u64)),
        ("simulated", format!("{simulated:.0} s")),
        ("frames shown", grouped(frames)),
        ("results", grouped(results)),
        ("date", began.get(..16).unwrap_or(&began).to_owned()),
        ("took", minutes(report.took_secs)),
    ];
    page::figures(rows)
}

fn minutes(secs: f64) -> String {
    if secs < 120.0 {
        format!("{secs:.0} s")
    } else {
        format!("{:.0} min", secs / 60.0)
    }
}

fn contents(report: &Report) -> String {
    let mut html = String::from("<nav aria-label=\"Contents\"><ul>");
    for table in tables(report) {
        let (id, name) = (anchor(table.task), escape(table.task));
        let _ = write!(html, "<li><a href=\"#task-{id}\">{name}</a></li>");
    }
    for (id, name) in [
        ("latency", "latency"),
        ("timeline", "timeline"),
        ("frames", "frames and results"),
        ("usage", "resources"),
        ("scenarios", "scenarios"),
        ("how", "how it was made"),
        ("words", "what the words mean"),
    ] {
        let _ = write!(html, "<li><a href=\"#{id}\">{name}</a></li>");
    }
    html + "</ul></nav>\n"
}

fn warnings(report: &Report) -> String {
    let of_runs = report.runs.iter().flat_map(|run| {
        run.faults
            .iter()
            .map(move |fault| format!("{}: {fault}", run.label()))
    });
    let all: Vec<String> = report.warnings.iter().cloned().chain(of_runs).collect();
    page::warnings(&all)
}
