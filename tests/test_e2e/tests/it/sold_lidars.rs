//! Lidars as they are sold, from the launch file to the bus, a recording and its replay.

use std::collections::BTreeSet;
use std::path::Path;

use schema_frames::{FrameHeader, LidarReturn, Modality};
use schema_recording::read::{RecordingFile, What};
use test_e2e::exports::record_drive;
use test_e2e::{assert_nothing_left, spawn_consumer, spawn_daemon};
use test_kit::Sandbox;

const LAUNCH: &str = r#"version = 1
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 20
vehicles = 2
[sensor.roof]
sensor = "velodyne/vlp-16"
mount.position_m = [0.0, 0.0, 2.0]
[sensor.own]
sensor = "own.toml"
rate_hz = 20
mount.position_m = [0.0, 0.0, 2.0]
"#;

/// Four staggered channels, which fire 1 µs apart.
const OWN: &str = r#"name = "Own"
kind = "lidar"
[sources]
bench = "made for this test"
[keys]
returns = { value = true, status = "measured", source = "bench" }
channels = { value = 4, status = "measured", source = "bench" }
columns = { value = 36, status = "measured", source = "bench" }
elevations_deg = { value = [5.0, -2.0, -10.0, -25.0], status = "measured", source = "bench" }
azimuth_offsets_deg = { value = [2.0, -2.0], status = "measured", source = "bench" }
fire_offsets_ns = { value = [0.0, 1000.0, 2000.0, 3000.0], status = "measured", source = "bench" }
rings = { value = [7, 5, 3, 1], status = "measured", source = "bench" }
min_range_m = { value = 1.0, status = "measured", source = "bench" }
"#;

/// Headers and returns of a topic, in the order of the file.
fn frames(path: &Path, topic: &str) -> Vec<(FrameHeader, Vec<LidarReturn>)> {
    let file = RecordingFile::open(path).unwrap();
    let mut samples = file.samples_of((0, u64::MAX), |found| *found.name == *topic);
    let mut frames = Vec::new();
    while let Some(sample) = samples.next().unwrap() {
        if let What::Frame {
            header,
            mut payload,
            ..
        } = sample.what
        {
            let returns = bytemuck::pod_collect_to_vec(&payload.to_vec().unwrap());
            frames.push((header, returns));
        }
    }
    frames
}

/// Column of a return: each channel fires once a column, the last column's last firing is at 0.
fn column(time_ns: i32, fired_ns: f64, last_ns: f64, period_ns: f64, n_columns: f64) -> f64 {
    let column = n_columns - 1.0 + (f64::from(time_ns) + last_ns - fired_ns) / period_ns;
    assert!(
        (column - column.round()).abs() < 1e-4,
        "{time_ns} ns is when no column fires"
    );
    assert!((0.0..n_columns).contains(&column.round()), "{column}");
    column.round()
}

/// A VLP-16 by its manual: 16 lasers 2° apart, 2.304 µs from one to the next in the order −15, 1, −13,
/// 3, …, 55.296 µs for all; clockwise. Noise of the range moves points along their beams only.
fn assert_vlp_16(header: &FrameHeader, returns: &[LidarReturn]) {
    assert_eq!(header.modality(), Some(Modality::LidarReturns));
    assert_eq!((header.n_channels, header.range_limit_m), (16, 100.0));
    assert!(
        (2_000..=16 * 1800).contains(&returns.len()),
        "{}",
        returns.len()
    );
    let mut seen = BTreeSet::new();
    for point in returns {
        let elevation_deg = 2 * i32::from(point.ring) - 15;
        let place = match elevation_deg {
            ..0 => elevation_deg + 15,
            _ => elevation_deg,
        };
        let fired_ns = f64::from(place) * 2304.0;
        let column = column(point.time_ns, fired_ns, 15.0 * 2304.0, 55_296.0, 1800.0);
        assert!(
            seen.insert((point.ring, column as u32)),
            "one return a firing"
        );
        let head_deg = 180.0 - 0.2 * (column + 1.0);
        let (sin, cos) = head_deg.to_radians().sin_cos();
        let [x, y, z] = point.hit_in_sensor_m.map(f64::from);
        let [x, y] = [x - 0.041_91 * cos, y - 0.041_91 * sin];
        let seen_deg = z.atan2(x.hypot(y)).to_degrees();
        assert!(
            (seen_deg - f64::from(elevation_deg)).abs() < 1e-3,
            "{point:?}"
        );
        let azimuth_deg = head_deg - 0.2 * fired_ns / 55_296.0;
        let error_deg = (y.atan2(x).to_degrees() - azimuth_deg + 180.0).rem_euclid(360.0) - 180.0;
        assert!(error_deg.abs() < 1e-3, "{error_deg} {point:?}");
        assert_ne!(point.class, 0, "{point:?}");
    }
    let rings: BTreeSet<u16> = returns.iter().map(|point| point.ring).collect();
    assert!(
        rings.range(..8).count() == 8,
        "all that look down: {rings:?}"
    );
}

/// The profile [`OWN`], whose `rate_hz` the launch file gives.
fn assert_own(header: &FrameHeader, returns: &[LidarReturn]) {
    assert_eq!((header.n_channels, header.range_limit_m), (4, 120.0));
    assert!((72..=144).contains(&returns.len()), "{}", returns.len());
    for point in returns {
        let channel = usize::from(7 - point.ring) / 2;
        let fired_ns = 1000.0 * channel as f64;
        let period_ns = 1e9 / 20.0 / 36.0;
        let column = column(point.time_ns, fired_ns, 3000.0, period_ns, 36.0);
        let [x, y, z] = point.hit_in_sensor_m.map(f64::from);
        let elevation_deg = z.atan2(x.hypot(y)).to_degrees();
        assert!((elevation_deg - [5.0, -2.0, -10.0, -25.0][channel]).abs() < 1e-3);
        // Counter-clockwise from behind, while the head turns on.
        let aside_deg = [2.0, -2.0][channel % 2] + 10.0 * fired_ns / period_ns;
        let azimuth_deg = 10.0 * (column + 1.0) - 180.0 + aside_deg;
        let error_deg = (y.atan2(x).to_degrees() - azimuth_deg + 180.0).rem_euclid(360.0) - 180.0;
        assert!(error_deg.abs() < 1e-3, "{error_deg} {point:?}");
        assert!((x * x + y * y + z * z).sqrt() >= 1.0);
    }
}

#[test]
fn sold_lidars_send_what_their_tables_say_and_replay_the_same_bytes() {
    let sandbox = Sandbox::new("sold");
    sandbox.write("own.toml", OWN);
    record_drive(&sandbox, LAUNCH, 10);
    let drive = sandbox.path("drive.mcap");
    let roof = frames(&drive, "ego/roof/lidar_returns");
    let own = frames(&drive, "ego/own/lidar_returns");
    assert!(
        roof.len() >= 4 && own.len() >= 8,
        "{} {}",
        roof.len(),
        own.len()
    );
    for (header, returns) in &roof {
        assert_vlp_16(header, returns);
    }
    for (header, returns) in &own {
        assert_own(header, returns);
    }

    let replay = [
        "drive.mcap",
        "--rate",
        "max",
        "--await-participant",
        "again",
    ];
    let replay = spawn_consumer(&sandbox, "gantry-replay", &replay);
    let recorder = ["--out", "again.mcap", "--lockstep=again"];
    let recorder = spawn_consumer(&sandbox, "gantry-record", &recorder);
    replay.wait().expect_code(0);
    recorder.stop().expect_code(0);
    for (topic, before) in [
        ("ego/roof/lidar_returns", roof),
        ("ego/own/lidar_returns", own),
    ] {
        let after = frames(&sandbox.path("again.mcap"), topic);
        assert_eq!(after.len(), before.len(), "{topic}");
        for ((header, returns), (_, wanted)) in after.iter().zip(&before) {
            let [found, wanted]: [&[u8]; 2] =
                [returns, wanted].map(|points| bytemuck::cast_slice(points));
            assert!(found == wanted, "frame {} of {topic}", header.seq);
        }
    }
    assert_nothing_left(&sandbox);
}

/// A profile with mistakes ends the simulator with a sentence for each, and where it stands.
#[test]
fn a_profile_with_mistakes_is_refused_with_its_lines() {
    let sandbox = Sandbox::new("unsold");
    let wrong = OWN
        .replace("5.0, -2.0, -10.0, -25.0", "5.0, -2.0, -10.0")
        .replace("min_range_m", "nearest_m");
    sandbox.write("own.toml", &wrong);
    let ended = spawn_daemon(&sandbox, LAUNCH, &[]).wait().expect_code(2);
    for sentence in [
        "sensor.own.elevations_deg is a list of 3, but must have as many numbers as channels 4 or a divisor",
        "own.toml:9:28",
        "unknown key \"nearest_m\" in [sensor.own]",
        "own.toml:13:1",
    ] {
        assert!(ended.says(sentence), "{sentence}: {:?}", ended.lines);
    }
    assert_nothing_left(&sandbox);
}
