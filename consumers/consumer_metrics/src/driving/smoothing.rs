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
    let mut derivatives = Vec::with_capacity(n);
    let mut parabola = (usize::MAX, Vector3::zeros());
    for at in 0..n {
        let centre = at.clamp(half, n - 1 - half);
        if parabola.0 != centre {
            parabola = (centre, fit.of(&values[centre - half..=centre + half]));
        }
        let [_, slope, curve] = parabola.1.into();
        let off = at as f64 - centre as f64;
        derivatives.push(match order {
            1 => (slope + 2.0 * curve * off) / step_secs,
            _ => 2.0 * curve / (step_secs * step_secs),
        });
    }
    derivatives
}

/// The least-squares parabola of a window of samples, with places counted from its middle.
struct Fit {
    half: usize,
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
        Self { half, inverse }
    }

    /// Value, slope and half of the second derivative in the middle.
    fn of(&self, window: &[f64]) -> Vector3<f64> {
        let mut moments = Vector3::zeros();
        for (at, value) in window.iter().enumerate() {
            let place = at as f64 - self.half as f64;
            moments += Vector3::new(1.0, place, place * place) * *value;
        }
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
        assert_eq!(derivative(&[1.0, 2.0], 0.1, 1.0, 1), [0.0, 0.0]);
        assert_eq!(derivative(&values, 0.0, 1.0, 1), vec![0.0; 40]);
    }
}
