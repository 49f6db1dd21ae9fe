//! Batches beside other programs: the command line tells of them, and the recorder leaves them out
//! with a sentence.

use test_e2e::recording::sequences;
use test_e2e::{assert_nothing_left, counter, join_bus, spawn_consumer, start_daemon};
use test_kit::{Sandbox, eventually};

const RIG: &str = r#"version = 1
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 20
[sensor.left]
kind = "camera"
rate_hz = 20
width_px = 64
height_px = 48
mount.position_m = [0.6, 0.5, 1.6]
mount.rpy_deg = [0.0, 0.0, 60.0]
[sensor.right]
kind = "camera"
rate_hz = 20
width_px = 64
height_px = 48
mount.position_m = [0.6, -0.5, 1.6]
mount.rpy_deg = [0.0, 0.0, -60.0]
[sensor.rear]
kind = "camera"
rate_hz = 20
width_px = 64
height_px = 48
mount.position_m = [-1.5, 0.0, 1.6]
mount.rpy_deg = [0.0, 0.0, 180.0]
[batch.sides]
cameras = ["ego/right", "ego/left"]
"#;

const TOPIC: &str = "batch/sides/rgb";

fn gantry(sandbox: &Sandbox, words: &[&str]) -> String {
    let args = [words, &["--domain", sandbox.domain()]].concat();
    let ended = sandbox.spawn("gantry", &args).wait().expect_code(0);
    ended.lines.join("\n")
}

#[test]
fn the_command_line_tells_of_a_batch_and_the_recorder_leaves_it_out_with_a_sentence() {
    let sandbox = Sandbox::new("batch-programs");
    let daemon = start_daemon(&sandbox, RIG, &[]);
    let list = gantry(&sandbox, &["topic", "list"]);
    assert!(list.contains(TOPIC), "{list}");
    let info = gantry(&sandbox, &["topic", "info", TOPIC]);
    assert!(
        info.contains("images         2: ego/right, ego/left"),
        "{info}"
    );
    assert!(info.contains("readers        0 of 2"), "{info}");
    let info = gantry(&sandbox, &["topic", "info", "ego/left/rgb"]);
    assert!(!info.contains("images"), "{info}");
    let echo = gantry(&sandbox, &["topic", "echo", TOPIC, "--once", "--json"]);
    let echo: serde_json::Value = serde_json::from_str(&echo).unwrap();
    assert_eq!(
        (&echo["n_images"], &echo["width"], &echo["height"]),
        (&2.into(), &64.into(), &96.into())
    );
    let hz = gantry(
        &sandbox,
        &["topic", "hz", TOPIC, "--window", "10s", "--once"],
    );
    assert!(hz.contains(" Hz "), "{hz}");

    let mut recorder = spawn_consumer(&sandbox, "gantry-record", &["--out", "drive.mcap"]);
    recorder.wait_line("a batch is not recorded");
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let of_left = |client: &mut _| counter(client, "sent ego/left/rgb");
    let before = of_left(&mut client);
    eventually("frames of a camera", || {
        (of_left(&mut client) > before + 10).then_some(())
    });
    recorder.stop().expect_code(0);
    let found = sequences(&sandbox.path("drive.mcap"));
    assert!(found.contains_key("/ego/left/rgb/gantry"));
    assert!(
        !found.keys().any(|name| name.contains("batch")),
        "{:?}",
        found.keys()
    );
    drop((client, bus));
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}
