//! Batches beside other programs: the command line tells of them, the recorder leaves them out with
//! a sentence, and their cameras stay with the simulator when render workers come.

use schema_bus::FrameReader;
use schema_frames::Modality;
use test_e2e::recording::sequences;
use test_e2e::{assert_nothing_left, counter, join_bus, reader, spawn_consumer, start_daemon};
use test_kit::client::step;
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

/// Takes the frames of a tick, and compares the batch with its cameras, one after the other.
fn compare(batch: &mut FrameReader, own: &mut [FrameReader], tick: u64) {
    let whole = eventually("a frame of the batch", || batch.next().unwrap());
    assert_eq!(whole.header().tick, tick);
    let mut images = Vec::new();
    for reader in own {
        let frame = eventually("a frame", || reader.next().unwrap());
        assert_eq!(frame.header().tick, tick);
        images.extend_from_slice(&frame);
    }
    assert!(*whole == images[..], "the batch at tick {tick}");
}

#[test]
fn cameras_of_a_batch_stay_with_the_simulator_when_workers_come() {
    let sandbox = Sandbox::new("batch-workers");
    let stepped = RIG.replace("tick_hz = 20", "tick_hz = 20\nmode = \"stepped\"");
    let daemon = start_daemon(&sandbox, &stepped, &["--await-workers", "1"]);
    let mut worker = spawn_consumer(&sandbox, "gantry-render", &["--name", "one"]);
    worker.wait_line("joined");
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut batch = reader(&bus, TOPIC);
    let mut own = ["ego/right/rgb", "ego/left/rgb"].map(|topic| reader(&bus, topic));
    let mut rear = reader(&bus, "ego/rear/rgb");
    for tick in 1..=3 {
        assert_eq!(step(&mut client, 1), tick);
        compare(&mut batch, &mut own, tick);
        let frame = eventually("the worker's frame", || rear.next().unwrap());
        assert_eq!(
            (frame.modality(), frame.header().tick),
            (Modality::Rgb, tick)
        );
    }
    assert!(counter(&mut client, "sent_by_workers") >= 3);
    assert_eq!(counter(&mut client, "sent ego/rear/rgb"), 0);
    assert_eq!(counter(&mut client, "sent ego/left/rgb"), 3);
    // A worker that goes takes nothing of the batch with it.
    worker.kill9();
    for tick in 4..=5 {
        assert_eq!(step(&mut client, 1), tick);
        compare(&mut batch, &mut own, tick);
        assert!(eventually("a frame", || rear.next().unwrap()).header().tick <= tick);
    }
    drop((batch, own, rear, client, bus));
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}
