//! Frames that the copy queue copies while the next ones are drawn equal those that are copied
//! after their own drawing, while cameras come and go.
//!
//! `Apart` does on one queue what `Beside` does on two, so lifetimes and bookkeeping are tested on
//! every adapter. Where an adapter has two queues, both ways are tested.

#![expect(
    unsafe_code,
    reason = "targets are raw memory; each block carries its proof"
)]

use crate::common;

use std::collections::VecDeque;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::Arc;

use schema_frames::Modality;
use sensor_camera::{
    CameraRenderer, Output, Quality, Rasteriser, Submission, View, ViewJob, ViewSpec,
};
use sensor_core::{MeshId, Scene, SceneAssets};
use sensor_gpu::{CopyPath, Gpu, GpuOptions, ShmTarget};
use sensor_spec::{ExposureMode, Intrinsics};

const SIX: [Modality; 6] = [
    Modality::Rgb,
    Modality::Depth,
    Modality::Semantic,
    Modality::Instance,
    Modality::Flow,
    Modality::Normals,
];

fn open(copies: CopyPath) -> Gpu {
    Gpu::open(&GpuOptions {
        copies,
        ..Default::default()
    })
    .unwrap_or_else(|error| panic!("{error}"))
}

/// Devices that copy while they draw.
fn gpus() -> Vec<Gpu> {
    [CopyPath::Apart, CopyPath::Beside]
        .map(open)
        .into_iter()
        .filter(Gpu::copies_beside)
        .collect()
}

/// Page-aligned memory that lives as long as the test process, as a segment does as long as its
/// publisher.
fn segment(n_bytes: usize) -> (*mut u8, usize) {
    const PAGE: usize = 1 << 16;
    let len = n_bytes.next_multiple_of(PAGE);
    let memory: &'static mut [u8] = vec![0u8; len + PAGE].leak();
    let aligned = memory.as_ptr().align_offset(PAGE);
    (memory[aligned..aligned + len].as_mut_ptr(), len)
}

/// The modalities of a camera in a step; they vary.
fn asked(number: usize, step: u64) -> Vec<Modality> {
    match (number, step % 4) {
        (0, _) => SIX.to_vec(),
        (1, 0) => vec![Modality::Depth],
        (1, 1) => vec![],
        (1, _) => vec![Modality::Depth, Modality::Instance, Modality::Normals],
        (2, 3) => SIX[..4].to_vec(),
        (2, _) => vec![Modality::Rgb],
        _ => vec![Modality::Rgb, Modality::Dvs],
    }
}

fn view(gpu: &Gpu, number: usize, scale: u32) -> View {
    let [width, height] = [[80, 60], [64, 48], [64, 48], [40, 40]][number].map(|side| side * scale);
    let lens = Intrinsics::from_fov(width, height, 90f64.to_radians());
    let mut spec = ViewSpec {
        sensor_id: number as u32,
        ..ViewSpec::pinhole(lens)
    };
    if number == 3 {
        spec.optics.exposure.mode = ExposureMode::Histogram;
    }
    View::new(gpu, spec)
}

fn scene(assets: &Arc<SceneAssets>, car: MeshId, step: u64) -> Scene {
    let turn = (step % 40) as f64;
    let pose = |i: f64| {
        common::pose(
            6.0 + 9.0 * i + 0.3 * turn,
            1.8 - i,
            0.0,
            [0.0, 0.0, 9.0 * turn],
        )
    };
    common::scene(
        assets,
        (0..4u32)
            .map(|i| common::moving(5 + i, car, pose(i as f64)))
            .collect(),
        step * 50_000_000,
    )
}

/// Hashes of all frames, in order, with `n_in_flight` submissions in flight.
fn film(gpu: &Gpu, quality: Quality, rasteriser: Rasteriser, n_in_flight: usize) -> Vec<u64> {
    let (scale, n_steps) = if gpu.is_software() { (1, 10) } else { (8, 300) };
    let (assets, car) = common::street();
    let mut renderer = CameraRenderer::with_rasteriser(gpu, quality, rasteriser);
    let mut views: Vec<View> = (0..4).map(|number| view(gpu, number, scale)).collect();
    let room = |view: &View| {
        SIX.iter()
            .chain(&[Modality::Dvs])
            .map(|m| view.payload_bytes(*m).next_multiple_of(64))
            .sum::<usize>()
    };
    let step_bytes: usize = views.iter().map(room).sum();
    let (base, len) = segment(step_bytes * n_in_flight);
    // SAFETY: the segment is leaked, and each range is looked at only when its submission was
    // waited for.
    let target = Arc::new(unsafe { ShmTarget::import(gpu, base, len, ()) });
    assert_eq!(target.cpu_copies(), 0);
    let mut hashes = Vec::new();
    let mut take = |(submission, offsets): (Submission<'static>, Vec<usize>)| {
        let results = submission.wait().unwrap();
        for (result, begin) in results
            .iter()
            .flat_map(|result| &result.outputs)
            .zip(offsets)
        {
            // SAFETY: leaked, and the submission that writes to this range is done.
            let bytes = unsafe { std::slice::from_raw_parts_mut(base.add(begin), result.n_bytes) };
            let mut hasher = DefaultHasher::new();
            (result.modality as u32, &*bytes).hash(&mut hasher);
            hashes.push(hasher.finish());
            bytes.fill(0xa5);
        }
    };
    let mut on_their_way: Vec<(Submission<'static>, Vec<usize>)> = Vec::new();
    for step in 1..=n_steps {
        // In bursts, because looking at a frame takes longer than drawing it.
        if on_their_way.len() == n_in_flight {
            on_their_way.drain(..).for_each(&mut take);
        }
        let (mut next, mut offsets, mut jobs) = (
            (step as usize % n_in_flight) * step_bytes,
            Vec::new(),
            Vec::new(),
        );
        for (number, view) in views.iter_mut().enumerate() {
            let mut outputs = Vec::new();
            for modality in asked(number, step) {
                let capacity_bytes = view.payload_bytes(modality);
                // SAFETY: ranges of a leaked segment that do not overlap, and are looked at after the wait.
                let place = unsafe { target.place(next, capacity_bytes) };
                outputs.push(Output { modality, place });
                offsets.push(next);
                next += capacity_bytes.next_multiple_of(64);
            }
            let world_from_sensor = common::pose(
                -3.0 * number as f64 + 0.05 * step as f64,
                0.3,
                1.6,
                [0.0, 2.0, 2.0 * step as f64],
            );
            jobs.push(ViewJob {
                view,
                world_from_sensor,
                outputs,
            });
        }
        on_their_way.push((
            renderer.render(&scene(&assets, car, step), jobs).unwrap(),
            offsets,
        ));
    }
    on_their_way.into_iter().for_each(&mut take);
    hashes
}

/// Oracle: one submission at a time, copied after its drawing.
#[test]
fn frames_do_not_show_how_they_were_copied() {
    let plain = open(CopyPath::Behind);
    assert!(!plain.copies_beside());
    for rasteriser in common::rasterisers(&plain) {
        for quality in [Quality::Low, Quality::High] {
            let expected = film(&plain, quality, rasteriser, 1);
            assert!(expected.windows(2).any(|pair| pair[0] != pair[1]));
            for gpu in gpus() {
                for n_in_flight in if gpu.is_software() { 5..=5 } else { 2..=6 } {
                    let wrong = film(&gpu, quality, rasteriser, n_in_flight)
                        .iter()
                        .zip(&expected)
                        .filter(|(a, b)| a != b)
                        .count();
                    assert_eq!(
                        wrong, 0,
                        "{gpu:?}: {rasteriser:?}, {quality:?}, {n_in_flight} in flight: frames that differ"
                    );
                }
            }
        }
    }
}

/// Cameras of all sizes are made and dropped while their frames are in flight; their textures are
/// freed with them.
#[test]
fn cameras_come_and_go_under_way() {
    let (assets, car) = common::street();
    for gpu in gpus() {
        let n_rounds = if gpu.is_software() { 25 } else { 1500 };
        let mut renderer = CameraRenderer::new(&gpu, Quality::default_for(&gpu));
        let mut dice = fastrand::Rng::with_seed(5);
        let (base, len) = segment(2 * 4 * 29 * 130 * 100);
        // SAFETY: the segment is leaked and nobody looks at it.
        let target = Arc::new(unsafe { ShmTarget::import(&gpu, base, len, ()) });
        let mut under_way: VecDeque<Submission<'static>> = VecDeque::new();
        for round in 1..=n_rounds {
            let lens = |dice: &mut fastrand::Rng| {
                Intrinsics::from_fov(dice.u32(1..130), dice.u32(1..100), 1.2)
            };
            let mut views: Vec<View> = (0..dice.usize(1..5))
                .map(|_| View::new(&gpu, ViewSpec::pinhole(lens(&mut dice))))
                .collect();
            for part in 0..2 {
                let mut next = part * len / 2;
                let mut jobs = Vec::new();
                for view in &mut views {
                    let mut outputs = Vec::new();
                    for modality in SIX {
                        let capacity_bytes = view.payload_bytes(modality);
                        if dice.bool() {
                            outputs.push(Output {
                                modality,
                                // SAFETY: ranges of a leaked segment that do not overlap, and are looked at after the wait.
                                place: unsafe { target.place(next, capacity_bytes) },
                            });
                            next += capacity_bytes.next_multiple_of(64);
                        }
                    }
                    jobs.push(ViewJob {
                        view,
                        world_from_sensor: common::pose(0.1 * round as f64, 0.0, 1.5, [0.0; 3]),
                        outputs,
                    });
                }
                under_way.push_back(
                    renderer
                        .render(&scene(&assets, car, 2 * round + part as u64), jobs)
                        .unwrap(),
                );
            }
            // The submission is waited for, dropped, or left in flight after its views are gone.
            match dice.u8(0..3) {
                0 => under_way
                    .drain(..)
                    .for_each(|submission| drop(submission.wait().unwrap())),
                1 => under_way.clear(),
                _ => drop(under_way.pop_front()),
            }
            while under_way.len() > 4 {
                drop(under_way.pop_front());
            }
        }
        drop((under_way, renderer));
        gpu.submit([]);
        gpu.wait_idle();
        assert_eq!(gpu.n_shared_textures(), 0);
    }
}
