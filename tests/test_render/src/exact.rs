//! Holds frames of a camera and of a lidar against the [`Oracle`](crate::oracle::Oracle), pixel by
//! pixel and beam by beam.

use nalgebra::{Isometry3, Point3, Vector3};
use schema_frames::{Modality, SemanticLidarPoint};
use sensor_camera::{CameraRenderer, View, ViewSpec};
use sensor_core::Scene;
use sensor_gpu::Gpu;
use sensor_spec::Intrinsics;

use crate::oracle::{Detail, Met, Oracle};
use crate::shot::shot;

/// What a camera saw in all [`Modality`]s but colour.
pub struct Frames {
    /// Lens.
    pub lens: Intrinsics,
    /// Metres along the optical axis.
    pub depth_m: Vec<f32>,
    /// Class numbers.
    pub class: Vec<u8>,
    /// Object ids.
    pub instance: Vec<u32>,
    /// Motion since the previous firing, pixels, x right, y down.
    pub flow_px: Vec<[f32; 2]>,
    /// Normals in world space.
    pub normals: Vec<Vector3<f64>>,
}

const LABELS: [Modality; 5] = [
    Modality::Depth,
    Modality::Semantic,
    Modality::Instance,
    Modality::Flow,
    Modality::Normals,
];

/// Fires a camera at two scenes, one after the other, and gives what it saw of the second.
pub fn two_firings(
    gpu: &Gpu,
    renderer: &mut CameraRenderer,
    lens: Intrinsics,
    scenes: [&Scene; 2],
    poses: [Isometry3<f64>; 2],
) -> Frames {
    let mut view = View::new(gpu, ViewSpec::pinhole(lens));
    let [_, bytes] = [0, 1].map(|at| shot(renderer, scenes[at], &mut view, poses[at], &LABELS));
    let [depth, class, instance, flow, normals] = bytes.try_into().expect("one per modality");
    let normals = normals
        .chunks_exact(8)
        .map(|p| Vector3::new(half(p), half(&p[2..]), half(&p[4..])));
    Frames {
        lens,
        depth_m: bytemuck::pod_collect_to_vec(&depth),
        class,
        instance: bytemuck::pod_collect_to_vec(&instance),
        flow_px: bytemuck::pod_collect_to_vec(&flow),
        normals: normals.collect(),
    }
}

fn half(bytes: &[u8]) -> f64 {
    f64::from(crate::sheet::half(bytes))
}

/// Largest errors, and the numbers of pixels that were compared.
#[derive(Clone, Debug, Default)]
pub struct Errors {
    /// Pixels that are not edges.
    pub n: usize,
    /// Edges: rays near the pixel's corners meet other surfaces than the one through its middle.
    pub n_edges: usize,
    /// Pixels on something that moves.
    pub n_moving: usize,
    /// Pixels whose flow is longer than a pixel.
    pub n_flowing: usize,
    /// Pixels with another id or class.
    pub n_labels_off: usize,
    /// Pixels whose depth is off by more than 1 mm + 1e-5 of it.
    pub n_depth_off: usize,
    /// Largest error of depth over what is allowed.
    pub worst_depth_ratio: f64,
    /// Largest error of flow, pixels.
    pub worst_flow_px: f64,
    /// Largest angle between normals, degrees.
    pub worst_normal_deg: f64,
    /// Descriptions of the first few that are off.
    pub examples: Vec<String>,
}

impl Errors {
    fn note(&mut self, text: impl FnOnce() -> String) {
        if self.examples.len() < 8 {
            self.examples.push(text());
        }
    }

    /// Whether all errors are within the tolerances.
    pub fn is_exact(&self) -> bool {
        self.n_labels_off == 0
            && self.n_depth_off * 1000 <= self.n
            && self.worst_flow_px <= 0.01
            && self.worst_normal_deg <= 0.5
    }
}

/// Direction through an image position in the sensor's space (x forward, y left, z up), 1 along the
/// optical axis.
fn ray(lens: &Intrinsics, x_px: f64, y_px: f64) -> Vector3<f64> {
    let [fx, fy, cx, cy] = lens.as_array();
    Vector3::new(1.0, -(x_px - cx) / fx, -(y_px - cy) / fy)
}

fn project(lens: &Intrinsics, point_in_sensor: Vector3<f64>) -> [f64; 2] {
    let [fx, fy, cx, cy] = lens.as_array();
    [
        cx - fx * point_in_sensor.y / point_in_sensor.x,
        cy - fy * point_in_sensor.z / point_in_sensor.x,
    ]
}

/// Near plane of every camera, metres.
const NEAR_M: f64 = 0.1;

/// What the pixel's middle shows, unless the pixel is an edge.
fn pixel<'o>(
    oracle: &'o Oracle,
    lens: &Intrinsics,
    pose: &Isometry3<f64>,
    at: [f64; 2],
) -> Option<Option<Met<'o>>> {
    let origin = Point3::from(pose.translation.vector);
    let cast = |dx: f64, dy: f64| {
        oracle.cast(
            origin,
            pose.rotation * ray(lens, at[0] + dx, at[1] + dy),
            NEAR_M,
            false,
        )
    };
    let middle = cast(0.0, 0.0);
    // Corners far from the middle and close to it, because lines can be much thinner than a pixel.
    let mut corners = [0.45, 0.02]
        .into_iter()
        .flat_map(|d| [(-d, -d), (d, -d), (-d, d), (d, d)]);
    let agrees = |(dx, dy): (f64, f64)| match (&middle, &cast(dx, dy)) {
        (Some(a), Some(b)) => a.is_beside(b),
        (a, b) => a.is_none() && b.is_none(),
    };
    corners.all(agrees).then_some(middle)
}

/// Compares what a camera saw at the second of two firings.
pub fn check_camera(frames: &Frames, scenes: [&Scene; 2], poses: [Isometry3<f64>; 2]) -> Errors {
    let [before, now] = scenes;
    let lens = &frames.lens;
    let eye = Point3::from(poses[1].translation.vector);
    let oracle = Oracle::of(now, Detail::SeenFrom(eye), eye, f64::INFINITY);
    let mut errors = Errors::default();
    for i in 0..frames.depth_m.len() {
        let (x, y) = (i as u32 % lens.width_px, i as u32 / lens.width_px);
        let at = [f64::from(x) + 0.5, f64::from(y) + 0.5];
        let Some(seen) = pixel(&oracle, lens, &poses[1], at) else {
            errors.n_edges += 1;
            continue;
        };
        errors.n += 1;
        let expected = seen.map_or((11, 0), |met| (met.triangle.class, met.triangle.object));
        if (frames.class[i], frames.instance[i]) != expected {
            errors.n_labels_off += 1;
            let found = (frames.class[i], frames.instance[i], frames.depth_m[i]);
            errors.note(|| {
                format!(
                    "({x}, {y}) shows class, id, depth {found:?} instead of {expected:?} at {:?}",
                    seen.map(|met| met.t)
                )
            });
            continue;
        }
        let then = match &seen {
            None => poses[0].rotation.inverse() * (poses[1].rotation * ray(lens, at[0], at[1])),
            Some(met) => {
                check_surface(frames, i, met, &mut errors);
                let point = poses[1] * Point3::from(ray(lens, at[0], at[1]) * met.t);
                errors.n_moving += met.triangle.dynamic.is_some() as usize;
                (poses[0].inverse() * place_before(before, now, met, point)).coords
            }
        };
        let limit_m = if seen.is_some() { NEAR_M } else { 0.0 };
        if then.x > limit_m {
            let then = project(lens, then);
            let [dx, dy] = frames.flow_px[i].map(f64::from);
            let error_px = (at[0] - then[0] - dx).hypot(at[1] - then[1] - dy);
            errors.n_flowing += (dx.hypot(dy) > 1.0) as usize;
            if error_px > 0.01 {
                errors.note(|| {
                    format!(
                        "flow at ({x}, {y}) is [{dx}, {dy}], off by {error_px} px, at {:?} m",
                        seen.map(|met| met.t)
                    )
                });
            }
            errors.worst_flow_px = errors.worst_flow_px.max(error_px);
        }
    }
    errors
}

fn check_surface(frames: &Frames, i: usize, met: &Met<'_>, errors: &mut Errors) {
    let at = [
        i as u32 % frames.lens.width_px,
        i as u32 / frames.lens.width_px,
    ];
    let error_m = (f64::from(frames.depth_m[i]) - met.t).abs();
    let allowed_m = 1e-3 + 1e-5 * met.t;
    if error_m > allowed_m {
        errors.n_depth_off += 1;
        let facing = met.triangle.face;
        errors.note(|| {
            format!(
                "depth at {at:?} is {} instead of {}, class {}, face {facing:?}",
                frames.depth_m[i], met.t, met.triangle.class
            )
        });
    }
    errors.worst_depth_ratio = errors.worst_depth_ratio.max(error_m / allowed_m);
    // Flat surfaces have their plane's normal, whatever is stored; rounded ones what lies between
    // the corners'.
    let normal = if met.is_flat() {
        met.triangle.face
    } else {
        met.normal()
    };
    let found = frames.normals[i];
    let angle_deg = found
        .cross(&normal)
        .norm()
        .atan2(found.dot(&normal))
        .to_degrees();
    if angle_deg > 0.5 {
        let class = met.triangle.class;
        errors.note(|| format!("normal at {at:?} is {found:?} instead of {normal:?}: {angle_deg}°, class {class}, flat {}", met.is_flat()));
    }
    errors.worst_normal_deg = errors.worst_normal_deg.max(angle_deg);
}

/// Where a point of the surface that was met lay in the scene `before`.
fn place_before(before: &Scene, now: &Scene, met: &Met<'_>, point: Point3<f64>) -> Point3<f64> {
    let Some(k) = met.triangle.dynamic else {
        return point;
    };
    let instance = &now.dynamics[k];
    match before
        .dynamics
        .iter()
        .find(|earlier| earlier.key() == instance.key())
    {
        Some(earlier) => {
            earlier.world_from_mesh * instance.world_from_mesh.inverse_transform_point(&point)
        }
        None => point,
    }
}

/// Result of comparing one turn of a lidar.
#[derive(Clone, Debug, Default)]
pub struct LidarErrors {
    /// Beams that meet no edge.
    pub n: usize,
    /// Beams of those that hit something.
    pub n_hits: usize,
    /// Beams with a hit where there is none, or none where there is one.
    pub n_wrong: usize,
    /// Hits on another id or class.
    pub n_labels_off: usize,
    /// Largest distance between hits, metres.
    pub worst_m: f64,
}

/// Compares a turn of a semantic lidar with `channels` evenly spaced from `upper_deg` down to
/// `lower_deg`, and `columns` of which the last looks straight back.
pub fn check_lidar(
    points: &[SemanticLidarPoint],
    spec: &sensor_spec::LidarSpec,
    scene: &Scene,
    world_from_sensor: &Isometry3<f64>,
) -> LidarErrors {
    let origin = Point3::from(world_from_sensor.translation.vector);
    let oracle = Oracle::of(scene, Detail::Finest, origin, spec.range_m + 1.0);
    let mut errors = LidarErrors::default();
    let step_rad = std::f64::consts::TAU / f64::from(spec.columns);
    let column_of = |point: &SemanticLidarPoint| {
        let azimuth =
            f64::from(point.hit_in_sensor_m[1]).atan2(f64::from(point.hit_in_sensor_m[0]));
        ((azimuth + std::f64::consts::PI) / step_rad).round() as u32
    };
    let n_columns = spec.columns;
    let mut grid = vec![None; (spec.channels * n_columns) as usize];
    for point in points {
        let column = (column_of(point) + n_columns - 1) % n_columns;
        grid[(u32::from(point.channel) * n_columns + column) as usize] = Some(point);
    }
    for channel in 0..spec.channels {
        let down = f64::from(channel) / f64::from(spec.channels - 1);
        let elevation =
            (spec.upper_fov_deg + (spec.lower_fov_deg - spec.upper_fov_deg) * down).to_radians();
        for column in 0..n_columns {
            let azimuth = -std::f64::consts::PI + step_rad * f64::from(column + 1);
            let cast = |da: f64, de: f64| {
                let (a, e) = (azimuth + da, elevation + de);
                let direction = Vector3::new(e.cos() * a.cos(), e.cos() * a.sin(), e.sin());
                oracle
                    .cast(origin, world_from_sensor.rotation * direction, 1e-9, true)
                    .filter(|met| met.t <= spec.range_m)
            };
            const AWAY_RAD: f64 = 2e-4;
            let middle = cast(0.0, 0.0);
            let agrees = |(da, de): (f64, f64)| match (&middle, &cast(da * AWAY_RAD, de * AWAY_RAD))
            {
                (Some(a), Some(b)) => a.is_beside(b),
                (a, b) => a.is_none() && b.is_none(),
            };
            if ![(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)]
                .into_iter()
                .all(agrees)
            {
                continue;
            }
            errors.n += 1;
            match (middle, grid[(channel * n_columns + column) as usize]) {
                (Some(met), Some(point)) => {
                    errors.n_hits += 1;
                    let direction = Vector3::new(
                        elevation.cos() * azimuth.cos(),
                        elevation.cos() * azimuth.sin(),
                        elevation.sin(),
                    );
                    let found = Vector3::from(point.hit_in_sensor_m).cast::<f64>();
                    errors.worst_m = errors.worst_m.max((found - direction * met.t).norm());
                    errors.n_labels_off += ((point.class, point.object_id)
                        != (met.triangle.class, met.triangle.object))
                        as usize;
                }
                (None, None) => {}
                _ => errors.n_wrong += 1,
            }
        }
    }
    errors
}
