//! What `gantry bench compare` says of reports whose difference is known, and its intervals beside
//! SciPy's.

use crate::perception_report::example;

use std::path::Path;

use consumer_perception::report::{Report, compare};
use serde_json::{Value, json};
use test_e2e::processes::venv_program;
use test_kit::Sandbox;
use test_kit::sandbox::repository;

fn text(path: &Path) -> &str {
    path.to_str().expect("sandbox paths are text")
}

fn bench(sandbox: &Sandbox, words: &[&str], code: i32) -> Vec<String> {
    sandbox
        .spawn("gantry-bench", words)
        .wait()
        .expect_code(code)
        .lines
}

fn save(sandbox: &Sandbox, name: &str, report: &Report) -> String {
    let text = serde_json::to_string(report).unwrap();
    sandbox.write(name, &text).to_str().unwrap().to_owned()
}

#[test]
fn compare_finds_what_was_changed_and_nothing_else() {
    let sandbox = Sandbox::new("compare");
    let before = example::report(&sandbox.path("report"));
    let mut after = before.clone();
    // Boxes of hog in time: better in all scenarios, by a little or a lot. Its flow has none.
    // Latency of blobs: worse in all. Accuracy of blobs in time: up in half of them, down in half.
    for (at, scenario) in after.runs[1].scenarios.iter_mut().enumerate() {
        *scenario.scores[0].streaming.get_mut("AP").unwrap() += 0.02 + 0.01 * at as f64;
    }
    let blobs = after
        .runs
        .iter()
        .position(|run| run.file_stem() == "blobs-streaming")
        .unwrap();
    for (at, scenario) in after.runs[blobs].scenarios.iter_mut().enumerate() {
        scenario.latency.end_to_end.p99 *= 1.3 + 0.1 * at as f64;
        let sign = if at % 2 == 0 { 1.0 } else { -1.0 };
        *scenario.scores[0].streaming.get_mut("AP").unwrap() += 0.05 * sign;
    }
    let (a, b) = (
        save(&sandbox, "a.json", &before),
        save(&sandbox, "b.json", &after),
    );
    let json = sandbox.path("changes.json");
    let words = ["compare", &a, &b, "--json", text(&json)];
    let lines = bench(&sandbox, &words, 0);
    assert!(
        lines.iter().all(|line| line.chars().count() <= 100),
        "{lines:#?}"
    );
    let found: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    let of = |verdict: &str| -> Vec<String> {
        let all = found["changes"].as_array().unwrap().iter();
        let of_kind = all.filter(|it| it["verdict"] == verdict);
        of_kind
            .map(|it| {
                format!(
                    "{} {}",
                    it["run"].as_str().unwrap(),
                    it["metric"].as_str().unwrap()
                )
            })
            .collect()
    };
    assert_eq!(of("better"), ["hog streaming AP"]);
    assert_eq!(of("worse"), ["blobs streaming end_to_end p99, ms"]);
    assert!(of("changed").is_empty());
    let hog = found["changes"]
        .as_array()
        .unwrap()
        .iter()
        .find(|it| it["verdict"] == "better")
        .unwrap();
    // The mean of 0.02 to 0.07; the interval lies within them.
    assert!(
        (hog["difference"].as_f64().unwrap() - 0.045).abs() < 1e-9,
        "{hog}"
    );
    let ends: Vec<f64> = hog["interval"]
        .as_array()
        .unwrap()
        .iter()
        .map(|it| it.as_f64().unwrap())
        .collect();
    assert!(
        0.02 < ends[0] && ends[0] < 0.045 && 0.045 < ends[1] && ends[1] < 0.07,
        "{ends:?}"
    );
    // The same again is the same; a report with itself has no change.
    assert_eq!(bench(&sandbox, &words, 0), lines);
    let same = bench(&sandbox, &["compare", &a, &a, "--fail-on", "changed"], 0);
    assert!(
        same.iter().any(|line| line.ends_with(" unchanged")),
        "{same:#?}"
    );
    // For scripts.
    bench(&sandbox, &["compare", &a, &b, "--fail-on", "worse"], 1);
    bench(&sandbox, &["compare", &b, &a, "--fail-on", "worse"], 1);
    bench(
        &sandbox,
        &["compare", &a, &b, "--fail-on", "worse", "--at-least", "0.9"],
        0,
    );
    let out = bench(&sandbox, &["compare", &a, &b, "--json", "-"], 0).join("\n");
    assert_eq!(serde_json::from_str::<Value>(&out).unwrap(), found);
    // Two programs of one report.
    let lines = bench(&sandbox, &["compare", &a, &a, "--as", "hog=blobs"], 0);
    let line = lines
        .iter()
        .find(|line| line.starts_with("boxes2d AP "))
        .unwrap();
    assert!(
        line.contains("0.569") && line.contains("0.343") && line.ends_with("worse"),
        "{line}"
    );
}

#[test]
fn compare_refuses_what_does_not_show_the_same() {
    let sandbox = Sandbox::new("compare");
    let before = example::report(&sandbox.path("report"));
    let a = save(&sandbox, "a.json", &before);
    let refused = |name: &str, change: &dyn Fn(&mut Report), says: &str| {
        let mut other = before.clone();
        change(&mut other);
        let b = save(&sandbox, &format!("{name}.json"), &other);
        let lines = bench(&sandbox, &["compare", &a, &b], 2);
        assert!(
            lines
                .iter()
                .any(|line| line.contains(says) && line.contains("--any")),
            "{lines:#?}"
        );
        let lines = bench(&sandbox, &["compare", &a, &b, "--any"], 0);
        assert!(
            lines.iter().any(|line| line.starts_with("! ")),
            "{lines:#?}"
        );
    };
    refused(
        "suite",
        &|it| it.suite = "other".into(),
        "the suites \"example\" and \"other\"",
    );
    refused("seed", &|it| it.seed = 8, "seeds are 7 and 8");
    refused(
        "hash",
        &|it| it.suite_hash = "0".into(),
        "the hash of suite, build and seed differs",
    );
    refused(
        "frames",
        &|it| it.scenarios[2].frames_hash = "0".into(),
        "the frames of \"town03-clear-dusk-dense\" differ",
    );
    refused(
        "fewer",
        &|it| drop(it.scenarios.pop()),
        "the second has no scenario",
    );
    let mut nothing = before.clone();
    nothing.runs.iter_mut().for_each(|run| run.program += "-2");
    let b = save(&sandbox, "nothing.json", &nothing);
    let lines = bench(&sandbox, &["compare", &a, &b], 2);
    assert!(
        lines
            .iter()
            .any(|line| line.contains("no run in common") && line.contains("--as")),
        "{lines:#?}"
    );
    let lines = bench(&sandbox, &["compare", &a, "/nowhere.json"], 2);
    assert!(
        lines
            .iter()
            .any(|line| line.contains("cannot read the report /nowhere.json")),
        "{lines:#?}"
    );
}

#[test]
fn one_scenario_has_no_interval() {
    let sandbox = Sandbox::new("compare");
    let mut before = example::report(&sandbox.path("report"));
    before.scenarios.truncate(1);
    let mut after = before.clone();
    *after.runs[1].scenarios[0].scores[0]
        .streaming
        .get_mut("AP")
        .unwrap() -= 0.1;
    let (a, b) = (
        save(&sandbox, "a.json", &before),
        save(&sandbox, "b.json", &after),
    );
    let lines = bench(&sandbox, &["compare", &a, &b], 0);
    assert!(
        lines.iter().any(|line| line.contains("no interval exists")),
        "{lines:#?}"
    );
    assert!(
        lines
            .iter()
            .any(|line| line.starts_with("boxes2d AP ") && line.ends_with('?')),
        "{lines:#?}"
    );
    let lines = bench(&sandbox, &["compare", &a, &b, "--fail-on", "worse"], 2);
    assert!(
        lines
            .iter()
            .any(|line| line.contains("at least two scenarios")),
        "{lines:#?}"
    );
    bench(
        &sandbox,
        &[
            "compare",
            &a,
            &b,
            "--fail-on",
            "worse",
            "--at-least",
            "0.05",
        ],
        1,
    );
}

/// Intervals of many samples whose mean is known, beside SciPy's of the same samples: each is where
/// SciPy's is, and they hold the mean as often as its do.
#[test]
fn intervals_are_those_of_scipy() {
    let sandbox = Sandbox::new("bootstrap");
    let mut random = fastrand::Rng::with_seed(3);
    let mut cases = Vec::new();
    for at in 0..400_u64 {
        let n = 20;
        // Half of the samples are lopsided.
        let draw = |random: &mut fastrand::Rng| {
            if at % 2 == 0 {
                (0..12).map(|_| random.f64()).sum::<f64>() - 6.0
            } else {
                -random.f64().max(1e-12).ln()
            }
        };
        let sample: Vec<f64> = (0..n).map(|_| draw(&mut random)).collect();
        let (low, high) = compare::interval(&sample, 0.95, 4000, at).unwrap();
        let mean = if at % 2 == 0 { 0.0 } else { 1.0 };
        cases.push(json!({"sample": sample, "mean": mean, "confidence": 0.95, "resamples": 4000, "interval": [low, high]}));
    }
    let file = sandbox.write("cases.json", &Value::from(cases).to_string());
    let script = repository().join("tests/test_e2e/python/perception_report.py");
    let words = [text(&script), "bootstrap", text(&file)];
    let python = venv_program("python");
    let lines = sandbox
        .spawn_program("python", &python, &words, &[])
        .wait()
        .expect_code(0)
        .lines;
    let numbers: Vec<f64> = lines
        .join(" ")
        .split(' ')
        .filter_map(|word| word.parse().ok())
        .collect();
    let [worst, ours, theirs] = numbers[..] else {
        panic!("{lines:?}")
    };
    // Ends of 4000 resamples vary by a few percent of the width.
    assert!(worst < 0.1, "{lines:?}");
    // Known of the percentile bootstrap at n = 20: a little below its name.
    assert!(
        (ours - theirs).abs() <= 0.01 && (0.88..0.97).contains(&ours),
        "{lines:?}"
    );
}
