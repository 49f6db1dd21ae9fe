//! Frames, results and vehicles as messages of ROS 2, in the axes of REP 103 and 105: x forward, y
//! left, z up; cameras have a second frame, `…_optical`, with z forward, x right, y down.

use nalgebra::{UnitQuaternion, Vector3};
use schema_frames::{
    ActorRecord, Box2d, Box3d, FrameHeader, GnssSample, ImuSample, Modality, RadarDetection,
    VehiclePart,
};
use schema_types::Pose;
use schema_types::space::sensor_from_camera;

use crate::ros2::cdr::Writer;

/// Fixed frame of the world.
pub const MAP: &str = "map";
/// Type number of a field of points: `uint8`.
const UINT8: u8 = 2;
/// `uint16`.
const UINT16: u8 = 4;
/// `uint32`.
const UINT32: u8 = 6;
/// `float32`.
const FLOAT32: u8 = 7;
/// Quality of compressed images.
const JPEG_QUALITY: u8 = 85;

/// Nanoseconds as ROS 2 writes moments.
fn time(writer: &mut Writer, nanos: u64) {
    writer.i32((nanos / 1_000_000_000) as i32);
    writer.u32((nanos % 1_000_000_000) as u32);
}

fn header(writer: &mut Writer, nanos: u64, frame_id: &str) {
    time(writer, nanos);
    writer.string(frame_id);
}

fn vector(writer: &mut Writer, vector: Vector3<f64>) {
    writer.f64s(vector.as_slice());
}

fn quaternion(writer: &mut Writer, rotation: &UnitQuaternion<f64>) {
    let q = rotation.quaternion();
    writer.f64s(&[q.i, q.j, q.k, q.w]);
}

fn pose(writer: &mut Writer, pose: &Pose) {
    writer.f64s(&pose.translation_m);
    writer.f64s(&pose.rotation_xyzw);
}

/// `rosgraph_msgs/Clock`.
pub fn clock(sim_nanos: u64) -> Vec<u8> {
    let mut writer = Writer::new(8);
    time(&mut writer, sim_nanos);
    writer.finish()
}

/// Name of the encoding of an image, and the bytes of a pixel; `None` of what is no image of ROS 2.
fn image_encoding(modality: Modality) -> Option<(&'static str, usize)> {
    Some(match modality {
        Modality::Rgb => ("bgra8", 4),
        Modality::Depth => ("32FC1", 4),
        Modality::Semantic => ("mono8", 1),
        Modality::Instance => ("32SC1", 4),
        Modality::Flow => ("32FC2", 8),
        _ => return None,
    })
}

/// Whether frames of this modality are images of ROS 2.
pub fn is_image(modality: Modality) -> bool {
    image_encoding(modality).is_some()
}

/// `sensor_msgs/Image` with the pixels as they are.
pub fn image(frame: &FrameHeader, payload: &[u8], frame_id: &str) -> Option<Vec<u8>> {
    let (encoding, pixel_bytes) = image_encoding(frame.modality()?)?;
    let row_bytes = frame.width as usize * pixel_bytes;
    let mut writer = Writer::new(payload.len());
    header(&mut writer, frame.sim_nanos, frame_id);
    writer.u32(frame.height);
    writer.u32(frame.width);
    writer.string(encoding);
    writer.u8(0);
    writer.u32(row_bytes as u32);
    writer.octets_by(row_bytes * frame.height as usize, |out| {
        for row in payload.chunks(frame.row_stride.max(1) as usize) {
            out.extend(row.get(..row_bytes).unwrap_or_default());
        }
    });
    Some(writer.finish())
}

/// `sensor_msgs/CompressedImage` of a colour image.
pub fn compressed_image(frame: &FrameHeader, payload: &[u8], frame_id: &str) -> Option<Vec<u8>> {
    let file = crate::coding::jpeg(frame, payload, JPEG_QUALITY)?;
    let mut writer = Writer::new(file.len());
    header(&mut writer, frame.sim_nanos, frame_id);
    writer.string("bgra8; jpeg compressed bgr8");
    writer.octets(&file);
    Some(writer.finish())
}

/// `sensor_msgs/CameraInfo`.
pub fn camera_info(frame: &FrameHeader, frame_id: &str) -> Vec<u8> {
    let [fx, fy, cx, cy] = frame.intrinsics_px;
    // ROS 2 counts from the middle of the first pixel.
    let (cx, cy) = (cx - 0.5, cy - 0.5);
    let mut writer = Writer::new(512);
    header(&mut writer, frame.sim_nanos, frame_id);
    writer.u32(frame.height);
    writer.u32(frame.width);
    match frame.distortion() {
        None => {
            writer.string("plumb_bob");
            writer.u32(5);
            writer.f64s(&[0.0; 5]);
        }
        // CARLA's lens is none of those that ROS 2 has a name for.
        Some(lens) => {
            writer.string("carla");
            writer.u32(4);
            writer.f64s(&lens.as_array().map(f64::from));
        }
    }
    writer.f64s(&[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]);
    writer.f64s(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    writer.f64s(&[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
    for _ in 0..2 {
        writer.u32(0); // binning
    }
    for _ in 0..4 {
        writer.u32(0); // region of interest: all
    }
    writer.bool(false);
    writer.finish()
}

/// One field of points: name, place, type.
type Field = (&'static str, u32, u8);

const LIDAR_FIELDS: &[Field] = &[
    ("x", 0, FLOAT32),
    ("y", 4, FLOAT32),
    ("z", 8, FLOAT32),
    ("intensity", 12, FLOAT32),
    ("ring", 16, UINT16),
];
const SEMANTIC_LIDAR_FIELDS: &[Field] = &[
    ("x", 0, FLOAT32),
    ("y", 4, FLOAT32),
    ("z", 8, FLOAT32),
    ("cos_angle", 12, FLOAT32),
    ("object_idx", 16, UINT32),
    ("object_tag", 20, UINT8),
    ("ring", 22, UINT16),
];
const RADAR_FIELDS: &[Field] = &[
    ("x", 0, FLOAT32),
    ("y", 4, FLOAT32),
    ("z", 8, FLOAT32),
    ("range", 12, FLOAT32),
    ("velocity", 16, FLOAT32),
    ("azimuth", 20, FLOAT32),
    ("elevation", 24, FLOAT32),
];

/// `sensor_msgs/PointCloud2` of a lidar or a radar; `None` of other frames.
pub fn points(frame: &FrameHeader, payload: &[u8], frame_id: &str) -> Option<Vec<u8>> {
    let modality = frame.modality()?;
    let (fields, stride) = match modality {
        Modality::Lidar => (LIDAR_FIELDS, 20usize),
        Modality::SemanticLidar => (SEMANTIC_LIDAR_FIELDS, 24),
        Modality::Radar => (RADAR_FIELDS, 28),
        _ => return None,
    };
    let elements = payload.chunks_exact(frame.element_bytes.max(1) as usize);
    let n = elements.len();
    let mut writer = Writer::new(n * stride + 512);
    header(&mut writer, frame.sim_nanos, frame_id);
    writer.u32(1);
    writer.u32(n as u32);
    writer.u32(fields.len() as u32);
    for (name, offset, kind) in fields {
        writer.string(name);
        writer.u32(*offset);
        writer.u8(*kind);
        writer.u32(1);
    }
    writer.bool(false);
    writer.u32(stride as u32);
    writer.u32((n * stride) as u32);
    writer.octets_by(n * stride, |out| {
        for element in elements {
            match modality {
                Modality::Lidar => {
                    let intensity = u16::from_le_bytes([element[12], element[13]]);
                    out.extend(&element[..12]);
                    out.extend((f32::from(intensity) / 65_535.0).to_le_bytes());
                    out.extend(&element[14..16]);
                    out.extend([0; 2]);
                }
                Modality::Radar => {
                    let of: RadarDetection = bytemuck::pod_read_unaligned(element);
                    let (sin_azimuth, cos_azimuth) = of.azimuth_rad.sin_cos();
                    let (sin_altitude, cos_altitude) = of.altitude_rad.sin_cos();
                    for value in [
                        of.depth_m * cos_altitude * cos_azimuth,
                        of.depth_m * cos_altitude * sin_azimuth,
                        of.depth_m * sin_altitude,
                        of.depth_m,
                        of.velocity_mps,
                        of.azimuth_rad,
                        of.altitude_rad,
                    ] {
                        out.extend(value.to_le_bytes());
                    }
                }
                _ => out.extend(element),
            }
        }
    });
    writer.bool(true);
    Some(writer.finish())
}

/// `sensor_msgs/Imu`, with gravity in the acceleration, as REP 145 has it.
pub fn imu(frame: &FrameHeader, payload: &[u8], frame_id: &str) -> Option<Vec<u8>> {
    let bytes = payload.get(..size_of::<ImuSample>())?;
    let sample: ImuSample = bytemuck::pod_read_unaligned(bytes);
    let mut writer = Writer::new(384);
    header(&mut writer, frame.sim_nanos, frame_id);
    writer.f64s(&frame.world_from_sensor.rotation_xyzw);
    writer.f64s(&[0.0; 9]);
    writer.f64s(&sample.angular_velocity_radps);
    writer.f64s(&[0.0; 9]);
    writer.f64s(&sample.specific_force_mps2);
    writer.f64s(&[0.0; 9]);
    Some(writer.finish())
}

/// `sensor_msgs/NavSatFix`.
pub fn nav_sat_fix(frame: &FrameHeader, payload: &[u8], frame_id: &str) -> Option<Vec<u8>> {
    let bytes = payload.get(..size_of::<GnssSample>())?;
    let sample: GnssSample = bytemuck::pod_read_unaligned(bytes);
    let mut writer = Writer::new(192);
    header(&mut writer, frame.sim_nanos, frame_id);
    writer.u8(0); // a fix, without augmentation
    writer.u16(1); // GPS
    writer.f64s(&[sample.latitude_deg, sample.longitude_deg, sample.altitude_m]);
    writer.f64s(&[0.0; 9]);
    writer.u8(0); // covariance unknown
    Some(writer.finish())
}

/// `nav_msgs/Odometry` of an actor: its pose on the map, its velocities along its own axes.
pub fn odometry(actor: &ActorRecord, sim_nanos: u64, frame_id: &str) -> Vec<u8> {
    let into_body = actor.world_from_actor.isometry().rotation.inverse();
    let mut writer = Writer::new(1024);
    header(&mut writer, sim_nanos, MAP);
    writer.string(frame_id);
    pose(&mut writer, &actor.world_from_actor);
    writer.f64s(&[0.0; 36]);
    vector(
        &mut writer,
        into_body * Vector3::from(actor.velocity_in_world_mps),
    );
    vector(
        &mut writer,
        into_body * Vector3::from(actor.angular_velocity_in_world_radps),
    );
    writer.f64s(&[0.0; 36]);
    writer.finish()
}

/// `carla_msgs/CarlaEgoVehicleStatus`: accelerations along the vehicle's axes, the steering with
/// CARLA's sign, positive to the right.
pub fn vehicle_status(
    actor: &ActorRecord,
    part: &VehiclePart,
    sim_nanos: u64,
    frame_id: &str,
) -> Vec<u8> {
    let rotation = actor.world_from_actor.isometry().rotation;
    let mut writer = Writer::new(256);
    header(&mut writer, sim_nanos, frame_id);
    writer.f32(actor.speed_mps() as f32);
    vector(
        &mut writer,
        rotation.inverse() * Vector3::from(actor.acceleration_in_world_mps2),
    );
    vector(&mut writer, Vector3::zeros());
    quaternion(&mut writer, &rotation);
    header(&mut writer, sim_nanos, frame_id);
    writer.f32(part.throttle_ratio);
    writer.f32(-part.steer_ratio);
    writer.f32(part.brake_ratio);
    writer.bool(part.control_flags & 1 != 0);
    writer.bool(part.control_flags & 2 != 0);
    writer.i32(part.gear);
    writer.bool(part.control_flags & 4 != 0);
    writer.finish()
}

/// One transform: frame, its parent, `parent_from_frame`.
pub type Link<'a> = (&'a str, &'a str, Pose);

/// Transform from a sensor's frame to the optical one of a camera.
pub fn optical() -> Pose {
    let q = sensor_from_camera();
    let q = q.quaternion();
    Pose {
        translation_m: [0.0; 3],
        rotation_xyzw: [q.i, q.j, q.k, q.w],
    }
}

/// `tf2_msgs/TFMessage`.
pub fn transforms(links: &[Link<'_>], sim_nanos: u64) -> Vec<u8> {
    let mut writer = Writer::new(links.len() * 128);
    writer.u32(links.len() as u32);
    for (frame, parent, parent_from_frame) in links {
        header(&mut writer, sim_nanos, parent);
        writer.string(frame);
        pose(&mut writer, parent_from_frame);
    }
    writer.finish()
}

/// What a detector found.
pub struct Found<'a> {
    /// When, simulated.
    pub sim_nanos: u64,
    /// Frame of the boxes.
    pub frame_id: &'a str,
    /// Name of a class.
    pub class_name: &'a dyn Fn(u32) -> String,
}

/// `vision_msgs/Detection2DArray`.
pub fn detections_2d(found: &Found<'_>, boxes: &[Box2d]) -> Vec<u8> {
    let mut writer = Writer::new(boxes.len() * 640);
    header(&mut writer, found.sim_nanos, found.frame_id);
    writer.u32(boxes.len() as u32);
    for of in boxes {
        header(&mut writer, found.sim_nanos, found.frame_id);
        hypothesis(&mut writer, found, of.class, of.score, &Pose::IDENTITY);
        let [min, max] = [of.min_px, of.max_px].map(|corner| corner.map(f64::from));
        // ROS 2 counts from the middle of the first pixel.
        writer.f64s(&[
            (min[0] + max[0]) / 2.0 - 0.5,
            (min[1] + max[1]) / 2.0 - 0.5,
            0.0,
            max[0] - min[0],
            max[1] - min[1],
        ]);
        writer.string(&id(of.id));
    }
    writer.finish()
}

/// `vision_msgs/Detection3DArray`.
pub fn detections_3d(found: &Found<'_>, boxes: &[Box3d]) -> Vec<u8> {
    let mut writer = Writer::new(boxes.len() * 704);
    header(&mut writer, found.sim_nanos, found.frame_id);
    writer.u32(boxes.len() as u32);
    for of in boxes {
        header(&mut writer, found.sim_nanos, found.frame_id);
        hypothesis(&mut writer, found, of.class, of.score, &of.pose);
        pose(&mut writer, &of.pose);
        writer.f64s(&of.half_m.map(|half| 2.0 * f64::from(half)));
        writer.string(&id(of.id));
    }
    writer.finish()
}

fn hypothesis(writer: &mut Writer, found: &Found<'_>, class: u32, score: f32, at: &Pose) {
    writer.u32(1);
    writer.string(&(found.class_name)(class));
    writer.f64(score.into());
    pose(writer, at);
    writer.f64s(&[0.0; 36]);
}

/// Number of an object as text; empty if it has none.
fn id(id: u32) -> String {
    match id {
        0 => String::new(),
        id => id.to_string(),
    }
}
