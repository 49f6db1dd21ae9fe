//! A lens that bends lines: from a place in the picture to the place that a pinhole camera shows
//! there, and back.

use crate::intrinsics::Intrinsics;

/// Longest side of the pinhole image that a distorted picture is taken from, pixels.
const MAX_DRAWN_PX: u32 = 8192;
/// The same as a multiple of the picture's side.
const MAX_DRAWN_RATIO: f64 = 3.0;

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

impl Distortion {
    /// Where the pinhole camera shows what the picture has at `p`; both in sides of the picture,
    /// from its middle.
    pub fn bend(&self, p: [f64; 2]) -> [f64; 2] {
        let r2 = (p[0] * self.size[0] as f64).powi(2) + (p[1] * self.size[1] as f64).powi(2);
        let factor = 1.0 + r2 * (self.k as f64 + self.k_cubed as f64 * r2.sqrt());
        p.map(|x| x * factor)
    }

    /// Where the picture has what the pinhole camera shows at `q`: the inverse of
    /// [`Distortion::bend`], by Newton's method.
    pub fn unbend(&self, q: [f64; 2]) -> [f64; 2] {
        let s2 = (q[0] * self.size[0] as f64).powi(2) + (q[1] * self.size[1] as f64).powi(2);
        let (a, b) = (self.k as f64 * s2, self.k_cubed as f64 * s2 * s2.sqrt());
        let mut share = 1.0;
        for _ in 0..16 {
            let value = share * (1.0 + share * share * (a + b * share)) - 1.0;
            let slope = 1.0 + share * share * (3.0 * a + 4.0 * b * share);
            share = (share - value / slope.max(0.05)).clamp(0.0, 100.0);
        }
        q.map(|x| x * share)
    }

    /// The pinhole camera whose image holds all that the picture shows: the same focal length, and
    /// a margin on both sides where the picture shows more than a pinhole image of its size would.
    /// Margins are limited to the picture's own side, beyond which the rim is repeated.
    pub fn drawn_by(&self, picture: &Intrinsics) -> Intrinsics {
        const STEPS: i32 = 64;
        let mut most = [0.5f64; 2];
        for x in 0..=STEPS {
            for y in 0..=STEPS {
                let at = [x, y].map(|step| step as f64 / STEPS as f64 - 0.5);
                let bent = self.bend(at);
                (0..2).for_each(|axis| most[axis] = most[axis].max(bent[axis].abs()));
            }
        }
        let side = |px: u32, most: f64| {
            let extra = (most - 0.5).min(0.5 * (MAX_DRAWN_RATIO - 1.0)) * px as f64;
            // Two pixels more for interpolation. A margin that is whole but for rounding is whole.
            let margin = if extra > 0.0 {
                (extra - 1e-3).ceil() as u32 + 2
            } else {
                0
            };
            px + 2 * margin.min(MAX_DRAWN_PX.saturating_sub(px) / 2)
        };
        Intrinsics {
            width_px: side(picture.width_px, most[0]),
            height_px: side(picture.height_px, most[1]),
            focal_px: picture.focal_px,
        }
    }
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
        ] {
            let lens = Distortion { k, k_cubed, size };
            for p in [[0.0, 0.0], [0.5, 0.5], [-0.3, 0.1], [0.02, -0.49]] {
                let again = lens.unbend(lens.bend(p));
                assert!(
                    (0..2).all(|axis| (again[axis] - p[axis]).abs() < 1e-9),
                    "{lens:?} {p:?} {again:?}"
                );
            }
        }
    }

    /// Goal: a barrel lens gets margins that hold its corner; a pincushion lens none.
    #[test]
    fn margins_hold_what_the_picture_shows() {
        let picture = Intrinsics::from_fov(800, 600, 1.2);
        let barrel = Distortion {
            k: 0.4,
            k_cubed: 0.0,
            size: [1.0; 2],
        };
        let drawn = barrel.drawn_by(&picture);
        // The corner has r² = 0.5, so its factor is 1.2.
        assert_eq!(
            (drawn.width_px, drawn.height_px, drawn.focal_px),
            (800 + 2 * 82, 600 + 2 * 62, picture.focal_px)
        );
        let pincushion = Distortion { k: -0.4, ..barrel };
        assert_eq!(pincushion.drawn_by(&picture), picture);
        let wild = Distortion { k: 10.0, ..barrel };
        assert!(wild.drawn_by(&picture).width_px <= 2404);
    }
}
