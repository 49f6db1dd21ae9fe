//! The props of CARLA 0.9.16's library, with sizes and shapes of our own.

use std::collections::BTreeMap;

use rapier3d::math::Vector;
use schema_frames::document::{BodyBox, CatalogueEntry};
use schema_types::Class;
use simd_body::prop::{PropShape, PropStyle};

use crate::errors::{self, BadAttribute};

/// One kind of prop: name behind `static.prop.`; family; length, width and height in centimetres;
/// two colours.
type Row = (&'static str, PropStyle, [u16; 3], [u8; 3], [u8; 3]);

const ORANGE: [u8; 3] = [226, 92, 24];
const WHITE: [u8; 3] = [232, 232, 228];
const RED: [u8; 3] = [190, 36, 34];
const YELLOW: [u8; 3] = [232, 186, 36];
const GREEN: [u8; 3] = [58, 112, 66];
const LEAF: [u8; 3] = [70, 120, 52];
const BLUE: [u8; 3] = [40, 80, 150];
const GREY: [u8; 3] = [140, 142, 144];
const DARK: [u8; 3] = [46, 48, 52];
const BROWN: [u8; 3] = [120, 84, 54];
const CARTON: [u8; 3] = [176, 140, 98];
const STONE: [u8; 3] = [164, 158, 148];
const CLAY: [u8; 3] = [168, 92, 62];
const STRAW: [u8; 3] = [206, 176, 96];

use PropStyle::{
    Bag, Barrel, Barrier, Bench, Bin, Board, Cart, Chair, Cone, Container, Crate, Debris, Fountain,
    Lamp, Plant, Plate, Round, Shelter, Sign, Table, Tree,
};

const ROWS: &[Row] = &[
    ("advertisement", Crate, [30, 130, 250], DARK, WHITE),
    ("atm", Crate, [70, 80, 170], BLUE, GREY),
    ("barbeque", Table, [60, 110, 95], DARK, RED),
    ("barrel", Barrel, [58, 58, 88], BLUE, GREY),
    ("bench01", Bench, [62, 180, 85], BROWN, DARK),
    ("bench02", Bench, [70, 200, 90], BROWN, GREY),
    ("bench03", Bench, [60, 160, 80], GREEN, DARK),
    ("bike helmet", Round, [28, 22, 17], RED, WHITE),
    ("bikeparking", Shelter, [90, 220, 85], GREY, GREY),
    ("bin", Bin, [50, 50, 95], GREEN, DARK),
    ("box01", Crate, [60, 60, 50], CARTON, BROWN),
    ("box02", Crate, [45, 60, 40], CARTON, BROWN),
    ("box03", Crate, [35, 45, 30], CARTON, WHITE),
    ("briefcase", Crate, [12, 44, 34], BROWN, DARK),
    ("brokentile01", Debris, [60, 55, 6], CLAY, STONE),
    ("brokentile02", Debris, [50, 60, 5], CLAY, CLAY),
    ("brokentile03", Debris, [45, 45, 5], STONE, CLAY),
    ("brokentile04", Debris, [70, 50, 6], STONE, GREY),
    ("busstop", Shelter, [170, 400, 260], DARK, GREY),
    ("busstoplb", Shelter, [160, 360, 255], GREY, DARK),
    ("calibrator", Sign, [40, 100, 190], WHITE, DARK),
    ("chainbarrier", Barrier, [24, 160, 95], GREY, DARK),
    ("chainbarrierend", Barrier, [24, 60, 95], GREY, DARK),
    ("clothcontainer", Container, [110, 130, 190], GREEN, WHITE),
    ("clothesline", Shelter, [120, 300, 190], WHITE, GREY),
    ("colacan", Barrel, [7, 7, 12], RED, WHITE),
    ("constructioncone", Cone, [45, 45, 80], ORANGE, WHITE),
    ("container", Container, [600, 244, 259], CLAY, GREY),
    ("creasedbox01", Crate, [55, 60, 35], CARTON, CARTON),
    ("creasedbox02", Crate, [50, 45, 30], CARTON, BROWN),
    ("creasedbox03", Crate, [60, 40, 28], CARTON, STONE),
    ("dirtdebris01", Debris, [120, 110, 12], BROWN, STONE),
    ("dirtdebris02", Debris, [150, 90, 10], BROWN, GREY),
    ("dirtdebris03", Debris, [80, 80, 8], STONE, BROWN),
    ("doghouse", Crate, [95, 80, 85], BROWN, RED),
    ("foodcart", Cart, [180, 110, 210], RED, WHITE),
    ("fountain", Fountain, [320, 320, 220], STONE, STONE),
    ("garbage01", Debris, [60, 60, 14], DARK, WHITE),
    ("garbage02", Debris, [70, 50, 12], WHITE, BLUE),
    ("garbage03", Debris, [50, 50, 10], GREY, RED),
    ("garbage04", Debris, [80, 70, 16], CARTON, WHITE),
    ("garbage05", Debris, [60, 80, 12], GREEN, GREY),
    ("garbage06", Debris, [40, 60, 10], BLUE, WHITE),
    ("gardenlamp", Lamp, [26, 26, 90], DARK, [255, 226, 160]),
    ("glasscontainer", Container, [130, 130, 170], GREEN, GREEN),
    ("gnome", Round, [22, 22, 48], RED, WHITE),
    ("guitarcase", Crate, [14, 42, 108], DARK, BROWN),
    ("haybale", Crate, [60, 110, 48], STRAW, BROWN),
    ("haybalelb", Barrel, [150, 150, 130], STRAW, STRAW),
    ("ironplank", Plate, [200, 100, 3], GREY, DARK),
    ("kiosk_01", Crate, [260, 260, 290], GREEN, WHITE),
    ("mailbox", Crate, [45, 40, 125], YELLOW, DARK),
    ("maptable", Sign, [50, 150, 200], BROWN, WHITE),
    ("mesh", Crate, [100, 100, 100], GREY, GREY),
    ("mobile", Plate, [8, 15, 2], DARK, DARK),
    ("motorhelmet", Round, [32, 25, 26], DARK, BLUE),
    ("omri-sign", Sign, [30, 90, 220], BLUE, WHITE),
    ("pergola", Shelter, [400, 300, 260], BROWN, BROWN),
    ("pickupgarbage", Container, [120, 120, 110], BLUE, GREY),
    ("plantpot01", Plant, [60, 60, 110], CLAY, LEAF),
    ("plantpot02", Plant, [50, 50, 90], STONE, LEAF),
    ("plantpot03", Plant, [80, 80, 130], STONE, GREEN),
    ("plantpot04", Plant, [40, 40, 60], CLAY, LEAF),
    ("plantpot05", Plant, [90, 90, 100], DARK, LEAF),
    ("plantpot06", Plant, [110, 110, 160], STONE, LEAF),
    ("plantpot07", Plant, [70, 70, 85], CLAY, GREEN),
    ("plantpot08", Plant, [55, 55, 75], WHITE, LEAF),
    ("plasticbag", Bag, [32, 26, 38], WHITE, GREY),
    ("plasticchair", Chair, [56, 56, 85], WHITE, WHITE),
    ("plastictable", Table, [90, 90, 74], WHITE, WHITE),
    ("platformgarbage01", Container, [280, 180, 150], GREEN, DARK),
    ("purse", Bag, [14, 32, 26], RED, DARK),
    ("shoppingbag", Bag, [18, 34, 42], CARTON, BROWN),
    ("shoppingcart", Cart, [95, 58, 102], GREY, RED),
    ("shoppingtrolley", Cart, [45, 38, 98], BLUE, DARK),
    ("slide", Cart, [300, 80, 210], YELLOW, RED),
    ("streetbarrier", Barrier, [50, 125, 105], RED, WHITE),
    ("streetfountain", Fountain, [60, 60, 110], DARK, GREY),
    ("streetsign", Sign, [12, 70, 260], WHITE, BLUE),
    ("streetsign01", Sign, [12, 60, 240], WHITE, RED),
    ("streetsign04", Sign, [12, 80, 280], WHITE, GREEN),
    ("swing", Shelter, [160, 260, 220], RED, BLUE),
    ("swingcouch", Bench, [120, 190, 180], GREEN, GREY),
    ("table", Table, [80, 160, 76], BROWN, DARK),
    ("trafficcone01", Cone, [38, 38, 70], ORANGE, WHITE),
    ("trafficcone02", Cone, [30, 30, 50], ORANGE, WHITE),
    ("trafficwarning", Board, [60, 110, 150], YELLOW, DARK),
    ("trampoline", Table, [305, 305, 70], DARK, BLUE),
    ("trashbag", Bag, [62, 56, 60], DARK, DARK),
    ("trashcan01", Bin, [46, 46, 92], GREY, DARK),
    ("trashcan02", Bin, [55, 55, 100], GREEN, GREEN),
    ("trashcan03", Bin, [60, 58, 108], DARK, GREY),
    ("trashcan04", Bin, [42, 42, 80], BLUE, DARK),
    ("trashcan05", Bin, [70, 70, 112], BROWN, DARK),
    ("travelcase", Crate, [26, 46, 68], BLUE, DARK),
    ("vendingmachine", Crate, [85, 100, 185], RED, WHITE),
    ("warningaccident", Board, [50, 90, 100], RED, WHITE),
    ("warningconstruction", Board, [50, 90, 100], YELLOW, DARK),
    ("wateringcan", Barrel, [28, 20, 32], GREEN, GREEN),
    ("aporosatree", Tree, [420, 420, 620], BROWN, LEAF),
    ("coconutpalm", Tree, [360, 360, 900], BROWN, LEAF),
    ("cypresstree", Tree, [180, 180, 750], BROWN, GREEN),
];

/// The prop that stands in for a user's mesh file, and the attributes it has beside its size.
const MESH: &str = "static.prop.mesh";
const MESH_ATTRIBUTES: &[(&str, &str)] = &[("mesh_path", ""), ("scale", "1.0"), ("mass", "1.0")];

/// One kind of prop.
#[derive(Clone, Debug, PartialEq)]
pub struct PropModel {
    /// Catalogue id.
    pub type_id: String,
    /// Shape and class.
    pub shape: PropShape,
    /// CARLA's `size`.
    pub size: &'static str,
}

/// CARLA's word for a size by the longest side.
fn size_word(longest_m: f64) -> &'static str {
    match longest_m {
        x if x < 0.3 => "tiny",
        x if x < 0.8 => "small",
        x if x < 2.0 => "medium",
        x if x < 4.0 => "big",
        _ => "huge",
    }
}

impl PropModel {
    fn new((name, style, size_cm, rgb, accent_rgb): Row) -> PropModel {
        let half_m = size_cm.map(|cm| f64::from(cm) / 200.0);
        let class = match style {
            Tree => Class::VEGETATION,
            Sign | Board => Class::TRAFFIC_SIGNS,
            Barrier => Class::FENCES,
            Bench | Bin | Container | Fountain | Lamp | Shelter | Plant => Class::STATIC,
            _ => Class::DYNAMIC,
        };
        let longest_m = half_m.iter().fold(0.0f64, |a, b| a.max(2.0 * b));
        PropModel {
            type_id: format!("static.prop.{name}"),
            shape: PropShape {
                style,
                half_m,
                rgb,
                accent_rgb,
                class,
            },
            size: size_word(longest_m),
        }
    }

    fn attributes(&self) -> BTreeMap<String, String> {
        let size = [("size", self.size)];
        let of_mesh = if self.type_id == MESH {
            MESH_ATTRIBUTES
        } else {
            &[]
        };
        size.iter()
            .chain(of_mesh)
            .map(|(name, value)| ((*name).to_owned(), (*value).to_owned()))
            .collect()
    }

    /// The catalogue's attributes with the `given` ones in their place.
    ///
    /// # Errors
    /// A given attribute that the prop does not have, or that may not differ.
    pub(crate) fn checked_attributes(
        &self,
        given: &BTreeMap<String, String>,
    ) -> Result<BTreeMap<String, String>, BadAttribute> {
        errors::checked_attributes(self.attributes(), given, |name, value, _| {
            self.refusal(name, value)
        })
    }

    /// What it weighs: its attribute `mass`, or what things of its family weigh per volume of their
    /// boxes, hollow as most are.
    pub(crate) fn mass_kg(&self, attributes: &BTreeMap<String, String>) -> f64 {
        let given = attributes.get("mass").and_then(|mass| mass.parse().ok());
        let density_kgpm3 = match self.shape.style {
            Shelter => 10.0,
            Sign | Cone | Chair => 30.0,
            Bench | Board | Cart | Lamp | Table | Tree => 60.0,
            Bag | Bin | Container | Crate | Round => 100.0,
            Barrel | Barrier | Plant => 150.0,
            Debris => 300.0,
            Fountain | Plate => 1000.0,
        };
        let volume_m3: f64 = self.shape.half_m.iter().map(|half| 2.0 * half).product();
        given.unwrap_or_else(|| (density_kgpm3 * volume_m3).max(0.05))
    }

    /// Whether it is litter so flat that cars and people go over it and touch nothing, as they do
    /// in CARLA.
    pub(crate) fn is_litter(&self) -> bool {
        self.shape.style == Debris
    }

    /// Half extents of its box in the engine, metres.
    pub(crate) fn engine_half(&self) -> Vector {
        let [x, y, z] = self.shape.half_m.map(|x| x as f32);
        Vector::new(x, y, z)
    }

    /// Why an attribute cannot have this value.
    fn refusal(&self, name: &str, value: &str) -> Option<String> {
        let attributes = self.attributes();
        let is_positive = value
            .parse::<f64>()
            .is_ok_and(|number| number > 0.0 && number.is_finite());
        match (name, attributes.get(name)) {
            (_, Some(is)) if is == value => None,
            // The path names a file of CARLA's engine, which cannot be read here: a box of one
            // metre stands for the mesh.
            ("mesh_path", Some(_)) => None,
            ("mass", Some(_)) if is_positive => None,
            ("mass", Some(_)) => Some("it must be a number above 0".to_owned()),
            ("scale", Some(_)) if value.parse() == Ok(1.0f64) => None,
            ("scale", Some(_)) => {
                Some("only 1.0 is supported: a box of 1 m stands for the mesh".to_owned())
            }
            (_, Some(is)) => Some(format!("it is fixed at {is:?}")),
            (_, None) => Some(format!(
                "this prop has only {}",
                attributes.keys().cloned().collect::<Vec<_>>().join(", ")
            )),
        }
    }

    pub(crate) fn catalogue_entry(&self) -> CatalogueEntry {
        let half_m = self.shape.half_m.map(|x| x as f32);
        CatalogueEntry {
            type_id: self.type_id.clone(),
            kind: "prop".to_owned(),
            class: self.shape.class.0,
            body_box: BodyBox {
                centre_m: [0.0, 0.0, half_m[2]],
                half_m,
            },
            attributes: self.attributes(),
            recommended: BTreeMap::new(),
        }
    }
}

/// Every prop in the order of the catalogue.
pub fn prop_models() -> &'static [PropModel] {
    static MODELS: std::sync::OnceLock<Vec<PropModel>> = std::sync::OnceLock::new();
    MODELS.get_or_init(|| ROWS.iter().map(|row| PropModel::new(*row)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn about_a_hundred_things_of_sensible_size() {
        assert!(ROWS.len() >= 95, "{}", ROWS.len());
        for model in prop_models() {
            let [x, y, z] = model.shape.half_m;
            assert!(
                (0.005..5.0).contains(&x) && (0.005..5.0).contains(&y) && (0.005..5.0).contains(&z),
                "{}",
                model.type_id
            );
        }
        let cone = prop_models()
            .iter()
            .find(|model| model.type_id == "static.prop.trafficcone01")
            .unwrap();
        assert_eq!(cone.size, "small");
    }
}
