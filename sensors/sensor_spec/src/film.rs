//! Settings of the tone curve: from light to the brightness of a picture.

use serde::{Deserialize, Serialize};

use crate::check::{SpecError, check_range};

/// Which tone curve.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FilmCurve {
    /// A fixed film curve.
    #[default]
    Standard,
    /// The curve that slope, toe, shoulder and clips describe.
    Shaped,
}

/// Tone curve. Over the logarithm of light, base 10, a shaped curve is a straight line through 18 %
/// grey with a toe below and a shoulder above.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FilmSpec {
    /// Which one; the other keys act on `shaped` only.
    pub curve: FilmCurve,
    /// Steepness of the straight part.
    pub slope: f32,
    /// How dark the darkest part of the straight part is: more is a longer toe.
    pub toe: f32,
    /// How bright its brightest part is: more is a longer shoulder.
    pub shoulder: f32,
    /// How far below black the toe ends.
    pub black_clip: f32,
    /// How far above white the shoulder ends.
    pub white_clip: f32,
}

impl Default for FilmSpec {
    fn default() -> Self {
        FilmSpec {
            curve: FilmCurve::Standard,
            slope: 0.88,
            toe: 0.55,
            shoulder: 0.26,
            black_clip: 0.0,
            white_clip: 0.04,
        }
    }
}

/// Where the parts of a shaped curve meet, log10 of light, and their heights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmParts {
    /// Where the toe meets the straight part.
    pub toe_at: f32,
    /// Where the straight part meets the shoulder.
    pub shoulder_at: f32,
    /// The straight part is slope · (log10 + this).
    pub straight_offset: f32,
    /// Height of the toe.
    pub toe_height: f32,
    /// Height of the shoulder.
    pub shoulder_height: f32,
}

impl FilmSpec {
    /// The parts of the shaped curve; 18 % grey stays 18 % grey.
    pub fn parts(&self) -> FilmParts {
        const GREY: f64 = 0.18;
        let [slope, toe, shoulder, black, white] = [
            self.slope,
            self.toe,
            self.shoulder,
            self.black_clip,
            self.white_clip,
        ]
        .map(f64::from);
        let (toe_height, shoulder_height) = (1.0 + black - toe, 1.0 + white - shoulder);
        let toe_at = if toe > 0.8 {
            // Grey lies on the straight part.
            (1.0 - toe - GREY) / slope + GREY.log10()
        } else {
            // Grey lies on the toe, a logistic function.
            let level = (GREY + black) / toe_height - 1.0;
            let steps = 0.5 * ((1.0 + level) / (1.0 - level)).ln();
            GREY.log10() - steps * toe_height / slope
        };
        let straight_offset = (1.0 - toe) / slope - toe_at;
        FilmParts {
            toe_at: toe_at as f32,
            shoulder_at: (shoulder / slope - straight_offset) as f32,
            straight_offset: straight_offset as f32,
            toe_height: toe_height as f32,
            shoulder_height: shoulder_height as f32,
        }
    }

    pub(crate) fn check(&self, errors: &mut Vec<SpecError>) {
        for (key, value, low, high) in [
            ("optics.film.slope", self.slope, 0.01, 10.0),
            ("optics.film.toe", self.toe, 0.0, 1.0),
            ("optics.film.shoulder", self.shoulder, 0.0, 1.0),
            ("optics.film.black_clip", self.black_clip, 0.0, 1.0),
            ("optics.film.white_clip", self.white_clip, 0.0, 1.0),
        ] {
            check_range(key, value, low, high, errors);
        }
        if !(self.parts().toe_at.is_finite() && self.parts().toe_height > 0.0) {
            errors.push(SpecError {
                key: "optics.film.toe",
                value: self.toe.to_string(),
                allowed: format!(
                    "with optics.film.black_clip {} it leaves the curve no toe; take a toe nearer to 0.55",
                    self.black_clip
                ),
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_allowed_and_an_impossible_toe_is_a_sentence() {
        let mut errors = Vec::new();
        FilmSpec::default().check(&mut errors);
        assert!(errors.is_empty(), "{errors:?}");
        FilmSpec {
            toe: f32::NAN,
            ..Default::default()
        }
        .check(&mut errors);
        assert!(
            errors[0]
                .to_string()
                .starts_with("optics.film.toe is NaN, but"),
            "{}",
            errors[0]
        );
    }
}
