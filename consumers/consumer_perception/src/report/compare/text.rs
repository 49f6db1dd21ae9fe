//! A comparison on a terminal: a table per run, and what must be known to read it.

use std::fmt::Write as _;

use super::change::{Change, Comparison, Verdict};
use crate::report::terminal::WIDTH;
use consumer_report::numbers::number;
use consumer_report::terminal::{Mark, Paint};
use consumer_report::words::{shortened, wrapped};

/// The comparison as text of at most [`WIDTH`] columns.
pub fn text(it: &Comparison, colour: bool) -> String {
    let paint = Paint { is_on: colour };
    let suite = if it.suites[0] == it.suites[1] {
        it.suites[0].clone()
    } else {
        it.suites.join(" and ")
    };
    let mut text = format!(
        "suite {suite}, {}; B − A over scenarios, {:.0} % intervals ({} resamples, seed {})\n",
        match it.scenarios.len() {
            1 => "1 scenario".into(),
            n => format!("{n} scenarios, paired"),
        },
        it.confidence * 100.0,
        it.resamples,
        it.seed
    );
    let mut runs: Vec<&str> = Vec::new();
    for change in &it.changes {
        if !runs.contains(&change.run.as_str()) {
            runs.push(&change.run);
        }
    }
    for run in runs {
        let of_run = || it.changes.iter().filter(|change| change.run == run);
        let name_width = of_run()
            .map(|it| name(it).chars().count())
            .max()
            .unwrap_or(0)
            .clamp(20, 40);
        let _ = writeln!(text, "\n{}", paint.set(Mark::Bold, run));
        let head = format!(
            "{:<name_width$}  {:>8}  {:>8}  {:>8}  {:>19}",
            "", "A", "B", "B − A", "interval"
        );
        let _ = writeln!(text, "{}", paint.set(Mark::Soft, &head));
        for change in of_run() {
            let interval = change.interval.map_or("none".into(), |[low, high]| {
                format!("{} … {}", signed(low), signed(high))
            });
            let line = format!(
                "{:<name_width$}  {:>8}  {:>8}  {:>8}  {interval:>19}  {}",
                shortened(&name(change), name_width),
                number(Some(change.a)),
                number(Some(change.b)),
                signed(change.difference),
                word(change.verdict)
            );
            let line = line.trim_end();
            let line = match change.verdict {
                Verdict::Better => paint.set(Mark::Good, line),
                Verdict::Worse => paint.set(Mark::Bad, line),
                Verdict::Changed => paint.set(Mark::Warn, line),
                Verdict::Same | Verdict::Unknown => line.to_owned(),
            };
            text += &line;
            text.push('\n');
        }
    }
    let count = |verdict: Verdict| {
        it.changes
            .iter()
            .filter(|change| change.verdict == verdict)
            .count()
    };
    let mut parts = Vec::new();
    for (verdict, word) in [
        (Verdict::Better, "better"),
        (Verdict::Worse, "worse"),
        (Verdict::Changed, "changed"),
        (Verdict::Same, "unchanged"),
        (Verdict::Unknown, "unknown"),
    ] {
        if count(verdict) > 0 {
            parts.push(format!("{} {word}", count(verdict)));
        }
    }
    let _ = writeln!(text, "\n{}", paint.set(Mark::Bold, &parts.join(", ")));
    for note in &it.notes {
        for (at, line) in wrapped(note, WIDTH - 2).iter().enumerate() {
            let _ = writeln!(text, "{}{line}", if at == 0 { "! " } else { "  " });
        }
    }
    text
}

fn word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Better => "better",
        Verdict::Worse => "worse",
        Verdict::Changed => "changed",
        Verdict::Same => "",
        Verdict::Unknown => "?",
    }
}

fn name(change: &Change) -> String {
    format!("{} {}", change.group, change.metric)
}

fn signed(value: f64) -> String {
    let text = number(Some(value));
    if value > 0.0 {
        format!("+{text}")
    } else {
        text.replace('-', "−")
    }
}
