//! Poses that callers give, checked before they are used.

use schema_types::Pose;

/// The pose with a quaternion of unit length; one that already is keeps its bits.
pub(crate) fn unit_pose(pose: Pose, origin_m: [f64; 3]) -> Result<Pose, &'static str> {
    if !pose
        .translation_m
        .iter()
        .chain(&pose.rotation_xyzw)
        .all(|x| x.is_finite())
    {
        return Err("has a value that is not finite");
    }
    // Maps in national grids lie thousands of kilometres from zero, so the distance is measured
    // from the map's own origin.
    if pose
        .translation_m
        .iter()
        .zip(origin_m)
        .any(|(x, origin)| (x - origin).abs() > 1e5)
    {
        return Err("lies more than 100 km from the middle of the map");
    }
    let norm = pose.rotation_xyzw.iter().map(|x| x * x).sum::<f64>().sqrt();
    if !(0.5..=2.0).contains(&norm) {
        return Err("has a rotation that is not a unit quaternion");
    }
    if (norm - 1.0).abs() < 1e-12 {
        return Ok(pose);
    }
    Ok(Pose {
        rotation_xyzw: pose.rotation_xyzw.map(|x| x / norm),
        ..pose
    })
}
