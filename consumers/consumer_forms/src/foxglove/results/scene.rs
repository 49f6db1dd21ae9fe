//! Boxes, points, poses and paths as Foxglove's messages in space.

use consumer_kit::items::is_pose;
use fox::packed_element_field::NumericType;
use foxglove::messages as fox;
use nalgebra::Isometry3;
use schema_frames::{Box3d, ElementType, Odometry, PathPoint, PoseEstimate, Track};
use schema_types::Pose;

use super::shot::{OPACITY, Shot};
use super::state::ResultConverter;
use crate::foxglove::frames::{DATA_FIELD, quaternion, timestamp, vector};
use schema_recording::messages::{Content, Entry, encoded};
use schema_recording::wire::put_bytes;

/// Speed that is shown in full red, m/s.
const FULL_SPEED_MPS: f64 = 20.0;
const TEXT_M: f64 = 0.5;
const BAD_POSE: &str = "a pose is not finite or has no unit quaternion";

/// A box in space as it is drawn.
struct Solid {
    pose: Pose,
    half_m: [f32; 3],
    colour: fox::Color,
    label: String,
}

impl ResultConverter {
    pub(super) fn boxes3d(&mut self, shot: &Shot<'_>) -> Entry {
        let boxes = shot.parts.records::<Box3d>();
        let solids = boxes.iter().map(|it| Solid {
            pose: it.pose,
            half_m: it.half_m,
            colour: shot.colour(it.class, it.id, false, OPACITY),
            label: shot.parts.label(it.class, it.score, it.id),
        });
        self.solids(shot, shot.channel.clone(), solids)
    }

    pub(super) fn tracks3d(&mut self, shot: &Shot<'_>, tracks: &[&Track]) -> Entry {
        let solids = tracks.iter().map(|it| Solid {
            pose: it.pose,
            half_m: it.half_m,
            colour: shot.colour(it.class, it.id, true, OPACITY),
            label: shot.parts.label(it.class, it.score, it.id),
        });
        self.solids(shot, format!("{}/space", shot.channel), solids)
    }

    fn solids(
        &mut self,
        shot: &Shot<'_>,
        channel: String,
        solids: impl Iterator<Item = Solid>,
    ) -> Entry {
        let (mut entity, axes) = shot.entity();
        for solid in solids {
            let is_size = solid
                .half_m
                .iter()
                .all(|half| half.is_finite() && *half >= 0.0);
            if !is_pose(&solid.pose) || !is_size {
                let why =
                    "a box in space is not finite, has a negative side, or no unit quaternion";
                self.bad.note(shot.parts.topic, 1, why);
                continue;
            }
            let pose = Some(placed(&axes, &solid.pose));
            entity.cubes.push(fox::CubePrimitive {
                pose,
                size: Some(vector(solid.half_m.map(|half| 2.0 * half as f64))),
                color: Some(solid.colour),
            });
            entity.texts.push(fox::TextPrimitive {
                pose,
                billboard: true,
                font_size: TEXT_M,
                scale_invariant: false,
                color: Some(fox::Color {
                    a: 1.0,
                    ..solid.colour
                }),
                text: solid.label,
            });
        }
        Entry::foxglove(channel, Content::SceneUpdate, &update(entity))
    }

    pub(super) fn path(&mut self, shot: &Shot<'_>) -> Entry {
        let (mut entity, axes) = shot.entity();
        let points = shot.parts.records::<PathPoint>();
        let finite = |it: &&PathPoint| it.pose.translation_m.iter().all(|x| x.is_finite());
        let good: Vec<&PathPoint> = points.iter().filter(finite).collect();
        let n_bad = (points.len() - good.len()) as u64;
        self.bad
            .note(shot.parts.topic, n_bad, "a point of a path is not finite");
        let place = |it: &&PathPoint| {
            let at = axes * nalgebra::Point3::from(it.pose.translation_m);
            fox::Point3 {
                x: at.x,
                y: at.y,
                z: at.z,
            }
        };
        // From green over yellow to red; white where no speed is planned.
        let colour = |it: &&PathPoint| {
            let share = (it.speed_mps as f64 / FULL_SPEED_MPS).clamp(0.0, 1.0);
            let [r, g, b] = match it.speed_mps.is_finite() {
                true => [(2.0 * share).min(1.0), (2.0 - 2.0 * share).min(1.0), 0.1],
                false => [1.0; 3],
            };
            fox::Color { r, g, b, a: 1.0 }
        };
        if good.len() > 1 {
            entity.lines.push(fox::LinePrimitive {
                r#type: fox::line_primitive::Type::LineStrip as i32,
                pose: Some(fox_pose(&Pose::IDENTITY)),
                thickness: 0.2,
                points: good.iter().map(place).collect(),
                colors: good.iter().map(colour).collect(),
                ..Default::default()
            });
        }
        shot.entry(Content::SceneUpdate, &update(entity))
    }

    pub(super) fn poses(&mut self, shot: &Shot<'_>) -> Entry {
        let (frame_id, axes) = shot.axes();
        let poses = shot.parts.records::<PoseEstimate>();
        let good = poses.iter().filter(|it| is_pose(&it.pose));
        let axes = axes.isometry();
        let message = fox::PosesInFrame {
            timestamp: Some(timestamp(shot.sim_nanos)),
            frame_id,
            poses: good.map(|it| placed(&axes, &it.pose)).collect(),
        };
        let n_bad = (poses.len() - message.poses.len()) as u64;
        self.bad.note(shot.parts.topic, n_bad, BAD_POSE);
        shot.entry(Content::PosesInFrame, &message)
    }

    /// The first of a topic's odometry; a result has one.
    pub(super) fn odometry(&mut self, shot: &Shot<'_>) -> Option<Entry> {
        let (frame_id, axes) = shot.axes();
        let sample = *shot.parts.records::<Odometry>().first()?;
        if !is_pose(&sample.pose) {
            self.bad.note(shot.parts.topic, 1, BAD_POSE);
            return None;
        }
        let covariance = |matrix: [f64; 36]| match matrix.iter().any(|x| *x != 0.0) {
            true => matrix.to_vec(),
            false => Vec::new(),
        };
        let message = fox::Odometry {
            timestamp: Some(timestamp(shot.sim_nanos)),
            frame_id,
            body_frame_id: shot.parts.topic.to_owned(),
            pose: Some(placed(&axes.isometry(), &sample.pose)),
            linear_velocity: Some(vector(sample.velocity_mps)),
            angular_velocity: Some(vector(sample.angular_velocity_radps)),
            pose_covariance: covariance(sample.pose_covariance),
            velocity_covariance: covariance(sample.twist_covariance),
            ..Default::default()
        };
        Some(shot.entry(Content::Odometry, &message))
    }

    pub(super) fn points(
        &mut self,
        shot: &Shot<'_>,
        reuse: &mut dyn FnMut(usize) -> Vec<u8>,
    ) -> Option<Entry> {
        let (frame_id, axes) = shot.axes();
        let fields = shot.parts.fields();
        let has = |name: &str| fields.iter().any(|field| field.name == name);
        if !(has("x") && has("y") && has("z") && is_pose(&axes)) {
            let why = "its points have no fields x, y and z inside a point, or their space no pose";
            self.bad.note(shot.parts.topic, 1, why);
            return None;
        }
        let known = fields.into_iter().filter_map(|field| {
            Some(fox::PackedElementField {
                name: field.name,
                offset: field.offset as u32,
                r#type: numeric(field.element)? as i32,
            })
        });
        let head = fox::PointCloud {
            timestamp: Some(timestamp(shot.sim_nanos)),
            frame_id,
            pose: Some(fox_pose(&axes)),
            point_stride: shot.parts.header.element_bytes,
            fields: known.collect(),
            ..Default::default()
        };
        let mut bytes = encoded(&head, reuse(shot.parts.body.len() + 1024));
        put_bytes(&mut bytes, DATA_FIELD, shot.parts.body);
        Some(shot.raw(Content::PointCloud, bytes))
    }
}

impl Shot<'_> {
    /// An entity that takes the place of the topic's one before, and the pose of the result's space
    /// in its axes.
    fn entity(&self) -> (fox::SceneEntity, Isometry3<f64>) {
        let (frame_id, axes) = self.axes();
        let entity = fox::SceneEntity {
            timestamp: Some(timestamp(self.sim_nanos)),
            frame_id,
            id: self.parts.topic.to_owned(),
            ..Default::default()
        };
        let axes = if is_pose(&axes) { axes } else { Pose::IDENTITY };
        (entity, axes.isometry())
    }
}

fn update(entity: fox::SceneEntity) -> fox::SceneUpdate {
    fox::SceneUpdate {
        deletions: Vec::new(),
        entities: vec![entity],
    }
}

fn placed(axes: &Isometry3<f64>, pose: &Pose) -> fox::Pose {
    fox_pose(&Pose::from(axes * pose.isometry()))
}

fn fox_pose(pose: &Pose) -> fox::Pose {
    fox::Pose {
        position: Some(vector(pose.translation_m)),
        orientation: Some(quaternion(pose.rotation_xyzw)),
    }
}

/// Foxglove's type of an element; it has none for halves and whole numbers of 64 bits.
fn numeric(of: ElementType) -> Option<NumericType> {
    match of {
        ElementType::U8 | ElementType::Bool => Some(NumericType::Uint8),
        ElementType::I8 => Some(NumericType::Int8),
        ElementType::U16 => Some(NumericType::Uint16),
        ElementType::I16 => Some(NumericType::Int16),
        ElementType::U32 => Some(NumericType::Uint32),
        ElementType::I32 => Some(NumericType::Int32),
        ElementType::F32 => Some(NumericType::Float32),
        ElementType::F64 => Some(NumericType::Float64),
        ElementType::U64 | ElementType::I64 | ElementType::F16 => None,
    }
}
