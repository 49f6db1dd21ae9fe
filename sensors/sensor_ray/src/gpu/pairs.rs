//! Numbers and poses for the shader, each as the sum of two `f32`.

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

/// A number as the sum of two `f32`.
pub(super) fn pair(x: f64) -> [f32; 2] {
    let high = x as f32;
    [high, (x - high as f64) as f32]
}

pub(super) fn pair_of_pairs((cos, sin): &(f64, f64)) -> [f32; 4] {
    let ([a, b], [c, d]) = (pair(*cos), pair(*sin));
    [a, b, c, d]
}

/// Rows of a rotation with a translation in w: first the high parts, then the low parts.
pub(super) fn rows(turn: &Matrix3<f64>, shift: &Vector3<f64>) -> [[f32; 4]; 6] {
    let mut rows = [[0.0; 4]; 6];
    for i in 0..3 {
        for (j, x) in [turn[(i, 0)], turn[(i, 1)], turn[(i, 2)], shift[i]]
            .into_iter()
            .enumerate()
        {
            [rows[i][j], rows[i + 3][j]] = pair(x);
        }
    }
    rows
}

/// The rows of a pose: rotation, and translation in w.
pub(super) fn rows_of(pose: &Isometry3<f64>) -> [[f32; 4]; 6] {
    rows(
        pose.rotation.to_rotation_matrix().matrix(),
        &pose.translation.vector,
    )
}

/// The pose that shifts a point to the origin.
pub(super) fn shift_from(origin_m: &Point3<f64>) -> Isometry3<f64> {
    Isometry3::translation(-origin_m.x, -origin_m.y, -origin_m.z)
}
