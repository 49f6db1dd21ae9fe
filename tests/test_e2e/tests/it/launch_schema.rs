//! `launch/launch.schema.json` against launch files, judged by an implementation of JSON Schema from
//! outside: what the reader accepts, the schema accepts, and it refuses the mistakes that an editor
//! can show.

use launch_spec::{FileText, Launch};
use serde_json::{Value, json};
use test_e2e::processes::venv_program;
use test_kit::Sandbox;
use test_kit::sandbox::repository;

const PIPELINE: &str = r#"version = 1
include = ["base.toml"]
[rig.pole]
pose.position_m = [0, 0, 6]
[rig.chaser]
vehicle = "ego"
[sensor.front]
kind = "camera"
width_px = 640
rig = ["ego", "pole"]
[sensor.roof]
kind = "lidar"
channels = 16
[topic."ego/front/rgb"]
readers = 4
buffer = 4
borrowed = 3
[topic."detector/boxes"]
type = "boxes2d"
max_bytes = 65536
[defaults]
env = { A = "1" }
[process.detector]
cmd = ["python", "detector.py", "--settings=${params}"]
cwd = "."
venv = "env"
ready = { service = "detector/boxes", within = "20 s" }
restart = { policy = "on-failure", delay = "1.5s" }
stop.signal = "TERM"
after = ["simd"]
cores = [0, 1]
nice = -5
lockstep = true
[process.detector.params]
threshold = 0.25
classes = ["car", { name = "person" }]
[process.simd]
cmd = ["simd"]
"#;

/// One change to [`PIPELINE`] each, which the reader refuses and an editor should show.
const MISTAKES: [(&str, &str); 19] = [
    ("version = 1", ""),
    ("version = 1", "version = 2"),
    ("include = [\"base.toml\"]", "include = \"base.toml\""),
    ("[0, 0, 6]", "[0, 6]"),
    ("channels = 16", "channels = 400"),
    ("channels = 16", "chanels = 16"),
    ("kind = \"lidar\"", "kind = \"lider\""),
    ("readers = 4", "readers = 0"),
    ("buffer = 4", "buffers = 4"),
    ("\"boxes2d\"", "\"boxes\""),
    ("detector/boxes\"]", "detector//boxes\"]"),
    ("within = \"20 s\"", "within = \"20 parsecs\""),
    ("\"on-failure\"", "\"onfailure\""),
    ("cores = [0, 1]", "cpus = [0, 1]"),
    ("cores = [0, 1]", "cores = [\"0\"]"),
    ("nice = -5", "nice = 20"),
    ("lockstep = true", "lockstep = \"yes\""),
    ("[process.detector]\n", "[process.Detector]\n"),
    ("[defaults]\n", "[default]\n"),
];

fn case(name: &str, text: &str, valid: bool) -> Value {
    let document: toml::Table = text
        .parse()
        .unwrap_or_else(|error| panic!("{name}: {error}"));
    json!({ "name": name, "document": document, "valid": valid })
}

#[test]
fn the_schema_and_the_reader_agree() {
    let sandbox = Sandbox::new("schema");
    // What is laid over another file need not repeat what that says.
    let over = "version = 1\n[sensor.front]\nwidth_px = 320\n[process.drive]\nnice = 5\n";
    let mut cases = vec![case("pipeline", PIPELINE, true), case("over", over, true)];
    for entry in std::fs::read_dir(repository().join("launch")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "toml") {
            continue;
        }
        let text = std::fs::read_to_string(&path).unwrap();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        assert!(
            text.starts_with("#:schema ./launch.schema.json\n"),
            "{name} does not name its schema, so editors cannot complete it"
        );
        cases.push(case(&name, &text, true));
        // The same with every key there is.
        let launch = Launch::load(&[path], &[], &mut FileText::read);
        let full = launch
            .unwrap_or_else(|errors| panic!("{errors}"))
            .to_toml_with_defaults();
        cases.push(case(&format!("{name} in full"), &full, true));
    }
    assert!(cases.len() > 8, "{} files", cases.len());
    let alone = |text: &str| text.replace("include = [\"base.toml\"]\n", "");
    Launch::parse(&alone(PIPELINE), "x").unwrap_or_else(|errors| panic!("{errors}"));
    for (right, wrong) in MISTAKES {
        let text = PIPELINE.replacen(right, wrong, 1);
        assert_ne!(text, PIPELINE, "{right:?} stands in the file");
        let name = format!("{wrong:?} for {right:?}");
        assert!(Launch::parse(&alone(&text), "x").is_err(), "{name}");
        cases.push(case(&name, &text, false));
    }
    let lines: Vec<String> = cases.iter().map(Value::to_string).collect();
    let documents = sandbox.write("documents.jsonl", &lines.join("\n"));
    let script = repository().join("tests/test_e2e/python/validate_launch.py");
    let schema = repository().join("launch/launch.schema.json");
    let words = [&script, &schema, &documents].map(|path| path.to_str().unwrap());
    let ended = sandbox
        .spawn_program("python", &venv_program("python"), &words, &[])
        .wait()
        .expect_code(0);
    assert_eq!(
        ended.lines,
        [format!("validated {} documents", cases.len())],
        "{:#?}",
        ended.lines
    );
}
