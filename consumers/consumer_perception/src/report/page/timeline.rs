//! The time line: which frames there were, which of them each program took, how long it worked on
//! them and when its results came.

use std::fmt::Write as _;

use super::latency;
use crate::capture::Mode;
use crate::report::types::{Report, ResultEvent, Run, ScenarioRun};
use consumer_report::numbers::number;
use consumer_report::page::{Cell, Head, Table, details};
use consumer_report::plot::{Axis, N_COLOURS};
use consumer_report::words::{escape, shortened};

/// Frames that are shown, of the slowest sensor.
const N_FRAMES: usize = 20;
/// Most programs of a time line.
const MAX_RUNS: usize = 16;

const WIDTH: f64 = 1140.0;
const LEFT: f64 = 150.0;
const BAND: f64 = 64.0;
const HEAD: f64 = 6.0;
const FOOT: f64 = 40.0;
/// Height of a bar, and of one below another.
const BAR: f64 = 8.0;
const N_LANES: usize = 3;
/// Longest name of a run, characters.
const NAME_LENGTH: usize = 18;

/// The section: a time line for every scenario that was run in real time.
pub fn section(report: &Report) -> String {
    let mut html = String::from(
        "<section><h2 id=\"timeline\">Timeline</h2>\n<p class=\"soft\">A few frames from the middle of a scenario. Every upright mark is a frame of the sensor, a pale one is a frame that never got an answer. A bar begins where the program took the frame and ends where it published the result.</p>\n",
    );
    let mut n_shown = 0;
    for scenario in &report.scenarios {
        let runs: Vec<(&Run, &ScenarioRun)> = report
            .runs
            .iter()
            .filter(|run| run.mode == Mode::Streaming)
            .filter_map(|run| {
                Some((
                    run,
                    run.scenarios
                        .iter()
                        .find(|it| it.scenario == scenario.name)?,
                ))
            })
            .take(MAX_RUNS)
            .collect();
        let Some((from, to)) = window(&runs) else {
            continue;
        };
        let plot = svg(report, &scenario.name, &runs, from, to);
        let text = format!(
            "<div class=\"wide\">{plot}</div>\n{}",
            values(&runs, from, to)
        );
        n_shown += 1;
        html += &if n_shown == 1 {
            format!("<h3>{}</h3>\n{text}", escape(&scenario.name))
        } else {
            details(&scenario.name, &text)
        };
    }
    if n_shown == 0 {
        html += "<p>No run in real time has a result.</p>\n";
    }
    html + "</section>\n"
}

/// The time that is shown: about [`N_FRAMES`] frames in the middle of what all runs have.
fn window(runs: &[(&Run, &ScenarioRun)]) -> Option<(f64, f64)> {
    let gaps = runs.iter().filter_map(|(_, it)| median_gap(&frames(it)));
    let gap = gaps.reduce(f64::max)?;
    let with_events = runs.iter().filter(|(_, it)| !it.events.is_empty());
    let begin = with_events
        .clone()
        .filter_map(|(_, it)| {
            it.events
                .iter()
                .map(|event| event.frame_secs)
                .reduce(f64::min)
        })
        .fold(f64::INFINITY, f64::min);
    let end = with_events
        .filter_map(|(_, it)| {
            it.events
                .iter()
                .map(|event| event.frame_secs)
                .reduce(f64::max)
        })
        .fold(f64::NEG_INFINITY, f64::max);
    if !begin.is_finite() || gap.is_nan() || gap <= 0.0 {
        return None;
    }
    let length = gap * N_FRAMES as f64;
    let middle = f64::midpoint(begin, end);
    let from = (middle - length / 2.0).max(begin - gap / 2.0);
    Some((from, from + length))
}

/// The usual time between two frames, seconds.
fn median_gap(frames: &[f64]) -> Option<f64> {
    let mut gaps: Vec<f64> = frames.windows(2).map(|it| it[1] - it[0]).collect();
    gaps.sort_by(f64::total_cmp);
    gaps.get(gaps.len() / 2).copied()
}

/// Times of frames, those of the results if no others are known.
fn frames(run: &ScenarioRun) -> Vec<f64> {
    let mut secs = run.frame_secs.clone();
    if secs.is_empty() {
        secs = run.events.iter().map(|event| event.frame_secs).collect();
        secs.sort_by(f64::total_cmp);
        secs.dedup();
    }
    secs
}

fn svg(
    report: &Report,
    scenario: &str,
    runs: &[(&Run, &ScenarioRun)],
    from: f64,
    to: f64,
) -> String {
    let height = HEAD + runs.len() as f64 * BAND + FOOT;
    let ground = height - FOOT;
    let x = |secs: f64| LEFT + (secs - from) / (to - from) * (WIDTH - LEFT - 10.0);
    let mut svg = format!(
        "<svg role=\"img\" aria-label=\"{}\" viewBox=\"0 0 {WIDTH} {height:.0}\" width=\"{WIDTH}\" height=\"{height:.0}\">",
        escape(&format!("Frames and results of {scenario} over time"))
    );
    for (value, text) in Axis::linear("", from, to).ticks() {
        if *value < from || *value > to {
            continue;
        }
        let _ = write!(
            svg,
            "<line class=\"grid\" x1=\"{0:.1}\" y1=\"{HEAD}\" x2=\"{0:.1}\" y2=\"{ground:.1}\"/><text class=\"tick\" x=\"{0:.1}\" y=\"{1:.1}\" text-anchor=\"middle\">{text}</text>",
            x(*value),
            ground + 16.0
        );
    }
    let _ = write!(
        svg,
        "<text class=\"axis\" x=\"{:.0}\" y=\"{:.1}\" text-anchor=\"middle\">simulated time, s</text>",
        f64::midpoint(LEFT, WIDTH),
        height - 6.0
    );
    for (at, (run, of_run)) in runs.iter().enumerate() {
        let style = latency::style(report, run) % N_COLOURS;
        let top = HEAD + at as f64 * BAND;
        let shift = |secs: f64| x(secs.clamp(from, to));
        let _ = write!(svg, "<g class=\"s{style}\">");
        if at % 2 == 0 {
            let _ = write!(
                svg,
                "<rect class=\"band\" x=\"0\" y=\"{top:.1}\" width=\"{WIDTH}\" height=\"{BAND}\"/>"
            );
        }
        let _ = write!(
            svg,
            "<rect class=\"work\" x=\"4\" y=\"{:.1}\" width=\"9\" height=\"9\" rx=\"2\"/><text class=\"end\" x=\"19\" y=\"{:.1}\">{}</text>",
            top + 26.0,
            top + 35.0,
            escape(&shortened(&latency::name(run), NAME_LENGTH))
        );
        let events: Vec<&ResultEvent> = of_run
            .events
            .iter()
            .filter(|event| event.published_secs >= from && event.frame_secs <= to)
            .collect();
        for secs in frames(of_run)
            .into_iter()
            .filter(|secs| (from..=to).contains(secs))
        {
            let is_answered = of_run
                .events
                .iter()
                .any(|event| (event.frame_secs - secs).abs() < 1e-6);
            let class = if is_answered { "frame" } else { "unanswered" };
            let _ = write!(
                svg,
                "<line class=\"{class}\" x1=\"{0:.1}\" y1=\"{1:.1}\" x2=\"{0:.1}\" y2=\"{2:.1}\"/>",
                x(secs),
                top + 8.0,
                top + 18.0
            );
        }
        let mut lanes = [f64::NEG_INFINITY; N_LANES];
        for event in events {
            let free = lanes.iter().position(|end| *end <= event.taken_secs + 1e-9);
            let lane = free.unwrap_or(N_LANES - 1);
            lanes[lane] = event.published_secs;
            let y = top + 28.0 + lane as f64 * (BAR + 3.0);
            let (taken, published) = (shift(event.taken_secs), shift(event.published_secs));
            let note = format!(
                "frame {}: at {:.3} s, taken {:+.1} ms, published {:+.1} ms",
                event.seq,
                event.frame_secs,
                (event.taken_secs - event.frame_secs) * 1e3,
                (event.published_secs - event.frame_secs) * 1e3
            );
            let _ = write!(svg, "<g><title>{}</title>", escape(&note));
            if event.frame_secs >= from {
                let _ = write!(
                    svg,
                    "<line class=\"way\" x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{taken:.1}\" y2=\"{y:.1}\"/>",
                    x(event.frame_secs),
                    top + 18.0
                );
            }
            let _ = write!(
                svg,
                "<rect class=\"work\" x=\"{taken:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{BAR}\" rx=\"1.5\"/></g>",
                (published - taken).max(1.5)
            );
        }
        svg += "</g>";
    }
    svg + "</svg>\n"
}

fn values(runs: &[(&Run, &ScenarioRun)], from: f64, to: f64) -> String {
    let heads = vec![
        Head::words("run"),
        Head::new("frame"),
        Head::new("at, s"),
        Head::new("taken after, ms"),
        Head::new("published after, ms"),
    ];
    let mut table = Table::new("", heads);
    for (run, of_run) in runs {
        let shown = |event: &&ResultEvent| (from..=to).contains(&event.frame_secs);
        for event in of_run.events.iter().filter(shown) {
            table.row([
                Cell::from(latency::name(run)),
                event.seq.to_string().into(),
                format!("{:.3}", event.frame_secs).into(),
                number(Some((event.taken_secs - event.frame_secs) * 1e3)).into(),
                number(Some((event.published_secs - event.frame_secs) * 1e3)).into(),
            ]);
        }
    }
    details("Values", &table.html())
}
