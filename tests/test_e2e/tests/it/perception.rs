//! `gantry bench perception` measured: programs that are late, silent, twice or out of order on
//! purpose are counted as what they are, and the same suite shows the same frames.

use std::path::Path;

use serde_json::Value;
use test_e2e::benchmark::{BENCH_LIMIT, bench_report, fake_program, start_bench, street};
use test_kit::{Ended, Sandbox, Setup, Simulator};

/// Two and a half seconds of an empty street: 25 images, of which 20 count.
fn suite() -> String {
    street(2.0, 10)
}

fn bench(sandbox: &Sandbox, suite: &str, words: &[&str]) -> Ended {
    start_bench(sandbox, suite, words)
        .wait_longer(BENCH_LIMIT)
        .expect_code(0)
}

/// The run of a program.
fn run<'a>(report: &'a Value, program: &str) -> &'a Value {
    let runs = report["runs"].as_array().expect("runs");
    let found = runs.iter().find(|run| run["program"] == program);
    found.unwrap_or_else(|| panic!("no run of {program}: {report}"))
}

fn count(run: &Value, what: &str) -> u64 {
    run["counts"][what].as_u64().expect("a count")
}

#[test]
fn what_programs_do_on_purpose_is_counted_as_that() {
    let sandbox = Sandbox::new("perception-counts");
    let kinds = [
        "every", "second", "twice", "swapped", "late", "never", "invented",
    ];
    let mut suite = suite();
    for kind in kinds {
        suite += &fake_program(kind, &[kind], "modes = [\"offline\"]");
    }
    bench(&sandbox, &suite, &["--out", "out"]);
    let report = bench_report(&sandbox, "out");
    // Images are numbered from 0; the first five are warm-up. `swapped` answers 5, then 7, 6, 9, 8,
    // … 23, 22, and keeps 24; `late` answers 0 to 22. An image that never was has no time, so
    // answers to it count during the warm-up too.
    for (kind, answered, results, repeated, out_of_order, invented) in [
        ("every", 20, 20, 0, 0, 0),
        ("second", 10, 10, 0, 0, 0),
        ("twice", 20, 40, 20, 0, 0),
        ("swapped", 19, 19, 0, 9, 0),
        ("late", 18, 18, 0, 0, 0),
        ("never", 0, 0, 0, 0, 0),
        ("invented", 20, 45, 0, 0, 25),
    ] {
        let run = run(&report, kind);
        let found = [
            "n_frames",
            "n_answered",
            "n_results",
            "n_repeated",
            "n_out_of_order",
            "n_invented",
            "n_lost",
            "n_unreadable",
        ]
        .map(|what| count(run, what));
        let expected = [
            20,
            answered,
            results,
            repeated,
            out_of_order,
            invented,
            0,
            0,
        ];
        assert_eq!(found, expected, "{kind}: {}", run["faults"]);
    }
    let faults = |kind: &str| run(&report, kind)["faults"].to_string();
    assert_eq!(faults("every"), "[]");
    for (kind, n) in [("second", 12), ("never", 25)] {
        let sentence = format!("{n} of 25 frames were not answered in time in lockstep");
        assert!(faults(kind).contains(&sentence), "{}", faults(kind));
    }
}

#[test]
fn a_known_delay_is_found_in_latency_and_age() {
    let sandbox = Sandbox::new("perception-delay");
    let suite = suite() + &fake_program("slow", &["slow", "0.15"], "");
    bench(&sandbox, &suite, &["--out", "out", "--modes", "streaming"]);
    let report = bench_report(&sandbox, "out");
    let run = run(&report, "slow");
    // The program sleeps this long between taking a frame and publishing.
    for which in ["answer", "work", "end_to_end"] {
        let least = run["latency"][which]["min"].as_f64().expect("a number");
        assert!(least >= 150.0, "{which}: {least} ms");
    }
    // In 2 s it can answer at most one image every 150 ms, and there are images left out.
    let answered = count(run, "n_answered");
    assert!((1..=14).contains(&answered), "{answered} of 20");
    // A result is 150 ms old at least when it comes, so it is never of the newest image.
    assert_eq!(count(run, "in_time"), 0);
    assert_eq!(count(run, "n_queries"), 20);
}

#[test]
fn a_stream_has_as_many_frames_as_asked_for() {
    let sandbox = Sandbox::new("perception-stress");
    let suite = suite() + &fake_program("every", &["every"], "");
    let words = [
        "--out",
        "out",
        "--modes",
        "constant,single",
        "--frames",
        "60",
    ];
    bench(&sandbox, &suite, &words);
    let report = bench_report(&sandbox, "out");
    let runs = report["runs"].as_array().expect("runs");
    assert_eq!(runs.len(), 2);
    for run in runs {
        // The recording, of which 20 images count, is gone through three times.
        let is_single = run["speed"] == 0.0;
        let (frames, answered) = (count(run, "n_frames"), count(run, "n_answered"));
        assert_eq!(frames, 60, "single: {is_single}");
        // In a single stream the next image comes with the answer; a constant one waits for nobody.
        let least = if is_single { 60 } else { 1 };
        assert!(answered >= least, "{answered}, single: {is_single}");
    }
}

#[test]
fn parts_are_joined_to_a_report_whose_frames_are_made_again() {
    let sandbox = Sandbox::new("perception-parts");
    let towns = "maps = [\"Town01\", \"Town02\"]";
    let suite = street(0.5, 10).replace("maps = [\"Town01\"]", towns)
        + &fake_program("every", &["every"], "modes = [\"offline\"]");
    let part = ["--out", "out", "--part", "--scenarios", "Town01*"];
    let ended = bench(&sandbox, &suite, &part);
    assert!(ended.says("the runs are kept in"), "{:#?}", ended.lines);
    assert!(!sandbox.path("out/report.json").exists());
    let ended = bench(&sandbox, &suite, &["--resume", "out"]);
    assert!(ended.says("in Town01_clear_noon_s1 had finished"));
    assert!(ended.says("to cite: Gantry "), "{:#?}", ended.lines);
    let report = bench_report(&sandbox, "out");
    let scenarios = report["scenarios"].as_array().expect("scenarios");
    assert_eq!(scenarios.len(), 2);
    assert_eq!(count(run(&report, "every"), "n_answered"), 10);

    let verify = |report: &str| {
        let words = [
            "verify",
            report,
            "--cache",
            "again",
            "--scenarios",
            "*Town02*",
        ];
        let process = sandbox.spawn("gantry-bench", &words);
        process.wait_longer(BENCH_LIMIT)
    };
    let ended = verify("out").expect_code(0);
    assert!(ended.says("the frames of 1 of 2 scenarios are those of the report"));
    let hash = scenarios[1]["frames_hash"].as_str().expect("a hash");
    let text = std::fs::read_to_string(sandbox.path("out/report.json")).expect("a report");
    sandbox.write("other.json", &text.replace(hash, &"0".repeat(64)));
    let ended = verify("other.json").expect_code(1);
    assert!(ended.says("other frames") && ended.says("its hashes were changed"));
    assert_eq!(count_files(&sandbox.path("again")), 0, "nothing is left");
}

/// A box that is moved by a tenth of its width overlaps itself by 0.9 / 1.1 = 0.818, which passes
/// seven of COCO's ten thresholds, 0.50 to 0.95; an exact one passes all.
#[test]
fn a_live_fake_in_traffic_has_the_score_that_its_error_says() {
    let sandbox = Sandbox::new("perception-live-fake");
    let place = "maps = [\"Town10HD\"]\nspawn_points = [126]\nseeds = [6]";
    let mut suite = street(1.5, 60)
        .replace("maps = [\"Town01\"]", place)
        .replace("\"empty\"", "\"street\"")
        .replace(
            "width_px = 64",
            "modalities = [\"rgb\", \"semantic\", \"instance\"]\nwidth_px = 320",
        )
        .replace("height_px = 48", "height_px = 180")
        // Ahead of the bonnet, which no truth has.
        .replace("[0.6, 0.0, 1.6]", "[2.6, 0.0, 1.4]")
        + "classes = [\"vehicle\"]\nignore = { min_pixels = 9, min_height_px = 4 }\n\
           [density.street]\nvehicles = 40\nwalkers = 60\n";
    for (name, share) in [("exact", "0.0"), ("moved", "0.1")] {
        suite += &fake_program(name, &[share], "modes = [\"offline\"]")
            .replace("perception_fake.py", "perception_shifted.py");
    }
    bench(&sandbox, &suite, &["--out", "out", "--source", "live"]);
    let report = bench_report(&sandbox, "out");
    for (name, expected) in [("exact", 1.0), ("moved", 0.7)] {
        let run = run(&report, name);
        let score = &run["scores"][0];
        let n = score["n_scored"].as_u64().expect("a number");
        assert!(n > 30, "{n} vehicles are seen");
        let found = score["offline"]["AP"].as_f64().expect("an AP");
        assert!((found - expected).abs() < 1e-6, "{name}: {found}, {score}");
    }
}

#[test]
fn the_same_suite_shows_the_same_frames_and_another_seed_others() {
    let sandbox = Sandbox::new("perception-same");
    let suite = street(0.5, 10);
    let hash = |suite: &str, cache: &str| {
        let words = ["--truth-only", "--cache", cache];
        sandbox.write("suite.toml", suite);
        let all = [&["perception", "suite.toml"][..], &words].concat();
        let ended = sandbox.spawn("gantry-bench", &all).wait_longer(BENCH_LIMIT);
        let ended = ended.expect_code(0);
        let line = ended.lines.iter().find(|line| line.contains(".mcap"));
        let line = line.unwrap_or_else(|| panic!("{:#?}", ended.lines));
        let hash = line.split(' ').find(|word| word.len() == 64);
        hash.expect("a hash").to_owned()
    };
    let first = hash(&suite, "one");
    assert_eq!(hash(&suite, "two"), first, "made twice");
    assert_eq!(hash(&suite, "one"), first, "kept");
    let traffic = suite.replace("\"empty\"", "\"light\"");
    assert_ne!(hash(&traffic, "one"), first);
    assert_eq!(count_files(&sandbox.path("one")), 4, "two recordings");
}

fn count_files(folder: &Path) -> usize {
    std::fs::read_dir(folder).expect("a folder").count()
}

#[test]
fn truth_at_every_millisecond_is_what_stepping_the_world_there_gives() {
    let sandbox = Sandbox::new("perception-1khz");
    let suite = suite()
        .replace(
            "tick_hz = 20",
            "tick_hz = 1000\nquery_hz = 1000\ndrive = false",
        )
        .replace("settle_s = 0.2", "settle_s = 0.0")
        .replace("warm_up_s = 0.5", "warm_up_s = 0.0")
        .replace("secs = 2.0", "secs = 0.05")
        .replace("rate_hz = 10", "rate_hz = 100")
        .replace("\"empty\"", "\"few\"")
        + "[density.few]\nvehicles = 6\nwalkers = 6\n";
    bench(&sandbox, &suite, &["--truth-only"]);
    let recorded = std::fs::read_dir(sandbox.path("cache")).expect("a folder");
    let paths = recorded.map(|entry| entry.expect("an entry").path());
    let path = paths
        .into_iter()
        .find(|path| path.extension().is_some_and(|it| it == "mcap"))
        .expect("a recording");
    // The same world with a camera that sees ids and depth at every tick, stepped by this test.
    let launch = "version = 1\n[scenario]\nmap = \"Town01\"\nseed = 1\ntick_hz = 1000\nvehicles = 6\nwalkers = 6\n\
                  [scenario.weather]\ncloudiness = 15.0\nwind_intensity = 10.0\nsun_altitude_deg = 65.0\nsun_azimuth_deg = -90.0\n\
                  [sensor.front_truth]\nkind = \"camera\"\nmodalities = [\"depth\", \"instance\"]\nrate_hz = 1000\n\
                  width_px = 64\nheight_px = 48\nmount.position_m = [0.6, 0.0, 1.6]\n";
    let mut simulator = Simulator::start(Setup::text(launch));
    let mut readers =
        ["depth", "instance"].map(|what| simulator.frames(&format!("ego/front_truth/{what}")));
    let mut file = Recorded::read(&path);
    let mut n_compared = 0;
    for tick in 1..=50 {
        assert_eq!(simulator.step(1), tick);
        for reader in &mut readers {
            let now = simulator.frame_of(reader, tick);
            let topic = now.topic().to_owned();
            let then = file.frames.remove(&(topic.clone(), tick));
            let then = then.unwrap_or_else(|| panic!("{topic} of tick {tick} is missing"));
            assert!(then == *now, "{topic} of tick {tick} differs");
            n_compared += 1;
        }
    }
    assert_eq!(n_compared, 100);
    drop(readers);
    simulator.finish();
}

/// Payloads of a recording by topic and tick.
struct Recorded {
    frames: std::collections::HashMap<(String, u64), Vec<u8>>,
}

impl Recorded {
    fn read(path: &Path) -> Recorded {
        use schema_recording::read::{RecordingFile, TopicKind, What};
        let file = RecordingFile::open(path).expect("a recording");
        let mut samples = file.samples_of((0, u64::MAX), |topic| topic.kind == TopicKind::Frame);
        let mut frames = std::collections::HashMap::new();
        while let Some(sample) = samples.next().expect("a readable file") {
            if let What::Frame {
                topic,
                header,
                mut payload,
            } = sample.what
            {
                let bytes = payload.to_vec().expect("a payload");
                frames.insert((topic.to_string(), header.tick), bytes);
            }
        }
        Recorded { frames }
    }
}
