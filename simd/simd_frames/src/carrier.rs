//! The actor a sensor is attached to, as the sensor's model sees it in one tick.

use nalgebra::{Isometry3, Vector3};
use schema_types::{ActorId, Pose, SimTime};
use sensor_core::imu::BodyState;
use sensor_core::lane_marks::Corners;

/// State of a sensor's actor, and of the body that carries it, in one tick.
#[derive(Clone, Copy, Debug)]
pub struct Carrier {
    /// Actor that the sensor is attached to; 0 if there is none.
    pub parent: ActorId,
    /// Pose of the sensor in the world, exactly as in the snapshot.
    pub world_from_sensor: Pose,
    /// Velocity of the sensor's own point, m/s.
    pub velocity_in_world_mps: Vector3<f64>,
    /// State of the body that carries it; its own without one.
    pub body: BodyState,
    /// Lower corners of the body's box in the world: front left, front right, rear right, rear left.
    pub lower_corners: Corners,
}

impl Carrier {
    /// Where the sensor sits on the body that carries it.
    pub fn mount(&self) -> Isometry3<f64> {
        let world_from_vehicle = &self.body.world_from_vehicle;
        world_from_vehicle.inv_mul(&self.world_from_sensor.isometry())
    }

    /// What a camera needs to know: where it is, and what it is mounted on.
    pub fn of_camera(parent: ActorId, world_from_sensor: Pose, sim_time: SimTime) -> Carrier {
        Carrier {
            parent,
            world_from_sensor,
            velocity_in_world_mps: Vector3::zeros(),
            body: BodyState {
                sim_time,
                world_from_vehicle: world_from_sensor.isometry(),
                velocity_in_world_mps: Vector3::zeros(),
                angular_velocity_in_world_radps: Vector3::zeros(),
            },
            lower_corners: Corners::default(),
        }
    }
}
