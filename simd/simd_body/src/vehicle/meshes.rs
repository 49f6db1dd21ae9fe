//! All meshes of a vehicle: its body in levels of detail, its wheel, and where wheels sit.

use sensor_core::{Mesh, MeshBuilder};

use super::bodywork::Bodywork;
use super::outfit::Outfit;
use super::shape::{BodyStyle, VehicleShape};
use super::{car, heavy, two_wheeler, wheel};

/// Where a wheel sits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WheelSite {
    /// Centre, vehicle space, metres.
    pub centre_m: [f64; 3],
    /// Radius, metres.
    pub radius_m: f64,
    /// Whether it turns with the steering.
    pub steered: bool,
    /// Whether it is on the left. There the wheel mesh is turned by half a turn about z so that its
    /// rim looks outwards.
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

/// Builds the meshes for a shape. Body and wheels together fit its box to 1 cm. `CarPaint` is
/// white: the instance's tint colours it.
pub fn vehicle_meshes(shape: &VehicleShape) -> VehicleMeshes {
    outfitted_meshes(shape, Outfit::Plain)
}

/// As without an outfit, with equipment and livery added.
pub fn outfitted_meshes(shape: &VehicleShape, outfit: Outfit) -> VehicleMeshes {
    let body = Bodywork::new(shape, outfit);
    let mut builder = MeshBuilder::new(format!("{:?} body", shape.style).to_lowercase());
    for (detail, until_m) in LEVELS_M.into_iter().enumerate() {
        match shape.style {
            BodyStyle::Bus => heavy::bus(&mut builder, &body, detail),
            BodyStyle::Lorry => heavy::lorry(&mut builder, &body, detail),
            BodyStyle::Motorcycle | BodyStyle::Bicycle => {
                two_wheeler::body(&mut builder, &body, shape.style, detail.min(2))
            }
            _ => car::body(&mut builder, &body, shape.style, detail),
        }
        builder.end_level(until_m);
    }
    let (width_m, spokes) = tyre(shape.style);
    VehicleMeshes {
        body: builder.finish(),
        wheel: wheel::wheel(body.class, body.wheel_radius_m, width_m, spokes),
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
    let aside = f64::from(
        Bodywork::new(shape, Outfit::Plain).half_width_m - 0.5 * tyre(shape.style).0 - 0.012,
    );
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
