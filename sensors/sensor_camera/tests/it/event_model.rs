//! The event camera's model on hand-made images: counts, times and noise against the published
//! formulas, which are computed here independently.

use schema_frames::DvsEvent;
use sensor_camera::dvs::{EventCamera, EventImages, Rows};
use sensor_spec::{DvsMode, DvsSpec};

const WIDTH: usize = 200;
const HEIGHT: usize = 100;
const N: usize = WIDTH * HEIGHT;
const WINDOW_NANOS: u64 = 50_000_000;

/// Feeds images without motion that change only in brightness; returns the events of each window.
fn feed(spec: DvsSpec, sensor: u64, pictures: &[Vec<f32>]) -> Vec<Vec<DvsEvent>> {
    let spec = DvsSpec {
        max_events: 10_000_000,
        ..spec
    };
    let mut camera = EventCamera::new(spec.clone(), [WIDTH as u32, HEIGHT as u32], 5, sensor);
    let mut out = vec![0; 16 * spec.max_events as usize];
    let (flow, ids) = (vec![0; 8 * N], vec![7; 4 * N]);
    let depth: Vec<u8> = (0..N).flat_map(|_| 10f32.to_le_bytes()).collect();
    let mut windows = Vec::new();
    for (i, picture) in pictures.iter().enumerate() {
        let luminance: Vec<u8> = picture.iter().flat_map(|x| x.to_le_bytes()).collect();
        let images = EventImages {
            luminance: Rows::tight(&luminance, 4 * WIDTH),
            flow: Rows::tight(&flow, 8 * WIDTH),
            depth: Rows::tight(&depth, 4 * WIDTH),
            instance: Rows::tight(&ids, 4 * WIDTH),
            class: Rows::tight(&ids[..N], WIDTH),
        };
        let made = camera.advance(&images, WINDOW_NANOS, &mut out);
        assert_eq!((made.first, made.n_dropped), (i == 0, 0));
        let events: Vec<DvsEvent> = bytemuck::cast_slice(&out[..16 * made.n_events]).to_vec();
        assert!(events.is_sorted_by_key(|e| (e.nanos_in_window, e.y_px, e.x_px)));
        assert!(events.iter().all(|e| e.object_id == 0x0707_0707
            && e.class == 7
            && e.nanos_in_window as u64 <= WINDOW_NANOS));
        if i > 0 {
            windows.push(events);
        }
    }
    windows
}

fn noise(seed: u64) -> Vec<f32> {
    let mut rng = fastrand::Rng::with_seed(seed);
    (0..N).map(|_| 0.02 + 0.9 * rng.f32()).collect()
}

/// The interpolating simulator as published (ESIM, and CARLA's), one pixel at a time in `f64`:
/// (pixel, nanos, polarity).
fn reference_events(
    levels: &[Vec<f64>],
    up: f64,
    down: f64,
    refractory: f64,
) -> Vec<Vec<(usize, f64, u8)>> {
    let mut windows = vec![Vec::new(); levels.len() - 1];
    for pixel in 0..N {
        let (mut reference, mut last) = (levels[0][pixel], f64::NEG_INFINITY);
        for (window, pair) in levels.windows(2).enumerate() {
            let (before, after) = (pair[0][pixel], pair[1][pixel]);
            let (step, polarity) = if after > before { (up, 1) } else { (-down, 0) };
            while (after - (reference + step)) * step.signum() >= 0.0 && after != before {
                reference += step;
                let share = ((reference - before) / (after - before)).clamp(0.0, 1.0);
                let at = (window as f64 + share) * WINDOW_NANOS as f64;
                if at >= last + refractory {
                    windows[window].push((
                        pixel,
                        at - window as f64 * WINDOW_NANOS as f64,
                        polarity,
                    ));
                    last = at;
                }
            }
        }
    }
    windows
}

/// The events agree except for crossings within a rounding error of a threshold.
fn check_against_reference(found: &[Vec<DvsEvent>], expected: &[Vec<(usize, f64, u8)>]) {
    for (found, expected) in found.iter().zip(expected) {
        let mut found: Vec<(usize, u32, u8)> = found
            .iter()
            .map(|e| {
                (
                    e.y_px as usize * WIDTH + e.x_px as usize,
                    e.nanos_in_window,
                    e.polarity,
                )
            })
            .collect();
        found.sort_by_key(|(pixel, nanos, _)| (*pixel, *nanos));
        assert!(expected.len() > 1000, "{} events", expected.len());
        assert!(
            found.len().abs_diff(expected.len()) <= 2 + expected.len() / 2000,
            "{} instead of {}",
            found.len(),
            expected.len()
        );
        if found.len() == expected.len() {
            for (a, b) in found.iter().zip(expected) {
                assert_eq!((a.0, a.2), (b.0, b.2));
                assert!(
                    (a.1 as f64 - b.1).abs() < 2e-5 * WINDOW_NANOS as f64,
                    "{a:?} {b:?}"
                );
            }
        }
    }
}

fn pictures() -> Vec<Vec<f32>> {
    vec![noise(1), noise(2), noise(3)]
}

#[test]
fn a_picture_that_changes_in_place_gives_the_published_models_events() {
    let levels: Vec<Vec<f64>> = pictures()
        .iter()
        .map(|p| p.iter().map(|x| (*x as f64 + 0.001).ln()).collect())
        .collect();
    let spec = DvsSpec {
        positive_threshold: 0.31,
        negative_threshold: 0.23,
        ..Default::default()
    };
    check_against_reference(
        &feed(spec.clone(), 1, &pictures()),
        &reference_events(&levels, 0.31, 0.23, 0.0),
    );
    let spec = DvsSpec {
        refractory_nanos: 12_345_678,
        ..spec
    };
    check_against_reference(
        &feed(spec, 1, &pictures()),
        &reference_events(&levels, 0.31, 0.23, 12_345_678.0),
    );
}

#[test]
fn linear_mode_counts_grey_levels() {
    let levels: Vec<Vec<f64>> = pictures()
        .iter()
        .map(|p| p.iter().map(|x| 255.0 * *x as f64).collect())
        .collect();
    let spec = DvsSpec {
        use_log: false,
        positive_threshold: 20.3,
        negative_threshold: 31.7,
        ..Default::default()
    };
    check_against_reference(
        &feed(spec, 1, &pictures()),
        &reference_events(&levels, 20.3, 31.7, 0.0),
    );
}

#[test]
fn two_frame_mode_looks_at_encoded_colours_as_carla_does() {
    let encoded = |x: f64| {
        if x <= 0.0031308 {
            12.92 * x
        } else {
            1.055 * x.powf(1.0 / 2.4) - 0.055
        }
    };
    let levels: Vec<Vec<f64>> = pictures()
        .iter()
        .map(|p| {
            p.iter()
                .map(|x| (encoded(*x as f64) + 0.001).ln())
                .collect()
        })
        .collect();
    let spec = DvsSpec {
        mode: DvsMode::TwoFrame,
        ..Default::default()
    };
    check_against_reference(
        &feed(spec, 1, &pictures()),
        &reference_events(&levels, 0.3f32 as f64, 0.3f32 as f64, 0.0),
    );
}

#[test]
fn a_still_picture_is_silent_without_chance() {
    for mode in [DvsMode::Motion, DvsMode::TwoFrame] {
        let spec = DvsSpec {
            mode,
            threshold_mismatch_stddev: 0.05,
            sigma_positive_threshold: 0.05,
            ..Default::default()
        };
        assert!(feed(spec, 1, &vec![noise(1); 4]).iter().all(Vec::is_empty));
    }
}

/// v2e: a pixel leaks ON events at the leak rate, whatever it sees; the phases of pixels differ.
#[test]
fn leaks_come_at_their_rate_and_not_in_step() {
    let spec = DvsSpec {
        leak_rate_hz: 30.0,
        ..Default::default()
    };
    let windows = feed(spec, 1, &vec![noise(1); 9]);
    let n: usize = windows.iter().map(Vec::len).sum();
    let expected = N as f64 * 30.0 * 8.0 * 0.05;
    assert!(
        (n as f64 / expected - 1.0).abs() < 0.01,
        "{n} instead of {expected}"
    );
    assert!(windows.iter().flatten().all(|e| e.polarity == 1));
    // Times fill the window evenly: each tenth has a tenth, within five standard errors.
    for tenth in 0..10 {
        let share = windows[3]
            .iter()
            .filter(|e| e.nanos_in_window as u64 * 10 / WINDOW_NANOS == tenth)
            .count() as f64
            / windows[3].len() as f64;
        assert!(
            (share - 0.1).abs() < 5.0 * (0.09 / windows[3].len() as f64).sqrt(),
            "{share}"
        );
    }
}

/// v2e: shot noise is Poisson with the rate times ((0.25 − 1)·I + 1), half of it for each polarity.
#[test]
fn shot_noise_has_v2es_rate_in_dark_and_in_light() {
    let spec = DvsSpec {
        shot_noise_rate_hz: 5.0,
        ..Default::default()
    };
    for light in [0.0f32, 0.4, 1.0] {
        let windows = feed(spec.clone(), 1, &vec![vec![light; N]; 5]);
        let n: usize = windows.iter().map(Vec::len).sum();
        let expected = N as f64 * 5.0 * 4.0 * 0.05 * ((0.25 - 1.0) * light as f64 + 1.0);
        assert!(
            (n as f64 - expected).abs() < 5.0 * expected.sqrt(),
            "{n} instead of {expected} at {light}"
        );
        let on = windows.iter().flatten().filter(|e| e.polarity == 1).count() as f64;
        assert!(
            (on - 0.5 * n as f64).abs() < 5.0 * (0.25 * n as f64).sqrt(),
            "{on} of {n}"
        );
    }
    assert_eq!(
        feed(spec.clone(), 1, &vec![noise(1); 3]),
        feed(spec.clone(), 1, &vec![noise(1); 3])
    );
    assert_ne!(
        feed(spec.clone(), 1, &vec![noise(1); 3]),
        feed(spec, 2, &vec![noise(1); 3])
    );
}

/// A rise of just the nominal threshold makes an event at the pixels whose own threshold lies
/// below: half of them.
#[test]
fn mismatch_and_spread_move_thresholds_by_their_deviation() {
    let rise = |by: f32| vec![vec![0.2; N], vec![(0.2f32 + 0.001) * by.exp() - 0.001; N]];
    let share = |spec: DvsSpec, by: f32| feed(spec, 1, &rise(by))[0].len() as f64 / N as f64;
    let mismatch = DvsSpec {
        threshold_mismatch_stddev: 0.03,
        ..Default::default()
    };
    let spread = DvsSpec {
        sigma_positive_threshold: 0.03,
        ..Default::default()
    };
    for spec in [mismatch, spread] {
        // Normal distribution function at −1, 0, 1; five standard errors.
        for (by, expected) in [(0.27, 0.1587), (0.3, 0.5), (0.33, 0.8413)] {
            let found = share(spec.clone(), by);
            assert!(
                (found - expected).abs() < 5.0 * (0.25 / N as f64).sqrt(),
                "{found} instead of {expected}"
            );
        }
    }
}
