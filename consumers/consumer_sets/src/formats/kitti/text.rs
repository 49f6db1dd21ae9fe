//! KITTI's calibration files and lines of motion.

use nalgebra::{Isometry3, Matrix4};
use schema_frames::Modality;

use crate::formats::family::{Motion, matrix, numbers, projection, row34, world_from_carrier};
use consumer_truth::scenario::{Scenario, Sensor};
use consumer_truth::ticks::World;

/// Matrices of a rig.
#[derive(Clone, Debug)]
pub struct Calibration {
    projections: [Matrix4<f64>; 4],
    camera_from_velo: Isometry3<f64>,
    velo_from_imu: Isometry3<f64>,
}

impl Calibration {
    /// Of a camera or a pair. Without a lidar the carrier's own axes stand in for the Velodyne's,
    /// and without an IMU for the IMU's.
    pub fn of(scenario: &Scenario, cameras: &[&Sensor], lidar: Option<&Sensor>) -> Calibration {
        let carrier_from_first = cameras[0].carrier_from_camera();
        let of = |camera: &Sensor| {
            let first_from_it = carrier_from_first.inverse() * camera.carrier_from_camera();
            // The pair's axes are parallel; what rounding says otherwise is left out.
            projection(camera, &Isometry3::from(first_from_it.translation))
        };
        let first = of(cameras[0]);
        let second = cameras.get(1).map_or(first, |camera| of(camera));
        let carrier_from_velo =
            lidar.map_or_else(Isometry3::identity, |lidar| lidar.carrier_from_sensor);
        let imu = scenario.with(Modality::Imu).next();
        let carrier_from_imu = imu.map_or_else(Isometry3::identity, |imu| imu.carrier_from_sensor);
        Calibration {
            projections: [first, second, first, second],
            camera_from_velo: carrier_from_first.inverse() * carrier_from_velo,
            velo_from_imu: carrier_from_velo.inverse() * carrier_from_imu,
        }
    }

    fn lines(&self, names: [&str; 3]) -> String {
        let mut text = String::new();
        for (number, projection) in self.projections.iter().enumerate() {
            text += &format!("P{number}: {}\n", row34(projection));
        }
        let level = numbers([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        text += &format!("{} {level}\n", names[0]);
        text += &format!("{} {}\n", names[1], row34(&matrix(&self.camera_from_velo)));
        text += &format!("{} {}\n", names[2], row34(&matrix(&self.velo_from_imu)));
        text
    }

    /// A file of `object/training/calib`.
    pub fn object(&self) -> String {
        self.lines(["R0_rect:", "Tr_velo_to_cam:", "Tr_imu_to_velo:"])
    }

    /// A file of `tracking/training/calib`, whose last three keys have no colon.
    pub fn tracking(&self) -> String {
        self.lines(["R_rect", "Tr_velo_cam", "Tr_imu_velo"])
    }
}

/// A line of 30 numbers as KITTI's OXTS unit writes it. Place from GNSS, accelerations and rates from
/// the IMU, attitude and velocity from the snapshot; accuracies are 0. Forward, left and up are
/// level axes, x, y and z the vehicle's own.
pub fn oxts(scenario: &Scenario, world: &World, motion: &Motion) -> String {
    let world_from_carrier = world_from_carrier(scenario, world);
    let (roll, pitch, yaw) = world_from_carrier.rotation.euler_angles();
    let velocity = world
        .record(scenario.carrier_id)
        .map_or([0.0; 3], |r| r.velocity_in_world_mps);
    let level_from_carrier =
        nalgebra::UnitQuaternion::from_euler_angles(0.0, 0.0, -yaw) * world_from_carrier.rotation;
    let level_from_world = level_from_carrier * world_from_carrier.rotation.inverse();
    let own = level_from_world * nalgebra::Vector3::from(velocity);
    let fix = motion.gnss.unwrap_or(bytemuck::Zeroable::zeroed());
    let imu = motion.imu.unwrap_or(bytemuck::Zeroable::zeroed());
    let force = nalgebra::Vector3::from(imu.specific_force_mps2);
    let rates = nalgebra::Vector3::from(imu.angular_velocity_radps);
    let (level_force, level_rates) = (level_from_carrier * force, level_from_carrier * rates);
    // World +y is north and +x is east; positive pitch is nose down, for KITTI as for us.
    let mut values = vec![fix.latitude_deg, fix.longitude_deg, fix.altitude_m];
    values.extend([roll, pitch, yaw, velocity[1], velocity[0]]);
    for vector in [own, force, level_force, rates, level_rates] {
        values.extend(vector.iter());
    }
    // Accuracies of place and velocity.
    values.extend([0.0, 0.0]);
    format!("{} 4 10 4 4 0\n", numbers(values))
}
