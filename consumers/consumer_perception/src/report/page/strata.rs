//! Accuracy over parts of the truth: a plot for each that divides it, e.g. distance or light.

use crate::report::rows::{Line, TaskTable};
use crate::report::types::{Stratum, TaskScore};
use consumer_report::numbers::{NONE, grouped, number};
use consumer_report::page::{Cell, Head, Table, details};
use consumer_report::plot::{Axis, Scale, Series, lines};
use consumer_report::words::escape;

/// All plots of a task, each with its values.
pub fn sections(table: &TaskTable<'_>, styles: &[usize]) -> String {
    let scores = || table.lines.iter().filter_map(Line::score);
    let mut divisions: Vec<&str> = Vec::new();
    for stratum in scores().flat_map(|score| &score.strata) {
        if !divisions.contains(&stratum.by.as_str()) {
            divisions.push(&stratum.by);
        }
    }
    // What is asked for most comes first.
    let usual = ["distance_m", "occlusion", "speed_mps", "light"];
    divisions.sort_by_key(|by| usual.iter().position(|it| it == by).unwrap_or(usual.len()));
    divisions
        .iter()
        .map(|by| section(table, styles, by))
        .collect()
}

/// A division in words: `distance_m` is `distance, m`.
fn words(by: &str) -> String {
    let units = ["_mps", "_px", "_m", "_deg", "_percent"];
    let unit = units.iter().find(|unit| by.ends_with(*unit));
    let name = unit
        .map_or(by, |unit| by.trim_end_matches(unit))
        .replace('_', " ");
    match unit {
        None => name,
        Some(&"_mps") => format!("{name}, m/s"),
        Some(unit) => format!("{name}, {}", unit.trim_start_matches('_')),
    }
}

fn find<'a>(score: &'a TaskScore, by: &str, part: &str) -> Option<&'a Stratum> {
    score
        .strata
        .iter()
        .find(|it| it.by == by && it.part == part)
}

fn section(table: &TaskTable<'_>, styles: &[usize], by: &str) -> String {
    let mut parts: Vec<&str> = Vec::new();
    let scores = || table.lines.iter().filter_map(Line::score);
    for stratum in scores()
        .flat_map(|score| &score.strata)
        .filter(|it| it.by == by)
    {
        if !parts.contains(&stratum.part.as_str()) {
            parts.push(&stratum.part);
        }
    }
    // Offline values are those of the run in lockstep, if there is one.
    let offline = |line: &Line<'_>, part: &str| {
        let score = line.offline_score.or(line.streaming_score)?;
        find(score, by, part)?.offline
    };
    let streaming = |line: &Line<'_>, part: &str| find(line.streaming_score?, by, part)?.streaming;
    let n = |part: &str| {
        scores()
            .find_map(|score| Some(find(score, by, part)?.n))
            .unwrap_or(0)
    };
    let any = |of: &dyn Fn(&Line<'_>, &str) -> Option<f64>| {
        let values = table
            .lines
            .iter()
            .flat_map(|line| parts.iter().map(move |part| of(line, part)));
        values.flatten().collect::<Vec<f64>>()
    };
    let (of_offline, of_streaming) = (any(&offline), any(&streaming));
    let y = Axis::of_values(
        table.headline,
        of_offline.iter().chain(&of_streaming).copied(),
    );
    let plot = |title: &str, of: &dyn Fn(&Line<'_>, &str) -> Option<f64>| {
        // Without time all runs of a program are one.
        let is_first = |at: usize| {
            let of = |at: usize| table.lines[at].offline_score.map(std::ptr::from_ref);
            title != "offline" || of(at).is_none() || (0..at).all(|before| of(before) != of(at))
        };
        let ticks = parts.iter().enumerate();
        let ticks = ticks
            .map(|(at, part)| (at as f64, (*part).to_owned()))
            .collect();
        let last = parts.len() as f64 - 1.0;
        let x = Axis::with_ticks(&words(by), Scale::Linear, -0.4, last + 0.4, ticks);
        let series: Vec<Series> = table
            .lines
            .iter()
            .zip(styles)
            .enumerate()
            .filter(|(at, _)| is_first(*at))
            .map(|(_, (line, style))| {
                let known = parts.iter().enumerate();
                let known: Vec<(usize, &str, f64)> = known
                    .filter_map(|(at, part)| Some((at, *part, of(line, part)?)))
                    .collect();
                Series {
                    name: line.label.clone(),
                    style: *style,
                    points: known
                        .iter()
                        .map(|(at, _, value)| (*at as f64, *value))
                        .collect(),
                    notes: known
                        .iter()
                        .map(|(_, part, value)| {
                            format!("{}, {part}: {}", line.label, number(Some(*value)))
                        })
                        .collect(),
                    has_marks: true,
                    ..Series::default()
                }
            })
            .filter(|series| !series.points.is_empty())
            .collect();
        let label = format!(
            "{} of {} by {}, {title}",
            table.headline,
            table.task,
            words(by)
        );
        format!(
            "<section><h3>By {}, {title}</h3>\n{}</section>\n",
            escape(&words(by)),
            lines(&label, &x, &y, &series)
        )
    };
    let mut heads = vec![Head::words("program"), Head::words("mode")];
    heads.extend(parts.iter().map(|part| Head::new(*part)));
    let mut values = Table::new("", heads);
    let mut counts = vec![Cell::from("truths"), Cell::from("")];
    counts.extend(parts.iter().map(|part| Cell::from(grouped(n(part)))));
    values.row(counts);
    for (line, style) in table.lines.iter().zip(styles) {
        for (mode, of) in [
            (
                "offline",
                &offline as &dyn Fn(&Line<'_>, &str) -> Option<f64>,
            ),
            ("streaming", &streaming),
        ] {
            let cells: Vec<String> = parts.iter().map(|part| number(of(line, part))).collect();
            if cells.iter().any(|cell| cell != NONE) {
                let head = [
                    Cell::from(line.label.clone()).swatch(*style),
                    Cell::from(mode),
                ];
                values.row(head.into_iter().chain(cells.into_iter().map(Cell::from)));
            }
        }
    }
    let values = details(&format!("Values by {}", words(by)), &values.html());
    // One part alone is no comparison.
    if parts.len() < 2 {
        return values;
    }
    let mut plots = String::new();
    if !of_offline.is_empty() {
        plots += &plot("offline", &offline);
    }
    if !of_streaming.is_empty() {
        plots += &plot("streaming", &streaming);
    }
    if plots.is_empty() {
        return String::new();
    }
    format!("<div class=\"charts\">{plots}</div>\n{values}")
}

#[cfg(test)]
mod tests {
    use super::words;

    #[test]
    fn divisions_are_said_with_their_units() {
        assert_eq!(words("distance_m"), "distance, m");
        assert_eq!(words("speed_mps"), "speed, m/s");
        assert_eq!(words("time_of_day"), "time of day");
    }
}
