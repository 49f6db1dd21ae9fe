//! Worst frames on the page: the truth and the result side by side, as pictures within the page.

use std::fmt::Write as _;
use std::path::{Component, Path};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use consumer_report::words::escape;

use super::legend::legend;
use crate::capture::Mode;
use crate::report::types::{Report, Run, WorstFrame};

/// Most worst frames of a run and task; the others stay beside the report.
const MAX_OF_RUN: usize = 2;
/// Most bytes of pictures within a page.
const MAX_BYTES: usize = 24 << 20;

/// Pictures of a report's folder, as many as a page can hold.
#[derive(Debug)]
pub struct Pictures<'a> {
    folder: &'a Path,
    n_bytes: usize,
}

impl<'a> Pictures<'a> {
    /// None is read yet.
    pub fn new(folder: &'a Path) -> Pictures<'a> {
        Pictures { folder, n_bytes: 0 }
    }

    /// The worst frames of a task, the worst of each run first.
    pub fn of_task(&mut self, report: &Report, task: &str) -> String {
        let mut sheet = String::new();
        let mut n_left = 0;
        for run in report.runs.iter().filter(|run| run.mode != Mode::Stress) {
            let frames = in_turn(run, task);
            n_left += frames.len().saturating_sub(MAX_OF_RUN);
            for (scenario, frame) in frames.into_iter().take(MAX_OF_RUN) {
                match self.figure(run, scenario, frame) {
                    Some(figure) => sheet += &figure,
                    None => n_left += 1,
                }
            }
        }
        if sheet.is_empty() {
            return String::new();
        }
        let more = match n_left {
            0 => String::new(),
            n => format!(
                "<p class=\"soft\">{n} more stand in report.json, their pictures beside it.</p>\n"
            ),
        };
        format!(
            "<h3>Worst frames</h3>\n{}<div class=\"sheet\">\n{sheet}</div>\n{more}",
            legend(report, task)
        )
    }

    fn figure(&mut self, run: &Run, scenario: &str, frame: &WorstFrame) -> Option<String> {
        let [truth, result] = [&frame.truth_image, &frame.result_image].map(|name| self.data(name));
        if truth.is_none() && result.is_none() {
            return None;
        }
        let label = run.label();
        let mut html = String::from("<figure><div class=\"pair\">");
        for (what, data) in [("truth", truth), ("result", result)] {
            let alt = format!("{what}, {label}, {scenario} at {:.2} s", frame.secs);
            let _ = match data {
                Some(data) => write!(
                    html,
                    "<div><img alt=\"{}\" loading=\"lazy\" src=\"data:image/jpeg;base64,{data}\"><span>{what}</span></div>",
                    escape(&alt)
                ),
                None => write!(html, "<div><span>{what}: no picture</span></div>"),
            };
        }
        let _ = writeln!(
            html,
            "</div><figcaption><strong>{}</strong> · {} · {:.2} s<br>{}</figcaption></figure>",
            escape(&label),
            escape(scenario),
            frame.secs,
            escape(&frame.why)
        );
        Some(html)
    }

    /// A picture as base64. Only files within the folder are read.
    fn data(&mut self, name: &str) -> Option<String> {
        let path = Path::new(name);
        let is_inside = path
            .components()
            .all(|part| matches!(part, Component::Normal(_)));
        if name.is_empty() || !is_inside {
            return None;
        }
        let path = self.folder.join(path);
        let left = MAX_BYTES.checked_sub(self.n_bytes)?;
        let bytes = launch_cli::files::read_plain(&path, left as u64).ok()?;
        self.n_bytes += bytes.len();
        bytes
            .starts_with(&[0xff, 0xd8])
            .then(|| STANDARD.encode(bytes))
    }
}

/// Worst frames of a run: the first of every scenario, then the second of every one.
fn in_turn<'r>(run: &'r Run, task: &str) -> Vec<(&'r str, &'r WorstFrame)> {
    let by_scenario: Vec<Vec<(&str, &WorstFrame)>> = run
        .scenarios
        .iter()
        .map(|one| {
            let frames = one.worst.iter().filter(|frame| frame.task == task);
            frames.map(|frame| (one.scenario.as_str(), frame)).collect()
        })
        .collect();
    let most = by_scenario.iter().map(Vec::len).max().unwrap_or(0);
    (0..most)
        .flat_map(|at| {
            by_scenario
                .iter()
                .filter_map(move |frames| frames.get(at).copied())
        })
        .collect()
}
