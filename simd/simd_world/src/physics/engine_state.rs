//! The physics engine's state, copied and written into checkpoints.
//!
//! In a checkpoint's bytes, colliders of the map travel with a stand-in for their shape and take
//! the shape back from the living world.

use rapier3d::prelude::*;
use serde::{Deserialize as _, Deserializer, Serialize as _, Serializer};

/// A copy of the engine's state. Pipelines and solvers hold no state between steps and are made
/// anew.
pub(crate) fn copy(engine: &PhysicsWorld) -> PhysicsWorld {
    PhysicsWorld {
        gravity: engine.gravity,
        integration_parameters: engine.integration_parameters,
        physics_pipeline: PhysicsPipeline::new(),
        collision_pipeline: CollisionPipeline::new(),
        islands: engine.islands.clone(),
        broad_phase: engine.broad_phase.clone(),
        narrow_phase: engine.narrow_phase.clone(),
        bodies: engine.bodies.clone(),
        colliders: engine.colliders.clone(),
        impulse_joints: engine.impulse_joints.clone(),
        multibody_joints: engine.multibody_joints.clone(),
        soft_bodies: engine.soft_bodies.clone(),
        ccd_solver: CCDSolver::new(),
    }
}

/// Colliders whose shape comes with the map: only they are triangle meshes.
fn geometry(engine: &PhysicsWorld) -> impl Iterator<Item = ColliderHandle> + '_ {
    engine
        .colliders
        .iter()
        .filter(|(_, collider)| collider.shape().as_trimesh().is_some())
        .map(|(handle, _)| handle)
}

/// Radius of a stand-in shape; no real shape is that small.
const STAND_IN_M: f32 = f32::MIN_POSITIVE;

pub(crate) fn serialize<S: Serializer>(
    engine: &PhysicsWorld,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    let mut light = copy(engine);
    for handle in geometry(engine) {
        if let Some(collider) = light.colliders.get_mut(handle) {
            collider.set_shape(SharedShape::ball(STAND_IN_M));
        }
    }
    light.serialize(serializer)
}

pub(crate) fn deserialize<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<PhysicsWorld, D::Error> {
    PhysicsWorld::deserialize(deserializer)
}

/// A checkpoint's engine holds colliders of a map that the living world does not have.
#[derive(Clone, Copy, Debug, thiserror::Error)]
#[error("it has solid geometry that the loaded map lacks")]
pub(crate) struct LackingGeometry;

/// Replaces the stand-ins by the living world's colliders. They are copied whole: with them comes
/// their "unchanged" mark, so the engine keeps what it knows of their contacts.
pub(crate) fn take_geometry(
    engine: &mut PhysicsWorld,
    living: &PhysicsWorld,
) -> Result<(), LackingGeometry> {
    for handle in geometry(living) {
        let Some(original) = living.colliders.get(handle) else {
            continue;
        };
        if let Some(stand_in) = engine.colliders.get_mut(handle) {
            let is_enabled = stand_in.is_enabled();
            *stand_in = original.clone();
            if stand_in.is_enabled() != is_enabled {
                stand_in.set_enabled(is_enabled);
            }
        }
    }
    let is_stand_in = |collider: &Collider| {
        collider
            .shape()
            .as_ball()
            .is_some_and(|ball| ball.radius == STAND_IN_M)
    };
    match engine
        .colliders
        .iter()
        .any(|(_, collider)| is_stand_in(collider))
    {
        true => Err(LackingGeometry),
        false => Ok(()),
    }
}
