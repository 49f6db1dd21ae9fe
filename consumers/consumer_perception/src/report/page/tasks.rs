//! A task on the page: all programs in one table, the curve over added delay, parts of the truth,
//! every metric, every scenario, and the worst frames.

use std::collections::BTreeSet;

use super::names::style_of;
use super::pictures::Pictures;
use super::strata;
use crate::report::rows::{Line, TaskTable, best};
use crate::report::types::{Report, TaskScore};
use consumer_report::numbers::{grouped, number, percent};
use consumer_report::page::{Cell, Head, Table, details};
use consumer_report::plot::{Axis, N_COLOURS, Origin, Scale, Series, wide_lines};
use consumer_report::words::{anchor, escape};

/// The section of a task.
pub fn section(report: &Report, table: &TaskTable<'_>, pictures: &mut Pictures<'_>) -> String {
    let styles = styles(report, table);
    let better = if table.higher_is_better {
        "more"
    } else {
        "less"
    };
    let mut html = format!(
        "<section><h2 id=\"task-{}\">{}: {}</h2>\n<p class=\"soft\">{} is better. {} truths scored, {} left out by the task's rules.</p>\n",
        anchor(table.task),
        escape(table.task),
        escape(&headline(table)),
        if better == "more" { "More" } else { "Less" },
        grouped(table.n_scored),
        grouped(table.n_ignored),
    );
    html += &verdict(table);
    html += &summary(table, &styles);
    html += &curve(table, &styles);
    html += &strata::sections(table, &styles);
    html += &details("Every metric", &every_metric(table));
    html += &details("Every scenario", &every_scenario(table));
    html += &pictures.of_task(report, table.task);
    html + "</section>\n"
}

fn headline(table: &TaskTable<'_>) -> String {
    match table.unit {
        "" => table.headline.to_owned(),
        unit => format!("{} [{unit}]", table.headline),
    }
}

/// The style of each line.
fn styles(report: &Report, table: &TaskTable<'_>) -> Vec<usize> {
    let lines = &table.lines;
    (0..lines.len())
        .map(|at| {
            let before = lines[..at]
                .iter()
                .filter(|it| it.program == lines[at].program);
            let nth_run = before.count();
            // Of many programs some share a colour; those of one task shall not.
            let n_colours = N_COLOURS;
            if crate::report::rows::programs(report).len() <= n_colours {
                style_of(report, lines[at].program, nth_run)
            } else {
                let mut known: Vec<&str> = lines.iter().map(|it| it.program).collect();
                known.dedup();
                let place = known.iter().position(|it| *it == lines[at].program);
                let place = place.unwrap_or(0);
                place % n_colours + (place / n_colours + nth_run) * n_colours
            }
        })
        .collect()
}

/// Who is best without time and who in time, in a sentence.
fn verdict(table: &TaskTable<'_>) -> String {
    let best = |of: &dyn Fn(&Line<'_>) -> Option<f64>| {
        let lines = || table.lines.iter();
        let best = best(lines().filter_map(of), table.higher_is_better)?;
        lines().find_map(|line| Some((of(line).filter(|it| *it == best)?, line)))
    };
    let (Some((offline, first)), Some((streaming, second))) =
        (best(&|it| it.offline), best(&|it| it.streaming))
    else {
        return String::new();
    };
    let (a, b) = (escape(&first.label), escape(&second.label));
    let (offline, streaming) = (number(Some(offline)), number(Some(streaming)));
    let text = if first.label == second.label {
        format!(
            "<strong>{a}</strong> is best both without time ({offline}) and in real time ({streaming})."
        )
    } else {
        format!(
            "Without time <strong>{a}</strong> is best ({offline}); in real time <strong>{b}</strong> is ({streaming}), and {a} reaches {}.",
            number(first.streaming)
        )
    };
    format!("<p class=\"verdict\">{text}</p>\n")
}

fn summary(table: &TaskTable<'_>, styles: &[usize]) -> String {
    let heads = vec![
        Head::words("program"),
        Head::new("offline")
            .note("Each result against the truth of the frame it answers: accuracy without time"),
        Head::new("streaming").note("Truth at every query against the newest result then"),
        Head::new("+100 ms").note("Streaming, if every result had come 100 ms later"),
        Head::new("miss").note("Share of queries at which there was no result yet"),
        Head::new("in time").note("Share of queries whose newest result answers the newest frame"),
        Head::new("behind")
            .note("Frames that the newest result lags behind the newest frame, mean"),
        Head::new("p50 ms").note(
            "From the publication of the oldest frame behind the result to that of the result",
        ),
        Head::new("p99 ms"),
        Head::new("p99.9 ms"),
        Head::new("CPU").note("Processor time of the program per second"),
    ];
    let best = |of: &dyn Fn(&Line<'_>) -> Option<f64>| {
        let values = table.lines.iter().filter_map(of);
        best(values, table.higher_is_better)
    };
    let bests = [
        best(&|it| it.offline),
        best(&|it| it.streaming),
        best(&|it| it.delayed),
    ];
    let mut is_partial = false;
    let mut html = Table::new("", heads);
    for (line, style) in table.lines.iter().zip(styles) {
        let mark = line.offline_is_partial && line.offline.is_some();
        is_partial |= mark;
        let spread = line.latency().map(|it| &it.end_to_end);
        let values = [line.offline, line.streaming, line.delayed];
        let mut cells = vec![Cell::from(line.label.clone()).swatch(*style)];
        for (at, (value, best)) in values.into_iter().zip(bests).enumerate() {
            let star = if at == 0 && mark { "*" } else { "" };
            cells.push(Cell::from(number(value) + star).best(value.is_some() && value == best));
        }
        cells.extend(
            [
                percent(line.miss),
                percent(line.in_time),
                number(line.mismatch),
                number(spread.and_then(|it| it.shown_p50())),
                number(spread.and_then(|it| it.shown_p99())),
                number(spread.and_then(|it| it.shown_p999())),
                number(line.cpu_cores),
            ]
            .map(Cell::from),
        );
        html.row(cells);
    }
    let note =
        "<p class=\"soft\">* of a run in real time: only the frames that were answered.</p>\n";
    html.html() + if is_partial { note } else { "" }
}

/// The plot of the streaming value over added delay, with the offline value at its left.
fn curve(table: &TaskTable<'_>, styles: &[usize]) -> String {
    let with_curve: Vec<(&Line<'_>, &TaskScore, usize)> = table
        .lines
        .iter()
        .zip(styles)
        .filter_map(|(line, style)| Some((line, line.streaming_score?, *style)))
        .filter(|(_, score, _)| !score.curve.is_empty())
        .collect();
    if with_curve.is_empty() {
        return String::new();
    }
    let delays: Vec<f64> = with_curve
        .iter()
        .flat_map(|(_, score, _)| score.curve.iter().map(|it| it.delay_ms))
        .collect();
    let longest = delays.iter().copied().fold(1.0, f64::max);
    let apart = -0.09 * longest;
    let round = Axis::linear("", 0.0, longest);
    let mut ticks = vec![(apart, "offline".to_owned())];
    ticks.extend(
        round
            .ticks()
            .iter()
            .filter(|(at, _)| *at <= longest * 1.001)
            .cloned(),
    );
    let x = Axis::with_ticks(
        "added delay, ms",
        Scale::Linear,
        apart * 1.25,
        longest,
        ticks,
    );
    let values = with_curve.iter().flat_map(|(line, score, _)| {
        let points = score.curve.iter().map(|it| it.value);
        points.chain(line.offline)
    });
    let y = Axis::of_values(&headline(table), values);
    let series: Vec<Series> = with_curve
        .iter()
        .map(|(line, score, style)| Series {
            name: line.label.clone(),
            style: *style,
            points: score
                .curve
                .iter()
                .map(|it| (it.delay_ms, it.value))
                .collect(),
            origin: line.offline.map(|value| Origin {
                point: (apart, value),
                note: format!("{}, offline: {}", line.label, number(Some(value))),
            }),
            notes: score
                .curve
                .iter()
                .map(|it| {
                    format!(
                        "{}, +{} ms: {}",
                        line.label,
                        it.delay_ms,
                        number(Some(it.value))
                    )
                })
                .collect(),
            has_marks: true,
            is_stepped: false,
        })
        .collect();
    let label = format!("{} of {} over added delay", table.headline, table.task);
    let mut known: Vec<f64> = delays;
    known.sort_by(f64::total_cmp);
    known.dedup();
    let mut heads = vec![Head::words("program"), Head::new("offline")];
    heads.extend(known.iter().map(|delay| Head::new(format!("+{delay} ms"))));
    let mut values = Table::new("", heads);
    for (line, score, style) in &with_curve {
        let mut cells = vec![
            Cell::from(line.label.clone()).swatch(*style),
            number(line.offline).into(),
        ];
        let of = |delay: &f64| crate::report::rows::at_delay(score, *delay);
        cells.extend(known.iter().map(|delay| Cell::from(number(of(delay)))));
        values.row(cells);
    }
    format!(
        "<section><h3>Accuracy over added delay</h3>\n<p class=\"soft\">The step from a hollow mark (accuracy without time) to the begin of its line is what the program's own latency costs; how fast the line goes on from there, what more latency would cost.</p><div class=\"wide\">{}</div>\n{}</section>\n",
        wide_lines(&label, &x, &y, &series),
        details("Values", &values.html())
    )
}

fn every_metric(table: &TaskTable<'_>) -> String {
    let names: BTreeSet<&String> = table
        .lines
        .iter()
        .flat_map(|line| [line.offline_score, line.streaming_score])
        .flatten()
        .flat_map(|score| score.offline.keys().chain(score.streaming.keys()))
        .collect();
    let mut heads = vec![Head::words("metric")];
    for line in &table.lines {
        heads.push(Head::new(format!("{} offline", line.label)));
        if line.streaming_score.is_some() {
            heads.push(Head::new(format!("{} streaming", line.label)));
        }
    }
    let mut html = Table::new("", heads);
    for name in names {
        let mut cells = vec![Cell::from(name.as_str())];
        for line in &table.lines {
            let offline = line.offline_score.or(line.streaming_score);
            cells.push(number(offline.and_then(|it| it.offline.get(name).copied())).into());
            if let Some(score) = line.streaming_score {
                cells.push(number(score.streaming.get(name).copied()).into());
            }
        }
        html.row(cells);
    }
    html.html()
}

fn every_scenario(table: &TaskTable<'_>) -> String {
    let heads = vec![
        Head::words("program"),
        Head::words("scenario"),
        Head::new("offline"),
        Head::new("streaming"),
        Head::new("p50 ms"),
        Head::new("p99 ms"),
        Head::new("miss"),
        Head::new("behind"),
        Head::new("pace").note("Simulated seconds per second that were reached"),
    ];
    let mut html = Table::new("", heads);
    for line in &table.lines {
        let Some(run) = line.streaming_run.or(line.offline_run) else {
            continue;
        };
        for scenario in &run.scenarios {
            let score_in = |run: Option<&crate::report::types::Run>, topic: &str| {
                let one = run?
                    .scenarios
                    .iter()
                    .find(|it| it.scenario == scenario.scenario)?;
                let score = one
                    .scores
                    .iter()
                    .find(|it| it.task == table.task && it.topic == topic);
                score.cloned()
            };
            let topic = line.score().map_or("", |it| it.topic.as_str());
            let of = |run, values: fn(&TaskScore) -> &std::collections::BTreeMap<String, f64>| {
                values(&score_in(run, topic)?).get(table.headline).copied()
            };
            let offline = of(line.offline_run, |it| &it.offline);
            let offline = offline.or_else(|| of(line.streaming_run, |it| &it.offline));
            let counts = &scenario.counts;
            let share = |n: u64, all: u64| (all > 0).then(|| n as f64 / all as f64);
            let spread = Some(&scenario.latency.end_to_end);
            let spread = spread.filter(|it| it.n > 0 && line.streaming_run.is_some());
            html.row([
                Cell::from(line.label.clone()),
                scenario.scenario.clone().into(),
                number(offline).into(),
                number(of(line.streaming_run, |it| &it.streaming)).into(),
                number(spread.and_then(|it| it.shown_p50())).into(),
                number(spread.and_then(|it| it.shown_p99())).into(),
                percent(share(counts.miss, counts.n_queries)).into(),
                number(share(
                    counts.mismatch,
                    counts.n_queries.saturating_sub(counts.miss),
                ))
                .into(),
                number(scenario.pace).into(),
            ]);
        }
    }
    html.html()
}
