//! Views that are drawn in tiles on the processor: their pictures are the adapter's, and the same for
//! any number of threads.

use std::collections::BTreeSet;

use nalgebra::Isometry3;
use schema_frames::{Modality, VehicleControl};
use sensor_camera::{Rasteriser, TileCamera, TileImages, TileRenderer};
use sensor_core::Scene;
use sensor_gpu::{Gpu, GpuOptions};
use sensor_spec::Intrinsics;
use test_render::tiles::{Both, ColorDifference};
use test_render::{Stage, weathers};

const ALL: [Modality; 6] = [
    Modality::Rgb,
    Modality::Depth,
    Modality::Semantic,
    Modality::Instance,
    Modality::Flow,
    Modality::Normals,
];

/// Not a multiple of the tile's side or of eight.
const SIZE_PX: [u32; 2] = [333, 250];

fn lens() -> Intrinsics {
    Intrinsics::from_fov(SIZE_PX[0], SIZE_PX[1], 90f64.to_radians())
}

/// A town whose vehicles and walkers move.
fn stage(town: &str) -> Stage {
    let mut stage = Stage::new(town, 7, 30).unwrap();
    stage.add_walkers(20);
    stage.drive(VehicleControl {
        throttle_ratio: 0.6,
        ..VehicleControl::default()
    });
    (0..20).for_each(|_| stage.step());
    stage
}

/// The scene after another step, and where a camera is there.
fn step(stage: &mut Stage, weather: &str, place: usize, k: usize) -> (Scene, Isometry3<f64>) {
    stage.step();
    let weather = weathers::named(weather).expect("it has this name");
    let pose = stage.camera(place, 0.4 * k as f64, 3.0 * k as f64, 2.0);
    (stage.scene(weather), pose)
}

/// Share of elements for which `is_same` does not hold.
fn different<T, U>(a: &[T], b: &[U], is_same: impl Fn(&T, &U) -> bool) -> f64 {
    assert_eq!(a.len(), b.len(), "images of one size");
    let n = a.iter().zip(b).filter(|(a, b)| !is_same(a, b)).count();
    n as f64 / a.len() as f64
}

/// Draws two firings in each of these weathers and places by both, and gives the differences of
/// colour. The second firing moves over the shadows of the first.
fn differences(
    stage: &mut Stage,
    rasteriser: Rasteriser,
    looks: &[(&str, usize)],
) -> Vec<(String, ColorDifference)> {
    let gpu = Gpu::open(&GpuOptions::default()).unwrap();
    let mut all = Vec::new();
    for (weather, place) in looks {
        let mut both = Both::new(&gpu, rasteriser, lens());
        for k in 0..2 {
            let (scene, pose) = step(stage, weather, *place, k);
            let (bytes, images) = both.draw(&scene, pose, &ALL);
            let what = format!("{}, {weather}, place {place}, firing {k}", stage.name);
            let color = ColorDifference::of(&bytes[&Modality::Rgb], &images.color);
            println!("{what}: {color:?}");
            let numbers = |modality| bytemuck::pod_collect_to_vec::<u8, u32>(&bytes[&modality]);
            let floats = |modality| bytemuck::pod_collect_to_vec::<u8, f32>(&bytes[&modality]);
            let is_near = |a: &f32, b: &f32| a == b || (a - b).abs() <= 1e-3 * b.abs();
            let is_flow = |a: &f32, b: &f32| (a - b).abs() <= 0.02 + 1e-3 * b.abs();
            let classes = &bytes[&Modality::Semantic];
            let flow = images.flow_px.as_flattened();
            let apart = [
                different(&images.depth_m, &floats(Modality::Depth), is_near),
                different(&images.class_code, classes, |a, b| a == b),
                different(&images.instance, &numbers(Modality::Instance), |a, b| {
                    a == b
                }),
                different(flow, &floats(Modality::Flow), is_flow),
            ];
            assert!(
                apart.iter().all(|share| *share <= 1e-3),
                "{what}: {apart:?}"
            );
            let n_colors = images.color.iter().collect::<BTreeSet<_>>().len();
            assert!(n_colors > 500, "{what} shows {n_colors} colours");
            all.push((what, color));
        }
    }
    all
}

/// Oracle: the renderer as it is on the adapter. It keeps half the bytes of a surface until it is lit,
/// which moves the frames of windows by some steps, and the computed one below does not.
#[test]
fn pictures_in_tiles_are_those_that_users_get() {
    let looks = [("day", 0), ("day", 30), ("overcast", 12), ("night", 3)];
    for town in ["Town10HD", "Town03"] {
        let all = differences(&mut stage(town), Rasteriser::Drawn, &looks);
        let mean_far = all.iter().map(|(_, of)| of.far_ratio).sum::<f64>() / all.len() as f64;
        assert!(mean_far <= 1e-3, "{town}: {mean_far} of all pixels");
        for (what, color) in all {
            assert!(
                color.mean <= 0.5 && color.far_ratio <= 2e-3,
                "{what}: {color:?}"
            );
        }
    }
}

/// Oracle: the renderer on the adapter with surfaces of the same bytes.
#[test]
fn pictures_in_tiles_are_those_of_computed_surfaces() {
    let looks = [
        ("day", 7),
        ("hazy", 5),
        ("fog", 20),
        ("rain", 9),
        ("rainy_night", 2),
    ];
    for (what, color) in differences(&mut stage("Town10HD"), Rasteriser::Computed, &looks) {
        assert!(
            color.mean <= 0.1 && color.far_ratio <= 6e-4,
            "{what}: {color:?}"
        );
    }
}

/// The images of some firings, drawn by this number of threads.
fn film(firings: &[(Scene, Isometry3<f64>)], n_threads: usize) -> Vec<TileImages> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads);
    pool.build().unwrap().install(|| {
        let (mut renderer, mut camera) = (TileRenderer::default(), TileCamera::new(lens()));
        let draw = |(scene, pose): &(Scene, Isometry3<f64>)| {
            let mut images = TileImages::default();
            renderer.render(scene, &mut camera, pose, &ALL, &mut images);
            images
        };
        firings.iter().map(draw).collect()
    })
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    let mut stage = stage("Town10HD");
    let firings: Vec<_> = ["day", "day", "night", "rain", "rain"]
        .iter()
        .enumerate()
        .map(|(k, weather)| step(&mut stage, weather, 0, k))
        .collect();
    let expected = film(&firings, 1);
    assert!(expected.windows(2).all(|two| two[0].color != two[1].color));
    let is_same = |n_threads| {
        // Whole images would not be read as a message.
        let bits = |images: &TileImages| {
            let normals: Vec<u32> = bytemuck::pod_collect_to_vec(&images.normal);
            let flow: Vec<u32> = bytemuck::pod_collect_to_vec(&images.flow_px);
            let depths: Vec<u32> = bytemuck::pod_collect_to_vec(&images.depth_m);
            let labels = (images.class_code.clone(), images.instance.clone());
            (images.color.clone(), depths, normals, flow, labels)
        };
        let found = film(&firings, n_threads);
        found.iter().map(bits).eq(expected.iter().map(bits))
    };
    for n_threads in [2, 3, 7] {
        assert!(
            is_same(n_threads),
            "{n_threads} threads draw other pictures"
        );
    }
}
