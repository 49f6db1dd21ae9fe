//! Lidars as they are sold, from the launch file to the bus, a recording and its replay.

use std::collections::BTreeSet;
use std::path::Path;

use nalgebra::{Isometry3, Point3, Vector3};
use schema_bus::{CommandClient, FrameReader, SnapshotReader};
use schema_frames::{Command, CommandReply, FrameHeader, LidarReturn, Modality, RaySegment};
use schema_recording::read::{RecordingFile, What};
use schema_types::Pose;
use test_e2e::exports::record_drive;
use test_e2e::{
    ask, assert_nothing_left, join_bus, reader, spawn_consumer, spawn_daemon, start_daemon, step,
};
use test_kit::{Sandbox, eventually};

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

const PASSING: &str = r#"version = 1
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 20
mode = "stepped"
vehicles = 0
[sensor.roof]
sensor = "turning.toml"
mount.position_m = [0.0, 0.0, 2.0]
"#;

/// Turns once in two ticks, and looks at what stands beside the car.
const TURNING: &str = r#"name = "Turning"
kind = "lidar"
[sources]
bench = "made for this test"
[keys]
returns = { value = true, status = "measured", source = "bench" }
motion_distortion = { value = true, status = "measured", source = "bench" }
rate_hz = { value = 10.0, status = "measured", source = "bench" }
channels = { value = 24, status = "measured", source = "bench" }
columns = { value = 720, status = "measured", source = "bench" }
upper_fov_deg = { value = 0.0, status = "measured", source = "bench" }
lower_fov_deg = { value = -23.0, status = "measured", source = "bench" }
fire_offsets_ns = { value = [0.0, 10000.0], status = "measured", source = "bench" }
"#;

/// A car, and the poses that snapshots gave it, with their times.
struct Passer {
    actor_id: u32,
    poses: Vec<(u64, Isometry3<f64>)>,
}

impl Passer {
    /// Lets a tick pass, and takes note of its snapshot.
    fn step(&mut self, client: &mut CommandClient, snapshots: &mut SnapshotReader) {
        step(client, 1);
        let snapshot = eventually("the newest snapshot", || snapshots.latest().unwrap());
        let car = snapshot.actor(self.actor_id).unwrap();
        let pose = car.world_from_actor.isometry();
        self.poses.push((snapshot.header().sim_nanos, pose));
    }

    /// Its pose between the snapshots of two ticks; before the first one, that one's.
    fn at(&self, sim_nanos: f64) -> Isometry3<f64> {
        let pairs = self.poses.iter().zip(&self.poses[1..]);
        for ((begin, before), (end, after)) in pairs {
            let [begin, end] = [*begin, *end].map(|nanos| nanos as f64);
            if sim_nanos <= end {
                let share = ((sim_nanos - begin) / (end - begin)).max(0.0);
                return before.lerp_slerp(after, share);
            }
        }
        self.poses.last().expect("ticks have passed").1
    }
}

/// Frames that wait, with their returns.
fn arrived(reader: &mut FrameReader) -> Vec<(FrameHeader, Vec<LidarReturn>)> {
    let mut frames = Vec::new();
    while let Some(frame) = reader.next().unwrap() {
        frames.push((*frame.header(), frame.elements().unwrap().to_vec()));
    }
    frames
}

/// Puts the car where it was when a return on it was fired, and casts the same ray through the world
/// that stands still. Returns how many were checked, and how many are at another distance.
fn check_flank(
    client: &mut CommandClient,
    car: &Passer,
    (header, returns): &(FrameHeader, Vec<LidarReturn>),
) -> [usize; 2] {
    let world_from_sensor = header.world_from_sensor.isometry();
    let from = world_from_sensor.translation.vector;
    let (mut n_checked, mut n_wrong) = (0, 0);
    for point in returns
        .iter()
        .filter(|point| point.object_id == car.actor_id)
    {
        let fired_nanos = header.sim_nanos as f64 + f64::from(point.time_ns);
        let pose = car.at(fired_nanos);
        let hit = world_from_sensor * Point3::from(point.hit_in_sensor_m.map(f64::from));
        // Wheels turn, and hang when a car is put elsewhere.
        if (pose.inverse() * hit).z < 0.8 {
            continue;
        }
        let put = Command::SetPose {
            actor_id: car.actor_id,
            pose: Pose::from(pose).into(),
        };
        assert_eq!(ask(client, put), CommandReply::Done);
        let to_m = (from + (hit.coords - from) * 1.5).into();
        let cast = Command::CastRays {
            rays: vec![RaySegment {
                from_m: from.into(),
                to_m,
            }],
            all: false,
        };
        let CommandReply::Hits { rays } = ask(client, cast) else {
            panic!("rays are cast")
        };
        let distance_m = (hit.coords - from).norm();
        let agrees = rays[0].first().is_some_and(|found| {
            found.object_id == car.actor_id && (found.distance_m - distance_m).abs() < 2e-3
        });
        (n_checked, n_wrong) = (n_checked + 1, n_wrong + usize::from(!agrees));
    }
    [n_checked, n_wrong]
}

/// Goal: a car passes at 20 m/s, 2 m in a turn. Each return on its flank lies where the snapshots'
/// poses, interpolated to the return's time, put it. A car that a command puts elsewhere stands there
/// for the whole turn.
#[test]
fn a_turning_lidar_sees_a_driving_car_at_the_time_of_each_ray() {
    let sandbox = Sandbox::new("passer");
    sandbox.write("turning.toml", TURNING);
    let daemon = start_daemon(&sandbox, PASSING, &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut roof = reader(&bus, "ego/roof/lidar_returns");
    let mut snapshots = bus.snapshot_reader().unwrap();
    step(&mut client, 20);
    let ego_id = arrived(&mut roof).last().expect("it turned").0.parent_id;
    let snapshot = eventually("the newest snapshot", || snapshots.latest().unwrap());
    let mut place = snapshot.actor(ego_id).unwrap().world_from_actor;
    drop(snapshot);
    let world_from_ego = place.isometry();
    let beside = |x: f64| (world_from_ego * Point3::new(x, 3.5, 0.3)).coords.into();
    place.translation_m = beside(-9.0);
    let spawn = Command::Spawn {
        type_id: "vehicle.tesla.model3".into(),
        pose: place.into(),
        parent_id: None,
        role: String::new(),
        attributes: Default::default(),
    };
    let CommandReply::Spawned { actor_id, .. } = ask(&mut client, spawn) else {
        panic!("must be made")
    };
    let mut car = Passer {
        actor_id,
        poses: Vec::new(),
    };
    step(&mut client, 10);
    let drive = Command::SetVelocity {
        actor_id,
        velocity_in_world_mps: (world_from_ego.rotation * Vector3::x() * 20.0).into(),
    };
    assert_eq!(ask(&mut client, drive), CommandReply::Done);
    arrived(&mut roof);
    let mut turns = Vec::new();
    for _ in 0..14 {
        car.step(&mut client, &mut snapshots);
        turns.extend(arrived(&mut roof));
    }
    assert!(turns.len() >= 6, "{} turns", turns.len());
    let went_m = (car.poses[13].1.translation.vector - car.poses[1].1.translation.vector).norm();
    assert!(went_m > 9.0, "it went {went_m} m in 0.6 s");

    // Put 5 m on between two ticks of a turn.
    let mut put = Passer {
        actor_id,
        poses: Vec::new(),
    };
    let is_between = turns.last().expect("there are turns").0.sim_nanos == car.poses[13].0;
    if is_between {
        car.step(&mut client, &mut snapshots);
        assert!(arrived(&mut roof).is_empty());
    }
    place.translation_m = beside(4.0);
    let jump = Command::SetPose {
        actor_id,
        pose: place.into(),
    };
    assert_eq!(ask(&mut client, jump), CommandReply::Done);
    put.step(&mut client, &mut snapshots);
    put.poses.push((put.poses[0].0 + 1, put.poses[0].1));
    let jumped = arrived(&mut roof);
    assert_eq!(jumped.len(), 1);

    let mut n = [0; 2];
    // The first turn began before the car was followed.
    for turn in turns
        .iter()
        .filter(|turn| turn.0.sim_nanos > car.poses[2].0)
    {
        let of_turn = check_flank(&mut client, &car, turn);
        n = [n[0] + of_turn[0], n[1] + of_turn[1]];
    }
    assert!(n[0] > 200, "{} returns on the flank", n[0]);
    assert!(
        n[1] * 100 <= n[0],
        "{} of {} returns are elsewhere",
        n[1],
        n[0]
    );
    let [n_checked, n_wrong] = check_flank(&mut client, &put, &jumped[0]);
    assert!(n_checked > 20, "{n_checked} returns after the jump");
    assert!(
        n_wrong * 50 <= n_checked,
        "{n_wrong} of {n_checked} after the jump"
    );
    drop((roof, snapshots, client, bus));
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}
