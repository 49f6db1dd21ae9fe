//! Calibrations of cameras with a lens, live, recorded, replayed and exported, against OpenCV's own
//! projections.

use test_e2e::{document, join_bus, python_package, spawn_consumer, start_daemon, venv_program};
use test_kit::Sandbox;
use test_kit::sandbox::repository;

/// `calibrated_lenses.py` has the same numbers.
const CAMERAS: [(&str, &str); 4] = [
    (
        "straight",
        r#"model = "pinhole", focal_px = [100.0, 101.0], centre_px = [80.0, 60.0]"#,
    ),
    (
        "bent",
        r#"model = "opencv", focal_px = [90.0, 91.5], centre_px = [81.25, 58.5], coefficients = [-0.28, 0.09, 0.0011, -0.0007, -0.012]"#,
    ),
    (
        "fisheye",
        r#"model = "kannala_brandt", focal_px = [48.0, 48.5], centre_px = [79.0, 61.0], coefficients = [-0.0132, 0.0204, -0.0113, 0.0021]"#,
    ),
    (
        "even",
        r#"model = "equidistant", focal_px = [45.0, 45.0], centre_px = [80.0, 60.0]"#,
    ),
];

fn launch() -> String {
    let mut text = String::from(
        "version = 1\n[scenario]\nmap = \"Town01\"\nseed = 4\nvehicles = 0\nwalkers = 0\n",
    );
    for (name, lens) in CAMERAS {
        text += &format!(
            "[sensor.{name}]\nkind = \"camera\"\nmodalities = [\"depth\"]\nwidth_px = 160\nheight_px = 120\nlens = {{ {lens} }}\nmount.position_m = [0.6, 0.0, 1.6]\n"
        );
    }
    text
}

fn described(sandbox: &Sandbox) -> serde_json::Value {
    let text = document(&join_bus(sandbox, "look"), "world/info");
    let info: serde_json::Value = serde_json::from_str(&text.text).unwrap();
    let cameras = info["cameras"].clone();
    assert_eq!(cameras.as_array().map(Vec::len), Some(CAMERAS.len()));
    cameras
}

#[test]
fn live_recorded_replayed_and_exported_lenses_are_those_of_opencv() {
    let sandbox = Sandbox::new("lenses");
    let domain = sandbox.domain().to_owned();
    let script = repository().join("tests/test_e2e/python/calibrated_lenses.py");
    let package = python_package();
    let env = [
        ("PYTHONPATH", package.to_str().unwrap()),
        ("PYTHONDONTWRITEBYTECODE", "1"),
    ];
    let check = |words: &[&str]| {
        let args = [&[script.to_str().unwrap()], words].concat();
        let ended = sandbox
            .spawn_program("python", &venv_program("python"), &args, &env)
            .wait()
            .expect_code(0);
        let passed = format!("{} passed", words[0]);
        assert!(ended.says(&passed), "{:?}", ended.lines);
    };
    let daemon = start_daemon(&sandbox, &launch(), &[]);
    let recorder = spawn_consumer(&sandbox, "gantry-record", &["--out", "drive.mcap"]);
    check(&["live", &domain]);
    let live = described(&sandbox);
    for (name, _) in CAMERAS {
        let topic = format!("ego/{name}/depth");
        let words = ["sensor", "export", &topic, "--format", "opencv"];
        let written = spawn_consumer(&sandbox, "gantry", &words)
            .wait()
            .expect_code(0);
        let file = sandbox.path(&format!("{name}.yaml"));
        std::fs::write(&file, written.lines.join("\n") + "\n").unwrap();
        check(&["exported", name, file.to_str().unwrap()]);
    }
    recorder.stop().expect_code(0);
    daemon.stop().expect_code(0);
    check(&["recording", "drive.mcap"]);
    let replay = spawn_consumer(&sandbox, "gantry-replay", &["drive.mcap", "--loop"]);
    check(&["replay", &domain]);
    assert_eq!(described(&sandbox), live);
    replay.stop().expect_code(0);
}
