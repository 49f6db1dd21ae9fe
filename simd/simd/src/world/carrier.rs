//! What the world knows of the actor that a sensor is attached to.

use nalgebra::{Point3, Vector3};
use schema_types::{ActorId, SimTime};
use sensor_core::imu::BodyState;
use simd_frames::carrier::Carrier;
use simd_world::World;

/// The carrier of a sensor; `None` if the sensor or the actor it is attached to has gone.
pub fn carrier_of(world: &World, sensor: ActorId, sim_time: SimTime) -> Option<Carrier> {
    let record = world.record(sensor)?;
    let body = if record.parent_id == 0 {
        record
    } else {
        world.record(ActorId(record.parent_id))?
    };
    let body_box = world
        .catalogue()
        .entries
        .get(body.catalogue_idx as usize)?
        .body_box;
    let world_from_vehicle = body.world_from_actor.isometry();
    let lower = |x: f64, y: f64| {
        let half = body_box.half_m.map(f64::from);
        let centre = body_box.centre_m.map(f64::from);
        let corner = Point3::new(
            centre[0] + x * half[0],
            centre[1] + y * half[1],
            centre[2] - half[2],
        );
        (world_from_vehicle * corner).coords.into()
    };
    Some(Carrier {
        parent: ActorId(record.parent_id),
        world_from_sensor: record.world_from_actor,
        velocity_in_world_mps: Vector3::from(record.velocity_in_world_mps),
        lower_corners: [
            lower(1.0, 1.0),
            lower(1.0, -1.0),
            lower(-1.0, -1.0),
            lower(-1.0, 1.0),
        ],
        body: BodyState {
            sim_time,
            world_from_vehicle,
            velocity_in_world_mps: Vector3::from(body.velocity_in_world_mps),
            angular_velocity_in_world_radps: Vector3::from(body.angular_velocity_in_world_radps),
        },
    })
}
