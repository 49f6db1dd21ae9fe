//! Single rays: the nearest hit, and every surface along a ray.

use nalgebra::{Point3, Vector3};
use schema_types::ActorId;
use sensor_core::vector_lanes::in_lanes;

use super::bundle::{Bundle, Hits, Sides};
use super::caster::{Caster, OneBundle, Stacks};
use super::hit::{Hit, WorldRay, surface};
use crate::ray_scene::RayScene;

/// Two surfaces that lie nearer to one another along a ray than this may count as one, metres.
const STEP_M: f64 = 1e-3;

impl RayScene {
    /// The nearest hit from `origin_m` along the unit vector `direction` within `max_m`. Both sides
    /// of triangles count.
    pub fn cast(
        &self,
        origin_m: &Point3<f64>,
        direction: &Vector3<f64>,
        max_m: f64,
    ) -> Option<Hit> {
        self.cast_ignoring(origin_m, direction, max_m, None)
    }

    /// As [`RayScene::cast`], through the parts of one actor.
    pub fn cast_ignoring(
        &self,
        origin_m: &Point3<f64>,
        direction: &Vector3<f64>,
        max_m: f64,
        ignored: Option<ActorId>,
    ) -> Option<Hit> {
        self.cast_sides(origin_m, direction, max_m, ignored, Sides::Both)
    }

    /// As [`RayScene::cast`], but only the fronts of triangles count.
    pub(crate) fn cast_fronts(
        &self,
        origin_m: &Point3<f64>,
        direction: &Vector3<f64>,
        max_m: f64,
    ) -> Option<Hit> {
        self.cast_sides(origin_m, direction, max_m, None, Sides::Front)
    }

    fn cast_sides(
        &self,
        origin_m: &Point3<f64>,
        direction: &Vector3<f64>,
        max_m: f64,
        ignored: Option<ActorId>,
        sides: Sides,
    ) -> Option<Hit> {
        let mut caster = Caster {
            scene: self,
            ignored,
            moment: None,
            stacks: Stacks::default(),
        };
        let bundle = Bundle::new(&[Some(*direction)])?;
        let mut hits = Hits::new(&bundle, max_m);
        hits.sides = sides;
        in_lanes(OneBundle {
            caster: &mut caster,
            origin_m,
            bundle: &bundle,
            hits: &mut hits,
        });
        let ray = WorldRay {
            origin_m,
            direction,
            moment: None,
        };
        surface(self, &hits, &bundle, 0, &ray).filter(|hit| hit.distance_m <= max_m)
    }

    /// Every surface along a ray, nearest first, at most `max_hits`; distances are from `origin_m`.
    /// A body has one surface where the ray enters it and another where it leaves. A surface less
    /// than a millimetre behind another one may be left out.
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
