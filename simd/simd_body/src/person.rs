//! People made from a few numbers: twelve rigid parts, and how they move.

use schema_types::Class;
use sensor_core::mesh::Surface;
use sensor_core::{Material, Mesh, MeshBuilder};

mod body;
pub mod bones;
mod gait;
pub(crate) mod stack;
mod wheelchair;

pub use gait::{N_PARTS, Part, Posture, Skeleton, stride_m};

/// Age group; sets the proportions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Age {
    /// About six years.
    Child,
    /// About fourteen years.
    Teenager,
    /// Grown up.
    Adult,
    /// Old.
    Elderly,
}

/// What the hair is like.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Hair {
    /// None.
    Bald,
    /// Short.
    Short,
    /// To the shoulders.
    Long,
    /// A flat cap over short hair.
    Cap,
}

/// Looks that do not change the measures. Colours are sRGB.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Look {
    /// Skin.
    pub skin_rgb: [u8; 3],
    /// Hair, or the cap.
    pub hair_rgb: [u8; 3],
    /// Shirt, jacket, dress.
    pub top_rgb: [u8; 3],
    /// Trousers or skirt.
    pub bottom_rgb: [u8; 3],
    /// Shoes.
    pub shoe_rgb: [u8; 3],
    /// Hair.
    pub hair: Hair,
    /// Bare forearms.
    pub short_sleeves: bool,
    /// A skirt to the knees.
    pub skirt: bool,
    /// Shape of chest, waist and hips.
    pub female: bool,
}

/// One person.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PersonShape {
    /// Age group.
    pub age: Age,
    /// From the soles to the crown, metres.
    pub height_m: f64,
    /// Looks.
    pub look: Look,
}

/// Meshes of a person. Each is about its joint (torso: between the hip joints, head: base of the
/// neck); left and right are alike.
#[derive(Clone, Debug)]
pub struct PersonMeshes {
    /// By [`Part`] without sides: torso, head, upper arm, forearm, thigh, shin, foot.
    pub parts: [Mesh; 7],
    /// What a seated person sits in, about the ground under the middle of the body.
    pub wheelchair: Mesh,
}

/// Index into [`PersonMeshes::parts`] of a part by its number.
pub fn mesh_of(part: usize) -> usize {
    if part < 2 { part } else { 2 + (part - 2) / 2 }
}

/// Half depth and half width of a standing body as shares of its height.
const HALF_BOX: [f64; 2] = [0.100, 0.138];

/// Heights of the joints as shares of the body's.
struct Proportions {
    hip: f64,
    knee: f64,
    shoulder: f64,
    neck: f64,
    head_half_y: f32,
}

impl Age {
    fn proportions(self) -> Proportions {
        match self {
            Age::Child => Proportions {
                hip: 0.470,
                knee: 0.255,
                shoulder: 0.765,
                neck: 0.800,
                head_half_y: 0.062,
            },
            Age::Teenager => Proportions {
                hip: 0.520,
                knee: 0.280,
                shoulder: 0.805,
                neck: 0.850,
                head_half_y: 0.046,
            },
            Age::Adult | Age::Elderly => Proportions {
                hip: 0.530,
                knee: 0.285,
                shoulder: 0.815,
                neck: 0.865,
                head_half_y: 0.042,
            },
        }
    }
}

impl PersonShape {
    /// A person in grey.
    pub fn plain(age: Age, height_m: f64) -> PersonShape {
        let grey = [128; 3];
        let look = Look {
            skin_rgb: [200, 160, 130],
            hair_rgb: grey,
            top_rgb: grey,
            bottom_rgb: grey,
            shoe_rgb: grey,
            hair: Hair::Short,
            short_sleeves: false,
            skirt: false,
            female: false,
        };
        PersonShape {
            age,
            height_m,
            look,
        }
    }

    /// Half extents of the box round the standing body.
    pub fn half_m(&self) -> [f64; 3] {
        [
            HALF_BOX[0] * self.height_m,
            HALF_BOX[1] * self.height_m,
            0.5 * self.height_m,
        ]
    }

    /// Joints.
    pub fn skeleton(&self) -> Skeleton {
        let (h, p) = (self.height_m, self.age.proportions());
        Skeleton {
            height_m: h,
            hip_m: p.hip * h,
            hip_half_m: 0.048 * h,
            knee_m: p.knee * h,
            ankle_m: 0.039 * h,
            shoulder_m: p.shoulder * h,
            shoulder_half_m: 0.113 * h,
            upper_arm_m: 0.172 * h,
            forearm_m: 0.146 * h,
            neck_m: p.neck * h,
            heel_m: 0.055 * h,
            toe_m: 0.100 * h,
        }
    }

    fn surface(&self, rgb: [u8; 3]) -> Surface {
        Surface::new(Class::PEDESTRIANS, Material::Cloth, rgb)
    }
}

/// Distance up to which the fine level is drawn, metres.
const NEAR_M: f32 = 22.0;

/// Builds the meshes for a shape. Standing, they fit its box to 1 cm.
pub fn person_meshes(shape: &PersonShape) -> PersonMeshes {
    type Build = fn(&mut MeshBuilder, &PersonShape, usize);
    let builders: [(&str, Build); 7] = [
        ("torso", body::torso),
        ("head", body::head),
        ("upper arm", body::upper_arm),
        ("forearm", body::forearm),
        ("thigh", body::thigh),
        ("shin", body::shin),
        ("foot", body::foot),
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
    use super::*;
    use nalgebra::Point3;

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
