//! Events from the GPU against events from the CPU, on the same images: one model, two
//! implementations.

use crate::common;

use std::collections::BTreeMap;

use nalgebra::Isometry3;
use schema_frames::{DvsEvent, Modality};
use sensor_camera::{CameraRenderer, OutputResult, Quality};
use sensor_gpu::Gpu;
use sensor_spec::{DvsMode, DvsSpec};

const SIZE_PX: [u32; 2] = [323, 205];
const TICK_NANOS: u64 = 50_000_000;

/// A drive along the street past a car that crosses it, turning and not; its third window is longer
/// than the others.
fn drive(gpu: &Gpu, dvs: &DvsSpec, on_gpu: bool) -> Vec<(Vec<DvsEvent>, OutputResult)> {
    let mut renderer = CameraRenderer::new(gpu, Quality::Low);
    assert!(
        renderer.set_events_on_gpu(on_gpu),
        "this adapter cannot follow events"
    );
    let mut view = common::view_with(gpu, SIZE_PX[0], SIZE_PX[1], dvs.clone());
    let (assets, car) = common::street();
    let fire = |step: u64| {
        let secs = if step < 3 { step } else { step + 1 };
        let camera: Isometry3<f64> = common::pose(
            0.4 * secs as f64,
            0.0,
            1.5,
            [0.0, 0.0, 1.5 * (step / 2) as f64],
        );
        let car = common::moving(
            4,
            car,
            common::pose(11.0, 3.0 - 0.7 * secs as f64, 0.0, [0.0, 0.0, 90.0]),
        );
        let scene = common::scene(&assets, vec![car], (secs + 1) * TICK_NANOS);
        let frames = common::render(&mut renderer, &scene, &mut view, camera, &[Modality::Dvs]);
        let (bytes, result) = &frames[&Modality::Dvs];
        (
            bytes
                .chunks_exact(16)
                .map(bytemuck::pod_read_unaligned)
                .collect(),
            *result,
        )
    };
    (0..6).map(fire).collect()
}

/// Time, polarity and labels of an event.
type Crossing = (u32, u8, u32, u8);

/// A pixel's events in order of time.
fn by_pixel(events: &[DvsEvent]) -> BTreeMap<(u16, u16), Vec<Crossing>> {
    let mut pixels = BTreeMap::<_, Vec<_>>::new();
    for e in events {
        pixels.entry((e.y_px, e.x_px)).or_default().push((
            e.nanos_in_window,
            e.polarity,
            e.object_id,
            e.class,
        ));
    }
    pixels
}

#[test]
fn the_gpus_events_are_the_processors() {
    let gpu = common::gpu();
    let base = DvsSpec {
        max_events: 2_000_000,
        ..Default::default()
    };
    let specs = [
        base.clone(),
        DvsSpec {
            substep_px: 4.0,
            positive_threshold: 0.15,
            negative_threshold: 0.23,
            ..base.clone()
        },
        DvsSpec {
            refractory_nanos: 4_000_000,
            leak_rate_hz: 20.0,
            threshold_mismatch_stddev: 0.03,
            ..base.clone()
        },
        DvsSpec {
            use_log: false,
            positive_threshold: 12.0,
            negative_threshold: 9.0,
            ..base.clone()
        },
        DvsSpec {
            mode: DvsMode::TwoFrame,
            ..base
        },
    ];
    for spec in specs {
        let (ours, theirs) = (drive(&gpu, &spec, true), drive(&gpu, &spec, false));
        assert!(ours == drive(&gpu, &spec, true), "twice: {spec:?}");
        let (mut n_pixels, mut n_other, mut n_events) = (0, 0, [0, 0]);
        for (firing, ((a, of_a), (b, of_b))) in ours.iter().zip(&theirs).enumerate() {
            assert!(
                a.is_sorted_by_key(|e| (e.nanos_in_window, e.y_px, e.x_px)),
                "firing {firing}: {spec:?}"
            );
            assert_eq!(
                (of_a.first, of_a.window_nanos, of_a.n_dropped),
                (of_b.first, of_b.window_nanos, of_b.n_dropped)
            );
            assert!(a.is_empty() == (firing == 0));
            let (a, b) = (by_pixel(a), by_pixel(b));
            // A level that stops within a rounding error of a threshold crosses it in one
            // implementation only; times differ by a rounding error of their step.
            let alike = |a: &Vec<Crossing>, b: &Vec<Crossing>| {
                a.len() == b.len()
                    && a.iter().zip(b).all(|(a, b)| {
                        a.0.abs_diff(b.0) < 20_000 && (a.1, a.2, a.3) == (b.1, b.2, b.3)
                    })
            };
            n_other += b
                .iter()
                .filter(|(at, events)| !a.get(at).is_some_and(|own| alike(own, events)))
                .count();
            n_other += a.keys().filter(|at| !b.contains_key(at)).count();
            n_pixels += b.len();
            n_events = [
                n_events[0] + a.values().map(Vec::len).sum::<usize>(),
                n_events[1] + b.values().map(Vec::len).sum::<usize>(),
            ];
        }
        assert!(
            n_events[1] > 10_000 && n_other * 300 <= n_pixels,
            "{n_other} of {n_pixels} pixels differ, {n_events:?} events: {spec:?}"
        );
    }
}

/// Cameras whose noise is drawn again in every window use the CPU, and work as well.
#[test]
fn chance_per_window_is_the_processors() {
    let gpu = common::gpu();
    let spec = DvsSpec {
        shot_noise_rate_hz: 3.0,
        sigma_positive_threshold: 0.02,
        max_events: 2_000_000,
        ..Default::default()
    };
    let (asked, not_asked) = (drive(&gpu, &spec, true), drive(&gpu, &spec, false));
    assert!(asked == not_asked && asked[1].0.len() > 1000);
}
