//! Settings of what makes a picture unsharp: motion while the shutter is open, and focus.

use serde::{Deserialize, Serialize};

use crate::check::{SpecError, check_range};
use crate::intrinsics::Intrinsics;

/// Motion blur of `rgb`: every point is smeared along its motion while the shutter is open.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MotionBlurSpec {
    /// How long the shutter is open, seconds; the middle of this time is the frame's. 0: no blur.
    pub shutter_secs: f32,
    /// Longest streak as a share of the image's width.
    pub longest_ratio: f32,
}

impl Default for MotionBlurSpec {
    fn default() -> Self {
        MotionBlurSpec {
            shutter_secs: 0.0,
            longest_ratio: 0.05,
        }
    }
}

impl MotionBlurSpec {
    /// Whether anything is smeared.
    pub fn is_on(&self) -> bool {
        self.shutter_secs > 0.0 && self.longest_ratio > 0.0
    }

    pub(crate) fn check(&self, errors: &mut Vec<SpecError>) {
        for (key, value, low, high) in [
            (
                "optics.motion_blur.shutter_secs",
                self.shutter_secs,
                0.0,
                1.0,
            ),
            (
                "optics.motion_blur.longest_ratio",
                self.longest_ratio,
                0.0,
                0.2,
            ),
        ] {
            check_range(key, value, low, high, errors);
        }
    }
}

/// Depth of field of `rgb`: what is nearer or farther than the focus is unsharp.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FocusSpec {
    /// Distance of what is sharp, metres along the optical axis; 0: a pinhole, everything is sharp.
    pub distance_m: f32,
    /// Focal length over the diameter of the aperture.
    pub fstop: f32,
    /// Width of the film behind the lens, millimetres; with the field of view it gives the focal
    /// length.
    pub sensor_width_mm: f32,
    /// Blades of the diaphragm, which give bright points their shape.
    pub blades: u32,
    /// Least f-number of the lens: there the diaphragm is a circle, and its blades have that
    /// circle's curvature. 0: straight blades.
    pub min_fstop: f32,
    /// Haze: radius of the blur of what is infinitely far, pixels of an image 1920 wide.
    pub haze_px: f32,
    /// Distance at which haze has half of its radius, metres.
    pub haze_half_m: f32,
}

impl Default for FocusSpec {
    fn default() -> Self {
        FocusSpec {
            distance_m: 0.0,
            fstop: 2.8,
            sensor_width_mm: 24.576,
            blades: 5,
            min_fstop: 1.2,
            haze_px: 0.0,
            haze_half_m: 1000.0,
        }
    }
}

impl FocusSpec {
    /// Whether anything is unsharp.
    pub fn is_on(&self) -> bool {
        self.distance_m > 0.0 || self.haze_px > 0.0
    }

    /// Radius of the circle of confusion of what is infinitely far, pixels; 0 for a pinhole. At the
    /// distance d it is this times |1 − focus / d|, by the thin lens.
    pub fn far_radius_px(&self, lens: &Intrinsics) -> f64 {
        if self.distance_m <= 0.0 {
            return 0.0;
        }
        let px_per_mm = lens.width_px as f64 / self.sensor_width_mm as f64;
        let focal_mm = lens.focal_px / px_per_mm;
        // A lens cannot focus nearer than its focal length.
        let focus_mm = (1000.0 * self.distance_m as f64).max(1.01 * focal_mm);
        let diameter_mm = focal_mm * focal_mm / (self.fstop as f64 * (focus_mm - focal_mm));
        0.5 * diameter_mm * px_per_mm
    }

    pub(crate) fn check(&self, errors: &mut Vec<SpecError>) {
        for (key, value, low, high) in [
            ("optics.focus.distance_m", self.distance_m, 0.0, 1e5),
            ("optics.focus.fstop", self.fstop, 0.1, 100.0),
            (
                "optics.focus.sensor_width_mm",
                self.sensor_width_mm,
                0.1,
                1000.0,
            ),
            ("optics.focus.min_fstop", self.min_fstop, 0.0, 100.0),
            ("optics.focus.haze_px", self.haze_px, 0.0, 100.0),
            ("optics.focus.haze_half_m", self.haze_half_m, 1e-3, 1e6),
        ] {
            check_range(key, value, low, high, errors);
        }
        check_range("optics.focus.blades", self.blades, 3, 16, errors);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Oracle: a 50 mm lens at f/2 focused at 2 m blurs infinity to a circle of 0.641 mm (the
    /// hyperfocal formula of any textbook: f² / (N (s − f))).
    #[test]
    fn a_circle_of_confusion_is_the_textbooks() {
        let lens = Intrinsics {
            width_px: 3600,
            height_px: 2400,
            focal_px: 5000.0,
        };
        let focus = FocusSpec {
            distance_m: 2.0,
            fstop: 2.0,
            sensor_width_mm: 36.0,
            ..Default::default()
        };
        let diameter_mm = 2.0 * focus.far_radius_px(&lens) / 100.0;
        assert!(
            (diameter_mm - 2500.0 / (2.0 * 1950.0)).abs() < 1e-9,
            "{diameter_mm}"
        );
    }

    #[test]
    fn defaults_blur_nothing_and_are_allowed() {
        let mut errors = Vec::new();
        MotionBlurSpec::default().check(&mut errors);
        FocusSpec::default().check(&mut errors);
        assert!(errors.is_empty(), "{errors:?}");
        assert!(!MotionBlurSpec::default().is_on() && !FocusSpec::default().is_on());
        FocusSpec {
            blades: 2,
            ..Default::default()
        }
        .check(&mut errors);
        assert_eq!(
            errors[0].to_string(),
            "optics.focus.blades is 2, but must be 3 to 16"
        );
    }
}
