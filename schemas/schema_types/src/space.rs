//! Coordinate systems. This page is the one place that defines them.
//!
//! ```text
//!   world, vehicle, sensor (right-handed, ISO 8855)      camera (right-handed)        image
//!
//!            z up                                             z forward               (0,0)──► u
//!            │   x forward                                   ╱                          │
//!            │  ╱                                           ●────► x right              ▼ v
//!   y left ◄─●                                              │
//!                                                           ▼ y down
//! ```
//!
//! - A transform is `target_from_source` and reads right to left.
//! - Rotations are unit quaternions stored `[x, y, z, w]`.
//! - Pixel (0, 0) begins at the outer corner of the top-left pixel, so that pixel's centre is (0.5,
//!   0.5) and cx = W/2. Formats that count from pixel centres (OpenCV, ROS, Foxglove's K) get cx −
//!   0.5, cy − 0.5.
//! - Depth is measured along the optical axis (`camera` z), not along the ray.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Rotation that takes a vector in `camera` to `sensor`: camera z is sensor x, camera x is sensor
/// −y, camera y is sensor −z.
pub fn sensor_from_camera() -> UnitQuaternion<f64> {
    let columns = Matrix3::from_columns(&[-Vector3::y(), -Vector3::z(), Vector3::x()]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(columns))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn camera_axes_land_where_the_drawing_says() {
        let q = sensor_from_camera();
        let close = |a: Vector3<f64>, b: Vector3<f64>| assert!((a - b).norm() < 1e-12, "{a} {b}");
        close(q * Vector3::z(), Vector3::x());
        close(q * Vector3::x(), -Vector3::y());
        close(q * Vector3::y(), -Vector3::z());
    }
}
