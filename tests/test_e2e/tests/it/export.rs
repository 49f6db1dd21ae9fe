//! `gantry-export` on real recordings: sets that the formats' own tools open, that agree with the
//! images, that are the same every time and after `kill -9`; sentences for what cannot be exported.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use consumer_truth::ticks::{Actors, World};
use consumer_truth::{Body, BoxTruth, Camera, Images, bodies, box_truths};
use nix::sys::signal::Signal;
use schema_frames::document::ActorList;
use schema_frames::{Command, CommandReply};
use schema_types::Pose;
use test_e2e::SMALL_RIG;
use test_e2e::exports::{record_drive, run_python};
use test_kit::patience::eventually;
use test_kit::{Process, Sandbox, Setup, Simulator};

/// A rectified pair, a camera that looks elsewhere, both lidars at one place, and motion, in a street
/// with traffic and parked cars.
const RIG: &str = r#"version = 1
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 20
vehicles = 40
walkers = 60
[ego]
spawn_point = 126
[sensor.front]
kind = "camera"
modalities = ["rgb", "depth", "semantic", "instance", "flow"]
rate_hz = 10
width_px = 512
height_px = 288
mount.position_m = [0.6, 0.0, 1.6]
[sensor.front_right]
kind = "camera"
modalities = ["rgb"]
rate_hz = 10
width_px = 512
height_px = 288
mount.position_m = [0.6, -0.5, 1.6]
[sensor.left]
kind = "camera"
modalities = ["rgb", "depth", "semantic", "instance"]
rate_hz = 10
width_px = 320
height_px = 240
fov_deg = 100
mount.position_m = [0.3, 0.4, 1.6]
mount.rpy_deg = [0.0, 5.0, 60.0]
[sensor.roof]
kind = "lidar"
rate_hz = 10
channels = 32
columns = 1000
range_m = 100
mount.position_m = [0.0, 0.0, 2.0]
mount.rpy_deg = [0.0, 2.0, 10.0]
[sensor.roof_semantic]
kind = "lidar"
semantic = true
rate_hz = 10
channels = 32
columns = 1000
range_m = 100
mount.position_m = [0.0, 0.0, 2.0]
mount.rpy_deg = [0.0, 2.0, 10.0]
[sensor.radar]
kind = "radar"
rate_hz = 10
mount.position_m = [2.0, 0.0, 1.0]
[sensor.imu]
kind = "imu"
rate_hz = 20
[sensor.gnss]
kind = "gnss"
rate_hz = 10
"#;

/// Formats of this page; events and bags have one of their own.
const FORMATS: [&str; 6] = [
    "coco",
    "yolo",
    "kitti",
    "nuscenes",
    "semantickitti",
    "kitti-360",
];

fn export(sandbox: &Sandbox, words: &[&str]) -> Process {
    sandbox.spawn("gantry-export", words)
}

/// Every file below a folder: relative path and bytes.
fn tree(root: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![root.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let bytes = std::fs::read(&path).unwrap();
                found.insert(path.strip_prefix(root).unwrap().to_path_buf(), bytes);
            }
        }
    }
    found
}

/// Asserts that two exports are the same, and names the first file that is not.
fn assert_same(one: &Path, other: &Path) {
    let (one, other) = (tree(one), tree(other));
    let names = |tree: &BTreeMap<PathBuf, Vec<u8>>| tree.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&one), names(&other));
    for (path, bytes) in &one {
        assert!(*bytes == other[path], "{} differs", path.display());
    }
}

#[test]
fn sets_open_in_the_formats_own_tools_and_projections_meet_the_pixels() {
    let sandbox = Sandbox::new("exportsets");
    record_drive(&sandbox, RIG, 260);
    for format in FORMATS {
        export(
            &sandbox,
            &["drive.mcap", "--format", format, "--out", format],
        )
        .wait()
        .expect_code(0);
    }
    let polygons = [
        "--format", "coco", "--masks", "polygon", "--out", "outlines",
    ];
    export(&sandbox, &[&["drive.mcap"], &polygons[..]].concat())
        .wait()
        .expect_code(0);
    let coco = ["drive.mcap", "left", "coco", "outlines", "yolo"];
    run_python(&sandbox, "export_coco.py", &coco);
    run_python(&sandbox, "export_kitti.py", &["drive.mcap", "kitti"]);
    let clouds = ["drive.mcap", "nuscenes", "semantickitti", "kitti-360"];
    run_python(&sandbox, "export_clouds.py", &clouds);
}

#[test]
fn an_export_that_was_killed_goes_on_to_the_tree_of_one_that_was_not() {
    let sandbox = Sandbox::new("exportkilled");
    record_drive(&sandbox, SMALL_RIG, 40);
    let copies = ["drive.mcap"; 6];
    let mut n_killed_midway = 0;
    for format in FORMATS {
        let run = |out: &str, more: &[&str]| {
            let split = ["--split", "train=0.7,val=0.3", "--split-seed", "3"];
            let words = ["--format", format, "--out", out, "--min-pixels", "1"];
            export(&sandbox, &[&copies[..], &words, &split, more].concat())
        };
        run("whole", &[]).wait().expect_code(0);
        let killed = run("killed", &[]);
        let out = sandbox.path("killed");
        eventually("some files are there", || {
            let n_entries = std::fs::read_dir(&out).map_or(0, |entries| entries.count());
            (n_entries >= 2).then_some(())
        });
        killed.kill9();
        n_killed_midway += usize::from(!out.join("gantry-export.json").exists());
        let refused = run("killed", &[]).wait().expect_code(2);
        assert!(refused.says("--resume"), "{:?}", refused.lines);
        let other = run("killed", &["--every", "2", "--resume"]).wait();
        assert!(other.expect_code(2).says("every = 1"));
        run("killed", &["--resume"]).wait().expect_code(0);
        assert_same(&sandbox.path("whole"), &out);
        // A complete one stays as it is.
        run("killed", &["--resume"]).wait().expect_code(0);
        let manifest = std::fs::read_to_string(out.join("gantry-export.json")).unwrap();
        let manifest: serde_json::Value = serde_json::from_str(&manifest).unwrap();
        let splits = manifest["done"].as_array().unwrap().iter();
        let n_train = splits.filter(|done| done["split"] == "train").count();
        assert_eq!(n_train, 4, "0.7 of six scenarios, rounded");
        for folder in ["whole", "killed"] {
            std::fs::remove_dir_all(sandbox.path(folder)).unwrap();
        }
    }
    assert!(
        n_killed_midway >= 3,
        "kills came too late: {n_killed_midway}"
    );
}

#[test]
fn what_cannot_be_exported_is_told_in_a_sentence() {
    let sandbox = Sandbox::new("exportfaults");
    record_drive(&sandbox, SMALL_RIG, 30);
    let whole = std::fs::read(sandbox.path("drive.mcap")).unwrap();
    std::fs::write(sandbox.path("cut.mcap"), &whole[..whole.len() * 6 / 10]).unwrap();
    std::fs::write(sandbox.path("empty.mcap"), b"").unwrap();
    std::fs::write(sandbox.path("foreign.mcap"), b"PNG, not MCAP").unwrap();
    std::fs::create_dir(sandbox.path("full")).unwrap();
    sandbox.write("full/notes.txt", "mine");
    let refused = |words: &[&str], code: i32, sentence: &str| {
        let ended = export(&sandbox, words).wait().expect_code(code);
        assert!(ended.says(sentence), "{words:?}: {:?}", ended.lines);
        assert!(!ended.says("panicked"), "{:?}", ended.lines);
    };
    // A recording that was cut off is exported as far as it goes, and the end says so.
    let cut = [
        "cut.mcap",
        "--format",
        "coco",
        "--out",
        "cut",
        "--min-pixels",
        "1",
    ];
    let ended = export(&sandbox, &cut).wait().expect_code(3);
    assert!(ended.says("the file was cut off"), "{:?}", ended.lines);
    assert!(
        sandbox
            .path("cut/annotations/instances_train.json")
            .exists()
    );
    for (file, sentence) in [
        ("empty.mcap", "empty.mcap is empty"),
        ("foreign.mcap", "not an MCAP file"),
        ("nothing.mcap", "nothing.mcap"),
    ] {
        refused(&[file, "--format", "kitti", "--out", "none"], 1, sentence);
    }
    let with = |more: &[&'static str]| [&["drive.mcap", "--out", "none"], more].concat();
    let kitti = ["--format", "kitti"];
    refused(
        &with(&[&kitti[..], &["--cameras", "rear"]].concat()),
        2,
        "no camera \"rear\" on rig \"ego\"; it has front",
    );
    refused(
        &with(&[&kitti[..], &["--rig", "truck"]].concat()),
        2,
        "no rig \"truck\"; it has ego",
    );
    refused(
        &with(&[&kitti[..], &["--from", "1h"]].concat()),
        2,
        "--from lies behind the end",
    );
    refused(
        &with(&[&kitti[..], &["--from", "2s", "--to", "1s"]].concat()),
        2,
        "--to must lie behind --from",
    );
    refused(
        &with(&[&kitti[..], &["--split", "train=2,train=1"]].concat()),
        2,
        "twice",
    );
    refused(
        &with(&[&kitti[..], &["--scenario", "a/b"]].concat()),
        2,
        "no name of a scenario",
    );
    assert!(
        !sandbox.path("none").exists(),
        "nothing is made before everything is checked"
    );
    let full = ["drive.mcap", "--format", "coco", "--out", "full"];
    refused(&full, 2, "full is not empty");
    refused(
        &[&full[..], &["--resume"]].concat(),
        2,
        "holds no export that was stopped",
    );
    assert_eq!(tree(&sandbox.path("full")).len(), 1);

    // A rig without cameras and labels.
    let bare = "version = 1\n[scenario]\nmap = \"Town01\"\nvehicles = 1\n[sensor.roof]\nkind = \"lidar\"\nrate_hz = 10\nchannels = 4\ncolumns = 60\n";
    let other = Sandbox::new("exportbare");
    record_drive(&other, bare, 12);
    for (format, sentence) in [
        (
            "kitti",
            "kitti needs a colour camera (a topic <rig>/<sensor>/rgb), and drive has none on rig \"ego\"; it has ego/roof/lidar",
        ),
        ("kitti-360", "kitti-360 needs a colour camera"),
        (
            "coco",
            "coco needs a camera with the modalities rgb and instance",
        ),
        (
            "yolo",
            "yolo needs a camera with the modalities rgb and instance",
        ),
        ("semantickitti", "semantickitti needs a semantic lidar"),
    ] {
        let ended = export(&other, &["drive.mcap", "--format", format, "--out", "none"]).wait();
        assert!(ended.expect_code(2).says(sentence), "{format}");
    }
    // A lidar alone is enough for nuScenes.
    export(
        &other,
        &["drive.mcap", "--format", "nuscenes", "--out", "nuscenes"],
    )
    .wait()
    .expect_code(0);

    // A disk that takes no more: a limit on the size of files stands in for it. With room the export
    // goes on to the tree of one that was never short of it.
    let command = format!(
        "trap '' XFSZ; ulimit -f 8; exec {} drive.mcap --format kitti --out short",
        test_kit::sandbox::binary_path("gantry-export").display()
    );
    let short = sandbox
        .spawn_program("sh", Path::new("/bin/sh"), &["-c", &command], &[])
        .wait()
        .expect_code(1);
    assert!(short.says("cannot write short/"), "{:?}", short.lines);
    let words = ["drive.mcap", "--format", "kitti", "--out"];
    export(&sandbox, &[&words[..], &["short", "--resume"]].concat())
        .wait()
        .expect_code(0);
    export(&sandbox, &[&words[..], &["roomy"]].concat())
        .wait()
        .expect_code(0);
    assert_same(&sandbox.path("short"), &sandbox.path("roomy"));
}

#[test]
fn a_launch_file_is_run_recorded_and_exported() {
    let sandbox = Sandbox::new("exportlaunch");
    let processes = "[process.simd]\ncmd = [\"simd\"]\nrequired = true\nready = { service = \"world/snapshot\" }\n[process.drive]\ncmd = [\"gantry-drive\"]\nafter = [\"simd\"]\n";
    sandbox.write("town.toml", &format!("{SMALL_RIG}{processes}"));
    let words = [
        "town.toml",
        "--frames",
        "7",
        "--format",
        "coco",
        "--min-pixels",
        "1",
    ];
    let done = export(
        &sandbox,
        &[&words[..], &["--out", "set", "--json"]].concat(),
    )
    .wait_longer(Duration::from_secs(180))
    .expect_code(0);
    let report = done
        .lines
        .iter()
        .find(|line| line.starts_with('{'))
        .unwrap();
    let report: serde_json::Value = serde_json::from_str(report).unwrap();
    assert_eq!(report["complete"], true);
    assert_eq!(report["scenarios"][0]["name"], "town");
    assert_eq!(report["scenarios"][0]["n_ticks"], 7);
    let images = tree(&sandbox.path("set/images/train"));
    assert_eq!(images.len(), 7);
    assert!(
        !sandbox.path("set/.gantry-export").exists(),
        "the recording is gone"
    );
    // The same launch file gives the same pictures.
    export(&sandbox, &[&words[..], &["--out", "again"]].concat())
        .wait_longer(Duration::from_secs(180))
        .expect_code(0);
    assert!(tree(&sandbox.path("again/images/train")) == images);

    // Ctrl-C ends the simulation too.
    let long = [
        "town.toml",
        "--frames",
        "100000",
        "--format",
        "coco",
        "--out",
        "long",
    ];
    let running = export(&sandbox, &long);
    eventually("the recorder has begun", || {
        let part = sandbox.path("long/.gantry-export/launch_0.mcap.part");
        part.exists().then_some(())
    });
    running.signal(Signal::SIGTERM);
    running.wait_longer(Duration::from_secs(120)).expect_code(0);
    let broken = sandbox.write("broken.toml", "version = 1\n[scenario]\nmapp = 1\n");
    let ended = export(
        &sandbox,
        &[broken.to_str().unwrap(), "--format", "coco", "--out", "no"],
    );
    assert!(ended.wait().expect_code(2).says("mapp"));
}

/// A camera high above a town, whose lens bends what it sees.
const BENT_EYE: &str = r#"version = 1
[scenario]
map = "Town02"
seed = 7
vehicles = 0
walkers = 0
[rig.post]
pose = { position_m = [0.0, 0.0, 300.0] }
[sensor.eye]
rig = "post"
kind = "camera"
modalities = ["instance"]
rate_hz = 20
width_px = 320
height_px = 240
fov_deg = 90
"#;

/// Crates fill their boxes, so a crate's pixels are its projected box, wherever the lens puts them.
#[test]
fn boxes_bend_as_the_image_does() {
    for [k, k_cubed] in [[0.5, 0.0], [-0.3, 0.0], [0.2, 0.3]] {
        let mut simulator = Simulator::start(
            Setup::text(BENT_EYE)
                .set(format!("sensor.eye.optics.distortion_k={k:?}"))
                .set(format!("sensor.eye.optics.distortion_k_cubed={k_cubed:?}"))
                .set("sensor.eye.optics.distortion_size=[1.0, 0.75]"),
        );
        for (i, (y, z)) in [-2.7, 0.0, 2.7]
            .into_iter()
            .flat_map(|y| [-1.6, 0.0, 1.6].map(|z| (y, z)))
            .enumerate()
        {
            let turned = nalgebra::UnitQuaternion::from_euler_angles(0.3 * i as f64, 0.5, i as f64);
            let pose = Pose {
                translation_m: [4.5, y, 300.0 + z],
                rotation_xyzw: turned.coords.into(),
            };
            let spawn = Command::Spawn {
                type_id: "static.prop.mesh".into(),
                pose: pose.into(),
                parent_id: None,
                role: String::new(),
                attributes: Default::default(),
            };
            let reply = simulator.ask(spawn);
            assert!(matches!(reply, CommandReply::Spawned { .. }), "{reply:?}");
        }
        let mut images = simulator.frames("post/eye/instance");
        let tick = simulator.step(1);
        let image = simulator.frame_of(&mut images, tick);
        let ids: Vec<u32> = bytemuck::pod_collect_to_vec(&image);
        let bodies = bodies_of(&mut simulator);
        let camera = Camera::of(image.header());
        assert!(camera.lens.is_some());
        let seen = |camera: &Camera| {
            let images = Images {
                instance: Some(&ids),
                depth: None,
            };
            box_truths(camera, &bodies, images)
        };
        let bent = seen(&camera);
        assert_eq!(bent.len(), 9);
        for truth in &bent {
            let shown = truth.seen.expect("there is an instance image");
            assert!(shown.pixels > 400, "{truth:?}");
            assert!(beside_px(truth) <= 1.5, "k {k} {k_cubed}: {truth:?}");
            let more = truth.hull_pixels.abs_diff(shown.pixels);
            assert!(25 * more <= shown.pixels, "k {k} {k_cubed}: {truth:?}");
        }
        let straight = Camera {
            lens: None,
            ..camera
        };
        let worst = seen(&straight).iter().map(beside_px).fold(0.0, f64::max);
        assert!(worst > 5.0, "without the lens boxes are elsewhere: {worst}");
        drop((image, images));
        simulator.finish();
    }
}

/// What stands in the world now.
fn bodies_of(simulator: &mut Simulator) -> Vec<Body> {
    let list: ActorList = simulator.document("world/actors").json().unwrap();
    let by_id = list.actors.into_iter().map(|info| (info.id, info));
    let actors = Actors {
        revision: 1,
        by_id: by_id.collect(),
    };
    let snapshot = simulator.snapshot();
    let world = World {
        header: *snapshot.header(),
        records: snapshot.records().to_vec(),
        actors: actors.into(),
        scenery: [].into(),
    };
    bodies(&world, 0)
}

/// How far the box's rectangle in the image is from the one round its pixels, pixels.
fn beside_px(truth: &BoxTruth) -> f64 {
    let seen = truth.seen.and_then(|seen| seen.bounds);
    let pixels = seen.map_or([0.0; 4], |bounds| bounds.map(f64::from));
    (0..4)
        .map(|side| (pixels[side] - truth.clipped_px[side]).abs())
        .fold(0.0, f64::max)
}
