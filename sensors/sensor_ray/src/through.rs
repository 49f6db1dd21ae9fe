//! Rays that go on through what they hit.

use nalgebra::{Point3, Vector3};

use crate::hit::Hit;
use crate::scene::RayScene;

/// Surfaces nearer to one another than this along a ray may count as one, metres.
const STEP_M: f64 = 1e-3;

impl RayScene {
    /// Every surface along a ray, nearest first, at most `max_hits`; distances are from `origin_m`.
    /// A body has a surface where the ray goes in
    /// and another where it comes out. Surfaces less than a millimetre behind another one may be
    /// left out.
    pub fn cast_through(
        &self,
        origin_m: &Point3<f64>,
        direction: &Vector3<f64>,
        max_m: f64,
        max_hits: usize,
    ) -> Vec<Hit> {
        let mut hits = Vec::new();
        let mut passed_m = 0.0;
        while hits.len() < max_hits && passed_m <= max_m {
            let from = origin_m + direction * passed_m;
            let Some(hit) = self.cast(&from, direction, max_m - passed_m) else {
                break;
            };
            let distance_m = passed_m + hit.distance_m;
            hits.push(Hit { distance_m, ..hit });
            passed_m = distance_m + STEP_M;
        }
        hits
    }
}
