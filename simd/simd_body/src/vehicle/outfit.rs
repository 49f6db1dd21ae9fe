//! What sets a vehicle apart from others of its body.

use schema_types::Class;
use sensor_core::Material;
use sensor_core::mesh::Surface;

/// Equipment and livery of a vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Outfit {
    /// None.
    #[default]
    Plain,
    /// Light bar, white doors.
    Police,
    /// Sign on the roof.
    Taxi,
    /// Light bar, red band.
    Ambulance,
    /// Light bar on the cab, shutters, white band, ladder.
    FireEngine,
    /// Red box with a white wave.
    Drinks,
}

impl Outfit {
    /// Height of what stands on the roof, metres.
    pub(super) fn roof_m(self) -> f32 {
        match self {
            Outfit::Police | Outfit::Ambulance => 0.11,
            Outfit::Taxi => 0.15,
            Outfit::FireEngine => 0.20,
            Outfit::Plain | Outfit::Drinks => 0.0,
        }
    }

    /// Surface of a strip of a car's skin that is not painted like the rest. `strip` counts from
    /// the floor; `is_side` is true between the axles.
    pub(super) fn livery(self, class: Class, strip: usize, is_side: bool) -> Option<Surface> {
        let rgb = match (self, strip) {
            (Outfit::Police, 2..=4) if is_side => [232, 232, 230],
            (Outfit::Ambulance, 3..=4) => [206, 38, 30],
            _ => return None,
        };
        Some(Surface::new(class, Material::Matte, rgb))
    }
}
