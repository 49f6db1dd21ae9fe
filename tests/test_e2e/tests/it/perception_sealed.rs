//! `gantry bench perception` and programs that cheat: by each way in they find nothing, on a replay
//! and beside a live simulator.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use test_e2e::benchmark::{BENCH_LIMIT, bench_report, street};
use test_e2e::{python_package, venv_program};
use test_kit::sandbox::repository;
use test_kit::{Ended, Sandbox};

/// Two and a half seconds of a street with a few others, a camera and an event camera.
fn suite() -> String {
    street(2.0, 20)
        .replace("\"empty\"", "\"few\"")
        .replace("settle_s = 0.2", "settle_s = 2.0")
        + "[density.few]\nvehicles = 6\nwalkers = 6\n\
           [rig.car.sensor.events]\nkind = \"camera\"\nmodalities = [\"dvs\"]\nrate_hz = 20\nwidth_px = 64\nheight_px = 48\n\
           [[task]]\nkind = \"depth\"\nsensor = \"front\"\n\
           [[task]]\nkind = \"flow\"\nsensor = \"front\"\n\
           [[task]]\nkind = \"odometry\"\nsensor = \"front\"\n"
}

/// A table of the suite with a program that cheats; what it finds goes to `found-KIND.json`.
fn cheat(sandbox: &Sandbox, kind: &str, table: &str) -> String {
    let script = repository().join("tests/test_e2e/python/perception_cheat.py");
    let (topic, task) = match kind {
        "header" | "still" | "table" => ("cheat/pose", "odometry"),
        _ => ("cheat/boxes", "boxes2d"),
    };
    format!(
        "[program.{kind}]\ncmd = [{:?}, {script:?}, {kind:?}, {:?}, {table:?}]\nmodes = [\"offline\"]\n\
         results = {{ {topic:?} = {task:?} }}\n\
         env = {{ PYTHONPATH = {:?}, PYTHONDONTWRITEBYTECODE = \"1\" }}\n",
        venv_program("python"),
        found_path(sandbox, kind),
        python_package(),
    )
}

fn found_path(sandbox: &Sandbox, kind: &str) -> PathBuf {
    sandbox.path(&format!("found-{kind}.json"))
}

fn found(sandbox: &Sandbox, kind: &str) -> Value {
    let text = std::fs::read_to_string(found_path(sandbox, kind)).expect("what a program found");
    serde_json::from_str(&text).expect("JSON")
}

/// Runs the suite with a cache to which no program is led.
fn bench(sandbox: &Sandbox, cache: &Path, suite: &str, words: &[&str]) -> Ended {
    sandbox.write("suite.toml", suite);
    let cache = cache.to_str().expect("a path of letters");
    let all = [&["perception", "suite.toml", "--cache", cache], words].concat();
    sandbox
        .spawn("gantry-bench", &all)
        .wait_longer(BENCH_LIMIT)
        .expect_code(0)
}

fn run<'a>(report: &'a Value, program: &str) -> &'a Value {
    let mut runs = report["runs"].as_array().expect("runs").iter();
    let found = runs.find(|run| run["program"] == program);
    found.unwrap_or_else(|| panic!("no run of {program}"))
}

/// Metres by which a program's path is wrong.
fn ate_m(report: &Value, program: &str) -> f64 {
    let run = run(report, program);
    let scores = run["scores"].as_array().expect("scores");
    let score = scores.iter().find(|score| score["task"] == "odometry");
    let value = score.and_then(|score| score["offline"]["ATE"].as_f64());
    value.unwrap_or_else(|| panic!("no ATE of {program}: {run}"))
}

/// Every way in but a table, from one kind of source.
fn cheats_find_nothing(source: &str) {
    let sandbox = Sandbox::new(&format!("perception-sealed-{source}"));
    let elsewhere = Sandbox::new("perception-cache");
    let cache = elsewhere.path("cache");
    let kinds = [
        "header",
        "still",
        "snapshot",
        "documents",
        "commands",
        "topics",
        "numbers",
        "files",
    ];
    let mut suite = suite();
    for kind in kinds {
        suite += &cheat(&sandbox, kind, "");
    }
    let words = ["--out", "out", "--source", source];
    let ended = bench(&sandbox, &cache, &suite, &words);
    assert!(ended.says("sealed: programs reached their inputs"));
    let report = bench_report(&sandbox, "out");
    assert_eq!(report["is_sealed"], true);
    assert_eq!(report["given_truth"], json!([]));
    for kind in kinds {
        let run = run(&report, kind);
        assert_eq!(run["faults"], json!([]), "{kind}");
        assert_eq!(run["counts"]["n_answered"], 20, "{kind}");
    }
    // One pose for all frames, the suite's mount; so it knows as much as one that knows nothing.
    assert_eq!(found(&sandbox, "header"), json!([[0.6, 0.0, 1.6]]));
    let (by_header, still) = (ate_m(&report, "header"), ate_m(&report, "still"));
    assert!((by_header - still).abs() < 1e-6, "{by_header} {still}");
    assert!(
        still > 0.1,
        "the car drove, but a path that stands still is wrong by {still} m"
    );
    // A snapshot per image at least, and nobody in any of them.
    let actors = found(&sandbox, "snapshot");
    let actors = actors.as_array().expect("numbers of actors");
    assert!(
        actors.len() >= 25 && actors.iter().all(|n| *n == 0),
        "{actors:?}"
    );
    let documents = found(&sandbox, "documents");
    assert_eq!(
        documents,
        json!({"documents": {}, "info": {"map": "", "seed": 0, "adapter": ""}})
    );
    for (command, answer) in found(&sandbox, "commands").as_object().expect("answers") {
        let answer = answer.as_str().expect("a sentence");
        assert!(
            answer.contains("this world is sealed"),
            "{command}: {answer}"
        );
    }
    // The truth's own sensors are silent, and the replay does not even have them.
    let topics = found(&sandbox, "topics");
    for (topic, n_frames) in topics.as_object().expect("topics") {
        let is_input = topic == "ego/events/dvs";
        assert!(is_input || *n_frames == 0, "{topic}: {n_frames} frames");
    }
    let events = found(&sandbox, "numbers");
    assert!(events["events"].as_u64() > Some(0), "{events}");
    assert_eq!(events["numbered"], 0);
    assert_eq!(found(&sandbox, "files"), json!([]));
}

#[test]
fn cheats_find_nothing_on_a_replay() {
    cheats_find_nothing("replay");
}

#[test]
fn cheats_find_nothing_beside_a_live_simulator() {
    cheats_find_nothing("live");
}

#[test]
fn events_keep_numbers_and_classes_where_the_suite_gives_them() {
    let sandbox = Sandbox::new("perception-given");
    let elsewhere = Sandbox::new("perception-cache");
    let cache = elsewhere.path("cache");
    let suite = suite().replace("settle_s", "exact_inputs = [\"ego/events/dvs\"]\nsettle_s")
        + &cheat(&sandbox, "numbers", "");
    let ended = bench(&sandbox, &cache, &suite, &["--out", "out"]);
    assert!(ended.says("given on purpose: ego/events/dvs"));
    let events = found(&sandbox, "numbers");
    assert!(events["numbered"].as_u64() > Some(0), "{events}");
}

/// What is made for all programs was made from the truth, whose sensors are where they are.
#[test]
fn headers_of_results_that_are_inputs_say_no_pose() {
    let sandbox = Sandbox::new("perception-results");
    let elsewhere = Sandbox::new("perception-cache");
    let cache = elsewhere.path("cache");
    let script = repository().join("launch/bench/programs/noisy_boxes.py");
    let input = format!(
        "[input.noisy_boxes]\ncmd = [{:?}, {script:?}]\n\
         params = {{ truth = \"ego/front_truth\", rate_hz = 20 }}\n\
         env = {{ PYTHONPATH = {:?}, PYTHONDONTWRITEBYTECODE = \"1\" }}\n",
        venv_program("python"),
        python_package(),
    );
    let program = cheat(&sandbox, "results", "").replace(
        "modes =",
        "inputs = [\"ego/front/rgb\", \"noisy/boxes\"]\nmodes =",
    );
    let suite = suite() + &input + &program;
    bench(&sandbox, &cache, &suite, &["--out", "out"]);
    let poses = found(&sandbox, "results");
    let poses = poses.as_array().expect("poses");
    assert!(poses.len() > 10, "{} results came", poses.len());
    let identity = json!([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
    assert!(poses.iter().all(|pose| *pose == identity), "{poses:?}");
}

/// The truth of a drive by tick: where the camera is.
fn table(cache: &Path) -> serde_json::Map<String, Value> {
    use schema_recording::read::{RecordingFile, TopicKind, What};
    let mut entries = std::fs::read_dir(cache).expect("a folder").flatten();
    let path = entries.find(|entry| entry.path().extension().is_some_and(|it| it == "mcap"));
    let file = RecordingFile::open(&path.expect("a recording").path()).expect("readable");
    let mut samples = file.samples_of((0, u64::MAX), |topic| {
        topic.kind == TopicKind::Frame && &*topic.name == "ego/front/rgb"
    });
    let mut table = serde_json::Map::new();
    while let Some(sample) = samples.next().expect("a readable file") {
        if let What::Frame { header, .. } = sample.what {
            let at = header.world_from_sensor.translation_m;
            table.insert(header.tick.to_string(), json!(at));
        }
    }
    table
}

#[test]
fn a_table_of_the_public_drive_is_worth_nothing_on_a_drawn_seed() {
    let sandbox = Sandbox::new("perception-table");
    let elsewhere = Sandbox::new("perception-cache");
    let cache = elsewhere.path("cache");
    let bare = suite() + &cheat(&sandbox, "still", "");
    bench(&sandbox, &cache, &bare, &["--truth-only"]);
    let table = Value::Object(table(&cache)).to_string();
    let path = sandbox.write("table.json", &table);
    let suite = bare + &cheat(&sandbox, "table", path.to_str().expect("a path of letters"));
    let public = bench(&sandbox, &cache, &suite, &["--out", "public"]);
    assert!(public.says("seed 1 is public"));
    let report = bench_report(&sandbox, "public");
    // Positions are exact there, and turns play no part in ATE.
    assert!(
        ate_m(&report, "table") < 1e-3,
        "{}",
        ate_m(&report, "table")
    );
    // Straight paths are alike once they are aligned, so the drives must differ in speed.
    for seed in ["2", "3", "4"] {
        let words = ["--out", seed, "--seed", seed];
        bench(&sandbox, &cache, &suite, &words);
        let report = bench_report(&sandbox, seed);
        let by_table = ate_m(&report, "table");
        assert!(by_table > 0.1, "seed {seed}: {by_table} m");
    }
}

#[test]
fn a_drawn_seed_stands_in_the_report_and_makes_the_same_drive_again() {
    let sandbox = Sandbox::new("perception-drawn");
    let elsewhere = Sandbox::new("perception-cache");
    let cache = elsewhere.path("cache");
    let suite = suite() + &cheat(&sandbox, "still", "");
    let drawn = bench(&sandbox, &cache, &suite, &["--out", "drawn", "--seed"]);
    let report = bench_report(&sandbox, "drawn");
    assert_eq!(report["has_drawn_seed"], true);
    let seed = report["seed"].as_u64().expect("a number");
    assert!(drawn.says(&format!("seed {seed} was drawn")));
    // Made anew, and not taken from the cache.
    let anew = elsewhere.path("anew");
    let words = ["--out", "again", "--seed", &seed.to_string()];
    bench(&sandbox, &anew, &suite, &words);
    let again = bench_report(&sandbox, "again");
    let hash = |report: &Value| report["scenarios"][0]["frames_hash"].clone();
    assert_eq!(hash(&again), hash(&report));
    assert_eq!(again["suite_hash"], report["suite_hash"]);
}
