//! Frames of sensors as messages of ROS 2.

use half::f16;
use schema_calibration::{Format, ros};
use schema_frames::{
    Calibration, FrameHeader, GnssSample, ImuSample, LidarPoint, LidarReturn, Modality,
    RadarDetection, SemanticLidarPoint,
};
use schema_types::Lens;

use super::cdr::{TooLong, Writer};

/// The reason why a frame becomes no message.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// Of another modality.
    #[error("the message has no form for {0:?}")]
    Modality(Option<Modality>),
    /// Too large.
    #[error(transparent)]
    TooLong(#[from] TooLong),
}

/// Begins a message with `std_msgs/Header`.
pub(super) fn begin<'a>(out: &'a mut Writer, nanos: u64, frame_id: &str) -> &'a mut Writer {
    header(out.start(), nanos, frame_id)
}

/// `std_msgs/Header`.
pub(super) fn header<'a>(out: &'a mut Writer, nanos: u64, frame_id: &str) -> &'a mut Writer {
    time(out, nanos).text(frame_id)
}

/// `builtin_interfaces/Time`.
pub(super) fn time(out: &mut Writer, nanos: u64) -> &mut Writer {
    out.i32((nanos / 1_000_000_000) as i32)
        .u32((nanos % 1_000_000_000) as u32)
}

/// Name of the encoding of an image; `None` of what is no image of ROS 2.
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

/// The rows of a list or an image without padding. A row that the payload lacks is shorter.
fn rows<'a>(of: &FrameHeader, payload: &'a [u8]) -> impl Iterator<Item = &'a [u8]> + use<'a> {
    let row_bytes = of.width as usize * of.element_bytes as usize;
    let rows = payload.chunks(of.row_stride.max(1) as usize);
    rows.take(of.height as usize)
        .map(move |row| &row[..row_bytes.min(row.len())])
}

/// Writes `sensor_msgs/Image`: normals become three `f32`, everything else keeps its bytes.
///
/// # Errors
/// [`FrameError`] if the frame is no image or too large.
pub fn image(
    out: &mut Writer,
    of: &FrameHeader,
    payload: &[u8],
    frame_id: &str,
) -> Result<(), FrameError> {
    let modality = of.modality();
    let encoding = modality
        .and_then(image_encoding)
        .ok_or(FrameError::Modality(modality))?;
    let is_normals = modality == Some(Modality::Normals);
    let pixel_bytes = if is_normals { 12 } else { of.element_bytes };
    let step = of.width * pixel_bytes;
    begin(out, of.sim_nanos, frame_id)
        .u32(of.height)
        .u32(of.width)
        .text(encoding)
        .u8(0)
        .u32(step);
    let n_bytes = step as usize * of.height as usize;
    out.sequence_by(n_bytes, |data| {
        for row in rows(of, payload) {
            if !is_normals {
                data.extend(row);
                continue;
            }
            for normal in row.chunks_exact(8) {
                for half in normal[..6].chunks_exact(2) {
                    let number = f16::from_le_bytes([half[0], half[1]]).to_f32();
                    data.extend(number.to_le_bytes());
                }
            }
        }
    })?;
    Ok(())
}

/// Writes `sensor_msgs/CompressedImage` of a colour image that is coded as the JPEG `file`.
///
/// # Errors
/// [`FrameError`] if the file is too large.
pub fn compressed_image(
    out: &mut Writer,
    of: &FrameHeader,
    file: &[u8],
    frame_id: &str,
) -> Result<(), FrameError> {
    begin(out, of.sim_nanos, frame_id)
        .text("bgra8; jpeg compressed bgr8")
        .sequence(file)?;
    Ok(())
}

/// Lenses that ROS 2 has words for.
pub const KNOWN_LENSES: &str = Format::Ros.models();

/// Whether ROS 2 has words for a lens.
pub fn has_words_for(lens: &Lens) -> bool {
    ros::distortion(lens).is_some()
}

/// Writes `sensor_msgs/CameraInfo` of an image of `size_px`, which a list of events does not carry.
/// The numbers of a lens with a model are not in headers: without `lens`, and if ROS 2 has no words
/// for it, the message says that there is no calibration.
pub fn camera_info(
    out: &mut Writer,
    of: &FrameHeader,
    lens: Option<&Calibration>,
    size_px: (u32, u32),
    frame_id: &str,
) {
    let own = Calibration::of(of);
    let calibration = own
        .as_ref()
        .or(lens.filter(|it| it.crc() == of.calibration_crc));
    let said = calibration.and_then(|calibration| {
        let lens = calibration.lens();
        let (model, coefficients) = match calibration.distortion() {
            // CARLA's lens is none of those that ROS 2 has a name for.
            Some(bent) => ("carla", bent.as_array().map(f64::from).to_vec()),
            None => {
                let said = ros::distortion(lens)?;
                (said.model, said.coefficients)
            }
        };
        Some((model, coefficients, lens.plane()))
    });
    begin(out, of.sim_nanos, frame_id)
        .u32(size_px.1)
        .u32(size_px.0);
    const IDENTITY: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    match said {
        Some((model, coefficients, plane)) => {
            let [fx, fy] = plane.focal_px;
            // ROS 2 counts from the middle of the first pixel.
            let [cx, cy] = plane.centre_px.map(|it| it - 0.5);
            out.text(model)
                .u32(coefficients.len() as u32)
                .f64s(&coefficients)
                .f64s(&[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
                .f64s(&IDENTITY)
                .f64s(&[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
        }
        // It says by zeros that a camera has no calibration.
        None => {
            out.text("").u32(0).f64s(&[0.0; 9]);
            out.f64s(&IDENTITY).f64s(&[0.0; 12]);
        }
    }
    // Binning by two numbers, the region of interest by four: all of the image.
    for _ in 0..6 {
        out.u32(0);
    }
    out.bool(false);
}

/// Type number of a field of points: `uint8`.
const UINT8: u8 = 2;
/// `uint16`.
const UINT16: u8 = 4;
/// `int32`.
const INT32: u8 = 5;
/// `uint32`.
const UINT32: u8 = 6;
/// `float32`.
const FLOAT32: u8 = 7;

/// Name, type and bytes of a field of points.
type Field = (&'static str, u8, u32);

const LIDAR_FIELDS: &[Field] = &[
    ("x", FLOAT32, 4),
    ("y", FLOAT32, 4),
    ("z", FLOAT32, 4),
    ("intensity", FLOAT32, 4),
    ("ring", UINT16, 2),
];
const SEMANTIC_LIDAR_FIELDS: &[Field] = &[
    ("x", FLOAT32, 4),
    ("y", FLOAT32, 4),
    ("z", FLOAT32, 4),
    ("cos_incidence", FLOAT32, 4),
    ("object_id", UINT32, 4),
    ("ring", UINT16, 2),
    ("class", UINT8, 1),
];
/// `time` is that of Velodyne's drivers, seconds from the message's stamp, and `time_ns` the same in
/// nanoseconds; `return_type` is [`LidarReturn::returns`].
const RETURN_FIELDS: &[Field] = &[
    ("x", FLOAT32, 4),
    ("y", FLOAT32, 4),
    ("z", FLOAT32, 4),
    ("intensity", FLOAT32, 4),
    ("time", FLOAT32, 4),
    ("object_id", UINT32, 4),
    ("ring", UINT16, 2),
    ("return_type", UINT8, 1),
    ("class", UINT8, 1),
    ("time_ns", INT32, 4),
    ("range_mm_lsb", UINT16, 2),
    ("ambient", UINT16, 2),
    ("reflectivity", UINT8, 1),
    ("flags", UINT8, 1),
];
const RADAR_FIELDS: &[Field] = &[
    ("x", FLOAT32, 4),
    ("y", FLOAT32, 4),
    ("z", FLOAT32, 4),
    ("velocity", FLOAT32, 4),
    ("azimuth", FLOAT32, 4),
    ("elevation", FLOAT32, 4),
    ("range", FLOAT32, 4),
    ("object_id", UINT32, 4),
    ("class", UINT8, 1),
];

/// Writes `sensor_msgs/PointCloud2` of any lidar or a radar, in the sensor's own frame.
///
/// # Errors
/// [`FrameError`] if the frame has no points or too many.
pub fn points(
    out: &mut Writer,
    of: &FrameHeader,
    payload: &[u8],
    frame_id: &str,
) -> Result<(), FrameError> {
    let modality = of.modality();
    type Append = fn(&[u8], &mut Vec<u8>);
    let (fields, element_bytes, append): (&[Field], usize, Append) = match modality {
        Some(Modality::Lidar) => (LIDAR_FIELDS, size_of::<LidarPoint>(), lidar),
        Some(Modality::SemanticLidar) => {
            let element_bytes = size_of::<SemanticLidarPoint>();
            (SEMANTIC_LIDAR_FIELDS, element_bytes, semantic_lidar)
        }
        Some(Modality::LidarReturns) => (RETURN_FIELDS, size_of::<LidarReturn>(), lidar_return),
        Some(Modality::Radar) => (RADAR_FIELDS, size_of::<RadarDetection>(), radar),
        other => return Err(FrameError::Modality(other)),
    };
    let elements = || rows(of, payload).flat_map(|row| row.chunks_exact(element_bytes));
    let n_points = elements().count();
    let n_fields = fields.len() as u32;
    begin(out, of.sim_nanos, frame_id)
        .u32(1)
        .u32(n_points as u32)
        .u32(n_fields);
    let mut offset = 0;
    for (name, kind, n_bytes) in fields {
        out.text(name).u32(offset).u8(*kind).u32(1);
        offset += n_bytes;
    }
    // Points are padded to whole floats, so that readers may cast.
    let step = offset.next_multiple_of(4);
    let n_bytes = n_points * step as usize;
    out.bool(false).u32(step).u32(n_bytes as u32);
    out.sequence_by(n_bytes, |data| {
        for element in elements() {
            append(element, data);
        }
    })?
    .bool(true);
    Ok(())
}

fn lidar(element: &[u8], data: &mut Vec<u8>) {
    let point: LidarPoint = bytemuck::pod_read_unaligned(element);
    let [x, y, z] = point.hit_in_sensor_m;
    floats(data, &[x, y, z, f32::from(point.intensity) / 65_535.0]);
    data.extend(point.channel.to_le_bytes());
    data.extend([0; 2]);
}

fn semantic_lidar(element: &[u8], data: &mut Vec<u8>) {
    let point: SemanticLidarPoint = bytemuck::pod_read_unaligned(element);
    let [x, y, z] = point.hit_in_sensor_m;
    floats(data, &[x, y, z, point.cos_incidence]);
    data.extend(point.object_id.to_le_bytes());
    data.extend(point.channel.to_le_bytes());
    data.extend([point.class, 0]);
}

fn lidar_return(element: &[u8], data: &mut Vec<u8>) {
    let point: LidarReturn = bytemuck::pod_read_unaligned(element);
    let [x, y, z] = point.hit_in_sensor_m;
    let (intensity, time_s) = (
        f32::from(point.intensity) / 65_535.0,
        point.time_ns as f32 * 1e-9,
    );
    floats(data, &[x, y, z, intensity, time_s]);
    data.extend(point.object_id.to_le_bytes());
    data.extend(point.ring.to_le_bytes());
    data.extend([point.returns, point.class]);
    data.extend(point.time_ns.to_le_bytes());
    data.extend(point.range_mm_lsb.to_le_bytes());
    data.extend(point.ambient.to_le_bytes());
    data.extend([point.reflectivity, point.flags, 0, 0]);
}

fn radar(element: &[u8], data: &mut Vec<u8>) {
    let hit: RadarDetection = bytemuck::pod_read_unaligned(element);
    let (azimuth, elevation) = (hit.azimuth_rad, hit.altitude_rad);
    let flat = hit.depth_m * elevation.cos();
    floats(
        data,
        &[
            flat * azimuth.cos(),
            flat * azimuth.sin(),
            hit.depth_m * elevation.sin(),
            hit.velocity_mps,
            azimuth,
            elevation,
            hit.depth_m,
        ],
    );
    data.extend(hit.object_id.to_le_bytes());
    data.extend([hit.class, 0, 0, 0]);
}

fn floats(data: &mut Vec<u8>, values: &[f32]) {
    data.extend(values.iter().flat_map(|value| value.to_le_bytes()));
}

/// Writes `sensor_msgs/Imu`: what was measured, with gravity in the acceleration, as REP 145 has it;
/// the orientation is that of the sensor's true pose.
pub fn imu(out: &mut Writer, of: &FrameHeader, sample: &ImuSample, frame_id: &str) {
    begin(out, of.sim_nanos, frame_id)
        .f64s(&of.world_from_sensor.rotation_xyzw)
        .f64s(&[0.0; 9])
        .f64s(&sample.angular_velocity_radps)
        .f64s(&[0.0; 9])
        .f64s(&sample.specific_force_mps2)
        .f64s(&[0.0; 9]);
}

/// Writes `sensor_msgs/NavSatFix` with a fix by GPS and unknown covariance.
pub fn nav_sat_fix(out: &mut Writer, of: &FrameHeader, sample: &GnssSample, frame_id: &str) {
    begin(out, of.sim_nanos, frame_id)
        .i8(0) // a fix, without augmentation
        .u16(1) // GPS
        .f64s(&[sample.latitude_deg, sample.longitude_deg, sample.altitude_m])
        .f64s(&[0.0; 9])
        .u8(0); // covariance unknown
}

/// Writes `event_camera_msgs/EventPacket` with words of EVT 3.0, which go on from packet to packet.
///
/// # Errors
/// [`FrameError`] if there are 4 GiB of words.
pub fn events(
    out: &mut Writer,
    of: &FrameHeader,
    size_px: (u32, u32),
    words: &[u8],
    frame_id: &str,
) -> Result<(), FrameError> {
    begin(out, of.sim_nanos, frame_id)
        .u32(size_px.1)
        .u32(size_px.0)
        .u64(of.seq)
        .u64(0)
        .text("evt3")
        .u8(0)
        .sequence(words)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::read;
    use super::*;

    fn cloud(modality: Modality, elements: &[u8]) -> read::PointCloud {
        let mut header = FrameHeader::new(modality);
        header.set_list((elements.len() / modality.element_bytes()) as u32);
        let mut out = Writer::default();
        points(&mut out, &header, elements, "ego/sensor").unwrap();
        read::point_cloud(out.bytes()).unwrap()
    }

    fn place(of: &read::PointCloud, name: &str) -> usize {
        let field = of.fields.iter().find(|field| field.name == name);
        field.expect("a field of this name").offset
    }

    #[test]
    fn a_radar_hit_lies_where_its_angles_say() {
        let mut hit: RadarDetection = bytemuck::Zeroable::zeroed();
        hit.azimuth_rad = std::f32::consts::FRAC_PI_2;
        hit.depth_m = 10.0;
        (hit.object_id, hit.class) = (77, 14);
        let seen = cloud(Modality::Radar, bytemuck::bytes_of(&hit));
        assert_eq!((seen.stride, seen.data.len()), (36, 36));
        let xyz: Vec<f32> = seen.data[..12]
            .chunks_exact(4)
            .map(bytemuck::pod_read_unaligned)
            .collect();
        assert!(xyz[0].abs() < 1e-5 && (xyz[1] - 10.0).abs() < 1e-5 && xyz[2] == 0.0);
        assert_eq!(seen.data[place(&seen, "object_id")..][..4], [77, 0, 0, 0]);
        assert_eq!(seen.data[place(&seen, "class")], 14);
    }

    #[test]
    fn a_labelled_point_has_its_fields_where_they_are_announced() {
        let point = SemanticLidarPoint {
            hit_in_sensor_m: [1.0, 2.0, 3.0],
            cos_incidence: 0.5,
            object_id: 0x8000_0007,
            class: 14,
            channel: 9,
            ..bytemuck::Zeroable::zeroed()
        };
        let seen = cloud(Modality::SemanticLidar, bytemuck::bytes_of(&point));
        assert_eq!(
            seen.data[place(&seen, "cos_incidence")..][..4],
            0.5f32.to_le_bytes()
        );
        assert_eq!(seen.data[place(&seen, "object_id")..][..4], [7, 0, 0, 0x80]);
        assert_eq!(seen.data[place(&seen, "ring")..][..2], [9, 0]);
        assert_eq!((seen.data[place(&seen, "class")], seen.stride), (14, 24));
    }

    #[test]
    fn an_image_loses_its_padding_and_normals_become_floats() {
        let mut header = FrameHeader::new(Modality::Normals);
        header.set_image(1, 2);
        let mut pixel = Vec::new();
        for half in [0x3c00u16, 0xbc00, 0x3555, 0] {
            pixel.extend(half.to_le_bytes());
        }
        header.row_stride = 16;
        let payload = [&pixel[..], &[9; 8], &pixel, &[9; 8]].concat();
        let mut out = Writer::default();
        image(&mut out, &header, &payload, "ego/front_optical").unwrap();
        let seen = read::image(out.bytes()).unwrap();
        assert_eq!((seen.step, seen.encoding.as_str()), (12, "32FC3"));
        let numbers: Vec<f32> = seen
            .data
            .chunks_exact(4)
            .map(bytemuck::pod_read_unaligned)
            .collect();
        assert_eq!(numbers, [1.0, -1.0, 0.333_251_95, 1.0, -1.0, 0.333_251_95]);
        let refused = image(&mut out, &FrameHeader::new(Modality::Imu), &[], "");
        assert_eq!(refused, Err(FrameError::Modality(Some(Modality::Imu))));
    }
}
