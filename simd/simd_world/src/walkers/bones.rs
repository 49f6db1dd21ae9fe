//! A walker's own pose beside its gait: bones that commands hold, shown by a share.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Translation3};
use schema_frames::{BoneReading, CommandReply, HeldBone, SkeletonAction};
use schema_types::{ActorId, Pose};
use serde::{Deserialize, Serialize};
use simd_body::person::bones::{between, bones, find};
use simd_body::person::{N_PARTS, Posture, Skeleton};

use super::Walker;
use crate::world::World;

/// Farthest that a bone may be held from its parent, metres.
const MAX_OFFSET_M: f64 = 100.0;

/// Bones that somebody holds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct OwnPose {
    /// In their parents' frames, by the bone's number.
    held: BTreeMap<u8, Isometry3<f64>>,
    /// 0: the gait alone; 1: this pose alone.
    ratio: f64,
}

impl Walker {
    /// Bones in their parents' frames as they are shown.
    fn relative_bones(&self) -> Vec<Isometry3<f64>> {
        let skeleton = self.model().shape.skeleton();
        let mut shown = skeleton.relative_bones(self.posture());
        if let Some(own) = self.own_pose.as_ref().filter(|own| own.ratio > 0.0) {
            let standing = skeleton.relative_bones(Posture::Upright {
                phase_rad: 0.0,
                speed_mps: 0.0,
            });
            for (idx, bone) in shown.iter_mut().enumerate() {
                *bone = between(
                    bone,
                    own.held.get(&(idx as u8)).unwrap_or(&standing[idx]),
                    own.ratio,
                );
            }
        }
        shown
    }

    /// Poses of the body's parts as they are shown, about the ground between the feet.
    pub fn parts(&self) -> [Isometry3<f64>; N_PARTS] {
        let skeleton = self.model().shape.skeleton();
        match &self.own_pose {
            Some(own) if own.ratio > 0.0 => {
                skeleton.parts_on(&Skeleton::chain(&self.relative_bones()))
            }
            _ => skeleton.parts(self.posture()),
        }
    }

    /// From the ground under the middle of the body to the world.
    pub fn world_from_ground(&self) -> Isometry3<f64> {
        self.pose() * Translation3::new(0.0, 0.0, -0.5 * self.model().shape.height_m)
    }

    fn read_bones(&self) -> Vec<BoneReading> {
        let text = |pose: &Isometry3<f64>| Pose::from(*pose).into();
        let relative = self.relative_bones();
        let world_from_body = self.world_from_ground();
        let reading = |((bone, in_body), in_parent): (
            (&simd_body::person::bones::Bone, &Isometry3<f64>),
            &Isometry3<f64>,
        )| BoneReading {
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

    fn hold_bones(&mut self, wanted: &[HeldBone]) -> Result<(), String> {
        let mut held = Vec::with_capacity(wanted.len());
        for bone in wanted {
            let idx = find(&bone.name)
                .ok_or_else(|| format!("there is no bone {:?}; `read` lists them", bone.name))?;
            let pose = Pose::from(bone.bone_in_parent);
            let near = pose
                .translation_m
                .iter()
                .all(|x| x.is_finite() && x.abs() <= MAX_OFFSET_M);
            let norm = pose.rotation_xyzw.iter().map(|x| x * x).sum::<f64>().sqrt();
            if !near || !(0.5..2.0).contains(&norm) {
                return Err(format!(
                    "bone {:?} needs a place within {MAX_OFFSET_M} m of its parent and a unit quaternion",
                    bone.name
                ));
            }
            held.push((idx as u8, pose.isometry()));
        }
        self.own_pose.get_or_insert_default().held.extend(held);
        Ok(())
    }
}

impl World {
    /// Reads or holds the bones of a walker.
    pub(crate) fn act_on_skeleton(
        &mut self,
        actor: ActorId,
        action: &SkeletonAction,
    ) -> CommandReply {
        let walker = match self.walker_mut(actor) {
            Ok(walker) => walker,
            Err(error) => {
                return CommandReply::Refused {
                    error: error.to_string(),
                };
            }
        };
        let done = match action {
            SkeletonAction::Read => {
                return CommandReply::Bones {
                    bones: walker.read_bones(),
                };
            }
            SkeletonAction::Hold { bones } => walker.hold_bones(bones),
            SkeletonAction::Blend { ratio } if (0.0..=1.0).contains(ratio) => {
                walker.own_pose.get_or_insert_default().ratio = *ratio;
                Ok(())
            }
            SkeletonAction::Blend { ratio } => Err(format!(
                "a pose cannot be blended by {ratio}; give 0 (the gait) to 1 (the own pose)"
            )),
            SkeletonAction::Capture => {
                let gait = walker
                    .model()
                    .shape
                    .skeleton()
                    .relative_bones(walker.posture());
                walker.own_pose.get_or_insert_default().held = gait
                    .into_iter()
                    .enumerate()
                    .map(|(idx, bone)| (idx as u8, bone))
                    .collect();
                Ok(())
            }
        };
        match done {
            Ok(()) => CommandReply::Done,
            Err(error) => CommandReply::Refused { error },
        }
    }
}
