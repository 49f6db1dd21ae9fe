//! The GPU processes the views of a tick together; no view's bytes may depend on the others.

use crate::common;

use std::sync::Arc;

use nalgebra::Isometry3;
use schema_frames::Modality;
use sensor_camera::{CameraRenderer, Output, Place, Quality, Rasteriser, View, ViewJob, ViewSpec};
use sensor_core::{MeshId, Scene, SceneAssets};
use sensor_gpu::Gpu;
use sensor_spec::{ExposureMode, Intrinsics};

const SIX: [Modality; 6] = [
    Modality::Rgb,
    Modality::Depth,
    Modality::Semantic,
    Modality::Instance,
    Modality::Flow,
    Modality::Normals,
];
const N_STEPS: u64 = 4;

/// A camera of a fleet: sizes, lenses, optics and modalities differ, and so do the ticks at which
/// they fire.
struct Camera {
    number: usize,
    asked: Vec<Modality>,
}

impl Camera {
    fn of(number: usize) -> Camera {
        let asked = match number % 4 {
            0 => SIX.to_vec(),
            1 => vec![Modality::Depth, Modality::Instance],
            _ => vec![Modality::Rgb],
        };
        Camera { number, asked }
    }

    fn view(&self, gpu: &Gpu) -> View {
        let [width, height] = [[64, 48], [64, 48], [40, 40]][self.number % 3];
        let lens = Intrinsics::from_fov(
            width,
            height,
            (60.0 + 30.0 * (self.number % 2) as f64).to_radians(),
        );
        let mut spec = ViewSpec {
            sensor_id: self.number as u32,
            ..ViewSpec::pinhole(lens)
        };
        match self.number % 7 {
            5 => spec.optics.exposure.mode = ExposureMode::Histogram,
            6 => spec.optics.bloom_intensity = 0.8,
            _ => {}
        }
        View::new(gpu, spec)
    }

    fn fires_at(&self, step: u64) -> bool {
        self.number < 38 || !step.is_multiple_of(2)
    }

    fn pose(&self, step: u64) -> Isometry3<f64> {
        let x_m = -100.0 + 5.0 * self.number as f64 + 0.4 * step as f64;
        common::pose(
            x_m,
            -2.0 + (self.number % 3) as f64,
            1.5,
            [0.0, 1.0, 11.0 * self.number as f64],
        )
    }
}

fn scene(assets: &Arc<SceneAssets>, car: MeshId, step: u64) -> Scene {
    let car = |i: u64| {
        // Every third stands still.
        let x_m = -90.0
            + 18.0 * i as f64
            + if i.is_multiple_of(3) {
                0.0
            } else {
                0.5 * step as f64
            };
        common::moving(
            5 + i as u32,
            car,
            common::pose(
                x_m,
                if i.is_multiple_of(2) { -2.0 } else { 2.0 },
                0.0,
                [0.0; 3],
            ),
        )
    };
    common::scene(assets, (0..10).map(car).collect(), step * 50_000_000)
}

/// Frames of the last step, per camera and modality.
fn shoot(
    gpu: &Gpu,
    quality: Quality,
    rasteriser: Rasteriser,
    numbers: &[usize],
) -> Vec<Vec<Vec<u8>>> {
    let (assets, car) = common::street();
    let mut renderer = CameraRenderer::with_rasteriser(gpu, quality, rasteriser);
    let cameras: Vec<Camera> = numbers.iter().map(|number| Camera::of(*number)).collect();
    let mut views: Vec<View> = cameras.iter().map(|camera| camera.view(gpu)).collect();
    let bytes = |(camera, view): (&Camera, &View)| {
        camera
            .asked
            .iter()
            .map(|m| vec![0xa5; view.payload_bytes(*m)])
            .collect()
    };
    let mut memory: Vec<Vec<Vec<u8>>> = cameras.iter().zip(&views).map(bytes).collect();
    for step in 1..=N_STEPS {
        let mut jobs = Vec::new();
        for ((camera, view), memory) in cameras
            .iter()
            .zip(&mut views)
            .zip(&mut memory)
            .filter(|((camera, _), _)| camera.fires_at(step))
        {
            let outputs = camera.asked.iter().zip(memory).map(|(m, bytes)| Output {
                modality: *m,
                place: Place::Memory(bytes),
            });
            jobs.push(ViewJob {
                view,
                world_from_sensor: camera.pose(step),
                outputs: outputs.collect(),
            });
        }
        if !jobs.is_empty() {
            renderer
                .render(&scene(&assets, car, step), jobs)
                .unwrap()
                .wait()
                .unwrap();
        }
    }
    memory
}

/// Oracle: a camera by itself. Forty at once give every one of them the bytes that it gets alone,
/// whatever order they come in.
#[test]
fn a_fleet_of_cameras_gets_what_each_would_get_alone() {
    let gpu = common::gpu();
    for rasteriser in common::rasterisers(&gpu) {
        let numbers: Vec<usize> = (0..41).collect();
        let backwards: Vec<usize> = (0..41).rev().collect();
        let together = shoot(&gpu, Quality::Low, rasteriser, &numbers);
        let mut again = shoot(&gpu, Quality::Low, rasteriser, &backwards);
        again.reverse();
        assert!(
            together == again,
            "{rasteriser:?}: the order of cameras shows"
        );
        for number in [0, 1, 5, 6, 14, 31, 40] {
            let alone = shoot(&gpu, Quality::Low, rasteriser, &[number]);
            assert!(
                together[number] == alone[0],
                "{rasteriser:?}: camera {number} sees others"
            );
        }
    }
}

/// The same in high quality, with post-processing and two shadow maps per view, of which small ones
/// share a layer.
#[test]
fn a_fleet_in_high_quality_gets_what_each_would_get_alone() {
    let gpu = common::gpu();
    let rasteriser = Rasteriser::Computed;
    let numbers: Vec<usize> = (0..41).step_by(2).collect();
    let together = shoot(&gpu, Quality::High, rasteriser, &numbers);
    for number in [4, 6, 12, 40] {
        let alone = shoot(&gpu, Quality::High, rasteriser, &[number]);
        assert!(
            together[number / 2] == alone[0],
            "camera {number} sees others"
        );
    }
    assert!(
        together
            .iter()
            .any(|frames| frames[0].iter().any(|byte| *byte != 0xa5))
    );
}
