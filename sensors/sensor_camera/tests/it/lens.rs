//! A lens that bends: every image of a camera shows what the formula of the lens says, so labels,
//! depth, flow and colour fit each other.
//!
//! The oracle casts a ray per pixel at a plane: bend by the documented formula, focal length,
//! rotation. For flow it finds where the point was by bisection.

use crate::common;

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};
use schema_frames::Modality;
use schema_types::Class;
use sensor_camera::{CameraRenderer, Quality, View, ViewSpec};
use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder, Scene, SceneAssets};
use sensor_spec::{Intrinsics, OpticsSpec};

const WIDTH: u32 = 160;
const HEIGHT: u32 = 120;
/// Where kerb and road meet, world y.
const BORDER_M: f64 = 0.7;

fn scene() -> Scene {
    let mut builder = MeshBuilder::new("street");
    let mut half = |class, rgb: [u8; 3], y0: f32, y1: f32| {
        let corners = [
            [-300.0, y0, 0.0],
            [300.0, y0, 0.0],
            [300.0, y1, 0.0],
            [-300.0, y1, 0.0],
        ];
        builder.quad(
            Surface::new(class, Material::CarPaint, rgb),
            corners,
            [[0.0; 2]; 4],
        );
    };
    half(Class::SIDEWALKS, [230, 30, 30], BORDER_M as f32, 300.0);
    half(Class::ROADS, [30, 30, 230], -300.0, BORDER_M as f32);
    let mut assets = SceneAssets {
        episode: 1,
        ..Default::default()
    };
    let mesh = assets.add_mesh(builder.finish());
    assets
        .statics
        .push(common::fixed(mesh, Isometry3::identity()));
    common::scene(&Arc::new(assets), vec![], 50_000_000)
}

/// The lens in the oracle's own words.
struct Lens {
    k: f64,
    k_cubed: f64,
    size: [f64; 2],
}

impl Lens {
    fn bend(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let r = ((x * self.size[0]).powi(2) + (y * self.size[1]).powi(2)).sqrt();
        let factor = 1.0 + self.k * r.powi(2) + self.k_cubed * r.powi(3);
        [x * factor, y * factor]
    }

    /// Bisection along the ray from the middle.
    fn unbend(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (mut low, mut high) = (0.0, 4.0);
        for _ in 0..60 {
            let share = 0.5 * (low + high);
            let [bx, by] = self.bend([x * share, y * share]);
            match bx.hypot(by) < x.hypot(y) {
                true => low = share,
                false => high = share,
            }
        }
        [x * low, y * low]
    }

    fn optics(&self) -> OpticsSpec {
        OpticsSpec {
            distortion_k: self.k as f32,
            distortion_k_cubed: self.k_cubed as f32,
            distortion_size: self.size.map(|s| s as f32),
            ..Default::default()
        }
    }
}

/// Point of the ground that a place of the picture shows, and its depth.
fn ground_at(
    lens: &Lens,
    pose: &Isometry3<f64>,
    focal_px: f64,
    at_px: [f64; 2],
) -> Option<(Point3<f64>, f64)> {
    let p = [
        at_px[0] / WIDTH as f64 - 0.5,
        at_px[1] / HEIGHT as f64 - 0.5,
    ];
    let q = lens.bend(p);
    let ray = Vector3::new(
        1.0,
        -q[0] * WIDTH as f64 / focal_px,
        -q[1] * HEIGHT as f64 / focal_px,
    );
    let towards = pose.rotation * ray;
    let depth_m = -pose.translation.vector.z / towards.z;
    (depth_m > 0.0 && depth_m < 100.0).then(|| {
        (
            Point3::from(pose.translation.vector + towards * depth_m),
            depth_m,
        )
    })
}

/// Where the picture shows a point, pixels.
fn pixel_of(lens: &Lens, pose: &Isometry3<f64>, focal_px: f64, point: &Point3<f64>) -> [f64; 2] {
    let at = pose.inverse_transform_point(point);
    let q = [
        -at.y / at.x * focal_px / WIDTH as f64,
        -at.z / at.x * focal_px / HEIGHT as f64,
    ];
    let p = lens.unbend(q);
    [(p[0] + 0.5) * WIDTH as f64, (p[1] + 0.5) * HEIGHT as f64]
}

fn check(lens: &Lens, quality: Quality) {
    let gpu = common::gpu();
    let scene = scene();
    let intrinsics = Intrinsics::from_fov(WIDTH, HEIGHT, 80f64.to_radians());
    let focal_px = intrinsics.focal_px;
    let modalities = [
        Modality::Rgb,
        Modality::Depth,
        Modality::Semantic,
        Modality::Instance,
        Modality::Flow,
        Modality::Normals,
    ];
    for rasteriser in common::rasterisers(&gpu) {
        let mut renderer = CameraRenderer::with_rasteriser(&gpu, quality, rasteriser);
        let mut view = View::new(
            &gpu,
            ViewSpec {
                optics: lens.optics(),
                ..ViewSpec::pinhole(intrinsics)
            },
        );
        let before = common::pose(-0.25, 0.02, 3.0, [0.0, 24.0, 1.0]);
        let now = common::pose(0.0, 0.0, 3.0, [0.0, 25.0, 0.0]);
        common::render(&mut renderer, &scene, &mut view, before, &modalities);
        let mut later = scene.clone();
        later.sim_time.0 += 50_000_000;
        let images = common::render(&mut renderer, &later, &mut view, now, &modalities);
        let depth = common::floats(&images[&Modality::Depth].0);
        let flow = common::floats(&images[&Modality::Flow].0);
        let (classes, colors) = (&images[&Modality::Semantic].0, &images[&Modality::Rgb].0);
        let (mut n_checked, mut worst_flow) = (0, 0f64);
        for (x, y) in (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y))) {
            let i = (y * WIDTH + x) as usize;
            let middle = [x as f64 + 0.5, y as f64 + 0.5];
            // The picture has the pinhole's pixel that holds the place: up to a pixel of it away,
            // which is up to 1.3 of the picture's where this lens is narrowest.
            let around = [[-1.3, 0.0], [1.3, 0.0], [0.0, -1.3], [0.0, 1.3]]
                .map(|d| ground_at(lens, &now, focal_px, [middle[0] + d[0], middle[1] + d[1]]));
            let (Some((point, _)), true) = (
                ground_at(lens, &now, focal_px, middle),
                around.iter().all(Option::is_some),
            ) else {
                continue;
            };
            let around = around.map(|found| found.expect("it was checked"));
            n_checked += 1;
            let near = around.iter().map(|(_, d)| *d).fold(f64::MAX, f64::min);
            let far = around.iter().map(|(_, d)| *d).fold(0.0, f64::max);
            let seen_m = depth[i] as f64;
            assert!(
                (near..=far).contains(&seen_m),
                "{quality:?} {rasteriser:?} depth at {x} {y}: {seen_m}, not {near} to {far}"
            );
            if around.iter().all(|(p, _)| p.y > BORDER_M)
                || around.iter().all(|(p, _)| p.y < BORDER_M)
            {
                let (class, is_red) = (classes[i], colors[4 * i + 2] > colors[4 * i]);
                let expected = point.y > BORDER_M;
                let wanted = if expected {
                    Class::SIDEWALKS
                } else {
                    Class::ROADS
                };
                assert_eq!(class, wanted.0, "class at {x} {y}");
                assert_eq!(is_red, expected, "colour at {x} {y}");
            }
            let then = pixel_of(lens, &before, focal_px, &point);
            let wanted = [middle[0] - then[0], middle[1] - then[1]];
            let error = (flow[2 * i] as f64 - wanted[0]).hypot(flow[2 * i + 1] as f64 - wanted[1]);
            worst_flow = worst_flow.max(error / (1.0 + wanted[0].hypot(wanted[1])));
        }
        assert!(n_checked > (WIDTH * HEIGHT / 2) as usize, "{n_checked}");
        assert!(
            worst_flow < 0.06,
            "{quality:?} {rasteriser:?} flow: {worst_flow}"
        );
    }
}

/// A barrel lens shows more than a pinhole of its size would: its rim is drawn, not repeated.
#[test]
fn a_barrel_lens_bends_every_image_alike() {
    let lens = Lens {
        k: 0.35,
        k_cubed: 0.1,
        size: [1.0, 1.0],
    };
    check(&lens, Quality::Low);
    check(&lens, Quality::High);
}

#[test]
fn a_pincushion_lens_bends_every_image_alike() {
    let lens = Lens {
        k: -0.5,
        k_cubed: 0.05,
        size: [1.0, 0.8],
    };
    check(&lens, Quality::Low);
}

/// Goal: an event camera behind the lens sees nothing at rest and events inside its own picture
/// when it moves, on the CPU as on the GPU.
#[test]
fn events_come_from_the_bent_picture() {
    let gpu = common::gpu();
    let scene = scene();
    let optics = Lens {
        k: 0.35,
        k_cubed: 0.0,
        size: [1.0, 1.0],
    }
    .optics();
    let mut renderer = CameraRenderer::new(&gpu, Quality::Low);
    let intrinsics = Intrinsics::from_fov(WIDTH, HEIGHT, 80f64.to_radians());
    let mut view = View::new(
        &gpu,
        ViewSpec {
            optics,
            ..ViewSpec::pinhole(intrinsics)
        },
    );
    let mut shoot = |y_m: f64, step: u64| {
        let mut scene = scene.clone();
        scene.sim_time.0 += step * 50_000_000;
        let pose = common::pose(0.0, y_m, 3.0, [0.0, 25.0, 0.0]);
        common::render(&mut renderer, &scene, &mut view, pose, &[Modality::Dvs])[&Modality::Dvs]
            .0
            .len()
    };
    assert_eq!((shoot(0.0, 0), shoot(0.0, 1)), (0, 0));
    assert!(shoot(0.1, 2) > 0, "the border moved and nobody saw it");
}
