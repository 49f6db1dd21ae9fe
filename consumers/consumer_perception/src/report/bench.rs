//! `bench.json`: the lines of the tables as rows, in the form of all benchmarks of this project, for
//! `docs/benchmarks/raw`; `gantry bench report` builds pages from it.

use consumer_report::numbers::{NONE, number, percent as show_percent};
use serde_json::{Map, Value, json};

use super::rows::{Line, TaskTable, tables};
use super::types::Report;

/// The rows, one for each line of each task's table. What does not exist is `–`.
pub fn value(report: &Report) -> Value {
    let tables = tables(report);
    let rows: Vec<Value> = tables
        .iter()
        .flat_map(|table| table.lines.iter().map(|line| row(table, line)))
        .collect();
    let machine = &report.machine;
    let mut tasks = Map::new();
    for table in &tables {
        let of_task = rows.iter().filter(|row| row["task"] == table.task);
        tasks.insert(table.task.to_owned(), of_task.cloned().collect());
    }
    json!({
        "bench": "perception",
        "suite": report.suite,
        "suite_hash": report.suite_hash,
        "seed": report.seed,
        "n_scenarios": report.scenarios.len(),
        "took_secs": report.took_secs,
        "machine": {
            "cpu": machine.cpu,
            "n_cores": machine.n_cpus,
            "gpu": machine.adapter,
            "kernel": machine.kernel,
            "load_1min": format!("{:.2}", machine.load),
            "commit": report.build,
            "command": report.command.join(" "),
            "date": report.began.get(..10).unwrap_or_default(),
        },
        "tasks": tasks,
        "rows": rows,
    })
}

fn row(table: &TaskTable<'_>, line: &Line<'_>) -> Value {
    let or_dash = |value: Option<f64>| value.map_or(json!(NONE), |value| json!(value));
    let percent = |value: Option<f64>| or_dash(value.map(|it| it * 100.0));
    let spread = line.latency().map(|it| &it.end_to_end);
    let answer = line.latency().map(|it| &it.answer);
    let headline = match table.unit {
        "" => table.headline.to_owned(),
        unit => format!("{}, {unit}", table.headline),
    };
    let better = if table.higher_is_better {
        "more"
    } else {
        "less"
    };
    json!({
        "name": format!("{} {}", table.task, line.label),
        "task": table.task,
        "program": line.label,
        "headline": headline,
        "better": better,
        "offline": or_dash(line.offline),
        "streaming": or_dash(line.streaming),
        "streaming_plus_100ms": or_dash(line.delayed),
        "miss_percent": percent(line.miss),
        "in_time_percent": percent(line.in_time),
        "mismatch_frames": or_dash(line.mismatch),
        "p50_ms": or_dash(spread.and_then(|it| it.shown_p50())),
        "p99_ms": or_dash(spread.and_then(|it| it.shown_p99())),
        "p999_ms": or_dash(spread.and_then(|it| it.shown_p999())),
        "answer_p50_ms": or_dash(answer.and_then(|it| it.shown_p50())),
        "answer_p99_ms": or_dash(answer.and_then(|it| it.shown_p99())),
        "cpu_cores": or_dash(line.cpu_cores),
        "n_scored": table.n_scored,
        // The same as tables show it.
        "shown": {
            "offline": number(line.offline),
            "streaming": number(line.streaming),
            "streaming_plus_100ms": number(line.delayed),
            "miss": show_percent(line.miss),
            "in_time": show_percent(line.in_time),
            "mismatch": number(line.mismatch),
            "p50_ms": number(spread.and_then(|it| it.shown_p50())),
            "p99_ms": number(spread.and_then(|it| it.shown_p99())),
            "cpu_cores": number(line.cpu_cores),
        },
    })
}
