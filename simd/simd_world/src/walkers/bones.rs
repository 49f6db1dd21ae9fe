//! Commands that read or hold the bones of a walker.

use nalgebra::Isometry3;
use schema_frames::{BoneReading, SkeletonAction};
use schema_types::Pose;
use simd_body::person::Skeleton;
use simd_body::person::bones::{Bone, bones};

use crate::errors::SkeletonError;

use super::own_pose::checked_bones;
use super::walker::Walker;

/// Reads or holds a walker's bones; only `Read` has an answer.
///
/// # Errors
/// If a bone or the ratio of blending cannot be used.
pub(crate) fn act(
    walker: &mut Walker,
    action: &SkeletonAction,
) -> Result<Option<Vec<BoneReading>>, SkeletonError> {
    match action {
        SkeletonAction::Read => return Ok(Some(read(walker))),
        SkeletonAction::Hold { bones } => {
            let held = checked_bones(bones)?;
            walker.own_pose.get_or_insert_default().hold(held);
        }
        SkeletonAction::Blend { ratio } if (0.0..=1.0).contains(ratio) => {
            walker.own_pose.get_or_insert_default().blend(*ratio);
        }
        SkeletonAction::Blend { ratio } => {
            return Err(SkeletonError::Blend(*ratio));
        }
        SkeletonAction::Capture => {
            let gait = walker
                .model()
                .shape
                .skeleton()
                .relative_bones(walker.posture());
            walker.own_pose.get_or_insert_default().capture(gait);
        }
    }
    Ok(None)
}

fn read(walker: &Walker) -> Vec<BoneReading> {
    let text = |pose: &Isometry3<f64>| Pose::from(*pose).into();
    let relative = walker.relative_bones();
    let world_from_body = walker.world_from_ground();
    let reading =
        |((bone, in_body), in_parent): ((&Bone, &Isometry3<f64>), &Isometry3<f64>)| BoneReading {
            name: bone.name.clone(),
            bone_in_world: text(&(world_from_body * in_body)),
            bone_in_body: text(in_body),
            bone_in_parent: text(in_parent),
        };
    bones()
        .iter()
        .zip(&Skeleton::chain(&relative))
        .zip(&relative)
        .map(reading)
        .collect()
}
