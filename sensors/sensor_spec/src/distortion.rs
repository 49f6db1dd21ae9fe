//! How much a pinhole camera must draw, so that a lens that bends lines finds its picture in it.

use schema_types::Distortion;

use crate::intrinsics::Intrinsics;

/// Longest side of the pinhole image that a distorted picture is taken from, pixels.
const MAX_DRAWN_PX: u32 = 8192;
/// The same as a multiple of the picture's side.
const MAX_DRAWN_RATIO: f64 = 3.0;

/// The pinhole camera whose image holds all that the picture shows: the same focal length, and
/// a margin on both sides where the picture shows more than a pinhole image of its size would.
/// Margins are limited to the picture's own side, beyond which the rim is repeated.
pub fn drawn_by(lens: &Distortion, picture: &Intrinsics) -> Intrinsics {
    const STEPS: i32 = 64;
    let mut most = [0.5f64; 2];
    for x in 0..=STEPS {
        for y in 0..=STEPS {
            let at = [x, y].map(|step| step as f64 / STEPS as f64 - 0.5);
            let bent = lens.bend(at);
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: a barrel lens gets margins that hold its corner; a pincushion lens none.
    #[test]
    fn margins_hold_what_the_picture_shows() {
        let picture = Intrinsics::from_fov(800, 600, 1.2);
        let barrel = Distortion {
            k: 0.4,
            k_cubed: 0.0,
            size: [1.0; 2],
        };
        let drawn = drawn_by(&barrel, &picture);
        // The corner has r² = 0.5, so its factor is 1.2.
        assert_eq!(
            (drawn.width_px, drawn.height_px, drawn.focal_px),
            (800 + 2 * 82, 600 + 2 * 62, picture.focal_px)
        );
        let pincushion = Distortion { k: -0.4, ..barrel };
        assert_eq!(drawn_by(&pincushion, &picture), picture);
        let wild = Distortion { k: 10.0, ..barrel };
        assert!(drawn_by(&wild, &picture).width_px <= 2404);
    }
}
