//! Tasks in space: boxes, points, trajectories, lines.

use consumer_truth::ticks::TickSet;
use nalgebra::Isometry3;
use schema_frames::{
    ActorKind, Box3d, Modality, Odometry as OdometryRecord, ResultHeader, ResultType,
    SemanticLidarPoint, Space,
};
use schema_types::Pose;

use super::close;
use super::scene::{
    EGO, MS, actor, capture, list, plan, result, scenario, scored, scored_in, spec, tick,
};
use crate::capture::{Body, CapturedResult, Mode};
use crate::report::TaskScore;
use crate::suite::TaskKind;
use crate::tasks::dense::lidar_semantic::LidarSemantic;
use crate::tasks::motion::odometry::Odometry;
use crate::tasks::objects::boxes3d::Boxes3d;
use crate::tasks::{Measure, Spec, TaskRun};

fn times() -> impl Iterator<Item = u64> + Clone {
    (1..31u64).map(|n| n * 100 * MS)
}

fn secs(at: u64) -> f64 {
    at as f64 / 1e9
}

/// The carrier drives along x at 10 m/s, turned by half a radian.
fn ego(at: u64) -> Pose {
    Pose::from_xyz_yaw(10.0 * secs(at), 0.0, 0.0, 0.5)
}

/// A car drives at 12 m/s, 20 m ahead and 3 m to the left of where the carrier began.
fn car(at: u64) -> Pose {
    Pose::from_xyz_yaw(20.0 + 12.0 * secs(at), 3.0, 0.75, 0.1)
}

fn point(id: u32, class: u8, at: [f32; 3]) -> SemanticLidarPoint {
    SemanticLidarPoint {
        hit_in_sensor_m: at,
        cos_incidence: 1.0,
        object_id: id,
        class,
        reserved: 0,
        channel: 0,
    }
}

fn scene(at: u64) -> TickSet {
    let points = [
        point(9, 14, [18.0, 2.0, 0.5]),
        point(0, 1, [5.0, 0.0, -1.0]),
        point(0, 1, [6.0, 0.0, -1.0]),
        point(0, 3, [5.0, 9.0, 2.0]),
    ];
    let mut cloud = list(
        "ego/front_truth/semantic_lidar",
        Modality::SemanticLidar,
        at,
        &points,
    );
    cloud.header.world_from_sensor = ego(at);
    let records = vec![
        actor(EGO, ActorKind::Vehicle, 14, ego(at), [10.0, 0.0, 0.0]),
        actor(9, ActorKind::Vehicle, 14, car(at), [12.0, 0.0, 0.0]),
        // Without a point of its own.
        actor(
            10,
            ActorKind::Walker,
            12,
            Pose::from_xyz_yaw(5.0, 9.0, 0.9, 0.0),
            [0.0; 3],
        ),
    ];
    tick(at, vec![cloud], records)
}

fn run<M: Measure>(
    mode: Mode,
    spec: &Spec,
    measure: M,
    answer: impl Fn(u64) -> CapturedResult,
) -> TaskScore {
    let mut capture = capture(mode, times());
    capture.results.extend(times().map(answer));
    let mut task = TaskRun::new(spec.clone(), mode, plan(&[0, 100]), measure);
    let scored = scored(
        &mut task,
        &capture,
        &scenario(),
        1000 * MS,
        times().map(scene),
    );
    assert_eq!(scored.first_fault, None);
    scored.score
}

/// The car as a box in a space, published 50 ms after its frame.
fn boxed(at: u64, space: Space) -> CapturedResult {
    let world_from_space = match space {
        Space::World => Pose::IDENTITY,
        _ => ego(at),
    };
    let placed = world_from_space.isometry().inverse() * car(at).isometry();
    let turned =
        world_from_space.isometry().rotation.inverse() * nalgebra::Vector3::new(12.0, 0.0, 0.0);
    let mut found: Box3d = bytemuck::Zeroable::zeroed();
    found.pose = placed.into();
    found.half_m = [2.0, 1.0, 0.75];
    found.velocity_mps = [turned.x as f32, turned.y as f32, 0.0];
    (found.score, found.class) = (0.9, 14);
    let mut result = result(ResultType::Boxes3d, at, at + 50 * MS, &[found]);
    result.header.space = space as u32;
    if space == Space::Sensor {
        result.header.world_from_space = world_from_space;
    }
    result
}

#[test]
fn a_box_is_the_same_in_every_space() {
    let asked = spec(TaskKind::Boxes3d);
    for space in [Space::World, Space::Sensor, Space::Vehicle] {
        let measure = Boxes3d::new(&asked).expect("classes");
        let score = run(Mode::Offline, &asked, measure, |at| boxed(at, space));
        close(score.offline.get("mAP"), 1.0, "mAP");
        for error in ["mATE", "mASE", "mAOE", "mAVE"] {
            assert!(
                score.offline[error] < 1e-5,
                "{space:?} {error}: {}",
                score.offline[error]
            );
        }
        assert!((score.offline["NDS"] - 1.0).abs() < 1e-5, "{space:?}");
        // The person shows no point: neither asked for nor missed.
        assert_eq!((score.n_scored, score.n_ignored), (21, 21));
    }
}

/// In a sealed world a program knows the mount of its sensor alone.
#[test]
fn a_box_of_a_sealed_world_is_placed_by_the_carriers_pose() {
    let asked = spec(TaskKind::Boxes3d);
    let mount = Pose::from_xyz_yaw(1.5, 0.2, 1.6, 0.3);
    let seen = |at: u64| {
        let world_from_sensor = ego(at).isometry() * mount.isometry();
        let mut result = boxed(at, Space::Vehicle);
        let mut found: Box3d = bytemuck::pod_read_unaligned(&result.body.bytes().unwrap());
        found.pose = (world_from_sensor.inverse() * car(at).isometry()).into();
        result.body = Body::Held(bytemuck::bytes_of(&found).into());
        result.header.space = Space::Sensor as u32;
        result.header.world_from_space = mount;
        result
    };
    let score = |is_sealed: bool| {
        let mut capture = capture(Mode::Offline, times());
        capture.results.extend(times().map(seen));
        let measure = Boxes3d::new(&asked).expect("classes");
        let mut task = TaskRun::new(asked.clone(), Mode::Offline, plan(&[0]), measure);
        let ticks = times().map(scene);
        let scored = scored_in(
            &mut task,
            &capture,
            &scenario(),
            1000 * MS,
            ticks,
            is_sealed,
        );
        assert_eq!(scored.first_fault, None);
        scored.score
    };
    let sealed = score(true);
    close(sealed.offline.get("mAP"), 1.0, "mAP");
    assert!(sealed.offline["mATE"] < 1e-5, "{}", sealed.offline["mATE"]);
    close(
        score(false).offline.get("mAP"),
        0.0,
        "mAP of a mount that is taken for a place",
    );
}

#[test]
fn a_late_box_is_behind_by_what_the_car_drove_meanwhile() {
    let asked = spec(TaskKind::Boxes3d);
    let measure = Boxes3d::new(&asked).expect("classes");
    let score = run(Mode::Streaming, &asked, measure, |at| {
        boxed(at, Space::Sensor)
    });
    // A query finds the answer to the frame before: 1.2 m behind, so right at 2 m and 4 m only.
    for (metric, value) in [
        ("AP@0.5m", 0.0),
        ("AP@1m", 0.0),
        ("AP@2m", 1.0),
        ("AP@4m", 1.0),
    ] {
        close(score.streaming.get(metric), value, metric);
    }
    assert!((score.streaming["mATE"] - 1.2).abs() < 1e-5);
    assert!((score.offline["mAP"] - 1.0).abs() < 1e-9);
    // 100 ms later 2.4 m: at 4 m only.
    let at: Vec<f64> = score.curve.iter().map(|point| point.delay_ms).collect();
    assert_eq!(at, [0.0, 100.0]);
    assert!(score.curve[1].value < score.curve[0].value);
}

#[test]
fn labels_follow_their_points_and_unlabelled_points_are_unanswered() {
    let asked = spec(TaskKind::LidarSemantic);
    let labelled = |at: u64, n: usize| {
        // x, y, z as f32 and a class, in the sensor's space.
        let points = [
            ([18.0f32, 2.0, 0.5], 14u32),
            ([5.0, 0.0, -1.0], 1),
            ([6.0, 0.0, -1.0], 1),
            ([5.0, 9.0, 2.0], 3),
        ];
        let mut body = Vec::new();
        for (place, class) in &points[..n] {
            body.extend(bytemuck::bytes_of(place));
            body.extend(class.to_le_bytes());
        }
        let mut header = ResultHeader::new(ResultType::Points);
        header.set_list(n as u32, 16, 0);
        header.world_from_space = ego(at);
        with_fields(header, at, &body)
    };
    let score = |n: usize| {
        let mut capture = capture(Mode::Offline, times());
        capture.results.extend(times().map(|at| labelled(at, n)));
        let mut own = schema_frames::About::default();
        for (i, (name, element)) in [("x", "f32"), ("y", "f32"), ("z", "f32"), ("class", "u32")]
            .iter()
            .enumerate()
        {
            own.fields.push(schema_frames::about::PointField {
                name: (*name).into(),
                element: (*element).into(),
                offset: i as u32 * 4,
            });
        }
        capture.abouts.insert("mine/out".into(), own);
        let measure = LidarSemantic::new(&asked).expect("classes");
        let mut task = TaskRun::new(asked.clone(), Mode::Offline, plan(&[0]), measure);
        let scored = scored(&mut task, &capture, &scenario(), 0, times().map(scene));
        assert_eq!(scored.first_fault, None);
        scored.score
    };
    close(score(4).offline.get("mIoU"), 1.0, "mIoU");
    // Without the last point the building is not found.
    let less = score(3);
    close(less.offline.get("IoU/Roads"), 1.0, "roads");
    close(less.offline.get("IoU/Buildings"), 0.0, "buildings");
    close(less.offline.get("accuracy"), 0.75, "accuracy");
}

fn with_fields(header: ResultHeader, at: u64, body: &[u8]) -> CapturedResult {
    super::scene::with_body(header, at, at + MS, body)
}

#[test]
fn a_trajectory_is_judged_without_its_own_origin() {
    let asked = spec(TaskKind::Odometry);
    // The program's own space is turned and moved; nothing else is wrong.
    let own = Isometry3::new(
        nalgebra::Vector3::new(5.0, -3.0, 1.0),
        nalgebra::Vector3::z() * 1.2,
    );
    let answer = |at: u64| {
        let mut record: OdometryRecord = bytemuck::Zeroable::zeroed();
        record.pose = (own * ego(at).isometry()).into();
        result(ResultType::Odometry, at, at + 50 * MS, &[record])
    };
    let score = run(Mode::Offline, &asked, Odometry::new(&asked), answer);
    for metric in ["ATE", "RPE"] {
        assert!(
            score.offline[metric] < 1e-6,
            "{metric}: {}",
            score.offline[metric]
        );
    }
    // In time every pose is the one of the frame before, a metre behind on a straight way at one
    // speed: from frame to frame nothing is wrong.
    let late = run(Mode::Streaming, &asked, Odometry::new(&asked), answer);
    assert!(late.streaming["RPE"] < 1e-6);
    assert_eq!(late.n_scored, 21);
}
