//! Lays a trajectory on another.

use nalgebra::{Isometry3, Matrix3, Matrix4, Quaternion, Translation3, UnitQuaternion, Vector3};

use super::settings::Alignment;

/// The results laid on the truths, and the scale that was applied.
pub(super) fn laid_on(
    truths: &[Isometry3<f64>],
    results: &[Isometry3<f64>],
    alignment: Alignment,
) -> (Vec<Isometry3<f64>>, f64) {
    let (motion, scale) = match alignment {
        Alignment::None => (Isometry3::identity(), 1.0),
        Alignment::Origin => match (truths.first(), results.first()) {
            (Some(truth), Some(result)) => (truth * result.inverse(), 1.0),
            _ => (Isometry3::identity(), 1.0),
        },
        Alignment::Rigid => least_squares(truths, results, false),
        Alignment::Scaled => least_squares(truths, results, true),
    };
    let lay = |result: &Isometry3<f64>| {
        let scaled = Translation3::from(result.translation.vector * scale);
        motion * Isometry3::from_parts(scaled, result.rotation)
    };
    (results.iter().map(lay).collect(), scale)
}

/// The motion (and scale) with the least squared distances, found through quaternions (Horn, 1987),
/// which gives what Umeyama's decomposition gives. Where the poses leave a turn open (all on one
/// line, or at one place), any of the best ones is taken.
fn least_squares(
    truths: &[Isometry3<f64>],
    results: &[Isometry3<f64>],
    with_scale: bool,
) -> (Isometry3<f64>, f64) {
    let n = truths.len().max(1) as f64;
    let middle = |poses: &[Isometry3<f64>]| {
        let sum: Vector3<f64> = poses.iter().map(|pose| pose.translation.vector).sum();
        sum / n
    };
    let (truth_middle, result_middle) = (middle(truths), middle(results));
    let mut products = Matrix3::zeros();
    let mut variance = 0.0;
    for (truth, result) in truths.iter().zip(results) {
        let from = result.translation.vector - result_middle;
        products += from * (truth.translation.vector - truth_middle).transpose() / n;
        variance += from.norm_squared() / n;
    }
    let sum = products + products.transpose();
    let difference = products - products.transpose();
    let turning = Vector3::new(difference[(1, 2)], difference[(2, 0)], difference[(0, 1)]);
    let mut form = Matrix4::zeros();
    form[(0, 0)] = products.trace();
    form.fixed_view_mut::<3, 1>(1, 0).copy_from(&turning);
    form.fixed_view_mut::<1, 3>(0, 1)
        .copy_from(&turning.transpose());
    form.fixed_view_mut::<3, 3>(1, 1)
        .copy_from(&(sum - Matrix3::identity() * products.trace()));
    let eigen = form.symmetric_eigen();
    let best = eigen.eigenvalues.imax();
    let axis = eigen.eigenvectors.column(best);
    let turn = UnitQuaternion::from_quaternion(Quaternion::new(axis[0], axis[1], axis[2], axis[3]));
    let scale = if with_scale && variance > 0.0 {
        eigen.eigenvalues[best] / variance
    } else {
        1.0
    };
    let shift = Translation3::from(truth_middle - turn * result_middle * scale);
    (Isometry3::from_parts(shift, turn), scale)
}
