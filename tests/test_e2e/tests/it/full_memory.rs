//! What a full `/dev/shm` does: whoever asks for more is refused with a sentence, whoever runs goes
//! on, and nobody dies. The tests run in a mount namespace with a `/dev/shm` of 64 MB, as in a
//! container, and fill it.

use std::io::Write as _;
use std::path::Path;
use std::process::Command as Program;

use schema_bus::{BusError, LoanError, ResultTopic};
use schema_frames::{Command, CommandReply, ResultType};
use test_e2e::{ask, join_bus, mount_namespace, reader, start_daemon};
use test_kit::{PATIENCE, Sandbox, eventually, output_within};

/// Bytes of the small `/dev/shm`: a container's 64 MiB, and three pages by which it is told from one.
const SMALL_BYTES: u64 = (64 << 20) + 3 * 4096;

/// A camera, an IMU and little traffic: some 7 MB of `/dev/shm`.
const RIG: &str = r#"version = 1
[scenario]
map = "Town02"
seed = 7
tick_hz = 20
vehicles = 2
[sensor.front]
kind = "camera"
modalities = ["rgb"]
rate_hz = 20
width_px = 96
height_px = 64
[sensor.imu]
kind = "imu"
rate_hz = 20
"#;

/// Runs the body of the test `name` with a small `/dev/shm` of its own: the test starts itself once
/// more in a mount namespace, and there the body runs.
fn in_small_memory(name: &str, body: impl FnOnce()) {
    let of = nix::sys::statvfs::statvfs("/dev/shm").expect("it is mounted");
    if of.blocks() as u64 * of.fragment_size() as u64 == SMALL_BYTES {
        return body();
    }
    let test = std::env::current_exe().expect("a test knows its file");
    let script = format!(
        "mount -t tmpfs -o size={SMALL_BYTES} tmpfs /dev/shm && exec \"$0\" --exact --nocapture full_memory::{name}"
    );
    let mut again = Program::new("unshare");
    again
        .args(mount_namespace())
        .args(["sh", "-c", &script])
        .arg(&test);
    // Every wait of the body has a limit of its own.
    let ended = output_within(&mut again, 5 * PATIENCE);
    let said = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (out, err) = (said(&ended.stdout), said(&ended.stderr));
    assert!(
        ended.status.success() && out.contains("1 passed"),
        "{name} in a mount namespace of its own (which needs the rights to mount): {:?}\n{out}\n{err}",
        ended.status
    );
}

/// Takes all that is left of `/dev/shm`; removed when dropped.
struct Filler;

impl Filler {
    const FILE: &str = "/dev/shm/filler";

    fn new() -> Filler {
        let mut file = std::fs::File::create(Self::FILE).expect("a file needs no page");
        while file.write_all(&[1; 4096]).is_ok() {}
        Filler
    }
}

impl Drop for Filler {
    fn drop(&mut self) {
        std::fs::remove_file(Self::FILE).expect("it is there");
    }
}

fn is_memory(error: &BusError) -> bool {
    matches!(error, BusError::Memory { .. }) && error.to_string().contains("/dev/shm has")
}

#[test]
fn a_full_dev_shm_refuses_readers_sensors_and_writers() {
    in_small_memory(
        "a_full_dev_shm_refuses_readers_sensors_and_writers",
        readers_sensors_and_writers_are_refused,
    );
}

fn readers_sensors_and_writers_are_refused() {
    let sandbox = Sandbox::new("full");
    let mut daemon = start_daemon(&sandbox, RIG, &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut rgb = reader(&bus, "ego/front/rgb");
    let first = eventually("a frame", || rgb.latest().unwrap()).header().seq;
    let results = ResultTopic::new(ResultType::Text);
    let writer = bus.result_publisher("early/words", &results).unwrap();
    let mut words = bus.result_reader("early/words").unwrap();
    let spawn = || Command::SpawnSensor {
        type_id: "sensor.camera.view".into(),
        pose: schema_types::Pose::from_xyz_yaw(0.5, 0.0, 2.0, 0.3).into(),
        parent_id: None,
        attachment: Default::default(),
        interval_nanos: 0,
        spec: serde_json::from_str(
            r#"{"kind": "camera", "width_px": 64, "height_px": 48, "modalities": ["rgb"]}"#,
        )
        .unwrap(),
        attributes: Default::default(),
    };

    let filler = Filler::new();
    let refusals = [
        bus.frame_reader("ego/imu/imu").err(),
        bus.result_publisher("late/words", &results).err(),
        bus.command_client("late").err(),
        bus.document_reader("world/map").err(),
        bus.listener("late").err(),
    ];
    for (i, refusal) in refusals.into_iter().enumerate() {
        let error = refusal.unwrap_or_else(|| panic!("{i} was not refused"));
        assert!(is_memory(&error), "{i}: {error}");
    }
    assert!(matches!(
        writer.loan(32 << 10),
        Err(LoanError::Memory { .. })
    ));
    let hz = ["topic", "hz", "ego/front/rgb", "--domain", sandbox.domain()];
    let ended = sandbox.spawn("gantry", &hz).wait().expect_code(1);
    assert!(ended.says("of shared memory"), "{:?}", ended.lines);
    let CommandReply::Refused { error } = ask(&mut client, spawn()) else {
        panic!("a sensor without memory was spawned")
    };
    assert!(error.contains("shared memory"), "{error}");
    // The frames of those who read before go on.
    let during = eventually("frames go on", || {
        let frame = rgb.latest().unwrap()?;
        (frame.header().seq > first + 20).then(|| frame.header().seq)
    });
    assert!(daemon.is_running());

    drop(filler);
    eventually("frames go on", || {
        let frame = rgb.latest().unwrap()?;
        (frame.header().seq > during + 5).then_some(())
    });
    let mut loan = writer.loan(32 << 10).unwrap();
    loan.body_mut()[..5].copy_from_slice(b"again");
    loan.set_list(5, 1, 0).unwrap();
    assert_eq!(loan.send().unwrap(), 1);
    let said = eventually("a result", || words.latest().unwrap());
    assert_eq!(&said[..5], b"again");
    let CommandReply::Spawned { topics, .. } = ask(&mut client, spawn()) else {
        panic!("a sensor was refused although there is room")
    };
    let mut spawned = reader(&bus, &topics[0]);
    eventually("a frame of the new sensor", || spawned.latest().unwrap());
    drop((rgb, spawned, said, words, writer, client, bus));
    daemon.stop().expect_code(0);
    assert_eq!(sandbox.leftovers(), Vec::<String>::new());
}

#[test]
fn a_sample_whose_memory_goes_away_while_it_is_filled_is_not_sent() {
    in_small_memory(
        "a_sample_whose_memory_goes_away_while_it_is_filled_is_not_sent",
        what_is_filled_while_memory_goes_away_is_not_sent,
    );
}

/// The slot is loaned while there is room, and filled when there is none: the worst moment.
fn what_is_filled_while_memory_goes_away_is_not_sent() {
    let sandbox = Sandbox::new("goes");
    let bus = join_bus(&sandbox, "test");
    let topic = ResultTopic {
        body_bytes: 64 << 10,
        ..ResultTopic::new(ResultType::Text)
    };
    let writer = bus.result_publisher("mine/words", &topic).unwrap();
    let mut words = bus.result_reader("mine/words").unwrap();
    let bytes: Vec<u8> = (0..64u32 << 10)
        .map(|i| b'a' + (i * 7 + i / 251) as u8 % 26)
        .collect();
    for round in 0..3 {
        let mut loan = writer.loan(bytes.len()).unwrap();
        loan.set_list(bytes.len() as u32, 1, 0).unwrap();
        let filler = Filler::new();
        loan.body_mut().copy_from_slice(&bytes);
        if round == 0 {
            let error = loan.send().unwrap_err();
            assert!(is_memory(&error), "{error}");
            assert!(words.latest().unwrap().is_none());
            drop(filler);
            continue;
        }
        // What was written is kept, and reaches its reader if there is room again in time.
        drop(filler);
        assert_eq!(loan.send().unwrap(), 1);
        let said = eventually("a result", || words.latest().unwrap());
        assert!(said[..bytes.len()] == bytes[..], "round {round}");
    }
    drop((words, writer, bus));
    assert_eq!(sandbox.leftovers(), Vec::<String>::new());
}

/// A filler that is there before anything of Gantry: one sentence.
#[test]
fn nothing_starts_on_a_full_dev_shm() {
    in_small_memory("nothing_starts_on_a_full_dev_shm", nothing_starts);
}

fn nothing_starts() {
    let sandbox = Sandbox::new("none");
    let filler = Filler::new();
    let file = sandbox.write("launch.toml", RIG);
    let words = [
        "--launch",
        file.to_str().unwrap(),
        "--domain",
        sandbox.domain(),
    ];
    let ended = sandbox.spawn("simd", &words).wait();
    assert!([1, 2].contains(&ended.code()), "{:?}", ended.lines);
    assert!(ended.says("of shared memory"), "{:?}", ended.lines);
    drop(filler);
    assert!(!Path::new(Filler::FILE).exists());
    assert_eq!(sandbox.leftovers(), Vec::<String>::new());
}
