//! The event camera against closed forms: when an edge crosses a pixel, how many thresholds lie in
//! its contrast, and silence.

use crate::common;

use nalgebra::Isometry3;
use schema_frames::{DvsEvent, Modality};
use schema_types::Class;
use sensor_camera::{CameraRenderer, OutputResult, Quality, View};
use sensor_core::mesh::Surface;
use sensor_core::{DynamicInstance, Material, Mesh, MeshBuilder, Scene, SceneAssets};
use sensor_gpu::Gpu;
use sensor_spec::DvsSpec;
use std::sync::Arc;

const SIZE_PX: [u32; 2] = [320, 40];
const TICK_NANOS: u64 = 50_000_000;
const DISTANCE_M: f64 = 8.0;
/// 90° over 320 px.
const FOCAL_PX: f64 = 160.0;

fn spec() -> DvsSpec {
    DvsSpec {
        positive_threshold: 0.3,
        negative_threshold: 0.3,
        log_eps: 1e-6,
        substep_px: 0.5,
        max_events: 1_000_000,
        ..Default::default()
    }
}

/// A wall across the view, its face at x = 0, from y0 to y1 (y is to the left), darker or brighter.
fn wall(builder: &mut MeshBuilder, grey: u8, y0: f32, y1: f32) {
    let surface = Surface::new(Class::WALLS, Material::Matte, [grey; 3]);
    builder.quad(
        surface,
        [
            [0.0, y1, -30.0],
            [0.0, y0, -30.0],
            [0.0, y0, 30.0],
            [0.0, y1, 30.0],
        ],
        [[0.0; 2]; 4],
    );
}

fn linear(grey: u8) -> f64 {
    let s = grey as f64 / 255.0;
    if s <= 0.04045 {
        s / 12.92
    } else {
        ((s + 0.055) / 1.055).powf(2.4)
    }
}

/// Events are followed on the CPU, and on the GPU if it has the features.
fn ways(gpu: &Gpu) -> Vec<bool> {
    let can = CameraRenderer::new(gpu, Quality::Low).set_events_on_gpu(true);
    if can { vec![false, true] } else { vec![false] }
}

struct Bench {
    renderer: CameraRenderer,
    view: View,
}

impl Bench {
    fn new(gpu: &Gpu, dvs: DvsSpec, on_gpu: bool) -> Self {
        let mut renderer = CameraRenderer::new(gpu, Quality::Low);
        assert!(renderer.set_events_on_gpu(on_gpu));
        Bench {
            renderer,
            view: common::view_with(gpu, SIZE_PX[0], SIZE_PX[1], dvs),
        }
    }

    fn fire(&mut self, scene: &Scene, camera: Isometry3<f64>) -> (Vec<DvsEvent>, OutputResult) {
        let frames = common::render(
            &mut self.renderer,
            scene,
            &mut self.view,
            camera,
            &[Modality::Dvs],
        );
        let (bytes, result) = &frames[&Modality::Dvs];
        (
            bytes
                .chunks_exact(16)
                .map(bytemuck::pod_read_unaligned)
                .collect(),
            *result,
        )
    }
}

/// An image position as metres to the left at the wall's distance.
fn left_m(x_px: f64, distance_m: f64) -> f64 {
    -(x_px - 0.5 * SIZE_PX[0] as f64) / FOCAL_PX * distance_m
}

/// Events of the third firing while something moves `step_px` to the right per tick, its origin at
/// `begin_px` when the window begins.
fn shift(
    gpu: &Gpu,
    on_gpu: bool,
    meshes: Vec<(Mesh, f64)>,
    moving: Mesh,
    begin_px: f64,
    step_px: f64,
) -> Vec<DvsEvent> {
    let mut bench = Bench::new(gpu, spec(), on_gpu);
    let mut assets = SceneAssets {
        episode: 1,
        ..Default::default()
    };
    for (mesh, x_m) in meshes {
        let id = assets.add_mesh(mesh);
        assets
            .statics
            .push(common::fixed(id, common::pose(x_m, 0.0, 1.5, [0.0; 3])));
    }
    let id = assets.add_mesh(moving);
    let assets = Arc::new(assets);
    let mut events = Vec::new();
    for step in 0..3 {
        let x_px = begin_px + step_px * (step as f64 - 1.0);
        let panel: DynamicInstance = common::moving(
            9,
            id,
            common::pose(DISTANCE_M, left_m(x_px, DISTANCE_M), 1.5, [0.0; 3]),
        );
        let mut scene = common::scene(&assets, vec![panel], (step + 1) * TICK_NANOS);
        // The sky is overcast, because a moving shadow would make events of its own.
        scene.weather.cloudiness = 100.0;
        let result;
        (events, result) = bench.fire(&scene, common::pose(0.0, 0.0, 1.5, [0.0; 3]));
        assert_eq!((result.first, result.n_dropped), (step == 0, 0));
        assert!(step > 0 || events.is_empty());
    }
    assert!(events.is_sorted_by_key(|e| (e.nanos_in_window, e.y_px, e.x_px)));
    events
}

/// Checks that each pixel column between two edge positions has `n` events of one polarity around
/// the time the edge passes its middle.
fn check_edge(
    events: &[DvsEvent],
    begin_px: f64,
    step_px: f64,
    columns: std::ops::Range<u16>,
    polarity: u8,
    n: std::ops::RangeInclusive<usize>,
    tolerance_nanos: f64,
) {
    for x in columns {
        for y in [3u16, 20, 36] {
            let times: Vec<f64> = events
                .iter()
                .filter(|e| (e.x_px, e.y_px, e.polarity) == (x, y, polarity))
                .map(|e| e.nanos_in_window as f64)
                .collect();
            assert!(
                n.contains(&times.len()),
                "pixel {x} {y} has {} events of polarity {polarity}, not {n:?}",
                times.len()
            );
            let mean = times.iter().sum::<f64>() / times.len() as f64;
            let expected = (x as f64 + 0.5 - begin_px) / step_px * TICK_NANOS as f64;
            assert!(
                (mean - expected).abs() < tolerance_nanos,
                "pixel {x} {y}: {mean} ns instead of {expected}"
            );
        }
    }
}

/// Goal: a panel, bright on its left half and dark on its right, slides to the right; every pixel
/// brightens when the edge passes.
#[test]
fn moving_edge_gives_events_when_it_passes_and_as_many_as_its_contrast() {
    let gpu = common::gpu();
    let paths = [
        (60.0, 64.0, 200_000.0),
        (60.3, 128.4, 200_000.0),
        (90.0, 20.0, 200_000.0),
    ];
    for (on_gpu, (begin_px, step_px, tolerance_nanos)) in ways(&gpu)
        .into_iter()
        .flat_map(|way| paths.map(|path| (way, path)))
    {
        let mut panel = MeshBuilder::new("panel");
        wall(&mut panel, 230, 0.0, 60.0);
        wall(&mut panel, 70, -60.0, 0.0);
        let events = shift(&gpu, on_gpu, vec![], panel.finish(), begin_px, step_px);
        let contrast = (linear(230) / linear(70)).ln();
        // Air in front of the panel takes a little of the contrast.
        let n = (contrast / 0.3 - 0.6).floor() as usize..=(contrast / 0.3).ceil() as usize;
        let columns = begin_px as u16 + 2..(begin_px + step_px) as u16 - 2;
        assert!(
            events
                .iter()
                .all(|e| e.polarity == 1 && e.object_id == 9 && e.class == Class::WALLS.0)
        );
        assert!(
            events
                .iter()
                .all(|e| (begin_px as u16 - 1..=(begin_px + step_px) as u16 + 1).contains(&e.x_px))
        );
        check_edge(&events, begin_px, step_px, columns, 1, n, tolerance_nanos);
    }
}

/// Goal: a dark bar, thinner than its path, passes a striped wall that stands still: each pixel
/// darkens when the front passes and brightens when the back does, and the wall's own stripes stay
/// silent.
#[test]
fn bar_before_a_wall_at_rest_has_a_front_and_a_back() {
    let gpu = common::gpu();
    for on_gpu in ways(&gpu) {
        let mut stripes = MeshBuilder::new("stripes");
        for i in -30..30 {
            wall(
                &mut stripes,
                if i % 2 == 0 { 235 } else { 190 },
                i as f32 * 1.7,
                (i + 1) as f32 * 1.7,
            );
        }
        let mut bar = MeshBuilder::new("bar");
        let width_px = 16.0;
        wall(&mut bar, 40, 0.0, (width_px / FOCAL_PX * DISTANCE_M) as f32);
        let (front_px, step_px) = (120.0, 64.0);
        let events = shift(
            &gpu,
            on_gpu,
            vec![(stripes.finish(), 16.0)],
            bar.finish(),
            front_px,
            step_px,
        );
        let path = (front_px - width_px) as u16 - 1..=(front_px + step_px) as u16 + 1;
        let outside: Vec<_> = events.iter().filter(|e| !path.contains(&e.x_px)).collect();
        assert!(
            outside.is_empty(),
            "{} events beside the path, e.g. {:?}",
            outside.len(),
            outside[0]
        );
        // Both edges pass these; half a pixel of either edge is 0.4 ms at this speed.
        check_edge(&events, front_px, step_px, 124..164, 0, 8..=16, 800_000.0);
        check_edge(
            &events,
            front_px - width_px,
            step_px,
            124..164,
            1,
            8..=16,
            800_000.0,
        );
    }
}

#[test]
fn scene_at_rest_is_silent() {
    let gpu = common::gpu();
    for on_gpu in ways(&gpu) {
        let mut bench = Bench::new(&gpu, DvsSpec::default(), on_gpu);
        let (assets, car) = common::street();
        for step in 1..4u64 {
            let scene = common::scene(
                &assets,
                vec![common::moving(
                    4,
                    car,
                    common::pose(9.0, 0.0, 0.0, [0.0; 3]),
                )],
                step * TICK_NANOS,
            );
            let (events, result) = bench.fire(&scene, common::pose(0.0, 0.0, 1.5, [0.0; 3]));
            assert_eq!((events.len(), result.first), (0, step == 1));
        }
    }
}

#[test]
fn reader_that_comes_back_begins_anew() {
    let gpu = common::gpu();
    for on_gpu in ways(&gpu) {
        let mut bench = Bench::new(&gpu, DvsSpec::default(), on_gpu);
        let (assets, _) = common::street();
        let camera = |step: u64| common::pose(step as f64 * 0.4, 0.0, 1.5, [0.0; 3]);
        let scene = |step: u64| common::scene(&assets, vec![], step * TICK_NANOS);
        assert!(bench.fire(&scene(1), camera(1)).1.first);
        assert!(!bench.fire(&scene(2), camera(2)).1.first);
        common::render(
            &mut bench.renderer,
            &scene(3),
            &mut bench.view,
            camera(3),
            &[],
        );
        let (events, result) = bench.fire(&scene(4), camera(4));
        assert_eq!((events.len(), result.first), (0, true));
        let (events, result) = bench.fire(&scene(5), camera(5));
        assert!(!events.is_empty() && !result.first);
    }
}

#[test]
fn events_beyond_the_limit_are_dropped_from_the_end_and_counted() {
    let gpu = common::gpu();
    let (assets, _) = common::street();
    for on_gpu in ways(&gpu) {
        let fire_twice = |max_events: u32| {
            let mut bench = Bench::new(
                &gpu,
                DvsSpec {
                    max_events,
                    ..Default::default()
                },
                on_gpu,
            );
            bench.fire(
                &common::scene(&assets, vec![], TICK_NANOS),
                common::pose(0.0, 0.0, 1.5, [0.0; 3]),
            );
            bench.fire(
                &common::scene(&assets, vec![], 2 * TICK_NANOS),
                common::pose(1.0, 0.0, 1.5, [0.0; 3]),
            )
        };
        let (all, _) = fire_twice(500_000);
        let (some, result) = fire_twice(1000);
        assert!(all.len() > 1000);
        assert_eq!(
            (some.len(), result.n_dropped as usize),
            (1000, all.len() - 1000)
        );
        assert!(some == all[..1000]);
    }
}
