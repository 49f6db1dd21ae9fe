//! Several launch files as one: layers, includes, and what two files may not say about one thing.

use std::collections::BTreeMap;
use std::io;
use std::path::{Component, Path, PathBuf};

use launch_spec::{FileText, Launch, LaunchErrors};

/// Loads `roots` from files that are given as (path, text).
fn load(files: &[(&str, &str)], roots: &[&str], sets: &[&str]) -> Result<Launch, LaunchErrors> {
    let files: BTreeMap<PathBuf, &str> = files
        .iter()
        .map(|(path, text)| (PathBuf::from(path), *text))
        .collect();
    let mut read = |path: &Path| {
        // Two names of one file: "./" does not tell them apart.
        let identity: PathBuf = path
            .components()
            .filter(|part| *part != Component::CurDir)
            .collect();
        let text = files
            .get(&identity)
            .ok_or_else(|| io::Error::from(io::ErrorKind::NotFound))?;
        let folder = Path::new("/runs").join(identity.parent().unwrap());
        Ok(FileText {
            identity,
            folder,
            text: (*text).to_owned(),
        })
    };
    let roots: Vec<PathBuf> = roots.iter().map(PathBuf::from).collect();
    let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
    Launch::load(&roots, &sets, &mut read)
}

fn errors(files: &[(&str, &str)], roots: &[&str]) -> Vec<String> {
    match load(files, roots, &[]) {
        Ok(_) => Vec::new(),
        Err(errors) => errors.0.iter().map(ToString::to_string).collect(),
    }
}

const BASE: &str = "version = 1
[scenario]
seed = 1
vehicles = 3
[sensor.front]
kind = \"camera\"
width_px = 320
[process.simd]
cmd = [\"simd\"]
[process.drive]
cmd = [\"gantry-drive\"]
env = { A = \"1\", B = \"1\" }
";

#[test]
fn later_files_add_and_override_key_by_key() {
    let over = "version = 1
[scenario]
seed = 9
[sensor.front]
height_px = 240
[process.drive]
env = { B = \"2\" }
[process.detector]
cmd = [\"python\", \"detector.py\"]
";
    let launch = load(
        &[("a.toml", BASE), ("b.toml", over)],
        &["a.toml", "b.toml"],
        &["scenario.vehicles=5"],
    )
    .unwrap();
    assert_eq!((launch.scenario.seed, launch.scenario.vehicles), (9, 5));
    let sensor_spec::SensorSpec::Camera(camera) = &launch.sensors["front"].spec else {
        panic!("a camera")
    };
    assert_eq!((camera.width_px, camera.height_px), (320, 240));
    let names: Vec<_> = launch.processes.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["simd", "drive", "detector"]);
    let env = &launch.process("drive").unwrap().env;
    assert_eq!((env["A"].as_str(), env["B"].as_str()), ("1", "2"));
}

#[test]
fn included_files_lie_beneath_and_count_once() {
    let files = [
        ("base.toml", BASE),
        (
            "sub/left.toml",
            "version = 1\ninclude = [\"../base.toml\"]\n[scenario]\nseed = 2\nvehicles = 4\n",
        ),
        (
            "sub/right.toml",
            "version = 1\ninclude = [\"../base.toml\"]\n[scenario]\nseed = 3\n",
        ),
        (
            "top.toml",
            "version = 1\ninclude = [\"sub/left.toml\", \"sub/right.toml\"]\n[process.last]\ncmd = [\"x\"]\n",
        ),
    ];
    // `..` is resolved by the reader; here the files are there under the names that are asked for.
    let files: Vec<(&str, &str)> = files
        .into_iter()
        .chain([("sub/../base.toml", BASE)])
        .collect();
    let launch = load(&files, &["top.toml"], &[]).unwrap();
    // The base is read once, beneath the first that includes it, so it does not undo "left".
    assert_eq!((launch.scenario.seed, launch.scenario.vehicles), (3, 4));
    let names: Vec<_> = launch.processes.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["simd", "drive", "last"], "included ones come first");
    let written = launch.to_toml_with_defaults();
    assert!(!written.contains("include"), "{written}");
    assert_eq!(Launch::parse(&written, "/runs/written").unwrap(), launch);
}

#[test]
fn paths_begin_in_the_folder_of_the_file_that_says_them() {
    let files = [
        (
            "base/base.toml",
            "version = 1\n[process.a]\ncmd = [\"a\"]\ncwd = \".\"\nvenv = \"../envs/torch\"\n",
        ),
        (
            "top.toml",
            "version = 1\ninclude = [\"base/base.toml\"]\n[process.b]\ncmd = [\"b\"]\ncwd = \"tools\"\nvenv = \"/opt/venv\"\n",
        ),
    ];
    let launch = load(&files, &["top.toml"], &[]).unwrap();
    let paths = |name: &str| {
        let process = launch.process(name).unwrap();
        (process.cwd.clone().unwrap(), process.venv.clone().unwrap())
    };
    assert_eq!(
        paths("a"),
        ("/runs/base".into(), "/runs/base/../envs/torch".into())
    );
    assert_eq!(paths("b"), ("/runs/tools".into(), "/opt/venv".into()));
}

#[test]
fn includes_in_a_circle_are_refused_with_the_chain() {
    let files = [
        ("a.toml", "version = 1\ninclude = [\"b.toml\"]\n"),
        ("b.toml", "version = 1\n\ninclude = [\"c.toml\"]\n"),
        ("c.toml", "include = [\"b.toml\"]\nversion = 1\n"),
        ("own.toml", "version = 1\ninclude = [\"./own.toml\"]\n"),
    ];
    assert_eq!(
        errors(&files, &["a.toml"]),
        ["include goes in a circle: b.toml → c.toml → b.toml; take one of them out at c.toml:1:11"]
    );
    assert_eq!(
        errors(&files, &["own.toml"]),
        ["include goes in a circle: own.toml → own.toml; take one of them out at own.toml:2:11"]
    );
}

#[test]
fn missing_and_broken_files_are_named() {
    let files = [
        (
            "a.toml",
            "version = 1\ninclude = [\"no.toml\"]\n[sensor.x]\nkind = 3\n",
        ),
        ("b.toml", "version = 1\ninclude = \"a.toml\"\n"),
        ("c.toml", "version = 1\ninclude = [\"d.toml\"]\n"),
        ("d.toml", "[scenario]\nseed = 1\n"),
        ("e.toml", "version = 1\n[scenario\n"),
    ];
    let one = |root: &str| {
        let errors = errors(&files, &[root]);
        assert_eq!(errors.len(), 1, "{errors:?}");
        errors[0].clone()
    };
    let message = one("a.toml");
    assert!(
        message.starts_with("include names \"no.toml\", but no.toml cannot be read: ")
            && message.ends_with(" at a.toml:2:11"),
        "{message}"
    );
    assert_eq!(
        one("b.toml"),
        "include is \"a.toml\", but must be a list of files, e.g. [\"base.toml\"] at b.toml:2:11"
    );
    assert_eq!(
        one("c.toml"),
        "version is missing; begin the file with version = 1 at d.toml:1:1"
    );
    assert!(one("e.toml").contains("e.toml:2:"), "{}", one("e.toml"));
    let message = one("gone.toml");
    assert!(
        message.starts_with("cannot read the launch file gone.toml: "),
        "{message}"
    );
    let error = load(&files, &["d.toml"], &["include=[\"a.toml\"]"]).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("include can only stand in a file"),
        "{error}"
    );
    let error = Launch::parse("version = 1\ninclude = [\"a.toml\"]\n", "x.toml").unwrap_err();
    assert!(error.to_string().contains("cannot be read"), "{error}");
}

#[test]
fn contradictions_name_both_files_and_lines() {
    let over = "version = 1
process.simd = 3
[scenario]
seed = { value = 3 }
[sensor.front]
kind = \"lidar\"
";
    assert_eq!(
        errors(&[("a.toml", BASE), ("b.toml", over)], &["a.toml", "b.toml"]),
        [
            "process.simd is 3, but a table at a.toml:8:1; one of them must go at b.toml:2:16",
            "scenario.seed is a table, but 1 at a.toml:3:8; one of them must go at b.toml:4:8",
            "sensor.front.kind is \"lidar\", but \"camera\" at a.toml:6:8; sensor.front can only be one of them: give the second a name of its own at b.toml:6:8",
        ]
    );
    let signs = "version = 1\n[process.simd]\nready = { line = \"up\" }\n";
    let base = format!("{BASE}[process.simd.ready]\nservice = \"world/snapshot\"\n");
    assert_eq!(
        errors(
            &[("a.toml", &base), ("b.toml", signs)],
            &["a.toml", "b.toml"]
        ),
        [
            "process.simd.ready has 2 signs, but must have one of service, line, tcp: the other is at a.toml:14:11; write service = \"\" to take that away at b.toml:3:18"
        ]
    );
    let taken = "version = 1\n[process.simd]\nready = { line = \"up\", service = \"\" }\n";
    let launch = load(
        &[("a.toml", &base), ("b.toml", taken)],
        &["a.toml", "b.toml"],
        &[],
    )
    .unwrap();
    let ready = launch.process("simd").unwrap().ready.clone().unwrap();
    assert_eq!(ready.when, launch_spec::ReadyWhen::Line("up".into()));
    let places = "version = 1\n[rig.pole]\nvehicle = 0\n";
    let base = format!("{BASE}[rig.pole]\npose.position_m = [0.0, 0.0, 6.0]\n");
    assert_eq!(
        errors(
            &[("a.toml", &base), ("b.toml", places)],
            &["a.toml", "b.toml"]
        ),
        [
            "[rig.pole] has both vehicle and pose; keep one: the other is at a.toml:14:1 at b.toml:3:1"
        ]
    );
}

#[test]
fn a_setting_may_make_something_else_of_a_thing() {
    let launch = load(
        &[("a.toml", BASE)],
        &["a.toml"],
        &["sensor.front={kind=\"imu\"}"],
    );
    let error = launch.unwrap_err().to_string();
    assert!(
        error.contains("unknown key \"width_px\" in [sensor.front]"),
        "the camera's keys are none of an IMU: {error}"
    );
}
