//! A walker's own pose: bones that commands hold, blended with its gait.

use std::collections::BTreeMap;

use nalgebra::Isometry3;
use schema_frames::HeldBone;
use schema_types::Pose;
use serde::{Deserialize, Serialize};
use simd_body::person::bones::{between, find};
use simd_body::person::{Posture, Skeleton};

use crate::errors::SkeletonError;

/// Farthest that a bone may be held from its parent, metres.
const MAX_OFFSET_M: f64 = 100.0;

/// The bones that commands hold.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct OwnPose {
    /// Poses in their parents' space, by the bone's number.
    held: BTreeMap<u8, Isometry3<f64>>,
    /// Share of this pose in what is shown; 0 shows the gait alone, 1 this pose alone.
    ratio: f64,
}

impl OwnPose {
    /// Whether any of it is shown.
    pub fn is_shown(&self) -> bool {
        self.ratio > 0.0
    }

    /// Sets the share of this pose in what is shown, 0 to 1.
    pub fn blend(&mut self, ratio: f64) {
        self.ratio = ratio;
    }

    /// Holds all bones as they are.
    pub fn capture(&mut self, bones: Vec<Isometry3<f64>>) {
        self.held = bones
            .into_iter()
            .enumerate()
            .map(|(idx, bone)| (idx as u8, bone))
            .collect();
    }

    /// Blends this pose into the bones of a gait; bones that are not held stand upright.
    pub fn mix_into(&self, shown: &mut [Isometry3<f64>], skeleton: &Skeleton) {
        let standing = skeleton.relative_bones(Posture::Upright {
            phase_rad: 0.0,
            speed_mps: 0.0,
        });
        for (idx, bone) in shown.iter_mut().enumerate() {
            *bone = between(
                bone,
                self.held.get(&(idx as u8)).unwrap_or(&standing[idx]),
                self.ratio,
            );
        }
    }

    /// Holds bones by their numbers, see [`checked_bones`].
    pub fn hold(&mut self, bones: Vec<(u8, Isometry3<f64>)>) {
        self.held.extend(bones);
    }
}

/// The wanted bones by their numbers.
///
/// # Errors
/// If a bone is unknown or its pose cannot be used.
pub(crate) fn checked_bones(
    wanted: &[HeldBone],
) -> Result<Vec<(u8, Isometry3<f64>)>, SkeletonError> {
    let mut held = Vec::with_capacity(wanted.len());
    for bone in wanted {
        let idx = find(&bone.name).ok_or_else(|| SkeletonError::UnknownBone(bone.name.clone()))?;
        let pose = Pose::from(bone.bone_in_parent);
        let near = pose
            .translation_m
            .iter()
            .all(|x| x.is_finite() && x.abs() <= MAX_OFFSET_M);
        let norm = pose.rotation_xyzw.iter().map(|x| x * x).sum::<f64>().sqrt();
        if !near || !(0.5..2.0).contains(&norm) {
            return Err(SkeletonError::BonePose {
                bone: bone.name.clone(),
                max_offset_m: MAX_OFFSET_M,
            });
        }
        held.push((idx as u8, pose.isometry()));
    }
    Ok(held)
}
