//! Semantic classes: CARLA's numbers 0–28 with their names and colours (CARLA ≥ 0.9.14).
//!
//! This is the only table of them: shaders, viewer, recorder and Python take it from here.

/// Semantic class of a triangle. Any `u8` is valid data; only 0–28 have a name.
#[repr(transparent)]
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    Hash,
    PartialOrd,
    Ord,
    bytemuck::Pod,
    bytemuck::Zeroable,
    serde::Serialize,
    serde::Deserialize,
)]
pub struct Class(pub u8);

/// Name and display colour (sRGB) of one class.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClassInfo {
    /// English name as CARLA spells it.
    pub name: &'static str,
    /// Display colour, sRGB.
    pub rgb: [u8; 3],
}

macro_rules! classes {
    ($($number:literal $konst:ident $name:literal $rgb:expr;)*) => {
        impl Class {
            $(#[doc = concat!("Class ", $number, ": ", $name, ".")] pub const $konst: Class = Class($number);)*
        }
        /// Every named class; the index is the number.
        pub const CLASSES: [ClassInfo; 29] = [$(ClassInfo { name: $name, rgb: $rgb },)*];
    };
}

classes! {
    0 UNLABELED "Unlabeled" [0, 0, 0];
    1 ROADS "Roads" [128, 64, 128];
    2 SIDEWALKS "Sidewalks" [244, 35, 232];
    3 BUILDINGS "Buildings" [70, 70, 70];
    4 WALLS "Walls" [102, 102, 156];
    5 FENCES "Fences" [190, 153, 153];
    6 POLES "Poles" [153, 153, 153];
    7 TRAFFIC_LIGHT "TrafficLight" [250, 170, 30];
    8 TRAFFIC_SIGNS "TrafficSigns" [220, 220, 0];
    9 VEGETATION "Vegetation" [107, 142, 35];
    10 TERRAIN "Terrain" [152, 251, 152];
    11 SKY "Sky" [70, 130, 180];
    12 PEDESTRIANS "Pedestrians" [220, 20, 60];
    13 RIDER "Rider" [255, 0, 0];
    14 CAR "Car" [0, 0, 142];
    15 TRUCK "Truck" [0, 0, 70];
    16 BUS "Bus" [0, 60, 100];
    17 TRAIN "Train" [0, 80, 100];
    18 MOTORCYCLE "Motorcycle" [0, 0, 230];
    19 BICYCLE "Bicycle" [119, 11, 32];
    20 STATIC "Static" [110, 190, 160];
    21 DYNAMIC "Dynamic" [170, 120, 50];
    22 OTHER "Other" [55, 90, 80];
    23 WATER "Water" [45, 60, 150];
    24 ROAD_LINES "RoadLines" [157, 234, 50];
    25 GROUND "Ground" [81, 0, 81];
    26 BRIDGE "Bridge" [150, 100, 100];
    27 RAIL_TRACK "RailTrack" [230, 150, 140];
    28 GUARD_RAIL "GuardRail" [180, 165, 180];
}

impl Class {
    /// Name and colour; `None` for a number without a name.
    pub fn info(self) -> Option<&'static ClassInfo> {
        CLASSES.get(self.0 as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_match_their_place_in_the_table() {
        assert_eq!(Class::SKY.info().map(|info| info.name), Some("Sky"));
        assert_eq!(Class::GUARD_RAIL.0 as usize, CLASSES.len() - 1);
        assert_eq!(Class(29).info(), None);
    }
}
