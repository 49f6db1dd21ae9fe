//! Bones: the joints of a body with the names of CARLA's skeletons, and the conversion between
//! bones and the twelve parts.
//!
//! While the body stands, the axes of every bone are those of the body: x forward, y left, z up.
//! Fingers, toes and eyes have bones, but no part of the mesh that they move.

use std::sync::LazyLock;

use nalgebra::{Isometry3, Translation3, UnitQuaternion};

use super::gait::{N_PARTS, Part, Posture, Skeleton};

/// One bone.
#[derive(Clone, Debug)]
pub struct Bone {
    /// Name.
    pub name: String,
    /// Index of the bone it hangs from; of the root, itself.
    pub parent: usize,
    /// The part whose gait it follows; `None` for the ground under the body.
    follows: Option<Part>,
    /// Place relative to that part, as shares of the body's height: forward, left, up.
    offset: [f64; 3],
}

/// Number of bones.
pub const N_BONES: usize = 66;
const HIPS: usize = 1;
const SPINE: usize = 3;
/// Shares of the body's height: distance of a shoulder blade from the spine, and length of a
/// finger's joint.
const BLADE: f64 = 0.03;
const JOINT: f64 = 0.012;

static TABLE: LazyLock<Vec<Bone>> = LazyLock::new(table);

/// The bones, parents before children.
pub fn bones() -> &'static [Bone] {
    &TABLE
}

fn table() -> Vec<Bone> {
    let mut all: Vec<Bone> = Vec::with_capacity(N_BONES);
    let mut add = |name: String, parent: usize, follows: Option<Part>, offset: [f64; 3]| {
        all.push(Bone {
            name,
            parent,
            follows,
            offset,
        });
        all.len() - 1
    };
    let torso = Some(Part::Torso);
    let root = add("crl_root".into(), 0, None, [0.0; 3]);
    let hips = add("crl_hips__C".into(), root, torso, [0.0; 3]);
    let spine = add("crl_spine__C".into(), hips, torso, [0.0, 0.0, 0.02]);
    let chest = add("crl_spine01__C".into(), spine, torso, [0.0, 0.0, 0.13]);
    debug_assert_eq!((hips, chest), (HIPS, SPINE));
    let sides = [("L", 1.0, 0), ("R", -1.0, 1)];
    let part = |left: Part, right: Part, side: usize| Some(if side == 0 { left } else { right });
    for (side, sign, i) in sides {
        // The height given here is a placeholder: `Skeleton::offset` puts the blade at the height
        // of the shoulder.
        let prefix = if side == "L" { "ctrl" } else { "crl" };
        let blade = add(
            format!("{prefix}_shoulder__{side}"),
            chest,
            torso,
            [0.0, sign * BLADE, 0.25],
        );
        let arm = add(
            format!("crl_arm__{side}"),
            blade,
            part(Part::UpperArmLeft, Part::UpperArmRight, i),
            [0.0; 3],
        );
        let forearm = add(
            format!("crl_foreArm__{side}"),
            arm,
            part(Part::ForearmLeft, Part::ForearmRight, i),
            [0.0; 3],
        );
        let follows = part(Part::ForearmLeft, Part::ForearmRight, i);
        let wrist_m = -0.146;
        let hand = add(
            format!("crl_hand__{side}"),
            forearm,
            follows,
            [0.0, 0.0, wrist_m],
        );
        for (finger, forward) in [
            ("Thumb", 0.022),
            ("Index", 0.014),
            ("Middle", 0.005),
            ("Ring", -0.004),
            ("Pinky", -0.013),
        ] {
            let mut parent = hand;
            let root_m = wrist_m - if finger == "Thumb" { 0.015 } else { 0.050 };
            // CARLA's table spells the first joints of the other fingers with one underscore.
            let dash = if matches!(finger, "Thumb" | "Index") {
                "__"
            } else {
                "_"
            };
            for (k, (joint, dash)) in [("", dash), ("01", "__"), ("02", "__"), ("End", "__")]
                .into_iter()
                .enumerate()
            {
                let place = [forward, 0.0, root_m - JOINT * k as f64];
                parent = add(
                    format!("crl_hand{finger}{joint}{dash}{side}"),
                    parent,
                    follows,
                    place,
                );
            }
        }
    }
    let neck = add("crl_neck__C".into(), chest, Some(Part::Head), [0.0; 3]);
    let head = add(
        "crl_Head__C".into(),
        neck,
        Some(Part::Head),
        [0.0, 0.0, 0.035],
    );
    for (side, sign, _) in sides {
        add(
            format!("crl_eye__{side}"),
            head,
            Some(Part::Head),
            [0.048, sign * 0.018, 0.075],
        );
    }
    for (side, _, i) in sides {
        let thigh = add(
            format!("crl_thigh__{side}"),
            hips,
            part(Part::ThighLeft, Part::ThighRight, i),
            [0.0; 3],
        );
        let leg = add(
            format!("crl_leg__{side}"),
            thigh,
            part(Part::ShinLeft, Part::ShinRight, i),
            [0.0; 3],
        );
        let follows = part(Part::FootLeft, Part::FootRight, i);
        let foot = add(format!("crl_foot__{side}"), leg, follows, [0.0; 3]);
        let toe = add(
            format!("crl_toe__{side}"),
            foot,
            follows,
            [0.060, 0.0, -0.030],
        );
        add(
            format!("crl_toeEnd__{side}"),
            toe,
            follows,
            [0.100, 0.0, -0.030],
        );
    }
    all
}

/// Index of the bone that carries a part: the part moves with it.
fn carrier(part: usize) -> usize {
    static CARRIERS: LazyLock<[usize; N_PARTS]> = LazyLock::new(|| {
        std::array::from_fn(|part| {
            let name = match part {
                0 => "crl_spine01__C",
                1 => "crl_Head__C",
                _ => {
                    let joint = ["arm", "foreArm", "thigh", "leg", "foot"][(part - 2) / 2];
                    let side = ["L", "R"][part % 2];
                    return find(&format!("crl_{joint}__{side}")).unwrap_or(0);
                }
            };
            find(name).unwrap_or(0)
        })
    });
    CARRIERS[part]
}

/// Index of a bone by its name. Single and double underscores are equivalent.
pub fn find(name: &str) -> Option<usize> {
    let single = |name: &str| name.replace("__", "_");
    let wanted = single(name);
    bones().iter().position(|bone| single(&bone.name) == wanted)
}

impl Skeleton {
    /// Pose of every bone in the body's space, as the gait alone holds it.
    fn bones_in_body(&self, parts: &[Isometry3<f64>; N_PARTS]) -> Vec<Isometry3<f64>> {
        let place = |bone: &Bone| match bone.follows {
            None => Isometry3::identity(),
            Some(part) => parts[part as usize] * self.offset(bone),
        };
        bones().iter().map(place).collect()
    }

    fn offset(&self, bone: &Bone) -> Isometry3<f64> {
        let [x, y, z] = bone.offset.map(|share| share * self.height_m);
        let z = if bone.name.ends_with("shoulder__L") || bone.name.ends_with("shoulder__R") {
            self.shoulder_m - self.hip_m
        } else {
            z
        };
        Isometry3::translation(x, y, z)
    }

    /// Pose of every bone relative to its parent, as a posture holds it.
    pub fn relative_bones(&self, posture: Posture) -> Vec<Isometry3<f64>> {
        let in_body = self.bones_in_body(&self.parts(posture));
        let relative = |(idx, bone): (usize, &Bone)| {
            if idx == bone.parent {
                in_body[idx]
            } else {
                in_body[bone.parent].inv_mul(&in_body[idx])
            }
        };
        bones().iter().enumerate().map(relative).collect()
    }

    /// Converts poses relative to the parents into poses in the body's space.
    pub fn chain(relative: &[Isometry3<f64>]) -> Vec<Isometry3<f64>> {
        let mut in_body: Vec<Isometry3<f64>> = Vec::with_capacity(relative.len());
        for (idx, (bone, pose)) in bones().iter().zip(relative).enumerate() {
            in_body.push(if idx == bone.parent {
                *pose
            } else {
                in_body[bone.parent] * pose
            });
        }
        in_body
    }

    /// Poses of the parts that hang on these bones; all poses are in the body's space.
    pub fn parts_on(&self, in_body: &[Isometry3<f64>]) -> [Isometry3<f64>; N_PARTS] {
        std::array::from_fn(|part| {
            let idx = carrier(part);
            in_body[idx] * self.offset(&bones()[idx]).inverse()
        })
    }
}

/// Interpolates between two poses: positions along a straight line, rotations along the shortest
/// way.
pub fn between(from: &Isometry3<f64>, to: &Isometry3<f64>, ratio: f64) -> Isometry3<f64> {
    let place = from.translation.vector.lerp(&to.translation.vector, ratio);
    let turn = from.rotation.try_slerp(&to.rotation, ratio, 1e-9);
    let turn: UnitQuaternion<f64> = turn.unwrap_or(if ratio < 0.5 {
        from.rotation
    } else {
        to.rotation
    });
    Isometry3::from_parts(Translation3::from(place), turn)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use nalgebra::Vector3;

    use super::*;
    use crate::person::{Age, PersonShape};

    #[test]
    fn there_is_every_bone_once_and_parents_come_first() {
        let names: BTreeSet<&str> = bones().iter().map(|bone| bone.name.as_str()).collect();
        assert_eq!((bones().len(), names.len()), (N_BONES, N_BONES));
        assert!(
            bones()
                .iter()
                .enumerate()
                .all(|(idx, bone)| bone.parent < idx || idx == 0)
        );
    }

    #[test]
    fn bones_there_and_back_give_the_parts_of_the_gait() {
        let skeleton = PersonShape::plain(Age::Adult, 1.8).skeleton();
        let postures = [
            Posture::Upright {
                phase_rad: 1.0,
                speed_mps: 1.4,
            },
            Posture::Upright {
                phase_rad: 4.0,
                speed_mps: 3.5,
            },
            Posture::Seated,
            Posture::Lying,
            Posture::Airborne,
        ];
        for posture in postures {
            let back = skeleton.parts_on(&Skeleton::chain(&skeleton.relative_bones(posture)));
            for (part, (a, b)) in skeleton.parts(posture).iter().zip(&back).enumerate() {
                assert!(
                    (a.translation.vector - b.translation.vector).norm() < 1e-12,
                    "{part} {posture:?}"
                );
                assert!(
                    a.rotation.angle_to(&b.rotation) < 1e-7,
                    "{part} {posture:?}"
                );
            }
        }
    }

    #[test]
    fn a_raised_arm_takes_forearm_and_fingers_along_and_nothing_else() {
        let skeleton = PersonShape::plain(Age::Adult, 1.8).skeleton();
        let standing = Posture::Upright {
            phase_rad: 0.0,
            speed_mps: 0.0,
        };
        let mut relative = skeleton.relative_bones(standing);
        let before = Skeleton::chain(&relative);
        let arm = find("crl_arm__L").unwrap();
        // Straight forward: from hanging down (−z) to x.
        relative[arm].rotation =
            UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -std::f64::consts::FRAC_PI_2);
        let after = Skeleton::chain(&relative);
        let moved: Vec<&str> = (0..N_BONES)
            .filter(|i| {
                (before[*i].translation.vector - after[*i].translation.vector).norm() > 1e-6
            })
            .map(|i| bones()[i].name.as_str())
            .collect();
        assert!(
            moved
                .iter()
                .all(|name| name.ends_with("_L")
                    && (name.contains("hand") || name.contains("foreArm"))),
            "{moved:?}"
        );
        let elbow = after[find("crl_foreArm__L").unwrap()].translation.vector
            - after[arm].translation.vector;
        assert!(
            (elbow - Vector3::new(skeleton.upper_arm_m, 0.0, 0.0)).norm() < 1e-9,
            "{elbow}"
        );
    }
}
