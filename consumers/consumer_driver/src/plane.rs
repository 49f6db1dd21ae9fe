//! Points of lanes and paths, their sides, and distances and angles in the plane.

/// A point of a lane or of a path.
#[derive(Clone, Copy, Debug)]
pub struct PathPoint {
    /// World position, metres.
    pub position_m: [f64; 2],
    /// World height, metres.
    pub height_m: f64,
    /// Direction, radians.
    pub heading_rad: f64,
    /// Curvature, 1/m, positive to the left.
    pub curvature_per_m: f64,
    /// Speed limit, m/s.
    pub limit_mps: f64,
    /// Speed that the bend allows, m/s.
    pub bend_mps: f64,
    /// Length of the path up to here, metres.
    pub arc_m: f64,
}

/// A side of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Side {
    /// To the left, in the direction of the path.
    Left,
    /// To the right.
    Right,
}

impl Side {
    /// 1 for left, −1 for right.
    pub fn sign(self) -> f64 {
        match self {
            Side::Left => 1.0,
            Side::Right => -1.0,
        }
    }
}

/// Distance in the plane.
pub fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    let d = [a[0] - b[0], a[1] - b[1]];
    (d[0] * d[0] + d[1] * d[1]).sqrt()
}

/// An angle in (−π, π].
pub fn wrap(angle_rad: f64) -> f64 {
    let turns = (angle_rad / std::f64::consts::TAU).round();
    angle_rad - turns * std::f64::consts::TAU
}
