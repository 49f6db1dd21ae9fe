//! The memory of shadow maps is bounded, and images do not depend on the limit.

use crate::common;

use schema_frames::Modality;
use sensor_camera::{CameraRenderer, Output, Place, Quality, Rasteriser, View, ViewJob, ViewSpec};
use sensor_gpu::Gpu;
use sensor_spec::Intrinsics;

const N_CAMERAS: usize = 5;
const N_STEPS: u64 = 3;

/// Result of some ticks: images, number of submissions, and peak memory of shadow maps.
struct Shots {
    pictures: Vec<Vec<u8>>,
    n_submissions: u64,
    most_bytes: u64,
}

/// Cameras with long lenses, which ask for the largest maps, in cells of their own; cars drive
/// past, and the cameras move on.
fn shoot(gpu: &Gpu, quality: Quality, rasteriser: Rasteriser, most_bytes: Option<u64>) -> Shots {
    let (assets, car) = common::street();
    let mut renderer = CameraRenderer::with_rasteriser(gpu, quality, rasteriser);
    if let Some(most_bytes) = most_bytes {
        renderer.limit_shadow_bytes(most_bytes);
    }
    let lens = Intrinsics {
        width_px: 64,
        height_px: 48,
        focal_px: 310.0,
    };
    let mut views: Vec<View> = (0..N_CAMERAS)
        .map(|_| View::new(gpu, ViewSpec::pinhole(lens)))
        .collect();
    let mut pictures: Vec<Vec<Vec<u8>>> = views
        .iter()
        .map(|view| vec![vec![0; view.payload_bytes(Modality::Rgb)]; N_STEPS as usize])
        .collect();
    let mut most = 0;
    let before = gpu.counters().counts();
    for step in 0..N_STEPS {
        let cars = (0..N_CAMERAS).map(|i| {
            common::moving(
                5 + i as u32,
                car,
                common::pose(-70.0 + 33.0 * i as f64 + step as f64, 0.0, 0.0, [0.0; 3]),
            )
        });
        let scene = common::scene(&assets, cars.collect(), (step + 1) * 50_000_000);
        let jobs = views
            .iter_mut()
            .zip(&mut pictures)
            .enumerate()
            .map(|(i, (view, pictures))| {
                let world_from_sensor = common::pose(
                    -80.0 + 33.0 * i as f64 + 2.0 * step as f64,
                    -1.0,
                    2.5,
                    [0.0, 12.0, 6.0],
                );
                let place = Place::Memory(&mut pictures[step as usize]);
                ViewJob {
                    view,
                    world_from_sensor,
                    outputs: vec![Output {
                        modality: Modality::Rgb,
                        place,
                    }],
                }
            });
        renderer
            .render(&scene, jobs.collect())
            .unwrap()
            .wait()
            .unwrap();
        most = most.max(renderer.shadow_bytes());
    }
    let n_submissions = gpu.counters().counts().since(before).submissions;
    Shots {
        pictures: pictures.concat(),
        n_submissions,
        most_bytes: most,
    }
}

/// Oracle: the same cameras with room for all their maps.
#[test]
fn cameras_whose_maps_do_not_fit_get_the_same_pictures() {
    let gpu = common::gpu();
    const MIB: u64 = 1 << 20;
    // Room for two of the largest maps where five are needed. Drawn: 16 MiB each, and as much for
    // smaller ones; computed: 64 MiB a near and 32 MiB a far one.
    for (quality, rasteriser, most_bytes) in [
        (Quality::Low, Rasteriser::Drawn, 64 * MIB),
        (Quality::High, Rasteriser::Computed, 192 * MIB),
    ] {
        let free = shoot(&gpu, quality, rasteriser, None);
        assert!(
            free.most_bytes > most_bytes,
            "{quality:?}: {} bytes are no test",
            free.most_bytes
        );
        let limited = shoot(&gpu, quality, rasteriser, Some(most_bytes));
        assert!(
            limited.most_bytes <= most_bytes,
            "{quality:?}: {} bytes of {most_bytes}",
            limited.most_bytes
        );
        assert!(
            limited.pictures == free.pictures,
            "{quality:?}: memory shows in the pictures"
        );
        assert_eq!(free.n_submissions, N_STEPS);
        assert!(
            limited.n_submissions > N_STEPS,
            "{quality:?}: all maps fitted"
        );
        assert!(
            limited
                .pictures
                .iter()
                .any(|picture| picture.chunks(4).any(|pixel| pixel != &picture[..4]))
        );
    }
}

/// Even with the smallest limit every camera gets its light.
#[test]
fn a_single_map_is_enough() {
    let gpu = common::gpu();
    let free = shoot(&gpu, Quality::Low, Rasteriser::Drawn, None);
    let least = shoot(&gpu, Quality::Low, Rasteriser::Drawn, Some(0));
    assert!(least.pictures == free.pictures);
    assert_eq!(least.most_bytes, 16 << 20);
}
