//! Props: objects that are put down and stand still, until their physics is switched on.

mod model;
mod prop;

use std::collections::BTreeMap;

use rapier3d::math::{Pose as EnginePose, Vector};
use rapier3d::parry::query::intersection_test;
use rapier3d::parry::shape::Shape;
use rapier3d::prelude::*;
use schema_types::{ActorId, Pose};
use serde::{Deserialize, Serialize};

use crate::actors::Actors;
use crate::physics::{Physics, collider_tag};

pub use model::{PropModel, prop_models};
pub(crate) use prop::Prop;

/// All props by rising id.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(crate) struct Props {
    by_id: BTreeMap<ActorId, Prop>,
}

impl Props {
    pub fn get(&self, actor: ActorId) -> Option<&Prop> {
        self.by_id.get(&actor)
    }

    /// The props with their actors, by rising id.
    pub fn all(&self) -> impl Iterator<Item = (&ActorId, &Prop)> {
        self.by_id.iter()
    }

    pub fn get_mut(&mut self, actor: ActorId) -> Option<&mut Prop> {
        self.by_id.get_mut(&actor)
    }

    /// After a tick: gives the actors of props that moved their new poses.
    pub fn end_tick(&mut self, actors: &mut Actors, physics: &mut Physics) {
        let moving = self.by_id.iter_mut().filter(|(_, prop)| prop.is_simulated);
        for (id, prop) in moving {
            if let Ok(actor) = actors.get_mut(*id)
                && let Some(pose) = prop.end_tick(&actor.pose, physics)
            {
                actor.pose = pose;
            }
        }
    }

    /// Adds a prop that stands by itself, with a body in the engine.
    pub fn add_standing(
        &mut self,
        actor: ActorId,
        model_idx: usize,
        mass_kg: f64,
        pose: &Pose,
        physics: &mut Physics,
    ) {
        let model = &prop_models()[model_idx];
        let half = model.engine_half();
        let body = RigidBodyBuilder::fixed().pose(physics.engine_pose(&pose.isometry()));
        let collider = ColliderBuilder::cuboid(half.x, half.y, half.z)
            .translation(Vector::new(0.0, 0.0, half.z))
            .collision_groups(match model.is_litter() {
                true => InteractionGroups::none(),
                false => InteractionGroups::all(),
            })
            .friction(0.6)
            .user_data(collider_tag(actor.0, model.shape.class));
        physics.still.forget();
        let body = Some(physics.engine.insert(body, collider).0);
        self.add(actor, model_idx, mass_kg, body);
    }

    /// Adds a prop that is attached to another actor.
    pub fn add_attached(&mut self, actor: ActorId, model_idx: usize) {
        self.add(actor, model_idx, 1.0, None);
    }

    fn add(
        &mut self,
        actor: ActorId,
        model_idx: usize,
        mass_kg: f64,
        body: Option<RigidBodyHandle>,
    ) {
        let prop = Prop {
            model_idx: model_idx as u16,
            body,
            is_simulated: false,
            mass_kg: mass_kg as f32,
        };
        self.by_id.insert(actor, prop);
    }

    /// Moves a prop's body to its actor's new pose, if `actor` is one.
    pub fn set_pose(&self, actor: ActorId, pose: &Pose, physics: &mut Physics) {
        if let Some(body) = self.get(actor).and_then(|prop| prop.body) {
            let at = physics.engine_pose(&pose.isometry());
            physics.engine.bodies[body].set_position(at, true);
            physics.still.forget();
        }
    }

    /// Removes a prop and its body, if `actor` is one.
    pub fn remove(&mut self, actor: ActorId, physics: &mut Physics) {
        if let Some(body) = self.by_id.remove(&actor).and_then(|prop| prop.body) {
            physics.engine.remove_body(body);
            physics.still.forget();
        }
    }

    /// Type of the first prop that a shape would touch.
    pub fn touching(
        &self,
        at: &EnginePose,
        shape: &dyn Shape,
        physics: &Physics,
    ) -> Option<String> {
        self.by_id.values().find_map(|prop| {
            let model = &prop_models()[prop.model_idx as usize];
            if model.is_litter() && !prop.is_simulated {
                return None;
            }
            let half = model.engine_half();
            let mut other_at = *physics.engine.bodies.get(prop.body?)?.position();
            other_at.translation += other_at.rotation * Vector::new(0.0, 0.0, half.z);
            intersection_test(at, shape, &other_at, &Cuboid::new(half))
                .is_ok_and(|hit| hit.intersecting)
                .then(|| model.type_id.clone())
        })
    }
}
