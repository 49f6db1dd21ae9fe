//! When a result is correct: what it says is compared with what is true about the obstacle at the
//! tick that it answers.

use consumer_kit::items::{ResultParts, is_box, is_pose};
use consumer_metrics::tracking::iou;
use nalgebra::{Isometry3, Point3, Vector3};
use schema_frames::{
    Box2d, Box3d, MaskRecord, ResultType, Scalar, Space, Track, VehicleControlRecord,
};

use super::suite::Stage;

/// Greatest distance from the true middle if a suite says nothing, metres.
const DISTANCE_M: f64 = 2.0;
/// Least intersection over union if a suite says nothing.
const IOU: f64 = 0.5;
/// Least number of points in the true box if a suite says nothing.
const MIN_POINTS: u32 = 5;
/// How much the brake must be pressed if a suite says nothing.
const BRAKE: f32 = 0.05;
/// Points this far outside of the true box still belong to it, metres.
const POINT_SLACK_M: f64 = 0.1;
/// Most items of one result that are looked at.
const MAX_ITEMS: usize = 4096;

/// The obstacle at a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Obstacle {
    /// Middle and axes of its box in the world.
    pub world_from_box: Isometry3<f64>,
    /// Half of length, width and height, metres.
    pub half_m: Vector3<f64>,
}

/// What is true about the tick that a result answers.
#[derive(Clone, Copy, Debug)]
pub struct Truth {
    /// The obstacle; a traffic light has none in space.
    pub obstacle: Option<Obstacle>,
    /// The ego vehicle.
    pub world_from_ego: Isometry3<f64>,
    /// Rectangle round the obstacle's visible pixels as tangents of angles to the right and down:
    /// left, top, right, bottom. `None` if nothing of it is visible.
    pub rectangle: Option<[f64; 4]>,
}

/// What a result says, as far as a stage asks.
#[derive(Clone, Debug, PartialEq)]
pub enum Claim {
    /// Objects, in space, in the image, or both.
    Objects(Vec<Object>),
    /// The rule holds, or does not, whatever is true about the obstacle.
    Plain(bool),
}

/// Pose of a box in the world, half its length, width and height (metres), and its velocity (m/s) if
/// it is known.
pub type InSpace = (Isometry3<f64>, Vector3<f64>, Option<Vector3<f64>>);

/// An object that a result names.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Object {
    /// Its box in the world: middle and axes, half sizes, velocity if it was estimated.
    pub in_space: Option<InSpace>,
    /// Its rectangle in the image as in [`Truth::rectangle`].
    pub in_image: Option<[f64; 4]>,
}

/// Whether a record presses the brake of `ego` as a stage asks; `None` if it is about another car.
pub fn brakes(stage: &Stage, record: &VehicleControlRecord, ego: u32) -> Option<bool> {
    let control = record.control();
    (record.actor_id == ego)
        .then(|| control.hand_brake || control.brake_ratio > stage.brake_above.unwrap_or(BRAKE))
}

/// What a result says. `obstacle` is where the obstacle was at the result's tick, for points, which
/// are too many to keep.
pub fn claim(stage: &Stage, parts: &ResultParts<'_>, obstacle: Option<&Obstacle>) -> Claim {
    match parts.kind {
        ResultType::Boxes2d | ResultType::Boxes3d | ResultType::Tracks | ResultType::Masks => {
            Claim::Objects(objects(stage, parts))
        }
        ResultType::Points => Claim::Plain(obstacle.is_some_and(|obstacle| {
            n_inside(parts, obstacle) >= stage.min_points.unwrap_or(MIN_POINTS) as usize
        })),
        ResultType::Scalars => Claim::Plain(parts.records::<Scalar>().iter().any(|scalar| {
            stage.scalar.as_deref() == Some(scalar.name().as_str())
                && stage.above.is_none_or(|limit| scalar.value > limit)
                && stage.below.is_none_or(|limit| scalar.value < limit)
        })),
        ResultType::Text | ResultType::Json => {
            Claim::Plain(std::str::from_utf8(parts.body).is_ok_and(|text| {
                stage
                    .contains
                    .as_deref()
                    .is_some_and(|part| text.contains(part))
            }))
        }
        ResultType::Control => Claim::Plain(
            parts
                .records::<VehicleControlRecord>()
                .iter()
                .any(|record| brakes(stage, record, record.actor_id) == Some(true)),
        ),
        _ => Claim::Plain(false),
    }
}

/// Whether stages can be correct by results of this type.
pub fn is_judged(kind: ResultType) -> bool {
    use ResultType::*;
    matches!(
        kind,
        Boxes2d | Boxes3d | Tracks | Masks | Points | Scalars | Text | Json | Control
    )
}

/// Whether a claim is correct. `before_mps` is the speed along the ego's path that the stage found
/// before the stimulus, if it asks for a drop.
pub fn holds(stage: &Stage, claim: &Claim, truth: &Truth, before_mps: Option<f64>) -> bool {
    match claim {
        Claim::Plain(says) => *says,
        Claim::Objects(found) => found.iter().any(|object| {
            let slower = match (stage.slower_mps, before_mps) {
                (None, _) => true,
                (Some(drop), Some(before)) => {
                    along_mps(object, truth).is_some_and(|now| before - now >= drop)
                }
                (Some(_), None) => false,
            };
            slower && matches(stage, object, truth)
        }),
    }
}

/// Speed along the ego's path of the object that matches the obstacle, m/s.
pub fn matched_mps(stage: &Stage, claim: &Claim, truth: &Truth) -> Option<f64> {
    match claim {
        Claim::Plain(_) => None,
        Claim::Objects(found) => found
            .iter()
            .filter(|object| matches(stage, object, truth))
            .find_map(|object| along_mps(object, truth)),
    }
}

fn along_mps(object: &Object, truth: &Truth) -> Option<f64> {
    let (_, _, velocity) = object.in_space?;
    Some((truth.world_from_ego.rotation.inverse() * velocity?).x)
}

fn matches(stage: &Stage, object: &Object, truth: &Truth) -> bool {
    let in_space = || {
        let ((world_from_box, half_m, _), obstacle) = (object.in_space?, truth.obstacle?);
        let offset = world_from_box.translation.vector - obstacle.world_from_box.translation.vector;
        let near = offset.xy().norm() <= stage.distance_m.unwrap_or(DISTANCE_M);
        let in_path = stage.path_half_m.is_none_or(|half| {
            reaches_path(
                &(truth.world_from_ego.inverse() * world_from_box),
                &half_m,
                half,
            )
        });
        Some(near && in_path)
    };
    let in_image = || {
        let least = stage.iou.unwrap_or(IOU);
        Some(iou(&object.in_image?, &truth.rectangle?) >= least)
    };
    // A suite that asks for one of them is not satisfied with the other.
    let by_space = stage.distance_m.is_some() || stage.path_half_m.is_some();
    let by_image = stage.iou.is_some();
    match (by_space, by_image) {
        (true, true) => in_space() == Some(true) && in_image() == Some(true),
        (true, false) => in_space() == Some(true),
        (false, true) => in_image() == Some(true),
        (false, false) => in_space().or_else(in_image) == Some(true),
    }
}

/// Whether a box reaches into the strip of this half width ahead of the ego.
fn reaches_path(ego_from_box: &Isometry3<f64>, half_m: &Vector3<f64>, path_half_m: f64) -> bool {
    let across = ego_from_box
        .rotation
        .to_rotation_matrix()
        .matrix()
        .row(1)
        .abs();
    let extent_m = (across * half_m)[0];
    let at = ego_from_box.translation.vector;
    at.x > 0.0 && at.y.abs() - extent_m < path_half_m
}

/// A rectangle in pixels as tangents of angles, by a lens `[fx, fy, cx, cy]`; `None` without one.
pub fn tangents(rectangle: [f64; 4], [fx, fy, cx, cy]: [f64; 4]) -> Option<[f64; 4]> {
    let [left, top, right, bottom] = rectangle;
    (fx > 0.0 && fy > 0.0).then(|| {
        [
            (left - cx) / fx,
            (top - cy) / fy,
            (right - cx) / fx,
            (bottom - cy) / fy,
        ]
    })
}

fn objects(stage: &Stage, parts: &ResultParts<'_>) -> Vec<Object> {
    let counts = |class: u32, score: f32| {
        // A score that is not a number is none; it counts unless a least one is asked for.
        let sure = score >= stage.min_score || (score.is_nan() && stage.min_score <= 0.0);
        sure && (stage.classes.is_empty() || stage.classes.contains(&parts.about.class_name(class)))
    };
    let world_from_space = match parts.header.space() {
        Some(Space::World) => Isometry3::identity(),
        _ => parts.header.world_from_space.isometry(),
    };
    let in_space = |pose: &schema_types::Pose, half_m: [f32; 3], velocity: [f32; 3]| {
        let whole = is_pose(pose) && half_m.iter().all(|half| half.is_finite());
        whole.then(|| {
            let velocity = velocity.map(f64::from);
            let known = velocity.iter().all(|v| v.is_finite());
            (
                world_from_space * pose.isometry(),
                Vector3::from(half_m.map(f64::from)),
                known.then(|| world_from_space.rotation * Vector3::from(velocity)),
            )
        })
    };
    let in_image = |min_px: [f32; 2], max_px: [f32; 2]| {
        let rectangle = [min_px[0], min_px[1], max_px[0], max_px[1]].map(f64::from);
        is_box(min_px, max_px)
            .then(|| tangents(rectangle, parts.header.intrinsics_px))
            .flatten()
    };
    let mut found: Vec<Object> = Vec::new();
    match parts.kind {
        ResultType::Boxes2d => found.extend(
            parts
                .records::<Box2d>()
                .iter()
                .filter(|it| counts(it.class, it.score))
                .map(|it| Object {
                    in_space: None,
                    in_image: in_image(it.min_px, it.max_px),
                }),
        ),
        ResultType::Masks => found.extend(
            parts
                .records::<MaskRecord>()
                .iter()
                .filter(|it| counts(it.class, it.score))
                .map(|it| Object {
                    in_space: None,
                    in_image: in_image(it.min_px, it.max_px),
                }),
        ),
        ResultType::Boxes3d => found.extend(
            parts
                .records::<Box3d>()
                .iter()
                .filter(|it| counts(it.class, it.score))
                .map(|it| Object {
                    in_space: in_space(&it.pose, it.half_m, it.velocity_mps),
                    in_image: None,
                }),
        ),
        ResultType::Tracks => found.extend(
            parts
                .records::<Track>()
                .iter()
                .filter(|it| it.state < 3 && counts(it.class, it.score))
                .map(|it| Object {
                    in_space: (it.flags & Track::IN_SPACE != 0)
                        .then(|| in_space(&it.pose, it.half_m, it.velocity_mps))
                        .flatten(),
                    in_image: (it.flags & Track::IN_IMAGE != 0)
                        .then(|| in_image(it.min_px, it.max_px))
                        .flatten(),
                }),
        ),
        _ => {}
    }
    found.retain(|object| object.in_space.is_some() || object.in_image.is_some());
    found.truncate(MAX_ITEMS);
    found
}

/// Points of a cloud inside the obstacle's box.
fn n_inside(parts: &ResultParts<'_>, obstacle: &Obstacle) -> usize {
    let fields = parts.fields();
    let by_name = |name: &str| fields.iter().find(|field| field.name == name);
    let (Some(x), Some(y), Some(z)) = (by_name("x"), by_name("y"), by_name("z")) else {
        return 0;
    };
    let world_from_space = match parts.header.space() {
        Some(Space::World) => Isometry3::identity(),
        _ => parts.header.world_from_space.isometry(),
    };
    let box_from_space = obstacle.world_from_box.inverse() * world_from_space;
    let stride = (parts.header.element_bytes as usize).max(1);
    parts
        .body
        .chunks_exact(stride)
        .filter(|point| {
            let at = box_from_space * Point3::new(x.of(point), y.of(point), z.of(point));
            (0..3).all(|axis| at[axis].abs() <= obstacle.half_m[axis] + POINT_SLACK_M)
        })
        .count()
}

#[cfg(test)]
mod tests {
    use schema_frames::{About, ResultHeader, VehicleControl};
    use schema_types::Pose;

    use super::*;

    fn truth() -> Truth {
        Truth {
            obstacle: Some(Obstacle {
                world_from_box: Isometry3::translation(20.0, 1.0, 1.0),
                half_m: Vector3::new(0.3, 0.3, 0.9),
            }),
            world_from_ego: Isometry3::identity(),
            rectangle: Some([0.0, 0.0, 0.1, 0.2]),
        }
    }

    fn box_at(x: f64, y: f64, half_y: f32, vx: f32) -> Box3d {
        Box3d {
            pose: Pose::from_xyz_yaw(x, y, 1.0, 0.0),
            half_m: [0.4, half_y, 0.9],
            velocity_mps: [vx, 0.0, 0.0],
            score: 0.8,
            class: 12,
            id: 0,
            n_points: 0,
            reserved: [0; 2],
        }
    }

    fn claim_of<T: bytemuck::Pod>(
        stage: &Stage,
        kind: ResultType,
        records: &[T],
        header: ResultHeader,
    ) -> Claim {
        let mut header = header;
        header.set_list(records.len() as u32, size_of::<T>() as u32, 0);
        let about = About::default();
        let parts = ResultParts {
            topic: "a/b",
            header: &header,
            kind,
            body: bytemuck::cast_slice(records),
            inputs: &[],
            about: &about,
        };
        claim(stage, &parts, truth().obstacle.as_ref())
    }

    #[test]
    fn a_box_in_space_must_be_near_and_of_a_wanted_class() {
        let header = ResultHeader::new(ResultType::Boxes3d);
        let judge = |stage: &Stage, found: Box3d| {
            let claim = claim_of(stage, ResultType::Boxes3d, &[found], header);
            holds(stage, &claim, &truth(), Some(8.0))
        };
        let stage = |distance: f64| Stage {
            distance_m: Some(distance),
            ..Stage::default()
        };
        assert!(judge(&stage(1.0), box_at(20.6, 1.0, 0.3, 0.0)));
        assert!(!judge(&stage(0.5), box_at(20.6, 1.0, 0.3, 0.0)));
        let of_class = |name: &str| Stage {
            classes: vec![name.into()],
            ..stage(1.0)
        };
        let person = schema_types::class::CLASSES[12].name;
        assert!(judge(&of_class(person), box_at(20.0, 1.0, 0.3, 0.0)));
        assert!(!judge(&of_class("Car"), box_at(20.0, 1.0, 0.3, 0.0)));
        let sure = Stage {
            min_score: 0.9,
            ..stage(1.0)
        };
        assert!(!judge(&sure, box_at(20.0, 1.0, 0.3, 0.0)));
        // In the path of 1.2 m only if its side reaches into it.
        let path = Stage {
            path_half_m: Some(1.2),
            ..stage(2.0)
        };
        assert!(judge(&path, box_at(20.0, 1.6, 0.5, 0.0)));
        assert!(!judge(&path, box_at(20.0, 1.6, 0.3, 0.0)));
        // 3 m/s slower than before.
        let slower = Stage {
            slower_mps: Some(3.0),
            ..stage(1.0)
        };
        assert!(judge(&slower, box_at(20.0, 1.0, 0.3, 4.9)));
        assert!(!judge(&slower, box_at(20.0, 1.0, 0.3, 5.1)));
        assert!(!judge(&slower, box_at(20.0, 1.0, 0.3, f32::NAN)));
    }

    #[test]
    fn a_box_in_an_image_is_compared_by_angles_whatever_its_resolution() {
        let stage = Stage {
            iou: Some(0.5),
            ..Stage::default()
        };
        let judge = |lens: [f64; 4], min_px: [f32; 2], max_px: [f32; 2]| {
            let mut header = ResultHeader::new(ResultType::Boxes2d);
            header.intrinsics_px = lens;
            let found = Box2d {
                min_px,
                max_px,
                score: 1.0,
                class: 0,
                id: 0,
                reserved: 0,
            };
            let claim = claim_of(&stage, ResultType::Boxes2d, &[found], header);
            holds(&stage, &claim, &truth(), None)
        };
        // The true rectangle spans 0.1 by 0.2: 10 by 20 px at 100 px, 50 by 100 px at 500 px.
        assert!(judge(
            [100.0, 100.0, 50.0, 50.0],
            [50.0, 50.0],
            [60.0, 70.0]
        ));
        assert!(judge(
            [500.0, 500.0, 400.0, 300.0],
            [400.0, 300.0],
            [450.0, 400.0]
        ));
        // 10/15 and 10/22 of the union.
        assert!(judge(
            [100.0, 100.0, 50.0, 50.0],
            [50.0, 50.0],
            [65.0, 70.0]
        ));
        assert!(!judge(
            [100.0, 100.0, 50.0, 50.0],
            [50.0, 50.0],
            [72.0, 70.0]
        ));
        // Without a lens nothing can be said, and a box inside out is none.
        assert!(!judge([0.0; 4], [50.0, 50.0], [60.0, 70.0]));
        assert!(!judge(
            [100.0, 100.0, 50.0, 50.0],
            [60.0, 70.0],
            [50.0, 50.0]
        ));
    }

    #[test]
    fn points_scalars_and_texts_have_rules_of_their_own() {
        let points: Vec<[f32; 4]> = (0..6)
            .map(|i| [20.0, 1.0, 0.2 + 0.2 * i as f32, 0.0])
            .collect();
        let header = ResultHeader::new(ResultType::Points);
        let at_least = |n: u32| Stage {
            min_points: Some(n),
            ..Stage::default()
        };
        for (n, says) in [(6, true), (7, false)] {
            let claim = claim_of(&at_least(n), ResultType::Points, &points, header);
            assert_eq!(claim, Claim::Plain(says), "{n}");
        }
        let stage = Stage {
            scalar: Some("ttc_s".into()),
            below: Some(2.0),
            ..Stage::default()
        };
        let header = ResultHeader::new(ResultType::Scalars);
        for (value, says) in [(1.9, true), (2.0, false), (f64::NAN, false)] {
            let scalars = [Scalar::new("other", 0.0), Scalar::new("ttc_s", value)];
            let claim = claim_of(&stage, ResultType::Scalars, &scalars, header);
            assert_eq!(claim, Claim::Plain(says), "{value}");
        }
        let stage = Stage {
            contains: Some("red".into()),
            ..Stage::default()
        };
        let header = ResultHeader::new(ResultType::Text);
        assert_eq!(
            claim_of(&stage, ResultType::Text, b"it is red", header),
            Claim::Plain(true)
        );
        assert_eq!(
            claim_of(&stage, ResultType::Text, b"green", header),
            Claim::Plain(false)
        );
    }

    #[test]
    fn a_brake_is_the_pedal_or_the_lever_of_the_ego_alone() {
        let stage = Stage::default();
        let record = |brake_ratio: f32, hand_brake: bool| {
            let control = VehicleControl {
                brake_ratio,
                hand_brake,
                ..VehicleControl::default()
            };
            VehicleControlRecord::new(3, control)
        };
        assert_eq!(brakes(&stage, &record(0.04, false), 3), Some(false));
        assert_eq!(brakes(&stage, &record(0.06, false), 3), Some(true));
        assert_eq!(brakes(&stage, &record(0.0, true), 3), Some(true));
        assert_eq!(brakes(&stage, &record(1.0, true), 4), None);
    }
}
