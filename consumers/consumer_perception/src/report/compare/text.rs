//! A comparison on a terminal: a table per run, and what must be known to read it.

use std::fmt::Write as _;

use super::change::{Change, Comparison, Verdict};
use crate::report::rows::number;
use crate::report::terminal::{WIDTH, wrapped};

/// The comparison as text of at most [`WIDTH`] columns.
pub fn text(it: &Comparison, colour: bool) -> String {
    let paint = |code: &str, text: String| {
        if colour {
            format!("\x1b[{code}m{text}\x1b[0m")
        } else {
            text
        }
    };
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
        let _ = writeln!(text, "\n{}", paint("1", run.to_owned()));
        let head = format!(
            "{:<name_width$}  {:>8}  {:>8}  {:>8}  {:>19}",
            "", "A", "B", "B − A", "interval"
        );
        let _ = writeln!(text, "{}", paint("2", head));
        for change in of_run() {
            let interval = change.interval.map_or("none".into(), |[low, high]| {
                format!("{} … {}", signed(low), signed(high))
            });
            let line = format!(
                "{:<name_width$}  {:>8}  {:>8}  {:>8}  {interval:>19}  {}",
                cut(&name(change), name_width),
                number(Some(change.a)),
                number(Some(change.b)),
                signed(change.difference),
                word(change.verdict)
            );
            let code = match change.verdict {
                Verdict::Better => "32",
                Verdict::Worse => "31",
                Verdict::Changed => "33",
                Verdict::Same | Verdict::Unknown => "0",
            };
            let line = line.trim_end().to_owned();
            let _ = writeln!(
                text,
                "{}",
                if code == "0" { line } else { paint(code, line) }
            );
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
    let _ = writeln!(text, "\n{}", paint("1", parts.join(", ")));
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

fn cut(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        return text.to_owned();
    }
    text.chars().take(most - 1).collect::<String>() + "…"
}

fn signed(value: f64) -> String {
    let text = number(Some(value));
    if value > 0.0 {
        format!("+{text}")
    } else {
        text.replace('-', "−")
    }
}
