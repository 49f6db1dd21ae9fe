//! Camera booms: how an actor attached by a spring arm lags behind its parent and stays clear of
//! walls.
//!
//! The arm points from the child back to its parent. In each sub-step it closes a share of the
//! angle to the parent's yaw; the parent's pitch and roll are ignored. The child hangs at the arm's
//! end: its distance is always right, only the direction lags. The pose of a child on a boom is
//! meant for viewers and is no rigid mount.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rapier3d::parry::query::ShapeCastOptions;
use rapier3d::parry::shape::Ball;
use rapier3d::prelude::QueryFilter;
use schema_frames::Attachment;
use schema_types::ActorId;
use serde::{Deserialize, Serialize};

use crate::actors::Actor;
use crate::errors::ActorError;
use crate::physics::{Physics, narrow};

/// Longest sub-step of an arm, seconds.
const SUB_STEP_SECS: f64 = 1.0 / 60.0;
/// Share of the remaining angle that an arm closes per second of a sub-step.
const SPEED_PER_SEC: f64 = 8.0;
/// How much higher the pivot of a `spring_arm` lies than its parent's origin, metres.
const RAISE_M: f64 = 0.3;
/// Radius of the ball that must pass from the pivot to the child, metres.
const PROBE_M: f32 = 0.12;

/// State of one boom, with whether walls shorten it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Boom {
    shortens: bool,
    /// Rotation of the arm, `[x, y, z, w]`: its x axis points from the child to the pivot; `None`
    /// until the parent's pose was first seen.
    arm_xyzw: Option<[f64; 4]>,
}

impl Boom {
    /// `None` for a rigid attachment.
    fn new(attachment: Attachment) -> Option<Boom> {
        match attachment {
            Attachment::Rigid => None,
            Attachment::SpringArm => Some(Boom {
                shortens: true,
                arm_xyzw: None,
            }),
            Attachment::SpringArmGhost => Some(Boom {
                shortens: false,
                arm_xyzw: None,
            }),
        }
    }

    /// Pose of the child `dt_secs` after the last call (0 keeps the arm as it is). `free_m(pivot,
    /// direction, length)` returns how far a probe gets.
    pub fn follow(
        &mut self,
        world_from_parent: &Isometry3<f64>,
        parent_from_child: &Isometry3<f64>,
        dt_secs: f64,
        free_m: impl Fn(&Vector3<f64>, &Vector3<f64>, f64) -> f64,
    ) -> Isometry3<f64> {
        let place = parent_from_child.translation.vector;
        let length_m = place.norm();
        let target = target(world_from_parent, &place);
        let mut arm = self.arm_xyzw.map_or(target, |xyzw| {
            UnitQuaternion::new_unchecked(Quaternion::from(xyzw))
        });
        let mut left_secs = dt_secs;
        while left_secs > 1e-9 {
            let step_secs = left_secs.min(SUB_STEP_SECS);
            arm = arm
                .try_slerp(&target, (SPEED_PER_SEC * step_secs).min(1.0), 1e-9)
                .unwrap_or(target);
            left_secs -= step_secs;
        }
        self.arm_xyzw = Some(arm.coords.into());
        let raise_m = if self.shortens { RAISE_M } else { 0.0 };
        let pivot = world_from_parent.translation.vector + Vector3::z() * raise_m;
        let outwards = -(arm * Vector3::x());
        let reach_m = if self.shortens {
            free_m(&pivot, &outwards, length_m)
        } else {
            length_m
        };
        Isometry3::from_parts(
            Translation3::from(pivot + outwards * reach_m),
            arm * parent_from_child.rotation,
        )
    }
}

/// Target rotation of an arm: from the child's place back to the parent, without the parent's pitch
/// and roll.
fn target(world_from_parent: &Isometry3<f64>, place: &Vector3<f64>) -> UnitQuaternion<f64> {
    let forward = world_from_parent.rotation * Vector3::x();
    let parent_yaw = forward.y.atan2(forward.x);
    let back = -place;
    let yaw = parent_yaw + back.y.atan2(back.x);
    // About y, which points to the left, a positive angle looks down.
    let pitch = -back.z.atan2(back.x.hypot(back.y));
    UnitQuaternion::from_euler_angles(0.0, pitch, yaw)
}

/// How far a probe gets from `pivot` along the unit vector `direction`, at most `length_m`. The
/// body of `parent` does not stop it.
pub(crate) fn free_m(
    physics: &Physics,
    parent: Option<rapier3d::prelude::RigidBodyHandle>,
    pivot: &Vector3<f64>,
    direction: &Vector3<f64>,
    length_m: f64,
) -> f64 {
    let filter = parent.map_or(QueryFilter::default(), |body| {
        QueryFilter::default().exclude_rigid_body(body)
    });
    let from = physics.engine_pose(&Isometry3::from_parts(
        Translation3::from(*pivot),
        UnitQuaternion::identity(),
    ));
    let pipeline = physics.engine.query_pipeline_with_filter(filter);
    let options = ShapeCastOptions::with_max_time_of_impact(length_m as f32);
    let hit = pipeline.cast_shape(&from, narrow(direction), &Ball::new(PROBE_M), options);
    hit.map_or(length_m, |(_, hit)| hit.time_of_impact as f64)
}

/// The booms of all actors that hang on one.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(crate) struct Booms {
    pub by_id: BTreeMap<ActorId, Boom>,
}

impl Booms {
    /// Says how an attached actor follows its parent. Without a parent only `rigid` is allowed.
    pub fn attach(&mut self, actor: &Actor, attachment: Attachment) -> Result<(), ActorError> {
        let refuse = |problem| {
            Err(ActorError::Value {
                actor: actor.id,
                what: "attachment",
                problem,
            })
        };
        let Some(boom) = Boom::new(attachment) else {
            self.by_id.remove(&actor.id);
            return Ok(());
        };
        if actor.parent.is_none() {
            return refuse(
                "is a spring arm, but there is no parent to hang it on; attach it, or use rigid",
            );
        }
        let [x, y, _] = actor.pose.translation_m;
        if x.hypot(y) < 1e-6 {
            return refuse(
                "is a spring arm, but the pose lies right above or below the parent's origin, so the arm has no direction",
            );
        }
        self.by_id.insert(actor.id, boom);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mount(x: f64, y: f64, z: f64, pitch: f64) -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::new(x, y, z),
            UnitQuaternion::from_euler_angles(0.0, pitch, 0.0),
        )
    }

    fn ghost() -> Boom {
        Boom::new(Attachment::SpringArmGhost).unwrap()
    }

    #[test]
    fn a_chase_camera_looks_down_at_its_parent() {
        // CARLA's published example: 5.5 m behind and 2.5 m up, pitched up by 8°. The camera looks
        // down by atan(2.5 / 5.5) − 8° = 16.4°.
        let parent = Isometry3::translation(10.0, 20.0, 1.0);
        let pose = ghost().follow(
            &parent,
            &mount(-5.5, 0.0, 2.5, -8f64.to_radians()),
            0.05,
            |_, _, _| unreachable!(),
        );
        assert!((pose.translation.vector - Vector3::new(4.5, 20.0, 3.5)).norm() < 1e-12);
        let forward = pose.rotation * Vector3::x();
        let expected = 8f64.to_radians() - 2.5f64.atan2(5.5);
        assert!((forward.z.asin() - expected).abs() < 1e-12 && forward.y.abs() < 1e-12);
    }

    #[test]
    fn the_parents_pitch_and_roll_do_not_shake_the_arm() {
        let place = mount(-5.0, 1.0, 2.0, 0.0);
        let at = |roll: f64, pitch: f64| {
            let parent = Isometry3::from_parts(
                Translation3::new(1.0, 2.0, 3.0),
                UnitQuaternion::from_euler_angles(roll, pitch, 0.7),
            );
            ghost().follow(&parent, &place, 0.05, |_, _, _| unreachable!())
        };
        assert!((at(0.3, -0.2).translation.vector - at(0.0, 0.0).translation.vector).norm() < 1e-9);
    }

    /// Goal: after the parent turned by 90° at once, the angle left shrinks by (1 − 8 h) per
    /// sub-step of h ≤ 1/60 s.
    #[test]
    fn the_arm_lags_a_turn_as_the_formula_says() {
        let place = mount(-6.0, 0.0, 0.0, 0.0);
        for (dt_secs, sub_steps) in [(0.05, 3), (0.01, 1), (1.0 / 30.0, 2), (0.5, 30)] {
            let mut boom = ghost();
            boom.follow(
                &Isometry3::identity(),
                &place,
                0.0,
                |_, _, _| unreachable!(),
            );
            let turned = Isometry3::rotation(Vector3::z() * std::f64::consts::FRAC_PI_2);
            let pose = boom.follow(&turned, &place, dt_secs, |_, _, _| unreachable!());
            let left = std::f64::consts::FRAC_PI_2
                * (1.0 - 8.0 * dt_secs / sub_steps as f64).powi(sub_steps);
            let forward = pose.rotation * Vector3::x();
            let angle = std::f64::consts::FRAC_PI_2 - forward.y.atan2(forward.x);
            assert!((angle - left).abs() < 1e-9, "{dt_secs}: {angle} {left}");
        }
    }

    #[test]
    fn a_wall_behind_pulls_the_child_in_and_lifts_the_pivot() {
        let mut boom = Boom::new(Attachment::SpringArm).unwrap();
        let pose = boom.follow(
            &Isometry3::identity(),
            &mount(-6.0, 0.0, 0.0, 0.0),
            0.05,
            |pivot, direction, length_m| {
                assert!(
                    (pivot.z - 0.3).abs() < 1e-12
                        && (direction.x + 1.0).abs() < 1e-12
                        && (length_m - 6.0).abs() < 1e-12
                );
                2.5
            },
        );
        assert!((pose.translation.vector - Vector3::new(-2.5, 0.0, 0.3)).norm() < 1e-12);
    }
}
