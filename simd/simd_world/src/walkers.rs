//! Walkers: people who walk over the ground, are pushed and knocked down by vehicles, and show it.

mod attributes;
mod bones;
mod control;
mod crowd;
mod impact;
mod model;
mod own_pose;
mod pushes;
mod standing;
mod surroundings;
mod walker;

use std::collections::BTreeMap;

use nalgebra::Vector3;
use rapier3d::math::Pose as EnginePose;
use rapier3d::parry::query::intersection_test;
use rapier3d::parry::shape::Shape;
use schema_types::{ActorId, Pose};
use serde::{Deserialize, Serialize};

use crate::physics::Physics;
use crate::vehicles::Vehicles;
use standing::{MAX_PIECE_SECS, ground_below};

pub(crate) use attributes::checked_attributes;
pub(crate) use bones::act as act_on_skeleton;
pub use control::MAX_SPEED_MPS;
pub(crate) use control::{Lead, check_control, check_lead};
pub(crate) use crowd::{Crowd, draw_candidate};
pub use model::{WalkerModel, walker_models};
pub(crate) use surroundings::Surroundings;
pub(crate) use walker::Walker;

/// Longest time between two decisions of a stroller, seconds. In that time nobody walks further
/// than the distance at which a corner counts as reached.
const LEAD_SECS: f64 = 0.2;
/// Depth below the map's origin at which a walker is lost, metres.
const FALL_M: f64 = 500.0;

/// All walkers by rising id, and which of them stroll.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(crate) struct Walkers {
    pub by_id: BTreeMap<ActorId, Walker>,
    pub crowd: Crowd,
}

impl Walkers {
    pub fn get(&self, actor: ActorId) -> Option<&Walker> {
        self.by_id.get(&actor)
    }

    /// After a sub-step of the vehicles: lets them run into walkers.
    pub fn meet_vehicles(&mut self, vehicles: &Vehicles, physics: &mut Physics) {
        impact::meet_vehicles(&mut self.by_id, vehicles, physics);
    }

    /// Lets strollers decide and moves all walkers by one tick, after the vehicles. A long tick is
    /// split, so that nobody walks past a corner.
    pub fn step(&mut self, around: &Surroundings<'_>, dt_secs: f64) {
        let n_leads = (dt_secs / LEAD_SECS - 1e-9).ceil().max(1.0) as u32;
        let yaws_before_rad: Vec<f64> = self.by_id.values().map(|walker| walker.yaw_rad).collect();
        for _ in 0..n_leads {
            self.crowd
                .lead(&mut self.by_id, around, dt_secs / f64::from(n_leads));
            self.walk_on(around, dt_secs / f64::from(n_leads));
        }
        for (walker, yaw_before_rad) in self.by_id.values_mut().zip(yaws_before_rad) {
            walker.finish(yaw_before_rad, dt_secs);
            walker.end_forces();
        }
        impact::part_walkers(&mut self.by_id);
    }

    /// Moves all walkers that move by themselves.
    fn walk_on(&mut self, around: &Surroundings<'_>, dt_secs: f64) {
        let n_pieces = (dt_secs / MAX_PIECE_SECS - 1e-9).ceil().max(1.0) as u32;
        let piece_secs = dt_secs / f64::from(n_pieces);
        let floor_m = around.origin_z_m - FALL_M;
        for (id, walker) in &mut self.by_id {
            if walker.simulated && !walker.lost {
                (0..n_pieces).for_each(|_| walker.walk(around.physics, piece_secs));
                if !(walker.feet_m.iter().all(|x| x.is_finite()) && walker.feet_m[2] > floor_m) {
                    tracing::error!(
                        actor = id.0,
                        "walker fell out of the world and was stopped; destroy it or set its pose"
                    );
                    walker.feet_m = walker.last_feet_m;
                    walker.lost = true;
                }
            }
        }
    }

    /// Type and id of the first walker that a shape would touch.
    pub fn touching(
        &self,
        at: &EnginePose,
        shape: &dyn Shape,
        who: Touchable,
        physics: &Physics,
    ) -> Option<String> {
        self.by_id.iter().find_map(|(id, walker)| {
            let (body, body_at) = walker.standing().whole_body(physics);
            let counts = who == Touchable::Everybody || walker.collides;
            (counts
                && intersection_test(at, shape, &body_at, &body).is_ok_and(|hit| hit.intersecting))
            .then(|| format!("{} (actor {id})", walker.model().type_id))
        })
    }
}

/// Which walkers stand in the way of something new.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Touchable {
    Everybody,
    /// Only those whose collisions are switched on.
    Colliding,
}

/// A new walker with the middle of its body at `pose`; its feet are lifted onto the ground if they
/// would be in it. The attributes must have been checked.
pub(crate) fn new_walker(
    model_idx: usize,
    pose: &Pose,
    attributes: &BTreeMap<String, String>,
    physics: &Physics,
) -> Walker {
    let height_m = walker_models()[model_idx].shape.height_m;
    let [x, y, z] = pose.translation_m;
    let feet_m = lifted(Vector3::new(x, y, z - 0.5 * height_m), height_m, physics);
    let is = |name: &str| attributes.get(name).is_some_and(|value| value == "true");
    Walker {
        invincible: is("is_invincible"),
        seated: is("use_wheelchair"),
        ..Walker::new(model_idx as u16, feet_m.into(), pose.yaw_rad())
    }
}

fn lifted(feet_m: Vector3<f64>, height_m: f64, physics: &Physics) -> Vector3<f64> {
    match ground_below(physics, &feet_m, height_m, 0.0) {
        Some(down_m) if down_m < 0.0 => feet_m - Vector3::z() * down_m,
        _ => feet_m,
    }
}
