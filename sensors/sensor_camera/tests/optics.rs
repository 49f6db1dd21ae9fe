//! Effect of exposure and lens on colour, against a photographer's arithmetic; other modalities are
//! unaffected.

#[path = "common/mod.rs"]
mod common;

use std::sync::Arc;

use schema_frames::Modality;
use schema_types::Class;
use sensor_camera::{CameraRenderer, Quality, View, ViewSpec};
use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder, Scene, SceneAssets};
use sensor_spec::{DvsSpec, ExposureMode, ExposureSpec, Intrinsics, OpticsSpec};

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
            intrinsics,
            optics: optics.clone(),
            dvs: DvsSpec::default(),
            seed: 1,
            sensor_id: 1,
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

#[test]
fn optics_touch_colour_alone() {
    let scene = floor(60, 200);
    let wild = OpticsSpec {
        distortion_k: 3.0,
        distortion_size: [1.0; 2],
        gamma: 1.0,
        bloom_intensity: 2.0,
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
