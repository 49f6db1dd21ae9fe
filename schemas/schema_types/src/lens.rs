//! Lenses: from a direction to the pixel that shows it, and back.
//!
//! Directions are in the camera's optical axes, x to the right, y down, z ahead, as all files of
//! calibration have them. Pixels count from the image's upper left corner, so that the middle of
//! the first pixel is (0.5, 0.5).
//! A lens maps a direction to a place in its plane, and [`Plane`] takes that to a pixel. Beyond
//! the field of a model, where it would fold over or has no image, there is no pixel.

mod central;
mod model;
mod radial;

pub use model::{LensError, LensModel, PolynomialDirection};

/// From a lens's plane to pixels: (fx x + shear_x y + cx, shear_y x + fy y + cy).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// fx and fy.
    pub focal_px: [f64; 2],
    /// How much x grows with the plane's y, and y with its x.
    pub shear_px: [f64; 2],
    /// The pixel on the optical axis.
    pub centre_px: [f64; 2],
}

/// A lens whose values were checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Lens {
    model: LensModel,
    plane: Plane,
    /// 1 / determinant of the plane's matrix.
    inverse_area: f64,
    /// θ at which the field ends.
    max_angle_rad: f64,
    /// The coefficients of `opencv` and `unified`.
    distortion: central::OpenCvDistortion,
}

impl Lens {
    /// Checks a lens. Its field ends at `max_angle_rad` at the latest.
    ///
    /// # Errors
    /// The first value that no such lens has.
    pub fn new(
        model: LensModel,
        plane: Plane,
        max_angle_rad: Option<f64>,
    ) -> Result<Lens, LensError> {
        let Plane {
            focal_px: [fx, fy],
            shear_px: [dx, dy],
            centre_px,
        } = plane;
        let refused = |key, value: String, allowed| LensError {
            key,
            value,
            allowed,
        };
        if ![fx, fy].iter().all(|it| it.is_finite() && *it > 0.0) {
            let allowed = "both must be greater than 0";
            return Err(refused("focal_px", format!("[{fx}, {fy}]"), allowed));
        }
        let area = fx * fy - dx * dy;
        if !(area > 0.0 && area.is_finite()) {
            let allowed = "its product must be less than that of the focal lengths";
            return Err(refused("shear_px", format!("[{dx}, {dy}]"), allowed));
        }
        if !centre_px.iter().all(|it| it.is_finite()) {
            let allowed = "both must be numbers";
            return Err(refused("centre_px", format!("{centre_px:?}"), allowed));
        }
        let own = check(&model)?;
        let most = match max_angle_rad {
            None => own,
            Some(it) if it > 0.0 && it <= std::f64::consts::PI => it.min(own),
            Some(it) => {
                let allowed = "must lie between 0 and π";
                return Err(refused("max_angle_rad", it.to_string(), allowed));
            }
        };
        let distortion = match &model {
            LensModel::OpenCv { coefficients } | LensModel::Unified { coefficients, .. } => {
                central::OpenCvDistortion::new(coefficients)
            }
            _ => central::OpenCvDistortion::default(),
        };
        Ok(Lens {
            model,
            plane,
            inverse_area: 1.0 / area,
            max_angle_rad: most,
            distortion,
        })
    }

    /// How it maps directions.
    pub fn model(&self) -> &LensModel {
        &self.model
    }

    /// From its plane to pixels.
    pub fn plane(&self) -> &Plane {
        &self.plane
    }

    /// θ at which its field ends, radians.
    pub fn max_angle_rad(&self) -> f64 {
        self.max_angle_rad
    }

    /// The pixel that shows a direction; `None` if it is beyond the field.
    pub fn project(&self, [x, y, z]: [f64; 3]) -> Option<[f64; 2]> {
        let aside = x.hypot(y);
        let theta = aside.atan2(z);
        // Also refuses what is no number, and a direction of no length.
        if !(theta <= self.max_angle_rad && aside.hypot(z) > 0.0) {
            return None;
        }
        let [u, v] = if let Some(curve) = radial::Curve::of(&self.model) {
            let radius = curve.radius(theta, self.max_angle_rad);
            match aside > 0.0 {
                true => [x, y].map(|it| it * (radius / aside)),
                false => [0.0; 2],
            }
        } else {
            let flat = central::flatten(&self.model, [x, y, z])?;
            self.distortion.apply(flat)?
        };
        let Plane {
            focal_px: [fx, fy],
            shear_px: [dx, dy],
            centre_px: [cx, cy],
        } = self.plane;
        let pixel = [fx * u + dx * v + cx, dy * u + fy * v + cy];
        pixel.iter().all(|it| it.is_finite()).then_some(pixel)
    }

    /// The direction that a pixel shows, of length 1; `None` if it shows none.
    pub fn unproject(&self, [px, py]: [f64; 2]) -> Option<[f64; 3]> {
        let Plane {
            focal_px: [fx, fy],
            shear_px: [dx, dy],
            centre_px: [cx, cy],
        } = self.plane;
        let [u, v] = [px - cx, py - cy];
        let at = [
            (fy * u - dx * v) * self.inverse_area,
            (fx * v - dy * u) * self.inverse_area,
        ];
        if !at.iter().all(|it| it.is_finite()) {
            return None;
        }
        if let Some(curve) = radial::Curve::of(&self.model) {
            let radius = at[0].hypot(at[1]);
            let theta = curve.angle(radius, self.max_angle_rad)?;
            let (sin, cos) = theta.sin_cos();
            return Some(match radius > 0.0 {
                true => [sin * at[0] / radius, sin * at[1] / radius, cos],
                false => [0.0, 0.0, 1.0],
            });
        }
        let flat = self.distortion.undo(at)?;
        let [x, y, z] = central::unflatten(&self.model, flat)?;
        // One part in 1e12 of the angle is rounding.
        let is_seen = x.hypot(y).atan2(z) <= self.max_angle_rad * (1.0 + 1e-12);
        let length = x.hypot(y).hypot(z);
        is_seen.then(|| [x, y, z].map(|it| it / length))
    }
}

/// θ at which a model's own field ends, if its values are those of a lens.
fn check(model: &LensModel) -> Result<f64, LensError> {
    match radial::Curve::of(model) {
        Some(curve) => curve.check(),
        None => central::check(model),
    }
}

#[cfg(test)]
mod tests;
