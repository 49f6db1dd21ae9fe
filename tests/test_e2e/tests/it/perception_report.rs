//! What the perception benchmark writes, opened with programs of others: its JSON with jsonschema,
//! its page with html5lib, its percentile files with HdrHistogram for Python, its COCO files with
//! pycocotools.

pub mod example;

use std::path::Path;

use consumer_metrics::coco_json::{CocoResult, CocoRuns, CocoTruth};
use consumer_perception::report::coco::{Category, CocoFiles, Image, ProgramResults};
use consumer_perception::report::{Files, Report, read, schema, terminal, write_all};
use serde_json::{Value, json};
use test_e2e::processes::venv_program;
use test_kit::Sandbox;
use test_kit::sandbox::repository;

/// Runs `perception_report.py`; its lines.
fn judge(sandbox: &Sandbox, words: &[&str]) -> Vec<String> {
    let script = repository().join("tests/test_e2e/python/perception_report.py");
    let words = [&[script.to_str().unwrap()], words].concat();
    let ended = sandbox
        .spawn_program("python", &venv_program("python"), &words, &[])
        .wait()
        .expect_code(0);
    ended.lines
}

fn text(path: &Path) -> &str {
    path.to_str().expect("sandbox paths are text")
}

/// The example, written into a folder of the sandbox.
fn written(sandbox: &Sandbox, files: &Files) -> (Report, std::path::PathBuf) {
    let folder = sandbox.path("report");
    let report = example::report(&folder);
    let written = write_all(&report, &folder, files).unwrap();
    for file in &written.files {
        assert!(file.exists(), "{}", file.display());
    }
    (report, folder)
}

#[test]
fn the_report_fits_its_schema_and_mistakes_do_not() {
    let sandbox = Sandbox::new("schema");
    let (report, folder) = written(&sandbox, &Files::default());
    let document: Value =
        serde_json::from_str(&std::fs::read_to_string(folder.join("report.json")).unwrap())
            .unwrap();
    assert_eq!(
        document,
        serde_json::to_value(read(&folder).unwrap()).unwrap()
    );
    assert_eq!(
        document["runs"].as_array().unwrap().len(),
        report.runs.len()
    );
    let changed = |pointer: &str, value: Value| {
        let mut document = document.clone();
        *document
            .pointer_mut(pointer)
            .unwrap_or_else(|| panic!("no {pointer}")) = value;
        document
    };
    let mut cases = vec![json!({"name": "the report", "document": document, "valid": true})];
    let none = changed("/runs", json!([]));
    cases.push(json!({"name": "no runs", "document": none, "valid": true}));
    for (pointer, value) in [
        ("/runs", json!({})),
        ("/suite", json!(3)),
        ("/seed", json!(-1)),
        ("/runs/0/mode", json!("lockstep")),
        ("/runs/0/scores/0/offline", json!({"AP": "much"})),
        ("/runs/1/scenarios/0/latency/work", json!({"n": 3})),
        ("/machine", json!({"cpu": "x", "colour": "red"})),
    ] {
        cases.push(json!({"name": pointer, "document": changed(pointer, value), "valid": false}));
    }
    let mut more = document.clone();
    more["runs"][0]["more"] = json!(1);
    cases.push(json!({"name": "an unknown key", "document": more, "valid": false}));
    let lines: Vec<String> = cases.iter().map(Value::to_string).collect();
    let documents = sandbox.write("documents.jsonl", &lines.join("\n"));
    let schema = sandbox.write("schema.json", &schema::text());
    let found = judge(&sandbox, &["schema", text(&schema), text(&documents)]);
    assert_eq!(found, [format!("validated {} documents", cases.len())]);
}

#[test]
fn the_page_is_well_formed_and_complete_and_needs_nothing_from_elsewhere() {
    let sandbox = Sandbox::new("page");
    let (report, folder) = written(&sandbox, &Files::default());
    let found = judge(&sandbox, &["page", text(&folder)]);
    // Two delay curves, distance, occlusion and light offline and streaming, the parts of flow
    // likewise, four kinds of latency, a time line for each of six scenarios.
    assert!(
        found[0].starts_with("20 plots, 16 pictures, "),
        "{}",
        found[0]
    );
    let words = &found[1];
    for scenario in &report.scenarios {
        assert!(words.contains(&scenario.name), "{}", scenario.name);
    }
    for part in [
        "stumbling <dis>",
        "Without time hog is best (0.569); in real time blobs is (0.310), and hog reaches 0.166.",
        "'it'\\''s \"quoted\" & <odd>'",
        "llvmpipe",
        "load 2.31 on 2 cores",
        "ended with exit code 1 after 214 frames",
        "gantry bench perception launch/bench/example.toml",
        "px behind",
    ] {
        assert!(words.contains(part), "{part} is missing in {words}");
    }
}

#[test]
fn a_report_without_runs_still_makes_a_page() {
    let sandbox = Sandbox::new("page");
    let folder = sandbox.path("report");
    let mut report = example::report(&folder);
    report.runs.truncate(1);
    write_all(&report, &folder, &Files::default()).unwrap();
    let found = judge(&sandbox, &["page", text(&folder)]);
    assert!(
        found[1].contains("No run in real time has a result."),
        "{}",
        found[1]
    );
    report.runs.clear();
    report.scenarios.clear();
    write_all(&report, &folder, &Files::default()).unwrap();
    let found = judge(&sandbox, &["page", text(&folder)]);
    assert!(found[0].starts_with("0 plots, 0 pictures"), "{}", found[0]);
    assert!(terminal(&report, false).contains("0 programs"));
}

#[test]
fn percentile_files_are_those_of_hdrhistogram() {
    let sandbox = Sandbox::new("hgrm");
    let (_, folder) = written(&sandbox, &Files::default());
    // Eight runs with four distributions each.
    assert_eq!(
        judge(&sandbox, &["hgrm", text(&folder)]),
        ["32 percentile files"]
    );
}

/// Two images; a perfect result and one that has half of the objects.
fn coco_files() -> Files {
    let boxes = [[10.0, 10.0, 40.0, 40.0], [100.0, 20.0, 50.0, 60.0]];
    let square = CocoRuns {
        size: [100, 200],
        // A block of 40 × 40 from (10, 10): 1010 pixels before it, then 40 of each column of 100.
        counts: String::new(),
    };
    let mut sets = Vec::new();
    for task in ["boxes2d", "masks"] {
        let is_mask = task == "masks";
        let mask = |left: u32| CocoRuns {
            counts: runs_of_block(left, 10, 40, 40, 200, 100),
            ..square.clone()
        };
        let (mut truths, mut perfect, mut half) = (Vec::new(), Vec::new(), Vec::new());
        for image_id in [1, 2] {
            for (at, bbox) in boxes.iter().enumerate() {
                let segmentation = is_mask.then(|| mask(if at == 0 { 10 } else { 120 }));
                truths.push(CocoTruth {
                    id: truths.len() as u64 + 1,
                    image_id,
                    category_id: 1 + at as u32,
                    bbox: *bbox,
                    area: if is_mask { 1600.0 } else { bbox[2] * bbox[3] },
                    iscrowd: 0,
                    ignore: 0,
                    segmentation: segmentation.clone(),
                });
                let result = CocoResult {
                    image_id,
                    category_id: 1 + at as u32,
                    bbox: (!is_mask).then_some(*bbox),
                    score: 0.9,
                    segmentation,
                };
                if at == 0 {
                    half.push(result.clone());
                }
                perfect.push(result);
            }
        }
        let image = |id: u64| Image {
            id,
            file_name: format!("scenario/ego/front/rgb/{id}"),
            width: 200,
            height: 100,
            scenario: "scenario".into(),
            secs: id as f64,
        };
        sets.push(CocoFiles {
            task: task.into(),
            categories: ["car", "person"]
                .iter()
                .zip(1..)
                .map(|(name, id)| Category {
                    id,
                    name: (*name).into(),
                })
                .collect(),
            images: vec![image(1), image(2)],
            truths,
            results: vec![
                ProgramResults {
                    run: "half-offline".into(),
                    detections: half,
                },
                ProgramResults {
                    run: "perfect-offline".into(),
                    detections: perfect,
                },
            ],
        });
    }
    Files { coco: sets }
}

/// COCO's text of the runs of a block, computed by the program's own encoder of masks.
fn runs_of_block(left: u32, top: u32, width: u32, height: u32, columns: u32, rows: u32) -> String {
    let mut runs = vec![left * rows + top];
    for column in 0..width {
        runs.push(height);
        runs.push(if column + 1 < width {
            rows - height
        } else {
            (columns - left - width) * rows + rows - top - height
        });
    }
    consumer_truth::masks::runs_text(&runs)
}

#[test]
fn coco_files_are_scored_by_pycocotools() {
    let sandbox = Sandbox::new("coco");
    let (_, folder) = written(&sandbox, &coco_files());
    let lines = judge(&sandbox, &["coco", text(&folder)]);
    let found: Vec<&str> = lines
        .iter()
        .filter_map(|line| line.strip_prefix("FOUND "))
        .collect();
    // All objects of one class and none of the other: the mean over both is a half.
    let expected: Vec<String> = ["boxes2d", "masks"]
        .iter()
        .flat_map(|task| {
            [("half", 0.5), ("perfect", 1.0)]
                .map(|(name, ap)| format!("{task} {name}-offline AP {ap:.6} AP50 {ap:.6}"))
        })
        .collect();
    assert_eq!(found, expected);
}

#[test]
fn performance_has_the_keys_of_ros2_benchmark() {
    let sandbox = Sandbox::new("ros2");
    let (report, folder) = written(&sandbox, &Files::default());
    // The results that NVIDIA publishes in NVIDIA-ISAAC-ROS/ros2_benchmark, folder results.
    let published = [
        "RECEIVED_DURATION",
        "MEAN_PLAYBACK_FRAME_RATE",
        "MEAN_FRAME_RATE",
        "NUM_MISSED_FRAMES",
        "NUM_FRAMES_SENT",
        "FIRST_SENT_RECEIVED_LATENCY",
        "LAST_SENT_RECEIVED_LATENCY",
        "MAX_JITTER",
        "MIN_JITTER",
        "MEAN_JITTER",
        "STD_DEV_JITTER",
        // Of its calculator, where messages are matched.
        "FIRST_INPUT_LATENCY",
        "LAST_INPUT_LATENCY",
        "MAX_LATENCY",
        "MIN_LATENCY",
        "MEAN_LATENCY",
    ];
    for run in &report.runs {
        let path = folder.join(format!("ros2_benchmark/{}.json", run.file_stem()));
        let found: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
        for scenario in run.scenarios.iter().map(|it| it.scenario.as_str()) {
            for name in published {
                let key = format!("BasicPerformanceMetrics.{name}");
                assert!(
                    found[&key].is_number() && found[scenario][&key].is_number(),
                    "{key}"
                );
            }
        }
        assert!(found["metadata"]["BenchmarkMetadata.TEST_DATETIME"].is_string());
    }
    let path = folder.join("ros2_benchmark/blobs-streaming.json");
    let found: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    // 400 frames at 20 Hz, 19.95 s from the first to the last.
    let rate = found["BasicPerformanceMetrics.MEAN_PLAYBACK_FRAME_RATE"]
        .as_f64()
        .unwrap();
    assert!((rate - 400.0 / 19.95).abs() < 1e-6, "{rate}");
    assert_eq!(found["BasicPerformanceMetrics.NUM_FRAMES_SENT"], 400.0);
}

#[test]
fn the_terminal_has_a_table_per_task_within_its_columns() {
    let sandbox = Sandbox::new("terminal");
    let mut report = example::report(&sandbox.path("report"));
    report.runs[0]
        .faults
        .push("a fault with a very long story ".repeat(12));
    let plain = terminal(&report, false);
    for line in plain.lines() {
        assert!(
            line.chars().count() <= 100,
            "{} columns: {line}",
            line.chars().count()
        );
    }
    assert!(!plain.contains('\u{1b}'));
    let coloured = terminal(&report, true);
    let mut stripped = String::new();
    for (at, part) in coloured.split("\u{1b}[").enumerate() {
        stripped += if at == 0 {
            part
        } else {
            part.split_once('m').unwrap().1
        };
    }
    assert!(
        coloured.len() > plain.len() && stripped == plain,
        "colours change nothing but colours"
    );
    for part in [
        "boxes2d: AP",
        "flow: EPE [px]",
        "hog 0.5x",
        "single: the next frame comes with the answer",
        "! warning: the machine was busy",
    ] {
        assert!(plain.contains(part), "{part} is missing in\n{plain}");
    }
}
