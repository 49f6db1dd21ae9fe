//! Converts a sensor frame into the messages that are recorded: header and payload in, encoded
//! messages out. A payload is copied once, from shared memory into the encoded message.

use bytemuck::pod_read_unaligned;
use foxglove::messages as fox;
use schema_frames::{DvsEvent, FrameHeader, GnssSample, ImuSample, Modality};

use crate::palette;
use schema_recording::messages::{Content, Entry, encoded};
use schema_recording::wire::{put_bytes, put_double, put_fixed64, put_varint};

/// Names of a topic `rig/sensor/modality` in the recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TopicName {
    /// `/rig/sensor/modality`.
    pub channel: String,
    /// `/rig/sensor`.
    pub sensor_channel: String,
    /// Foxglove's id of the sensor's axes: `rig/sensor`, x forward.
    pub frame_id: String,
    /// Foxglove's id of its parent's axes: `rig`.
    pub rig: String,
}

impl TopicName {
    /// Splits a topic without its domain; `None` unless it has a modality at its end and something
    /// before it.
    pub fn new(topic: &str) -> Option<TopicName> {
        let (sensor, modality) = topic.rsplit_once('/')?;
        let (rig, _) = sensor.split_once('/')?;
        Modality::from_name(modality)?;
        Some(TopicName {
            channel: format!("/{topic}"),
            sensor_channel: format!("/{sensor}"),
            frame_id: sensor.to_string(),
            rig: rig.to_string(),
        })
    }

    /// Foxglove's id of the axes of images: z forward, x to the right.
    pub fn optical_frame_id(&self) -> String {
        format!("{}/optical", self.frame_id)
    }
}

/// Simulated time as Foxglove writes it.
pub fn timestamp(nanos: u64) -> fox::Timestamp {
    let secs = u32::try_from(nanos / 1_000_000_000).unwrap_or(u32::MAX);
    fox::Timestamp::new(secs, (nanos % 1_000_000_000) as u32)
}

/// A vector as Foxglove writes it.
pub fn vector(v: [f64; 3]) -> fox::Vector3 {
    fox::Vector3 {
        x: v[0],
        y: v[1],
        z: v[2],
    }
}

/// A quaternion `[x, y, z, w]` as Foxglove writes it.
pub fn quaternion(q: [f64; 4]) -> fox::Quaternion {
    fox::Quaternion {
        x: q[0],
        y: q[1],
        z: q[2],
        w: q[3],
    }
}

/// Largest image that is made of a list of events: a header may claim any size.
const MAX_IMAGE_BYTES: u64 = 256 << 20;

/// The messages of a frame: a lossless `gantry.Frame`, and one that other programs can show, if
/// there is a type for it.
///
/// `payload` must be the bytes in use and `header` must have passed [`FrameHeader::check`]. `reuse`
/// hands in buffers to write into.
pub fn frame_entries(
    name: &TopicName,
    header: &FrameHeader,
    payload: &[u8],
    reuse: &mut dyn FnMut(usize) -> Vec<u8>,
) -> Vec<Entry> {
    let Some(modality) = header.modality() else {
        return Vec::new();
    };
    let shown = match modality {
        Modality::Rgb => Some((image(name, header, "bgra8", payload, reuse), true)),
        Modality::Depth => Some((image(name, header, "32FC1", payload, reuse), true)),
        Modality::Semantic => Some((image(name, header, "mono8", payload, reuse), true)),
        Modality::Instance => Some((low_ids(name, header, payload, reuse), false)),
        Modality::Dvs => events_image(name, header, payload).map(|entry| (entry, false)),
        Modality::Lidar | Modality::SemanticLidar | Modality::LidarReturns => {
            Some((cloud(name, header, modality, payload, reuse), true))
        }
        Modality::Imu => {
            one::<ImuSample>(payload).map(|sample| (imu(name, header, &sample), false))
        }
        Modality::Gnss => {
            one::<GnssSample>(payload).map(|sample| (location(name, header, &sample), false))
        }
        _ => None,
    };
    let payload_elsewhere = matches!(shown, Some((_, true)));
    let kept = (!payload_elsewhere).then_some(payload);
    let mut entries = vec![frame(name, header, kept, payload_elsewhere, "", reuse)];
    entries.extend(shown.map(|(entry, _)| entry));
    entries
}

/// The lossless message: the payload as `codec` has coded it, or the name of the topic whose `data`
/// holds it.
pub fn frame(
    name: &TopicName,
    header: &FrameHeader,
    payload: Option<&[u8]>,
    is_elsewhere: bool,
    codec: &str,
    reuse: &mut dyn FnMut(usize) -> Vec<u8>,
) -> Entry {
    let mut bytes = reuse(payload.map_or(0, <[u8]>::len) + 512);
    put_fixed64(&mut bytes, 1, header.tick);
    put_fixed64(&mut bytes, 2, header.sim_nanos);
    put_fixed64(&mut bytes, 3, header.seq);
    put_bytes(&mut bytes, 4, bytemuck::bytes_of(header));
    if let Some(payload) = payload {
        put_bytes(&mut bytes, 5, payload);
    }
    if is_elsewhere {
        put_bytes(&mut bytes, 6, name.channel.as_bytes());
    }
    if !codec.is_empty() {
        put_bytes(&mut bytes, 7, codec.as_bytes());
    }
    Entry {
        topic: format!("{}/gantry", name.channel),
        content: Content::Frame,
        bytes,
    }
}

/// A message whose last field is `data`. The field is appended by hand, so that the pixels are
/// copied only once.
pub fn with_data<M: foxglove::Encode>(
    head: &M,
    data: &[u8],
    reuse: &mut dyn FnMut(usize) -> Vec<u8>,
) -> Vec<u8> {
    let mut bytes = encoded(head, reuse(data.len() + 1024));
    put_bytes(&mut bytes, DATA_FIELD, data);
    bytes
}

/// Number of `data` in `foxglove.RawImage` and `foxglove.PointCloud`.
pub const DATA_FIELD: u32 = 6;

fn image_head(
    name: &TopicName,
    header: &FrameHeader,
    encoding: &str,
    size_px: [u32; 2],
    step: u32,
) -> fox::RawImage {
    fox::RawImage {
        timestamp: Some(timestamp(header.sim_nanos)),
        frame_id: name.optical_frame_id(),
        width: size_px[0],
        height: size_px[1],
        encoding: encoding.to_string(),
        step,
        ..Default::default()
    }
}

fn image(
    name: &TopicName,
    header: &FrameHeader,
    encoding: &str,
    payload: &[u8],
    reuse: &mut dyn FnMut(usize) -> Vec<u8>,
) -> Entry {
    let head = image_head(
        name,
        header,
        encoding,
        [header.width, header.height],
        header.row_stride,
    );
    Entry {
        topic: name.channel.clone(),
        content: Content::RawImage,
        bytes: with_data(&head, payload, reuse),
    }
}

/// Instance ids as an image for people: their low 16 bits.
fn low_ids(
    name: &TopicName,
    header: &FrameHeader,
    payload: &[u8],
    reuse: &mut dyn FnMut(usize) -> Vec<u8>,
) -> Entry {
    let n_bytes = header.width as usize * header.height as usize * 2;
    let head = image_head(
        name,
        header,
        "mono16",
        [header.width, header.height],
        header.width * 2,
    );
    let mut bytes = encoded(&head, reuse(n_bytes + 1024));
    put_varint(&mut bytes, (DATA_FIELD as u64) << 3 | 2);
    put_varint(&mut bytes, n_bytes as u64);
    for row in rows(header, payload) {
        bytes.extend(row.chunks_exact(4).flat_map(|id| [id[0], id[1]]));
    }
    Entry {
        topic: name.channel.clone(),
        content: Content::RawImage,
        bytes,
    }
}

/// The rows of an image without their padding.
fn rows<'a>(header: &FrameHeader, payload: &'a [u8]) -> impl Iterator<Item = &'a [u8]> + use<'a> {
    let (stride, row_bytes) = (
        header.row_stride as usize,
        header.width as usize * header.element_bytes as usize,
    );
    (0..header.height as usize).map(move |row| &payload[row * stride..row * stride + row_bytes])
}

/// Size of the image that a list of events belongs to. The list carries no size, but the principal
/// point is the middle of the image.
pub fn image_size_px(header: &FrameHeader) -> Option<[u32; 2]> {
    let [_, _, cx, cy] = header.intrinsics_px;
    let size = [(2.0 * cx).round(), (2.0 * cy).round()];
    let usable = |px: f64| (1.0..=65_536.0).contains(&px);
    (usable(size[0]) && usable(size[1])).then(|| size.map(|px| px as u32))
}

/// Events of a window as an image: red where the last change was brighter, blue where it was
/// darker, dark grey elsewhere.
fn events_image(name: &TopicName, header: &FrameHeader, payload: &[u8]) -> Option<Entry> {
    let [width, height] = image_size_px(header)?;
    let n_bytes = width as u64 * height as u64 * 3;
    if n_bytes > MAX_IMAGE_BYTES {
        return None;
    }
    let [nothing, darker, brighter] = palette::EVENTS;
    let mut pixels = nothing.repeat(n_bytes as usize / 3);
    for bytes in payload.chunks_exact(size_of::<DvsEvent>()) {
        let event: DvsEvent = pod_read_unaligned(bytes);
        if (event.x_px as u32) < width && (event.y_px as u32) < height {
            let at = (event.y_px as usize * width as usize + event.x_px as usize) * 3;
            let colour = if event.polarity == 1 {
                brighter
            } else {
                darker
            };
            pixels[at..at + 3].copy_from_slice(&colour);
        }
    }
    let head = image_head(name, header, "rgb8", [width, height], width * 3);
    Some(Entry {
        topic: name.channel.clone(),
        content: Content::RawImage,
        bytes: with_data(&head, &pixels, &mut |n| Vec::with_capacity(n)),
    })
}

/// Name, offset and type of each field of a point, as in `schema_frames`.
fn point_fields(modality: Modality) -> Vec<fox::PackedElementField> {
    use fox::packed_element_field::NumericType::{Float32, Int32, Uint8, Uint16, Uint32};
    let mut fields = vec![("x", 0, Float32), ("y", 4, Float32), ("z", 8, Float32)];
    fields.extend(match modality {
        Modality::SemanticLidar => {
            vec![
                ("cos_incidence", 12, Float32),
                ("object_id", 16, Uint32),
                ("class", 20, Uint8),
                ("channel", 22, Uint16),
            ]
        }
        Modality::LidarReturns => {
            vec![
                ("time_ns", 12, Int32),
                ("object_id", 16, Uint32),
                ("intensity", 20, Uint16),
                ("ring", 22, Uint16),
                ("reflectivity", 24, Uint8),
                ("returns", 25, Uint8),
                ("class", 26, Uint8),
                ("flags", 27, Uint8),
                ("ambient", 28, Uint16),
                ("range_mm_lsb", 30, Uint16),
            ]
        }
        _ => vec![("intensity", 12, Uint16), ("channel", 14, Uint16)],
    });
    fields
        .into_iter()
        .map(|(name, offset, kind)| fox::PackedElementField {
            name: name.to_string(),
            offset,
            r#type: kind as i32,
        })
        .collect()
}

fn cloud(
    name: &TopicName,
    header: &FrameHeader,
    modality: Modality,
    payload: &[u8],
    reuse: &mut dyn FnMut(usize) -> Vec<u8>,
) -> Entry {
    Entry {
        topic: name.channel.clone(),
        content: Content::PointCloud,
        bytes: with_data(&cloud_head(name, header, modality), payload, reuse),
    }
}

/// Everything of a cloud but its points.
pub fn cloud_head(name: &TopicName, header: &FrameHeader, modality: Modality) -> fox::PointCloud {
    fox::PointCloud {
        timestamp: Some(timestamp(header.sim_nanos)),
        frame_id: name.frame_id.clone(),
        pose: Some(fox::Pose {
            position: Some(vector([0.0; 3])),
            orientation: Some(quaternion([0.0, 0.0, 0.0, 1.0])),
        }),
        point_stride: header.element_bytes,
        fields: point_fields(modality),
        ..Default::default()
    }
}

fn one<T: bytemuck::AnyBitPattern>(payload: &[u8]) -> Option<T> {
    payload.get(..size_of::<T>()).map(pod_read_unaligned)
}

fn imu(name: &TopicName, header: &FrameHeader, sample: &ImuSample) -> Entry {
    let mut bytes = Vec::with_capacity(128);
    put_fixed64(&mut bytes, 1, header.sim_nanos);
    put_bytes(&mut bytes, 2, name.frame_id.as_bytes());
    let values = sample
        .specific_force_mps2
        .iter()
        .chain(&sample.angular_velocity_radps)
        .chain([&sample.compass_rad]);
    for (idx, value) in values.enumerate() {
        put_double(&mut bytes, 3 + idx as u32, *value);
    }
    Entry {
        topic: name.channel.clone(),
        content: Content::Imu,
        bytes,
    }
}

fn location(name: &TopicName, header: &FrameHeader, sample: &GnssSample) -> Entry {
    let fix = fox::LocationFix {
        timestamp: Some(timestamp(header.sim_nanos)),
        frame_id: name.frame_id.clone(),
        latitude: sample.latitude_deg,
        longitude: sample.longitude_deg,
        altitude: sample.altitude_m,
        ..Default::default()
    };
    Entry::foxglove(name.channel.clone(), Content::LocationFix, &fix)
}

/// Calibration of a camera; `None` if the header has no intrinsics.
///
/// Foxglove counts from pixel centres, so the principal point moves by half a pixel.
pub fn calibration(name: &TopicName, header: &FrameHeader) -> Option<Entry> {
    let [fx, fy, cx, cy] = header.intrinsics_px;
    let [width, height] = image_size_px(header)?;
    if !(fx > 0.0 && fy > 0.0) {
        return None;
    }
    let (cx, cy) = (cx - 0.5, cy - 0.5);
    let message = fox::CameraCalibration {
        timestamp: Some(timestamp(header.sim_nanos)),
        frame_id: name.optical_frame_id(),
        width,
        height,
        distortion_model: "plumb_bob".to_string(),
        d: vec![0.0; 5],
        k: vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: vec![fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    };
    Some(Entry::foxglove(
        format!("{}/calibration", name.sensor_channel),
        Content::CameraCalibration,
        &message,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use foxglove::Decode;
    use schema_recording::wire::{Value, bytes_field, fields};

    fn fresh(n: usize) -> Vec<u8> {
        Vec::with_capacity(n)
    }

    fn rgb() -> (TopicName, FrameHeader, Vec<u8>) {
        let mut header = FrameHeader::new(Modality::Rgb);
        header.set_image(5, 3);
        header.tick = 9;
        header.sim_nanos = 1_500_000_000;
        header.seq = 4;
        header.intrinsics_px = [4.0, 4.0, 2.5, 1.5];
        (
            TopicName::new("ego/front/rgb").unwrap(),
            header,
            (0..60).collect(),
        )
    }

    #[test]
    fn an_image_keeps_every_byte_and_its_header() {
        let (name, header, payload) = rgb();
        let entries = frame_entries(&name, &header, &payload, &mut fresh);
        assert_eq!(
            entries.iter().map(|e| e.topic.as_str()).collect::<Vec<_>>(),
            ["/ego/front/rgb/gantry", "/ego/front/rgb"]
        );
        assert_eq!(
            bytes_field(&entries[0].bytes, 4),
            Some(bytemuck::bytes_of(&header))
        );
        assert_eq!(
            bytes_field(&entries[0].bytes, 6),
            Some(&b"/ego/front/rgb"[..])
        );
        let image = fox::RawImage::decode(entries[1].bytes.as_slice()).unwrap();
        assert_eq!(
            (
                image.width,
                image.height,
                image.step,
                image.encoding.as_str()
            ),
            (5, 3, 20, "bgra8")
        );
        assert_eq!(image.data.as_ref(), payload);
        assert_eq!(image.timestamp, Some(fox::Timestamp::new(1, 500_000_000)));
        assert_eq!(image.frame_id, "ego/front/optical");
    }

    #[test]
    fn instance_ids_stay_whole_beside_their_picture() {
        let mut header = FrameHeader::new(Modality::Instance);
        header.set_image(2, 1);
        let payload = [0x11, 0x22, 0x33, 0x84, 5, 0, 0, 0];
        let entries = frame_entries(
            &TopicName::new("ego/front/instance").unwrap(),
            &header,
            &payload,
            &mut fresh,
        );
        assert_eq!(bytes_field(&entries[0].bytes, 5), Some(&payload[..]));
        let image = fox::RawImage::decode(entries[1].bytes.as_slice()).unwrap();
        assert_eq!(image.data.as_ref(), [0x11, 0x22, 5, 0]);
    }

    #[test]
    fn principal_point_moves_to_pixel_centres() {
        let (name, header, _) = rgb();
        let entry = calibration(&name, &header).unwrap();
        let message = fox::CameraCalibration::decode(entry.bytes.as_slice()).unwrap();
        assert_eq!((message.width, message.height), (5, 3));
        assert_eq!(message.k, [4.0, 0.0, 2.0, 0.0, 4.0, 1.0, 0.0, 0.0, 1.0]);
    }

    #[test]
    fn imu_fields_stand_where_the_schema_says() {
        let mut header = FrameHeader::new(Modality::Imu);
        header.set_list(1);
        let sample = ImuSample {
            specific_force_mps2: [1.0, 2.0, 9.81],
            angular_velocity_radps: [0.1, 0.2, 0.3],
            compass_rad: 3.0,
            reserved: [0; 2],
        };
        let entries = frame_entries(
            &TopicName::new("ego/imu/imu").unwrap(),
            &header,
            bytemuck::bytes_of(&sample),
            &mut fresh,
        );
        let doubles: Vec<f64> = fields(&entries[1].bytes)
            .filter_map(|(n, v)| {
                if let (3.., Value::Fixed64(bits)) = (n, v) {
                    Some(f64::from_bits(bits))
                } else {
                    None
                }
            })
            .collect();
        assert_eq!(doubles, [1.0, 2.0, 9.81, 0.1, 0.2, 0.3, 3.0]);
    }

    #[test]
    fn a_topic_without_modality_is_no_frame() {
        assert_eq!(TopicName::new("world/snapshot"), None);
        assert_eq!(TopicName::new("rgb"), None);
    }
}
