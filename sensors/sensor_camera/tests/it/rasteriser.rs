//! The computed rasteriser: no gaps or overlaps at common edges, near and huge triangles, and the
//! same image as the adapter draws.

use crate::common;

use std::sync::Arc;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use schema_frames::Modality;
use schema_types::Class;
use sensor_camera::{CameraRenderer, Quality, Rasteriser};
use sensor_core::mesh::Surface;
use sensor_core::{Material, Mesh, MeshBuilder, SceneAssets};

fn grey() -> Surface {
    Surface::new(Class::BUILDINGS, Material::Matte, [128; 3])
}

fn assets(mesh: Mesh) -> Arc<SceneAssets> {
    let mut assets = SceneAssets {
        episode: 1,
        ..Default::default()
    };
    let mesh = assets.add_mesh(mesh);
    assets
        .statics
        .push(common::fixed(mesh, Isometry3::identity()));
    Arc::new(assets)
}

/// A bumpy shell about the origin that shows its inside; `n` rings.
fn shell(n: usize, seed: u64) -> Mesh {
    let mut rng = fastrand::Rng::with_seed(seed);
    let sectors = 2 * n;
    let mut radii = vec![vec![0.0f32; sectors]; n + 1];
    radii
        .iter_mut()
        .flatten()
        .for_each(|radius| *radius = 2.0 + 20.0 * rng.f32());
    let (top, bottom) = (radii[0][0], radii[n][0]);
    radii[0].fill(top);
    radii[n].fill(bottom);
    let at = |ring: usize, sector: usize| {
        let (theta, phi) = (
            ring as f32 / n as f32 * std::f32::consts::PI,
            (sector % sectors) as f32 / sectors as f32 * std::f32::consts::TAU,
        );
        // The poles' corners must agree to the bit.
        let across = if ring == 0 || ring == n {
            0.0
        } else {
            theta.sin()
        };
        let radius = radii[ring][sector % sectors];
        [
            across * phi.cos() * radius,
            across * phi.sin() * radius,
            theta.cos() * radius,
        ]
    };
    let mut builder = MeshBuilder::new("shell");
    for ring in 0..n {
        for sector in 0..sectors {
            let [a, b, c, d] = [
                at(ring, sector),
                at(ring + 1, sector),
                at(ring + 1, sector + 1),
                at(ring, sector + 1),
            ];
            // Reversed: the inside is the front.
            for triangle in [[a, c, b], [a, d, c]] {
                if triangle[0] != triangle[1]
                    && triangle[1] != triangle[2]
                    && triangle[2] != triangle[0]
                {
                    builder.polygon_with_normals(
                        grey(),
                        &triangle,
                        &[[0.0, 0.0, 1.0]; 3],
                        &[[0.0; 2]; 3],
                    );
                }
            }
        }
    }
    builder.finish()
}

/// Oracle: from inside a closed shell no sky is visible, wherever its triangles lie relative to
/// pixels, near plane and image.
#[test]
fn nothing_shines_through_a_closed_shell() {
    let gpu = common::gpu();
    for rasteriser in common::rasterisers(&gpu) {
        let mut renderer = CameraRenderer::with_rasteriser(&gpu, Quality::Low, rasteriser);
        for (n, seed) in [(3, 1), (12, 2), (60, 3)] {
            let assets = assets(shell(n, seed));
            let mut rng = fastrand::Rng::with_seed(seed);
            for step in 0..6u64 {
                let mut view = common::view(&gpu, 200, 150);
                let scene = common::scene(&assets, vec![], (step + 1) * 50_000_000);
                let turn = [0; 3].map(|_| rng.f64() * 360.0);
                let place = [0; 3].map(|_| rng.f64() * 1.6 - 0.8);
                let pose = common::pose(place[0], place[1], place[2], turn);
                let frames = common::render(
                    &mut renderer,
                    &scene,
                    &mut view,
                    pose,
                    &[Modality::Depth, Modality::Semantic],
                );
                let depth = common::floats(&frames[&Modality::Depth].0);
                // Surfaces nearer than the near plane are cut away; in a corner of the image that
                // is 0.13 m.
                let holes = depth.iter().filter(|depth| !depth.is_finite()).count();
                assert_eq!(holes, 0, "{rasteriser:?}, {n} rings, step {step}");
                assert!(depth.iter().all(|depth| (0.1..30.0).contains(depth)));
            }
        }
    }
}

/// Oracle: depth of a plane in closed form. Two triangles of a kilometre under a camera that nearly
/// lies on them, level and tilted.
#[test]
fn huge_triangles_that_pass_the_eye_lie_where_they_are() {
    let gpu = common::gpu();
    let mut builder = MeshBuilder::new("plain");
    let far = 600.0;
    builder.quad(
        grey(),
        [
            [-far, -far, 0.0],
            [far, -far, 0.0],
            [far, far, 0.0],
            [-far, far, 0.0],
        ],
        [[0.0; 2]; 4],
    );
    let assets = assets(builder.finish());
    for rasteriser in common::rasterisers(&gpu) {
        let mut renderer = CameraRenderer::with_rasteriser(&gpu, Quality::Low, rasteriser);
        for (height_m, rpy_deg) in [
            (1.6, [0.0, 0.0, 0.0]),
            (0.3, [0.0, 5.0, 30.0]),
            (1.6, [25.0, 8.0, 77.0]),
            (12.0, [3.0, 60.0, 10.0]),
        ] {
            let mut view = common::view(&gpu, 320, 200);
            let lens = view.intrinsics();
            let pose = common::pose(3.0, 2.0, height_m, rpy_deg);
            let scene = common::scene(&assets, vec![], 50_000_000);
            let frames = common::render(&mut renderer, &scene, &mut view, pose, &[Modality::Depth]);
            let depth = common::floats(&frames[&Modality::Depth].0);
            let [fx, fy, cx, cy] = lens.as_array();
            let mut n_hits = 0;
            for (i, depth_m) in depth.iter().enumerate() {
                let (x, y) = ((i % 320) as f64 + 0.5, (i / 320) as f64 + 0.5);
                let ray = pose.rotation * Vector3::new(1.0, -(x - cx) / fx, -(y - cy) / fy);
                let expected_m = if ray.z < 0.0 {
                    -height_m / ray.z
                } else {
                    f64::INFINITY
                };
                if !(0.11..300.0).contains(&expected_m) {
                    continue;
                }
                n_hits += 1;
                let error_m = (*depth_m as f64 - expected_m).abs();
                // For a camera this close to a plane, 5 cm of height are kilometres of depth at the
                // horizon, so the tolerance is relative to the slope.
                let allowed_m = 1e-3 + 1e-5 * expected_m * (1.0 + expected_m / height_m * 0.02);
                assert!(
                    error_m <= allowed_m,
                    "{rasteriser:?} at {x} {y}: {depth_m} m instead of {expected_m} m"
                );
            }
            assert!(n_hits > 10_000, "{n_hits}");
        }
    }
}

/// Goal: both rasterisers give the same image except for pixels at edges, where corners are rounded
/// differently. Tolerances leave room for the coarse depth and normals of a GPU's own rasteriser.
#[test]
fn computed_pictures_are_drawn_pictures() {
    let gpu = common::gpu();
    let (assets, car) = common::street();
    let all = [
        Modality::Depth,
        Modality::Semantic,
        Modality::Instance,
        Modality::Flow,
        Modality::Normals,
        Modality::Rgb,
    ];
    for quality in [Quality::Low, Quality::High] {
        let shoot = |rasteriser: Rasteriser| {
            let mut renderer = CameraRenderer::with_rasteriser(&gpu, quality, rasteriser);
            let mut view = common::view(&gpu, 320, 240);
            let scene = |step: u64| {
                let cars = vec![common::moving(
                    5,
                    car,
                    common::pose(8.0 + step as f64, -2.0, 0.0, [0.0; 3]),
                )];
                common::scene(&assets, cars, step * 50_000_000)
            };
            common::render(
                &mut renderer,
                &scene(1),
                &mut view,
                common::pose(0.0, -1.0, 1.5, [0.0; 3]),
                &[],
            );
            common::render(
                &mut renderer,
                &scene(2),
                &mut view,
                common::pose(0.3, -1.0, 1.5, [0.0, 1.0, 2.0]),
                &all,
            )
        };
        let (drawn, computed) = (shoot(Rasteriser::Drawn), shoot(Rasteriser::Computed));
        let n_pixels = 320 * 240;
        for modality in all {
            let size = drawn[&modality].0.len() / n_pixels;
            let pairs = drawn[&modality]
                .0
                .chunks_exact(size)
                .zip(computed[&modality].0.chunks_exact(size));
            let differ = |(a, b): (&[u8], &[u8])| match modality {
                Modality::Rgb => a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > 8),
                Modality::Depth | Modality::Flow => common::floats(a)
                    .iter()
                    .zip(common::floats(b))
                    .any(|(a, b)| (a - b).abs() > 1e-2 + 2e-3 * a.abs()),
                // Halves of unit vectors: one step.
                Modality::Normals => a.chunks_exact(2).zip(b.chunks_exact(2)).any(|(a, b)| {
                    u16::from_le_bytes([a[0], a[1]]).abs_diff(u16::from_le_bytes([b[0], b[1]])) > 2
                        && a[1] & 0x7c > 0x10
                }),
                _ => a != b,
            };
            let n_differ = pairs.filter(|pair| differ(*pair)).count();
            assert!(
                n_differ * 100 < n_pixels,
                "{quality:?} {modality:?}: {n_differ} of {n_pixels} pixels differ"
            );
        }
    }
}

/// Goal: the same bytes twice, whatever the order of threads.
#[test]
fn computed_pictures_come_out_the_same_twice() {
    let gpu = common::gpu();
    let assets = assets(shell(60, 3));
    let shoot = |n_views: usize| {
        let mut renderer =
            CameraRenderer::with_rasteriser(&gpu, Quality::High, Rasteriser::Computed);
        let mut views: Vec<_> = (0..n_views).map(|_| common::view(&gpu, 160, 120)).collect();
        let mut bytes: Vec<Vec<u8>> = views
            .iter()
            .map(|view| vec![0; view.payload_bytes(Modality::Rgb)])
            .collect();
        let scene = common::scene(&assets, vec![], 50_000_000);
        let pose = |i: usize| {
            let turn = UnitQuaternion::from_euler_angles(0.0, 0.0, 0.7 * i as f64);
            Isometry3::from_parts(Vector3::new(0.1, 0.2, 0.3).into(), turn)
        };
        let jobs = views
            .iter_mut()
            .zip(&mut bytes)
            .enumerate()
            .map(|(i, (view, bytes))| sensor_camera::ViewJob {
                view,
                world_from_sensor: pose(i),
                outputs: vec![sensor_camera::Output {
                    modality: Modality::Rgb,
                    place: sensor_camera::Place::Memory(bytes),
                }],
            });
        renderer
            .render(&scene, jobs.collect())
            .unwrap()
            .wait()
            .unwrap();
        bytes
    };
    let (once, again, alone) = (shoot(5), shoot(5), shoot(1));
    assert!(once == again);
    assert!(once[0] == alone[0], "a picture depends on its neighbours");
}
