//! Lenses whose image is drawn on a flat plane, and OpenCV's distortion of that plane.

use std::f64::consts::FRAC_PI_2;

use super::model::{LensError, LensModel};

/// Number of OpenCV's coefficients.
const COEFFICIENTS: usize = 14;
/// Steps of Newton's method, and halvings of each.
const STEPS: usize = 60;
const HALVINGS: usize = 30;
/// Samples of the field's angle in which a fold is looked for.
const SAMPLES: usize = 4096;

/// The flat place of a direction, before distortion.
pub(super) fn flatten(model: &LensModel, [x, y, z]: [f64; 3]) -> Option<[f64; 2]> {
    let length = x.hypot(y).hypot(z);
    let depth = match model {
        LensModel::Unified { mirror, .. } => z + mirror * length,
        LensModel::DoubleSphere { xi, alpha } => {
            let moved = xi * length + z;
            alpha * x.hypot(y).hypot(moved) + (1.0 - alpha) * moved
        }
        _ => z,
    };
    (depth > 0.0).then(|| [x / depth, y / depth])
}

/// A direction of a flat place.
pub(super) fn unflatten(model: &LensModel, [u, v]: [f64; 2]) -> Option<[f64; 3]> {
    let r2 = u * u + v * v;
    let found = match model {
        LensModel::Unified { mirror, .. } => {
            let root = (1.0 + (1.0 - mirror * mirror) * r2).sqrt();
            let share = (mirror + root) / (1.0 + r2);
            [share * u, share * v, share - mirror]
        }
        LensModel::DoubleSphere { xi, alpha } => {
            let root = (1.0 - (2.0 * alpha - 1.0) * r2).sqrt();
            let depth = (1.0 - alpha * alpha * r2) / (alpha * root + 1.0 - alpha);
            let d2 = depth * depth;
            let share = (depth * xi + (d2 + (1.0 - xi * xi) * r2).sqrt()) / (d2 + r2);
            [share * u, share * v, share * depth - xi]
        }
        _ => [u, v, 1.0],
    };
    // A root of what is negative is no number: the place is beyond the field.
    found.iter().all(|it| it.is_finite()).then_some(found)
}

/// θ at which the field ends.
pub(super) fn check(model: &LensModel) -> Result<f64, LensError> {
    let refused = |key, value: String, allowed| LensError {
        key,
        value,
        allowed,
    };
    match model {
        LensModel::OpenCv { coefficients } | LensModel::Unified { coefficients, .. } => {
            let most = COEFFICIENTS;
            if coefficients.len() > most || !coefficients.iter().all(|it| it.is_finite()) {
                let allowed = "must be at most 14 numbers";
                return Err(refused(
                    "coefficients",
                    format!("{coefficients:?}"),
                    allowed,
                ));
            }
        }
        _ => {}
    }
    match model {
        LensModel::Unified {
            mirror,
            coefficients,
        } => {
            if !(0.0..=10.0).contains(mirror) {
                return Err(refused("mirror", mirror.to_string(), "must be 0 to 10"));
            }
            let horizon = match *mirror > 1.0 {
                true => -1.0 / mirror,
                false => -mirror,
            };
            let end = horizon.acos().min(std::f64::consts::PI - 1e-6);
            let end = if *mirror <= 1.0 { end - 1e-9 } else { end };
            Ok(within_fold(
                model,
                &OpenCvDistortion::new(coefficients),
                end,
            ))
        }
        LensModel::DoubleSphere { xi, alpha } => {
            if !(-1.0..=1.0).contains(xi) {
                return Err(refused("xi", xi.to_string(), "must be -1 to 1"));
            }
            if !(0.0..=1.0).contains(alpha) {
                return Err(refused("alpha", alpha.to_string(), "must be 0 to 1"));
            }
            let w1 = match *alpha <= 0.5 {
                true => alpha / (1.0 - alpha),
                false => (1.0 - alpha) / alpha,
            };
            let w2 = (w1 + xi) / (2.0 * w1 * xi + xi * xi + 1.0).sqrt();
            // At the very end a place has no direction of its own.
            Ok((-w2).clamp(-1.0, 1.0).acos() - 1e-9)
        }
        LensModel::OpenCv { coefficients } => Ok(within_fold(
            model,
            &OpenCvDistortion::new(coefficients),
            FRAC_PI_2 - 1e-9,
        )),
        _ => Ok(FRAC_PI_2 - 1e-9),
    }
}

/// θ up to `end` at which the distortion of the flat plane turns back.
fn within_fold(model: &LensModel, distortion: &OpenCvDistortion, end: f64) -> f64 {
    let rises = |theta: f64| {
        let place = flatten(model, [theta.sin(), 0.0, theta.cos()]);
        place.is_some_and(|[r, _]| distortion.slope(r) > 0.0)
    };
    let at = |sample: usize| end * sample as f64 / SAMPLES as f64;
    let Some(after) = (1..=SAMPLES).find(|it| !rises(at(*it))) else {
        return end;
    };
    let [mut low, mut high] = [at(after - 1), at(after)];
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        match rises(middle) {
            true => low = middle,
            false => high = middle,
        }
    }
    low
}

/// OpenCV's distortion of a flat plane.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct OpenCvDistortion {
    /// OpenCV's order.
    k: [f64; COEFFICIENTS],
    /// The tilted plane's matrix and its inverse; `None` if it is not tilted.
    tilt: Option<[[[f64; 3]; 3]; 2]>,
}

impl Default for OpenCvDistortion {
    fn default() -> Self {
        OpenCvDistortion::new(&[])
    }
}

impl OpenCvDistortion {
    pub(super) fn new(coefficients: &[f64]) -> OpenCvDistortion {
        let mut k = [0.0; COEFFICIENTS];
        let given = coefficients.len().min(COEFFICIENTS);
        k[..given].copy_from_slice(&coefficients[..given]);
        let is_tilted = k[12] != 0.0 || k[13] != 0.0;
        OpenCvDistortion {
            tilt: is_tilted.then(|| tilt(k[12], k[13])),
            k,
        }
    }

    fn is_none(&self) -> bool {
        self.k == [0.0; COEFFICIENTS]
    }

    /// Factor of the radius at its square, and that factor's derivative by the square.
    fn factor(&self, r2: f64) -> [f64; 2] {
        let [k1, k2, _, _, k3, k4, k5, k6, ..] = self.k;
        let above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
        let above_slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
        let below_slope = k4 + r2 * (2.0 * k5 + r2 * 3.0 * k6);
        // Beyond a pole there is no image.
        match below > 0.0 {
            true => [
                above / below,
                (above_slope * below - above * below_slope) / (below * below),
            ],
            false => [f64::NAN; 2],
        }
    }

    /// How the radius grows with that of the flat plane.
    fn slope(&self, r: f64) -> f64 {
        let [factor, slope] = self.factor(r * r);
        factor + 2.0 * r * r * slope
    }

    /// Place before the tilt, and its derivatives by x and y as rows.
    fn bent(&self, [x, y]: [f64; 2]) -> ([f64; 2], [[f64; 2]; 2]) {
        let [_, _, p1, p2, _, _, _, _, s1, s2, s3, s4, ..] = self.k;
        let r2 = x * x + y * y;
        let [factor, slope] = self.factor(r2);
        let at = [
            x * factor + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + r2 * (s1 + s2 * r2),
            y * factor + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y + r2 * (s3 + s4 * r2),
        ];
        // Of r², the derivatives are 2x and 2y.
        let [prism_x, prism_y] = [s1 + 2.0 * s2 * r2, s3 + 2.0 * s4 * r2];
        let cross = 2.0 * x * y * slope;
        let by = [
            [
                factor + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x + 2.0 * x * prism_x,
                cross + 2.0 * p1 * x + 2.0 * p2 * y + 2.0 * y * prism_x,
            ],
            [
                cross + 2.0 * p1 * x + 2.0 * p2 * y + 2.0 * x * prism_y,
                factor + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x + 2.0 * y * prism_y,
            ],
        ];
        (at, by)
    }

    /// Where the lens shows a flat place; `None` if it folds over before.
    pub(super) fn apply(&self, flat: [f64; 2]) -> Option<[f64; 2]> {
        if self.is_none() {
            return Some(flat);
        }
        let (at, by) = self.bent(flat);
        let is_unfolded = determinant(by) > 0.0;
        if !is_unfolded {
            return None;
        }
        match &self.tilt {
            Some([tilt, _]) => moved(tilt, at),
            None => Some(at),
        }
    }

    /// The flat place that the lens shows at a place; `None` if there is none, or none is found.
    /// Newton's method begins at the radial inverse, and ever nearer to the middle if it is lost
    /// at a fold.
    pub(super) fn undo(&self, at: [f64; 2]) -> Option<[f64; 2]> {
        if self.is_none() {
            return Some(at);
        }
        let wanted = match &self.tilt {
            Some([_, untilt]) => moved(untilt, at)?,
            None => at,
        };
        let start = self.start(wanted);
        [1.0, 0.9, 0.7, 0.5, 0.25, 0.0]
            .into_iter()
            .find_map(|share| self.newton(wanted, start.map(|it| it * share)))
    }

    /// Newton's method from a flat place on, each step of which comes nearer.
    fn newton(&self, wanted: [f64; 2], mut flat: [f64; 2]) -> Option<[f64; 2]> {
        let off = |[x, y]: [f64; 2]| [x - wanted[0], y - wanted[1]];
        let size = |[x, y]: [f64; 2]| x.hypot(y);
        let (place, mut by) = self.bent(flat);
        let mut error = off(place);
        for _ in 0..STEPS {
            let area = determinant(by);
            let is_unfolded = area > 0.0;
            if size(error) == 0.0 || !is_unfolded {
                break;
            }
            let step = [
                (by[1][1] * error[0] - by[0][1] * error[1]) / area,
                (by[0][0] * error[1] - by[1][0] * error[0]) / area,
            ];
            let mut share = 1.0;
            let nearer = (0..HALVINGS).find_map(|_| {
                let next = [flat[0] - share * step[0], flat[1] - share * step[1]];
                share *= 0.5;
                let (place, by) = self.bent(next);
                let is_nearer = size(off(place)) < size(error) && determinant(by) > 0.0;
                is_nearer.then(|| (next, off(place), by))
            });
            // Nothing nearer is rounding, or a fold.
            let Some((next, left, slopes)) = nearer else {
                break;
            };
            (flat, error, by) = (next, left, slopes);
        }
        (size(error) <= 1e-12 * (1.0 + size(wanted)) && determinant(by) > 0.0).then_some(flat)
    }

    /// The flat place in the same direction whose radius the radial part alone makes that of `at`,
    /// or that comes nearest before a fold.
    fn start(&self, at: [f64; 2]) -> [f64; 2] {
        let radius = at[0].hypot(at[1]);
        let below = |r: f64| self.slope(r) > 0.0 && r * self.factor(r * r)[0] < radius;
        let mut end = radius.max(1e-9);
        for _ in 0..40 {
            if !below(end) {
                break;
            }
            end *= 1.5;
        }
        let [mut low, mut high] = [0.0, end];
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            match below(middle) {
                true => low = middle,
                false => high = middle,
            }
        }
        match radius > 0.0 {
            true => at.map(|it| it * low / radius),
            false => [0.0; 2],
        }
    }
}

fn determinant([[a, b], [c, d]]: [[f64; 2]; 2]) -> f64 {
    a * d - b * c
}

/// A place of a plane under a matrix that keeps straight lines.
fn moved(matrix: &[[f64; 3]; 3], [x, y]: [f64; 2]) -> Option<[f64; 2]> {
    let [u, v, w] = matrix.map(|[a, b, c]| a * x + b * y + c);
    (w > 0.0).then(|| [u / w, v / w])
}

/// OpenCV's tilted image plane: turned about x, then about y, and seen along the axis again.
fn tilt(about_x: f64, about_y: f64) -> [[[f64; 3]; 3]; 2] {
    let ((sx, cx), (sy, cy)) = (about_x.sin_cos(), about_y.sin_cos());
    let turn = nalgebra::Matrix3::new(cy, 0.0, -sy, 0.0, 1.0, 0.0, sy, 0.0, cy)
        * nalgebra::Matrix3::new(1.0, 0.0, 0.0, 0.0, cx, sx, 0.0, -sx, cx);
    let (z, x, y) = (turn[(2, 2)], turn[(0, 2)], turn[(1, 2)]);
    let seen = nalgebra::Matrix3::new(z, 0.0, -x, 0.0, z, -y, 0.0, 0.0, 1.0) * turn;
    // A plane that is seen from its edge has no inverse, and then no place is found.
    let back = seen
        .try_inverse()
        .unwrap_or_else(|| nalgebra::Matrix3::from_element(f64::NAN));
    [seen, back].map(|it| [0, 1, 2].map(|row| [0, 1, 2].map(|column| it[(row, column)])))
}
