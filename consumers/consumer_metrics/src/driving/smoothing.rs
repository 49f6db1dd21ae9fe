//! Derivatives of samples at equal steps, by fitting parabolas.

use nalgebra::{Matrix3, Vector3};

/// First or second derivative of each sample. The parabola is fitted in a window of about this
/// length, an odd number of samples, at least three and at most all; where the window would reach
/// beyond the ends, that of the first or last full one is read off. All zero for fewer than three
/// samples or without a step.
pub(super) fn derivative(values: &[f64], step_secs: f64, window_secs: f64, order: u32) -> Vec<f64> {
    let n = values.len();
    if n < 3 || !(step_secs.is_finite() && step_secs > 0.0) {
        return vec![0.0; n];
    }
    let half_wanted = (window_secs / step_secs / 2.0).round().max(1.0) as usize;
    let half = half_wanted.min((n - 1) / 2);
    let fit = Fit::new(half);
    let mut window = Window::new(values, half);
    let mut derivatives = Vec::with_capacity(n);
    for at in 0..n {
        let centre = at.clamp(half, n - 1 - half);
        if window.centre != centre {
            window.step(values);
        }
        let [_, slope, curve] = fit.of(&window.moments).into();
        let off = at as f64 - centre as f64;
        derivatives.push(match order {
            1 => (slope + 2.0 * curve * off) / step_secs,
            _ => 2.0 * curve / (step_secs * step_secs),
        });
    }
    derivatives
}

/// Sums over a window that moves on: of the samples, of them times their places, and of them times
/// the squares of their places, counted from the middle.
struct Window {
    half: usize,
    centre: usize,
    moments: Vector3<f64>,
}

/// After so many steps sums are computed anew, so that rounding does not add up.
const N_STEPS: usize = 64;

impl Window {
    fn new(values: &[f64], half: usize) -> Self {
        Self::at(values, half, half)
    }

    fn at(values: &[f64], half: usize, centre: usize) -> Self {
        let mut moments = Vector3::zeros();
        for (at, value) in values[centre - half..=centre + half].iter().enumerate() {
            moments += powers(at as f64 - half as f64) * *value;
        }
        Self {
            half,
            centre,
            moments,
        }
    }

    /// One sample on.
    fn step(&mut self, values: &[f64]) {
        let centre = self.centre + 1;
        if centre.is_multiple_of(N_STEPS) {
            *self = Self::at(values, self.half, centre);
            return;
        }
        let reach = self.half as f64;
        self.moments -= powers(-reach) * values[centre - 1 - self.half];
        let [sum, first, second] = self.moments.into();
        // Every place is now one less.
        self.moments = Vector3::new(sum, first - sum, second - 2.0 * first + sum);
        self.moments += powers(reach) * values[centre + self.half];
        self.centre = centre;
    }
}

fn powers(place: f64) -> Vector3<f64> {
    Vector3::new(1.0, place, place * place)
}

/// The least-squares parabola of a window of samples, with places counted from its middle.
struct Fit {
    inverse: Matrix3<f64>,
}

impl Fit {
    fn new(half: usize) -> Self {
        // Odd powers sum to zero.
        let (mut n, mut squares, mut fourths) = (0.0, 0.0, 0.0);
        for at in 0..=2 * half {
            let square = (at as f64 - half as f64).powi(2);
            n += 1.0;
            squares += square;
            fourths += square * square;
        }
        let determinant = n * fourths - squares * squares;
        let mut inverse = Matrix3::zeros();
        inverse[(0, 0)] = fourths / determinant;
        inverse[(2, 2)] = n / determinant;
        inverse[(0, 2)] = -squares / determinant;
        inverse[(2, 0)] = inverse[(0, 2)];
        inverse[(1, 1)] = 1.0 / squares;
        Self { inverse }
    }

    /// Value, slope and half of the second derivative in the middle.
    fn of(&self, moments: &Vector3<f64>) -> Vector3<f64> {
        self.inverse * moments
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_a_parabola_they_are_exact() {
        let values: Vec<f64> = (0..40)
            .map(|at| 0.1 * f64::from(at))
            .map(|t| 3.0 - 2.0 * t + 0.5 * t * t)
            .collect();
        for window in [0.0, 0.5, 1.5, 100.0] {
            let slopes = derivative(&values, 0.1, window, 1);
            let curves = derivative(&values, 0.1, window, 2);
            for (at, (slope, curve)) in slopes.iter().zip(&curves).enumerate() {
                assert!(
                    (slope - (0.1 * at as f64 - 2.0)).abs() < 1e-9,
                    "{at} {slope}"
                );
                assert!((curve - 1.0).abs() < 1e-7, "{at} {curve}");
            }
        }
        let far: Vec<f64> = (0..5000).map(|at| 40.0 + 0.001 * f64::from(at)).collect();
        let slopes = derivative(&far, 0.001, 1.5, 1);
        assert!(slopes.iter().all(|slope| (slope - 1.0).abs() < 1e-9));
        let curves = derivative(&far, 0.001, 1.5, 2);
        assert!(curves.iter().all(|curve| curve.abs() < 1e-6));
        assert_eq!(derivative(&[1.0, 2.0], 0.1, 1.0, 1), [0.0, 0.0]);
        assert_eq!(derivative(&values, 0.0, 1.0, 1), vec![0.0; 40]);
    }
}
