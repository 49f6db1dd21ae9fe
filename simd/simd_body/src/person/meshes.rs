//! The meshes of a person, one for each kind of part.

use sensor_core::{Mesh, MeshBuilder};

use super::shape::PersonShape;
use super::{parts, wheelchair};

/// Meshes of a person. The origin of each is its joint (torso: between the hip joints, head: base
/// of the neck); left and right are alike.
#[derive(Clone, Debug)]
pub struct PersonMeshes {
    /// By [`Part`] without sides: torso, head, upper arm, forearm, thigh, shin, foot.
    pub parts: [Mesh; 7],
    /// Wheelchair of a seated person; its origin is on the ground under the middle of the body.
    pub wheelchair: Mesh,
}

/// Index into [`PersonMeshes::parts`] of a part by its number.
pub fn mesh_of(part: usize) -> usize {
    if part < 2 { part } else { 2 + (part - 2) / 2 }
}

/// Distance up to which the fine level is drawn, metres.
const NEAR_M: f32 = 22.0;

/// Builds the meshes for a shape. Standing, they fit its box to 1 cm.
pub fn person_meshes(shape: &PersonShape) -> PersonMeshes {
    type Build = fn(&mut MeshBuilder, &PersonShape, usize);
    let builders: [(&str, Build); 7] = [
        ("torso", parts::torso),
        ("head", parts::head),
        ("upper arm", parts::upper_arm),
        ("forearm", parts::forearm),
        ("thigh", parts::thigh),
        ("shin", parts::shin),
        ("foot", parts::foot),
    ];
    let parts = builders.map(|(name, build)| {
        let mut builder = MeshBuilder::new(format!("person {name}"));
        for (n_sides, until_m) in [(12, NEAR_M), (4, f32::INFINITY)] {
            build(&mut builder, shape, n_sides);
            builder.end_level(until_m);
        }
        builder.finish()
    });
    PersonMeshes {
        parts,
        wheelchair: wheelchair::wheelchair(shape.height_m as f32),
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;
    use schema_types::Class;

    use super::*;
    use crate::person::{Age, Hair, Look, N_PARTS, Posture};

    #[test]
    fn a_standing_body_fits_its_box_to_a_centimetre() {
        for age in [Age::Child, Age::Teenager, Age::Adult, Age::Elderly] {
            for (hair, female) in [
                (Hair::Short, false),
                (Hair::Long, true),
                (Hair::Cap, false),
                (Hair::Bald, false),
            ] {
                let plain = PersonShape::plain(age, 1.86);
                let shape = PersonShape {
                    look: Look {
                        hair,
                        female,
                        ..plain.look
                    },
                    ..plain
                };
                let meshes = person_meshes(&shape);
                let parts = shape.skeleton().parts(Posture::Upright {
                    phase_rad: 0.0,
                    speed_mps: 0.0,
                });
                let (mut low, mut high) = ([f64::MAX; 3], [f64::MIN; 3]);
                for (part, pose) in parts.iter().enumerate() {
                    for (corners, vertex) in meshes.parts[mesh_of(part)].triangles() {
                        assert_eq!(vertex.class, Class::PEDESTRIANS.0);
                        for corner in corners {
                            let p = pose * Point3::from(corner.map(f64::from));
                            (0..3).for_each(|i| {
                                (low[i], high[i]) = (low[i].min(p[i]), high[i].max(p[i]))
                            });
                        }
                    }
                }
                let half = shape.half_m();
                // Depth: the toes reach the front of the box, and nothing behind is further out.
                assert!(
                    (high[0] - half[0]).abs() < 0.01 && low[0] > -half[0] - 0.01,
                    "{age:?} {hair:?}: x {low:?} {high:?}"
                );
                for (side, y) in [(-1.0, low[1]), (1.0, high[1])] {
                    assert!(
                        (y - side * half[1]).abs() < 0.01,
                        "{age:?}: y {low:?} {high:?} {half:?}"
                    );
                }
                assert!(
                    low[2].abs() < 0.01 && (high[2] - 2.0 * half[2]).abs() < 0.01,
                    "{age:?} {hair:?}: z {low:?} {high:?}"
                );
            }
        }
    }

    #[test]
    fn a_person_is_cheap() {
        let meshes = person_meshes(&PersonShape::plain(Age::Adult, 1.8));
        let count = |lod: usize| {
            (0..N_PARTS)
                .map(|part| meshes.parts[mesh_of(part)].lods[lod].n_indices / 3)
                .sum::<u32>()
        };
        assert!(
            count(0) < 3000 && count(1) < 700,
            "{} {}",
            count(0),
            count(1)
        );
    }
}
