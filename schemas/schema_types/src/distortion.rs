//! A lens that bends lines: from a place in the picture to the place that a pinhole camera shows
//! there, and back.

/// Radial distortion: a picture has at p (−0.5 to 0.5 in both axes) what a pinhole camera of the
/// same focal length has at p · (1 + k r² + k_cubed r³), r = |p · size|.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distortion {
    /// Quadratic coefficient.
    pub k: f32,
    /// Cubic coefficient.
    pub k_cubed: f32,
    /// Scale of r in x and y.
    pub size: [f32; 2],
}

/// Halvings of an interval that leave no more than rounding.
const HALVINGS: usize = 60;

impl Distortion {
    /// The lens of `[k, k_cubed, size x, size y]`; `None` if straight lines stay straight.
    pub fn from_array([k, k_cubed, x, y]: [f32; 4]) -> Option<Distortion> {
        let bends = k != 0.0 || k_cubed != 0.0;
        bends.then_some(Distortion {
            k,
            k_cubed,
            size: [x, y],
        })
    }

    /// `[k, k_cubed, size x, size y]`.
    pub fn as_array(&self) -> [f32; 4] {
        [self.k, self.k_cubed, self.size[0], self.size[1]]
    }

    /// Where the pinhole camera shows what the picture has at `p`; both in sides of the picture,
    /// from its middle.
    pub fn bend(&self, p: [f64; 2]) -> [f64; 2] {
        let r2 = self.radius_squared(p);
        let factor = 1.0 + r2 * (self.k as f64 + self.k_cubed as f64 * r2.sqrt());
        p.map(|x| x * factor)
    }

    /// Where the picture has what the pinhole camera shows at `q`: the inverse of
    /// [`Distortion::bend`] from the middle to where the lens folds the picture over, if it does.
    /// Beyond, which no picture shows, places go on outwards in proportion to `q`.
    pub fn unbend(&self, q: [f64; 2]) -> [f64; 2] {
        let s2 = self.radius_squared(q);
        let (a, b) = (self.k as f64 * s2, self.k_cubed as f64 * s2 * s2.sqrt());
        // The place is `share · q`, and its image `value(share) · q`.
        let value = |share: f64| share * (1.0 + share * share * (a + b * share));
        let share = match fold(a, b) {
            Some(fold) if value(fold) < 1.0 => fold / value(fold),
            end => {
                let mut most = 1.0;
                while end.is_none() && value(most) < 1.0 {
                    most *= 2.0;
                }
                halved([0.0, end.unwrap_or(most)], |share| value(share) < 1.0)
            }
        };
        q.map(|x| x * share)
    }

    fn radius_squared(&self, p: [f64; 2]) -> f64 {
        (p[0] * self.size[0] as f64).powi(2) + (p[1] * self.size[1] as f64).powi(2)
    }
}

/// The least positive x at which x (1 + a x² + b x³) stops to rise; `None` if it never does.
fn fold(a: f64, b: f64) -> Option<f64> {
    let slope = |x: f64| 1.0 + x * x * (3.0 * a + 4.0 * b * x);
    let end = if b > 0.0 {
        // The slope is least here, where it rises again for ever.
        (-a / (2.0 * b)).max(0.0)
    } else if a < 0.0 || b < 0.0 {
        let mut end = 1.0;
        while slope(end) > 0.0 {
            end *= 2.0;
        }
        end
    } else {
        return None;
    };
    (slope(end) <= 0.0).then(|| halved([0.0, end], |x| slope(x) > 0.0))
}

/// Where a condition that holds from `low` on ends before `high`.
fn halved([mut low, mut high]: [f64; 2], holds: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if holds(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unbending_undoes_bending() {
        for (k, k_cubed, size) in [
            (-1.0, 0.0, [0.08, 0.08]),
            (0.6, 0.4, [1.0, 0.7]),
            (-0.5, 0.2, [1.0, 1.0]),
            (0.9, -0.3, [0.8, 1.0]),
        ] {
            let lens = Distortion { k, k_cubed, size };
            assert_eq!(Distortion::from_array(lens.as_array()), Some(lens));
            for p in [[0.0, 0.0], [0.5, 0.5], [-0.3, 0.1], [0.02, -0.49]] {
                let again = lens.unbend(lens.bend(p));
                assert!(
                    (0..2).all(|axis| (again[axis] - p[axis]).abs() < 1e-9),
                    "{lens:?} {p:?} {again:?}"
                );
            }
        }
    }

    /// r (1 − 0.5 r²) is greatest, 0.5443, at r = √(2 / 3).
    #[test]
    fn what_a_fold_hides_lies_outside_and_in_order() {
        let lens = Distortion {
            k: -0.5,
            k_cubed: 0.0,
            size: [1.0; 2],
        };
        let fold = (2.0f64 / 3.0).sqrt();
        let mut before = 0.0;
        for step in 1..2000 {
            let q = 0.01 * step as f64;
            let [p, _] = lens.unbend([q, 0.0]);
            assert!(p > before, "{q} {p} {before}");
            assert_eq!(p > fold, q > fold * 2.0 / 3.0, "{q} {p}");
            before = p;
        }
        let [far, _] = lens.unbend([2.0 * fold * 2.0 / 3.0, 0.0]);
        assert!((far - 2.0 * fold).abs() < 1e-6, "{far}");
    }
}
