//! The kinds of vehicle: measures, masses, engines, paints.
//!
//! Ids, half extents and types are CARLA 0.9.16's; masses, wheelbases and engines are our own,
//! chosen to suit the kind of vehicle.

use schema_frames::document::BodyBox;
use schema_types::Class;
use simd_body::{BodyStyle, Outfit, VehicleShape};

use super::engine_spec::EngineSpec;

/// One kind of vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleModel {
    /// Catalogue id.
    pub type_id: &'static str,
    /// Body style.
    pub style: BodyStyle,
    /// Semantic class.
    pub class: Class,
    /// CARLA's `base_type`.
    pub base_type: &'static str,
    /// CARLA's `special_type`.
    pub special_type: &'static str,
    /// CARLA's `generation`.
    pub generation: u8,
    /// Half length, width, height of the body box with mirrors, metres; the box stands on the
    /// ground about the origin.
    pub half_m: [f64; 3],
    /// Number of axles: 2, or 3 for a lorry with a pair of rear axles.
    pub n_axles: usize,
    /// Distance between the front axle and the rear one, or the middle of the rear pair, metres.
    pub wheelbase_m: f64,
    /// Radius of the wheels, metres.
    pub wheel_radius_m: f64,
    /// Mass, kg.
    pub mass_kg: f64,
    /// Drag coefficient times frontal area, m².
    pub drag_area_m2: f64,
    /// Engine and gearbox.
    pub engine: EngineSpec,
    /// Whether the front wheels are driven.
    pub front_driven: bool,
    /// Whether the rear wheels are driven.
    pub rear_driven: bool,
    /// Paints, sRGB; the first is the default.
    pub colors: &'static [[u8; 3]],
}

impl VehicleModel {
    /// Number of visible wheels.
    pub fn n_wheels(&self) -> usize {
        match self.is_two_wheeler() {
            true => 2,
            false => 2 * self.n_axles,
        }
    }

    /// Motorcycle or bicycle.
    pub fn is_two_wheeler(&self) -> bool {
        matches!(self.style, BodyStyle::Motorcycle | BodyStyle::Bicycle)
    }

    /// Largest mean steering angle of the front wheels, radians: 70° for cars, as in CARLA, because
    /// its controllers rely on it.
    pub fn max_steer_rad(&self) -> f64 {
        let degrees: f64 = match self.style {
            BodyStyle::Bus | BodyStyle::Lorry => 60.0,
            BodyStyle::Motorcycle | BodyStyle::Bicycle => 45.0,
            _ => 70.0,
        };
        degrees.to_radians()
    }

    /// Height of the centre of mass above the ground, metres.
    pub fn mass_height_m(&self) -> f64 {
        match self.style {
            BodyStyle::Motorcycle => 0.50,
            BodyStyle::Bicycle => 0.45,
            _ => (0.58 * self.half_m[2]).min(1.1),
        }
    }

    /// Share of the mass on the front axle.
    pub fn front_load_ratio(&self) -> f64 {
        match self.style {
            BodyStyle::Bus | BodyStyle::Lorry => 0.45,
            BodyStyle::Motorcycle | BodyStyle::Bicycle => 0.5,
            _ => 0.53,
        }
    }

    /// Half extents of the body without mirrors, metres. CARLA's boxes of buses and lorries include
    /// the mirrors, but lanes only allow a width of 2.6 m.
    pub fn solid_half_m(&self) -> [f64; 3] {
        [self.half_m[0], self.half_m[1].min(1.3), self.half_m[2]]
    }

    /// The shape from which its meshes are made.
    pub fn shape(&self) -> VehicleShape {
        let half_m = self.solid_half_m();
        VehicleShape {
            style: self.style,
            half_m,
            wheel_radius_m: self.wheel_radius_m,
            wheelbase_m: self.wheelbase_m,
        }
    }

    /// What it carries and how it is painted.
    pub fn outfit(&self) -> Outfit {
        match (self.special_type, self.style) {
            ("emergency", BodyStyle::Lorry) => Outfit::FireEngine,
            ("emergency", BodyStyle::Van) => Outfit::Ambulance,
            ("emergency", _) => Outfit::Police,
            ("taxi", _) => Outfit::Taxi,
            _ if self.type_id == "vehicle.carlamotors.carlacola" => Outfit::Drinks,
            _ => Outfit::Plain,
        }
    }

    /// Whether its doors can open: those of cars and vans of the second generation can, as in
    /// CARLA.
    pub fn has_dynamic_doors(&self) -> bool {
        use BodyStyle::{Hatch, Microbus, Saloon, Suv, Van};
        self.generation == 2 && matches!(self.style, Saloon | Hatch | Suv | Van | Microbus)
    }

    pub(crate) fn body_box(&self) -> BodyBox {
        BodyBox {
            centre_m: [0.0, 0.0, self.half_m[2] as f32],
            half_m: self.half_m.map(|x| x as f32),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicles::model_list::MODELS;

    #[test]
    fn wheels_lie_within_the_body() {
        for model in MODELS {
            assert!(
                0.5 * model.wheelbase_m + 0.3 * model.wheel_radius_m < model.half_m[0],
                "{}",
                model.type_id
            );
        }
    }

    #[test]
    fn every_style_is_there() {
        use BodyStyle::*;
        for style in [
            Saloon, Hatch, Suv, Van, Microbus, Wedge, Bus, Lorry, Motorcycle, Bicycle,
        ] {
            assert!(MODELS.iter().any(|model| model.style == style), "{style:?}");
        }
    }

    /// The body's mesh has the class that the record states.
    #[test]
    fn meshes_are_of_the_models_class() {
        for model in MODELS {
            let meshes = simd_body::vehicle_meshes(&model.shape());
            assert!(
                meshes
                    .body
                    .vertices
                    .iter()
                    .any(|vertex| vertex.class == model.class.0),
                "{}",
                model.type_id
            );
        }
    }
}
