//! Settings of the event camera: thresholds, noise, limits.

use serde::{Deserialize, Serialize};

use crate::check::{SpecError, check_range};

/// How brightness is interpolated between two firings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DvsMode {
    /// Along the motion field: an event has the time at which the edge crosses the pixel.
    #[default]
    Motion,
    /// Linearly at each pixel, from one image to the next: CARLA's model.
    TwoFrame,
}

/// Event camera: a pixel makes an event whenever its level has changed by a threshold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DvsSpec {
    /// How brightness is interpolated between two firings.
    pub mode: DvsMode,
    /// Rise of the level per event.
    pub positive_threshold: f32,
    /// Fall of the level per event.
    pub negative_threshold: f32,
    /// Standard deviation of the thresholds from pixel to pixel.
    pub threshold_mismatch_stddev: f32,
    /// Standard deviation of the positive threshold, drawn anew for each pixel and window.
    pub sigma_positive_threshold: f32,
    /// The same for the negative threshold.
    pub sigma_negative_threshold: f32,
    /// Time after an event in which a pixel makes no other, nanoseconds.
    pub refractory_nanos: u32,
    /// Level is ln(luminance + `log_eps`) with luminance 0..=1; otherwise 255 · luminance.
    pub use_log: bool,
    /// Added to luminance (0..=1) before the logarithm.
    pub log_eps: f32,
    /// Events of rising brightness per second and pixel that occur without any change.
    pub leak_rate_hz: f32,
    /// Random events per second and pixel, of either polarity, in the dark; a quarter of that in
    /// full light.
    pub shot_noise_rate_hz: f32,
    /// Longest way of a point over the image between two samples of its brightness, pixels.
    pub substep_px: f32,
    /// Largest number of events in one frame; later ones are dropped and counted. 0 stands for one
    /// per pixel, at least 4096.
    pub max_events: u32,
    /// Tells the noise of otherwise equal event cameras apart.
    pub noise_seed: u64,
}

impl Default for DvsSpec {
    fn default() -> Self {
        DvsSpec {
            mode: DvsMode::Motion,
            positive_threshold: 0.3,
            negative_threshold: 0.3,
            threshold_mismatch_stddev: 0.0,
            sigma_positive_threshold: 0.0,
            sigma_negative_threshold: 0.0,
            refractory_nanos: 0,
            use_log: true,
            log_eps: 0.001,
            leak_rate_hz: 0.0,
            shot_noise_rate_hz: 0.0,
            substep_px: 1.0,
            max_events: 0,
            noise_seed: 0,
        }
    }
}

impl DvsSpec {
    /// Largest number of events in one frame of an image of this size.
    pub fn max_events_of(&self, width_px: u32, height_px: u32) -> u32 {
        match self.max_events {
            0 => (width_px * height_px).max(4096),
            n => n,
        }
    }

    pub(crate) fn check(&self, errors: &mut Vec<SpecError>) {
        // Without the logarithm thresholds are grey levels of 255.
        let (least, most) = if self.use_log {
            (0.01, 10.0)
        } else {
            (0.1, 255.0)
        };
        check_range(
            "dvs.positive_threshold",
            self.positive_threshold,
            least,
            most,
            errors,
        );
        check_range(
            "dvs.negative_threshold",
            self.negative_threshold,
            least,
            most,
            errors,
        );
        check_range(
            "dvs.threshold_mismatch_stddev",
            self.threshold_mismatch_stddev,
            0.0,
            most,
            errors,
        );
        check_range(
            "dvs.sigma_positive_threshold",
            self.sigma_positive_threshold,
            0.0,
            most,
            errors,
        );
        check_range(
            "dvs.sigma_negative_threshold",
            self.sigma_negative_threshold,
            0.0,
            most,
            errors,
        );
        check_range(
            "dvs.refractory_nanos",
            self.refractory_nanos,
            0,
            1_000_000_000,
            errors,
        );
        check_range("dvs.log_eps", self.log_eps, 1e-6, 1.0, errors);
        check_range("dvs.leak_rate_hz", self.leak_rate_hz, 0.0, 1000.0, errors);
        check_range(
            "dvs.shot_noise_rate_hz",
            self.shot_noise_rate_hz,
            0.0,
            1000.0,
            errors,
        );
        check_range("dvs.substep_px", self.substep_px, 0.1, 64.0, errors);
        check_range("dvs.max_events", self.max_events, 0, 50_000_000, errors);
    }
}
