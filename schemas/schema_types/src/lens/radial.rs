//! Lenses that are round: the radius in the plane is a function of the angle to the axis alone.

use std::f64::consts::{FRAC_PI_2, PI};

use super::model::{LensError, LensModel, PolynomialDirection};

/// Samples between 0 and the end of a field in which a fold is looked for.
const SAMPLES: usize = 4096;
/// Halvings of an interval that leave no more than rounding.
const HALVINGS: usize = 200;
/// Greatest distance from the centre that an f-theta polynomial is asked for, pixels.
const MAX_DISTANCE_PX: f64 = 65536.0;

/// Radius over θ, or θ over radius.
pub(super) enum Curve<'a> {
    KannalaBrandt(&'a [f64; 4]),
    DistanceToAngle(&'a [f64]),
    AngleToDistance(&'a [f64]),
    Equidistant,
    Equisolid,
    Stereographic,
    Orthographic,
    Table(&'a [f64], &'a [f64]),
}

impl<'a> Curve<'a> {
    /// `None` if the model is not round.
    pub(super) fn of(model: &'a LensModel) -> Option<Curve<'a>> {
        Some(match model {
            LensModel::KannalaBrandt { coefficients } => Curve::KannalaBrandt(coefficients),
            LensModel::FTheta {
                direction,
                polynomial,
            } => match direction {
                PolynomialDirection::DistanceToAngle => Curve::DistanceToAngle(polynomial),
                PolynomialDirection::AngleToDistance => Curve::AngleToDistance(polynomial),
            },
            LensModel::Equidistant {} => Curve::Equidistant,
            LensModel::Equisolid {} => Curve::Equisolid,
            LensModel::Stereographic {} => Curve::Stereographic,
            LensModel::Orthographic {} => Curve::Orthographic,
            LensModel::Table { angles_rad, radii } => Curve::Table(angles_rad, radii),
            LensModel::Pinhole {}
            | LensModel::OpenCv { .. }
            | LensModel::Unified { .. }
            | LensModel::DoubleSphere { .. } => return None,
        })
    }

    /// Radius at θ, which is at most `max_angle_rad`.
    pub(super) fn radius(&self, theta: f64, max_angle_rad: f64) -> f64 {
        match self {
            Curve::KannalaBrandt(k) => theta * (1.0 + even(k, theta)),
            Curve::DistanceToAngle(a) => {
                // The least distance whose angle is θ: the curve rises up to the field's end.
                let most = first_reaching(a, max_angle_rad);
                halved([0.0, most], |r| value(a, r) < theta)
            }
            Curve::AngleToDistance(b) => value(b, theta),
            Curve::Equidistant => theta,
            Curve::Equisolid => 2.0 * (theta / 2.0).sin(),
            Curve::Stereographic => 2.0 * (theta / 2.0).tan(),
            Curve::Orthographic => theta.sin(),
            Curve::Table(angles, radii) => between(angles, radii, theta),
        }
    }

    /// θ at a radius; `None` if it is beyond the field.
    pub(super) fn angle(&self, radius: f64, max_angle_rad: f64) -> Option<f64> {
        let end = self.radius(max_angle_rad, max_angle_rad);
        // One part in 1e12 of the radius is rounding.
        if radius > end * (1.0 + 1e-12) {
            return None;
        }
        let theta = match self {
            Curve::DistanceToAngle(a) => value(a, radius.min(end)),
            Curve::Equidistant => radius,
            Curve::Equisolid => 2.0 * (radius / 2.0).min(1.0).asin(),
            Curve::Stereographic => 2.0 * (radius / 2.0).atan(),
            Curve::Orthographic => radius.min(1.0).asin(),
            Curve::Table(angles, radii) => between(radii, angles, radius.min(end)),
            Curve::KannalaBrandt(_) | Curve::AngleToDistance(_) => {
                halved([0.0, max_angle_rad], |theta| {
                    self.radius(theta, max_angle_rad) < radius
                })
            }
        };
        Some(theta.min(max_angle_rad))
    }

    /// θ at which the field ends: where the curve turns back, at the latest behind the camera.
    pub(super) fn check(&self) -> Result<f64, LensError> {
        let refused = |key, values: &[f64], allowed| LensError {
            key,
            value: format!("{values:?}"),
            allowed,
        };
        match self {
            Curve::KannalaBrandt(k) => {
                if !k.iter().all(|it| it.is_finite()) {
                    return Err(refused("coefficients", *k, "must be numbers"));
                }
                let slope = |theta: f64| {
                    1.0 + even(&[3.0 * k[0], 5.0 * k[1], 7.0 * k[2], 9.0 * k[3]], theta)
                };
                Ok(fold(PI, slope).unwrap_or(PI))
            }
            Curve::DistanceToAngle(a) | Curve::AngleToDistance(a) => {
                let is_polynomial = a.len() >= 2
                    && a.len() <= 16
                    && a[0] == 0.0
                    && a[1] > 0.0
                    && a.iter().all(|it| it.is_finite());
                if !is_polynomial {
                    let allowed = "must be 2 to 16 numbers, the first of them 0 and the second greater than 0";
                    return Err(refused("polynomial", a, allowed));
                }
                if let Curve::AngleToDistance(_) = self {
                    return Ok(fold(PI, |theta| slope(a, theta)).unwrap_or(PI));
                }
                // Where the angle reaches π or turns back.
                let reach = PI / a[1];
                let most = fold(MAX_DISTANCE_PX.min(16.0 * reach), |r| slope(a, r));
                let most = most.unwrap_or(MAX_DISTANCE_PX.min(16.0 * reach));
                Ok(value(a, most).min(PI))
            }
            Curve::Equidistant | Curve::Equisolid => Ok(PI),
            // At π the radius has no end.
            Curve::Stereographic => Ok(PI - 1e-6),
            Curve::Orthographic => Ok(FRAC_PI_2),
            Curve::Table(angles, radii) => {
                let rises = |all: &[f64]| {
                    all.first() == Some(&0.0)
                        && all.len() >= 2
                        && all.windows(2).all(|it| it[0] < it[1])
                        && all.iter().all(|it| it.is_finite())
                };
                let allowed = "must be two numbers or more, the first of them 0, each greater than the one before";
                if !rises(angles) {
                    return Err(refused("angles_rad", angles, allowed));
                }
                if !rises(radii) {
                    return Err(refused("radii", radii, allowed));
                }
                if angles.len() != radii.len() {
                    let allowed = "must have as many numbers as angles_rad";
                    return Err(refused("radii", radii, allowed));
                }
                let last = angles[angles.len() - 1];
                if last > PI {
                    return Err(refused("angles_rad", angles, "the last must be at most π"));
                }
                Ok(last)
            }
        }
    }
}

/// k0 x² + k1 x⁴ + k2 x⁶ + k3 x⁸.
fn even(k: &[f64; 4], x: f64) -> f64 {
    let x2 = x * x;
    k.iter().rev().fold(0.0, |sum, k| (sum + k) * x2)
}

/// Value of a polynomial, from its constant on.
fn value(a: &[f64], x: f64) -> f64 {
    a.iter().rev().fold(0.0, |sum, a| sum * x + a)
}

/// Its derivative.
fn slope(a: &[f64], x: f64) -> f64 {
    let terms = a.iter().enumerate().skip(1).rev();
    terms.fold(0.0, |sum, (power, a)| sum * x + power as f64 * a)
}

/// The least x up to `end` at which a slope that is positive at 0 is no longer so.
fn fold(end: f64, slope: impl Fn(f64) -> f64) -> Option<f64> {
    let at = |sample: usize| end * sample as f64 / SAMPLES as f64;
    let after = (1..=SAMPLES).find(|it| slope(at(*it)) <= 0.0)?;
    // The lower end of what is left, at which the slope is still positive.
    Some(halved([at(after - 1), at(after)], |x| slope(x) > 0.0))
}

/// The distance at which a polynomial that rises first reaches an angle.
fn first_reaching(a: &[f64], angle_rad: f64) -> f64 {
    let end = MAX_DISTANCE_PX.min(16.0 * PI / a[1]);
    let at = |sample: usize| end * sample as f64 / SAMPLES as f64;
    let after = (1..=SAMPLES).find(|it| value(a, at(*it)) >= angle_rad);
    match after {
        Some(after) => halved([at(after - 1), at(after)], |r| value(a, r) < angle_rad),
        // The end is a fold between two samples.
        None => fold(end, |r| slope(a, r)).unwrap_or(end),
    }
}

/// Where a condition that holds from `low` on ends before `high`.
fn halved([mut low, mut high]: [f64; 2], holds: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if holds(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// The value at x of straight lines between points whose x rise.
fn between(xs: &[f64], ys: &[f64], x: f64) -> f64 {
    let after = xs.partition_point(|it| *it < x).clamp(1, xs.len() - 1);
    let share = (x - xs[after - 1]) / (xs[after] - xs[after - 1]);
    ys[after - 1] + share * (ys[after] - ys[after - 1])
}
