//! Settings of a camera's lens and of the way from light to colour. Distortion bends every image of
//! a camera alike; all other settings act on colour alone.

use schema_types::Distortion;
use serde::{Deserialize, Serialize};

use crate::blur::{FocusSpec, MotionBlurSpec};
use crate::check::{SpecError, check_range};
use crate::film::{FilmCurve, FilmSpec};

/// Lens and colour processing of a camera. The defaults leave an image as it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OpticsSpec {
    /// How much light becomes white.
    pub exposure: ExposureSpec,
    /// Exponent of the display's curve; a value above 2.2 brightens dark parts.
    pub gamma: f32,
    /// `false`: no film curve, bloom, flare, vignette, blur or automatic exposure; light is clipped
    /// at white.
    pub postprocess: bool,
    /// Colour temperature of light that is shown as white, kelvin; above 6500 the image turns
    /// warmer.
    pub white_kelvin: f32,
    /// Shift towards green (below 0) or magenta (above 0), −1 to 1.
    pub tint: f32,
    /// Strength of the glow around bright parts; 0 is none.
    pub bloom_intensity: f32,
    /// Darkening of the corners: 1 − multiplier · r^falloff, r = 1 in the corner.
    pub vignette_multiplier: f32,
    /// Exponent of the darkening.
    pub vignette_falloff: f32,
    /// Distortion: a pixel at p (−0.5 to 0.5) shows what a pinhole has at p · (1 + k r² + k_cubed
    /// r³), r = |p · distortion_size|. It bends all images of the camera alike.
    pub distortion_k: f32,
    /// Cubic coefficient of the distortion.
    pub distortion_k_cubed: f32,
    /// Scale of r in x and y.
    pub distortion_size: [f32; 2],
    /// Red and blue drift apart towards the rim by this share of half the image's width in percent.
    pub chromatic_aberration: f32,
    /// Distance from the middle (1 is the corner) at which the aberration begins.
    pub chromatic_aberration_start: f32,
    /// Strength of the ghosts that bright light leaves in the lens; 0 is none.
    pub flare_intensity: f32,
    /// Tone curve.
    pub film: FilmSpec,
    /// Motion blur.
    pub motion_blur: MotionBlurSpec,
    /// Depth of field.
    pub focus: FocusSpec,
}

impl Default for OpticsSpec {
    fn default() -> Self {
        OpticsSpec {
            exposure: ExposureSpec::default(),
            gamma: 2.2,
            postprocess: true,
            white_kelvin: 6500.0,
            tint: 0.0,
            bloom_intensity: 0.0,
            vignette_multiplier: 0.0,
            vignette_falloff: 5.0,
            distortion_k: 0.0,
            distortion_k_cubed: 0.0,
            distortion_size: [0.08; 2],
            chromatic_aberration: 0.0,
            chromatic_aberration_start: 0.0,
            flare_intensity: 0.0,
            film: FilmSpec::default(),
            motion_blur: MotionBlurSpec::default(),
            focus: FocusSpec::default(),
        }
    }
}

/// What sets the exposure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ExposureMode {
    /// The weather: bright by day, dim by night, the same for every direction and at once.
    #[default]
    Weather,
    /// Shutter, aperture and sensitivity.
    Manual,
    /// The brightness of the image, adapting over time.
    Histogram,
}

/// Exposure. EV100 is the photographer's: 15 is a street in the sun, 3 one under lamps at night.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ExposureSpec {
    /// What sets it.
    pub mode: ExposureMode,
    /// Brighter by this many stops, in every mode.
    pub compensation_ev: f32,
    /// Manual: one over the exposure time, 1/s.
    pub shutter_per_s: f32,
    /// Manual: sensitivity.
    pub iso: f32,
    /// Manual: aperture.
    pub fstop: f32,
    /// Histogram: never less than this.
    pub min_ev100: f32,
    /// Histogram: never more than this.
    pub max_ev100: f32,
    /// Histogram: how fast it follows into the light, 1/s.
    pub speed_up_per_s: f32,
    /// Histogram: how fast it follows into the dark, 1/s.
    pub speed_down_per_s: f32,
    /// Histogram: the meter's constant K (mean luminance in cd/m² is K · 2^EV100 / 100).
    pub calibration: f32,
}

impl Default for ExposureSpec {
    fn default() -> Self {
        ExposureSpec {
            mode: ExposureMode::Weather,
            compensation_ev: 0.0,
            shutter_per_s: 200.0,
            iso: 100.0,
            fstop: 8.0,
            min_ev100: -4.0,
            max_ev100: 17.0,
            speed_up_per_s: 3.0,
            speed_down_per_s: 1.0,
            calibration: 16.0,
        }
    }
}

impl ExposureSpec {
    /// EV100 of shutter, aperture and sensitivity: log2(N² · 100 / (t · S)).
    pub fn manual_ev100(&self) -> f32 {
        (self.fstop * self.fstop * self.shutter_per_s * 100.0 / self.iso).log2()
    }
}

impl OpticsSpec {
    /// Whether the light of a pinhole image becomes colour as it was shaded, so that there is
    /// nothing to process; a lens may bend it all the same.
    pub fn is_neutral(&self) -> bool {
        let exposure = &self.exposure;
        exposure.mode == ExposureMode::Weather
            && exposure.compensation_ev == 0.0
            && self.gamma == 2.2
            && self.postprocess
            && self.white_kelvin == 6500.0
            && self.tint == 0.0
            && self.bloom_intensity == 0.0
            && self.vignette_multiplier == 0.0
            && self.chromatic_aberration == 0.0
            && self.flare_intensity == 0.0
            && self.film.curve == FilmCurve::Standard
            && !self.is_blurred()
    }

    /// The bend of the lens; `None` if straight lines stay straight.
    pub fn distortion(&self) -> Option<Distortion> {
        let [x, y] = self.distortion_size;
        Distortion::from_array([self.distortion_k, self.distortion_k_cubed, x, y])
    }

    /// Whether motion is smeared.
    pub fn smears_motion(&self) -> bool {
        self.postprocess && self.motion_blur.is_on()
    }

    /// Whether parts of the image are out of focus.
    pub fn has_focus(&self) -> bool {
        self.postprocess && self.focus.is_on()
    }

    /// Whether motion is smeared or parts of the image are out of focus.
    pub fn is_blurred(&self) -> bool {
        self.smears_motion() || self.has_focus()
    }

    pub(crate) fn check(&self, errors: &mut Vec<SpecError>) {
        let exposure = &self.exposure;
        for (key, value, low, high) in [
            ("optics.gamma", self.gamma, 0.1, 10.0),
            ("optics.white_kelvin", self.white_kelvin, 1500.0, 25_000.0),
            ("optics.tint", self.tint, -1.0, 1.0),
            ("optics.bloom_intensity", self.bloom_intensity, 0.0, 100.0),
            (
                "optics.vignette_multiplier",
                self.vignette_multiplier,
                0.0,
                10.0,
            ),
            ("optics.vignette_falloff", self.vignette_falloff, 0.0, 10.0),
            ("optics.distortion_k", self.distortion_k, -10.0, 10.0),
            (
                "optics.distortion_k_cubed",
                self.distortion_k_cubed,
                -10.0,
                10.0,
            ),
            ("optics.distortion_size", self.distortion_size[0], 0.0, 10.0),
            ("optics.distortion_size", self.distortion_size[1], 0.0, 10.0),
            (
                "optics.chromatic_aberration",
                self.chromatic_aberration,
                0.0,
                100.0,
            ),
            (
                "optics.chromatic_aberration_start",
                self.chromatic_aberration_start,
                0.0,
                1.0,
            ),
            ("optics.flare_intensity", self.flare_intensity, 0.0, 100.0),
            (
                "optics.exposure.compensation_ev",
                exposure.compensation_ev,
                -20.0,
                20.0,
            ),
            (
                "optics.exposure.shutter_per_s",
                exposure.shutter_per_s,
                1e-3,
                1e6,
            ),
            ("optics.exposure.iso", exposure.iso, 1.0, 1e6),
            ("optics.exposure.fstop", exposure.fstop, 0.1, 100.0),
            ("optics.exposure.min_ev100", exposure.min_ev100, -20.0, 30.0),
            ("optics.exposure.max_ev100", exposure.max_ev100, -20.0, 30.0),
            (
                "optics.exposure.speed_up_per_s",
                exposure.speed_up_per_s,
                0.0,
                1e3,
            ),
            (
                "optics.exposure.speed_down_per_s",
                exposure.speed_down_per_s,
                0.0,
                1e3,
            ),
            (
                "optics.exposure.calibration",
                exposure.calibration,
                1.0,
                100.0,
            ),
        ] {
            check_range(key, value, low, high, errors);
        }
        self.film.check(errors);
        self.motion_blur.check(errors);
        self.focus.check(errors);
        if exposure.min_ev100 > exposure.max_ev100 {
            errors.push(SpecError {
                key: "optics.exposure.min_ev100",
                value: exposure.min_ev100.to_string(),
                allowed: format!(
                    "must not lie above optics.exposure.max_ev100 {}",
                    exposure.max_ev100
                ),
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sunny sixteen: f/16 at one over the film speed is EV100 15 in the sun (to a tenth).
    #[test]
    fn sunny_sixteen_is_ev_15() {
        let sunny = ExposureSpec {
            fstop: 16.0,
            shutter_per_s: 125.0,
            iso: 100.0,
            ..Default::default()
        };
        assert!(
            (sunny.manual_ev100() - 15.0).abs() < 0.1,
            "{}",
            sunny.manual_ev100()
        );
    }

    #[test]
    fn defaults_are_neutral_and_allowed_and_nan_is_not() {
        let mut errors = Vec::new();
        OpticsSpec::default().check(&mut errors);
        assert!(errors.is_empty() && OpticsSpec::default().is_neutral());
        OpticsSpec {
            gamma: f32::NAN,
            ..Default::default()
        }
        .check(&mut errors);
        assert_eq!(
            errors[0].to_string(),
            "optics.gamma is NaN, but must be 0.1 to 10"
        );
    }
}
