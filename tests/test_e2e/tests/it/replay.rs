//! `gantry-replay` beside real consumers: what was recorded comes out again byte for byte, waits for
//! slow participants, stands still, jumps, and ends cleanly.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Duration;

use consumer_kit::{Follower, Publisher, Steps, Take};
use nix::sys::signal::Signal;
use schema_frames::{Box2d, FrameHeader, ResultHeader, WorldInfo};
use schema_recording::read::{RecordingFile, Selection, What};
use test_e2e::carla::{run_script, start_gateway};
use test_e2e::{
    SMALL_RIG, assert_nothing_left, document, join_bus, python_package, spawn_consumer,
    spawn_daemon, venv_program,
};
use test_kit::sandbox::repository;
use test_kit::{Process, Sandbox, eventually};

const MORE_SENSORS: &str = r#"[sensor.radar]
kind = "radar"
points_per_second = 2000
mount.position_m = [2.0, 0.0, 0.8]
[sensor.ahead]
kind = "obstacle"
distance_m = 40
[sensor.bump]
kind = "collision"
[sensor.lines]
kind = "lane_invasion"
"#;
const N_TICKS: u64 = 200;

/// Ten seconds of every sensor, and of results that a program of the test publishes, recorded once
/// for all tests.
fn recording() -> &'static Path {
    static FILE: OnceLock<PathBuf> = OnceLock::new();
    FILE.get_or_init(record)
}

fn record() -> PathBuf {
    let sandbox = Sandbox::new("replay-rec");
    let launch = format!("{SMALL_RIG}{MORE_SENSORS}");
    let n_ticks = N_TICKS.to_string();
    let args = [
        &["--unpaced", "--ticks", &n_ticks][..],
        &["--await-participant", "rec", "--await-participant", "boxer"],
    ];
    let mut daemon = spawn_daemon(&sandbox, &launch, &args.concat());
    daemon.wait_line("ready");
    let driver = spawn_consumer(&sandbox, "gantry-drive", &[]);
    let args = ["--out", "drive.mcap", "--lockstep=rec"];
    let recorder = spawn_consumer(&sandbox, "gantry-record", &args);
    publish_boxes(&sandbox);
    drop(daemon.wait().expect_code(0));
    drop(driver);
    recorder.stop().expect_code(0);
    let name = format!("replay-{}.mcap", std::process::id());
    let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::create_dir_all(env!("CARGO_TARGET_TMPDIR")).unwrap();
    for old in std::fs::read_dir(env!("CARGO_TARGET_TMPDIR"))
        .unwrap()
        .flatten()
    {
        if old.file_name().to_string_lossy().starts_with("replay-") {
            let _ = std::fs::remove_file(old.path());
        }
    }
    std::fs::copy(sandbox.path("drive.mcap"), &kept).unwrap();
    kept
}

/// Publishes a box for every image, in lockstep.
fn publish_boxes(sandbox: &Sandbox) {
    let bus = join_bus(sandbox, "boxer");
    let mut spec = schema_bus::ResultTopic::new(schema_frames::ResultType::Boxes2d);
    spec.about.classes = vec!["car".into()];
    let publisher = Publisher::<Box2d>::open_with(&bus, "boxer/boxes", spec).unwrap();
    let mut follower = Follower::on(join_bus(sandbox, "boxer-frames"));
    let camera = follower.follow("ego/front/rgb", Take::All);
    // The recorder finds the topic before the first tick.
    test_e2e::wait_readers(follower.bus(), "boxer/boxes", 1);
    test_e2e::wait_readers(follower.bus(), "ego/front/rgb", 1);
    let mut steps = Steps::join(&mut follower, "boxer", Duration::from_secs(30)).unwrap();
    while let Some(world) = steps.next(follower.bus(), Duration::from_secs(30)).unwrap() {
        while let Some(image) = follower.take(camera).unwrap() {
            let found = Box2d {
                score: image.header().tick as f32,
                ..bytemuck::Zeroable::zeroed()
            };
            publisher.send(&[found], &[&image]).unwrap();
        }
        if world.header.tick == N_TICKS {
            break;
        }
    }
}

/// What a file holds, without what may differ between a run and its replay: per topic a line for
/// each sample.
#[derive(Debug, Default, PartialEq)]
struct Digest {
    samples: BTreeMap<String, Vec<String>>,
    documents: BTreeMap<String, Vec<String>>,
}

fn digest(path: &Path) -> Digest {
    let file = RecordingFile::open(path).unwrap();
    assert!(file.is_complete(), "{}", path.display());
    let mut samples = file.samples(&Selection::default());
    let mut digest = Digest::default();
    while let Some(sample) = samples.next().unwrap() {
        let (topic, line) = match sample.what {
            What::Frame {
                topic,
                mut header,
                mut payload,
            } => {
                header.flags &= !FrameHeader::REPLAYED;
                let hash = hash(&[header.hashed_bytes(), &payload.to_vec().unwrap()]);
                (topic.to_string(), format!("{} {hash:016x}", header.seq))
            }
            What::Snapshot { header, records } => {
                let head = &bytemuck::bytes_of(&header)[..64];
                let hash = hash(&[head, bytemuck::cast_slice(records)]);
                (
                    "world/snapshot".into(),
                    format!("{} {hash:016x}", header.tick),
                )
            }
            What::Result {
                topic,
                mut header,
                mut body,
                inputs,
            } => {
                header.flags &= !ResultHeader::REPLAYED;
                let head =
                    &bytemuck::bytes_of(&header)[..schema_frames::result::HASHED_RESULT_BYTES];
                let of: Vec<_> = inputs
                    .iter()
                    .map(|of| (of.topic(), of.tick, of.seq))
                    .collect();
                let hash = hash(&[head, &body.to_vec().unwrap()]);
                (
                    topic.to_string(),
                    format!("{} {of:?} {hash:016x}", header.seq),
                )
            }
            What::Document {
                topic,
                header,
                text,
            } => {
                if &**topic != "world/info" {
                    let line = format!(
                        "{} {} {:016x}",
                        header.revision,
                        header.tick,
                        hash(&[text.as_bytes()])
                    );
                    digest
                        .documents
                        .entry(topic.to_string())
                        .or_default()
                        .push(line);
                }
                continue;
            }
            What::Journal { .. } | What::Foreign { .. } => continue,
        };
        digest.samples.entry(topic).or_default().push(line);
    }
    assert_eq!(samples.damage().total(), 0, "{:?}", samples.damage());
    digest
}

/// FNV-1a.
fn hash(parts: &[&[u8]]) -> u64 {
    let bytes = parts.iter().flat_map(|part| part.iter());
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

fn replay(sandbox: &Sandbox, args: &[&str]) -> Process {
    let file = recording().to_str().unwrap();
    spawn_consumer(sandbox, "gantry-replay", &[&[file][..], args].concat())
}

fn python(sandbox: &Sandbox, script: &str, args: &[&str]) -> Process {
    let script = repository().join("tests/test_e2e/python").join(script);
    let package = python_package();
    let env = [
        ("PYTHONPATH", package.to_str().unwrap()),
        ("PYTHONDONTWRITEBYTECODE", "1"),
    ];
    let args = [&[script.to_str().unwrap(), sandbox.domain()][..], args].concat();
    sandbox.spawn_program("python", &venv_program("python"), &args, &env)
}

/// Replays and records again, in lockstep.
fn record_again(sandbox: &Sandbox, args: &[&str]) -> PathBuf {
    let args = [&["--rate", "max", "--await-participant", "again"][..], args].concat();
    let replay = replay(sandbox, &args);
    let args = ["--out", "again.mcap", "--lockstep=again"];
    let recorder = spawn_consumer(sandbox, "gantry-record", &args);
    let ended = replay.wait().expect_code(0);
    assert!(ended.says("replayed"), "{:?}", ended.lines);
    recorder.stop().expect_code(0);
    sandbox.path("again.mcap")
}

#[test]
fn a_second_recording_equals_the_first() {
    let sandbox = Sandbox::new("replay");
    let first = digest(recording());
    let n = |topic: &str| first.samples.get(topic).map_or(0, Vec::len) as u64;
    for topic in test_e2e::SMALL_RIG_TOPICS {
        assert!(n(topic) >= N_TICKS / 2, "{topic}: {}", n(topic));
    }
    assert_eq!(n("world/snapshot"), N_TICKS + 1);
    assert!(n("boxer/boxes") >= N_TICKS - 1);
    assert!(n("ego/radar/radar") > 0, "{:?}", first.samples.keys());
    let again = record_again(&sandbox, &[]);
    let second = digest(&again);
    assert_eq!(
        first.samples.keys().collect::<Vec<_>>(),
        second.samples.keys().collect::<Vec<_>>()
    );
    for (topic, lines) in &first.samples {
        assert_eq!(lines, &second.samples[topic], "{topic}");
    }
    assert_eq!(first.documents, second.documents);
    // The world says that it is a replay, and frames say so, too.
    let file = RecordingFile::open(&again).unwrap();
    let info = file.metadata("world/info").unwrap().unwrap();
    assert_eq!(
        (info["source"].as_str(), info["map"].as_str()),
        ("replay", "Town10HD")
    );
    let epoch = |file: &RecordingFile| -> (u64, u32) {
        let mut samples = file.samples_of((0, u64::MAX), |topic| &*topic.name == "ego/imu/imu");
        match samples.next().unwrap().unwrap().what {
            What::Frame { header, .. } => (header.epoch, header.flags & FrameHeader::REPLAYED),
            other => panic!("{other:?}"),
        }
    };
    let (before, after) = (
        epoch(&RecordingFile::open(recording()).unwrap()),
        epoch(&file),
    );
    assert_ne!(before.0, after.0);
    assert_eq!((before.1, after.1), (0, FrameHeader::REPLAYED));
    assert_nothing_left(&sandbox);
}

#[test]
fn results_and_topics_are_left_out_or_renamed_by_choice() {
    let sandbox = Sandbox::new("replay-some");
    let args = [
        "--results",
        "none",
        "--topics",
        "ego/front/*",
        "ego/imu/*",
        "--map-topics",
        "ego/front=car/nose",
        "--to",
        "1s",
    ];
    let again = digest(&record_again(&sandbox, &args));
    let first = digest(recording());
    let topics: Vec<&str> = again.samples.keys().map(String::as_str).collect();
    assert!(
        topics.iter().all(|topic| topic.starts_with("car/nose/")
            || ["ego/imu/imu", "world/snapshot"].contains(topic)),
        "{topics:?}"
    );
    assert_eq!(topics.len(), 7 + 2);
    assert_eq!(
        again.samples["car/nose/rgb"],
        first.samples["ego/front/rgb"][..19]
    );
    assert_nothing_left(&sandbox);
}

#[test]
fn a_slow_participant_gets_every_frame() {
    let sandbox = Sandbox::new("replay-slow");
    let topics = [
        "ego/front/rgb",
        "ego/front/dvs",
        "ego/roof/lidar",
        "ego/imu/imu",
    ];
    let last = N_TICKS.to_string();
    let words = [&[last.as_str()][..], &topics].concat();
    let slow = python(&sandbox, "replay_slow.py", &words);
    let replay = replay(&sandbox, &["--rate", "max", "--lockstep"]);
    let ended = slow.wait().expect_code(0);
    replay.wait().expect_code(0);
    assert!(ended.says("done"), "{:?}", ended.lines);
    let file = RecordingFile::open(recording()).unwrap();
    let mut samples = file.samples_of((0, u64::MAX), |topic| topics.contains(&&*topic.name));
    let mut expected = Vec::new();
    while let Some(sample) = samples.next().unwrap() {
        if let What::Frame {
            topic,
            header,
            mut payload,
        } = sample.what
        {
            let crc = crc32(&payload.to_vec().unwrap());
            expected.push(format!("frame {topic} {} {crc:08x}", header.seq));
        }
    }
    let mut found: Vec<_> = ended
        .lines
        .into_iter()
        .filter(|line| line.starts_with("frame "))
        .collect();
    assert!(expected.len() as u64 > 3 * N_TICKS);
    expected.sort();
    found.sort();
    assert_eq!(found, expected);
    assert_nothing_left(&sandbox);
}

/// As zlib has it.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg())
        })
    })
}

#[test]
fn time_is_ruled_from_python() {
    let sandbox = Sandbox::new("replay-play");
    let replay = replay(&sandbox, &["--paused", "--hold"]);
    let last = N_TICKS.to_string();
    let ended = python(&sandbox, "replay_play.py", &[&last])
        .wait()
        .expect_code(0);
    assert!(ended.says("passed"), "{:?}", ended.lines);
    replay.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn a_killed_participant_does_not_stop_the_replay() {
    let sandbox = Sandbox::new("replay-kill");
    let mut replay = replay(&sandbox, &["--rate", "max", "--lockstep"]);
    // As long as this test takes part and acknowledges nothing, the recording cannot end.
    let mut follower = Follower::on(join_bus(&sandbox, "test"));
    let steps = eventually("a place in the lockstep", || {
        Steps::join(&mut follower, "test", Duration::from_secs(5)).ok()
    });
    let args = ["--out", "killed.mcap", "--lockstep=victim"];
    let victim = spawn_consumer(&sandbox, "gantry-record", &args);
    replay.wait_line("victim");
    victim.signal(Signal::SIGSTOP);
    victim.kill9();
    drop((steps, follower));
    let ended = replay.wait().expect_code(0);
    let is_told =
        |line: &String| line.contains("victim") && line.contains("is gone; going on without it");
    assert!(ended.lines.iter().any(is_told), "{:?}", ended.lines);
    assert_nothing_left(&sandbox);
}

#[test]
fn of_two_replays_in_one_domain_one_goes_on() {
    let sandbox = Sandbox::new("replay-two");
    recording();
    for _ in 0..5 {
        let mut both = [
            replay(&sandbox, &["--paused"]),
            replay(&sandbox, &["--paused"]),
        ];
        let gone = eventually("one of the two ends", || {
            both.iter_mut().position(|process| !process.is_running())
        });
        let [a, b] = both;
        let (loser, mut winner) = if gone == 0 { (a, b) } else { (b, a) };
        let ended = loser.wait().expect_code(2);
        assert!(
            ended.says("already has a simulator or a replay"),
            "{:?}",
            ended.lines
        );
        winner.wait_line("ready");
        let daemon = spawn_daemon(&sandbox, SMALL_RIG, &[]).wait().expect_code(2);
        assert!(daemon.says("already has a daemon"), "{:?}", daemon.lines);
        winner.stop().expect_code(0);
    }
    // One that was killed leaves the domain to the next.
    let mut killed = replay(&sandbox, &["--paused"]);
    killed.wait_line("ready");
    killed.kill9();
    let mut next = replay(&sandbox, &["--paused"]);
    next.wait_line("ready");
    next.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn every_round_of_a_loop_is_a_new_epoch() {
    let sandbox = Sandbox::new("replay-loop");
    let replay = replay(
        &sandbox,
        &[
            "--rate",
            "max",
            "--loop",
            "--from",
            "1s",
            "--to",
            "1.5s",
            "--lockstep",
        ],
    );
    let mut follower = Follower::on(join_bus(&sandbox, "test"));
    let imu = follower.follow("ego/imu/imu", Take::All);
    test_e2e::wait_readers(follower.bus(), "ego/imu/imu", 0);
    let mut steps = eventually("a place in the lockstep", || {
        Steps::join(&mut follower, "test", Duration::from_secs(5)).ok()
    });
    let mut rounds: Vec<(u64, Vec<u64>)> = Vec::new();
    while rounds.len() < 4 {
        let world = steps
            .next(follower.bus(), Duration::from_secs(30))
            .unwrap()
            .expect("ticks go on");
        let epoch = world.header.epoch;
        if rounds.last().is_none_or(|(last, _)| *last != epoch) {
            rounds.push((epoch, Vec::new()));
        }
        while let Some(frame) = follower.take(imu).unwrap() {
            assert_eq!(
                (frame.header().tick, frame.header().epoch),
                (world.header.tick, epoch)
            );
            rounds.last_mut().unwrap().1.push(frame.header().tick);
        }
    }
    for (_, ticks) in &rounds[1..3] {
        assert_eq!(*ticks, (20..30).collect::<Vec<u64>>());
    }
    assert_eq!(follower.reports()[0].counts.lost, 0);
    drop(steps);
    drop(follower);
    replay.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn a_recording_plays_at_its_own_speed_and_leaves_nothing_at_sigterm() {
    let sandbox = Sandbox::new("replay-term");
    let mut replay = replay(&sandbox, &[]);
    replay.wait_line("ready");
    let bus = join_bus(&sandbox, "test");
    let info: WorldInfo = document(&bus, "world/info").json().unwrap();
    assert_eq!((info.source.as_str(), info.seed), ("replay", 7));
    let mut reader = test_e2e::reader(&bus, "ego/front/depth");
    let frame = eventually("a frame", || reader.latest().unwrap());
    assert!(frame.header().tick < N_TICKS);
    drop((frame, reader, bus));
    replay.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn files_that_cannot_be_replayed_are_told_in_a_sentence() {
    let sandbox = Sandbox::new("replay-bad");
    let whole = std::fs::read(recording()).unwrap();
    let refused = |name: &str, bytes: Option<&[u8]>, args: &[&str], sentence: &str| {
        if let Some(bytes) = bytes {
            std::fs::write(sandbox.path(name), bytes).unwrap();
        }
        let ended = spawn_consumer(&sandbox, "gantry-replay", &[&[name][..], args].concat()).wait();
        assert_ne!(ended.code(), 0, "{name}: {:?}", ended.lines);
        assert!(ended.says(sentence), "{name}: {:?}", ended.lines);
        assert!(!ended.says("panicked"), "{name}: {:?}", ended.lines);
    };
    refused("none.mcap", None, &[], "cannot open none.mcap");
    refused("empty.mcap", Some(b""), &[], "empty.mcap is empty");
    refused(
        "text.mcap",
        Some(b"not a recording"),
        &[],
        "is not an MCAP file",
    );
    refused(
        "magic.mcap",
        Some(&whole[..8]),
        &[],
        "has nothing that can be replayed",
    );
    refused(
        "whole.mcap",
        Some(&whole),
        &["--from", "2s", "--to", "1s"],
        "is not before",
    );
    refused("whole.mcap", None, &["--rate", "0"], "0.01 to 100");
    refused(
        "whole.mcap",
        None,
        &["--map-topics", "ego/front/rgb=nose"],
        "RIG/SENSOR/rgb",
    );
    refused(
        "whole.mcap",
        None,
        &["--map-topics", "ego/front/rgb=ego/front/depth"],
        "give one of them another name",
    );
    // Half of it plays as far as it goes, and says so.
    std::fs::write(sandbox.path("half.mcap.part"), &whole[..whole.len() / 2]).unwrap();
    let args = ["half.mcap.part", "--rate", "max"];
    let half = spawn_consumer(&sandbox, "gantry-replay", &args)
        .wait()
        .expect_code(0);
    assert!(
        half.says("was not finished, or is cut off") && half.says("replayed"),
        "{:?}",
        half.lines
    );
    // A damaged chunk costs its own samples, which are counted.
    // Frames that nobody reads are passed over, so it is the head of a result's record.
    let mut damaged = whole.clone();
    let summary = mcap::Summary::read(&whole).unwrap().unwrap();
    let of_boxes = |chunk: &mcap::records::ChunkIndex| {
        let indexes = summary.read_message_indexes(&whole, chunk).unwrap();
        let mut channels = indexes.into_iter();
        channels.find(|(channel, _)| channel.topic.ends_with("boxer/boxes"))
    };
    let (chunk, at) = summary
        .chunk_indexes
        .iter()
        .find_map(|chunk| Some((chunk, of_boxes(chunk)?.1[0].offset)))
        .expect("boxes are recorded");
    assert_eq!(chunk.compression, "", "what follows counts in plain bytes");
    // The chunk's record head, its own head without a name of a compression, its records.
    let at = (chunk.chunk_start_offset + 9 + 40 + at) as usize;
    for byte in &mut damaged[at..at + 9] {
        *byte ^= 0x55;
    }
    std::fs::write(sandbox.path("damaged.mcap"), &damaged).unwrap();
    let args = ["damaged.mcap", "--rate", "max"];
    let ended = spawn_consumer(&sandbox, "gantry-replay", &args)
        .wait()
        .expect_code(3);
    assert!(
        ended.says("not everything was replayed"),
        "{:?}",
        ended.lines
    );
    assert_nothing_left(&sandbox);
}

/// A file of ROS 2: what maps is played, what does not is named.
#[test]
fn a_file_of_another_program_plays_as_far_as_its_messages_map() {
    let sandbox = Sandbox::new("replay-ros");
    let file = std::io::BufWriter::new(std::fs::File::create(sandbox.path("ros.mcap")).unwrap());
    let mut writer = mcap::Writer::new(file).unwrap();
    let mut channel = |topic: &str, schema: &str| {
        let schema = writer.add_schema(schema, "ros2msg", b"").unwrap();
        writer
            .add_channel(schema, topic, "cdr", &BTreeMap::new())
            .unwrap()
    };
    let (imu, other) = (
        channel("/imu/data", "sensor_msgs/msg/Imu"),
        channel("/joy", "sensor_msgs/msg/Joy"),
    );
    for n in 0..20u32 {
        let mut message = vec![0, 1, 0, 0];
        message.extend([0; 8]);
        message.extend(4u32.to_le_bytes());
        message.extend(b"imu\0");
        let numbers = [0.0, 0.0, 0.0, 1.0].into_iter().chain([0.0; 9]);
        let numbers = numbers.chain([0.0, 0.0, f64::from(n)]).chain([0.0; 9]);
        for number in numbers.chain([0.0, 0.0, 9.81]).chain([0.0; 9]) {
            message.extend(f64::to_le_bytes(number));
        }
        for channel_id in [imu, other] {
            let header = mcap::records::MessageHeader {
                channel_id,
                sequence: n,
                log_time: 1_700_000_000_000_000_000 + u64::from(n) * 10_000_000,
                publish_time: 0,
            };
            writer.write_to_known_channel(&header, &message).unwrap();
        }
    }
    writer.finish().unwrap();
    drop(writer);
    let replay = spawn_consumer(
        &sandbox,
        "gantry-replay",
        &["ros.mcap", "--rate", "max", "--lockstep"],
    );
    let mut follower = Follower::on(join_bus(&sandbox, "test"));
    let imu = follower.follow("imu/data/imu", Take::All);
    test_e2e::wait_readers(follower.bus(), "imu/data/imu", 0);
    let mut steps = eventually("a place in the lockstep", || {
        Steps::join(&mut follower, "test", Duration::from_secs(5)).ok()
    });
    let mut turns = Vec::new();
    while let Some(world) = steps.next(follower.bus(), Duration::from_secs(30)).unwrap() {
        while let Some(frame) = follower.take(imu).unwrap() {
            let sample = frame.elements::<schema_frames::ImuSample>().unwrap()[0];
            assert_eq!(frame.header().seq, frame.header().tick);
            turns.push((world.header.sim_nanos, sample.angular_velocity_radps[2]));
        }
        if turns.len() == 20 {
            break;
        }
    }
    let expected: Vec<_> = (0..20u32)
        .map(|n| (u64::from(n) * 10_000_000, f64::from(n)))
        .collect();
    assert_eq!(turns, expected);
    drop(steps);
    let ended = replay.wait().expect_code(0);
    assert!(
        ended.says("joy is not replayed: there is no frame for sensor_msgs/msg/Joy"),
        "{:?}",
        ended.lines
    );
    drop(follower);
    assert_nothing_left(&sandbox);
}

#[test]
fn carlas_client_looks_at_a_recording() {
    let sandbox = Sandbox::new("replay-carla");
    let file = recording().to_str().unwrap();
    let replay = spawn_consumer(&sandbox, "gantry-replay", &[file, "--loop"]);
    let (gateway, port, _) = start_gateway(&sandbox);
    run_script(
        &sandbox,
        "carla_on_replay.py",
        &[&port.to_string(), file],
        &["world", "refusal"],
    );
    gateway.stop().expect_code(0);
    replay.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}
