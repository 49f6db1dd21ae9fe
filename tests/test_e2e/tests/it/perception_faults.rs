//! `gantry bench perception` and programs that go wrong: each fault is a sentence in the report,
//! none ends the benchmark, and a killed benchmark leaves nothing behind that is taken for whole.

use nix::sys::signal::Signal;
use serde_json::Value;
use test_e2e::benchmark::{BENCH_LIMIT, fake_program, start_bench, street};
use test_kit::patience::eventually;
use test_kit::{Ended, Sandbox};

/// A second and a half of an empty street: 15 images, of which 10 count.
fn suite() -> String {
    street(1.0, 20)
}

fn bench(sandbox: &Sandbox, suite: &str, words: &[&str]) -> Ended {
    start_bench(sandbox, suite, words).wait_longer(BENCH_LIMIT)
}

#[test]
fn programs_that_crash_flood_or_keep_silent_do_not_end_the_benchmark() {
    let sandbox = Sandbox::new("perception-faults");
    let restart = "restart = { policy = \"on-failure\", delay = \"100ms\", max = 100 }";
    let suite = suite().replace("ready_within_s = 600", "ready_within_s = 60")
        + &fake_program("crash", &["crash", "1.0"], "modes = [\"offline\"]")
        + &fake_program(
            "again",
            // Frames that nobody answers are soon over; some are to be left for the second start.
            &["crash", "0.1"],
            &format!("modes = [\"offline\"]\n{restart}"),
        )
        + &fake_program("flood", &["flood"], "")
        + &fake_program("ended", &["ended"], "")
        + &fake_program("every", &["every"], "modes = [\"offline\"]");
    // The report is written, and the command says that a program crashed.
    bench(&sandbox, &suite, &["--out", "out"]).expect_code(1);
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

/// A table of the suite with a program that notes its starts in a file, and waits for `go` if it is
/// told to.
fn noting_program(name: &str, waits: bool) -> String {
    let wait = if waits {
        "while [ ! -e go ]; do sleep 0.1; done; "
    } else {
        ""
    };
    let shell = format!("echo start >> starts-{name}; {wait}exec \"$@\"");
    fake_program(name, &["every"], "modes = [\"offline\"]").replacen(
        "cmd = [",
        &format!("cmd = [\"sh\", \"-c\", {shell:?}, \"sh\", "),
        1,
    )
}

#[test]
fn a_stopped_benchmark_goes_on_with_the_runs_that_have_finished() {
    let sandbox = Sandbox::new("perception-resume");
    let suite = suite() + &noting_program("first", false) + &noting_program("second", true);
    let starts = |name: &str| {
        let text = std::fs::read_to_string(sandbox.path(&format!("starts-{name}")));
        text.unwrap_or_default().lines().count()
    };
    let stopped = start_bench(&sandbox, &suite, &["--out", "out", "--seed"]);
    eventually("the second program starts", || {
        (starts("second") > 0).then_some(())
    });
    // Nothing that programs see tells the seed.
    assert!(!sandbox.path("out/stopped.json").exists());
    stopped.signal(Signal::SIGINT);
    let stopped = stopped.wait_longer(BENCH_LIMIT).expect_code(1);
    assert!(stopped.says("--resume"), "{:#?}", stopped.lines);
    sandbox.write("go", "");
    let other = ["--resume", "out", "--added-delay", "5"];
    let ended = bench(&sandbox, &suite, &other).expect_code(2);
    assert!(ended.says("that was another suite"), "{:#?}", ended.lines);
    bench(&sandbox, &suite, &["--resume", "out"]).expect_code(0);
    assert_eq!((starts("first"), starts("second")), (1, 2));
    let text = std::fs::read_to_string(sandbox.path("out/report.json")).expect("a report");
    let report: Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(report["has_drawn_seed"], true);
    for run in report["runs"].as_array().expect("runs") {
        assert_eq!(run["counts"]["n_answered"], 10, "{}", run["program"]);
        assert_eq!(run["scores"][0]["task"], "boxes2d", "{}", run["program"]);
    }
    assert!(!sandbox.path("out/finished").exists());
    let ended = bench(&sandbox, &suite, &["--resume", "out"]).expect_code(2);
    assert!(
        ended.says("no benchmark that was stopped"),
        "{:#?}",
        ended.lines
    );
}

#[test]
fn a_program_that_says_nothing_is_waited_for_only_so_long() {
    let sandbox = Sandbox::new("perception-shy");
    let suite = suite().replace("ready_within_s = 600", "ready_within_s = 2")
        + &fake_program(
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
    sandbox.write("suite.toml", &suite());
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
        .wait_longer(BENCH_LIMIT)
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
        let suite = suite().replace(from, to);
        let ended = bench(&sandbox, &suite, &words).expect_code(2);
        assert!(ended.says(sentence), "{sentence}: {:#?}", ended.lines);
    }
}
