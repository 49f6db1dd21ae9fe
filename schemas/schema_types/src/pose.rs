//! A pose as plain bytes, and its conversion to nalgebra.

use bytemuck::{Pod, Zeroable};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use serde::{Deserialize, Serialize};

/// Rigid transform `target_from_source`: metres and a unit quaternion `[x, y, z, w]`. 56 bytes, no
/// padding.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable, Serialize, Deserialize)]
pub struct Pose {
    /// Position of the source's origin in the target, metres.
    pub translation_m: [f64; 3],
    /// Unit quaternion, `[x, y, z, w]`.
    pub rotation_xyzw: [f64; 4],
}
const _: () = assert!(size_of::<Pose>() == 56);

impl Pose {
    /// No displacement, no rotation.
    pub const IDENTITY: Pose = Pose {
        translation_m: [0.0; 3],
        rotation_xyzw: [0.0, 0.0, 0.0, 1.0],
    };

    /// Converts to nalgebra's type. The quaternion is not normalised, so a round trip keeps every
    /// bit.
    pub fn isometry(&self) -> Isometry3<f64> {
        let [x, y, z, w] = self.rotation_xyzw;
        Isometry3::from_parts(
            Translation3::from(self.translation_m),
            UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z)),
        )
    }

    /// A level pose at a position, with a heading about z in radians counter-clockwise from x.
    pub fn from_xyz_yaw(x_m: f64, y_m: f64, z_m: f64, yaw_rad: f64) -> Pose {
        Isometry3::new(
            nalgebra::Vector3::new(x_m, y_m, z_m),
            nalgebra::Vector3::z() * yaw_rad,
        )
        .into()
    }

    /// Heading about z, radians in (−π, π].
    pub fn yaw_rad(&self) -> f64 {
        self.isometry().rotation.euler_angles().2
    }
}

impl Default for Pose {
    fn default() -> Self {
        Pose::IDENTITY
    }
}

impl From<Isometry3<f64>> for Pose {
    fn from(iso: Isometry3<f64>) -> Self {
        let q = iso.rotation.quaternion();
        Pose {
            translation_m: iso.translation.vector.into(),
            rotation_xyzw: [q.i, q.j, q.k, q.w],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_trip_through_nalgebra_keeps_every_bit() {
        let pose = Pose::from_xyz_yaw(1.0e6 + 0.1, -3.3, 0.7, 2.1);
        assert_eq!(Pose::from(pose.isometry()), pose);
        assert!((pose.yaw_rad() - 2.1).abs() < 1e-12);
    }
}
