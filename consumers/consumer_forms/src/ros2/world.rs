//! The world, vehicles and boxes as messages of ROS 2.

use nalgebra::{UnitQuaternion, Vector3};
use schema_frames::{ActorRecord, VehiclePart};
use schema_types::Pose;
use schema_types::space::sensor_from_camera;

use super::cdr::Writer;
use super::sensors::{begin, header, time};

/// Fixed frame of the world.
pub const MAP: &str = "map";

fn vector<'a>(out: &'a mut Writer, vector: &Vector3<f64>) -> &'a mut Writer {
    out.f64s(vector.as_slice())
}

fn quaternion<'a>(out: &'a mut Writer, rotation: &UnitQuaternion<f64>) -> &'a mut Writer {
    let q = rotation.quaternion();
    out.f64s(&[q.i, q.j, q.k, q.w])
}

fn pose<'a>(out: &'a mut Writer, pose: &Pose) -> &'a mut Writer {
    out.f64s(&pose.translation_m).f64s(&pose.rotation_xyzw)
}

/// Writes `rosgraph_msgs/Clock`.
pub fn clock(out: &mut Writer, sim_nanos: u64) {
    time(out.start(), sim_nanos);
}

/// Writes `std_msgs/String`.
pub fn text(out: &mut Writer, text: &str) {
    out.start().text(text);
}

/// A transform between two frames.
#[derive(Clone, Debug)]
pub struct Transform {
    /// Frame whose coordinates come out.
    pub parent: String,
    /// Frame whose coordinates go in.
    pub child: String,
    /// The child's pose in its parent.
    pub parent_from_child: Pose,
}

/// Transform from a sensor's frame to the optical one of a camera.
pub fn optical() -> Pose {
    nalgebra::Isometry3::from_parts(Default::default(), sensor_from_camera()).into()
}

/// Writes `tf2_msgs/TFMessage`.
pub fn transforms(out: &mut Writer, sim_nanos: u64, transforms: &[Transform]) {
    out.start().u32(transforms.len() as u32);
    for it in transforms {
        header(out, sim_nanos, &it.parent).text(&it.child);
        pose(out, &it.parent_from_child);
    }
}

/// Writes `nav_msgs/Odometry` of an actor: its pose on the map, its velocities along its own axes.
pub fn odometry(out: &mut Writer, sim_nanos: u64, child: &str, actor: &ActorRecord) {
    let into_body = actor.world_from_actor.isometry().rotation.inverse();
    let own = |velocity: [f64; 3]| into_body * Vector3::from(velocity);
    begin(out, sim_nanos, MAP).text(child);
    pose(out, &actor.world_from_actor).f64s(&[0.0; 36]);
    vector(out, &own(actor.velocity_in_world_mps));
    vector(out, &own(actor.angular_velocity_in_world_radps)).f64s(&[0.0; 36]);
}

/// Writes `carla_msgs/CarlaEgoVehicleStatus`: accelerations along the vehicle's axes, the steering
/// with CARLA's sign, positive to the right.
pub fn vehicle_status(
    out: &mut Writer,
    sim_nanos: u64,
    frame_id: &str,
    actor: &ActorRecord,
    part: &VehiclePart,
) {
    let rotation = actor.world_from_actor.isometry().rotation;
    begin(out, sim_nanos, frame_id).f32(actor.speed_mps() as f32);
    let acceleration = Vector3::from(actor.acceleration_in_world_mps2);
    vector(out, &(rotation.inverse() * acceleration));
    vector(out, &Vector3::zeros());
    quaternion(out, &rotation);
    header(out, sim_nanos, frame_id)
        .f32(part.throttle_ratio)
        .f32(-part.steer_ratio)
        .f32(part.brake_ratio)
        .bool(part.control_flags & 1 != 0)
        .bool(part.control_flags & 2 != 0)
        .i32(part.gear)
        .bool(part.control_flags & 4 != 0);
}

/// An object as a box in an image, pixels from the outer corner of the first one.
#[derive(Clone, Debug)]
pub struct Detection2d {
    /// Name of its class.
    pub class: String,
    /// Confidence, 0 to 1.
    pub score: f32,
    /// Its number; 0 for none.
    pub id: u32,
    /// Top left corner.
    pub min_px: [f32; 2],
    /// Bottom right corner.
    pub max_px: [f32; 2],
}

/// Writes `vision_msgs/Detection2DArray`.
pub fn detections_2d(out: &mut Writer, sim_nanos: u64, frame_id: &str, found: &[Detection2d]) {
    begin(out, sim_nanos, frame_id).u32(found.len() as u32);
    for it in found {
        header(out, sim_nanos, frame_id);
        hypothesis(out, &it.class, it.score, &Pose::IDENTITY);
        let [min, max] = [it.min_px, it.max_px].map(|corner| corner.map(f64::from));
        // ROS 2 counts from the middle of the first pixel.
        out.f64s(&[
            (min[0] + max[0]) / 2.0 - 0.5,
            (min[1] + max[1]) / 2.0 - 0.5,
            0.0,
            max[0] - min[0],
            max[1] - min[1],
        ]);
        number(out, it.id);
    }
}

/// An object as a box in space.
#[derive(Clone, Debug)]
pub struct Detection3d {
    /// Name of its class.
    pub class: String,
    /// Confidence, 0 to 1.
    pub score: f32,
    /// Its number; 0 for none.
    pub id: u32,
    /// Middle and axes of the box.
    pub pose: Pose,
    /// Length, width and height, metres.
    pub size_m: [f64; 3],
}

/// Writes `vision_msgs/Detection3DArray`.
pub fn detections_3d(out: &mut Writer, sim_nanos: u64, frame_id: &str, found: &[Detection3d]) {
    begin(out, sim_nanos, frame_id).u32(found.len() as u32);
    for it in found {
        header(out, sim_nanos, frame_id);
        hypothesis(out, &it.class, it.score, &it.pose);
        pose(out, &it.pose).f64s(&it.size_m);
        number(out, it.id);
    }
}

/// One `vision_msgs/ObjectHypothesisWithPose`.
fn hypothesis(out: &mut Writer, class: &str, score: f32, at: &Pose) {
    out.u32(1).text(class).f64(score.into());
    pose(out, at).f64s(&[0.0; 36]);
}

/// Number of an object as text; empty if it has none.
fn number(out: &mut Writer, id: u32) {
    match id {
        0 => out.text(""),
        id => out.text(&id.to_string()),
    };
}
