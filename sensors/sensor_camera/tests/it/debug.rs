//! Debug strokes: they appear in colour where a pinhole projects them, behind nearer surfaces, and
//! in no other image.

use crate::common;

use std::sync::Arc;

use nalgebra::Isometry3;
use schema_frames::Modality;
use schema_types::Class;
use sensor_camera::{CameraRenderer, Quality};
use sensor_camera::{Output, Place, View, ViewJob, ViewSpec};
use sensor_core::mesh::Surface;
use sensor_core::scene::{DebugStroke, DebugText, Overlay};
use sensor_core::{Material, Scene, SceneAssets};
use sensor_spec::Intrinsics;

const SIZE_PX: [u32; 2] = [160, 120];
const MAGENTA: [u8; 4] = [255, 0, 255, 255];

fn stroke(from_m: [f64; 3], to_m: [f64; 3], width_m: f32) -> DebugStroke {
    DebugStroke {
        from_m,
        to_m,
        width_m,
        color_rgb: [255, 0, 255],
    }
}

/// Pixels in the stroke's colour.
fn painted(bgra: &[u8]) -> Vec<(u32, u32)> {
    let hits = bgra
        .chunks_exact(4)
        .enumerate()
        .filter(|(_, pixel)| *pixel == MAGENTA);
    hits.map(|(i, _)| (i as u32 % SIZE_PX[0], i as u32 / SIZE_PX[0]))
        .collect()
}

#[test]
fn strokes_are_where_a_pinhole_puts_them_and_in_colour_only() {
    let gpu = common::gpu();
    let mut assets = SceneAssets {
        episode: 1,
        ..Default::default()
    };
    let wall = common::cuboid(
        "wall",
        Surface::new(Class::WALLS, Material::Concrete, [90, 120, 90]),
        [20.0, 10.0, 0.0],
        [0.5, 10.0, 20.0],
    );
    let wall = assets.add_mesh(wall);
    assets
        .statics
        .push(common::fixed(wall, Isometry3::identity()));
    let assets = Arc::new(assets);
    let modalities = [
        Modality::Rgb,
        Modality::Depth,
        Modality::Semantic,
        Modality::Instance,
        Modality::Flow,
        Modality::Normals,
    ];
    for quality in [Quality::Low, Quality::High] {
        let mut renderer = CameraRenderer::new(&gpu, quality);
        let mut look = |debug: Vec<DebugStroke>| {
            let mut view = common::view(&gpu, SIZE_PX[0], SIZE_PX[1]);
            let scene = Scene {
                debug,
                ..common::scene(&assets, Vec::new(), 50_000_000)
            };
            common::render(
                &mut renderer,
                &scene,
                &mut view,
                Isometry3::identity(),
                &modalities,
            )
        };
        let plain = look(Vec::new());
        assert!(painted(&plain[&Modality::Rgb].0).is_empty());
        // 90° across 160 pixels: f = 80. A bar 10 m ahead from 4 m left to 4 m right, 0.5 m thick:
        // 64 by 4 pixels about the middle.
        let bar = look(vec![stroke([10.0, 4.0, 0.0], [10.0, -4.0, 0.0], 0.5)]);
        let pixels = painted(&bar[&Modality::Rgb].0);
        let (xs, ys): (Vec<u32>, Vec<u32>) = pixels.iter().copied().unzip();
        assert_eq!(pixels.len(), 64 * 4, "{quality:?}");
        assert_eq!(
            (
                xs.iter().min(),
                xs.iter().max(),
                ys.iter().min(),
                ys.iter().max()
            ),
            (Some(&48), Some(&111), Some(&58), Some(&61))
        );
        for modality in &modalities[1..] {
            assert_eq!(
                plain[modality].0, bar[modality].0,
                "{modality:?} must not see it"
            );
        }
        let others = |(a, b): (&[u8], &[u8])| a != b && b != MAGENTA;
        let n_others = plain[&Modality::Rgb]
            .0
            .chunks(4)
            .zip(bar[&Modality::Rgb].0.chunks(4))
            .filter(|pair| others(*pair))
            .count();
        assert_eq!(n_others, 0, "nothing else changes colour");
        // A point 16 m ahead is a square: 1.6 m are 8 pixels.
        assert_eq!(
            painted(&look(vec![stroke([16.0, 0.0, 2.0], [16.0, 0.0, 2.0], 1.6)])[&Modality::Rgb].0)
                .len(),
            64
        );
        // The wall covers the left half from 19.5 m on: of a bar behind it only the right half is
        // seen.
        let behind = painted(
            &look(vec![stroke([30.0, 12.0, 0.0], [30.0, -12.0, 0.0], 1.5)])[&Modality::Rgb].0,
        );
        assert_eq!(behind.len(), 32 * 4, "{quality:?}");
        assert!(behind.iter().all(|(x, _)| *x >= 80));
        // Strokes through the camera and behind it: no panic, the part in front is visible, and the
        // thinnest stroke is one pixel wide.
        assert!(
            !painted(
                &look(vec![stroke([-5.0, 1.0, -1.0], [10.0, -1.0, 0.5], 0.0)])[&Modality::Rgb].0
            )
            .is_empty()
        );
        assert!(
            painted(&look(vec![stroke([-5.0, 0.0, 0.0], [-1.0, 0.0, 0.0], 1.0)])[&Modality::Rgb].0)
                .is_empty()
        );
    }
}

#[test]
fn the_overlay_is_on_top_of_one_view_and_not_of_its_twin() {
    let gpu = common::gpu();
    let mut assets = SceneAssets {
        episode: 1,
        ..Default::default()
    };
    // A wall from edge to edge 5 m ahead; what is drawn lies 10 m ahead.
    let wall = common::cuboid(
        "wall",
        Surface::new(Class::WALLS, Material::Concrete, [90, 120, 90]),
        [5.0, 0.0, 0.0],
        [0.5, 20.0, 20.0],
    );
    let wall = assets.add_mesh(wall);
    assets
        .statics
        .push(common::fixed(wall, Isometry3::identity()));
    let scene = Scene {
        overlay: Overlay {
            strokes: vec![stroke([10.0, 4.0, 0.0], [10.0, -4.0, 0.0], 4.0)],
            texts: vec![DebugText {
                at_m: [10.0, 0.0, 4.0],
                text: "text".into(),
                color_rgb: [255, 0, 255],
                shadow: false,
            }],
            panel: Vec::new(),
        },
        ..common::scene(&Arc::new(assets), Vec::new(), 50_000_000)
    };
    for quality in [Quality::Low, Quality::High] {
        let mut renderer = CameraRenderer::new(&gpu, quality);
        let lens = Intrinsics::from_fov(SIZE_PX[0], SIZE_PX[1], 90f64.to_radians());
        let mut views = [false, true].map(|shows_overlay| {
            let spec = ViewSpec {
                shows_overlay,
                ..ViewSpec::pinhole(lens)
            };
            View::new(&gpu, spec)
        });
        let mut bytes = [0, 1].map(|_| vec![0; 4 * (SIZE_PX[0] * SIZE_PX[1]) as usize]);
        let jobs = views
            .iter_mut()
            .zip(&mut bytes)
            .map(|(view, bytes)| ViewJob {
                view,
                world_from_sensor: Isometry3::identity(),
                outputs: vec![Output {
                    modality: Modality::Rgb,
                    place: Place::Memory(bytes),
                }],
            });
        renderer
            .render(&scene, jobs.collect())
            .unwrap()
            .wait()
            .unwrap();
        let [plain, overlaid] = bytes.map(|bytes| painted(&bytes));
        assert!(
            plain.is_empty(),
            "{quality:?}: the views must not share one drawing"
        );
        // f = 80: 8 m are 64 pixels, four high; the text begins 32 pixels above the middle.
        let (bar, text): (Vec<_>, Vec<_>) = overlaid.iter().partition(|(_, y)| *y > 50);
        assert_eq!(bar.len(), 64 * 4, "{quality:?}");
        assert!(text.len() > 30, "{quality:?}: {}", text.len());
        let is_in_place = |(x, y): &(u32, u32)| (80..112).contains(x) && (28..36).contains(y);
        assert!(text.iter().all(is_in_place), "{quality:?}: {text:?}");
    }
}
