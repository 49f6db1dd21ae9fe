//! What the builders of all bodies share: measures of the skin, and its surfaces.

use schema_types::Class;
use sensor_core::Material;
use sensor_core::mesh::Surface;

use super::outfit::Outfit;
use super::shape::{BodyStyle, VehicleShape};

/// Measures and surfaces that the builders of one vehicle share.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bodywork {
    pub class: Class,
    pub outfit: Outfit,
    pub half: [f32; 3],
    /// Half width without mirrors.
    pub half_width_m: f32,
    /// Height of the floor.
    pub sill_m: f32,
    pub wheel_radius_m: f32,
    pub wheelbase_m: f32,
}

impl Bodywork {
    pub fn new(shape: &VehicleShape, outfit: Outfit) -> Bodywork {
        let half = shape.half_m.map(|x| x as f32);
        let two_wheels = matches!(shape.style, BodyStyle::Motorcycle | BodyStyle::Bicycle);
        Bodywork {
            class: class_of(shape.style),
            outfit,
            half,
            half_width_m: if two_wheels {
                half[1]
            } else {
                (half[1] - 0.09).min(1.275)
            },
            sill_m: 0.62 * shape.wheel_radius_m as f32,
            wheel_radius_m: shape.wheel_radius_m as f32,
            wheelbase_m: shape.wheelbase_m as f32,
        }
    }

    /// Height of the roof.
    pub fn height(&self) -> f32 {
        2.0 * self.half[2] - self.outfit.roof_m()
    }

    /// Half length of the skin. Lamps and plates stand out of it as far as the box.
    pub fn skin_m(&self) -> f32 {
        self.half[0] - 0.03
    }

    /// x of the place `u` on the skin, 0 at the front and 1 at the rear.
    pub fn x(&self, u: f32) -> f32 {
        self.skin_m() * (1.0 - 2.0 * u)
    }

    pub fn arch_radius_m(&self) -> f32 {
        self.wheel_radius_m * 1.16
    }

    /// Places at multiples of the wheel arch's radius before and behind both axles.
    pub fn arch_places(&self, shares: &[f32]) -> Vec<f32> {
        let reach = self.arch_radius_m();
        let place = |x: f32| 0.5 * (1.0 - x / self.skin_m());
        let mut places = Vec::new();
        for axle in [0.5 * self.wheelbase_m, -0.5 * self.wheelbase_m] {
            places.extend(shares.iter().map(|share| place(axle - share * reach)));
        }
        places.retain(|u| (0.004..0.996).contains(u));
        places
    }

    /// Height of the lower edge inside a wheel arch at the place `u`.
    pub fn arch(&self, u: f32, detail: usize) -> Option<f32> {
        if detail >= 2 {
            return None;
        }
        let (x, reach) = (self.x(u), self.arch_radius_m());
        let away = (x.abs() - 0.5 * self.wheelbase_m).abs() / reach;
        (away < 0.985).then(|| self.wheel_radius_m + reach * (1.0 - away * away).sqrt())
    }

    pub fn paint(&self) -> Surface {
        Surface::new(self.class, Material::CarPaint, [255, 255, 255])
    }

    pub fn glass(&self) -> Surface {
        Surface::new(self.class, Material::Glass, [28, 34, 40])
    }

    pub fn dark(&self) -> Surface {
        Surface::new(self.class, Material::Rubber, [22, 22, 24])
    }

    pub fn trim(&self) -> Surface {
        Surface::new(self.class, Material::Rubber, [40, 41, 44])
    }

    pub fn lamp(&self, rgb: [u8; 3], bit: u8) -> Surface {
        Surface::lamp(self.class, rgb, bit)
    }
}

/// Class of a car body.
fn class_of(style: BodyStyle) -> Class {
    match style {
        BodyStyle::Bus => Class::BUS,
        BodyStyle::Lorry | BodyStyle::Wedge => Class::TRUCK,
        BodyStyle::Motorcycle => Class::MOTORCYCLE,
        BodyStyle::Bicycle => Class::BICYCLE,
        _ => Class::CAR,
    }
}
