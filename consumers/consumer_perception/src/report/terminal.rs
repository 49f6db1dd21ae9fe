//! The report on a terminal: a table per task for all programs together, what became of frames and
//! results, and what a reader must know; at most [`WIDTH`] columns.

use std::fmt::Write as _;
use std::io::IsTerminal as _;

use consumer_report::numbers::{NONE, bytes, grouped, number, percent};
use consumer_report::terminal::{Mark, Paint, TextCell, TextTable};
use consumer_report::words::wrapped;
use launch_cli::ColorWhen;

use super::rows::{Line, TaskTable, best, tables, unanswered};
use super::types::{Report, Run};
use crate::capture::Mode;

/// Most columns of a line.
pub const WIDTH: usize = 100;

/// Longest name in a table; longer ones end in `…`.
const NAME_WIDTH: usize = 20;

/// Whether a report on stdout is coloured: not when it goes into a pipe or a file.
pub fn colours(color: ColorWhen) -> bool {
    color == ColorWhen::Always || (color.on_stderr() && std::io::stdout().is_terminal())
}

/// The whole report as text.
pub fn terminal(report: &Report, colour: bool) -> String {
    let paint = Paint { is_on: colour };
    let mut text = head(report, paint);
    for table in tables(report) {
        text += "\n";
        text += &task(&table, paint);
    }
    let unanswered = unanswered(report);
    if !unanswered.is_empty() {
        let line = format!("not answered by any program: {}", unanswered.join(", "));
        for line in wrapped(&line, WIDTH) {
            let _ = write!(text, "\n{}", paint.set(Mark::Soft, &line));
        }
        text += "\n";
    }
    text += &stress(report, paint);
    text += &totals(report, paint);
    for warning in &report.warnings {
        text += &note("warning", warning, paint);
    }
    for run in &report.runs {
        for fault in &run.faults {
            text += &note(&run.label(), fault, paint);
        }
    }
    text
}

fn head(report: &Report, paint: Paint) -> String {
    let programs = super::rows::programs(report).len();
    let simulated: f64 = report.scenarios.iter().map(|it| it.secs).sum();
    let title = format!("Perception benchmark {}", report.suite);
    let mut text = format!(
        "{}: {}, {}, {simulated:.0} simulated seconds, seed {}\n",
        paint.set(Mark::Bold, &title),
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
        let _ = writeln!(text, "{}", paint.set(Mark::Soft, &line));
    }
    let cited = format!("to cite: {}", report.citation());
    for sentence in report.fairness().into_iter().chain([cited]) {
        for line in wrapped(&sentence, WIDTH) {
            let _ = writeln!(text, "{}", paint.set(Mark::Soft, &line));
        }
    }
    text
}

fn counted(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

fn task(table: &TaskTable<'_>, paint: Paint) -> String {
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
        paint.set(
            Mark::Bold,
            &format!("{}: {}{unit}", table.task, table.headline)
        )
    );
    let about = format!(
        "{better} is better; {} scored{left_out}",
        grouped(table.n_scored)
    );
    let _ = writeln!(text, "{}", paint.set(Mark::Soft, &about));
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
    let mut grid = grid(&heads, paint);
    for line in &table.lines {
        any_partial |= line.offline_is_partial && line.offline.is_some();
        let mark = if line.offline_is_partial && line.offline.is_some() {
            "*"
        } else {
            ""
        };
        let latency = line.latency().map(|it| &it.end_to_end);
        let values = [line.offline, line.streaming, line.delayed];
        let mut cells = vec![TextCell::from(line.label.clone())];
        for (at, (value, best)) in values.into_iter().zip(bests).enumerate() {
            let mark = if at == 0 { mark } else { "" };
            let cell = TextCell::from(number(value) + mark);
            cells.push(cell.best(value.is_some() && value == best));
        }
        let plain = [
            percent(line.miss),
            percent(line.in_time),
            number(line.mismatch),
            number(latency.and_then(|it| it.shown_p50())),
            number(latency.and_then(|it| it.shown_p99())),
            number(latency.and_then(|it| it.shown_p999())),
            number(line.cpu_cores),
        ];
        cells.extend(plain.map(TextCell::from));
        grid.row(cells);
    }
    text += &grid.text();
    if any_partial {
        let about = "* of a run in real time: only the frames that were answered";
        let _ = writeln!(text, "{}", paint.set(Mark::Soft, about));
    }
    text
}

fn stress(report: &Report, paint: Paint) -> String {
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
    let rows = runs.iter().map(|run| {
        let spread = &run.latency.answer;
        let ms = |value: f64| number((spread.n > 0).then_some(value));
        [
            run.label(),
            grouped(run.counts.n_frames),
            grouped(run.counts.n_answered),
            ms(spread.p50),
            ms(spread.p90),
            number(spread.shown_p99()),
            number(spread.shown_p999()),
            ms(spread.max),
            number(run.cpu_cores()),
        ]
    });
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
        paint.set(Mark::Bold, "streams without accuracy"),
        wrapped(&about.join("; "), WIDTH)
            .iter()
            .map(|line| paint.set(Mark::Soft, line))
            .collect::<Vec<_>>()
            .join("\n"),
        grid(&heads, paint).rows(rows).text()
    )
}

fn totals(report: &Report, paint: Paint) -> String {
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
    let rows = report.runs.iter().map(|run| {
        let counts = &run.counts;
        [
            run.label(),
            grouped(counts.n_frames),
            grouped(counts.n_answered),
            grouped(counts.n_results),
            grouped(counts.n_repeated),
            grouped(counts.n_out_of_order),
            grouped(counts.n_invented),
            grouped(counts.n_unreadable),
            grouped(counts.n_lost),
            run.peak_bytes().map_or(NONE.into(), bytes),
        ]
    });
    format!(
        "\n{}\n{}",
        paint.set(Mark::Bold, "frames and results"),
        grid(&heads, paint).rows(rows).text()
    )
}

/// A table of at most [`WIDTH`] columns.
fn grid(heads: &[&str], paint: Paint) -> TextTable {
    TextTable::new(heads)
        .painted(paint)
        .within(WIDTH, NAME_WIDTH)
}

fn note(what: &str, sentence: &str, paint: Paint) -> String {
    let mut text = String::new();
    for (at, line) in wrapped(&format!("{what}: {sentence}"), WIDTH - 2)
        .iter()
        .enumerate()
    {
        let lead = if at == 0 { "! " } else { "  " };
        let _ = writeln!(text, "{}", paint.set(Mark::Warn, &format!("{lead}{line}")));
    }
    if text.is_empty() {
        text
    } else {
        format!("\n{text}")
    }
}
