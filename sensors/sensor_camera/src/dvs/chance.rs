//! Noise of an event camera: thresholds that vary, and shot noise.
//!
//! Shot noise is a Poisson process per pixel whose rate falls with the light: Hu, Liu, Delbruck,
//! *v2e: From Video Frames to Realistic DVS Events* (2021), section 3; each polarity has half of
//! the rate. Shot noise is added to the events that the pixel sees, and does not change its
//! reference.

use rayon::prelude::*;
use schema_types::noise::Noise;
use sensor_spec::DvsSpec;

/// Noise streams, separate from a sensor's other noise.
const MISMATCH_STREAM: u64 = 0x6476_735f_7468_7265;
const PHASE_STREAM: u64 = 0x6476_735f_7068_6173;
const SIGMA_STREAM: u64 = 0x6476_735f_7369_676d;
const SHOT_STREAM: u64 = 0x6476_735f_7368_6f74;
/// Mismatch does not lower a threshold below this share of its nominal value.
const MIN_MISMATCH: f64 = 0.1;
/// The spread from window to window does not lower it below this (CARLA's bound).
const MIN_THRESHOLD: f32 = 0.01;
/// Share of the shot noise's rate that remains in full light.
const RATE_IN_LIGHT: f64 = 0.25;

/// Source of an event camera's noise.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chance {
    seed: u64,
    stream: u64,
}

impl Chance {
    /// The noise of a sensor in a run with this seed.
    pub fn of_camera(spec: &DvsSpec, seed: u64, sensor: u64) -> Self {
        Chance {
            seed,
            stream: sensor ^ schema_types::noise::mix(spec.noise_seed),
        }
    }

    /// Factor of both thresholds per pixel; empty without mismatch.
    pub fn mismatch(&self, spec: &DvsSpec, n_pixels: usize) -> Vec<f32> {
        let noise = Noise::new(self.seed, self.stream ^ MISMATCH_STREAM, 0);
        let relative = spec.threshold_mismatch_stddev as f64
            / (0.5 * (spec.positive_threshold + spec.negative_threshold)) as f64;
        let factor =
            |pixel: usize| (1.0 + relative * noise.gaussian(pixel as u64)).max(MIN_MISMATCH) as f32;
        if relative > 0.0 {
            (0..n_pixels).into_par_iter().map(factor).collect()
        } else {
            Vec::new()
        }
    }

    /// How far a pixel has leaked towards its next event at the start, 0 to 1, so that pixels do
    /// not leak in step.
    pub fn phase(&self, pixel: usize) -> f32 {
        Noise::new(self.seed, self.stream ^ PHASE_STREAM, 0).uniform(pixel as u64) as f32
    }

    /// Thresholds `[up, down]` of a pixel in the window number `window`; nominal ones without
    /// spread.
    pub fn thresholds(&self, spec: &DvsSpec, window: u64, pixel: usize) -> [f32; 2] {
        let noise = Noise::new(self.seed, self.stream ^ SIGMA_STREAM, window);
        let draw = |nominal: f32, sigma: f32, sample: u64| {
            if sigma > 0.0 {
                (nominal + sigma * noise.gaussian(sample) as f32).max(MIN_THRESHOLD)
            } else {
                nominal
            }
        };
        let pixel = pixel as u64;
        [
            draw(
                spec.positive_threshold,
                spec.sigma_positive_threshold,
                2 * pixel,
            ),
            draw(
                spec.negative_threshold,
                spec.sigma_negative_threshold,
                2 * pixel + 1,
            ),
        ]
    }

    /// Calls `event(pixel, nanos_in_window, polarity)` for each event of shot noise; `light(pixel)`
    /// is its luminance, 0 to 1.
    ///
    /// The windows of all pixels form one long time line, so that a single chain of waiting times
    /// serves them all.
    pub fn shots(
        &self,
        spec: &DvsSpec,
        window: u64,
        window_nanos: u64,
        n_pixels: usize,
        light: impl Fn(usize) -> f32,
        mut event: impl FnMut(usize, u32, u8),
    ) {
        let rate_per_nano = spec.shot_noise_rate_hz as f64 * 1e-9;
        if rate_per_nano <= 0.0 || window_nanos == 0 {
            return;
        }
        let noise = Noise::new(self.seed, self.stream ^ SHOT_STREAM, window);
        let mut at_nanos = 0.0_f64;
        for shot in 0.. {
            at_nanos -= (1.0 - noise.uniform(3 * shot)).ln() / rate_per_nano;
            let pixel = (at_nanos / window_nanos as f64) as usize;
            if pixel >= n_pixels {
                return;
            }
            let kept = 1.0 - (1.0 - RATE_IN_LIGHT) * light(pixel).clamp(0.0, 1.0) as f64;
            if noise.uniform(3 * shot + 1) < kept {
                let nanos = (at_nanos - pixel as f64 * window_nanos as f64) as u32;
                event(pixel, nanos, (noise.uniform(3 * shot + 2) < 0.5) as u8);
            }
        }
    }
}
