//! Poses of cameras as text: TUM's trajectory lines, and matrices for JSON and YAML.

use nalgebra::Isometry3;
use schema_frames::FrameHeader;
use schema_types::space::sensor_from_camera;

/// First line of a trajectory.
pub const HEAD: &str = "# time_s tx ty tz qx qy qz qw: optical axes (x right, y down, z forward) in the map (x east, y north, z up), metres";

/// Pose of a camera's optical axes in the world.
pub fn world_from_camera(header: &FrameHeader) -> Isometry3<f64> {
    header.world_from_sensor.isometry() * sensor_from_camera()
}

/// A frame's line: simulated time and pose of the optical axes.
pub fn line(header: &FrameHeader) -> String {
    let pose = world_from_camera(header);
    let (t, q) = (pose.translation, pose.rotation);
    // A rotation has two quaternions; the one with w ≥ 0 is written.
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    format!(
        "{}.{:06} {:.6} {:.6} {:.6} {:.9} {:.9} {:.9} {:.9}",
        header.sim_nanos / 1_000_000_000,
        header.sim_nanos % 1_000_000_000 / 1000,
        t.x,
        t.y,
        t.z,
        sign * q.i,
        sign * q.j,
        sign * q.k,
        sign * q.w
    )
}

/// The rows of a pose as a 4×4 matrix.
pub fn matrix(pose: &Isometry3<f64>) -> [[f64; 4]; 4] {
    let matrix = pose.to_homogeneous();
    std::array::from_fn(|row| std::array::from_fn(|column| matrix[(row, column)]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use schema_frames::Modality;

    #[test]
    fn a_line_has_the_time_in_microseconds_and_the_optical_axes() {
        let mut header = FrameHeader::new(Modality::Dvs);
        header.sim_nanos = 12_050_001_999;
        header.world_from_sensor.translation_m = [1.0, 2.0, 3.0];
        header.world_from_sensor.rotation_xyzw = [0.0, 0.0, 0.0, 1.0];
        assert_eq!(
            line(&header),
            "12.050001 1.000000 2.000000 3.000000 -0.500000000 0.500000000 -0.500000000 0.500000000"
        );
        let rows = matrix(&world_from_camera(&header));
        assert_eq!(rows[3], [0.0, 0.0, 0.0, 1.0]);
        assert!((rows[0][2] - 1.0).abs() < 1e-12, "optical z is sensor x");
    }
}
