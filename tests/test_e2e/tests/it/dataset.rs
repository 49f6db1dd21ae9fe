//! `gantry-dataset`: recipes become sets, the same ones whatever is killed meanwhile.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;
use test_kit::patience::eventually;
use test_kit::{Process, Sandbox};

/// Two weathers, one small camera and one small lidar.
const RECIPE: &str = r#"version = 1
name = "tiny"
description = "a <tiny> set"
frames = 6
warm_up_s = 0.5
tick_hz = 10
vehicles = 8
walkers = 8
split = "train=1,val=1"
[matrix]
maps = ["Town01"]
weathers = ["clear", "storm"]
times = ["noon"]
[rig.car.sensor.front]
kind = "camera"
rate_hz = 10
modalities = ["rgb", "depth", "instance", "dvs"]
width_px = 96
height_px = 64
mount.position_m = [0.6, 0.0, 1.6]
[rig.car.sensor.roof]
kind = "lidar"
rate_hz = 5
channels = 4
[[export]]
format = "evt3"
[[export]]
format = "ros2-bag"
folder = "bag"
[[export]]
format = "coco"
"#;
const NAMES: [&str; 2] = ["Town01_clear_noon_s1", "Town01_storm_noon_s1"];
/// A set takes seconds here; the limit is far beyond that on any machine.
const LIMIT: Duration = Duration::from_secs(1800);

fn make(sandbox: &Sandbox, out: &str, more: &[&str]) -> Process {
    let mut words = vec!["make", "tiny.toml", "--out", out];
    words.extend(more);
    sandbox.spawn("gantry-dataset", &words)
}

fn text(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn manifest(sandbox: &Sandbox, set: &str) -> Value {
    serde_json::from_str(&text(&sandbox.path(&format!("{set}/manifest.json")))).unwrap()
}

/// The process `name` of the scenario that runs in the set, which its register names.
fn running(set: &Path, name: &str) -> Option<Pid> {
    let registers = fs::read_dir(set.join(".gantry-dataset/registers")).ok()?;
    registers.flatten().find_map(|entry| {
        let register: Value = serde_json::from_str(&fs::read_to_string(entry.path()).ok()?).ok()?;
        register["processes"].as_array()?.iter().find_map(|it| {
            let pid = it[0].as_i64()? as i32;
            let comm = fs::read_to_string(format!("/proc/{pid}/comm")).ok()?;
            comm.trim().starts_with(name).then_some(Pid::from_raw(pid))
        })
    })
}

/// Nothing of any set that was made by `maker` is left in shared memory.
fn assert_no_shared_memory(maker: u32) {
    let prefix = format!("gs{maker}x");
    let left: Vec<_> = fs::read_dir("/dev/shm")
        .unwrap()
        .flatten()
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .filter(|name| name.starts_with(&prefix))
        .collect();
    assert_eq!(left, Vec::<String>::new());
}

#[test]
fn killed_simulators_recorders_and_makers_change_nothing_in_the_set() {
    let sandbox = Sandbox::new("dataset");
    sandbox.write("tiny.toml", RECIPE);
    let quiet = make(&sandbox, "calm", &["--jobs", "1"]);
    let maker = quiet.pid();
    quiet.wait_longer(LIMIT).expect_code(0);
    assert_no_shared_memory(maker);
    let calm = manifest(&sandbox, "calm");
    let files: Vec<&String> = calm["files"].as_object().unwrap().keys().collect();
    for wanted in [
        "evt3/train/Town01_clear_noon_s1/front.raw",
        "evt3/val/Town01_storm_noon_s1/front.raw",
        "bag/train/Town01_clear_noon_s1/metadata.yaml",
        "summary.json",
        "index.html",
    ] {
        let other = wanted
            .replace("train", "x")
            .replace("val", "train")
            .replace("x/", "val/");
        let is_there = files.iter().any(|file| *file == wanted || **file == other);
        assert!(is_there, "{wanted}: {files:?}");
    }
    assert!(
        !sandbox.path("calm/recordings").exists() && !sandbox.path("calm/.gantry-dataset").exists()
    );
    check_summary(&sandbox.path("calm"));

    // A simulator, a recorder and a driver are killed, then the maker itself; two run at a time.
    let set = sandbox.path("rough");
    let mut rough = make(&sandbox, "rough", &["--jobs", "2"]);
    for name in ["simd", "gantry-record", "gantry-drive"] {
        eventually(&format!("{name} runs"), || {
            assert!(rough.is_running(), "{:?}", rough.lines());
            // It may end by itself just now, with the others of a scenario that was struck before.
            kill(running(&set, name)?, Signal::SIGKILL).ok()
        });
        rough.wait_line("is begun anew");
    }
    eventually("a scenario runs again", || running(&set, "simd"));
    rough.kill9();
    let again = make(&sandbox, "rough", &["--jobs", "1"]);
    let maker = again.pid();
    again.wait_longer(LIMIT).expect_code(0);
    assert_no_shared_memory(maker);
    assert_eq!(
        manifest(&sandbox, "rough"),
        calm,
        "the same bytes in every file"
    );

    // Stopped and continued.
    let mut stopped = make(&sandbox, "stopped", &[]);
    stopped.wait_line("recorded Town01");
    stopped.stop().expect_code(0);
    assert!(!sandbox.path("stopped/manifest.json").exists());
    let more = make(&sandbox, "stopped", &[])
        .wait_longer(LIMIT)
        .expect_code(0);
    assert!(
        !more.says(&format!("recorded {}", NAMES[0])),
        "it was there already"
    );
    assert_eq!(manifest(&sandbox, "stopped"), calm);
    let done = make(&sandbox, "stopped", &[]).wait().expect_code(0);
    assert!(done.says("finished already"), "{:?}", done.lines);

    check_verify(&sandbox);
}

fn check_summary(set: &Path) {
    let summary: Value = serde_json::from_str(&text(&set.join("summary.json"))).unwrap();
    assert_eq!(summary["total"]["n_ticks"], 12);
    assert_eq!(summary["total"]["frames"]["ego/front/rgb"], 12);
    assert_eq!(summary["total"]["frames"]["ego/roof/lidar"], 6);
    assert!(summary["total"]["n_events"].as_u64() > Some(0));
    assert_eq!(summary["parts"]["train"], 1);
    assert_eq!(summary["by_conditions"]["storm, noon"]["n_ticks"], 6);
    let page = text(&set.join("index.html"));
    assert!(
        page.contains("a &lt;tiny&gt; set") && !page.contains("http:") && !page.contains("https:")
    );
    assert_eq!(page.matches("data:image/jpeg;base64,").count(), 2);
    for name in NAMES {
        assert!(page.contains(name));
    }
}

fn check_verify(sandbox: &Sandbox) {
    let verify = || sandbox.spawn("gantry-dataset", &["verify", "calm"]).wait();
    verify().expect_code(0);
    let set = sandbox.path("calm");
    fs::write(set.join("index.html"), "other").unwrap();
    fs::remove_file(set.join("summary.json")).unwrap();
    let found = verify().expect_code(3);
    assert!(found.says("changed: index.html") && found.says("missing: summary.json"));
}

#[test]
fn what_cannot_be_made_is_said_before_anything_starts() {
    let sandbox = Sandbox::new("datasetwrong");
    let refused = |recipe: &str, more: &[&str], word: &str| {
        sandbox.write("tiny.toml", recipe);
        let ended = make(&sandbox, "set", more).wait().expect_code(2);
        assert!(ended.says(word), "{word}: {:?}", ended.lines);
        assert!(!sandbox.path("set/recordings").exists(), "{word}");
    };
    refused("version = 1\nframes = ", &[], "is no recipe");
    refused(
        &RECIPE.replace("\"storm\"", "\"snow\""),
        &[],
        "there is no weather \"snow\"",
    );
    refused(
        &RECIPE.replace("width_px = 96", "width_px = 0"),
        &[],
        NAMES[0],
    );
    refused(
        &RECIPE.replace("\"evt3\"", "\"evt4\""),
        &[],
        "there is no format \"evt4\"",
    );
    let large = RECIPE
        .replace("frames = 6", "frames = 1000000")
        .replace("width_px = 96", "width_px = 4000")
        .replace("height_px = 64", "height_px = 3000");
    refused(&large, &[], "--anyway");
    sandbox.write("tiny.toml", RECIPE);
    sandbox.write("set", "a file");
    let ended = make(&sandbox, "set", &[]).wait().expect_code(2);
    assert!(ended.says("set"), "{:?}", ended.lines);
    fs::remove_file(sandbox.path("set")).unwrap();
    fs::create_dir_all(sandbox.path("set/x")).unwrap();
    let ended = make(&sandbox, "set", &[]).wait().expect_code(2);
    assert!(ended.says("not empty"), "{:?}", ended.lines);
    let plan = make(&sandbox, "plan", &["--dry-run"]).wait().expect_code(0);
    assert!(
        plan.says("2 scenarios") && plan.says(NAMES[1]),
        "{:?}",
        plan.lines
    );
    assert!(!sandbox.path("plan").exists());
    let none = sandbox
        .spawn("gantry-dataset", &["verify", "plan"])
        .wait()
        .expect_code(2);
    assert!(none.says("manifest.json"), "{:?}", none.lines);
}

#[test]
fn a_scenario_that_always_fails_is_named_and_the_others_are_kept() {
    let sandbox = Sandbox::new("datasetfails");
    let map = sandbox.write("broken.xodr", "<OpenDRIVE>");
    let recipe = RECIPE
        .replace("[\"Town01\"]", "[\"Town01\", \"./broken.xodr\"]")
        .replace("\"clear\", ", "");
    sandbox.write("tiny.toml", &recipe);
    let failed = make(&sandbox, "set", &["--retries", "1"])
        .wait_longer(LIMIT)
        .expect_code(1);
    assert!(
        failed.says("error: broken_storm_noon_s1: simd ended"),
        "{:?}",
        failed.lines
    );
    assert!(failed.says("is begun anew"), "{:?}", failed.lines);
    let kept: PathBuf = sandbox.path("set/recordings/Town01_storm_noon_s1.mcap");
    assert!(kept.exists() && map.exists());
}

/// The recipes that come with Gantry are right, and so is the tutorial's.
#[test]
fn recipes_of_the_repository_and_of_the_tutorial_are_right() {
    let sandbox = Sandbox::new("datasetrecipes");
    let repository = test_kit::sandbox::repository();
    let mut files: Vec<PathBuf> = fs::read_dir(repository.join("launch/datasets"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    assert!(files.len() >= 2);
    let page = text(&repository.join("docs/how-to/datasets.md"));
    let blocks = page.split("```toml\n").skip(1);
    let recipes = blocks.filter_map(|block| block.split("```").next());
    let recipe = recipes
        .filter(|block| block.contains("[matrix]"))
        .collect::<String>();
    fs::create_dir_all(sandbox.path("recipes")).unwrap();
    files.push(sandbox.write("recipes/tutorial.toml", &recipe));
    let rig = "version = 1\n[sensor.front]\nkind = \"camera\"\nrate_hz = 10\n";
    sandbox.write("my_rig.toml", rig);
    for file in files {
        let words = ["make", file.to_str().unwrap(), "--dry-run", "--anyway"];
        let planned = sandbox
            .spawn("gantry-dataset", &words)
            .wait()
            .expect_code(0);
        assert!(planned.says(" scenarios, "), "{:?}", planned.lines);
    }
}
