//! Depth, class, instance, normals and flow against a slow ray caster that shares no code with the
//! renderer.

use crate::common;
use crate::lists::Lists;

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use schema_frames::Modality;
use sensor_camera::{CameraRenderer, Quality, Rasteriser};
use sensor_core::Scene;
use sensor_spec::Intrinsics;

const SIZE_PX: [u32; 2] = [160, 120];
const ALL: [Modality; 6] = [
    Modality::Rgb,
    Modality::Depth,
    Modality::Semantic,
    Modality::Instance,
    Modality::Flow,
    Modality::Normals,
];

/// What one ray sees.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Seen {
    depth_m: f64,
    class: u8,
    object: u32,
    normal: Vector3<f64>,
    /// Index into `dynamics`, if it moves.
    dynamic: Option<usize>,
}

/// Triangles in the world, corner by corner in f64.
struct Soup(Vec<([Point3<f64>; 3], Seen)>);

impl Soup {
    fn of(scene: &Scene) -> Soup {
        let mut triangles = Vec::new();
        let mut add =
            |mesh: &sensor_core::Mesh, pose: &Isometry3<f64>, id: u32, dynamic: Option<usize>| {
                for (corners, vertex) in mesh.triangles() {
                    let corners = corners.map(|c| pose * Point3::from(c.map(f64::from)));
                    let object = if vertex.object_id == 0 {
                        id
                    } else {
                        vertex.object_id
                    };
                    let normal = (corners[1] - corners[0])
                        .cross(&(corners[2] - corners[0]))
                        .normalize();
                    triangles.push((
                        corners,
                        Seen {
                            depth_m: 0.0,
                            class: vertex.class,
                            object,
                            normal,
                            dynamic,
                        },
                    ));
                }
            };
        for instance in &scene.assets.statics {
            add(
                scene.assets.mesh(instance.mesh),
                &instance.world_from_mesh,
                instance.object.0,
                None,
            );
        }
        for (i, instance) in scene.dynamics.iter().enumerate() {
            add(
                scene.assets.mesh(instance.mesh),
                &instance.world_from_mesh,
                instance.actor.0,
                Some(i),
            );
        }
        Soup(triangles)
    }

    /// Nearest front face along `origin + t · direction` with t ≥ 0.1 (direction has length 1 along
    /// the optical axis, so t is the depth).
    fn cast(&self, origin: Point3<f64>, direction: Vector3<f64>) -> Option<Seen> {
        let mut nearest: Option<Seen> = None;
        for (corners, seen) in &self.0 {
            if seen.normal.dot(&direction) >= 0.0 {
                continue;
            }
            // Cramer: origin + t d = a + u ab + v ac.
            let m = Matrix3::from_columns(&[
                -direction,
                corners[1] - corners[0],
                corners[2] - corners[0],
            ]);
            let Some(inverse) = m.try_inverse() else {
                continue;
            };
            let tuv = inverse * (origin - corners[0]);
            let inside = tuv.y >= 0.0 && tuv.z >= 0.0 && tuv.y + tuv.z <= 1.0;
            if inside && tuv.x >= 0.1 && nearest.is_none_or(|best| tuv.x < best.depth_m) {
                nearest = Some(Seen {
                    depth_m: tuv.x,
                    ..*seen
                });
            }
        }
        nearest
    }
}

/// Direction through an image position, in the sensor's space (x forward, y left, z up), 1 along
/// the optical axis.
fn ray(lens: &Intrinsics, x_px: f64, y_px: f64) -> Vector3<f64> {
    let [fx, fy, cx, cy] = lens.as_array();
    Vector3::new(1.0, -(x_px - cx) / fx, -(y_px - cy) / fy)
}

fn project(lens: &Intrinsics, point_in_sensor: Point3<f64>) -> [f64; 2] {
    let [fx, fy, cx, cy] = lens.as_array();
    [
        cx - fx * point_in_sensor.y / point_in_sensor.x,
        cy - fy * point_in_sensor.z / point_in_sensor.x,
    ]
}

/// Casts rays through the middle of each pixel and near its corners. A pixel whose rays see
/// different surfaces is an edge: `None`.
fn cast_all(
    scene: &Scene,
    lens: &Intrinsics,
    world_from_sensor: &Isometry3<f64>,
) -> Vec<Option<Option<Seen>>> {
    let soup = Soup::of(scene);
    let origin = Point3::from(world_from_sensor.translation.vector);
    let cast = |x: f64, y: f64| soup.cast(origin, world_from_sensor.rotation * ray(lens, x, y));
    let label = |seen: &Option<Seen>| {
        seen.map(|s| {
            (
                s.class,
                s.object,
                s.normal.map(|x| (x * 1e3).round() as i64),
            )
        })
    };
    let pixel = |i: u32| {
        let (x, y) = (
            (i % lens.width_px) as f64 + 0.5,
            (i / lens.width_px) as f64 + 0.5,
        );
        let centre = cast(x, y);
        let corners = [(-0.45, -0.45), (0.45, -0.45), (-0.45, 0.45), (0.45, 0.45)];
        corners
            .iter()
            .all(|(dx, dy)| label(&cast(x + dx, y + dy)) == label(&centre))
            .then_some(centre)
    };
    (0..lens.width_px * lens.height_px).map(pixel).collect()
}

fn half_to_f64(bits: u16) -> f64 {
    let (sign, exponent, mantissa) = (bits >> 15, (bits >> 10) & 31, bits & 1023);
    let magnitude = if exponent == 0 {
        mantissa as f64 * 2f64.powi(-24)
    } else {
        (1.0 + mantissa as f64 / 1024.0) * 2f64.powi(exponent as i32 - 15)
    };
    if sign == 1 { -magnitude } else { magnitude }
}

/// Two firings of a moving camera before moving cars; `origin` moves the whole world away from 0.
fn two_firings(origin: Vector3<f64>) -> (Scene, Scene, [Isometry3<f64>; 2]) {
    let (assets, car) = common::street();
    let mut assets = (*assets).clone();
    for instance in &mut assets.statics {
        instance.world_from_mesh.translation.vector += origin;
    }
    let assets = std::sync::Arc::new(assets);
    let at = |mut pose: Isometry3<f64>| {
        pose.translation.vector += origin;
        pose
    };
    let cars = |x: f64, yaw: f64| {
        vec![
            common::moving(
                11,
                car,
                at(common::pose(9.0 + x, -2.2, 0.0, [0.0, 0.0, yaw])),
            ),
            common::moving(
                12,
                car,
                at(common::pose(14.0 - x, 2.4, 0.0, [0.0, 0.0, 180.0])),
            ),
        ]
    };
    let before = common::scene(&assets, cars(0.0, 0.0), 50_000_000);
    let now = common::scene(&assets, cars(0.6, 4.0), 100_000_000);
    (
        before,
        now,
        [
            at(common::pose(0.0, -1.0, 1.5, [0.0, 2.0, 0.0])),
            at(common::pose(0.5, -0.9, 1.52, [1.0, 2.5, 1.5])),
        ],
    )
}

/// Images of the second of two firings.
struct Images {
    depth: Vec<f32>,
    class: Vec<u8>,
    instance: Vec<u32>,
    flow: Vec<f32>,
    normals: Vec<f64>,
}

fn images_of_renderer(origin: Vector3<f64>, rasteriser: Rasteriser) -> Images {
    let gpu = common::gpu();
    let mut renderer = CameraRenderer::with_rasteriser(&gpu, Quality::Low, rasteriser);
    let mut view = common::view(&gpu, SIZE_PX[0], SIZE_PX[1]);
    assert_eq!(view.intrinsics(), lens());
    let (before, now, poses) = two_firings(origin);
    common::render(&mut renderer, &before, &mut view, poses[0], &[]);
    let frames = common::render(&mut renderer, &now, &mut view, poses[1], &ALL);
    assert!(!frames[&Modality::Flow].1.first);
    Images {
        depth: common::floats(&frames[&Modality::Depth].0),
        class: frames[&Modality::Semantic].0.clone(),
        instance: common::words(&frames[&Modality::Instance].0),
        flow: common::floats(&frames[&Modality::Flow].0),
        normals: frames[&Modality::Normals]
            .0
            .chunks_exact(2)
            .map(|b| half_to_f64(u16::from_le_bytes([b[0], b[1]])))
            .collect(),
    }
}

/// The same by tiles on the processor, from lists that leave nothing out.
fn images_of_tiles(origin: Vector3<f64>) -> Images {
    let (before, now, poses) = two_firings(origin);
    let images = Lists::of([&before, &now], &poses, &lens()).exact_images();
    let normals = images.normal.iter();
    Images {
        depth: images.depth_m,
        class: images.class_code,
        instance: images.instance,
        flow: images.flow_px.into_flattened(),
        normals: normals
            .flat_map(|[x, y, z]| [*x, *y, *z, 0.0].map(f64::from))
            .collect(),
    }
}

fn lens() -> Intrinsics {
    Intrinsics::from_fov(SIZE_PX[0], SIZE_PX[1], 90f64.to_radians())
}

fn check_against_rays(origin: Vector3<f64>, images: Images) {
    let lens = lens();
    let (before, now, poses) = two_firings(origin);
    let Images {
        depth,
        class,
        instance,
        flow,
        normals,
    } = images;

    let rays = cast_all(&now, &lens, &poses[1]);
    let inner: Vec<(usize, Option<Seen>)> = rays
        .iter()
        .enumerate()
        .filter_map(|(i, ray)| ray.map(|seen| (i, seen)))
        .collect();
    assert!(
        inner.len() * 10 > rays.len() * 6,
        "only {} of {} pixels are not edges",
        inner.len(),
        rays.len()
    );
    let (mut n_hits, mut n_deep, mut n_cars, mut n_moved, mut worst_flow, mut worst_depth) =
        (0, 0, 0, 0, 0f64, 0f64);
    for (i, seen) in inner {
        let (x, y) = (i as u32 % lens.width_px, i as u32 / lens.width_px);
        let at = [x as f64 + 0.5, y as f64 + 0.5];
        let Some(seen) = seen else {
            assert_eq!(
                (depth[i], class[i], instance[i]),
                (f32::INFINITY, 11, 0),
                "sky at {x} {y}"
            );
            let then = poses[0].rotation.inverse() * (poses[1].rotation * ray(&lens, at[0], at[1]));
            let then = project(&lens, Point3::from(then));
            let error = (at[0] - then[0] - flow[2 * i] as f64)
                .hypot(at[1] - then[1] - flow[2 * i + 1] as f64);
            assert!(
                error < 0.01,
                "flow of the sky at {x} {y} is off by {error} px"
            );
            continue;
        };
        assert_eq!(
            (class[i], instance[i]),
            (seen.class, seen.object),
            "at {x} {y}"
        );
        n_hits += 1;
        let error_m = (depth[i] as f64 - seen.depth_m).abs();
        worst_depth = worst_depth.max(error_m / seen.depth_m);
        n_deep += (error_m > 1e-3 + 1e-5 * seen.depth_m) as u32;
        if seen.class == 2 || seen.class == 14 || seen.class == 3 {
            let normal = Vector3::new(normals[4 * i], normals[4 * i + 1], normals[4 * i + 2]);
            assert!(
                (normal - seen.normal).norm() < 0.01,
                "normal at {x} {y}: {normal} instead of {}",
                seen.normal
            );
        }
        let point = poses[1] * Point3::from(ray(&lens, at[0], at[1]) * seen.depth_m);
        let point_before = match seen.dynamic {
            Some(k) => {
                before.dynamics[k].world_from_mesh
                    * now.dynamics[k].world_from_mesh.inverse()
                    * point
            }
            None => point,
        };
        n_cars += seen.dynamic.is_some() as u32;
        let in_sensor = poses[0].inverse() * point_before;
        if in_sensor.x > 0.1 {
            let then = project(&lens, in_sensor);
            let error = (at[0] - then[0] - flow[2 * i] as f64)
                .hypot(at[1] - then[1] - flow[2 * i + 1] as f64);
            worst_flow = worst_flow.max(error);
            n_moved += (flow[2 * i].hypot(flow[2 * i + 1]) > 1.0) as u32;
        }
    }
    println!(
        "{n_hits} hits, {n_cars} of them on cars, {n_moved} moved by over a pixel; worst depth {worst_depth:.2e} relative, worst flow {worst_flow:.4} px"
    );
    assert!(
        n_deep * 1000 <= n_hits,
        "{n_deep} of {n_hits} depths are off"
    );
    assert!(worst_flow < 0.01, "flow is off by {worst_flow} px");
    assert!(n_cars > 100 && n_moved > 1000);
}

#[test]
fn every_modality_agrees_with_a_ray_caster() {
    let origin = Vector3::zeros();
    for rasteriser in common::rasterisers(&common::gpu()) {
        check_against_rays(origin, images_of_renderer(origin, rasteriser));
    }
    check_against_rays(origin, images_of_tiles(origin));
}

#[test]
fn ten_kilometres_from_the_origin_is_as_sharp_as_at_it() {
    let origin = Vector3::new(10_000.0, -7_000.0, 120.0);
    for rasteriser in common::rasterisers(&common::gpu()) {
        check_against_rays(origin, images_of_renderer(origin, rasteriser));
    }
    check_against_rays(origin, images_of_tiles(origin));
}

/// The computed rasteriser of the adapter is the other description of the same rules.
#[test]
fn tiles_on_the_processor_give_the_images_of_the_adapter() {
    let origin = Vector3::new(50.0, 20.0, -3.0);
    let (found, expected) = (
        images_of_tiles(origin),
        images_of_renderer(origin, Rasteriser::Computed),
    );
    let n_pixels = found.depth.len();
    let near = |a: f64, b: f64, bound: f64| a == b || (a - b).abs() <= bound;
    let (mut n_seen, mut n_different) = (0, 0);
    for i in 0..n_pixels {
        let depth_m = expected.depth[i] as f64;
        let pair = |of: &dyn Fn(&Images) -> f64| (of(&found), of(&expected));
        let is_near = |of: &dyn Fn(&Images) -> f64, bound: f64| {
            let (a, b) = pair(of);
            near(a, b, bound)
        };
        let is_same = found.class[i] == expected.class[i]
            && found.instance[i] == expected.instance[i]
            && is_near(&|images| images.depth[i] as f64, 1e-5 * depth_m)
            && (0..2).all(|k| is_near(&|images| images.flow[2 * i + k] as f64, 1e-2))
            // The adapter keeps them in 16 bits.
            && (0..3).all(|k| is_near(&|images| images.normals[4 * i + k], 1e-3));
        n_different += usize::from(!is_same);
        n_seen += usize::from(depth_m.is_finite());
    }
    // Matrices are rounded in another order, which may move an edge over a pixel's centre.
    assert!(
        n_different * 2000 <= n_pixels,
        "{n_different} of {n_pixels} pixels differ"
    );
    assert!(n_seen * 2 > n_pixels, "only {n_seen} pixels show anything");
}

#[test]
fn first_firing_has_no_flow_and_says_so() {
    let gpu = common::gpu();
    let mut renderer = CameraRenderer::new(&gpu, Quality::Low);
    let mut view = common::view(&gpu, 64, 48);
    let (before, now, poses) = two_firings(Vector3::zeros());
    let frames = common::render(
        &mut renderer,
        &before,
        &mut view,
        poses[0],
        &[Modality::Flow],
    );
    assert!(
        frames[&Modality::Flow].1.first && frames[&Modality::Flow].0.iter().all(|byte| *byte == 0)
    );
    let frames = common::render(&mut renderer, &now, &mut view, poses[1], &[Modality::Flow]);
    assert!(
        !frames[&Modality::Flow].1.first
            && common::floats(&frames[&Modality::Flow].0)
                .iter()
                .any(|f| f.abs() > 1.0)
    );
    assert_eq!(frames[&Modality::Flow].1.window_nanos, 50_000_000);
}

#[test]
fn flow_of_a_scene_at_rest_is_exactly_zero() {
    let gpu = common::gpu();
    let mut renderer = CameraRenderer::new(&gpu, Quality::Low);
    let mut view = common::view(&gpu, 64, 48);
    let (scene, _, poses) = two_firings(Vector3::zeros());
    common::render(&mut renderer, &scene, &mut view, poses[0], &[]);
    let frames = common::render(
        &mut renderer,
        &scene,
        &mut view,
        poses[0],
        &[Modality::Flow],
    );
    assert!(frames[&Modality::Flow].0.iter().all(|byte| *byte == 0));
}
