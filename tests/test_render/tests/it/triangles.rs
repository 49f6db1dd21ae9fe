//! The budget of a street view at quality `low`: 60 000 triangles with sixty vehicles and their
//! moving shadows, as the renderer counts.

use schema_frames::Modality;
use schema_frames::document::Weather;
use sensor_camera::{CameraRenderer, Output, Place, Quality, View, ViewJob, ViewSpec};
use sensor_gpu::{Gpu, GpuOptions};
use sensor_spec::Intrinsics;
use simd_town::Town;
use test_render::Stage;

const BUDGET: u64 = 60_000;
/// Number of viewpoints in each town, evenly spread over its spawn points, and the distances along
/// the lane from each, metres.
const N_PLACES: usize = 48;
const ALONG_M: [f64; 2] = [0.0, 7.0];

#[test]
fn every_street_view_stays_within_the_budget() {
    let gpu = Gpu::open(&GpuOptions::default()).unwrap();
    let mut over = Vec::new();
    for name in Town::NAMES {
        let stage = Stage::new(name, 7, 60).unwrap();
        let mut renderer = CameraRenderer::new(&gpu, Quality::Low);
        let mut view = View::new(
            &gpu,
            ViewSpec::pinhole(Intrinsics::from_fov(160, 120, 90f64.to_radians())),
        );
        let mut bytes = vec![0; view.payload_bytes(Modality::Rgb)];
        let scene = stage.scene(Weather::default());
        let mut counts = Vec::new();
        for k in 0..N_PLACES.min(stage.places.len()) {
            let place = k * stage.places.len() / N_PLACES.min(stage.places.len());
            for along_m in ALONG_M {
                let world_from_sensor = stage.camera(place, along_m, 0.0, 1.0);
                let mut n = 0;
                // The second frame reuses the shadow map of static scenery.
                for _ in 0..2 {
                    let before = gpu.counters().counts().triangles;
                    let outputs = vec![Output {
                        modality: Modality::Rgb,
                        place: Place::Memory(&mut bytes),
                    }];
                    let job = ViewJob {
                        view: &mut view,
                        world_from_sensor,
                        outputs,
                    };
                    renderer.render(&scene, vec![job]).unwrap().wait().unwrap();
                    n = gpu.counters().counts().triangles - before;
                }
                counts.push(n);
                if n > BUDGET {
                    over.push((name, place, along_m, n));
                }
            }
        }
        counts.sort_unstable();
        println!(
            "{name}: median {}, most {}, from {} places",
            counts[counts.len() / 2],
            counts[counts.len() - 1],
            counts.len()
        );
        assert!(counts[0] > 500, "{name}: a view shows hardly anything");
    }
    assert!(
        over.is_empty(),
        "(town, place, metres ahead, triangles): {over:?}"
    );
}
