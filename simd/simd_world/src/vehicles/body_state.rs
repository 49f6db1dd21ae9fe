//! The body of a vehicle at the beginning of a sub-step.

use rapier3d::math::{Pose as EnginePose, Vector};

/// Pose, axes and velocity of the body at the beginning of a sub-step, in engine coordinates.
pub(crate) struct BodyState {
    pub pose: EnginePose,
    pub center: Vector,
    pub forward: Vector,
    pub left: Vector,
    pub up: Vector,
    pub velocity: Vector,
    pub forward_mps: f32,
    /// Speed downwards along the springs.
    pub falling_mps: f32,
}
