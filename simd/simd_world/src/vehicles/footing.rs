//! The solid ground near a vehicle, cached for its wheels.
//!
//! Every wheel needs the ground below it in every sub-step, and a search through a whole town each
//! time would cost more than the rest of the vehicle's physics. So a vehicle caches the triangles
//! in a room around it, until it leaves that room or the ground changes. The result does not depend
//! on the cache: of the triangles whose box touches the ray's box, the nearest hit counts, and of
//! equally near ones the first by collider and triangle number. A vehicle with a full cache, with
//! an empty one or just restored from a checkpoint finds the same bits.

use rapier3d::math::{Pose, Vector};
use rapier3d::parry::query::details::local_ray_intersection_with_triangle;
use rapier3d::prelude::*;

use crate::physics::{Room, StillThings};

/// Margin of the room around the rays, metres, and how far ahead it reaches at the vehicle's
/// velocity, seconds.
const MARGIN_M: f32 = 0.5;
const AHEAD_SECS: f32 = 0.15;
/// With more triangles than this, the room shrinks to the rays' own boxes.
const MOST_TRIANGLES: usize = 512;
/// Rays' boxes are made this much thicker, so that no ray slips through between two neighbouring
/// triangles, metres.
const SKIN_M: f32 = 1e-3;

/// A ray of limited length, and its box.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Feeler {
    from: Vector,
    direction: Vector,
    length_m: f32,
    room: Room,
}

impl Feeler {
    pub const NONE: Feeler = Feeler {
        from: Vector::ZERO,
        direction: Vector::Z,
        length_m: 0.0,
        room: Room::NOWHERE,
    };

    /// `direction` has unit length.
    pub fn new(from: Vector, direction: Vector, length_m: f32) -> Feeler {
        let room = Room::around([from, from + direction * length_m]).grown(Vector::splat(SKIN_M));
        Feeler {
            from,
            direction,
            length_m,
            room,
        }
    }
}

/// Where a feeler hits something: distance along it, and the normal there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Felt {
    pub distance_m: f32,
    pub normal: Vector,
}

/// The cached solid things near a vehicle.
#[derive(Debug)]
pub(crate) struct Footing {
    /// Revision of the [`StillThings`] that the cache was filled from.
    revision: u64,
    room: Room,
    /// Boxes and corners of the triangles, by collider and number.
    rooms: Vec<Room>,
    corners: Vec<[Vector; 3]>,
    /// Things that are not made of triangles.
    others: Vec<usize>,
}

impl Default for Footing {
    fn default() -> Self {
        Footing {
            revision: 0,
            room: Room::NOWHERE,
            rooms: Vec::new(),
            corners: Vec::new(),
            others: Vec::new(),
        }
    }
}

/// A copy starts empty and fills itself: the cache follows from the map and the place.
impl Clone for Footing {
    fn clone(&self) -> Self {
        Footing::default()
    }
}

impl Footing {
    /// Makes sure that everything these feelers can hit is in the cache.
    pub fn prepare(
        &mut self,
        feelers: &[Feeler],
        velocity: Vector,
        still: &StillThings,
        colliders: &ColliderSet,
    ) {
        let needed = Room::around(
            feelers
                .iter()
                .flat_map(|feeler| [feeler.room.low, feeler.room.high]),
        );
        if self.revision == still.revision() && self.room.contains(&needed) {
            return;
        }
        self.revision = still.revision();
        let ahead = velocity * AHEAD_SECS;
        let mut room = needed.grown(Vector::splat(MARGIN_M));
        room = Room {
            low: room.low + ahead.min(Vector::ZERO),
            high: room.high + ahead.max(Vector::ZERO),
        };
        if !self.collect(room, still, colliders, MOST_TRIANGLES) {
            self.collect(needed, still, colliders, usize::MAX);
        }
    }

    /// Fills the cache with what is in a room; false if that is more than `most` triangles.
    fn collect(
        &mut self,
        room: Room,
        still: &StillThings,
        colliders: &ColliderSet,
        most: usize,
    ) -> bool {
        self.room = room;
        self.rooms.clear();
        self.corners.clear();
        self.others.clear();
        let aabb = room.aabb();
        for (idx, thing) in still
            .things()
            .iter()
            .enumerate()
            .filter(|(_, thing)| thing.room.touches(&room))
        {
            let Some(mesh) = colliders
                .get(thing.collider)
                .and_then(|collider| collider.shape().as_trimesh())
            else {
                self.others.push(idx);
                continue;
            };
            if thing.place != Pose::IDENTITY {
                self.others.push(idx);
                continue;
            }
            let mut numbers: Vec<u32> = mesh.bvh().intersect_aabb(&aabb).collect();
            numbers.sort_unstable();
            for number in numbers {
                let triangle = mesh.triangle(number);
                let corners = [triangle.a, triangle.b, triangle.c];
                let its_room = Room::around(corners);
                if its_room.touches(&room) {
                    self.rooms.push(its_room);
                    self.corners.push(corners);
                }
            }
            if self.corners.len() > most {
                return false;
            }
        }
        true
    }

    /// The nearest hit of a feeler, which must be one that `prepare` was called with.
    pub fn feel(
        &self,
        feeler: &Feeler,
        still: &StillThings,
        colliders: &ColliderSet,
    ) -> Option<Felt> {
        let ray = Ray::new(feeler.from, feeler.direction);
        let mut best: Option<Felt> = None;
        let mut consider = |hit: RayIntersection| {
            if hit.time_of_impact <= feeler.length_m
                && best.is_none_or(|best| hit.time_of_impact < best.distance_m)
            {
                best = Some(Felt {
                    distance_m: hit.time_of_impact,
                    normal: hit.normal,
                });
            }
        };
        for (room, [a, b, c]) in self.rooms.iter().zip(&self.corners) {
            if room.touches(&feeler.room)
                && let Some((hit, _)) = local_ray_intersection_with_triangle(*a, *b, *c, &ray)
            {
                consider(hit);
            }
        }
        for thing in self
            .others
            .iter()
            .map(|&idx| &still.things()[idx])
            .filter(|thing| thing.room.touches(&feeler.room))
        {
            let shape = colliders
                .get(thing.collider)
                .map(|collider| collider.shape());
            shape
                .and_then(|shape| {
                    shape.cast_ray_and_get_normal(&thing.place, &ray, feeler.length_m, true)
                })
                .map(&mut consider);
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use schema_types::noise::Noise;

    use super::*;
    use crate::map_data::MapData;
    use crate::physics::{Physics, Solids};

    fn town() -> (Physics, MapData) {
        let map = MapData::from(&simd_town::Town::generate("Town03", 1).unwrap());
        let solids = Solids::default().of(&Arc::new(map.clone())).unwrap();
        let mut physics = Physics::with_solids(map.origin_m, &solids);
        let stone = ColliderBuilder::cuboid(0.6, 0.4, 0.2).translation(Vector::new(0.0, 0.0, 0.1));
        let spot = physics.engine_point(map.spawn_points[0].translation_m);
        physics
            .engine
            .insert(RigidBodyBuilder::fixed().translation(spot), stone);
        physics.engine.step();
        physics.still.forget();
        (physics, map)
    }

    /// Feelers of a vehicle somewhere near a spawn point, mostly pointing down.
    fn feelers(at: Vector, noise: &Noise) -> Vec<Feeler> {
        let lot = |n: u64, most: f64| (most * (2.0 * noise.uniform(n) - 1.0)) as f32;
        let feeler = |i: u64| {
            let from = at
                + Vector::new(
                    lot(5 * i, 3.0),
                    lot(5 * i + 1, 2.0),
                    0.4 + lot(5 * i + 2, 0.3),
                );
            let direction = Vector::new(lot(5 * i + 3, 0.5), lot(5 * i + 4, 0.5), -1.0).normalize();
            Feeler::new(from, direction, 0.9)
        };
        (0..4).map(feeler).collect()
    }

    /// The engine's own query is the oracle: the distance must be the same, and the normal too
    /// except at edges, where either neighbour's counts.
    #[test]
    fn wheels_find_what_the_engine_finds_wherever_they_are() {
        let (mut physics, map) = town();
        physics.refresh_still();
        let query = physics
            .engine
            .query_pipeline_with_filter(QueryFilter::only_fixed());
        let (mut n_hits, mut n_other_normals) = (0, 0);
        let mut footing = Footing::default();
        for (i, spawn) in map.spawn_points.iter().enumerate() {
            let at = physics.engine_point(spawn.translation_m);
            for turn in 0..20 {
                let feelers = feelers(at, &Noise::new(5, i as u64, turn));
                footing.prepare(
                    &feelers,
                    Vector::new(4.0, -3.0, 0.0),
                    &physics.still,
                    &physics.engine.colliders,
                );
                for feeler in &feelers {
                    let felt = footing.feel(feeler, &physics.still, &physics.engine.colliders);
                    let ray = Ray::new(feeler.from, feeler.direction);
                    let expected = query
                        .cast_ray_and_get_normal(&ray, feeler.length_m, true)
                        .map(|(_, hit)| hit);
                    assert_eq!(
                        felt.map(|felt| felt.distance_m),
                        expected.map(|hit| hit.time_of_impact),
                        "{feeler:?}"
                    );
                    n_hits += usize::from(felt.is_some());
                    n_other_normals +=
                        usize::from(felt.map(|felt| felt.normal) != expected.map(|hit| hit.normal));
                }
            }
        }
        assert!(
            n_hits > 5000 && n_other_normals < n_hits / 1000,
            "{n_hits} hits, {n_other_normals} with another normal"
        );
    }

    #[test]
    fn what_is_at_hand_does_not_change_what_is_found() {
        let (mut physics, map) = town();
        physics.refresh_still();
        let colliders = &physics.engine.colliders;
        let mut wide = Footing::default();
        for (i, spawn) in map.spawn_points.iter().enumerate().take(40) {
            let at = physics.engine_point(spawn.translation_m);
            for turn in 0..20 {
                let feelers = feelers(at, &Noise::new(6, i as u64, turn));
                wide.prepare(
                    &feelers,
                    Vector::new(20.0, 20.0, 20.0),
                    &physics.still,
                    colliders,
                );
                let mut narrow = Footing::default();
                narrow.prepare(&feelers, Vector::ZERO, &physics.still, colliders);
                for feeler in &feelers {
                    let mut own = Footing::default();
                    own.collect(feeler.room, &physics.still, colliders, usize::MAX);
                    let found = [&wide, &narrow, &own]
                        .map(|footing| footing.feel(feeler, &physics.still, colliders));
                    assert!(found[0] == found[1] && found[1] == found[2], "{found:?}");
                }
            }
        }
    }

    #[test]
    fn a_thing_that_comes_moves_or_goes_is_noticed() {
        let (mut physics, map) = town();
        let at =
            physics.engine_point(map.spawn_points[3].translation_m) + Vector::new(0.0, 0.0, 0.5);
        let feeler = Feeler::new(at, -Vector::Z, 3.0);
        let mut footing = Footing::default();
        let mut find = |physics: &mut Physics| {
            physics.refresh_still();
            footing.prepare(
                &[feeler],
                Vector::ZERO,
                &physics.still,
                &physics.engine.colliders,
            );
            footing
                .feel(&feeler, &physics.still, &physics.engine.colliders)
                .map_or(f32::NAN, |felt| felt.distance_m)
        };
        let ground = find(&mut physics);
        let ball = RigidBodyBuilder::fixed().translation(at - Vector::new(0.0, 0.0, 0.4));
        let (body, _) = physics.engine.insert(ball, ColliderBuilder::ball(0.3));
        physics.still.forget();
        assert!((find(&mut physics) - 0.1).abs() < 1e-6);
        physics.engine.bodies[body].set_translation(at - Vector::new(0.0, 0.0, 0.45), true);
        physics.still.forget();
        assert!((find(&mut physics) - 0.15).abs() < 1e-6);
        physics.engine.remove_body(body);
        physics.still.forget();
        assert_eq!(find(&mut physics), ground);
    }
}
