//! One prop. If the engine moves it, it falls, tumbles, and is pushed by vehicles and by commands.

use nalgebra::Vector3;
use rapier3d::math::Vector;
use rapier3d::prelude::*;
use schema_frames::PhysicsAction;
use schema_types::Pose;
use serde::{Deserialize, Serialize};

use super::model::prop_models;
use crate::physics::{Physics, narrow, widen};
use crate::pushes::Push;

/// A prop this far below the map's origin has fallen out of the world, metres.
const FALL_M: f32 = 500.0;

/// A prop in the world. A prop that is attached to another actor has no body.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Prop {
    /// Index into [`prop_models`].
    pub model_idx: u16,
    pub body: Option<RigidBodyHandle>,
    /// Whether the engine moves it.
    pub is_simulated: bool,
    /// What it weighs when the engine moves it.
    pub mass_kg: f32,
}

impl Prop {
    /// Its body, if the engine moves it.
    fn moving(&self) -> Option<RigidBodyHandle> {
        self.body.filter(|_| self.is_simulated)
    }

    /// Carries out a switch; an attached prop, which has no body, has nothing to switch.
    pub fn switch(&mut self, action: &PhysicsAction, physics: &mut Physics) {
        let Some(body) = self.body else { return };
        match action {
            PhysicsAction::SetSimulated { enabled } => self.set_simulated(*enabled, physics),
            PhysicsAction::SetGravity { enabled } => {
                physics.engine.bodies[body].set_gravity_scale(f32::from(u8::from(*enabled)), true);
            }
            PhysicsAction::SetCollisions { enabled } => {
                let groups = match enabled {
                    true => InteractionGroups::all(),
                    false => InteractionGroups::none(),
                };
                for collider in physics.engine.bodies[body].colliders().to_vec() {
                    if let Some(collider) = physics.engine.colliders.get_mut(collider) {
                        collider.set_collision_groups(groups);
                    }
                }
                physics.still.forget();
            }
            _ => {}
        }
    }

    /// Lets the engine move it, or holds it where it is.
    fn set_simulated(&mut self, simulated: bool, physics: &mut Physics) {
        let Some(handle) = self.body.filter(|_| self.is_simulated != simulated) else {
            return;
        };
        self.is_simulated = simulated;
        let engine = &mut physics.engine;
        let body = &mut engine.bodies[handle];
        if simulated {
            for collider in body.colliders() {
                if let Some(collider) = engine.colliders.get_mut(*collider) {
                    collider.set_mass(self.mass_kg);
                    // Litter that falls has to lie on something.
                    collider.set_collision_groups(InteractionGroups::all());
                    collider.set_active_events(ActiveEvents::CONTACT_FORCE_EVENTS);
                    collider.set_contact_force_event_threshold(0.0);
                }
            }
            body.set_body_type(RigidBodyType::Dynamic, true);
            // Small things that are thrown must not pass through the ground.
            body.enable_ccd(true);
            // The engine would do this in its next step, but pushes may come before that.
            body.recompute_mass_properties_from_colliders(&engine.colliders);
        } else {
            body.set_linvel(Vector::ZERO, true);
            body.set_angvel(Vector::ZERO, true);
            body.set_body_type(RigidBodyType::Fixed, true);
        }
        physics.still.forget();
    }

    /// Takes a push; nothing pushes a prop that the engine does not move.
    pub fn take(&self, push: Push, physics: &mut Physics) {
        let Some(body) = self.moving() else { return };
        let at = match push {
            Push::Impulse(_, point) | Push::Force(_, point) => {
                point.map(|point| physics.engine_point(point.into()))
            }
            _ => None,
        };
        let body = &mut physics.engine.bodies[body];
        let at = at.unwrap_or_else(|| body.center_of_mass());
        match push {
            Push::Velocity(velocity) => {
                let lever = body.center_of_mass() - body.translation();
                body.set_linvel(narrow(&velocity) + body.angvel().cross(lever), true);
            }
            Push::Spin(spin) => body.set_angvel(narrow(&spin), true),
            Push::Impulse(impulse, _) => body.apply_impulse_at_point(narrow(&impulse), at, true),
            Push::AngularImpulse(impulse) => body.apply_torque_impulse(narrow(&impulse), true),
            Push::Force(force, _) => body.add_force_at_point(narrow(&force), at, true),
            Push::Torque(torque) => body.add_torque(narrow(&torque), true),
        }
    }

    /// After a tick: forces end, and the pose is that of the body. `None` if the engine does not
    /// move it. What fell out of the world is held at `pose`, its last one.
    pub fn end_tick(&mut self, pose: &Pose, physics: &mut Physics) -> Option<Pose> {
        let handle = self.moving()?;
        let body = &mut physics.engine.bodies[handle];
        if !body.is_sleeping() {
            body.reset_forces(false);
            body.reset_torques(false);
        }
        let at = *body.position();
        if at.translation.is_finite() && at.rotation.is_finite() && at.translation.z > -FALL_M {
            return Some(physics.world_pose(&at).into());
        }
        let held = physics.engine_pose(&pose.isometry());
        self.set_simulated(false, physics);
        physics.engine.bodies[handle].set_position(held, true);
        tracing::warn!(
            type_id = prop_models()[self.model_idx as usize].type_id,
            "a prop fell out of the world and is held; destroy it, or set its pose and switch its physics on again"
        );
        None
    }

    /// Velocity of its origin and angular velocity, world.
    pub fn velocity(&self, physics: &Physics) -> (Vector3<f64>, Vector3<f64>) {
        match self.moving() {
            None => Default::default(),
            Some(body) => {
                let body = &physics.engine.bodies[body];
                let origin = body.velocity_at_point(body.translation());
                (widen(origin), widen(body.angvel()))
            }
        }
    }
}
