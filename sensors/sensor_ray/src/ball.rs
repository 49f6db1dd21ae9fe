//! A ball that moves along a line until it touches a triangle: the obstacle detector's question.

use nalgebra::{Point3, Vector3};
use schema_types::{ActorId, Class, ObjectId};

use crate::ray_scene::{Placed, RayScene};
use near::visit_near;
use touch::Ball;

mod near;
mod touch;

/// What a moving ball passes through without touching it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BallFilter {
    /// The parts of this actor.
    pub ignored: Option<ActorId>,
    /// Everything except vehicles and walkers.
    pub only_traffic: bool,
}

/// What a moving ball touches first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BallHit {
    /// How far its centre has moved, metres; 0 if it touches something where it starts.
    pub distance_m: f64,
    /// Where it is touched.
    pub contact_in_world_m: Point3<f64>,
    /// Semantic class.
    pub class: Class,
    /// Object: the triangle's own, else its instance's.
    pub object: ObjectId,
}

impl RayScene {
    /// Moves a ball of `radius_m` from `centre_m` along the unit vector `direction` by at most
    /// `max_m` until it touches a triangle.
    ///
    /// If the ball touches several things at once, scenery comes first, then the actor with the
    /// smaller id.
    pub fn move_ball(
        &self,
        centre_m: &Point3<f64>,
        direction: &Vector3<f64>,
        radius_m: f64,
        max_m: f64,
        filter: BallFilter,
    ) -> Option<BallHit> {
        let ball = Ball {
            centre: *centre_m,
            direction: *direction,
            radius_m,
        };
        let mut search = Search {
            scene: self,
            ball,
            only_traffic: filter.only_traffic,
            found: None,
        };
        let mut limit_m = max_m;
        let scenery = if filter.only_traffic {
            &[][..]
        } else {
            &self.scenery.tiles
        };
        for tile in scenery {
            let near = Ball {
                centre: Point3::from(centre_m - tile.origin_m),
                ..ball
            };
            visit_near(&tile.tree, &near, &mut limit_m, |number, limit_m| {
                let (instance, triangle) = tile.sources[number as usize];
                search.touch(&self.scenery.statics[instance as usize], triangle, limit_m);
            });
        }
        let ignored = filter.ignored.map(ObjectId::from);
        for placed in self
            .dynamics
            .iter()
            .filter(|placed| Some(placed.object) != ignored)
        {
            let Some(tree) = &self.mesh_trees[placed.mesh_idx as usize] else {
                continue;
            };
            let near = ball.seen_from(&placed.mesh_from_world);
            visit_near(tree, &near, &mut limit_m, |triangle, limit_m| {
                search.touch(placed, triangle, limit_m)
            });
        }
        search.found
    }
}

/// The search for what a ball touches first.
struct Search<'s> {
    scene: &'s RayScene,
    ball: Ball,
    only_traffic: bool,
    found: Option<BallHit>,
}

impl Search<'_> {
    /// Tests one triangle and keeps the earlier touch.
    fn touch(&mut self, placed: &Placed, triangle: u32, limit_m: &mut f64) {
        let mesh = &self.scene.scenery.meshes[placed.mesh_idx as usize];
        let vertices = mesh.triangle(triangle as usize);
        let [first, ..] = vertices;
        let class = Class(first.class);
        if self.only_traffic && !is_traffic(class) {
            return;
        }
        let corners = vertices.map(|vertex| Point3::from(vertex.position_m.map(f64::from)));
        let ball = self.ball.seen_from(&placed.mesh_from_world);
        let Some(touch) = ball.touch(&corners, *limit_m) else {
            return;
        };
        if self
            .found
            .is_some_and(|found| touch.way_m >= found.distance_m)
        {
            return;
        }
        *limit_m = touch.way_m;
        self.found = Some(BallHit {
            distance_m: touch.way_m,
            contact_in_world_m: placed
                .mesh_from_world
                .inverse_transform_point(&touch.contact),
            class,
            object: placed.object_of(ObjectId(first.object_id)),
        });
    }
}

/// Whether a class is a walker, a rider, or a vehicle.
fn is_traffic(class: Class) -> bool {
    (Class::PEDESTRIANS.0..=Class::BICYCLE.0).contains(&class.0)
}
