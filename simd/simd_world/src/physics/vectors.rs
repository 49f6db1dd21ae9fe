//! Vectors between the engine's `f32` and the world's `f64`.

use nalgebra::Vector3;
use rapier3d::math::Vector;

/// `f32` engine vector as `f64`.
pub(crate) fn widen(v: Vector) -> Vector3<f64> {
    Vector3::new(v.x as f64, v.y as f64, v.z as f64)
}

/// `f64` vector as the engine's.
pub(crate) fn narrow(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x as f32, v.y as f32, v.z as f32)
}
