//! Frames and snapshots as ROS 2 messages. Axes are those of REP 103: x forward, y left, z up, which
//! are Gantry's own; images are in optical frames (x right, y down, z forward).

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use schema_frames::{
    ActorKind, ActorRecord, FrameHeader, GnssSample, ImuSample, LidarPoint, Modality,
    RadarDetection, SemanticLidarPoint,
};
use schema_types::Class;

use super::cdr::Cdr;
use consumer_truth::Body;
use consumer_truth::ticks::{TickFrame, World};

/// The frame of the world.
pub const MAP: &str = "map";

/// Begins a message with `std_msgs/Header`.
pub fn begin<'a>(cdr: &'a mut Cdr, nanos: u64, frame_id: &str) -> &'a mut Cdr {
    stamp(cdr.start(), nanos).text(frame_id)
}

/// Writes `builtin_interfaces/Time`.
pub fn stamp(cdr: &mut Cdr, nanos: u64) -> &mut Cdr {
    cdr.i32((nanos / 1_000_000_000) as i32)
        .u32((nanos % 1_000_000_000) as u32)
}

fn vector(cdr: &mut Cdr, vector: [f64; 3]) -> &mut Cdr {
    cdr.f64s(&vector)
}

fn rotation<'a>(cdr: &'a mut Cdr, q: &UnitQuaternion<f64>) -> &'a mut Cdr {
    cdr.f64s(&[q.i, q.j, q.k, q.w])
}

fn pose<'a>(cdr: &'a mut Cdr, pose: &Isometry3<f64>) -> &'a mut Cdr {
    let t = pose.translation;
    rotation(vector(cdr, [t.x, t.y, t.z]), &pose.rotation)
}

/// A transform between two frames.
#[derive(Clone, Debug)]
pub struct Transform {
    /// Frame whose coordinates come out.
    pub parent: String,
    /// Frame whose coordinates go in.
    pub child: String,
    /// `parent_from_child`.
    pub pose: Isometry3<f64>,
}

/// `tf2_msgs/TFMessage`.
pub fn transforms(cdr: &mut Cdr, nanos: u64, transforms: &[Transform]) {
    cdr.start().u32(transforms.len() as u32);
    for it in transforms {
        stamp(cdr, nanos).text(&it.parent).text(&it.child);
        pose(cdr, &it.pose);
    }
}

/// `nav_msgs/Odometry` of an actor; velocities are in its own axes.
pub fn odometry(cdr: &mut Cdr, nanos: u64, child: &str, record: &ActorRecord) {
    let world_from_actor = record.world_from_actor.isometry();
    let own = |v: [f64; 3]| {
        let v = world_from_actor.rotation.inverse() * Vector3::from(v);
        [v.x, v.y, v.z]
    };
    begin(cdr, nanos, MAP).text(child);
    pose(cdr, &world_from_actor).f64s(&[0.0; 36]);
    vector(cdr, own(record.velocity_in_world_mps));
    vector(cdr, own(record.angular_velocity_in_world_radps)).f64s(&[0.0; 36]);
}

/// `vision_msgs/Detection3DArray`: the boxes of vehicles, walkers and props in the map.
pub fn objects(cdr: &mut Cdr, nanos: u64, world: &World) {
    let solid: Vec<&ActorRecord> = world
        .records
        .iter()
        .filter(|record| {
            let kinds = [ActorKind::Vehicle, ActorKind::Walker, ActorKind::Prop];
            kinds.iter().any(|kind| *kind as u16 == record.kind)
                && record.half_box_m.iter().all(|half| *half > 0.0)
        })
        .collect();
    begin(cdr, nanos, MAP).u32(solid.len() as u32);
    for record in solid {
        let centre = world
            .actors
            .by_id
            .get(&record.id)
            .map_or([0.0; 3], |actor| actor.body_box.centre_m.map(f64::from));
        let at = record.world_from_actor.isometry()
            * Isometry3::translation(centre[0], centre[1], centre[2]);
        let size_m = record.half_box_m.map(|half| 2.0 * f64::from(half));
        detection(cdr, nanos, record.class, record.id, &at, size_m);
    }
}

/// `vision_msgs/Detection3DArray`: the boxes of vehicles and people that belong to the map.
pub fn scenery(cdr: &mut Cdr, nanos: u64, bodies: &[Body]) {
    begin(cdr, nanos, MAP).u32(bodies.len() as u32);
    for body in bodies {
        let at = &body.world_from_box;
        detection(cdr, nanos, body.class, body.id, at, body.size_m());
    }
}

/// `vision_msgs/Detection3D`.
fn detection(cdr: &mut Cdr, nanos: u64, class: u8, id: u32, at: &Isometry3<f64>, size_m: [f64; 3]) {
    stamp(cdr, nanos).text(MAP);
    let class = Class(class).info().map_or("Unlabeled", |it| it.name);
    cdr.u32(1).text(class).f64(1.0);
    pose(cdr, at).f64s(&[0.0; 36]);
    pose(cdr, at).f64s(&size_m);
    cdr.text(&id.to_string());
}

/// ROS's name of an image's elements, `None` if the modality is no image.
fn image_encoding(modality: Modality) -> Option<&'static str> {
    match modality {
        Modality::Rgb => Some("bgra8"),
        Modality::Depth => Some("32FC1"),
        Modality::Semantic => Some("mono8"),
        Modality::Instance => Some("32SC1"),
        Modality::Flow => Some("32FC2"),
        Modality::Normals => Some("32FC3"),
        _ => None,
    }
}

/// `sensor_msgs/Image`; normals become three `f32`, everything else keeps its bytes.
///
/// # Errors
/// If the modality is no image.
pub fn image(cdr: &mut Cdr, frame: &TickFrame, frame_id: &str) -> anyhow::Result<()> {
    let header = &frame.header;
    let encoding = image_encoding(frame.modality)
        .ok_or_else(|| anyhow::anyhow!("{} is no image", frame.topic))?;
    begin(cdr, header.sim_nanos, frame_id)
        .u32(header.height)
        .u32(header.width)
        .text(encoding)
        .u8(0);
    let tight = header.width * header.element_bytes;
    if frame.modality == Modality::Normals {
        let pixels: Vec<u8> = frame
            .elements::<[u16; 4]>()
            .iter()
            .flat_map(|[x, y, z, _]| [*x, *y, *z].map(half_to_f32))
            .flat_map(f32::to_le_bytes)
            .collect();
        cdr.u32(header.width * 12).sequence(&pixels)?;
    } else if header.row_stride == tight {
        let n_bytes = (tight * header.height) as usize;
        cdr.u32(tight).sequence(&frame.payload[..n_bytes])?;
    } else {
        let rows: Vec<u8> = (0..header.height as usize)
            .flat_map(|row| &frame.payload[row * header.row_stride as usize..][..tight as usize])
            .copied()
            .collect();
        cdr.u32(tight).sequence(&rows)?;
    }
    Ok(())
}

/// IEEE 754's 16-bit number, widened.
pub fn half_to_f32(bits: u16) -> f32 {
    let sign = if bits >> 15 == 1 { -1.0 } else { 1.0 };
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f32::from(bits & 1023));
    sign * match exponent {
        0 => fraction * 2f32.powi(-24),
        31 if fraction == 0.0 => f32::INFINITY,
        31 => f32::NAN,
        _ => (1024.0 + fraction) * 2f32.powi(exponent - 25),
    }
}

/// `sensor_msgs/CameraInfo` of a pinhole without distortion; ROS counts from pixel centres.
pub fn camera_info(cdr: &mut Cdr, header: &FrameHeader, size_px: (u32, u32), frame_id: &str) {
    let [fx, fy, cx, cy] = header.intrinsics_px;
    let (cx, cy) = (cx - 0.5, cy - 0.5);
    begin(cdr, header.sim_nanos, frame_id)
        .u32(size_px.1)
        .u32(size_px.0)
        .text("plumb_bob")
        .u32(5)
        .f64s(&[0.0; 5])
        .f64s(&[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
        .f64s(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
        .f64s(&[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0])
        .u32(0)
        .u32(0)
        .u32(0)
        .u32(0)
        .u32(0)
        .u32(0)
        .u8(0);
}

const UINT8: u8 = 2;
const UINT16: u8 = 4;
const UINT32: u8 = 6;
const FLOAT32: u8 = 7;

/// Named fields of a point: name, type, bytes.
type Fields = [(&'static str, u8, u32)];

/// `sensor_msgs/PointCloud2` of a lidar, semantic lidar or radar, in the sensor's own frame.
///
/// # Errors
/// If the modality has no points.
pub fn cloud(cdr: &mut Cdr, frame: &TickFrame, frame_id: &str) -> anyhow::Result<()> {
    let xyz = [("x", FLOAT32, 4), ("y", FLOAT32, 4), ("z", FLOAT32, 4)];
    let (more, data): (&Fields, Vec<u8>) = match frame.modality {
        Modality::Lidar => (
            &[("intensity", FLOAT32, 4), ("ring", UINT16, 2)],
            frame
                .elements::<LidarPoint>()
                .iter()
                .flat_map(lidar_bytes)
                .collect(),
        ),
        Modality::SemanticLidar => (
            &[
                ("cos_incidence", FLOAT32, 4),
                ("object_id", UINT32, 4),
                ("ring", UINT16, 2),
                ("class", UINT8, 1),
            ],
            frame
                .elements::<SemanticLidarPoint>()
                .iter()
                .flat_map(semantic_bytes)
                .collect(),
        ),
        Modality::Radar => (
            &[
                ("velocity", FLOAT32, 4),
                ("azimuth", FLOAT32, 4),
                ("elevation", FLOAT32, 4),
                ("range", FLOAT32, 4),
                ("object_id", UINT32, 4),
                ("class", UINT8, 1),
            ],
            frame
                .elements::<RadarDetection>()
                .iter()
                .flat_map(radar_bytes)
                .collect(),
        ),
        _ => anyhow::bail!("{} has no points", frame.topic),
    };
    let n_points = frame.header.width;
    begin(cdr, frame.header.sim_nanos, frame_id)
        .u32(1)
        .u32(n_points)
        .u32((xyz.len() + more.len()) as u32);
    let mut offset = 0;
    for (name, kind, n_bytes) in xyz.iter().chain(more) {
        cdr.text(name).u32(offset).u8(*kind).u32(1);
        offset += n_bytes;
    }
    // Points are padded to whole floats, so that readers may cast.
    let step = offset.next_multiple_of(4);
    cdr.u8(0).u32(step).u32(step * n_points);
    cdr.sequence(&data)?.u8(1);
    Ok(())
}

fn lidar_bytes(point: &LidarPoint) -> [u8; 20] {
    let [x, y, z] = point.hit_in_sensor_m;
    let mut bytes = [0; 20];
    put(&mut bytes, &[x, y, z, f32::from(point.intensity) / 65535.0]);
    bytes[16..18].copy_from_slice(&point.channel.to_le_bytes());
    bytes
}

fn semantic_bytes(point: &SemanticLidarPoint) -> [u8; 24] {
    let [x, y, z] = point.hit_in_sensor_m;
    let mut bytes = [0; 24];
    put(&mut bytes, &[x, y, z, point.cos_incidence]);
    bytes[16..20].copy_from_slice(&point.object_id.to_le_bytes());
    bytes[20..22].copy_from_slice(&point.channel.to_le_bytes());
    bytes[22] = point.class;
    bytes
}

fn radar_bytes(hit: &RadarDetection) -> [u8; 36] {
    let (azimuth, elevation) = (hit.azimuth_rad, hit.altitude_rad);
    let flat = hit.depth_m * elevation.cos();
    let mut bytes = [0; 36];
    let xyz = [
        flat * azimuth.cos(),
        flat * azimuth.sin(),
        hit.depth_m * elevation.sin(),
    ];
    put(
        &mut bytes,
        &[
            xyz[0],
            xyz[1],
            xyz[2],
            hit.velocity_mps,
            azimuth,
            elevation,
            hit.depth_m,
        ],
    );
    bytes[28..32].copy_from_slice(&hit.object_id.to_le_bytes());
    bytes[32] = hit.class;
    bytes
}

fn put(bytes: &mut [u8], values: &[f32]) {
    for (place, value) in bytes.chunks_exact_mut(4).zip(values) {
        place.copy_from_slice(&value.to_le_bytes());
    }
}

/// `sensor_msgs/Imu`: what was measured, and as the orientation that of the sensor's true pose.
pub fn imu(cdr: &mut Cdr, header: &FrameHeader, sample: &ImuSample, frame_id: &str) {
    begin(cdr, header.sim_nanos, frame_id);
    rotation(cdr, &header.world_from_sensor.isometry().rotation).f64s(&[0.0; 9]);
    vector(cdr, sample.angular_velocity_radps).f64s(&[0.0; 9]);
    vector(cdr, sample.specific_force_mps2).f64s(&[0.0; 9]);
}

/// `sensor_msgs/NavSatFix` with a fix by GPS and unknown covariance.
pub fn fix(cdr: &mut Cdr, header: &FrameHeader, sample: &GnssSample, frame_id: &str) {
    begin(cdr, header.sim_nanos, frame_id)
        .i8(0)
        .u16(1)
        .f64(sample.latitude_deg)
        .f64(sample.longitude_deg)
        .f64(sample.altitude_m)
        .f64s(&[0.0; 9])
        .u8(0);
}

/// `event_camera_msgs/EventPacket` with words of EVT 3.0, which go on from packet to packet.
///
/// # Errors
/// If there are 4 GiB of words.
pub fn events(
    cdr: &mut Cdr,
    header: &FrameHeader,
    size_px: (u32, u32),
    words: &[u8],
    frame_id: &str,
) -> anyhow::Result<()> {
    begin(cdr, header.sim_nanos, frame_id)
        .u32(size_px.1)
        .u32(size_px.0)
        .u64(header.seq)
        .u64(0)
        .text("evt3")
        .u8(0)
        .sequence(words)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_widen_exactly() {
        for (bits, value) in [
            (0x3c00, 1.0),
            (0xbc00, -1.0),
            (0x0001, 2f32.powi(-24)),
            (0x3555, 0.333_251_95),
            (0x0000, 0.0),
            (0x7bff, 65504.0),
            (0x7c00, f32::INFINITY),
        ] {
            assert_eq!(half_to_f32(bits), value, "{bits:x}");
        }
    }

    #[test]
    fn a_radar_hit_lies_where_its_angles_say() {
        let mut hit: RadarDetection = bytemuck::Zeroable::zeroed();
        hit.azimuth_rad = std::f32::consts::FRAC_PI_2;
        hit.depth_m = 10.0;
        let bytes = radar_bytes(&hit);
        let xyz: Vec<f32> = bytes[..12]
            .chunks_exact(4)
            .map(bytemuck::pod_read_unaligned)
            .collect();
        assert!(xyz[0].abs() < 1e-5 && (xyz[1] - 10.0).abs() < 1e-5 && xyz[2] == 0.0);
    }
}
