//! Boxes of bodies in an image: what of them is inside of it, and what can be seen.

use nalgebra::{Isometry3, Vector3};

use crate::bodies::Body;
use crate::camera::{Camera, Outline, area_px, bounds, clipped, rows};
use crate::segments::{by_id, segments};

/// How much nearer than a body's box something must be to cover it, metres: kerbs and slopes cut
/// into boxes by less.
pub const DEPTH_SLACK_M: f64 = 0.1;

/// Exact images of one camera and tick, tight.
#[derive(Clone, Copy, Debug, Default)]
pub struct Images<'a> {
    /// Object ids.
    pub instance: Option<&'a [u32]>,
    /// Metres along the optical axis.
    pub depth: Option<&'a [f32]>,
}

/// A body in an image. Fractions lie in 0..=1; the module [`super`] defines all of them.
#[derive(Clone, Debug, PartialEq)]
pub struct BoxTruth {
    /// Index in the list of bodies.
    pub body: usize,
    /// Outline of the projected box; may reach out of the image.
    pub hull: Outline,
    /// Rectangle round the hull: left, top, right, bottom, pixels.
    pub projected_px: [f64; 4],
    /// Rectangle round the part of the hull inside the image.
    pub clipped_px: [f64; 4],
    /// Pixels of the hull inside the image.
    pub hull_pixels: u64,
    /// Share of the hull's area outside of the image.
    pub truncation: f64,
    /// What can be seen; `None` without an instance image.
    pub seen: Option<Seen>,
    /// Distance of the box's centre along the optical axis, metres.
    pub depth_m: f64,
}

/// What can be seen of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// Pixels that show it.
    pub pixels: u64,
    /// Rectangle round them (first column and row, column and row behind the last); `None` if there
    /// are none.
    pub bounds: Option<[u32; 4]>,
    /// Pixels of its hull that are covered.
    pub covered_pixels: u64,
    /// Covered pixels over the hull's pixels inside the image.
    pub occlusion: f64,
    /// Share of the body that can be seen in this image.
    pub visible_fraction: f64,
}

/// Every body whose hull reaches into the image, by rising index.
pub fn box_truths(camera: &Camera, bodies: &[Body], images: Images<'_>) -> Vec<BoxTruth> {
    let camera_from_world = camera.world_from_camera.inverse();
    let own = images
        .instance
        .map(|ids| by_id(&segments(ids, None, camera.width)));
    let distances: std::collections::HashMap<u32, f64> = bodies
        .iter()
        .map(|body| {
            (
                body.id,
                (camera_from_world * body.world_from_box)
                    .translation
                    .vector
                    .norm(),
            )
        })
        .collect();
    let mut truths = Vec::new();
    for (index, body) in bodies.iter().enumerate() {
        let camera_from_box = camera_from_world * body.world_from_box;
        let corners = body
            .corners_in_world_m()
            .map(|corner| camera_from_world * corner);
        let hull = camera.hull(&corners);
        let inside = clipped(&hull, camera.frame());
        let (area, area_inside) = (area_px(&hull), area_px(&inside));
        let seen_at_all = own.as_ref().is_some_and(|own| own.contains_key(&body.id));
        if area_inside <= 0.0 && !seen_at_all {
            continue;
        }
        let Some(projected_px) = bounds(&hull) else {
            continue;
        };
        let frame = camera.frame();
        let at_rim = [
            projected_px[0].clamp(frame[0], frame[2]),
            projected_px[1].clamp(frame[1], frame[3]),
            projected_px[2].clamp(frame[0], frame[2]),
            projected_px[3].clamp(frame[1], frame[3]),
        ];
        let truncation = if area > 0.0 {
            (1.0 - area_inside / area).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let rows = rows(&inside, camera.width, camera.height);
        let hull_pixels = rows.iter().map(|(_, from, to)| u64::from(to - from)).sum();
        let seen = own.as_ref().zip(images.instance).map(|(own, ids)| {
            let (pixels, bounds) = own.get(&body.id).map_or((0, None), |(n, b)| (*n, Some(*b)));
            let entry = Entry::new(camera, &camera_from_box, &body.half_m);
            let own_distance = distances[&body.id];
            let covered = |row: u32, column: u32| {
                let at = row as usize * camera.width as usize + column as usize;
                if ids[at] == body.id {
                    return false;
                }
                match images.depth {
                    Some(depth) => entry
                        .depth_m(camera.unbent([f64::from(column) + 0.5, f64::from(row) + 0.5]))
                        .is_some_and(|entry| f64::from(depth[at]) < entry - DEPTH_SLACK_M),
                    None => distances
                        .get(&ids[at])
                        .is_some_and(|other| *other < own_distance),
                }
            };
            let covered_pixels = rows
                .iter()
                .map(|&(row, from, to)| {
                    (from..to).filter(|column| covered(row, *column)).count() as u64
                })
                .sum::<u64>();
            let occlusion = if hull_pixels > 0 {
                covered_pixels as f64 / hull_pixels as f64
            } else {
                0.0
            };
            let visible_fraction = if pixels > 0 {
                (1.0 - occlusion) * (1.0 - truncation)
            } else {
                0.0
            };
            Seen {
                pixels,
                bounds,
                covered_pixels,
                occlusion,
                visible_fraction,
            }
        });
        truths.push(BoxTruth {
            body: index,
            projected_px,
            clipped_px: bounds(&inside).unwrap_or(at_rim),
            hull,
            hull_pixels,
            truncation,
            seen,
            depth_m: camera_from_box.translation.vector.z,
        });
    }
    truths
}

/// Where rays through pixels of an image without a lens enter a box.
struct Entry {
    /// The camera's centre in the box's space, metres.
    origin: Vector3<f64>,
    /// In the box's space: the ray of the principal point, and what one pixel to the right and one
    /// down add to it; all have length 1 along the optical axis.
    ahead: Vector3<f64>,
    right: Vector3<f64>,
    down: Vector3<f64>,
    centre_px: [f64; 2],
    half_m: Vector3<f64>,
}

impl Entry {
    fn new(camera: &Camera, camera_from_box: &Isometry3<f64>, half_m: &Vector3<f64>) -> Entry {
        let box_from_camera = camera_from_box.inverse();
        let turned = |v: Vector3<f64>| box_from_camera.rotation * v;
        Entry {
            origin: box_from_camera.translation.vector,
            ahead: turned(Vector3::z()),
            right: turned(Vector3::x()) / camera.focal_px[0],
            down: turned(Vector3::y()) / camera.focal_px[1],
            centre_px: camera.centre_px,
            half_m: *half_m,
        }
    }

    /// Depth along the optical axis at which the ray enters the box, metres; `None` if it misses,
    /// 0 if it begins inside.
    fn depth_m(&self, [x_px, y_px]: [f64; 2]) -> Option<f64> {
        let ray = self.ahead
            + self.right * (x_px - self.centre_px[0])
            + self.down * (y_px - self.centre_px[1]);
        let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
        for axis in 0..3 {
            let inverse = 1.0 / ray[axis];
            let a = (-self.half_m[axis] - self.origin[axis]) * inverse;
            let b = (self.half_m[axis] - self.origin[axis]) * inverse;
            // A ray along a face gives no number here, and `min` and `max` then take the other one.
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        (enter <= leave).then_some(enter)
    }
}

#[cfg(test)]
mod tests {
    use schema_frames::ActorKind;

    use super::*;

    fn camera() -> Camera {
        Camera {
            world_from_camera: Isometry3::identity(),
            focal_px: [100.0, 100.0],
            centre_px: [50.0, 50.0],
            width: 100,
            height: 100,
            lens: None,
        }
    }

    /// A cube of 2 m at a place in the camera's space.
    fn cube(id: u32, x: f64, y: f64, z: f64) -> Body {
        Body {
            id,
            kind: ActorKind::Vehicle,
            class: 14,
            type_id: String::new(),
            base_type: String::new(),
            special_type: String::new(),
            age: String::new(),
            is_seated: false,
            is_down: false,
            world_from_box: Isometry3::translation(x, y, z),
            half_m: Vector3::repeat(1.0),
            velocity_mps: Vector3::zeros(),
        }
    }

    /// Images of cubes alone, by casting a ray through every pixel.
    fn cast(camera: &Camera, cubes: &[Body]) -> (Vec<u32>, Vec<f32>) {
        let mut ids = Vec::new();
        let mut depths = Vec::new();
        for row in 0..camera.height {
            for column in 0..camera.width {
                let hit = cubes
                    .iter()
                    .filter_map(|cube| {
                        let entry = Entry::new(camera, &cube.world_from_box, &cube.half_m);
                        let (x, y) = (f64::from(column) + 0.5, f64::from(row) + 0.5);
                        entry
                            .depth_m([x, y])
                            .filter(|depth| *depth > 0.0)
                            .map(|depth| (depth, cube.id))
                    })
                    .min_by(|a, b| a.0.total_cmp(&b.0));
                ids.push(hit.map_or(0, |hit| hit.1));
                depths.push(hit.map_or(f32::INFINITY, |hit| hit.0 as f32));
            }
        }
        (ids, depths)
    }

    #[test]
    fn a_cube_in_plain_sight_is_all_there() {
        let cubes = [cube(7, 0.0, 0.0, 11.0)];
        let (ids, depths) = cast(&camera(), &cubes);
        let images = Images {
            instance: Some(&ids),
            depth: Some(&depths),
        };
        let truth = &box_truths(&camera(), &cubes, images)[0];
        assert_eq!(truth.projected_px, [40.0, 40.0, 60.0, 60.0]);
        assert_eq!(truth.truncation, 0.0);
        let seen = truth.seen.expect("there is an instance image");
        assert_eq!((seen.pixels, seen.bounds), (400, Some([40, 40, 60, 60])));
        assert_eq!((seen.occlusion, seen.visible_fraction), (0.0, 1.0));
    }

    #[test]
    fn half_behind_another_and_half_out_of_the_image_leave_a_quarter() {
        // The far cube spans columns −10 to 10; the near one hides its lower half.
        let far = cube(7, -5.5, 0.0, 12.0);
        let near = cube(8, -2.5, 1.0, 6.0);
        let camera = camera();
        for with_depth in [true, false] {
            let cubes = [far.clone(), near.clone()];
            let (ids, depths) = cast(&camera, &cubes);
            let depth = with_depth.then_some(&depths[..]);
            let truths = box_truths(
                &camera,
                &cubes,
                Images {
                    instance: Some(&ids),
                    depth,
                },
            );
            let truth = &truths[0];
            // Its hull is wider than the front face; area by area is what the definition says.
            let inside = clipped(&truth.hull, camera.frame());
            let expected = 1.0 - area_px(&inside) / area_px(&truth.hull);
            assert!((truth.truncation - expected).abs() < 1e-12);
            assert!(
                truth.truncation > 0.3 && truth.truncation < 0.7,
                "{}",
                truth.truncation
            );
            let seen = truth.seen.expect("there is an instance image");
            let hidden = rows(&inside, 100, 100)
                .iter()
                .flat_map(|&(row, from, to)| (from..to).map(move |column| (row, column)))
                .filter(|(row, column)| ids[(row * 100 + column) as usize] == 8)
                .count() as u64;
            assert_eq!(seen.covered_pixels, hidden, "with depth: {with_depth}");
            assert!(
                seen.occlusion > 0.3 && seen.occlusion < 0.7,
                "{}",
                seen.occlusion
            );
            assert!(
                (seen.visible_fraction - (1.0 - seen.occlusion) * (1.0 - truth.truncation)).abs()
                    < 1e-12
            );
            // The near one is covered by nobody.
            assert_eq!(truths[1].seen.map(|seen| seen.covered_pixels), Some(0));
        }
    }

    #[test]
    fn what_cannot_be_seen_at_all_has_no_rectangle() {
        let cubes = [cube(7, 0.0, 0.0, 30.0), cube(8, 0.0, 0.0, 5.0)];
        let (ids, depths) = cast(&camera(), &cubes);
        let images = Images {
            instance: Some(&ids),
            depth: Some(&depths),
        };
        let truths = box_truths(&camera(), &cubes, images);
        let seen = truths[0].seen.expect("there is an instance image");
        assert_eq!(
            (seen.pixels, seen.bounds, seen.visible_fraction),
            (0, None, 0.0)
        );
        assert_eq!(seen.occlusion, 1.0);
        assert!(box_truths(&camera(), &[cube(7, 0.0, 0.0, -9.0)], images).is_empty());
    }
}
