//! What the spectator alone sees, as quadrangles of its image: lines of a width in pixels, texts at
//! places of the world, and lines of text in a corner.

mod font;

use nalgebra::{Isometry3, Point3, Vector3};
use sensor_core::scene::{DebugStroke, Overlay};
use sensor_spec::Intrinsics;

use crate::camera_motion::NEAR_M;
use font::{GLYPH_PX, runs};

/// Strokes are drawn nearer by this factor, so that a stroke on a road is not half hidden by it.
pub(crate) const NEARER_RATIO: f64 = 1.002;
/// Image height at which a dot of a glyph is one more pixel, pixels.
const HEIGHT_PER_DOT_PX: u32 = 360;
/// Most letters that are drawn in one image; what lies outside it does not count.
const MAX_LETTERS: usize = 20_000;
/// Colour of the corner's text.
const PANEL_RGB: [u8; 3] = [255; 3];
/// Colour of shadows.
const SHADOW_RGB: [u8; 3] = [0; 3];

/// A quadrangle of the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PixelQuad {
    /// Corners in order around it, pixels right of and below the image's outer corner.
    pub corners_px: [[f64; 2]; 4],
    /// sRGB.
    pub color_rgb: [u8; 3],
}

/// The image that the overlay is drawn on.
pub(crate) struct Pane<'p> {
    lens: &'p Intrinsics,
    world_from_camera: &'p Isometry3<f64>,
    /// Pixels of one dot of a glyph.
    dot_px: f64,
}

impl<'p> Pane<'p> {
    pub fn new(lens: &'p Intrinsics, world_from_camera: &'p Isometry3<f64>) -> Self {
        let dots = (lens.height_px + HEIGHT_PER_DOT_PX / 2) / HEIGHT_PER_DOT_PX;
        Pane {
            lens,
            world_from_camera,
            dot_px: f64::from(dots.max(1)),
        }
    }

    /// All of it, from the bottom up.
    pub fn quads(&self, overlay: &Overlay) -> Vec<PixelQuad> {
        let mut quads: Vec<PixelQuad> = overlay
            .strokes
            .iter()
            .filter_map(|stroke| self.line(stroke))
            .collect();
        let mut n_left = MAX_LETTERS;
        for text in &overlay.texts {
            let at = self.in_camera(text.at_m);
            if in_front(at, at).is_none() {
                continue;
            }
            let corner = self.on_image(&at).map(f64::round);
            let shadow = text.shadow.then_some(SHADOW_RGB);
            self.write(
                &text.text,
                corner,
                text.color_rgb,
                shadow,
                &mut n_left,
                &mut quads,
            );
        }
        let margin = 4.0 * self.dot_px;
        for (row, line) in overlay.panel.iter().enumerate() {
            let corner = [margin, margin + row as f64 * self.row_px()];
            self.write(
                line,
                corner,
                PANEL_RGB,
                Some(SHADOW_RGB),
                &mut n_left,
                &mut quads,
            );
        }
        quads
    }

    /// From one line of text to the next.
    fn row_px(&self) -> f64 {
        (f64::from(GLYPH_PX) + 2.0) * self.dot_px
    }

    fn in_camera(&self, at_m: [f64; 3]) -> Vector3<f64> {
        self.world_from_camera
            .inverse_transform_point(&Point3::from(at_m))
            .coords
    }

    fn on_image(&self, at: &Vector3<f64>) -> [f64; 2] {
        let [fx, fy, cx, cy] = self.lens.as_array();
        [cx + fx * at.x / at.z, cy + fy * at.y / at.z]
    }

    /// A line of the stroke's width, at least one pixel; a point is a square. `None` behind the
    /// camera.
    fn line(&self, stroke: &DebugStroke) -> Option<PixelQuad> {
        let (from, to) = in_front(self.in_camera(stroke.from_m), self.in_camera(stroke.to_m))?;
        let ([x0, y0], [x1, y1]) = (self.on_image(&from), self.on_image(&to));
        let half_px = (0.5 * f64::from(stroke.width_m)).max(0.5);
        let (dx, dy) = (x1 - x0, y1 - y0);
        let length = dx.hypot(dy);
        let corners_px = if length > 1e-6 {
            let (ax, ay) = (-dy / length * half_px, dx / length * half_px);
            [
                [x0 - ax, y0 - ay],
                [x0 + ax, y0 + ay],
                [x1 + ax, y1 + ay],
                [x1 - ax, y1 - ay],
            ]
        } else {
            rectangle([x0 - half_px, y0 - half_px], [2.0 * half_px; 2])
        };
        Some(PixelQuad {
            corners_px,
            color_rgb: stroke.color_rgb,
        })
    }

    /// Writes a text below and right of `corner`, its shadow one dot farther.
    fn write(
        &self,
        text: &str,
        corner: [f64; 2],
        color_rgb: [u8; 3],
        shadow_rgb: Option<[u8; 3]>,
        n_left: &mut usize,
        quads: &mut Vec<PixelQuad>,
    ) {
        let step = f64::from(GLYPH_PX) * self.dot_px;
        let (mut letters, [mut x, mut y]) = (Vec::new(), corner);
        for letter in text.chars() {
            if letter == '\n' {
                (x, y) = (corner[0], y + self.row_px());
                continue;
            }
            let is_seen = x + step > 0.0
                && y + step > 0.0
                && x < f64::from(self.lens.width_px)
                && y < f64::from(self.lens.height_px);
            if is_seen && *n_left > 0 {
                *n_left -= 1;
                letters.push((letter, x, y));
            }
            x += step;
        }
        let below = shadow_rgb.map(|rgb| (rgb, self.dot_px));
        for (rgb, aside) in below.into_iter().chain([(color_rgb, 0.0)]) {
            for (letter, x, y) in &letters {
                quads.extend(runs(*letter).map(|run| {
                    let place = |dots: u32, from: f64| from + aside + f64::from(dots) * self.dot_px;
                    let at = [place(run.column, *x), place(run.row, *y)];
                    PixelQuad {
                        corners_px: rectangle(at, [f64::from(run.n) * self.dot_px, self.dot_px]),
                        color_rgb: rgb,
                    }
                }));
            }
        }
    }
}

fn rectangle([x, y]: [f64; 2], [width, height]: [f64; 2]) -> [[f64; 2]; 4] {
    [
        [x, y],
        [x + width, y],
        [x + width, y + height],
        [x, y + height],
    ]
}

/// The part of a stroke in front of the near plane.
pub(crate) fn in_front(
    from: Vector3<f64>,
    to: Vector3<f64>,
) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let least_m = NEAR_M * NEARER_RATIO * 1.01;
    let cut = |inside: Vector3<f64>, outside: Vector3<f64>| {
        inside + (outside - inside) * ((inside.z - least_m) / (inside.z - outside.z))
    };
    match (from.z >= least_m, to.z >= least_m) {
        (true, true) => Some((from, to)),
        (true, false) => Some((from, cut(from, to))),
        (false, true) => Some((cut(to, from), to)),
        (false, false) => None,
    }
}

#[cfg(test)]
mod tests {
    use sensor_core::scene::DebugText;

    use super::*;

    /// 200 by 100 pixels, 90°: f = 100.
    fn lens() -> Intrinsics {
        Intrinsics::from_fov(200, 100, 90f64.to_radians())
    }

    fn quads(overlay: &Overlay) -> Vec<PixelQuad> {
        Pane::new(&lens(), &Isometry3::identity()).quads(overlay)
    }

    fn text(text: &str, at_m: [f64; 3], shadow: bool) -> Overlay {
        Overlay {
            texts: vec![DebugText {
                at_m,
                text: text.into(),
                color_rgb: [1, 2, 3],
                shadow,
            }],
            ..Overlay::default()
        }
    }

    #[test]
    fn a_line_has_its_width_in_pixels_at_any_distance() {
        for z in [1.0, 50.0] {
            let stroke = DebugStroke {
                from_m: [-0.5 * z, 0.0, z],
                to_m: [0.5 * z, 0.0, z],
                width_m: 4.0,
                color_rgb: [9; 3],
            };
            let overlay = Overlay {
                strokes: vec![stroke],
                ..Overlay::default()
            };
            let corners = quads(&overlay)[0].corners_px;
            let expected = [[50.0, 48.0], [50.0, 52.0], [150.0, 52.0], [150.0, 48.0]];
            let far = corners.iter().flatten().zip(expected.iter().flatten());
            assert!(
                far.clone().all(|(is, want)| (is - want).abs() < 1e-9),
                "{corners:?}"
            );
        }
    }

    #[test]
    fn a_text_begins_at_its_place_and_a_line_feed_begins_a_row() {
        // The bar "|" of the font fills rows in two columns; what counts is where its dots lie.
        let one = quads(&text("|", [0.0, 0.0, 2.0], false));
        let inside = |quads: &[PixelQuad], [x, y]: [f64; 2]| {
            quads
                .iter()
                .flat_map(|quad| quad.corners_px)
                .all(|[px, py]| (x..=x + 8.0).contains(&px) && (y..=y + 8.0).contains(&py))
        };
        assert!(!one.is_empty() && inside(&one, [100.0, 50.0]), "{one:?}");
        let two = quads(&text("\n|", [0.0, 0.0, 2.0], false));
        assert!(inside(&two, [100.0, 60.0]), "{two:?}");
        let shadowed = quads(&text("|", [0.0, 0.0, 2.0], true));
        assert_eq!(shadowed.len(), 2 * one.len());
        assert_eq!(shadowed[0].color_rgb, SHADOW_RGB, "the shadow lies below");
        assert_eq!(shadowed[one.len()..], one);
    }

    #[test]
    fn what_lies_behind_or_outside_is_not_drawn_and_letters_are_limited() {
        assert!(quads(&text("behind", [0.0, 0.0, -2.0], true)).is_empty());
        assert!(quads(&text("far right", [50.0, 0.0, 2.0], true)).is_empty());
        let overlay = Overlay {
            texts: vec![text("x", [0.0, 0.0, 2.0], false).texts.remove(0); MAX_LETTERS + 100],
            ..Overlay::default()
        };
        let of_one = quads(&text("x", [0.0, 0.0, 2.0], false)).len();
        assert_eq!(quads(&overlay).len(), MAX_LETTERS * of_one);
    }
}
