//! Colour through a calibrated lens and the labels that rays make show the same: every pixel amid
//! pixels of one class has that class's colour, over a field of 190° and beyond its end.

use std::sync::Arc;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use schema_frames::Modality;
use schema_types::lens::{Lens, LensModel, Plane};
use schema_types::{Class, ObjectId, SimTime, Tick};
use sensor_camera::{CameraRenderer, Output, Place, Quality, View, ViewJob, ViewSpec};
use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder, Scene, SceneAssets, StaticInstance};
use sensor_gpu::{Gpu, GpuOptions};
use sensor_ray::{LabelImages, RayCamera, RayScene};
use sensor_spec::Intrinsics;

const WIDTH: usize = 400;
const HEIGHT: usize = 300;

/// Stripes of two classes, red and blue, on a floor and a ceiling.
fn assets() -> Arc<SceneAssets> {
    let mut builder = MeshBuilder::new("stripes");
    for i in -40..40 {
        let (class, rgb) = match i % 2 == 0 {
            true => (Class::ROADS, [230, 30, 30]),
            false => (Class::SIDEWALKS, [30, 30, 230]),
        };
        let surface = Surface::new(class, Material::CarPaint, rgb);
        let [y0, y1] = [i, i + 1].map(|i| 2.0 * i as f32);
        for (z, [y0, y1]) in [(0.0, [y0, y1]), (6.0, [y1, y0])] {
            let corners = [[-80.0, y0, z], [80.0, y0, z], [80.0, y1, z], [-80.0, y1, z]];
            builder.quad(surface, corners, [[0.0; 2]; 4]);
        }
    }
    let mut assets = SceneAssets {
        episode: 1,
        ..Default::default()
    };
    let mesh = assets.add_mesh(builder.finish());
    assets.statics.push(StaticInstance {
        mesh,
        world_from_mesh: Isometry3::identity(),
        object: ObjectId::scenery(1),
    });
    Arc::new(assets)
}

fn lens(focal_px: f64) -> Lens {
    let coefficients = [0.0831, -0.0111, 0.0086, -0.0009];
    let plane = Plane {
        focal_px: [focal_px; 2],
        shear_px: [0.0; 2],
        centre_px: [203.25, 147.5],
    };
    let model = LensModel::KannalaBrandt { coefficients };
    Lens::new(model, plane, Some(95f64.to_radians())).unwrap()
}

fn colours(assets: &Arc<SceneAssets>, pose: Isometry3<f64>, lens: &Lens) -> Vec<[u8; 4]> {
    let gpu = Gpu::open(&GpuOptions::default()).unwrap();
    let mut renderer = CameraRenderer::new(&gpu, Quality::Low);
    let intrinsics = Intrinsics::from_fov(WIDTH as u32, HEIGHT as u32, 1.0);
    let mut view = View::of(ViewSpec {
        lens: Some(lens.clone()),
        ..ViewSpec::pinhole(intrinsics)
    });
    let mut bytes = vec![0; view.payload_bytes(Modality::Rgb)];
    let job = ViewJob {
        view: &mut view,
        world_from_sensor: pose,
        outputs: vec![Output {
            modality: Modality::Rgb,
            place: Place::Memory(&mut bytes),
        }],
    };
    let scene = Scene {
        tick: Tick(1),
        sim_time: SimTime(50_000_000),
        period_nanos: 50_000_000,
        assets: assets.clone(),
        dynamics: Vec::new(),
        past: Default::default(),
        weather: Default::default(),
        lidar_extinction_per_m: 0.0,
        debug: Vec::new(),
        overlay: Default::default(),
    };
    let made = renderer.render(&scene, vec![job]).unwrap();
    made.wait().unwrap();
    bytemuck::pod_collect_to_vec(&bytes)
}

/// Classes of pixels; `None` where stripes are so far away that they are finer than pixels.
fn classes(assets: &SceneAssets, pose: &Isometry3<f64>, lens: &Lens) -> Vec<Option<Class>> {
    const FAR_M: f32 = 30.0;
    let (mut classes, mut depth) = (vec![0; WIDTH * HEIGHT], vec![0; 4 * WIDTH * HEIGHT]);
    let images = LabelImages {
        class: Some(&mut classes),
        depth: Some(&mut depth),
        ..Default::default()
    };
    let camera = RayCamera::new(lens, [WIDTH as u32, HEIGHT as u32]);
    camera.cast(&RayScene::load(assets), pose, &[], images);
    let depth: Vec<f32> = bytemuck::pod_collect_to_vec(&depth);
    let pixels = classes.into_iter().map(Class).zip(depth);
    let near = |(class, depth_m)| (class == Class::UNLABELED || depth_m < FAR_M).then_some(class);
    pixels.map(near).collect()
}

/// Pixels amid pixels of one class, and how many of them have another colour than it.
fn compared(classes: &[Option<Class>], colours: &[[u8; 4]]) -> (usize, usize) {
    let (mut n, mut n_wrong) = (0, 0);
    for y in 1..HEIGHT - 1 {
        for x in 1..WIDTH - 1 {
            let at = y * WIDTH + x;
            let near = [at - WIDTH, at, at + WIDTH];
            let mut around = near.iter().flat_map(|it| &classes[it - 1..=it + 1]);
            if !around.all(|it| *it == classes[at]) {
                continue;
            }
            let [b, g, r, _] = colours[at];
            let Some(class) = classes[at] else { continue };
            let is_right = match class {
                Class::ROADS => r > b,
                Class::SIDEWALKS => b > r,
                Class::UNLABELED => [b, g, r] == [0; 3],
                _ => continue,
            };
            n += 1;
            n_wrong += usize::from(!is_right);
        }
    }
    (n, n_wrong)
}

#[test]
fn colour_through_a_fisheye_agrees_with_its_labels() {
    let assets = assets();
    let turn = UnitQuaternion::from_euler_angles(0.05, 0.2, 0.4);
    let pose = Isometry3::from_parts(Vector3::new(0.3, 0.4, 3.0).into(), turn);
    let labels = classes(&assets, &pose, &lens(105.0));
    let (n, n_wrong) = compared(&labels, &colours(&assets, pose, &lens(105.0)));
    assert!(n > 60_000 && n_wrong == 0, "{n_wrong} of {n}");
    // Labels of a lens whose focal length is 2 % longer do not fit.
    let (_, n_wrong) = compared(&labels, &colours(&assets, pose, &lens(107.1)));
    assert!(n_wrong > 100, "{n_wrong}");
}
