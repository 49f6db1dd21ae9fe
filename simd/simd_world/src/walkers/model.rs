//! The kinds of walker in the catalogue: ids, ages, sizes, looks.
//!
//! Ids, age groups and attributes are CARLA 0.9.16's; bodies, heights and clothes are our own and
//! follow from the number in the id.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use schema_frames::document::{BodyBox, CatalogueEntry};
use schema_types::Class;
use schema_types::noise::Noise;
use simd_body::person::{Age, Hair, Look, PersonShape};

/// Number of walkers: `walker.pedestrian.0001` to `0052`.
const N_WALKERS: u32 = 52;
/// Random stream of the looks: no other use of the seed has this number.
const STREAM: u64 = 0x3a1e_9001;
/// Ids of children and of police officers.
const CHILDREN: [u32; 8] = [9, 10, 11, 12, 13, 14, 48, 49];
const TEENAGERS: [u32; 4] = [5, 6, 23, 24];
const ELDERLY: [u32; 6] = [4, 17, 25, 36, 42, 46];
const POLICE: [u32; 2] = [30, 32];
/// Walkers from this number on are of generation 2.
const GENERATION_2_FROM: u32 = 15;

const SKINS: [[u8; 3]; 6] = [
    [236, 196, 168],
    [222, 176, 144],
    [198, 152, 118],
    [160, 112, 82],
    [118, 78, 56],
    [84, 56, 42],
];
const HAIRS: [[u8; 3]; 6] = [
    [34, 26, 22],
    [58, 40, 28],
    [96, 64, 38],
    [150, 112, 66],
    [190, 160, 108],
    [128, 52, 28],
];
const GREY_HAIRS: [[u8; 3]; 2] = [[176, 174, 170], [128, 126, 124]];
const TOPS: [[u8; 3]; 12] = [
    [44, 70, 120],
    [170, 50, 60],
    [226, 226, 222],
    [52, 56, 64],
    [66, 112, 84],
    [212, 166, 52],
    [120, 88, 140],
    [196, 108, 60],
    [92, 150, 180],
    [140, 134, 122],
    [30, 34, 44],
    [208, 142, 156],
];
const BOTTOMS: [[u8; 3]; 7] = [
    [52, 62, 92],
    [44, 46, 54],
    [96, 90, 80],
    [140, 126, 100],
    [30, 32, 38],
    [72, 84, 112],
    [116, 60, 52],
];
const SHOES: [[u8; 3]; 4] = [[38, 32, 30], [92, 62, 42], [212, 210, 204], [58, 62, 72]];

/// One kind of walker.
#[derive(Clone, Debug, PartialEq)]
pub struct WalkerModel {
    /// Catalogue id.
    pub type_id: String,
    /// Body.
    pub shape: PersonShape,
    /// CARLA's `gender`.
    pub gender: &'static str,
    /// CARLA's `age`.
    pub age: &'static str,
    /// CARLA's `generation`.
    pub generation: u8,
    /// Whether it can sit in a wheelchair.
    pub can_use_wheelchair: bool,
    /// Natural speeds of a walk and of a run, m/s.
    pub speeds_mps: [f64; 2],
    /// Mass, kg.
    pub mass_kg: f64,
}

impl WalkerModel {
    fn new(number: u32) -> WalkerModel {
        let draw = Noise::new(u64::from(number), STREAM, 0);
        let pick = |what: u64, n: usize| (draw.bits(what) % n as u64) as usize;
        let officer = POLICE.contains(&number);
        // Female and male walkers alternate.
        let female = if officer {
            number == POLICE[1]
        } else {
            number.is_multiple_of(2)
        };
        let (group, age) = match number {
            _ if CHILDREN.contains(&number) => (Age::Child, "child"),
            _ if TEENAGERS.contains(&number) => (Age::Teenager, "teenager"),
            _ if ELDERLY.contains(&number) => (Age::Elderly, "elderly"),
            _ => (Age::Adult, "adult"),
        };
        let spread = 0.01 * (pick(2, 9) as f64 - 4.0);
        let height_m = match (group, female) {
            (Age::Child, _) => 1.10 + 0.5 * spread,
            (Age::Teenager, _) => 1.62 + spread,
            (Age::Elderly, true) => 1.62 + spread,
            (Age::Elderly, false) => 1.74 + spread,
            (Age::Adult, true) => 1.70 + spread,
            (Age::Adult, false) => 1.82 + spread,
        };
        let hair = match (officer, group, female) {
            (true, ..) => Hair::Cap,
            (_, Age::Child, false) | (_, _, false) if pick(3, 7) > 0 || group == Age::Child => {
                Hair::Short
            }
            (_, _, false) => Hair::Bald,
            (_, _, true) if pick(3, 3) == 0 => Hair::Short,
            _ => Hair::Long,
        };
        let blue = [34, 44, 78];
        let look = Look {
            skin_rgb: SKINS[pick(4, SKINS.len())],
            hair_rgb: match group {
                _ if officer => [22, 26, 42],
                Age::Elderly => GREY_HAIRS[pick(5, GREY_HAIRS.len())],
                _ => HAIRS[pick(5, HAIRS.len())],
            },
            top_rgb: if officer {
                blue
            } else {
                TOPS[pick(6, TOPS.len())]
            },
            bottom_rgb: if officer {
                [26, 30, 44]
            } else {
                BOTTOMS[pick(7, BOTTOMS.len())]
            },
            shoe_rgb: SHOES[if officer { 0 } else { pick(8, SHOES.len()) }],
            hair,
            short_sleeves: !officer && pick(9, 5) < 2,
            skirt: female && !officer && pick(10, 3) == 0,
            female,
        };
        let shape = PersonShape {
            age: group,
            height_m,
            look,
        };
        // A body mass index of 16 for children, 20 for teenagers, 24 for the others.
        let index = match group {
            Age::Child => 16.0,
            Age::Teenager => 20.0,
            _ => 24.0,
        };
        let leg = shape.skeleton().leg_m() / 0.90;
        let walk = if group == Age::Elderly { 1.1 } else { 1.4 } * leg.sqrt();
        let run = if group == Age::Elderly { 1.8 } else { 2.9 } * leg.sqrt();
        let round = |x: f64| (x * 20.0).round() / 20.0;
        WalkerModel {
            type_id: format!("walker.pedestrian.{number:04}"),
            shape,
            gender: if female { "female" } else { "male" },
            age,
            generation: if number < GENERATION_2_FROM { 1 } else { 2 },
            can_use_wheelchair: group != Age::Child && number >= GENERATION_2_FROM,
            speeds_mps: [round(walk), round(run)],
            mass_kg: index * height_m * height_m,
        }
    }

    /// Radius of the upright capsule that stands for the body, metres.
    pub fn radius_m(&self) -> f64 {
        let [x, y, _] = self.shape.half_m();
        0.5 * (x + y)
    }

    pub(crate) fn body_box(&self) -> BodyBox {
        BodyBox {
            centre_m: [0.0; 3],
            half_m: self.shape.half_m().map(|x| x as f32),
        }
    }

    /// Attributes with their values in the catalogue.
    pub(crate) fn attributes(&self) -> BTreeMap<String, String> {
        let mut attributes = BTreeMap::from([
            ("age".to_owned(), self.age.to_owned()),
            ("gender".to_owned(), self.gender.to_owned()),
            ("generation".to_owned(), self.generation.to_string()),
            ("is_invincible".to_owned(), "true".to_owned()),
            ("speed".to_owned(), "0.0".to_owned()),
        ]);
        if self.can_use_wheelchair {
            attributes.insert("can_use_wheelchair".to_owned(), "true".to_owned());
            attributes.insert("use_wheelchair".to_owned(), "false".to_owned());
        }
        attributes
    }

    pub(crate) fn catalogue_entry(&self) -> CatalogueEntry {
        CatalogueEntry {
            type_id: self.type_id.clone(),
            kind: "walker".to_owned(),
            class: Class::PEDESTRIANS.0,
            body_box: self.body_box(),
            attributes: self.attributes(),
            recommended: BTreeMap::from([(
                "speed".to_owned(),
                [0.0, self.speeds_mps[0], self.speeds_mps[1]]
                    .map(|x| format!("{x:?}"))
                    .to_vec(),
            )]),
        }
    }
}

/// Every walker by rising id.
pub fn walker_models() -> &'static [WalkerModel] {
    static MODELS: OnceLock<Vec<WalkerModel>> = OnceLock::new();
    MODELS.get_or_init(|| (1..=N_WALKERS).map(WalkerModel::new).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_people_of_every_age_and_of_human_size() {
        for age in ["child", "teenager", "adult", "elderly"] {
            let of_age: Vec<_> = walker_models()
                .iter()
                .filter(|model| model.age == age)
                .collect();
            assert!(of_age.len() >= 2, "{age}");
            for gender in ["female", "male"] {
                assert!(
                    of_age.iter().any(|model| model.gender == gender),
                    "{age} {gender}"
                );
            }
        }
        for model in walker_models() {
            let (height_m, mass_kg) = (model.shape.height_m, model.mass_kg);
            assert!(
                (1.0..1.95).contains(&height_m) && (15.0..95.0).contains(&mass_kg),
                "{}: {height_m} m, {mass_kg} kg",
                model.type_id
            );
            assert!(model.speeds_mps[0] < model.speeds_mps[1]);
        }
    }
}
