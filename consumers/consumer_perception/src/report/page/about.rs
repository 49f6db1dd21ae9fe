//! What became of frames, what processes used, what was shown, how the report was made, and what its
//! words mean.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use crate::capture::Mode;
use crate::report::types::Report;
use consumer_report::numbers::{bytes, grouped, number};
use consumer_report::page::{Cell, Head, Table, definitions, details};
use consumer_report::words::escape;

/// What became of frames and results.
pub fn frames(report: &Report) -> String {
    let heads = vec![
        Head::words("run"),
        Head::new("frames").note("Frames that could be answered"),
        Head::new("answered").note("Frames with at least one result"),
        Head::new("results"),
        Head::new("repeated").note("Results for a frame that had one already"),
        Head::new("out of order")
            .note("Results for a frame older than one that was answered before"),
        Head::new("invented").note("Results for frames that were never sent"),
        Head::new("unreadable").note("Results that nobody asked for, or that cannot be read"),
        Head::new("lost").note("Results that came faster than the benchmark reads"),
        Head::new("frames/s")
            .note("Answered frames per second of the wall clock, mean over scenarios"),
        Head::new("pace").note("Simulated seconds per second: least of all scenarios"),
    ];
    let mut table = Table::new("", heads);
    for run in &report.runs {
        let it = &run.counts;
        let rates = run
            .scenarios
            .iter()
            .filter_map(|one| one.throughput.received_fps);
        let rates: Vec<f64> = rates.collect();
        let rate = (!rates.is_empty()).then(|| rates.iter().sum::<f64>() / rates.len() as f64);
        let paces = run.scenarios.iter().filter_map(|one| one.pace);
        let pace = paces.reduce(f64::min).filter(|_| run.mode != Mode::Offline);
        let counts = [
            it.n_frames,
            it.n_answered,
            it.n_results,
            it.n_repeated,
            it.n_out_of_order,
            it.n_invented,
            it.n_unreadable,
            it.n_lost,
        ];
        let cells = counts.map(|n| Cell::from(grouped(n)));
        let ends = [number(rate), number(pace)].map(Cell::from);
        table.row(
            [Cell::from(run.label())]
                .into_iter()
                .chain(cells)
                .chain(ends),
        );
    }
    format!(
        "<section><h2 id=\"frames\">Frames and results</h2>\n{}</section>\n",
        table.html()
    )
}

/// What processes used.
pub fn usage(report: &Report) -> String {
    let heads = vec![
        Head::words("run"),
        Head::words("process"),
        Head::new("CPU, cores").note("Processor time per second of the wall clock"),
        Head::new("CPU ms a frame").note("Processor time per answered frame"),
        Head::new("peak memory"),
        Head::words("cores"),
        Head::new("nice"),
    ];
    let mut table = Table::new("", heads);
    for run in &report.runs {
        for it in &run.usage {
            let cores = match (it.of_program, run.cores.is_empty()) {
                (false, _) => String::new(),
                (true, true) => "all".into(),
                (true, false) => run
                    .cores
                    .iter()
                    .map(u32::to_string)
                    .collect::<Vec<_>>()
                    .join(", "),
            };
            let nice = run
                .nice
                .filter(|_| it.of_program)
                .map_or(String::new(), |nice| nice.to_string());
            table.row([
                Cell::from(run.label()),
                it.process.clone().into(),
                number(Some(it.cpu_cores)).into(),
                number(Some(it.cpu_ms_per_frame)).into(),
                bytes(it.peak_bytes).into(),
                cores.into(),
                nice.into(),
            ]);
        }
    }
    let body = if table.is_empty() {
        "<p>Nothing was sampled.</p>\n".into()
    } else {
        table.html()
    };
    format!("<section><h2 id=\"usage\">Resources</h2>\n{body}</section>\n")
}

/// What was shown.
pub fn scenarios(report: &Report) -> String {
    let keys: BTreeSet<&String> = report
        .scenarios
        .iter()
        .flat_map(|it| it.settings.keys())
        .collect();
    let setting = |it: &crate::report::types::ScenarioInfo, key: &String| {
        it.settings.get(key).cloned().unwrap_or_default()
    };
    // What is the same in all of them is said once.
    let (same, keys): (Vec<&String>, Vec<&String>) = keys.into_iter().partition(|key| {
        let mut values = report.scenarios.iter().map(|it| setting(it, key));
        let first = values.next();
        values.all(|value| Some(value) == first)
    });
    let all: Vec<String> = same
        .iter()
        .filter_map(|key| Some(format!("{key} {}", setting(report.scenarios.first()?, key))))
        .collect();
    let all = match all.join(", ") {
        text if text.is_empty() => String::new(),
        text => format!("<p>In all of them: {}.</p>\n", escape(&text)),
    };
    let mut heads = vec![Head::words("scenario")];
    heads.extend(keys.iter().map(|key| Head::words(key.as_str())));
    heads.extend([
        Head::new("seconds"),
        Head::new("queries/s"),
        Head::words("frames, SHA-256"),
    ]);
    let mut table = Table::new("", heads);
    for it in &report.scenarios {
        let mut cells = vec![Cell::from(it.name.clone())];
        cells.extend(keys.iter().map(|key| Cell::from(setting(it, key))));
        let hash = it.frames_hash.get(..16).unwrap_or(&it.frames_hash);
        cells.extend(
            [
                number(Some(it.secs)),
                number(Some(it.query_hz)),
                hash.to_owned(),
            ]
            .map(Cell::from),
        );
        table.row(cells);
    }
    format!(
        "<section><h2 id=\"scenarios\">Scenarios</h2>\n<p class=\"soft\">Every program saw the same frames. Reports whose hashes are equal can be compared.</p>\n{all}{}</section>\n",
        table.html()
    )
}

/// The machine, the settings, and how to do it again.
pub fn how(report: &Report) -> String {
    let machine = &report.machine;
    let mut rows: Vec<(String, String)> = vec![
        ("suite".into(), report.suite.clone()),
        (
            "suite, build and seed, SHA-256".into(),
            report.suite_hash.clone(),
        ),
        ("seed".into(), report.seed.to_string()),
        ("fairness".into(), report.fairness().join("; ")),
        ("to cite".into(), report.citation()),
        ("Gantry".into(), report.build.clone()),
        ("began".into(), report.began.clone()),
        (
            "processor".into(),
            format!("{}, {} cores", machine.cpu, machine.n_cpus),
        ),
        ("memory".into(), bytes(machine.memory_bytes)),
        ("rendered by".into(), machine.adapter.clone()),
        ("kernel".into(), machine.kernel.clone()),
        ("load when it began".into(), format!("{:.2}", machine.load)),
    ];
    rows.extend(
        report
            .settings
            .iter()
            .map(|(key, value)| (key.clone(), value.clone())),
    );
    let rows = rows.iter().filter(|(_, value)| !value.is_empty());
    let mut html = format!(
        "<section><h2 id=\"how\">How it was made</h2>\n{}\n<h3>Programs</h3>\n",
        definitions(rows.map(|(name, value)| (name.as_str(), value.as_str())))
    );
    let heads = vec![Head::words("program"), Head::words("command")];
    let mut programs = Table::new("", heads);
    let mut seen = BTreeSet::new();
    for run in &report.runs {
        if seen.insert(&run.program) {
            programs.row([Cell::from(run.program.clone()), shell(&run.command).into()]);
        }
    }
    html += &programs.html();
    html += "<h3>To do it again</h3>\n";
    let _ = writeln!(html, "<pre>{}</pre>", escape(&shell(&report.command)));
    html += "<p class=\"soft\">The same suite, build and seed give the same frames; latency needs the same machine. <code>gantry bench compare A.json B.json</code> says what changed beyond noise.</p>\n";
    html += "<h3>To cite it</h3>\n";
    let cite = format!(
        "Gantry perception benchmark, suite “{}” ({}), {}, {}, seed {}{}, {}.",
        report.suite,
        report.suite_hash.get(..16).unwrap_or(&report.suite_hash),
        report.build,
        match report.is_sealed {
            true => "sealed",
            false => "not sealed",
        },
        report.seed,
        match report.has_drawn_seed {
            true => " drawn",
            false => " (public)",
        },
        report.began.get(..10).unwrap_or(&report.began)
    );
    let _ = writeln!(html, "<pre>{}</pre>", escape(&cite));
    if !report.suite_text.is_empty() {
        let text = format!("<pre>{}</pre>", escape(&report.suite_text));
        html += &details("The suite", &text);
    }
    html + "</section>\n"
}

/// Words of a command as a shell takes them.
fn shell(words: &[String]) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,+@%".contains(c);
    let quoted = words.iter().map(|word| {
        if !word.is_empty() && word.chars().all(plain) {
            word.clone()
        } else {
            format!("'{}'", word.replace('\'', "'\\''"))
        }
    });
    quoted.collect::<Vec<_>>().join(" ")
}

/// What the words of the tables mean.
pub fn words() -> String {
    let rows = [
        (
            "offline",
            "Every frame is answered, however long it takes; each result is scored against the truth of the frame it answers. Accuracy without time.",
        ),
        (
            "streaming",
            "The world goes on while the program works. At every query the truth of that moment is scored against the newest result there is (Li, Wang, Ramanan: Towards Streaming Perception, 2020).",
        ),
        (
            "+100 ms",
            "The streaming value if every result had come 100 ms later. It separates what is wrong from what is late.",
        ),
        (
            "miss",
            "Share of queries at which no result had come yet; they count with an empty result.",
        ),
        (
            "in time",
            "Share of queries whose newest result answers the newest frame.",
        ),
        (
            "behind",
            "By how many frames the newest result lags behind the newest frame, mean over queries with a result (mismatch).",
        ),
        (
            "p99, p99.9",
            "Times that 99 % and 99.9 % of the results are below. They are shown from 100 and from 1000 results on; below that they would be the largest.",
        ),
        (
            "query",
            "A moment at which truth and newest result are compared. Truth exists at each of them; nothing is interpolated.",
        ),
        ("hollow mark", "The offline value of the same program."),
    ];
    format!(
        "<section><h2 id=\"words\">What the words mean</h2>\n{}</section>\n",
        definitions(rows)
    )
}

#[cfg(test)]
mod tests {
    use super::shell;

    #[test]
    fn commands_can_be_pasted_into_a_shell() {
        let words = ["gantry", "bench", "a b", "it's", ""].map(str::to_owned);
        assert_eq!(shell(&words), r"gantry bench 'a b' 'it'\''s' ''");
    }
}
