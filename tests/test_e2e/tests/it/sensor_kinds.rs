//! Radar, obstacle, collision and lane invasion on the bus, against the snapshot and the map;
//! spring arms; order of making.

use nalgebra::{Point3, Vector3};
use schema_bus::{FrameReader, Snapshot, SnapshotReader};
use schema_frames::document::PoseText;
use schema_frames::{
    Attachment, CollisionEvent, Command, CommandReply, FrameHeader, LaneCrossing, ObstacleEvent,
    RadarDetection,
};
use schema_types::{Class, Pose};
use test_e2e::{ask, document, join_bus, reader, start_daemon, step};
use test_kit::{Sandbox, eventually};

const LAUNCH: &str = r#"version = 1
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 20
mode = "stepped"
vehicles = 0
[sensor.radar]
kind = "radar"
horizontal_fov_deg = 4
vertical_fov_deg = 4
points_per_second = 4000
mount.position_m = [2.0, 0.0, 0.8]
[sensor.ahead]
kind = "obstacle"
distance_m = 40
hit_radius_m = 0.3
only_dynamics = true
mount.position_m = [0.0, 0.0, 1.0]
[sensor.bump]
kind = "collision"
[sensor.lines]
kind = "lane_invasion"
[sensor.chase]
kind = "imu"
mount.position_m = [-6.0, 0.0, 3.0]
mount.attachment = "spring_arm_ghost"
[sensor.sweep]
kind = "lidar"
scan = "sweep"
rate_hz = 20
channels = 4
points_per_second = 8000
rotation_hz = 10
mount.position_m = [0.0, 0.0, 2.2]
"#;

/// All frames that wait to be read, as (header, records).
fn drain<T: bytemuck::Pod>(reader: &mut FrameReader) -> Vec<(FrameHeader, Vec<T>)> {
    let mut frames = Vec::new();
    while let Some(frame) = reader.next().unwrap() {
        frames.push((*frame.header(), frame.elements::<T>().unwrap().to_vec()));
    }
    frames
}

fn newest(snapshots: &mut SnapshotReader) -> Snapshot {
    eventually("the newest snapshot", || snapshots.latest().unwrap())
}

/// Goal: the ego runs into a parked car 14 m ahead; radar and obstacle detector see it come, the
/// collision detector feels it.
#[test]
fn a_run_into_a_parked_car_is_seen_coming_and_felt() {
    let sandbox = Sandbox::new("kinds");
    let _daemon = start_daemon(&sandbox, LAUNCH, &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut radar = reader(&bus, "ego/radar/radar");
    let mut ahead = reader(&bus, "ego/ahead/obstacle");
    let mut bump = reader(&bus, "ego/bump/collision");
    let mut snapshots = bus.snapshot_reader().unwrap();
    step(&mut client, 20);
    assert!(
        drain::<ObstacleEvent>(&mut ahead).is_empty(),
        "nothing ahead, nothing sent"
    );
    let ego_id = drain::<RadarDetection>(&mut radar)
        .last()
        .expect("a radar sends every tick")
        .0
        .parent_id;
    drain::<CollisionEvent>(&mut bump);

    let ego = *newest(&mut snapshots).actor(ego_id).unwrap();
    let world_from_ego = ego.world_from_actor.isometry();
    let mut place = ego.world_from_actor;
    place.translation_m = (world_from_ego * Point3::new(14.0, 0.0, 0.3)).coords.into();
    let spawn = Command::Spawn {
        type_id: "vehicle.tesla.model3".into(),
        pose: place.into(),
        parent_id: None,
        role: String::new(),
        attributes: Default::default(),
    };
    let CommandReply::Spawned {
        actor_id: parked, ..
    } = ask(&mut client, spawn)
    else {
        panic!("must be made")
    };
    step(&mut client, 10);
    let forward = world_from_ego.rotation * Vector3::x();
    let set = Command::SetVelocity {
        actor_id: ego_id,
        velocity_in_world_mps: (forward * 9.0).into(),
    };
    assert_eq!(ask(&mut client, set), CommandReply::Done);
    drain::<RadarDetection>(&mut radar);
    drain::<ObstacleEvent>(&mut ahead);

    let (mut felt, mut n_seen) = (Vec::new(), 0);
    for _ in 0..60 {
        step(&mut client, 1);
        let snapshot = newest(&mut snapshots);
        let (ego, other) = (
            *snapshot.actor(ego_id).unwrap(),
            *snapshot.actor(parked).unwrap(),
        );
        drop(snapshot);
        felt.extend(drain::<CollisionEvent>(&mut bump));
        if !felt.is_empty() {
            break;
        }
        let (header, detections) = drain::<RadarDetection>(&mut radar)
            .pop()
            .expect("one a tick");
        assert_eq!(header.window_nanos, 50_000_000);
        let seen: Vec<_> = detections
            .iter()
            .filter(|detection| detection.object_id == parked)
            .collect();
        assert!(
            seen.len() > 50,
            "4000 rays a second are 200 a tick, most of them on the car"
        );
        // The expected values: what the snapshot says of both vehicles, seen from the radar.
        let lever = world_from_ego.rotation * Vector3::new(2.0, 0.0, 0.8);
        let own = Vector3::from(ego.velocity_in_world_mps)
            + Vector3::from(ego.angular_velocity_in_world_radps).cross(&lever);
        let approach = Vector3::from(other.velocity_in_world_mps) - own;
        for detection in seen {
            assert_eq!(detection.class, Class::CAR.0);
            let (azimuth, altitude) = (detection.azimuth_rad as f64, detection.altitude_rad as f64);
            let along = Vector3::new(
                azimuth.cos() * altitude.cos(),
                azimuth.sin() * altitude.cos(),
                altitude.sin(),
            );
            let along = header.world_from_sensor.isometry().rotation * along;
            assert!(
                (detection.velocity_mps as f64 - approach.dot(&along)).abs() < 0.3,
                "{detection:?} {approach}"
            );
        }
        n_seen += 1;
        let (_, obstacles) = drain::<ObstacleEvent>(&mut ahead)
            .pop()
            .expect("the car is ahead");
        let gap = (Vector3::from(other.world_from_actor.translation_m)
            - Vector3::from(ego.world_from_actor.translation_m))
        .norm();
        // From the ego's origin to the other's rear: half its length, 2.3 to 2.4 m, and the ball's
        // radius less.
        assert_eq!((obstacles.len(), obstacles[0].object_id), (1, parked));
        assert!(
            (gap - obstacles[0].distance_m as f64 - 2.65).abs() < 0.25,
            "{gap} {:?}",
            obstacles[0]
        );
    }
    let (header, events) = felt.first().expect("9 m/s over 9 m end in a collision");
    assert_eq!(header.parent_id, ego_id);
    assert!(n_seen > 5, "seen in {n_seen} ticks before");
    let hit = events
        .iter()
        .find(|event| event.other_id == parked)
        .expect("with the parked car");
    assert_eq!(hit.class, Class::CAR.0);
    let impulse = Vector3::from(hit.impulse_in_world_ns);
    // Braked by the other car: against the way, and no more than would stop the ego and throw it
    // back as fast.
    assert!(
        impulse.dot(&forward) < -500.0 && impulse.norm() < 2.0 * 9.0 * 2500.0,
        "{impulse}"
    );
}

/// Goal: pushed sideways over the lane's edges, each crossing is reported where a line of the map
/// is, and none while standing.
#[test]
fn lines_are_crossed_where_the_map_has_them() {
    let sandbox = Sandbox::new("lines");
    let _daemon = start_daemon(&sandbox, LAUNCH, &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut lines = reader(&bus, "ego/lines/lane_invasion");
    let mut imu = reader(&bus, "ego/chase/imu");
    let roads = schema_roads::RoadMap::parse(&document(&bus, "world/map").text).unwrap();
    let marks = roads.mark_lines(0.5);
    step(&mut client, 20);
    let ego_id = imu.next().unwrap().unwrap().header().parent_id;
    drain::<LaneCrossing>(&mut lines);
    step(&mut client, 10);
    assert!(
        drain::<LaneCrossing>(&mut lines).is_empty(),
        "a car at rest crosses nothing"
    );

    let mut snapshots = bus.snapshot_reader().unwrap();
    let start = newest(&mut snapshots)
        .actor(ego_id)
        .unwrap()
        .world_from_actor;
    let (mut n_crossings, mut seqs) = (0, Vec::new());
    for k in 1..=24 {
        let at = start.isometry() * Point3::new(0.0, 0.25 * k as f64, 0.05);
        let pose: PoseText = Pose {
            translation_m: at.coords.into(),
            ..start
        }
        .into();
        assert_eq!(
            ask(
                &mut client,
                Command::SetPose {
                    actor_id: ego_id,
                    pose
                }
            ),
            CommandReply::Done
        );
        step(&mut client, 1);
        for (header, crossings) in drain::<LaneCrossing>(&mut lines) {
            seqs.push(header.seq);
            for crossing in crossings {
                n_crossings += 1;
                let place = crossing.crossing_in_world_m.map(f64::from);
                let near = |mark: &schema_roads::MarkLine| {
                    mark.points
                        .windows(2)
                        .any(|ends| distance_to_segment(place, ends[0], ends[1]) < 0.05)
                };
                let found = marks.iter().find(|mark| {
                    mark.kind as u8 == crossing.mark && mark.lane == crossing.lane && near(mark)
                });
                assert!(
                    found.is_some_and(|mark| mark.road == crossing.road),
                    "{crossing:?} is on no line of the map"
                );
            }
        }
    }
    assert!(n_crossings > 0, "six metres to the left cross some line");
    assert!(
        seqs.windows(2).all(|pair| pair[1] == pair[0] + 1),
        "{seqs:?}: numbers of event frames have no gaps"
    );
}

/// In the plan.
fn distance_to_segment(p: [f64; 3], a: [f64; 3], b: [f64; 3]) -> f64 {
    let (way, from) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let length2 = way[0] * way[0] + way[1] * way[1];
    let share = if length2 > 0.0 {
        ((from[0] * way[0] + from[1] * way[1]) / length2).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (from[0] - share * way[0]).hypot(from[1] - share * way[1])
}

/// Goal: what hangs on a boom lags a turn, its frames carry the snapshot's pose bit for bit, and a
/// boom without a parent is refused.
#[test]
fn a_boom_lags_and_its_pose_is_the_snapshots() {
    let sandbox = Sandbox::new("boom");
    let _daemon = start_daemon(&sandbox, LAUNCH, &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut imu = reader(&bus, "ego/chase/imu");
    let mut snapshots = bus.snapshot_reader().unwrap();
    step(&mut client, 20);
    let header = *imu.latest().unwrap().unwrap().header();
    let ego = newest(&mut snapshots)
        .actor(header.parent_id)
        .unwrap()
        .world_from_actor
        .isometry();
    let turned = ego * nalgebra::Isometry3::rotation(Vector3::z() * 0.8);
    let pose: PoseText = Pose::from(turned).into();
    assert_eq!(
        ask(
            &mut client,
            Command::SetPose {
                actor_id: header.parent_id,
                pose
            }
        ),
        CommandReply::Done
    );
    let yaw = |pose: &Pose| {
        let forward = pose.isometry().rotation * Vector3::x();
        forward.y.atan2(forward.x)
    };
    let before = yaw(&header.world_from_sensor);
    for tick in 1..=8 {
        step(&mut client, 1);
        let frame = imu.latest().unwrap().expect("one a tick");
        let sensor_pose = newest(&mut snapshots)
            .actor(header.sensor_id)
            .unwrap()
            .world_from_actor;
        assert_eq!(
            bytemuck::bytes_of(&frame.header().world_from_sensor),
            bytemuck::bytes_of(&sensor_pose)
        );
        // Three sub-steps of 1/60 s a tick, each leaving 1 − 8/60 of the angle.
        let left = 0.8 * (1.0 - 8.0 / 60.0f64).powi(3 * tick);
        let turned =
            (yaw(&frame.header().world_from_sensor) - before).rem_euclid(std::f64::consts::TAU);
        assert!(
            (0.8 - turned - left).abs() < 0.02,
            "tick {tick}: {turned}, {left} left"
        );
    }
    let wish = Command::SpawnSensor {
        type_id: "sensor.other.imu".into(),
        pose: Pose::from_xyz_yaw(-5.0, 0.0, 2.0, 0.0).into(),
        parent_id: None,
        attachment: Attachment::SpringArm,
        interval_nanos: 0,
        spec: serde_json::from_str(r#"{"kind": "imu"}"#).unwrap(),
        attributes: Default::default(),
    };
    let CommandReply::Refused { error } = ask(&mut client, wish) else {
        panic!("nothing to hang it on")
    };
    assert!(error.contains("no parent"), "{error}");
}

/// Goal: the payloads of noisy sensors are the same whatever other sensors exist and in whatever
/// order they were made.
#[test]
fn bytes_do_not_depend_on_other_sensors_or_their_order() {
    let specs = [
        r#"{"kind": "imu", "noise_accel_stddev_mps2": [0.1, 0.1, 0.1]}"#,
        r#"{"kind": "gnss", "noise_position_stddev_deg": [1e-5, 1e-5], "noise_altitude_stddev_m": 1.0}"#,
        r#"{"kind": "lidar", "scan": "sweep", "channels": 4, "points_per_second": 8000, "noise_range_stddev_m": 0.1, "dropoff_general_ratio": 0.4}"#,
        r#"{"kind": "radar", "points_per_second": 2000}"#,
    ];
    let run = |order: &[usize], n_more: usize| {
        let sandbox = Sandbox::new("order");
        let _daemon = start_daemon(
            &sandbox,
            &LAUNCH.replace("[sensor.bump]", "[sensor.bumper]"),
            &[],
        );
        let bus = join_bus(&sandbox, "test");
        let mut client = bus.command_client("test").unwrap();
        let ego_id = {
            let mut imu = reader(&bus, "ego/chase/imu");
            step(&mut client, 1);
            imu.latest().unwrap().unwrap().header().parent_id
        };
        let mut make = |spec: &str, x: f64| {
            let wish = Command::SpawnSensor {
                type_id: "sensor.other.imu".into(),
                pose: Pose::from_xyz_yaw(x, 0.0, 2.0, 0.3).into(),
                parent_id: Some(ego_id),
                attachment: Attachment::Rigid,
                interval_nanos: 0,
                spec: serde_json::from_str(spec).unwrap(),
                attributes: Default::default(),
            };
            match ask(&mut client, wish) {
                CommandReply::Spawned { topics, .. } => topics[0].clone(),
                other => panic!("{other:?}"),
            }
        };
        for k in 0..n_more {
            make(specs[k % specs.len()], 1.0 + k as f64);
        }
        let mut readers: Vec<_> = order
            .iter()
            .map(|i| (*i, reader(&bus, &make(specs[*i], 0.0))))
            .collect();
        step(&mut client, 3);
        readers.sort_by_key(|(i, _)| *i);
        let payloads = readers
            .into_iter()
            .map(|(_, mut reader)| reader.latest().unwrap().expect("read").to_vec());
        payloads.collect::<Vec<_>>()
    };
    let first = run(&[0, 1, 2, 3], 0);
    assert!(first.iter().all(|payload| !payload.is_empty()));
    assert_eq!(first, run(&[3, 1, 0, 2], 5));
}
