//! The worked programs of `launch/bench/worked.toml` do what they are meant to show.

use std::path::PathBuf;
use std::time::Duration;

use serde_json::Value;
use test_e2e::benchmark::bench_report;
use test_e2e::{python_package, venv_program};
use test_kit::sandbox::{binary_path, repository};
use test_kit::{Process, Sandbox};
use toml::Table;

/// Each of these benchmarks takes some minutes; only a hang reaches this.
const LIMIT: Duration = Duration::from_secs(3000);

/// A command of the suite by absolute paths, because programs of a test run in its sandbox.
fn command(words: &Value) -> Vec<String> {
    let words: Vec<String> = serde_json::from_value(words.clone()).expect("words");
    let mut found = Vec::new();
    for (i, word) in words.iter().enumerate() {
        let script = repository().join("launch/bench/programs").join(word);
        let path: PathBuf = match word.strip_prefix("./") {
            Some(example) if i == 0 => {
                let folder = binary_path("gantry-bench");
                folder.with_file_name("examples").join(example)
            }
            _ if i == 0 => venv_program(word),
            _ => script,
        };
        found.push(path.to_str().expect("UTF-8").to_owned());
    }
    found
}

/// Lets a table's process run anywhere.
fn moved(process: &mut Table) {
    let words = serde_json::to_value(&process["cmd"]).expect("JSON");
    let words = command(&words).into_iter().map(toml::Value::String);
    process.insert("cmd".into(), toml::Value::Array(words.collect()));
    process.remove("cwd");
    process.remove("venv");
    let package = python_package().to_str().expect("UTF-8").to_owned();
    let env = [
        ("PYTHONPATH", package),
        ("PYTHONDONTWRITEBYTECODE", "1".into()),
    ];
    let env = env.map(|(key, value)| (key.to_owned(), toml::Value::String(value)));
    process.insert("env".into(), toml::Value::Table(Table::from_iter(env)));
}

/// `worked.toml`, shortened to its first scenario and three seconds, in lockstep, with these programs.
fn shortened(keep: &[&str]) -> String {
    let text = std::fs::read_to_string(repository().join("launch/bench/worked.toml")).unwrap();
    let mut suite: Table = text.parse().expect("a suite");
    suite["secs"] = toml::Value::Float(3.0);
    let first = |list: &mut toml::Value| list.as_array_mut().expect("a list").truncate(1);
    for (_, list) in suite["matrix"].as_table_mut().unwrap() {
        first(list);
    }
    moved(suite["input"]["noisy_boxes"].as_table_mut().unwrap());
    let programs = suite["program"].as_table_mut().unwrap();
    let all: Vec<String> = programs.keys().cloned().collect();
    for name in all {
        if keep.contains(&name.as_str()) {
            let program = programs[&name].as_table_mut().unwrap();
            moved(program);
            let offline = toml::Value::Array(vec!["offline".into()]);
            program.insert("modes".into(), offline);
        } else {
            programs.remove(&name);
        }
    }
    assert_eq!(programs.len(), keep.len(), "{keep:?}");
    suite.to_string()
}

fn bench(sandbox: &Sandbox, words: &[&str]) -> Process {
    sandbox.spawn("gantry-bench", words)
}

/// The report of a benchmark of these programs.
fn measured(sandbox: &Sandbox, programs: &[&str], out: &str) -> Value {
    sandbox.write("suite.toml", &shortened(programs));
    let words = ["perception", "suite.toml", "--cache", "cache", "--out", out];
    bench(sandbox, &words).wait_longer(LIMIT).expect_code(0);
    bench_report(sandbox, out)
}

/// An offline figure of a program, of its only task.
fn offline(report: &Value, program: &str, metric: &str) -> f64 {
    let runs = report["runs"].as_array().expect("runs");
    let run = runs
        .iter()
        .find(|run| run["program"] == program)
        .unwrap_or_else(|| panic!("no run of {program}"));
    assert_eq!(run["faults"], serde_json::json!([]), "{program}");
    let answered = run["counts"]["n_answered"].as_u64();
    assert!(answered > Some(0), "{program}: {}", run["counts"]);
    let value = &run["scores"][0]["offline"][metric];
    value
        .as_f64()
        .unwrap_or_else(|| panic!("{program} has no {metric}: {}", run["scores"]))
}

/// The bounds come from what the methods are known for elsewhere, or from what doing nothing gives;
/// none is a figure of ours.
#[test]
fn worked_programs_reach_what_their_methods_are_known_for() {
    let programs = [
        "dis",
        "dis_ultrafast",
        "sgbm",
        "sgbm_fast",
        "ground_plane",
        "colour_table",
        "hough",
        "kiss_icp",
        "lidar_detector",
        "norfair",
        "sort",
        "event_slices",
        "hog",
        "detector",
    ];
    let sandbox = Sandbox::new("worked-programs");
    let report = measured(&sandbox, &programs, "out");
    let of = |program: &str, metric: &str| offline(&report, program, metric);

    // Better than saying that nothing moves, which is an error of the whole motion: at 6 m/s and
    // 10 Hz the near half of the image moves by ten pixels and more. On KITTI 2015, DIS has Fl of
    // about 50 %, and its presets are ordered.
    assert!(of("dis", "Fl") < 50.0);
    assert!(of("dis", "EPE") < of("dis_ultrafast", "EPE"));
    // The same motion in the image of half the size, from events.
    assert!(of("event_slices", "EPE") < 8.0);
    // Block matching has about 10 % on KITTI; a sixteenth of the pixels is worse.
    assert!(of("sgbm", "D1") < 25.0);
    assert!(of("sgbm", "D1") < of("sgbm_fast", "D1"));
    // Networks have 0.05 to 0.15 on KITTI; without knowing anything, the same depth everywhere, it
    // is about 1.
    assert!((0.1..0.8).contains(&of("ground_plane", "AbsRel")));
    // One class everywhere is right for a third of the pixels of one class in fifteen.
    assert!((0.1..0.7).contains(&of("colour_table", "mIoU")));
    assert!(of("hough", "F1") > 0.2);
    // KISS-ICP drifts by half a percent on KITTI; here are 15 m, from a scan of half the lines.
    assert!(of("kiss_icp", "ATE") < 0.5);
    // Few objects are near in three seconds; all that is known is that it is no perfect detector.
    assert!((0.02..0.8).contains(&of("lidar_detector", "NDS")));
    // Boxes with a tenth missing, noise of a twentieth and half a false one an image: far from
    // perfect, far from nothing.
    for tracker in ["norfair", "sort"] {
        let hota = of(tracker, "HOTA");
        assert!((0.1..0.9).contains(&hota), "{tracker}: {hota}");
    }
    // Trained on photographs of people 96 pixels high; what is as small as here it may miss.
    assert!((0.0..0.6).contains(&of("hog", "AP")));

    // Boxes at random have 0. It was trained on pictures of other towns, of which it finds a third.
    assert!((0.01..0.9).contains(&of("detector", "AP")));

    // Offline, another run of the same program has the same scores to the last bit.
    let repeated = ["colour_table", "hough", "lidar_detector"];
    let again = measured(&sandbox, &repeated, "again");
    let scores = |report: &Value, program: &str| -> Value {
        let runs = report["runs"].as_array().expect("runs");
        let run = runs.iter().find(|run| run["program"] == program);
        run.expect("its run")["scores"][0]["offline"].clone()
    };
    for program in repeated {
        assert!(scores(&report, program).is_object(), "{program}");
        assert_eq!(
            scores(&report, program),
            scores(&again, program),
            "{program}"
        );
    }
}
