//! Points of a cloud in the boxes of bodies.

use nalgebra::{Isometry3, Point3};

use crate::bodies::Body;

/// How far outside of a box a point still counts, metres: bodies touch their boxes from inside, and
/// points are rounded to `f32`.
pub const POINT_SLACK_M: f64 = 0.01;

/// Points of one cloud per body.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PointCounts {
    /// Points inside each body's box, by index in the list of bodies.
    pub in_box: Vec<u32>,
    /// Points whose object id is the body's; `None` if the cloud has no ids.
    pub with_id: Option<Vec<u32>>,
}

impl PointCounts {
    /// Counts points, given in the space of the sensor that stands at `world_from_sensor`; `ids`
    /// are their object ids, as many as points.
    pub fn count(
        points_m: &[[f32; 3]],
        ids: Option<&[u32]>,
        world_from_sensor: &Isometry3<f64>,
        bodies: &[Body],
    ) -> PointCounts {
        let sensor_from_world = world_from_sensor.inverse();
        let square = |p: &[f32; 3]| p[0] * p[0] + p[1] * p[1] + p[2] * p[2];
        let furthest = points_m.iter().map(square).fold(0.0f32, f32::max).sqrt();
        let in_box = bodies.iter().map(|body| {
            let box_from_sensor = (sensor_from_world * body.world_from_box).inverse();
            let centre = box_from_sensor.inverse().translation.vector.cast::<f32>();
            let half = body.half_m.add_scalar(POINT_SLACK_M);
            let reach = (half.norm() as f32).powi(2) * 1.001;
            if centre.norm() > furthest * 1.001 + reach.sqrt() {
                return 0;
            }
            let inside = |p: &&[f32; 3]| {
                let (dx, dy, dz) = (p[0] - centre.x, p[1] - centre.y, p[2] - centre.z);
                dx * dx + dy * dy + dz * dz <= reach && {
                    let at = box_from_sensor * Point3::from(p.map(f64::from));
                    (0..3).all(|axis| at[axis].abs() <= half[axis])
                }
            };
            points_m.iter().filter(inside).count() as u32
        });
        let in_box = in_box.collect();
        let with_id = ids.map(|ids| {
            let mut counts = std::collections::HashMap::new();
            for id in ids {
                *counts.entry(*id).or_insert(0u32) += 1;
            }
            bodies
                .iter()
                .map(|body| counts.get(&body.id).copied().unwrap_or(0))
                .collect()
        });
        PointCounts { in_box, with_id }
    }
}
