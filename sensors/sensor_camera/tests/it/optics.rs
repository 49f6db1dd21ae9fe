//! Effect of exposure, film and lens on colour, against a photographer's arithmetic; `lens.rs` and
//! `blur.rs` hold distortion and blur.

use crate::common;

use std::sync::Arc;

use schema_frames::Modality;
use schema_types::Class;
use sensor_camera::{CameraRenderer, Quality, View, ViewSpec};
use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder, Scene, SceneAssets};
use sensor_spec::{
    ExposureMode, ExposureSpec, FilmCurve, FilmSpec, FocusSpec, Intrinsics, MotionBlurSpec,
    OpticsSpec,
};

const SIZE_PX: [u32; 2] = [96, 64];

/// An even grey floor under the noon sun, or a brighter and a darker half.
fn floor(left: u8, right: u8) -> Scene {
    let mut builder = MeshBuilder::new("floor");
    let half = |builder: &mut MeshBuilder, grey: u8, y0: f32, y1: f32| {
        let corners = [
            [-90.0, y0, 0.0],
            [90.0, y0, 0.0],
            [90.0, y1, 0.0],
            [-90.0, y1, 0.0],
        ];
        builder.quad(
            Surface::new(Class::GROUND, Material::CarPaint, [grey; 3]),
            corners,
            [[0.0; 2]; 4],
        );
    };
    half(&mut builder, left, 0.0, 90.0);
    half(&mut builder, right, -90.0, 0.0);
    let mut assets = SceneAssets {
        episode: 1,
        ..Default::default()
    };
    let mesh = assets.add_mesh(builder.finish());
    assets
        .statics
        .push(common::fixed(mesh, common::pose(0.0, 0.0, 0.0, [0.0; 3])));
    let mut scene = common::scene(&Arc::new(assets), vec![], 50_000_000);
    (scene.weather.sun_altitude_deg, scene.weather.cloudiness) = (60.0, 0.0);
    scene
}

/// Looks straight down; x of the world runs up the image, y to the left.
fn shoot(scene: &Scene, optics: &OpticsSpec, quality: Quality, modality: Modality) -> Vec<u8> {
    let gpu = common::gpu();
    let mut renderer = CameraRenderer::new(&gpu, quality);
    let intrinsics = Intrinsics::from_fov(SIZE_PX[0], SIZE_PX[1], 90f64.to_radians());
    let mut view = View::new(
        &gpu,
        ViewSpec {
            optics: optics.clone(),
            seed: 1,
            sensor_id: 1,
            ..ViewSpec::pinhole(intrinsics)
        },
    );
    common::render(
        &mut renderer,
        scene,
        &mut view,
        common::pose(0.0, 0.0, 10.0, [0.0, 90.0, 0.0]),
        &[modality],
    )[&modality]
        .0
        .clone()
}

fn green(bytes: &[u8], x: u32, y: u32) -> f64 {
    bytes[4 * (y * SIZE_PX[0] + x) as usize + 1] as f64
}

fn manual(ev_change: f32, compensation_ev: f32) -> OpticsSpec {
    let exposure = ExposureSpec {
        mode: ExposureMode::Manual,
        compensation_ev,
        ..Default::default()
    };
    let shutter_per_s = exposure.shutter_per_s * ev_change.exp2();
    OpticsSpec {
        postprocess: false,
        exposure: ExposureSpec {
            shutter_per_s,
            ..exposure
        },
        ..Default::default()
    }
}

/// Goal: without film, a stop is a factor of two in light: 2^(1/2.2) in the encoded value; and a
/// stop of compensation is a stop of time.
#[test]
fn a_stop_is_a_factor_of_two() {
    let scene = floor(100, 100);
    let at =
        |optics: &OpticsSpec| green(&shoot(&scene, optics, Quality::Low, Modality::Rgb), 30, 20);
    let (bright, dark) = (at(&manual(2.0, 0.0)), at(&manual(3.0, 0.0)));
    assert!(bright > 40.0 && bright < 250.0, "{bright}");
    assert!(
        (bright / dark - 2f64.powf(1.0 / 2.2)).abs() < 0.03,
        "{bright} to {dark}"
    );
    assert!((at(&manual(3.0, 1.0)) - bright).abs() <= 1.0);
}

/// Goal: a white floor in the sun has EV100 of about 15 to 16; the meter finds it, so that bounds
/// of exactly that value change nothing.
#[test]
fn the_meter_finds_the_sun() {
    let scene = floor(118, 118);
    let metered = |min_ev100: f32, max_ev100: f32| {
        let exposure = ExposureSpec {
            mode: ExposureMode::Histogram,
            min_ev100,
            max_ev100,
            ..Default::default()
        };
        let optics = OpticsSpec {
            exposure,
            ..Default::default()
        };
        green(&shoot(&scene, &optics, Quality::Low, Modality::Rgb), 30, 20)
    };
    let free = metered(-10.0, 20.0);
    // 18 % grey comes out grey, whatever the light.
    assert!((85.0..160.0).contains(&free), "{free}");
    // The bounds hold: with too high a bound the image is darker, with too low a bound brighter,
    // and the scene lies between 13.5 and 16.
    assert!(metered(17.0, 20.0) < free - 10.0 && metered(-10.0, 12.0) > free + 10.0);
    assert!((metered(13.5, 16.0) - free).abs() <= 1.0);
}

#[test]
fn vignette_darkens_the_corner_and_not_the_middle() {
    let scene = floor(128, 128);
    let with = |multiplier: f32| {
        let optics = OpticsSpec {
            vignette_multiplier: multiplier,
            vignette_falloff: 4.0,
            ..Default::default()
        };
        shoot(&scene, &optics, Quality::Low, Modality::Rgb)
    };
    let (plain, dark) = (with(1e-6), with(0.8));
    assert_eq!(green(&plain, 48, 32), green(&dark, 48, 32));
    assert!(green(&dark, 0, 0) < 0.6 * green(&plain, 0, 0));
}

/// Goal: an edge at x = 0.25 of the width is where p · (1 + k r²) says.
#[test]
fn distortion_moves_an_edge_where_its_formula_says() {
    let mut scene = floor(30, 220);
    // The edge between the halves lies under y = 0: move the floor so that it shows at a quarter of
    // the image.
    let mut assets = (*scene.assets).clone();
    assets.statics[0].world_from_mesh = common::pose(0.0, 5.0, 0.0, [0.0; 3]);
    scene.assets = Arc::new(assets);
    let edge = |k: f32| {
        let optics = OpticsSpec {
            distortion_k: k,
            distortion_size: [1.0; 2],
            vignette_multiplier: 1e-6,
            ..Default::default()
        };
        let bytes = shoot(&scene, &optics, Quality::Low, Modality::Rgb);
        let row: Vec<f64> = (0..SIZE_PX[0]).map(|x| green(&bytes, x, 32)).collect();
        let half = 0.5 * (row[2] + row[SIZE_PX[0] as usize - 3]);
        let x = row
            .windows(2)
            .position(|pair| (pair[0] < half) != (pair[1] < half))
            .unwrap();
        (x as f64 + 1.0) / SIZE_PX[0] as f64 - 0.5
    };
    // fov 90°, 10 m up: y = 5 m is a quarter to the left.
    assert!((edge(0.0) + 0.25).abs() < 0.011, "{}", edge(0.0));
    let shown = edge(2.0);
    assert!(
        (shown * (1.0 + 2.0 * shown * shown) + 0.25).abs() < 0.012,
        "{shown}"
    );
}

/// Goal: everything but the bend of the lens acts on colour alone.
#[test]
fn optics_without_distortion_touch_colour_alone() {
    let scene = floor(60, 200);
    let wild = OpticsSpec {
        gamma: 1.0,
        bloom_intensity: 2.0,
        flare_intensity: 1.0,
        film: FilmSpec {
            curve: FilmCurve::Shaped,
            ..Default::default()
        },
        motion_blur: MotionBlurSpec {
            shutter_secs: 0.02,
            longest_ratio: 0.05,
        },
        focus: FocusSpec {
            distance_m: 1.0,
            fstop: 0.5,
            ..Default::default()
        },
        ..Default::default()
    };
    for quality in [Quality::Low, Quality::High] {
        assert!(
            shoot(&scene, &wild, quality, Modality::Rgb)
                != shoot(&scene, &OpticsSpec::default(), quality, Modality::Rgb)
        );
        for modality in [Modality::Depth, Modality::Instance, Modality::Normals] {
            assert!(
                shoot(&scene, &wild, quality, modality)
                    == shoot(&scene, &OpticsSpec::default(), quality, modality)
            );
        }
    }
}

/// The shaped film curve after the formula in docs/reference/sensors.md, in its own words: logistic toe and
/// shoulder over log10, joined by a smooth step.
fn film_oracle(film: &FilmSpec, light: f64) -> f64 {
    let [slope, toe, shoulder, black, white] = [
        film.slope,
        film.toe,
        film.shoulder,
        film.black_clip,
        film.white_clip,
    ]
    .map(f64::from);
    let (low, high) = (1.0 + black - toe, 1.0 + white - shoulder);
    let grey = 0.18f64.log10();
    // The logistic toe takes 18 % grey to 18 % grey.
    let at_toe = match toe > 0.8 {
        true => grey + (1.0 - toe - 0.18) / slope,
        false => grey + low / (2.0 * slope) * (2.0 * low / (0.18 + black) - 1.0).ln(),
    };
    let offset = (1.0 - toe) / slope - at_toe;
    let at_shoulder = shoulder / slope - offset;
    let x = light.max(1e-6).log10();
    let straight = slope * (x + offset);
    let below = match x < at_toe {
        true => 2.0 * low / (1.0 + (-2.0 * slope * (x - at_toe) / low).exp()) - black,
        false => straight,
    };
    let above = match x > at_shoulder {
        true => 1.0 + white - 2.0 * high / (1.0 + (2.0 * slope * (x - at_shoulder) / high).exp()),
        false => straight,
    };
    let mut share = ((x - at_toe) / (at_shoulder - at_toe)).clamp(0.0, 1.0);
    if at_shoulder < at_toe {
        share = 1.0 - share;
    }
    let smooth = share * share * (3.0 - 2.0 * share);
    below + (above - below) * smooth
}

/// Goal: every grey of a floor comes out where the film's formula has it. The light itself is read
/// from a picture without film, which is light to the power of 1 / 2.2.
#[test]
fn a_shaped_film_draws_its_curve() {
    let films = [
        FilmSpec {
            curve: FilmCurve::Shaped,
            ..Default::default()
        },
        FilmSpec {
            curve: FilmCurve::Shaped,
            slope: 1.3,
            toe: 0.3,
            shoulder: 0.5,
            black_clip: 0.05,
            white_clip: 0.1,
        },
        FilmSpec {
            curve: FilmCurve::Shaped,
            toe: 0.9,
            ..Default::default()
        },
    ];
    assert!((film_oracle(&films[0], 0.18) - 0.18).abs() < 0.02);
    for grey in [12, 60, 140, 230] {
        let scene = floor(grey, grey);
        let at = |optics: OpticsSpec| {
            green(&shoot(&scene, &optics, Quality::Low, Modality::Rgb), 30, 20) / 255.0
        };
        for ev in [-2.0f32, 0.0] {
            let exposure = ExposureSpec {
                compensation_ev: ev,
                ..Default::default()
            };
            // Dimmer by a known factor, so that nothing is clipped.
            let raw = at(OpticsSpec {
                postprocess: false,
                exposure: ExposureSpec {
                    compensation_ev: ev - 2.0,
                    ..Default::default()
                },
                ..Default::default()
            });
            let light = 4.0 * raw.powf(2.2);
            for film in &films {
                let shown = at(OpticsSpec {
                    exposure: exposure.clone(),
                    film: film.clone(),
                    ..Default::default()
                });
                let expected = film_oracle(film, light).clamp(0.0, 1.0).powf(1.0 / 2.2);
                assert!(
                    (shown - expected).abs() < 0.025,
                    "grey {grey}, {ev} EV, {film:?}: {shown:.3}, not {expected:.3}"
                );
            }
        }
    }
}

/// Goal: the sun in the picture leaves a ghost opposite of it, none beside it; twice the intensity
/// is a brighter ghost, and without the sun there is none.
#[test]
fn the_sun_leaves_ghosts_on_the_other_side_of_the_middle() {
    let mut scene = floor(20, 20);
    (
        scene.weather.sun_altitude_deg,
        scene.weather.sun_azimuth_deg,
    ) = (30.0, 0.0);
    let gpu = common::gpu();
    let picture = |flare_intensity: f32, compensation_ev: f32, yaw_deg: f64| {
        let mut renderer = CameraRenderer::new(&gpu, Quality::Low);
        let intrinsics = Intrinsics::from_fov(256, 192, 90f64.to_radians());
        let mut view = View::new(
            &gpu,
            ViewSpec {
                optics: OpticsSpec {
                    flare_intensity,
                    exposure: ExposureSpec {
                        compensation_ev,
                        ..Default::default()
                    },
                    ..Default::default()
                },
                ..ViewSpec::pinhole(intrinsics)
            },
        );
        let pose = common::pose(0.0, 0.0, 10.0, [0.0, -10.0, yaw_deg]);
        common::render(&mut renderer, &scene, &mut view, pose, &[Modality::Rgb])[&Modality::Rgb]
            .0
            .chunks(4)
            .map(|bgra| bgra[1] as f64)
            .collect::<Vec<f64>>()
    };
    // Find the sun: the heading under which the picture has its brightest spot off the middle.
    let sun_of = |picture: &[f64]| {
        let brightest = picture.iter().copied().fold(0.0, f64::max);
        let spot: Vec<usize> = (0..picture.len())
            .filter(|i| picture[*i] >= brightest - 1.0)
            .collect();
        let n = spot.len() as f64;
        let x = spot.iter().map(|i| (i % 256) as f64 + 0.5).sum::<f64>() / n - 128.0;
        let y = spot.iter().map(|i| (i / 256) as f64 + 0.5).sum::<f64>() / n - 96.0;
        (n < 200.0 && brightest > 200.0 && x.abs() > 20.0 && x.abs() < 90.0).then_some([x, y])
    };
    let heading = (0..24)
        .map(|i| 15.0 * i as f64)
        .find(|yaw| sun_of(&picture(0.0, -4.0, *yaw)).is_some())
        .expect("the sun stands 30° high and 90° of the sky are in view");
    let sun = sun_of(&picture(0.0, -4.0, heading)).unwrap();
    let (plain, flared) = (picture(0.0, -1.0, heading), picture(2.0, -1.0, heading));
    let gain = |flared: &[f64], x: f64, y: f64| {
        let around = (-2..=2).flat_map(|dy| (-2..=2).map(move |dx| (dx, dy)));
        around
            .map(|(dx, dy)| {
                let (x, y) = ((x + 128.0) as i64 + dx, (y + 96.0) as i64 + dy);
                let i = (y.clamp(0, 191) * 256 + x.clamp(0, 255)) as usize;
                flared[i] - plain[i]
            })
            .fold(f64::MIN, f64::max)
    };
    // One ghost has the distance of the sun itself.
    let ghost = gain(&flared, -sun[0], -sun[1]);
    assert!(ghost > 3.0, "{ghost} at {sun:?}, heading {heading}");
    assert!(gain(&flared, sun[1], -sun[0]).abs() < 1.0);
    let brighter = gain(&picture(8.0, -1.0, heading), -sun[0], -sun[1]);
    assert!(brighter > ghost + 1.0, "{brighter} to {ghost}");
    // Looking away from the sun nothing changes.
    let away = heading + 180.0;
    let (a, b) = (picture(0.0, -1.0, away), picture(4.0, -1.0, away));
    assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1.5));
}
