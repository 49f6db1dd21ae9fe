//! The report as one page of HTML that needs nothing from elsewhere: plots are SVG, pictures stand
//! within it, and there is no script. Beside every plot its values stand in a table.

use std::fmt::Write as _;
use std::path::Path;

use super::plot::escape;
use super::rows::{grouped, programs, tables, unanswered};
use super::types::Report;

mod about;
mod latency;
mod legend;
mod names;
mod pictures;
mod strata;
mod style;
mod table;
mod tasks;
mod timeline;

use names::anchor;
pub use style::STYLE;
pub use table::{Cell, Head, Table, details};

/// What the browser must never fetch: anything.
const POLICY: &str = "default-src 'none'; img-src data:; style-src 'unsafe-inline'";

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
    document(&title, &body)
}

/// A whole document with the style of the page.
pub fn document(title: &str, body: &str) -> String {
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
         <title>{}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n{body}</body>\n</html>\n",
        escape(title)
    )
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
    let mut html = String::from("<dl class=\"figures\">");
    for (name, value) in rows {
        let _ = write!(
            html,
            "<div><dt>{name}</dt><dd>{}</dd></div>",
            escape(&value)
        );
    }
    html + "</dl>\n"
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
    if all.is_empty() {
        return String::new();
    }
    let mut html = String::from(
        "<div class=\"warnings\" role=\"note\"><strong>Read before you believe a figure</strong><ul>",
    );
    for one in all {
        let _ = write!(html, "<li>{}</li>", escape(&one));
    }
    html + "</ul></div>\n"
}
