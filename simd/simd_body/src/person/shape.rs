//! The numbers that a person is made from.

use schema_types::Class;
use sensor_core::Material;
use sensor_core::mesh::Surface;

use super::gait::Skeleton;

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

/// Style of the hair.
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

/// Half depth and half width of a standing body as shares of its height.
const HALF_BOX: [f64; 2] = [0.100, 0.138];

/// Heights of the joints as shares of the body's.
pub(super) struct Proportions {
    pub hip: f64,
    pub knee: f64,
    pub shoulder: f64,
    pub neck: f64,
    pub head_half_y: f32,
}

impl Age {
    pub(super) fn proportions(self) -> Proportions {
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
    /// A person with grey clothes and hair.
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

    pub(super) fn surface(&self, rgb: [u8; 3]) -> Surface {
        Surface::new(Class::PEDESTRIANS, Material::Cloth, rgb)
    }
}
