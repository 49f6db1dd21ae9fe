//! Numbers in the form of CARLA's texts about recordings.

pub const ROOM: &str = "a text always has room";

/// A place in centimetres.
pub fn centimetres(location_m: [f64; 3]) -> String {
    let [x, y, z] = location_m.map(|metres| (metres * 1e3).round() / 10.0 + 0.0);
    format!("({x}, {y}, {z})")
}

/// A rotation in Unreal's order: degrees about x, y, z.
pub fn turn(rotation_deg: [f64; 3]) -> String {
    let [pitch, yaw, roll] = rotation_deg.map(|degrees| (degrees * 1e4).round() / 1e4 + 0.0);
    format!("({roll}, {pitch}, {yaw})")
}

/// Rounds to a microsecond, which removes the noise of binary fractions.
pub fn round(secs: f64) -> f64 {
    (secs * 1e6).round() / 1e6
}
