//! `gantry bench perception` and programs that go wrong: each fault is a sentence in the report,
//! none ends the benchmark, and a killed benchmark leaves nothing behind that is taken for whole.

use std::time::Duration;

use serde_json::Value;
use test_e2e::{python_package, venv_program};
use test_kit::patience::eventually;
use test_kit::sandbox::repository;
use test_kit::{Ended, Sandbox};

/// A second and a half of an empty street: 15 images, of which 10 count.
const SUITE: &str = r#"version = 1
settle_s = 0.2
warm_up_s = 0.5
secs = 1.0
tick_hz = 20
answer_within_s = 20
ready_within_s = 600
[matrix]
maps = ["Town01"]
densities = ["empty"]
[rig.car.sensor.front]
kind = "camera"
rate_hz = 10
width_px = 64
height_px = 48
mount.position_m = [0.6, 0.0, 1.6]
[[task]]
kind = "boxes2d"
sensor = "front"
"#;

/// A benchmark takes a minute here; only a hang reaches this.
const LIMIT: Duration = Duration::from_secs(1800);

/// A table of the suite with a fake program that behaves as `words` say.
fn program(name: &str, words: &[&str], more: &str) -> String {
    let script = repository().join("tests/test_e2e/python/perception_fake.py");
    let words: String = words.iter().map(|word| format!(", {word:?}")).collect();
    format!(
        "[program.{name}]\ncmd = [{:?}, {:?}{words}]\n{more}\nenv = {{ PYTHONPATH = {:?}, PYTHONDONTWRITEBYTECODE = \"1\" }}\n",
        venv_program("python"),
        script,
        python_package(),
    )
}

fn bench(sandbox: &Sandbox, suite: &str, words: &[&str]) -> Ended {
    sandbox.write("suite.toml", suite);
    let all = [&["perception", "suite.toml", "--cache", "cache"], words].concat();
    sandbox.spawn("gantry-bench", &all).wait_longer(LIMIT)
}

#[test]
fn programs_that_crash_flood_or_keep_silent_do_not_end_the_benchmark() {
    let sandbox = Sandbox::new("perception-faults");
    let restart = "restart = { policy = \"on-failure\", delay = \"100ms\", max = 100 }";
    let suite = SUITE.replace("ready_within_s = 600", "ready_within_s = 60")
        + &program("crash", &["crash"], "modes = [\"offline\"]")
        + &program(
            "again",
            &["crash"],
            &format!("modes = [\"offline\"]\n{restart}"),
        )
        + &program("flood", &["flood"], "")
        + &program("ended", &["ended"], "")
        + &program("every", &["every"], "modes = [\"offline\"]");
    bench(&sandbox, &suite, &["--out", "out"]).expect_code(0);
    let text = std::fs::read_to_string(sandbox.path("out/report.json")).expect("a report");
    let report: Value = serde_json::from_str(&text).expect("JSON");
    let runs = report["runs"].as_array().expect("runs");
    let of = |program: &str, mode: &str| {
        let is = |run: &&Value| run["program"] == program && run["mode"] == mode;
        let run = runs.iter().find(is);
        let run = run.unwrap_or_else(|| panic!("no {program} {mode}"));
        let count = |what: &str| run["counts"][what].as_u64().expect("a count");
        (
            [count("n_frames"), count("n_answered")],
            count("n_results") + count("n_lost"),
            run["faults"].to_string(),
        )
    };
    // Eight images, of which five are warm-up; the others nobody answers.
    let (counts, _, faults) = of("crash", "offline");
    assert_eq!(counts, [10, 3], "{faults}");
    assert!(faults.contains("crash ended with exit code 3"), "{faults}");
    // Started again, it answers what comes then.
    let (counts, _, faults) = of("again", "offline");
    assert!(counts[1] > 3, "{counts:?}: {faults}");
    assert!(faults.contains("restarting again in 100 ms"), "{faults}");
    for mode in ["offline", "streaming"] {
        let (_, results, faults) = of("flood", mode);
        assert!(results > 1000, "{mode}: {results} results, {faults}");
        let (counts, results, faults) = of("ended", mode);
        assert_eq!((counts, results), ([10, 0], 0), "{mode}");
        assert!(faults.contains("ended with exit code 0"), "{faults}");
    }
    assert_eq!(of("flood", "offline").0, [10, 10]);
    // The one behind them is none the worse.
    let (counts, results, faults) = of("every", "offline");
    assert_eq!((counts, results, faults.as_str()), ([10, 10], 10, "[]"));
}

#[test]
fn a_program_that_says_nothing_is_waited_for_only_so_long() {
    let sandbox = Sandbox::new("perception-shy");
    let suite = SUITE.replace("ready_within_s = 600", "ready_within_s = 2")
        + &program(
            "shy",
            &["shy"],
            "results = { \"fake/boxes\" = \"boxes2d\" }",
        );
    bench(&sandbox, &suite, &["--out", "out", "--modes", "streaming"]).expect_code(0);
    let text = std::fs::read_to_string(sandbox.path("out/report.json")).expect("a report");
    let report: Value = serde_json::from_str(&text).expect("JSON");
    let run = &report["runs"][0];
    assert_eq!(run["counts"]["n_results"], 0);
    let faults = run["faults"].to_string();
    assert!(
        faults.contains("was not ready within 2 s") && faults.contains("fake/boxes"),
        "{faults}"
    );
}

#[test]
fn a_killed_benchmark_leaves_no_recording_that_is_taken_for_whole() {
    let sandbox = Sandbox::new("perception-killed");
    sandbox.write("suite.toml", SUITE);
    let words = [
        "perception",
        "suite.toml",
        "--cache",
        "cache",
        "--truth-only",
    ];
    let killed = sandbox.spawn("gantry-bench", &words);
    let cache = sandbox.path("cache");
    let names = || {
        let entries = std::fs::read_dir(&cache).into_iter().flatten().flatten();
        let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
        names.collect::<Vec<String>>()
    };
    eventually("the recorder writes", || {
        let is_half = |name: &String| {
            let half = cache.join(name).join("truth.mcap.part");
            name.contains("-making-") && half.exists()
        };
        names().into_iter().find(is_half)
    });
    killed.kill9();
    eventually("what it started has ended", || {
        let own = sandbox.dir().to_string_lossy().into_owned();
        let processes = std::fs::read_dir("/proc").into_iter().flatten().flatten();
        let mut lines = processes.filter_map(|it| std::fs::read(it.path().join("cmdline")).ok());
        (!lines.any(|line| String::from_utf8_lossy(&line).contains(&own))).then_some(())
    });
    let whole = |name: &String| name.ends_with(".mcap") || name.ends_with(".json");
    assert!(!names().iter().any(whole), "{:?}", names());
    sandbox
        .spawn("gantry-bench", &words)
        .wait_longer(LIMIT)
        .expect_code(0);
    assert_eq!(names().iter().filter(|name| whole(name)).count(), 2);
}

#[test]
fn what_is_wrong_with_a_suite_is_a_sentence_and_nothing_starts() {
    let sandbox = Sandbox::new("perception-wrong");
    for (from, to, words, sentence) in [
        (
            "secs = 1.0",
            "secs = -1.0",
            vec!["--", "x"],
            "secs = -1; it lies in",
        ),
        (
            "\"Town01\"",
            "\"Town01\"",
            vec![],
            "give a command behind --",
        ),
        ("\"boxes2d\"", "\"boxes9d\"", vec!["--", "x"], "boxes9d"),
        (
            "\"Town01\"",
            "\"Town01\"",
            vec!["--scenarios", "night*", "--", "x"],
            "there is Town01_clear_noon_s1",
        ),
        (
            "\"Town01\"",
            "\"Town01\"",
            vec!["--modes", "constant", "--fps", "9000", "--", "x"],
            "0.01 to 100 times as fast",
        ),
        (
            "\"Town01\"",
            "\"Town01\"",
            vec!["--recording", "none.mcap", "--", "x"],
            "none.mcap",
        ),
    ] {
        let suite = SUITE.replace(from, to);
        let ended = bench(&sandbox, &suite, &words).expect_code(2);
        assert!(ended.says(sentence), "{sentence}: {:#?}", ended.lines);
    }
}
