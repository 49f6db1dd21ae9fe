//! The numbers that a vehicle is made from.

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
