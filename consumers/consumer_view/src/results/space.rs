//! Boxes, points, poses and paths in the world.

use consumer_forms::palette;
use consumer_kit::items::{Field, ResultParts, is_pose};
use nalgebra::Point3;
use rerun::{Quaternion, Rgba32};
use schema_frames::{Box3d, Odometry, PathPoint, PoseEstimate, ResultType, Space, Track};
use schema_types::Pose;

use super::canvas::{Canvas, class_id};
use super::state::{Results, Trail};
use crate::images;
use crate::layout::WORLD;
use crate::rerun;

/// Points of a trail, and the distance between them, metres.
const TRAIL_POINTS: usize = 1000;
const TRAIL_STEP_M: f64 = 0.2;
/// Speed that is shown in the last colour of a path, m/s.
const FULL_SPEED_MPS: f32 = 20.0;
/// Most points of a cloud; larger ones are thinned evenly.
const MAX_POINTS: usize = 60_000;
/// Most points of a path that are drawn.
const MAX_PATH: usize = 20_000;
/// Time whose way an arrow of a velocity shows, seconds.
const ARROW_SECS: f32 = 0.5;

/// Places of points and their colours.
type Cloud = (Vec<[f32; 3]>, Vec<[u8; 3]>);

/// A box as it is drawn.
struct Drawn {
    pose: Pose,
    half_m: [f32; 3],
    velocity_mps: [f32; 3],
    class: u32,
    label: String,
    colour: Rgba32,
}

impl Canvas<'_> {
    /// Entity in whose axes the result's numbers are, placed in the world.
    fn in_space(&self) -> anyhow::Result<String> {
        let topic = self.parts.topic;
        let world_path = format!("{WORLD}/results/{topic}");
        match (self.parts.header.space(), &self.rig) {
            (Some(Space::World), _) => Ok(world_path),
            (Some(Space::Vehicle), Some(rig)) => Ok(format!("{WORLD}/{rig}/results/{topic}")),
            _ => {
                let pose = &self.parts.header.world_from_space;
                if is_pose(pose) {
                    self.log(&world_path, &transform(pose))?;
                }
                Ok(world_path)
            }
        }
    }

    /// A pose of the result in the world; `None` where only the vehicle's axes are known.
    fn in_world(&self, pose: &Pose) -> Option<[f64; 3]> {
        let header = self.parts.header;
        match header.space() {
            Some(Space::World) => Some(pose.translation_m),
            Some(Space::Vehicle) if self.rig.is_some() => None,
            _ => {
                let place = header.world_from_space.isometry() * Point3::from(pose.translation_m);
                Some(place.coords.into())
            }
        }
    }
}

impl Results {
    pub(super) fn boxes3d(&mut self, canvas: &Canvas<'_>) -> anyhow::Result<()> {
        let parts = canvas.parts;
        let boxes = parts.records::<Box3d>();
        let drawn = boxes.iter().map(|it| Drawn {
            pose: it.pose,
            half_m: it.half_m,
            velocity_mps: it.velocity_mps,
            class: it.class,
            label: parts.label(it.class, it.score, it.id),
            colour: canvas.colour(it.class, it.id, false),
        });
        self.solids(canvas, drawn)
    }

    pub(super) fn tracks3d(
        &mut self,
        canvas: &Canvas<'_>,
        tracks: &[&Track],
    ) -> anyhow::Result<()> {
        let parts = canvas.parts;
        let drawn = tracks.iter().map(|it| Drawn {
            pose: it.pose,
            half_m: it.half_m,
            velocity_mps: it.velocity_mps,
            class: it.class,
            label: parts.label(it.class, it.score, it.id),
            colour: canvas.colour(it.class, it.id, true),
        });
        self.solids(canvas, drawn)
    }

    fn solids(
        &mut self,
        canvas: &Canvas<'_>,
        boxes: impl Iterator<Item = Drawn>,
    ) -> anyhow::Result<()> {
        let whole = |it: &Drawn| {
            is_pose(&it.pose)
                && it
                    .half_m
                    .iter()
                    .all(|half| half.is_finite() && *half >= 0.0)
        };
        let (good, bad): (Vec<Drawn>, Vec<Drawn>) = boxes.partition(whole);
        let why = "a box in space is not finite, has a negative side, or no unit quaternion";
        self.bad.note(canvas.parts.topic, bad.len() as u64, why);
        if good.is_empty() && !self.drawn.contains_key(canvas.parts.topic) {
            return Ok(());
        }
        let path = canvas.in_space()?;
        self.name_classes(canvas, &path)?;
        let centre = |it: &Drawn| vec3(it.pose.translation_m);
        let list = rerun::Boxes3D::from_centers_and_half_sizes(
            good.iter().map(centre),
            good.iter().map(|it| it.half_m),
        )
        .with_quaternions(good.iter().map(|it| quaternion(&it.pose)))
        .with_class_ids(good.iter().map(|it| class_id(it.class)))
        .with_colors(good.iter().map(|it| it.colour))
        .with_labels(good.iter().map(|it| it.label.as_str()));
        self.draw(canvas, &format!("{path}/boxes"), good.is_empty(), &list)?;
        let moves = |it: &&Drawn| {
            let is_finite = it.velocity_mps.iter().all(|v| v.is_finite());
            is_finite && it.velocity_mps.iter().any(|v| *v != 0.0)
        };
        let moving: Vec<&Drawn> = good.iter().filter(moves).collect();
        let vectors = moving
            .iter()
            .map(|it| it.velocity_mps.map(|v| v * ARROW_SECS));
        let arrows = rerun::Arrows3D::from_vectors(vectors)
            .with_origins(moving.iter().map(|it| centre(it)))
            .with_colors(moving.iter().map(|it| it.colour));
        self.draw(
            canvas,
            &format!("{path}/velocities"),
            moving.is_empty(),
            &arrows,
        )
    }

    pub(super) fn points(&mut self, canvas: &Canvas<'_>) -> anyhow::Result<()> {
        let parts = canvas.parts;
        let Some((positions, colours)) = cloud(parts) else {
            let why = "its points have no fields x, y and z inside a point";
            self.bad.note(parts.topic, 1, why);
            return Ok(());
        };
        let path = canvas.in_space()?;
        let list = rerun::Points3D::new(positions.iter().copied())
            .with_colors(
                colours
                    .into_iter()
                    .map(|[r, g, b]| Rgba32::from_rgb(r, g, b)),
            )
            .with_radii([0.05]);
        self.draw(
            canvas,
            &format!("{path}/points"),
            positions.is_empty(),
            &list,
        )
    }

    pub(super) fn poses(&mut self, canvas: &Canvas<'_>) -> anyhow::Result<()> {
        let parts = canvas.parts;
        let poses: Vec<Pose> = match parts.kind {
            ResultType::Odometry => parts
                .records::<Odometry>()
                .iter()
                .map(|it| it.pose)
                .collect(),
            _ => {
                let records = parts.records::<PoseEstimate>();
                records.iter().map(|it| it.pose).collect()
            }
        };
        let good: Vec<Pose> = poses.iter().copied().filter(is_pose).collect();
        let why = "a pose is not finite or has no unit quaternion";
        self.bad
            .note(parts.topic, (poses.len() - good.len()) as u64, why);
        let path = canvas.in_space()?;
        let forward =
            |pose: &Pose| vec3((pose.isometry().rotation * nalgebra::Vector3::x()).into());
        let arrows = rerun::Arrows3D::from_vectors(good.iter().map(forward))
            .with_origins(good.iter().map(|pose| vec3(pose.translation_m)));
        self.draw(
            canvas,
            &format!("{path}/headings"),
            good.is_empty(),
            &arrows,
        )?;
        let Some(first) = good.first() else {
            return Ok(());
        };
        let axes = format!("{path}/pose");
        if !self.trails.contains_key(parts.topic) {
            canvas
                .rec
                .log_static(axes.as_str(), &rerun::TransformAxes3D::new(1.5))?;
        }
        self.draw(canvas, &axes, false, &transform(first))?;
        self.extend_trail(canvas, first)
    }

    fn extend_trail(&mut self, canvas: &Canvas<'_>, pose: &Pose) -> anyhow::Result<()> {
        let parts = canvas.parts;
        let trail = self.trails.entry(parts.topic.to_owned()).or_default();
        if trail.writer_epoch != parts.header.writer_epoch {
            *trail = Trail {
                writer_epoch: parts.header.writer_epoch,
                points: Vec::new(),
            };
        }
        let Some(at) = canvas.in_world(pose) else {
            return Ok(());
        };
        let distance = |last: &[f64; 3]| (Point3::from(*last) - Point3::from(at)).norm();
        if trail
            .points
            .last()
            .is_some_and(|last| distance(last) < TRAIL_STEP_M)
        {
            return Ok(());
        }
        trail.points.push(at);
        if trail.points.len() > TRAIL_POINTS {
            trail.points.remove(0);
        }
        let strip = rerun::LineStrip3D::from_iter(trail.points.iter().map(|point| vec3(*point)));
        let line = rerun::LineStrips3D::new([strip])
            .with_colors([Rgba32::from_rgb(255, 220, 90)])
            .with_radii([0.05]);
        let path = format!("{WORLD}/trails/{}", parts.topic);
        self.draw(canvas, &path, false, &line)
    }

    pub(super) fn path(&mut self, canvas: &Canvas<'_>) -> anyhow::Result<()> {
        let parts = canvas.parts;
        let points = parts.records::<PathPoint>();
        let finite = |it: &&PathPoint| it.pose.translation_m.iter().all(|x| x.is_finite());
        let good: Vec<&PathPoint> = points.iter().filter(finite).take(MAX_PATH).collect();
        let n_bad = points.iter().filter(|it| !finite(it)).count() as u64;
        self.bad
            .note(parts.topic, n_bad, "a point of a path is not finite");
        let path = canvas.in_space()?;
        let strips = good.windows(2).map(|pair| {
            rerun::LineStrip3D::from_iter(pair.iter().map(|it| vec3(it.pose.translation_m)))
        });
        let colours = good.windows(2).map(|pair| speed_colour(pair[1].speed_mps));
        let lines = rerun::LineStrips3D::new(strips)
            .with_colors(colours)
            .with_radii([0.1]);
        self.draw(canvas, &format!("{path}/path"), good.len() < 2, &lines)
    }
}

/// White if the speed is not planned.
fn speed_colour(speed_mps: f32) -> Rgba32 {
    let [r, g, b] = match speed_mps.is_finite() {
        true => images::turbo(speed_mps / FULL_SPEED_MPS),
        false => [255; 3],
    };
    Rgba32::from_rgb(r, g, b)
}

/// Places and colours of points, thinned: by their red, green and blue, else by class, else by
/// intensity, else by height. `None` without fields for the place.
fn cloud(parts: &ResultParts<'_>) -> Option<Cloud> {
    let fields = parts.fields();
    let named = |name: &str| fields.iter().find(|field| field.name == name);
    let place = [named("x")?, named("y")?, named("z")?];
    let rgb = [
        named("r").or(named("red")),
        named("g").or(named("green")),
        named("b").or(named("blue")),
    ];
    let class = named("class").or(named("label"));
    let intensity = named("intensity").or(named("reflectivity"));
    let point_bytes = parts.header.element_bytes.max(1) as usize;
    let n_points = parts.body.len() / point_bytes;
    let points = || {
        let step = n_points.div_ceil(MAX_POINTS).max(1);
        parts.body.chunks_exact(point_bytes).step_by(step)
    };
    let largest = |field: &Field| {
        let values = points()
            .map(|point| field.of(point))
            .filter(|x| x.is_finite());
        values.fold(f64::MIN_POSITIVE, f64::max)
    };
    let full = intensity.map(largest);
    let colour = |point: &[u8], z_m: f32| match (rgb, class, intensity, full) {
        ([Some(r), Some(g), Some(b)], ..) => [r, g, b].map(|field| field.of(point) as u8),
        (_, Some(class), ..) => {
            let number = class.of(point).max(0.0) as u32;
            palette::class(number)
        }
        (_, _, Some(field), Some(full)) => images::turbo((field.of(point) / full) as f32),
        _ => images::height_colour(z_m),
    };
    let shown = points().map(|point| {
        let at = place.map(|field| field.of(point) as f32);
        (at, colour(point, at[2]))
    });
    let finite = |(at, _): &([f32; 3], [u8; 3])| at.iter().all(|x| x.is_finite());
    Some(shown.filter(finite).unzip())
}

fn vec3(v: [f64; 3]) -> [f32; 3] {
    v.map(|x| x as f32)
}

fn quaternion(pose: &Pose) -> Quaternion {
    Quaternion::from_xyzw(pose.rotation_xyzw.map(|x| x as f32))
}

fn transform(pose: &Pose) -> rerun::Transform3D {
    rerun::Transform3D::from_translation_rotation(vec3(pose.translation_m), quaternion(pose))
}
