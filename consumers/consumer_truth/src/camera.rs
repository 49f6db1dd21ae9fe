//! A camera, and outlines in its image, which a lens may bend.

use nalgebra::{Isometry3, Point3};
use schema_frames::FrameHeader;
use schema_types::Distortion;
use schema_types::space::sensor_from_camera;

/// Nothing nearer is drawn, metres along the optical axis.
pub const NEAR_M: f64 = 0.1;

/// How far an outline's chords may lie beside the bent line, pixels.
const BENT_WITHIN_PX: f64 = 0.05;
/// Halvings of a bent line in any case, and at most.
const HALVINGS: [u32; 2] = [2, 10];

/// A camera at one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Optical axes (x right, y down, z forward) in the world.
    pub world_from_camera: Isometry3<f64>,
    /// Focal lengths, pixels.
    pub focal_px: [f64; 2],
    /// Principal point from the outer corner of the top-left pixel, pixels.
    pub centre_px: [f64; 2],
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// How its lens bends lines; `None` for a pinhole.
    pub lens: Option<Distortion>,
}

/// A polygon in the image, counter-clockwise in x right, y down or the other way round, convex but
/// for what a lens bends; without area if it has fewer than three corners.
pub type Outline = Vec<[f64; 2]>;

impl Camera {
    /// The camera that took a frame.
    pub fn of(header: &FrameHeader) -> Camera {
        let [fx, fy, cx, cy] = header.intrinsics_px;
        Camera {
            world_from_camera: header.world_from_sensor.isometry() * sensor_from_camera(),
            focal_px: [fx, fy],
            centre_px: [cx, cy],
            width: header.width,
            height: header.height,
            lens: header.distortion(),
        }
    }

    /// Image of a point in the camera's space; meaningless if it does not lie in front.
    pub fn project(&self, at_m: &Point3<f64>) -> [f64; 2] {
        self.bent(self.straight(at_m))
    }

    /// As [`Camera::project`] of a camera without its lens.
    fn straight(&self, at_m: &Point3<f64>) -> [f64; 2] {
        [
            self.focal_px[0] * at_m.x / at_m.z + self.centre_px[0],
            self.focal_px[1] * at_m.y / at_m.z + self.centre_px[1],
        ]
    }

    /// Where the image has what one without the lens has at a place, pixels.
    fn bent(&self, at_px: [f64; 2]) -> [f64; 2] {
        self.through(at_px, Distortion::unbend)
    }

    /// Where an image without the lens has what this one has at a place, pixels.
    pub fn unbent(&self, at_px: [f64; 2]) -> [f64; 2] {
        self.through(at_px, Distortion::bend)
    }

    fn through(
        &self,
        at_px: [f64; 2],
        way: impl Fn(&Distortion, [f64; 2]) -> [f64; 2],
    ) -> [f64; 2] {
        let Some(lens) = &self.lens else {
            return at_px;
        };
        let sides = [self.width, self.height].map(f64::from);
        let from_middle = [0, 1].map(|axis| (at_px[axis] - self.centre_px[axis]) / sides[axis]);
        let moved = way(lens, from_middle);
        [0, 1].map(|axis| moved[axis] * sides[axis] + self.centre_px[axis])
    }

    /// Corners of a bent outline, close enough together.
    fn bent_outline(&self, straight: &[[f64; 2]]) -> Outline {
        let ends = straight.iter().zip(straight.iter().cycle().skip(1));
        let mut outline = Vec::with_capacity(4 * straight.len());
        for (a, b) in ends {
            outline.push(self.bent(*a));
            self.bent_line([*a, *b], 0, &mut outline);
        }
        outline
    }

    /// Adds places between the bent ends of a straight line until no chord is far from it.
    fn bent_line(&self, [a, b]: [[f64; 2]; 2], depth: u32, outline: &mut Outline) {
        let middle = [0, 1].map(|axis| 0.5 * (a[axis] + b[axis]));
        let [bent_a, bent_middle, bent_b] = [a, middle, b].map(|at| self.bent(at));
        let beside = [0, 1].map(|axis| bent_middle[axis] - 0.5 * (bent_a[axis] + bent_b[axis]));
        let is_straight = beside[0].hypot(beside[1]) < BENT_WITHIN_PX;
        if depth >= HALVINGS[1] || (depth >= HALVINGS[0] && is_straight) {
            return;
        }
        self.bent_line([a, middle], depth + 1, outline);
        outline.push(bent_middle);
        self.bent_line([middle, b], depth + 1, outline);
    }

    /// The image's own outline.
    pub fn frame(&self) -> [f64; 4] {
        [0.0, 0.0, f64::from(self.width), f64::from(self.height)]
    }

    /// Outline of a box whose corners (numbered as in [`super::Body::corners_in_world_m`]) are given
    /// in the camera's space; empty if all of it is nearer than the near plane.
    pub fn hull(&self, corners_m: &[Point3<f64>; 8]) -> Outline {
        let mut points = Vec::with_capacity(16);
        for (i, a) in corners_m.iter().enumerate() {
            if a.z >= NEAR_M {
                points.push(self.straight(a));
            }
            for bit in [1usize, 2, 4] {
                let b = &corners_m[i | bit];
                if i & bit == 0 && (a.z < NEAR_M) != (b.z < NEAR_M) {
                    let t = (NEAR_M - a.z) / (b.z - a.z);
                    let mut cut = a + (b - a) * t;
                    cut.z = NEAR_M;
                    points.push(self.straight(&cut));
                }
            }
        }
        let straight = convex(points);
        match self.lens {
            Some(_) => self.bent_outline(&straight),
            None => straight,
        }
    }
}

/// Convex outline of some points (Andrew's monotone chain).
pub fn convex(mut points: Vec<[f64; 2]>) -> Outline {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let turn = |o: [f64; 2], a: [f64; 2], b: [f64; 2]| {
        (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])
    };
    let half = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut chain: Outline = Vec::new();
        for point in points {
            while chain.len() >= 2
                && turn(chain[chain.len() - 2], chain[chain.len() - 1], point) <= 0.0
            {
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut hull = half(&mut points.iter().copied());
    hull.extend(half(&mut points.iter().rev().copied()));
    hull
}

/// Area of an outline, square pixels.
pub fn area_px(outline: &[[f64; 2]]) -> f64 {
    let next = outline.iter().cycle().skip(1);
    let twice: f64 = outline
        .iter()
        .zip(next)
        .map(|(a, b)| a[0] * b[1] - b[0] * a[1])
        .sum();
    twice.abs() / 2.0
}

/// The part of an outline within `[x0, y0, x1, y1]` (Sutherland and Hodgman).
pub fn clipped(outline: &[[f64; 2]], frame: [f64; 4]) -> Outline {
    let mut outline = outline.to_vec();
    for (axis, limit, sign) in [
        (0, frame[0], 1.0),
        (1, frame[1], 1.0),
        (0, frame[2], -1.0),
        (1, frame[3], -1.0),
    ] {
        let inside = |p: &[f64; 2]| (p[axis] - limit) * sign >= 0.0;
        let mut kept = Vec::with_capacity(outline.len() + 1);
        for (i, a) in outline.iter().enumerate() {
            let b = &outline[(i + 1) % outline.len()];
            if inside(a) {
                kept.push(*a);
            }
            if inside(a) != inside(b) {
                let t = (limit - a[axis]) / (b[axis] - a[axis]);
                let mut cut = [a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t];
                cut[axis] = limit;
                kept.push(cut);
            }
        }
        outline = kept;
    }
    outline
}

/// Smallest rectangle `[x0, y0, x1, y1]` round an outline; `None` if it has no corners.
pub fn bounds(outline: &[[f64; 2]]) -> Option<[f64; 4]> {
    let first = outline.first()?;
    Some(
        outline
            .iter()
            .fold([first[0], first[1], first[0], first[1]], |b, p| {
                [
                    b[0].min(p[0]),
                    b[1].min(p[1]),
                    b[2].max(p[0]),
                    b[3].max(p[1]),
                ]
            }),
    )
}

/// Pixels whose centres lie within an outline inside an image, in runs by rising row and column:
/// `(row, first column, column behind the last)`.
pub fn rows(outline: &[[f64; 2]], width: u32, height: u32) -> Vec<(u32, u32, u32)> {
    let Some([_, top, _, bottom]) = bounds(outline).filter(|_| outline.len() >= 3) else {
        return Vec::new();
    };
    let first = (top - 0.5).ceil().clamp(0.0, f64::from(height)) as u32;
    let last = (bottom - 0.5).floor().clamp(-1.0, f64::from(height) - 1.0);
    let (mut rows, mut crossed) = (Vec::new(), Vec::new());
    for row in first..(last + 1.0) as u32 {
        let y = f64::from(row) + 0.5;
        crossed.clear();
        for (i, a) in outline.iter().enumerate() {
            let b = &outline[(i + 1) % outline.len()];
            if (a[1] <= y) != (b[1] <= y) {
                let x = a[0] + (b[0] - a[0]) * (y - a[1]) / (b[1] - a[1]);
                crossed.push(x);
            }
        }
        crossed.sort_by(f64::total_cmp);
        for [left, right] in crossed.as_chunks().0 {
            let from = (left - 0.5).ceil().clamp(0.0, f64::from(width)) as u32;
            let to = ((right - 0.5).floor() + 1.0).clamp(0.0, f64::from(width)) as u32;
            if from < to {
                rows.push((row, from, to));
            }
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_keeps_its_area_and_its_pixels_when_it_is_cut() {
        let square = convex(vec![
            [-5.0, 2.0],
            [5.0, 2.0],
            [5.0, 8.0],
            [-5.0, 8.0],
            [0.0, 5.0],
        ]);
        assert_eq!(square.len(), 4);
        assert_eq!(area_px(&square), 60.0);
        let half = clipped(&square, [0.0, 0.0, 20.0, 20.0]);
        assert_eq!(area_px(&half), 30.0);
        let n: u32 = rows(&half, 20, 20)
            .iter()
            .map(|(_, from, to)| to - from)
            .sum();
        assert_eq!(n, 30);
        assert!(clipped(&square, [10.0, 0.0, 20.0, 20.0]).len() < 3);
    }

    #[test]
    fn rows_are_those_that_testing_every_pixel_finds() {
        let mut rng = fastrand::Rng::with_seed(3);
        for _ in 0..300 {
            let mut at = || rng.f64() * 60.0 - 10.0;
            let hull = convex((0..7).map(|_| [at(), at()]).collect());
            let inside = |x: f64, y: f64| {
                (0..hull.len()).all(|i| {
                    let (a, b) = (hull[i], hull[(i + 1) % hull.len()]);
                    (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) >= 0.0
                })
            };
            let mut expected = Vec::new();
            for row in 0..40u32 {
                let columns: Vec<u32> = (0..40)
                    .filter(|column| inside(f64::from(*column) + 0.5, f64::from(row) + 0.5))
                    .collect();
                if let (Some(first), Some(last)) = (columns.first(), columns.last()) {
                    expected.push((row, *first, last + 1));
                }
            }
            assert_eq!(rows(&hull, 40, 40), expected);
        }
    }

    #[test]
    fn a_box_that_reaches_behind_the_camera_is_cut_at_the_near_plane() {
        let camera = Camera {
            world_from_camera: Isometry3::identity(),
            focal_px: [100.0, 100.0],
            centre_px: [50.0, 50.0],
            width: 100,
            height: 100,
            lens: None,
        };
        let corners = |near: f64, far: f64| {
            std::array::from_fn(|i| {
                let pick = |bit: usize, low, high| if i >> bit & 1 == 1 { high } else { low };
                Point3::new(pick(0, -1.0, 1.0), pick(1, -1.0, 1.0), pick(2, near, far))
            })
        };
        let whole = bounds(&camera.hull(&corners(2.0, 4.0))).expect("it is in front");
        assert_eq!(whole, [0.0, 0.0, 100.0, 100.0]);
        let cut = bounds(&camera.hull(&corners(-1.0, 4.0))).expect("half of it is in front");
        assert!((cut[0] - (50.0 - 1000.0)).abs() < 1e-9, "{cut:?}");
        assert!(camera.hull(&corners(-4.0, -1.0)).is_empty());
    }

    /// Every pixel of a bent rectangle, found by asking where a pinhole has each pixel's centre.
    #[test]
    fn a_bent_box_covers_the_pixels_that_the_lens_shows_of_it() {
        for lens in [[0.5, 0.0, 1.0, 0.8], [-0.3, 0.1, 1.0, 1.0]] {
            let camera = Camera {
                world_from_camera: Isometry3::identity(),
                focal_px: [200.0, 200.0],
                centre_px: [160.0, 100.0],
                width: 320,
                height: 200,
                lens: Distortion::from_array(lens),
            };
            for (left, top, right, bottom) in [
                (20.0, 10.0, 120.0, 70.0),
                (-900.0, 60.0, 300.0, 190.0),
                (90.0, 40.0, 230.0, 160.0),
            ] {
                // A plate 2 m ahead, as thin as a sheet.
                let corners = std::array::from_fn(|i| {
                    let pick = |bit: usize, low, high| if i >> bit & 1 == 1 { high } else { low };
                    let (x, y) = (pick(0, left, right) - 160.0, pick(1, top, bottom) - 100.0);
                    Point3::new(x / 100.0, y / 100.0, 2.0)
                });
                let outline = camera.hull(&corners);
                let inside = clipped(&outline, camera.frame());
                let found = rows(&inside, camera.width, camera.height);
                // How far the place that a pixel's centre shows is inside the plate, pixels.
                let inside_px = |x: u32, y: u32| {
                    let [x, y] = camera.unbent([f64::from(x) + 0.5, f64::from(y) + 0.5]);
                    (x - left).min(right - x).min(y - top).min(bottom - y)
                };
                for y in 0..camera.height {
                    for x in 0..camera.width {
                        let mut runs = found.iter().filter(|run| run.0 == y);
                        let covered = runs.any(|run| (run.1..run.2).contains(&x));
                        let depth_px = inside_px(x, y);
                        assert!(
                            depth_px.abs() < 0.1 || covered == (depth_px > 0.0),
                            "{lens:?} {left}: {x} {y} {depth_px}"
                        );
                    }
                }
            }
        }
    }
}
