//! Vehicle bodies made from a few numbers.

use schema_types::Class;
use sensor_core::mesh::Surface;
use sensor_core::{Material, Mesh, MeshBuilder};

mod car;
pub mod door;
mod heavy;
pub(crate) mod loft;
mod microbus;
pub mod outfit;
mod tables;
mod two_wheeler;
mod wheel;

use outfit::Outfit;

/// Kind of body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BodyStyle {
    /// Three boxes.
    Saloon,
    /// Two boxes, steep tail.
    Hatch,
    /// Two high boxes.
    Suv,
    /// One box with a short bonnet.
    Van,
    /// One box without a bonnet: windows all round over a painted lower half.
    Microbus,
    /// Pick-up of flat plates: one straight line from the nose to the top, another to the tail.
    Wedge,
    /// City bus.
    Bus,
    /// Cab and cargo box.
    Lorry,
    /// Motorcycle with rider.
    Motorcycle,
    /// Bicycle with rider.
    Bicycle,
}

/// Measures of a vehicle. Its origin is on the ground midway between the axles; x forward, y left,
/// z up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleShape {
    /// Kind of body.
    pub style: BodyStyle,
    /// Half length, half width, half height, metres; the box stands on the ground.
    pub half_m: [f64; 3],
    /// Radius of the wheels, metres.
    pub wheel_radius_m: f64,
    /// Distance between the axles, metres.
    pub wheelbase_m: f64,
}

/// Where a wheel sits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WheelSite {
    /// Centre, vehicle space, metres.
    pub centre_m: [f64; 3],
    /// Radius, metres.
    pub radius_m: f64,
    /// Turns with the steering.
    pub steered: bool,
    /// On the left: the wheel mesh is turned by half a turn about z so that its rim looks outwards.
    pub left: bool,
}

/// Meshes of a vehicle.
#[derive(Clone, Debug)]
pub struct VehicleMeshes {
    /// Everything but the wheels, vehicle space. The box is centred on the origin in x and y.
    pub body: Mesh,
    /// A wheel about its own centre, axle along y, outer side towards −y.
    pub wheel: Mesh,
    /// One per wheel: front left, front right, rear left, rear right (motorcycle: front, rear).
    pub wheels: Vec<WheelSite>,
}

/// Distances up to which the levels of a body are drawn, metres.
const LEVELS_M: [f32; 4] = [16.0, 45.0, 90.0, f32::INFINITY];

/// What the builders of bodies share.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    class: Class,
    outfit: Outfit,
    half: [f32; 3],
    /// Half width without mirrors.
    body_half_m: f32,
    /// Height of the floor.
    sill_m: f32,
    wheel_radius_m: f32,
    wheelbase_m: f32,
}

impl Frame {
    fn new(shape: &VehicleShape, outfit: Outfit) -> Frame {
        let half = shape.half_m.map(|x| x as f32);
        let two_wheels = matches!(shape.style, BodyStyle::Motorcycle | BodyStyle::Bicycle);
        Frame {
            class: car::class_of(shape.style),
            outfit,
            half,
            body_half_m: if two_wheels {
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
    fn height(&self) -> f32 {
        2.0 * self.half[2] - self.outfit.roof_m()
    }

    /// Half length of the skin: lamps and plates stand out of it up to the box.
    fn skin_m(&self) -> f32 {
        self.half[0] - 0.03
    }

    /// x of the place `u` on the skin, 0 at the front and 1 at the rear.
    fn x(&self, u: f32) -> f32 {
        self.skin_m() * (1.0 - 2.0 * u)
    }

    fn arch_radius_m(&self) -> f32 {
        self.wheel_radius_m * 1.16
    }

    /// Places at these shares of the arch's radius about both axles.
    fn arch_places(&self, shares: &[f32]) -> Vec<f32> {
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
    fn arch(&self, u: f32, detail: usize) -> Option<f32> {
        if detail >= 2 {
            return None;
        }
        let (x, reach) = (self.x(u), self.arch_radius_m());
        let away = (x.abs() - 0.5 * self.wheelbase_m).abs() / reach;
        (away < 0.985).then(|| self.wheel_radius_m + reach * (1.0 - away * away).sqrt())
    }

    fn paint(&self) -> Surface {
        Surface::new(self.class, Material::CarPaint, [255, 255, 255])
    }

    fn glass(&self) -> Surface {
        Surface::new(self.class, Material::Glass, [28, 34, 40])
    }

    fn dark(&self) -> Surface {
        Surface::new(self.class, Material::Rubber, [22, 22, 24])
    }

    fn trim(&self) -> Surface {
        Surface::new(self.class, Material::Rubber, [40, 41, 44])
    }

    fn lamp(&self, rgb: [u8; 3], bit: u8) -> Surface {
        Surface::lamp(self.class, rgb, bit)
    }
}

/// Builds the meshes for a shape. Body and wheels together fit its box to 1 cm. `CarPaint` is
/// white: the instance's tint colours it.
pub fn vehicle_meshes(shape: &VehicleShape) -> VehicleMeshes {
    outfitted_meshes(shape, Outfit::Plain)
}

/// The same with equipment and livery.
pub fn outfitted_meshes(shape: &VehicleShape, outfit: Outfit) -> VehicleMeshes {
    let frame = Frame::new(shape, outfit);
    let mut builder = MeshBuilder::new(format!("{:?} body", shape.style).to_lowercase());
    for (detail, until_m) in LEVELS_M.into_iter().enumerate() {
        match shape.style {
            BodyStyle::Bus => heavy::bus(&mut builder, &frame, detail),
            BodyStyle::Lorry => heavy::lorry(&mut builder, &frame, detail),
            BodyStyle::Motorcycle | BodyStyle::Bicycle => {
                two_wheeler::body(&mut builder, &frame, shape.style, detail.min(2))
            }
            _ => car::body(&mut builder, &frame, shape.style, detail),
        }
        builder.end_level(until_m);
    }
    let (width_m, spokes) = tyre(shape.style);
    VehicleMeshes {
        body: builder.finish(),
        wheel: wheel::wheel(frame.class, frame.wheel_radius_m, width_m, spokes),
        wheels: wheel_sites(shape),
    }
}

/// Width of the tyre and number of spokes.
fn tyre(style: BodyStyle) -> (f32, usize) {
    match style {
        BodyStyle::Bus | BodyStyle::Lorry => (0.30, 8),
        BodyStyle::Motorcycle => (0.14, 6),
        BodyStyle::Bicycle => (0.045, 12),
        BodyStyle::Suv | BodyStyle::Van | BodyStyle::Wedge => (0.24, 6),
        BodyStyle::Microbus => (0.19, 0),
        _ => (0.215, 5),
    }
}

fn wheel_sites(shape: &VehicleShape) -> Vec<WheelSite> {
    let axle = 0.5 * shape.wheelbase_m;
    let radius_m = shape.wheel_radius_m;
    let axles = [(axle, true), (-axle, false)];
    if matches!(shape.style, BodyStyle::Motorcycle | BodyStyle::Bicycle) {
        return axles
            .map(|(x, steered)| WheelSite {
                centre_m: [x, 0.0, radius_m],
                radius_m,
                steered,
                left: false,
            })
            .to_vec();
    }
    let aside =
        f64::from(Frame::new(shape, Outfit::Plain).body_half_m - 0.5 * tyre(shape.style).0 - 0.012);
    axles
        .iter()
        .flat_map(|&(x, steered)| {
            [(aside, true), (-aside, false)].map(|(y, left)| WheelSite {
                centre_m: [x, y, radius_m],
                radius_m,
                steered,
                left,
            })
        })
        .collect()
}
