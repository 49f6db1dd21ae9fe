//! The world as sensors see it.

use nalgebra::Vector3;
use schema_types::{ActorId, SimTime};
use sensor_core::imu::BodyState;
use simd_world::World;

use crate::frames::Carrier;

/// Pose of a sensor and the state of the body it sits on; `None` if the sensor or its parent is gone.
pub fn carrier(world: &World, sensor: ActorId, sim_time: SimTime) -> Option<Carrier> {
    let record = world.record(sensor)?;
    let body = if record.parent_id == 0 { record } else { world.record(ActorId(record.parent_id))? };
    Some(Carrier {
        parent: ActorId(record.parent_id),
        world_from_sensor: record.world_from_actor,
        body: BodyState {
            sim_time,
            world_from_vehicle: body.world_from_actor.isometry(),
            velocity_in_world_mps: Vector3::from(body.velocity_in_world_mps),
            angular_velocity_in_world_radps: Vector3::from(body.angular_velocity_in_world_radps),
        },
    })
}
