//! What rays hit, with exact distances.

use nalgebra::{Point3, Vector3};
use schema_types::{Class, ObjectId};

use super::bundle::{Bundle, GROUP, Hits, NOWHERE};
use crate::ray_scene::{Moment, Placed, RayScene};

/// What a ray hit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the ray, metres.
    pub distance_m: f64,
    /// Unit normal of the triangle, on the side of the ray's origin.
    pub normal_in_world: Vector3<f64>,
    /// Semantic class.
    pub class: Class,
    /// Object: the triangle's own, else its instance's.
    pub object: ObjectId,
    /// [`sensor_core::Material`] number.
    pub material: u8,
    /// Velocity of what was hit (of its mesh's origin), m/s; zero for scenery.
    pub velocity_in_world_mps: Vector3<f64>,
    /// Place and slot of the triangle, as [`Hits`] has them.
    pub(crate) triangle: [u32; 2],
}

impl Hit {
    /// Cosine between the incoming ray and the normal: 1 is head-on, never negative.
    pub fn cos_incidence(&self, direction: &Vector3<f64>) -> f64 {
        -direction.dot(&self.normal_in_world)
    }
}

/// The distance to the plane of the triangle. A sliver has no well-defined plane: where the two
/// distances disagree, the one found in `f32` counts.
#[inline(always)]
fn exact(plane_m: f64, found_m: f64) -> f64 {
    if (plane_m - found_m).abs() <= 0.01 + 0.01 * found_m {
        plane_m.max(0.0)
    } else {
        found_m
    }
}

/// A ray in the world.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WorldRay<'a> {
    pub origin_m: &'a Point3<f64>,
    /// Unit vector.
    pub direction: &'a Vector3<f64>,
    /// When it is fired; `None` is at the tick.
    pub moment: Option<Moment>,
}

/// What a ray of a bundle has hit.
#[inline(always)]
pub(crate) fn surface(
    scene: &RayScene,
    hits: &Hits,
    bundle: &Bundle,
    number: usize,
    ray: &WorldRay<'_>,
) -> Option<Hit> {
    let (place, slot, found_m) = found(hits, bundle, number)?;
    Some(resolve(scene, place, slot, found_m, ray))
}

/// How far away the hits of a group are; NaN without one. `directions` are unit vectors in the
/// world, an axis at a time; `moments` say when the rays are fired.
#[inline(always)]
pub(crate) fn distances_m(
    scene: &RayScene,
    hits: &Hits,
    bundle: &Bundle,
    group: usize,
    origin_m: &Point3<f64>,
    directions: &[[f64; GROUP]; 3],
    moments: &[Option<Moment>; GROUP],
) -> [f64; GROUP] {
    let mut corners = [[[0.0f64; GROUP]; 3]; 3];
    let mut found_m = [f64::NAN; GROUP];
    let mut moving = 0u32;
    for lane in 0..GROUP {
        let (place, slot) = (hits.place[group][lane], hits.slot[group][lane]);
        if place == NOWHERE {
            continue;
        }
        found_m[lane] = (hits.depth[group][lane] / bundle.depth[group][lane]) as f64;
        let Some(tile) = scene.scenery.tiles.get(place as usize) else {
            moving |= 1 << lane;
            continue;
        };
        let (block, of_block) = (
            &tile.tree.blocks[slot as usize / GROUP],
            slot as usize % GROUP,
        );
        for axis in 0..3 {
            let from = origin_m[axis] - tile.origin_m[axis];
            for (corner, of_all) in corners.iter_mut().zip(&block.corner) {
                corner[axis][lane] = of_all[axis][of_block] as f64 - from;
            }
        }
    }
    let mut distances_m = plane_distances(&corners, directions);
    for lane in 0..GROUP {
        distances_m[lane] = exact(distances_m[lane], found_m[lane]);
        if moving >> lane & 1 != 0 {
            let direction = Vector3::new(
                directions[0][lane],
                directions[1][lane],
                directions[2][lane],
            );
            let (place, slot) = (hits.place[group][lane], hits.slot[group][lane]);
            let ray = WorldRay {
                origin_m,
                direction: &direction,
                moment: moments[lane],
            };
            distances_m[lane] = resolve(scene, place, slot, found_m[lane], &ray).distance_m;
        }
    }
    distances_m
}

/// Looks up what was hit and computes the exact distance in `f64`: to the plane of the mesh's own
/// triangle, in the mesh's space when the ray is fired.
fn resolve(scene: &RayScene, place: u32, slot: u32, found_m: f64, ray: &WorldRay<'_>) -> Hit {
    let WorldRay {
        origin_m,
        direction,
        moment,
    } = *ray;
    let (placed, triangle) = triangle_of(scene, place, slot);
    let mesh = &scene.scenery.meshes[placed.mesh_idx as usize];
    let vertices = mesh.triangle(triangle as usize);
    let [v0, v1, v2] = vertices.map(|vertex| Point3::from(vertex.position_m.map(f64::from)));
    let normal = (v1 - v0).cross(&(v2 - v0));
    let leg = scene
        .motion
        .leg(placed, moment)
        .map(|(leg, share)| leg.at(share));
    let (origin, forward) = match &leg {
        Some((at_m, mesh_from_world)) => (
            mesh_from_world * (origin_m - at_m),
            mesh_from_world * direction,
        ),
        None => (
            placed.mesh_from_world * origin_m,
            placed.mesh_from_world.rotation * direction,
        ),
    };
    let slope = normal.dot(&forward);
    let plane_m = normal.dot(&(v0 - origin)) / slope;
    let outwards = if slope > 0.0 { -normal } else { normal };
    let [first, ..] = vertices;
    Hit {
        distance_m: exact(plane_m, found_m),
        normal_in_world: leg
            .map_or_else(
                || {
                    let rotation = &placed.mesh_from_world.rotation;
                    rotation.inverse_transform_vector(&outwards)
                },
                |(_, mesh_from_world)| mesh_from_world.tr_mul(&outwards),
            )
            .try_normalize(0.0)
            .unwrap_or(-direction),
        class: Class(first.class),
        object: placed.object_of(ObjectId(first.object_id)),
        material: first.material,
        velocity_in_world_mps: placed.velocity_in_world_mps,
        triangle: [place, slot],
    }
}

/// The normal of what a ray at the tick hit, as it is drawn: between those of a round surface's
/// corners, else that of the triangle.
pub(crate) fn smooth_normal(scene: &RayScene, hit: &Hit, ray: &WorldRay<'_>) -> Vector3<f64> {
    let [place, slot] = hit.triangle;
    let (placed, triangle) = triangle_of(scene, place, slot);
    let mesh = &scene.scenery.meshes[placed.mesh_idx as usize];
    let vertices = mesh.triangle(triangle as usize);
    let [a, b, c] = vertices.map(|vertex| vertex.normal);
    if a == b && a == c {
        return hit.normal_in_world;
    }
    let [v0, v1, v2] = vertices.map(|vertex| Point3::from(vertex.position_m.map(f64::from)));
    let at = placed.mesh_from_world * (ray.origin_m + ray.direction * hit.distance_m);
    let (ab, ac, from) = (v1 - v0, v2 - v0, at - v0);
    let across = ab.cross(&ac);
    let area = across.norm_squared();
    let share = [
        from.cross(&ac).dot(&across) / area,
        ab.cross(&from).dot(&across) / area,
    ];
    let unit = |n: [i8; 4]| Vector3::new(n[0], n[1], n[2]).cast::<f64>().normalize();
    let normal = unit(a) * (1.0 - share[0] - share[1]) + unit(b) * share[0] + unit(c) * share[1];
    let normal = placed
        .mesh_from_world
        .rotation
        .inverse_transform_vector(&normal);
    normal.try_normalize(1e-9).unwrap_or(hit.normal_in_world)
}

/// The instance that a hit is on, and the number of its mesh's triangle.
fn triangle_of(scene: &RayScene, place: u32, slot: u32) -> (&Placed, u32) {
    match scene.scenery.tiles.get(place as usize) {
        Some(tile) => {
            let (instance, triangle) = tile.sources[tile.tree.number(slot) as usize];
            (&scene.scenery.statics[instance as usize], triangle)
        }
        None => {
            let placed = &scene.dynamics[place as usize - scene.scenery.tiles.len()];
            let tree = scene.mesh_trees[placed.mesh_idx as usize]
                .as_ref()
                .expect("what was hit has a hierarchy");
            (placed, tree.number(slot))
        }
    }
}

/// Place, slot and `f32` distance of what a ray has hit.
#[inline(always)]
fn found(hits: &Hits, bundle: &Bundle, ray: usize) -> Option<(u32, u32, f64)> {
    let (group, lane) = (ray / GROUP, ray % GROUP);
    let place = hits.place[group][lane];
    (place != NOWHERE).then(|| {
        (
            place,
            hits.slot[group][lane],
            (hits.depth[group][lane] / bundle.depth[group][lane]) as f64,
        )
    })
}

/// Distances at which rays from the origin meet the planes of their triangles.
#[inline(always)]
fn plane_distances(
    corners: &[[[f64; GROUP]; 3]; 3],
    directions: &[[f64; GROUP]; 3],
) -> [f64; GROUP] {
    let [a, b, c] = corners;
    let mut distances = [0.0; GROUP];
    for lane in 0..GROUP {
        let (x1, y1, z1) = (
            b[0][lane] - a[0][lane],
            b[1][lane] - a[1][lane],
            b[2][lane] - a[2][lane],
        );
        let (x2, y2, z2) = (
            c[0][lane] - a[0][lane],
            c[1][lane] - a[1][lane],
            c[2][lane] - a[2][lane],
        );
        let (x, y, z) = (y1 * z2 - z1 * y2, z1 * x2 - x1 * z2, x1 * y2 - y1 * x2);
        let above = x * a[0][lane] + y * a[1][lane] + z * a[2][lane];
        distances[lane] =
            above / (x * directions[0][lane] + y * directions[1][lane] + z * directions[2][lane]);
    }
    distances
}
