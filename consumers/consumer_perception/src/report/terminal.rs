//! The report on a terminal: a table per task for all programs together, what became of frames and
//! results, and what a reader must know; at most [`WIDTH`] columns.

use std::fmt::Write as _;
use std::io::IsTerminal as _;

use launch_cli::ColorWhen;

use super::rows::{Line, TaskTable, best, bytes, grouped, number, percent, tables, unanswered};
use super::types::{Report, Run};
use crate::capture::Mode;

/// Most columns of a line.
pub const WIDTH: usize = 100;

/// Longest name in a table; longer ones end in `…`.
const NAME_WIDTH: usize = 20;

const BOLD: &str = "1";
const SOFT: &str = "2";
const GOOD: &str = "32";
const WARN: &str = "33";

/// Whether a report on stdout is coloured: not when it goes into a pipe or a file.
pub fn colours(color: ColorWhen) -> bool {
    color == ColorWhen::Always || (color.on_stderr() && std::io::stdout().is_terminal())
}

/// The whole report as text.
pub fn terminal(report: &Report, colour: bool) -> String {
    let paint = Paint(colour);
    let mut text = head(report, &paint);
    for table in tables(report) {
        text += "\n";
        text += &task(&table, &paint);
    }
    let unanswered = unanswered(report);
    if !unanswered.is_empty() {
        let line = format!("not answered by any program: {}", unanswered.join(", "));
        for line in wrapped(&line, WIDTH) {
            let _ = write!(text, "\n{}", paint.set(SOFT, &line));
        }
        text += "\n";
    }
    text += &stress(report, &paint);
    text += &totals(report, &paint);
    for warning in &report.warnings {
        text += &note("warning", warning, &paint);
    }
    for run in &report.runs {
        for fault in &run.faults {
            text += &note(&run.label(), fault, &paint);
        }
    }
    text
}

struct Paint(bool);

impl Paint {
    fn set(&self, code: &str, text: &str) -> String {
        if self.0 {
            format!("\x1b[{code}m{text}\x1b[0m")
        } else {
            text.to_owned()
        }
    }
}

fn head(report: &Report, paint: &Paint) -> String {
    let programs = super::rows::programs(report).len();
    let simulated: f64 = report.scenarios.iter().map(|it| it.secs).sum();
    let title = format!("Perception benchmark {}", report.suite);
    let mut text = format!(
        "{}: {}, {}, {simulated:.0} simulated seconds, seed {}\n",
        paint.set(BOLD, &title),
        counted(report.scenarios.len(), "scenario"),
        counted(programs, "program"),
        report.seed
    );
    let machine = &report.machine;
    let mut parts = vec![machine.cpu.clone(), counted(machine.n_cpus, "core")];
    parts.extend([&machine.adapter, &report.build].map(Clone::clone));
    parts.push(format!("load {:.2}", machine.load));
    parts.retain(|part| !part.is_empty());
    for line in wrapped(&parts.join(", "), WIDTH) {
        let _ = writeln!(text, "{}", paint.set(SOFT, &line));
    }
    text
}

fn counted(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

/// A cell: its text, and whether it is the best of its column.
type Cell = (String, bool);

fn task(table: &TaskTable<'_>, paint: &Paint) -> String {
    let better = if table.higher_is_better {
        "more"
    } else {
        "less"
    };
    let unit = if table.unit.is_empty() {
        String::new()
    } else {
        format!(" [{}]", table.unit)
    };
    let left_out = match table.n_ignored {
        0 => String::new(),
        n => format!(", {} left out by the task's rules", grouped(n)),
    };
    let mut text = format!(
        "{}\n",
        paint.set(BOLD, &format!("{}: {}{unit}", table.task, table.headline))
    );
    let about = format!(
        "{better} is better; {} scored{left_out}",
        grouped(table.n_scored)
    );
    let _ = writeln!(text, "{}", paint.set(SOFT, &about));
    let heads = [
        "program", "offline", "stream", "+100 ms", "miss", "in time", "behind", "p50", "p99",
        "p99.9", "CPU",
    ];
    let best = |of: &dyn Fn(&Line<'_>) -> Option<f64>, higher: bool| {
        best(table.lines.iter().filter_map(of), higher)
    };
    let higher = table.higher_is_better;
    let bests = [
        best(&|it| it.offline, higher),
        best(&|it| it.streaming, higher),
        best(&|it| it.delayed, higher),
    ];
    let mut any_partial = false;
    let rows: Vec<Vec<Cell>> = table
        .lines
        .iter()
        .map(|line| {
            any_partial |= line.offline_is_partial && line.offline.is_some();
            let mark = if line.offline_is_partial && line.offline.is_some() {
                "*"
            } else {
                ""
            };
            let latency = line.latency().map(|it| &it.end_to_end);
            let values = [line.offline, line.streaming, line.delayed];
            let mut cells = vec![(line.label.clone(), false)];
            for (value, best) in values.into_iter().zip(bests) {
                cells.push((number(value), value.is_some() && value == best));
            }
            cells[1].0 += mark;
            let plain = [
                percent(line.miss),
                percent(line.in_time),
                number(line.mismatch),
                number(latency.and_then(|it| it.shown_p50())),
                number(latency.and_then(|it| it.shown_p99())),
                number(latency.and_then(|it| it.shown_p999())),
                number(line.cpu_cores),
            ];
            cells.extend(plain.map(|text| (text, false)));
            cells
        })
        .collect();
    text += &grid(&heads, &rows, paint);
    if any_partial {
        let about = "* of a run in real time: only the frames that were answered";
        let _ = writeln!(text, "{}", paint.set(SOFT, about));
    }
    text
}

fn stress(report: &Report, paint: &Paint) -> String {
    let runs: Vec<&Run> = report
        .runs
        .iter()
        .filter(|run| run.mode == Mode::Stress)
        .collect();
    if runs.is_empty() {
        return String::new();
    }
    let heads = [
        "run", "frames", "answered", "p50 ms", "p90", "p99", "p99.9", "max", "CPU",
    ];
    let rows: Vec<Vec<Cell>> = runs
        .iter()
        .map(|run| {
            let spread = &run.latency.answer;
            let ms = |value: f64| number((spread.n > 0).then_some(value));
            let cells = [
                run.label(),
                grouped(run.counts.n_frames),
                grouped(run.counts.n_answered),
                ms(spread.p50),
                ms(spread.p90),
                number(spread.shown_p99()),
                number(spread.shown_p999()),
                ms(spread.max),
                number(run.cpu_cores()),
            ];
            cells.map(|text| (text, false)).into()
        })
        .collect();
    let has = |name: &str| runs.iter().any(|run| run.mode_name() == name);
    let mut about = vec!["latency from the frame's publication to the result's"];
    if has("constant") {
        about.push("constant: frames at one rate");
    }
    if has("single") {
        about.push("single: the next frame comes with the answer");
    }
    format!(
        "\n{}\n{}\n{}",
        paint.set(BOLD, "streams without accuracy"),
        wrapped(&about.join("; "), WIDTH)
            .iter()
            .map(|line| paint.set(SOFT, line))
            .collect::<Vec<_>>()
            .join("\n"),
        grid(&heads, &rows, paint)
    )
}

fn totals(report: &Report, paint: &Paint) -> String {
    let heads = [
        "all tasks",
        "frames",
        "answered",
        "results",
        "repeat",
        "order",
        "invent",
        "unread",
        "lost",
        "memory",
    ];
    let rows: Vec<Vec<Cell>> = report
        .runs
        .iter()
        .map(|run| {
            let counts = &run.counts;
            let cells = [
                run.label(),
                grouped(counts.n_frames),
                grouped(counts.n_answered),
                grouped(counts.n_results),
                grouped(counts.n_repeated),
                grouped(counts.n_out_of_order),
                grouped(counts.n_invented),
                grouped(counts.n_unreadable),
                grouped(counts.n_lost),
                run.peak_bytes().map_or("–".into(), bytes),
            ];
            cells.map(|text| (text, false)).into()
        })
        .collect();
    format!(
        "\n{}\n{}",
        paint.set(BOLD, "frames and results"),
        grid(&heads, &rows, paint)
    )
}

/// Columns as wide as their widest cell: the first to the left, the others to the right.
fn grid(heads: &[&str], rows: &[Vec<Cell>], paint: &Paint) -> String {
    let named = |text: &str| {
        shortened(
            text,
            NAME_WIDTH.max(WIDTH.saturating_sub(widths_but_first(heads, rows))),
        )
    };
    let cell = |at: usize, text: &str| {
        if at == 0 {
            named(text)
        } else {
            text.to_owned()
        }
    };
    let width = |at: usize| {
        let cells = rows.iter().map(|row| cell(at, &row[at].0).chars().count());
        cells.chain([heads[at].chars().count()]).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..heads.len()).map(width).collect();
    let padded = |at: usize, text: &str| {
        let space = " ".repeat(widths[at].saturating_sub(text.chars().count()));
        if at == 0 {
            format!("{text}{space}")
        } else {
            format!("{space}{text}")
        }
    };
    let line: Vec<String> = heads
        .iter()
        .enumerate()
        .map(|(at, head)| padded(at, head))
        .collect();
    let mut text = format!("{}\n", paint.set(SOFT, line.join("  ").trim_end()));
    for row in rows {
        let cells: Vec<String> = row
            .iter()
            .enumerate()
            .map(|(at, (text, is_best))| {
                let text = padded(at, &cell(at, text));
                if *is_best {
                    paint.set(GOOD, &text)
                } else {
                    text
                }
            })
            .collect();
        text += cells.join("  ").trim_end();
        text += "\n";
    }
    text
}

/// Columns that all but the first take, with the gaps.
fn widths_but_first(heads: &[&str], rows: &[Vec<Cell>]) -> usize {
    (1..heads.len())
        .map(|at| {
            let cells = rows.iter().map(|row| row[at].0.chars().count());
            2 + cells.chain([heads[at].chars().count()]).max().unwrap_or(0)
        })
        .sum()
}

fn shortened(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        return text.to_owned();
    }
    let kept: String = text.chars().take(most.saturating_sub(1)).collect();
    kept + "…"
}

fn note(what: &str, sentence: &str, paint: &Paint) -> String {
    let mut text = String::new();
    for (at, line) in wrapped(&format!("{what}: {sentence}"), WIDTH - 2)
        .iter()
        .enumerate()
    {
        let lead = if at == 0 { "! " } else { "  " };
        let _ = writeln!(text, "{}", paint.set(WARN, &format!("{lead}{line}")));
    }
    if text.is_empty() {
        text
    } else {
        format!("\n{text}")
    }
}

/// Words in lines of at most `width` characters; longer words are cut.
pub fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines = Vec::new();
    let mut line = String::new();
    for word in text.split_whitespace() {
        let mut word: Vec<char> = word.chars().collect();
        while !word.is_empty() {
            let used = line.chars().count();
            let gap = usize::from(used > 0);
            if used + gap + word.len() <= width {
                if gap == 1 {
                    line.push(' ');
                }
                line.extend(word.drain(..));
            } else if used > 0 {
                lines.push(std::mem::take(&mut line));
            } else {
                lines.push(word.drain(..width).collect());
            }
        }
    }
    if !line.is_empty() {
        lines.push(line);
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_broken_between_words_and_within_those_that_are_too_long() {
        assert_eq!(wrapped("a bc def  ghij", 6), ["a bc", "def", "ghij"]);
        assert_eq!(wrapped("abcdefgh ij", 4), ["abcd", "efgh", "ij"]);
        assert!(wrapped("  ", 4).is_empty());
        assert_eq!(shortened("größer", 4), "grö…");
    }
}
