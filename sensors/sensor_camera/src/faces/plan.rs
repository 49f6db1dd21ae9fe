//! Which faces a lens needs, and where in them each pixel of its picture lies.
//!
//! A lens that sees little beyond a pinhole's field gets one face. Any other gets the sides of a cube
//! that it sees, each turned towards what it sees of it and cut to that. All faces have one focal
//! length, so that patterns and shadows that depend on it go on from face to face.

use nalgebra::{Isometry3, Rotation3, UnitQuaternion, Vector3};
use rayon::prelude::*;
use schema_types::Lens;
use schema_types::space::sensor_from_camera;
use sensor_spec::Intrinsics;

/// Tangent of the largest angle off the axis, across and down, that one face shows: 50°.
const MAX_TANGENT: f64 = 1.192;
/// Pixels of a face around what is seen of it, for interpolation.
const MARGIN_PX: u32 = 2;
/// Longest side of a face, pixels.
const MAX_SIDE_PX: u32 = 4096;
/// Faces are as fine as the picture is up to this angle off the axis, whose cosine it is: 30°.
const SHARP_COSINE: f64 = 0.866;
/// Of a table's entry: what a place is counted in, per pixel.
const PER_PX: f64 = 65536.0;
/// Of a table's entry: where the number of the face begins.
const FACE_SHIFT: u32 = 29;
/// The number of no face, of pixels beyond the field.
const NO_FACE: u32 = 7;

/// One pinhole image that the picture is taken from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Face {
    pub intrinsics: Intrinsics,
    /// From the face's axes to those of the camera's sensor, both x ahead.
    pub sensor_from_face: UnitQuaternion<f64>,
    /// The part of the picture that shows it: x, y, width, height.
    pub shown_px: [u32; 4],
}

/// The faces of a lens, and where each pixel of the picture lies in them.
#[derive(Debug)]
pub(crate) struct FacePlan {
    pub size_px: [u32; 2],
    pub faces: Vec<Face>,
    /// Per pixel of the picture, row by row: the face in the upper three bits of the first word, and
    /// x and y of its place less half a pixel in 65536ths of a pixel of the face.
    pub table: Vec<[u32; 2]>,
}

/// A side of the cube while it is cut.
struct Cut {
    /// Rows: the face's right, down and ahead in the camera's axes.
    face_from_camera: Rotation3<f64>,
    /// Largest tangents off its axis, across and down.
    half: [f64; 2],
}

impl FacePlan {
    pub fn new(lens: &Lens, size_px: [u32; 2]) -> FacePlan {
        let [width, height] = size_px.map(|side| side as usize);
        let direction = |pixel: usize| {
            let at = [pixel % width, pixel / width].map(|place| place as f64 + 0.5);
            lens.unproject(at).map(Vector3::from)
        };
        let seen: Vec<Option<Vector3<f64>>> =
            (0..width * height).into_par_iter().map(direction).collect();
        let sides = match fits_one(&seen) {
            true => vec![0; seen.len()],
            false => seen.iter().map(|it| it.map_or(0, side_of)).collect(),
        };
        let of_side = |side: u32| {
            let own = seen.iter().zip(&sides).filter(move |it| *it.1 == side);
            own.filter_map(|it| *it.0)
        };
        let (mut cuts, mut number) = (Vec::new(), [NO_FACE; 6]);
        for side in 0..6 {
            if of_side(side).next().is_some() {
                number[side as usize] = cuts.len() as u32;
                cuts.push(cut(side, || of_side(side)));
            }
        }
        let face_of = |pixel: usize| {
            let direction = seen[pixel]?;
            let face = number[sides[pixel] as usize];
            let at = cuts[face as usize].face_from_camera * direction;
            Some((face, [at.x / at.z, at.y / at.z]))
        };
        let places: Vec<Option<(u32, [f64; 2])>> =
            (0..seen.len()).into_par_iter().map(face_of).collect();
        let focal_px = focal_px(&seen, &places, width, &cuts);
        let mut faces: Vec<Face> = cuts
            .iter()
            .map(|cut| {
                let side = |half: f64| 2 * ((focal_px * half).ceil() as u32 + MARGIN_PX);
                let turn = sensor_from_camera();
                let camera_from_face = UnitQuaternion::from(cut.face_from_camera.inverse());
                Face {
                    intrinsics: Intrinsics {
                        width_px: side(cut.half[0]),
                        height_px: side(cut.half[1]),
                        focal_px,
                    },
                    sensor_from_face: turn * camera_from_face * turn.inverse(),
                    shown_px: [u32::MAX, u32::MAX, 0, 0],
                }
            })
            .collect();
        let mut table = Vec::with_capacity(places.len());
        for (pixel, place) in places.iter().enumerate() {
            let Some((number, at)) = place else {
                table.push([NO_FACE << FACE_SHIFT, 0]);
                continue;
            };
            let face = &mut faces[*number as usize];
            let [x, y] = [pixel % width, pixel / width].map(|place| place as u32);
            let [left, top, right, bottom] = face.shown_px;
            face.shown_px = [left.min(x), top.min(y), right.max(x + 1), bottom.max(y + 1)];
            let Intrinsics {
                width_px,
                height_px,
                ..
            } = face.intrinsics;
            let place = |side: u32, tangent: f64| {
                let px = 0.5 * f64::from(side) + focal_px * tangent - 0.5;
                (px.max(0.0) * PER_PX).round() as u32
            };
            table.push([
                *number << FACE_SHIFT | place(width_px, at[0]),
                place(height_px, at[1]),
            ]);
        }
        for face in &mut faces {
            let [left, top, right, bottom] = face.shown_px;
            face.shown_px = [left, top, right - left, bottom - top];
        }
        FacePlan {
            size_px,
            faces,
            table,
        }
    }

    /// Pose of a face's camera if the sensor has this one.
    pub fn pose(&self, face: usize, world_from_sensor: &Isometry3<f64>) -> Isometry3<f64> {
        Isometry3::from_parts(
            world_from_sensor.translation,
            world_from_sensor.rotation * self.faces[face].sensor_from_face,
        )
    }
}

/// Whether one pinhole image holds all directions.
fn fits_one(seen: &[Option<Vector3<f64>>]) -> bool {
    let fits = |it: &Vector3<f64>| it.z > 0.0 && it.x.abs().max(it.y.abs()) <= MAX_TANGENT * it.z;
    seen.iter().flatten().all(fits)
}

/// The side of the cube that a direction meets: ahead, right, left, down, up, behind.
fn side_of(direction: Vector3<f64>) -> u32 {
    let [x, y, z] = direction.map(f64::abs).into();
    match () {
        () if z >= x && z >= y => u32::from(direction.z < 0.0) * 5,
        () if x >= y => 1 + u32::from(direction.x < 0.0),
        () => 3 + u32::from(direction.y < 0.0),
    }
}

/// The turn from the camera's axes to those of a side, whose axis is z.
fn facing(side: u32) -> Rotation3<f64> {
    let quarter = std::f64::consts::FRAC_PI_2;
    match side {
        0 => Rotation3::identity(),
        1 => Rotation3::from_axis_angle(&Vector3::y_axis(), -quarter),
        2 => Rotation3::from_axis_angle(&Vector3::y_axis(), quarter),
        3 => Rotation3::from_axis_angle(&Vector3::x_axis(), quarter),
        4 => Rotation3::from_axis_angle(&Vector3::x_axis(), -quarter),
        _ => Rotation3::from_axis_angle(&Vector3::y_axis(), 2.0 * quarter),
    }
}

/// The smallest face that holds these directions of a side: the side's own, or turned across, down or
/// both to the middle of what is seen.
fn cut<I: Iterator<Item = Vector3<f64>>>(side: u32, seen: impl Fn() -> I) -> Cut {
    let whole = facing(side);
    let turned = |from: &Rotation3<f64>, across: bool| {
        let angles = seen().map(|it| {
            let it = from * it;
            (if across { it.x } else { it.y }).atan2(it.z)
        });
        let [low, high] = angles.fold([f64::MAX, f64::MIN], |[low, high], it| {
            [low.min(it), high.max(it)]
        });
        let middle = 0.5 * (low + high);
        match across {
            true => Rotation3::from_axis_angle(&Vector3::y_axis(), -middle) * from,
            false => Rotation3::from_axis_angle(&Vector3::x_axis(), middle) * from,
        }
    };
    let across = turned(&whole, true);
    let (down, both) = (turned(&whole, false), turned(&across, false));
    let cuts = [whole, across, down, both].map(|face_from_camera| {
        let half = seen().fold([0.0f64; 2], |[x, y], it| {
            let it = face_from_camera * it;
            match it.z > 0.0 {
                true => [x.max((it.x / it.z).abs()), y.max((it.y / it.z).abs())],
                false => [f64::INFINITY; 2],
            }
        });
        Cut {
            face_from_camera,
            half,
        }
    });
    let area = |cut: &Cut| cut.half[0] * cut.half[1];
    let [first, rest @ ..] = cuts;
    rest.into_iter()
        .fold(first, |best, cut| match area(&cut) < 0.999 * area(&best) {
            true => cut,
            false => best,
        })
}

/// The focal length at which no pixel of a face is larger than the picture's near the axis, as far as
/// [`MAX_SIDE_PX`] allows. A picture that does not show its axis counts as a whole.
fn focal_px(
    seen: &[Option<Vector3<f64>>],
    places: &[Option<(u32, [f64; 2])>],
    width: usize,
    cuts: &[Cut],
) -> f64 {
    let is_near = |pixel: usize| seen[pixel].is_some_and(|it| it.z > SHARP_COSINE);
    let (mut near, mut whole) = (0.0f64, 1.0f64);
    for (pixel, place) in places.iter().enumerate() {
        let Some((face, [x, y])) = place else {
            continue;
        };
        let right = (pixel % width + 1 < width).then_some(pixel + 1);
        for next in right.into_iter().chain([pixel + width]) {
            if let Some(Some((other, [u, v]))) = places.get(next)
                && other == face
            {
                let per_tangent = 1.0 / (u - x).hypot(v - y).max(1e-9);
                whole = whole.max(per_tangent);
                if is_near(pixel) {
                    near = near.max(per_tangent);
                }
            }
        }
    }
    let half = cuts.iter().flat_map(|cut| cut.half).fold(1e-6, f64::max);
    let fits = f64::from(MAX_SIDE_PX / 2 - MARGIN_PX - 1) / half;
    if near > 0.0 { near } else { whole }.min(fits)
}

#[cfg(test)]
mod tests {
    use schema_types::lens::{LensModel, Plane};

    use super::*;

    fn lens(model: LensModel, focal_px: f64) -> Lens {
        let plane = Plane {
            focal_px: [focal_px; 2],
            shear_px: [0.0; 2],
            centre_px: [200.75, 148.5],
        };
        Lens::new(model, plane, Some(110f64.to_radians())).unwrap()
    }

    /// Oracle: the lens's own direction of each pixel. Interpolation must stay inside the face.
    #[test]
    fn every_pixel_lies_in_its_face_where_its_direction_does() {
        let fisheye = LensModel::KannalaBrandt {
            coefficients: [0.05, -0.01, 0.002, -0.0003],
        };
        for (lens, n_faces) in [
            (lens(LensModel::Pinhole {}, 200.0), 1),
            (lens(LensModel::Pinhole {}, 120.0), 5),
            (lens(fisheye, 110.0), 5),
            (lens(LensModel::Equidistant {}, 70.0), 5),
            (lens(LensModel::Stereographic {}, 60.0), 5),
        ] {
            let size_px = [400, 300];
            let plan = FacePlan::new(&lens, size_px);
            assert_eq!(plan.faces.len(), n_faces, "{lens:?}");
            let mut n_seen = 0;
            for (pixel, [first, second]) in plan.table.iter().enumerate() {
                let at = [pixel % 400, pixel / 400].map(|it| it as f64 + 0.5);
                let number = (first >> FACE_SHIFT) as usize;
                let Some(direction) = lens.unproject(at) else {
                    assert_eq!(number, NO_FACE as usize);
                    continue;
                };
                n_seen += 1;
                let face = &plan.faces[number];
                let Intrinsics {
                    width_px,
                    height_px,
                    focal_px,
                } = face.intrinsics;
                let place = [first & ((1 << FACE_SHIFT) - 1), *second];
                let place = place.map(|it| f64::from(it) / PER_PX);
                assert!(place[0] < f64::from(width_px - 1) && place[1] < f64::from(height_px - 1));
                let tangent = [
                    (place[0] + 0.5 - 0.5 * f64::from(width_px)) / focal_px,
                    (place[1] + 0.5 - 0.5 * f64::from(height_px)) / focal_px,
                ];
                let ahead = Vector3::new(1.0, -tangent[0], -tangent[1]);
                let found = (face.sensor_from_face * ahead).normalize();
                let expected = sensor_from_camera() * Vector3::from(direction);
                // A pixel of the table is 1 / 65536 of a pixel.
                assert!((found - expected).norm() < 2e-5 / focal_px, "{pixel}");
                let [left, top, width, height] = face.shown_px;
                let [x, y] = at.map(|it| it as u32);
                assert!((left..left + width).contains(&x) && (top..top + height).contains(&y));
            }
            assert!(n_seen > 1000);
        }
    }

    /// Goal: side faces of a fisheye are cut to what it sees of them.
    #[test]
    fn faces_of_a_fisheye_have_few_times_the_pixels_of_its_picture() {
        let coefficients = [0.05, -0.01, 0.002, -0.0003];
        let plan = FacePlan::new(
            &lens(LensModel::KannalaBrandt { coefficients }, 110.0),
            [400, 300],
        );
        let pixels = |it: &Face| it.intrinsics.width_px * it.intrinsics.height_px;
        let n_pixels: u32 = plan.faces.iter().map(pixels).sum();
        assert!(n_pixels < 2 * 400 * 300, "{n_pixels}");
    }
}
