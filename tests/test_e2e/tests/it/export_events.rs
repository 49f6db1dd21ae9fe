//! Exports of events and ROS bags, opened with the formats' own tools and compared with the
//! recording.

use std::path::Path;

use test_e2e::exports::{record_drive, run_python};
use test_kit::{Process, Sandbox};

/// A stereo pair of event cameras 0.5 m apart, and every other kind of sensor.
const RIG: &str = r#"version = 1
[scenario]
map = "Town01"
seed = 4
vehicles = 6
walkers = 6
[sensor.left]
kind = "camera"
modalities = ["rgb", "depth", "semantic", "instance", "flow", "normals", "dvs"]
width_px = 160
height_px = 120
mount.position_m = [0.6, 0.25, 1.6]
[sensor.right]
kind = "camera"
modalities = ["rgb", "depth", "dvs"]
width_px = 160
height_px = 120
mount.position_m = [0.6, -0.25, 1.6]
[sensor.roof]
kind = "lidar"
channels = 8
rate_hz = 10
mount.position_m = [0.0, 0.0, 2.0]
[sensor.labels]
kind = "lidar"
semantic = true
channels = 8
rate_hz = 10
mount.position_m = [0.0, 0.0, 2.0]
[sensor.radar]
kind = "radar"
mount.position_m = [2.0, 0.0, 1.0]
[sensor.imu]
kind = "imu"
[sensor.gnss]
kind = "gnss"
"#;

fn export(sandbox: &Sandbox, format: &str) -> Process {
    let words = ["drive.mcap", "--format", format, "--out", format];
    sandbox.spawn("gantry-export", &words)
}

fn bytes(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

#[test]
fn the_formats_own_tools_read_what_was_recorded() {
    let sandbox = Sandbox::new("exportevents");
    record_drive(&sandbox, RIG, 24);
    for format in ["dsec", "evt3", "ros2-bag"] {
        export(&sandbox, format).wait().expect_code(0);
    }
    let trees = [
        "dsec/train/drive",
        "evt3/train/drive",
        "ros2-bag/train/drive",
    ];
    let words = [&["drive.mcap"], &trees[..]].concat();
    let checked = run_python(&sandbox, "export_events.py", &words);
    for theme in ["evt3", "dsec", "bag"] {
        assert!(
            checked.says(&format!("{theme} passed")),
            "{:?}",
            checked.lines
        );
    }
    // Made again, every byte is the same.
    for (format, files) in [
        (
            "dsec",
            &[
                "events/left/events.h5",
                "flow/forward/000003.png",
                "poses.txt",
            ][..],
        ),
        ("evt3", &["left.raw", "calibration.json"]),
        ("ros2-bag", &["drive_0.mcap", "metadata.yaml"]),
    ] {
        let again = format!("{format}-again");
        let words = ["drive.mcap", "--format", format, "--out", &again];
        sandbox.spawn("gantry-export", &words).wait().expect_code(0);
        for file in files {
            let path = |folder: &str| sandbox.path(&format!("{folder}/train/drive/{file}"));
            assert!(
                bytes(&path(format)) == bytes(&path(&again)),
                "{format} {file}"
            );
        }
    }
    // A choice that is no camera is explained.
    let words = [
        "drive.mcap",
        "--format",
        "dsec",
        "--out",
        "no",
        "--cameras",
        "roof",
    ];
    let refused = sandbox.spawn("gantry-export", &words).wait().expect_code(2);
    assert!(
        refused.says("roof") && refused.says("left, right"),
        "{:?}",
        refused.lines
    );
}

#[test]
fn a_recording_without_events_is_refused_and_still_makes_a_bag() {
    let sandbox = Sandbox::new("exportplain");
    let launch = "version = 1\n[scenario]\nmap = \"Town01\"\n[sensor.imu]\nkind = \"imu\"\n";
    record_drive(&sandbox, launch, 5);
    for format in ["dsec", "evt3"] {
        let refused = export(&sandbox, format).wait().expect_code(2);
        assert!(refused.says("event camera"), "{:?}", refused.lines);
        assert!(!sandbox.path(format).exists(), "nothing was begun");
    }
    export(&sandbox, "ros2-bag").wait().expect_code(0);
    assert!(sandbox.path("ros2-bag/train/drive/metadata.yaml").exists());
}
