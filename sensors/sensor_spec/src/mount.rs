//! Where a sensor sits on its carrier.

use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use schema_types::Pose;
use serde::{Deserialize, Serialize};

use crate::check::{SpecError, check_range};

pub use schema_frames::Attachment;

/// Pose on the vehicle: x forward, y left, z up; roll, then pitch, then yaw, degrees in files.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MountSpec {
    /// Metres.
    pub position_m: [f64; 3],
    /// Roll, pitch, yaw about x, y, z of the vehicle, degrees; positive pitch looks down, positive
    /// yaw turns left.
    pub rpy_deg: [f64; 3],
    /// How it follows its carrier.
    pub attachment: Attachment,
}

impl MountSpec {
    /// The mount as a transform.
    pub fn vehicle_from_sensor(&self) -> Isometry3<f64> {
        let [roll, pitch, yaw] = self.rpy_deg.map(f64::to_radians);
        Isometry3::from_parts(
            Translation3::from(self.position_m),
            UnitQuaternion::from_euler_angles(roll, pitch, yaw),
        )
    }

    /// The mount as a pose of plain numbers.
    pub fn pose(&self) -> Pose {
        self.vehicle_from_sensor().into()
    }

    pub(crate) fn check(&self, errors: &mut Vec<SpecError>) {
        for value in self.position_m {
            check_range("mount.position_m", value, -100.0, 100.0, errors);
        }
        for value in self.rpy_deg {
            check_range("mount.rpy_deg", value, -360.0, 360.0, errors);
        }
    }
}
