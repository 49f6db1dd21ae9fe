//! Motion blur and depth of field against what they stand for: the mean of many sharp pictures
//! while the shutter is open, and the disc that a point out of focus becomes.

use crate::common;

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use nalgebra::Isometry3;
use schema_frames::Modality;
use schema_types::Class;
use sensor_camera::{CameraRenderer, Quality, View, ViewSpec};
use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder, MeshId, Scene, SceneAssets};
use sensor_spec::{ExposureSpec, FocusSpec, Intrinsics, MotionBlurSpec, OpticsSpec};

const WIDTH: u32 = 160;
const HEIGHT: u32 = 96;
/// 8-bit levels by which two pictures may differ where both are right.
const LEVELS: f64 = 6.0;

/// An axis-aligned plate, seen from above.
fn plate(builder: &mut MeshBuilder, grey: u8, x: [f32; 2], y: [f32; 2], z: f32) {
    let corners = [
        [x[0], y[0], z],
        [x[1], y[0], z],
        [x[1], y[1], z],
        [x[0], y[1], z],
    ];
    builder.quad(
        Surface::new(Class::GROUND, Material::CarPaint, [grey; 3]),
        corners,
        [[0.0; 2]; 4],
    );
}

/// A floor of stripes one metre wide, and a plate that may move over it.
fn assets() -> (Arc<SceneAssets>, MeshId) {
    let mut floor = MeshBuilder::new("floor");
    for i in -30..30 {
        let grey = if i % 2 == 0 { 40 } else { 160 };
        plate(
            &mut floor,
            grey,
            [-60.0, 60.0],
            [i as f32, i as f32 + 1.0],
            0.0,
        );
    }
    let mut car = MeshBuilder::new("plate");
    plate(&mut car, 250, [-1.0, 1.0], [-1.5, 1.5], 0.0);
    let mut assets = SceneAssets {
        episode: 1,
        ..Default::default()
    };
    let floor = assets.add_mesh(floor.finish());
    let car = assets.add_mesh(car.finish());
    assets
        .statics
        .push(common::fixed(floor, Isometry3::identity()));
    (Arc::new(assets), car)
}

fn shot(
    renderer: &mut CameraRenderer,
    view: &mut View,
    scene: &Scene,
    pose: Isometry3<f64>,
) -> Vec<f64> {
    let bytes = common::render(renderer, scene, view, pose, &[Modality::Rgb])[&Modality::Rgb]
        .0
        .clone();
    // Green alone; the scene is grey.
    bytes.chunks(4).map(|bgra| bgra[1] as f64).collect()
}

fn view(optics: OpticsSpec) -> View {
    let intrinsics = Intrinsics::from_fov(WIDTH, HEIGHT, 90f64.to_radians());
    View::new(
        &common::gpu(),
        ViewSpec {
            optics,
            ..ViewSpec::pinhole(intrinsics)
        },
    )
}

/// Light of an 8-bit level, by bisection of the film curve that docs/reference/sensors.md names.
fn light_of(level: f64) -> f64 {
    let (mut low, mut high) = (0.0, 20.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if level_of(middle) < level {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

/// Hejl and Burgess-Dawson's curve.
fn level_of(light: f64) -> f64 {
    let x = (light - 0.004).max(0.0);
    255.0 * (x * (6.2 * x + 0.5)) / (x * (6.2 * x + 1.7) + 0.06)
}

/// The mean light of pictures, as a picture.
fn mean(pictures: &[Vec<f64>]) -> Vec<f64> {
    (0..pictures[0].len())
        .map(|i| pictures.iter().map(|p| light_of(p[i])).sum::<f64>() / pictures.len() as f64)
        .map(level_of)
        .collect()
}

/// Share of pixels that differ by more than [`LEVELS`], without a rim where neighbours are unknown.
fn differing(a: &[f64], b: &[f64], rim: u32) -> f64 {
    let inside: Vec<usize> = (rim..HEIGHT - rim)
        .flat_map(|y| (rim..WIDTH - rim).map(move |x| (y * WIDTH + x) as usize))
        .collect();
    let n = inside.iter().filter(|i| (a[**i] - b[**i]).abs() > LEVELS);
    n.count() as f64 / inside.len() as f64
}

/// Pictures with motion between two firings 50 ms apart; `pose_at` and `plate_at` give the camera
/// and the plate at a time in units of that, 0 at the second firing. Compares motion blur with the
/// mean of 64 sharp pictures while a shutter of 30 ms is open.
fn compare_with_mean(
    name: &str,
    pose_at: impl Fn(f64) -> Isometry3<f64>,
    plate_at: impl Fn(f64) -> Isometry3<f64>,
) {
    const SHUTTER: f64 = 0.6;
    let (assets, car) = assets();
    let scene_at = |time: f64, nanos: u64| {
        let plate = common::moving(7, car, plate_at(time));
        let mut scene = common::scene(&assets, vec![plate], nanos);
        (scene.weather.sun_altitude_deg, scene.weather.cloudiness) = (60.0, 100.0);
        scene
    };
    let gpu = common::gpu();
    let mut renderer = CameraRenderer::new(&gpu, Quality::Low);
    let blurred = {
        let mut view = view(OpticsSpec {
            motion_blur: MotionBlurSpec {
                shutter_secs: (0.05 * SHUTTER) as f32,
                longest_ratio: 0.2,
            },
            ..Default::default()
        });
        let first = scene_at(-1.0, 50_000_000);
        shot(&mut renderer, &mut view, &first, pose_at(-1.0));
        shot(
            &mut renderer,
            &mut view,
            &scene_at(0.0, 100_000_000),
            pose_at(0.0),
        )
    };
    let sharp: Vec<Vec<f64>> = (0..64)
        .map(|i| SHUTTER * ((i as f64 + 0.5) / 64.0 - 0.5))
        .map(|time| {
            // Every picture in the same light; a new view knows no motion.
            let scene = scene_at(time, 100_000_000);
            shot(
                &mut renderer,
                &mut view(OpticsSpec::default()),
                &scene,
                pose_at(time),
            )
        })
        .collect();
    let expected = mean(&sharp);
    let (with, without) = (
        differing(&blurred, &expected, 14),
        differing(&sharp[32], &expected, 14),
    );
    assert!(
        without > 0.01,
        "{name}: there is nothing to blur: {without}"
    );
    assert!(
        with < 0.15 * without,
        "{name}: {with} of the pixels differ, of sharp ones {without}"
    );
}

/// Looks straight down; x of the world runs up the image, y to the left.
fn above(x_m: f64, y_m: f64) -> Isometry3<f64> {
    common::pose(x_m, y_m, 10.0, [0.0, 90.0, 0.0])
}

fn still(_: f64) -> Isometry3<f64> {
    common::pose(0.0, 0.3, 0.5, [0.0; 3])
}

#[test]
fn a_camera_that_moves_smears_like_an_open_shutter() {
    compare_with_mean(
        "camera",
        |time| above(0.0, 1.6 * time),
        |_| common::pose(900.0, 0.0, 0.5, [0.0; 3]),
    );
}

#[test]
fn a_car_that_passes_smears_and_the_road_does_not() {
    compare_with_mean(
        "car",
        |_| above(0.0, 0.0),
        |time| common::pose(0.4 + 1.5 * time, 0.0, 0.5, [0.0; 3]),
    );
}

#[test]
fn a_tracked_car_stays_sharp_before_a_smeared_road() {
    compare_with_mean(
        "tracked",
        |time| above(0.0, 1.5 * time),
        |time| common::pose(0.0, 0.3 + 1.5 * time, 0.5, [0.0; 3]),
    );
}

/// Goal: nothing that rests is touched, and without a motion the first frame is sharp.
#[test]
fn what_rests_stays_sharp() {
    let (assets, car) = assets();
    let scene = common::scene(
        &assets,
        vec![common::moving(7, car, still(0.0))],
        50_000_000,
    );
    let mut renderer = CameraRenderer::new(&common::gpu(), Quality::Low);
    let mut blurring = view(OpticsSpec {
        motion_blur: MotionBlurSpec {
            shutter_secs: 0.05,
            longest_ratio: 0.1,
        },
        ..Default::default()
    });
    let plain = shot(
        &mut renderer,
        &mut view(OpticsSpec::default()),
        &scene,
        above(0.0, 0.0),
    );
    for step in 0..3 {
        let mut scene = scene.clone();
        scene.sim_time.0 += step * 50_000_000;
        let blurred = shot(&mut renderer, &mut blurring, &scene, above(0.0, 0.0));
        let worst = plain
            .iter()
            .zip(&blurred)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        assert!(worst <= 1.0, "frame {step}: {worst}");
    }
}

fn focus(distance_m: f32, fstop: f32, sensor_width_mm: f32) -> FocusSpec {
    FocusSpec {
        distance_m,
        fstop,
        sensor_width_mm,
        min_fstop: fstop,
        ..Default::default()
    }
}

/// Goal: an edge out of focus is the step response of a disc whose radius the thin lens gives.
#[test]
fn an_edge_out_of_focus_is_the_step_of_a_disc() {
    let mut floor = MeshBuilder::new("floor");
    plate(&mut floor, 40, [-90.0, 90.0], [0.0, 90.0], 0.0);
    plate(&mut floor, 160, [-90.0, 90.0], [-90.0, 0.0], 0.0);
    let mut assets = SceneAssets {
        episode: 1,
        ..Default::default()
    };
    let mesh = assets.add_mesh(floor.finish());
    assets
        .statics
        .push(common::fixed(mesh, Isometry3::identity()));
    let mut scene = common::scene(&Arc::new(assets), vec![], 50_000_000);
    (scene.weather.sun_altitude_deg, scene.weather.cloudiness) = (60.0, 100.0);
    let mut renderer = CameraRenderer::new(&common::gpu(), Quality::Low);
    // fov 90°: the focal length is half the film's width, 100 mm of 200 mm. A floor 10 m away.
    for (focus_m, fstop) in [(4.0, 1.0), (30.0, 0.5), (10.0, 0.5)] {
        let optics = OpticsSpec {
            focus: focus(focus_m, fstop, 200.0),
            ..Default::default()
        };
        let (f_mm, s_mm, d_mm) = (100.0, 1000.0 * focus_m as f64, 10_000.0f64);
        let diameter_mm = f_mm * f_mm / fstop as f64 * (d_mm - s_mm).abs() / (d_mm * (s_mm - f_mm));
        let radius_px = 0.5 * diameter_mm * WIDTH as f64 / 200.0;
        let picture = shot(&mut renderer, &mut view(optics), &scene, above(0.0, 0.0));
        let row = &picture[(HEIGHT / 2 * WIDTH) as usize..][..WIDTH as usize];
        let (dark, bright) = (light_of(row[10]), light_of(row[WIDTH as usize - 10]));
        for (x, level) in row.iter().enumerate().skip(20).take(WIDTH as usize - 40) {
            let t = (x as f64 + 0.5 - 0.5 * WIDTH as f64) / radius_px.max(0.5);
            let t = t.clamp(-1.0, 1.0);
            let share = 0.5 + (t.asin() + t * (1.0 - t * t).sqrt()) / PI;
            let expected = level_of(dark + (bright - dark) * share);
            assert!(
                (level - expected).abs() < 9.0,
                "focus {focus_m} m, radius {radius_px:.2} px, column {x}: {level}, not {expected:.0}"
            );
        }
    }
}

/// Goal: a bright point behind the focus is the picture of the diaphragm, a corner upwards; before
/// the focus it stands on its head. Straight blades give a polygon, the open lens a disc.
#[test]
fn a_point_out_of_focus_shows_the_diaphragm() {
    let mut floor = MeshBuilder::new("floor");
    plate(&mut floor, 1, [-90.0, 90.0], [-90.0, 90.0], 0.0);
    plate(&mut floor, 255, [-0.12, 0.12], [-0.12, 0.12], 0.01);
    let mut assets = SceneAssets {
        episode: 1,
        ..Default::default()
    };
    let mesh = assets.add_mesh(floor.finish());
    assets
        .statics
        .push(common::fixed(mesh, Isometry3::identity()));
    let mut scene = common::scene(&Arc::new(assets), vec![], 50_000_000);
    (scene.weather.sun_altitude_deg, scene.weather.cloudiness) = (60.0, 100.0);
    let mut renderer = CameraRenderer::new(&common::gpu(), Quality::Low);
    // The radius would be 8 px in both; longer ones are cut at 4 % of the width.
    let cases = [(5.26, 1.0, 5), (5.26, 1.0, 0), (100.0, 1.0, 3)];
    for (focus_m, fstop, blades) in cases {
        let radius_px = {
            let (f, s, d) = (100.0, 1000.0 * focus_m, 9_990.0f64);
            let diameter_mm: f64 = f * f / fstop * (d - s).abs() / (d * (s - f));
            (0.5 * diameter_mm * WIDTH as f64 / 200.0).min(0.04 * WIDTH as f64)
        };
        let mut spec = focus(focus_m as f32, fstop as f32, 200.0);
        if blades > 0 {
            (spec.blades, spec.min_fstop) = (blades, 0.0);
        }
        let optics = OpticsSpec {
            focus: spec,
            exposure: ExposureSpec {
                compensation_ev: 4.5,
                ..Default::default()
            },
            ..Default::default()
        };
        let picture = shot(&mut renderer, &mut view(optics), &scene, above(0.0, 0.0));
        let at = |x: f64, y: f64| {
            let (x, y) = (x + 0.5 * WIDTH as f64, y + 0.5 * HEIGHT as f64);
            light_of(picture[(y as u32 * WIDTH + x as u32) as usize])
        };
        let level = at(0.0, 0.0);
        assert!(level > 3.0 * at(30.0, 0.0), "{level} to {}", at(30.0, 0.0));
        // Behind the focus the first corner points upwards, before it downwards.
        let first = if focus_m < 9.0 {
            -0.25 * TAU
        } else {
            0.25 * TAU
        };
        let rim = |angle: f64| match blades {
            0 => radius_px,
            n => {
                let step = TAU / n as f64;
                let turned = (angle - first).rem_euclid(step) - 0.5 * step;
                radius_px * (0.5 * step).cos() / turned.cos()
            }
        };
        for i in 0..48 {
            let angle = TAU * i as f64 / 48.0;
            let (c, s) = (angle.cos(), angle.sin());
            // The point is a plate of two pixels, which the rim is blurred by.
            let (inner, outer) = (rim(angle) - 2.2, rim(angle) + 2.2);
            let name = format!("{blades} blades, focus {focus_m} m, angle {angle:.2}");
            if inner > 0.0 {
                let inside = at(inner * c, inner * s);
                assert!(inside > 0.6 * level, "{name}: {inside} of {level} inside");
            }
            let outside = at(outer * c, outer * s);
            assert!(
                outside < 0.4 * level,
                "{name}: {outside} of {level} outside"
            );
        }
    }
}
