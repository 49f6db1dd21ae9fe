//! Trials for people and for files: terminal table, `reaction.json`, one page of HTML, `.hgrm`.

use std::fmt::Write as _;
use std::path::Path;

use consumer_report::numbers::{NONE, number};
use consumer_report::page::{self, Cell, Head, Table};
use consumer_report::plot::{Axis, Series, lines};
use consumer_report::terminal::TextTable;
use consumer_report::words::{anchor, escape};
use consumer_report::{Folder, FolderError};
use serde_json::{Value, json};

use super::summary::{KindReport, Reactions, StageReport};

/// Columns of the table, and what each means.
const COLUMNS: [(&str, &str); 9] = [
    ("reacted", "trials with a correct result in the window"),
    ("missed", "trials without one"),
    (
        "alarms",
        "trials in which it was correct, or braked, before anything could be seen",
    ),
    (
        "p50 ms",
        "from the stimulus to the first correct result, wall clock: half are below",
    ),
    ("p90 ms", "90 % are below"),
    ("p99 ms", "99 % are below"),
    ("max ms", "the longest"),
    (
        "sensor ms",
        "of it: until the sensor's frame that it answers was published; half are below",
    ),
    (
        "step ms",
        "from the reaction of the stage above in the same trial; half are below",
    ),
];

fn cells(stage: &StageReport) -> [String; 9] {
    let wall = &stage.wall_ms;
    let ms = |n: u64, value: f64| number((n > 0).then_some(value));
    [
        stage.n_reactions.to_string(),
        stage.n_misses.to_string(),
        stage.n_false_alarms.to_string(),
        ms(wall.n, wall.p50),
        ms(wall.n, wall.p90),
        ms(wall.n, wall.p99),
        ms(wall.n, wall.max),
        ms(stage.sensor_ms.n, stage.sensor_ms.p50),
        ms(stage.step_ms.n, stage.step_ms.p50),
    ]
}

/// One table for each kind of trial, at most 100 columns wide.
pub fn terminal(reactions: &Reactions) -> String {
    let mut text = String::new();
    for kind in &reactions.kinds {
        let _ = writeln!(text, "{}: {}", kind.kind.name(), trials(kind));
        if !kind.stages.is_empty() {
            let heads = COLUMNS.map(|(head, _)| head);
            let heads: Vec<&str> = std::iter::once("stage").chain(heads).collect();
            let rows = kind
                .stages
                .iter()
                .map(|stage| std::iter::once(stage.stage.clone()).chain(cells(stage)));
            text += &TextTable::new(&heads).rows(rows).indented(2).text();
        }
        text.push('\n');
    }
    for warning in &reactions.warnings {
        let _ = writeln!(text, "warning: {warning}");
    }
    text
}

fn trials(kind: &KindReport) -> String {
    let mut text = format!("{} trials", kind.n_trials);
    if !kind.failed.is_empty() {
        let reasons = kind
            .failed
            .iter()
            .map(|(reason, n)| format!("{n} × {reason}"));
        let _ = write!(
            text,
            ", {} of them failed ({})",
            kind.n_trials - kind.n_counted,
            reasons.collect::<Vec<_>>().join("; ")
        );
    }
    text
}

/// The lines of the tables as rows, in the form of all benchmarks of this project, for
/// `docs/benchmarks/raw`. What does not exist is `–`.
pub fn bench(reactions: &Reactions) -> Value {
    let rows = reactions.kinds.iter().flat_map(|kind| {
        kind.stages.iter().map(move |stage| {
            let wall = &stage.wall_ms;
            let ms = |n: u64, value: f64| if n > 0 { json!(value) } else { json!(NONE) };
            json!({
                "kind": kind.kind.name().replace('_', " "),
                "stage": stage.stage,
                "n_trials": kind.n_trials,
                "n_failed": kind.n_trials - kind.n_counted,
                "n_reactions": stage.n_reactions,
                "n_misses": stage.n_misses,
                "n_false_alarms": stage.n_false_alarms,
                "p50_ms": ms(wall.n, wall.p50),
                "p90_ms": ms(wall.n, wall.p90),
                "p99_ms": ms(wall.n, wall.p99),
                "max_ms": ms(wall.n, wall.max),
                "sensor_p50_ms": ms(stage.sensor_ms.n, stage.sensor_ms.p50),
                "step_p50_ms": ms(stage.step_ms.n, stage.step_ms.p50),
                "simulated_p50_ms": ms(stage.sim_ms.n, stage.sim_ms.p50),
            })
        })
    });
    json!({
        "bench": "reaction",
        "suite": reactions.suite.name,
        "seed": reactions.suite.seed,
        "took_secs": reactions.took_secs,
        "machine": reactions.machine,
        "rows": rows.collect::<Vec<_>>(),
    })
}

/// Writes `reaction.json`, `reaction.html`, `bench.json` and one `KIND-STAGE.hgrm` for each distribution into
/// `folder`.
///
/// # Errors
/// If the folder cannot be written.
pub fn write(reactions: &Reactions, folder: &Path) -> Result<(), FolderError> {
    let mut out = Folder::make(folder)?;
    out.json("reaction.json", reactions)?;
    out.text("reaction.html", &html(reactions))?;
    out.json("bench.json", &bench(reactions))?;
    for kind in &reactions.kinds {
        for stage in &kind.stages {
            let name = format!("{}-{}.hgrm", kind.kind.name(), anchor(&stage.stage));
            out.percentiles(&name, &stage.wall_ms)?;
        }
    }
    Ok(())
}

/// The page.
pub fn html(reactions: &Reactions) -> String {
    let suite = &reactions.suite;
    let title = format!("Reaction times: {}", suite.name);
    let mut body = format!("<h1>{}</h1>\n", escape(&title));
    if !suite.description.is_empty() {
        let _ = writeln!(body, "<p>{}</p>", escape(&suite.description));
    }
    body += &page::warnings(&reactions.warnings);
    for kind in &reactions.kinds {
        body += &section(kind);
    }
    let _ = write!(
        body,
        "<h2>How it was measured</h2>\n<p>The stimulus is the first tick of which a camera at the \
         place of the sensor <code>{}</code> ({} × {} pixels, {}°) shows at least {} pixels of the \
         obstacle with light on them. Times run from the publication of that tick. {} trials took \
         {:.0} s; seed {}.</p>\n",
        escape(&suite.truth.sensor),
        suite.truth.width_px,
        suite.truth.height_px,
        suite.truth.fov_deg,
        suite.truth.min_pixels,
        reactions.trials.len(),
        reactions.took_secs,
        suite.seed
    );
    if let Some(machine) = reactions.machine.as_object() {
        body += "<p>";
        let shown = ["cpu", "n_cores", "kernel", "load_1min", "commit", "command"];
        for (key, value) in shown
            .iter()
            .filter_map(|key| Some((*key, machine.get(*key)?)))
        {
            let value = value
                .as_str()
                .map_or_else(|| value.to_string(), str::to_owned);
            let _ = write!(body, "{}: <code>{}</code> ", escape(key), escape(&value));
        }
        body += "</p>\n";
    }
    page::document(&title, "", &body)
}

fn section(kind: &KindReport) -> String {
    let name = kind.kind.name().replace('_', " ");
    let mut text = format!(
        "<h2>{}</h2>\n<p>{}</p>\n",
        escape(&name),
        escape(&trials(kind))
    );
    if kind.stages.is_empty() {
        return text;
    }
    let heads = std::iter::once(Head::words("stage"))
        .chain(
            COLUMNS
                .iter()
                .map(|(head, note)| Head::new(*head).note(note)),
        )
        .collect();
    let mut table = Table::new("Reactions by stage, wall clock", heads);
    for (index, stage) in kind.stages.iter().enumerate() {
        let first = Cell::from(stage.stage.clone()).swatch(index);
        table.row(std::iter::once(first).chain(cells(stage).map(Cell::from)));
    }
    text += &plot(kind, &name);
    text + &table.html()
}

/// Share of trials with a reaction, over the time since the stimulus; misses keep it below 100 %.
fn plot(kind: &KindReport, name: &str) -> String {
    let mut longest: f64 = 1.0;
    let mut series = Vec::new();
    for (index, stage) in kind.stages.iter().enumerate() {
        let n = f64::from(stage.n_reactions + stage.n_misses);
        let Ok(histogram) = stage.wall_ms.decode() else {
            continue;
        };
        let mut points = vec![(0.0, 0.0)];
        let mut below = 0u64;
        for step in histogram.iter_recorded() {
            below += step.count_since_last_iteration();
            points.push((
                step.value_iterated_to() as f64 / 1e6,
                below as f64 * 100.0 / n.max(1.0),
            ));
        }
        longest = longest.max(points.last().map_or(0.0, |(ms, _)| *ms));
        series.push(Series {
            name: stage.stage.clone(),
            style: index,
            points,
            is_stepped: true,
            ..Series::default()
        });
    }
    // A share holds until the end of the plot.
    for one in &mut series {
        let share = one.points.last().map_or(0.0, |(_, share)| *share);
        one.points.push((longest, share));
    }
    let x = Axis::linear("ms since the stimulus", 0.0, longest);
    let y = Axis::linear("% of trials", 0.0, 100.0);
    lines(
        &format!("{name}: trials with a reaction over time"),
        &x,
        &y,
        &series,
    )
}

#[cfg(test)]
mod tests {
    use super::super::suite::Kind;
    use super::super::summary::tests::trial;
    use super::super::summary::{REACTION_VERSION, kinds};
    use super::*;

    fn reactions() -> Reactions {
        let kind = Kind::PedestrianStepsOut;
        let trials: Vec<_> = (0..20)
            .map(|n| {
                trial(
                    kind,
                    n,
                    &[(Some(80 + u64::from(n)), 0), ((n > 4).then_some(150), 0)],
                )
            })
            .collect();
        Reactions {
            version: REACTION_VERSION,
            suite: toml::from_str(
                "version = 1\nname = \"a<b\"\nlaunch = []\nroad_m = 9\ntruth = { sensor = \"front\" }\n\
                 stage = []\n[kind.pedestrian_steps_out]\n",
            )
            .unwrap(),
            command: Vec::new(),
            machine: serde_json::json!({"cpu": "one"}),
            began_unix_secs: 0,
            took_secs: 12.0,
            stopped: false,
            kinds: kinds(&trials),
            warnings: vec!["busy & slow".into()],
            trials,
        }
    }

    #[test]
    fn the_terminal_shows_a_row_for_each_stage() {
        let text = terminal(&reactions());
        let row = |name: &str| -> Vec<String> {
            let line = text
                .lines()
                .find(|line| line.trim_start().starts_with(name))
                .unwrap();
            line.split_whitespace().map(str::to_owned).collect()
        };
        assert_eq!(row("detector")[1..4], ["20", "0", "0"]);
        assert_eq!(row("brake")[1..4], ["15", "5", "0"]);
        assert!(row("brake")[4].starts_with("150"), "{text}");
        assert!(text.contains("warning: busy & slow"));
        assert!(
            text.lines().all(|line| line.chars().count() <= 100),
            "{text}"
        );
    }

    #[test]
    fn files_are_whole_and_names_are_escaped() {
        let folder = tempfile::tempdir().unwrap();
        let reactions = reactions();
        write(&reactions, folder.path()).unwrap();
        let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
        let again: Reactions = serde_json::from_str(&read("reaction.json")).unwrap();
        assert_eq!(terminal(&again), terminal(&reactions));
        let page = read("reaction.html");
        assert!(
            page.contains("a&lt;b") && page.contains("busy &amp; slow") && page.contains("<svg")
        );
        assert!(
            !page.contains("http://") && !page.contains("https://") && !page.contains("<script")
        );
        let rows: Value = serde_json::from_str(&read("bench.json")).unwrap();
        assert_eq!(rows["rows"][1]["n_misses"], 5);
        assert!(read("pedestrian_steps_out-brake.hgrm").contains("Percentile"));
    }
}
