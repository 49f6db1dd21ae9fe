//! Files of other programs: their images, point clouds, inertial and position messages as frames.
//!
//! A topic `/camera/front/image` becomes `camera/front/image/rgb`. Times count from the file's first
//! message, and messages within a millisecond are one tick. What has no frame of ours is said once,
//! with the reason.

mod error;
mod picture;
mod points;

use std::collections::BTreeMap;
use std::sync::Arc;

use consumer_forms::ros2::read as ros2;
use foxglove::Decode as _;
use foxglove::messages as fox;
use schema_frames::{FrameHeader, GnssSample, ImuSample, Modality};
use schema_recording::read::{RecordingFile, Topic};

pub use error::ForeignError;
use picture::Picture;
use points::Cloud;

/// Length of a tick of a file that has none.
pub const FOREIGN_TICK_NANOS: u64 = 1_000_000;

/// How a message becomes a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Conversion {
    /// `foxglove.RawImage`, `foxglove.CompressedImage` and ROS 2's, as colour or depth.
    Image(Source, Modality),
    /// As above, coded as PNG or JPEG.
    CodedImage(Source),
    /// `foxglove.PointCloud`, `sensor_msgs/msg/PointCloud2`.
    Cloud(Source),
    /// `foxglove.LocationFix`, `sensor_msgs/msg/NavSatFix`.
    Position(Source),
    /// `sensor_msgs/msg/Imu`.
    Inertial,
}

/// Whose message it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// Foxglove's, in protobuf.
    Foxglove,
    /// ROS 2's, in CDR.
    Ros2,
}

impl Conversion {
    /// Modality of its frames.
    pub fn modality(self) -> Modality {
        match self {
            Conversion::Image(_, modality) => modality,
            Conversion::CodedImage(_) => Modality::Rgb,
            Conversion::Cloud(_) => Modality::Lidar,
            Conversion::Position(_) => Modality::Gnss,
            Conversion::Inertial => Modality::Imu,
        }
    }
}

/// How the messages of a topic become frames, and the payload of the first one; `None` if they say
/// something about other topics.
///
/// # Errors
/// Why they cannot.
pub fn plan(topic: &Topic, first: &[u8]) -> Result<Option<(Conversion, usize)>, ForeignError> {
    let of = match (topic.schema.as_str(), topic.encoding.as_str()) {
        ("foxglove.CameraCalibration", "protobuf") => return Ok(None),
        ("foxglove.RawImage", "protobuf") => Conversion::Image(Source::Foxglove, Modality::Rgb),
        ("foxglove.CompressedImage", "protobuf") => Conversion::CodedImage(Source::Foxglove),
        ("foxglove.PointCloud", "protobuf") => Conversion::Cloud(Source::Foxglove),
        ("foxglove.LocationFix", "protobuf") => Conversion::Position(Source::Foxglove),
        ("sensor_msgs/msg/Image", "cdr") => Conversion::Image(Source::Ros2, Modality::Rgb),
        ("sensor_msgs/msg/CompressedImage", "cdr") => Conversion::CodedImage(Source::Ros2),
        ("sensor_msgs/msg/PointCloud2", "cdr") => Conversion::Cloud(Source::Ros2),
        ("sensor_msgs/msg/NavSatFix", "cdr") => Conversion::Position(Source::Ros2),
        ("sensor_msgs/msg/Imu", "cdr") => Conversion::Inertial,
        (schema, encoding) => {
            let schema = match schema {
                "" => "messages without a schema",
                named => named,
            };
            return Err(ForeignError::Unknown {
                schema: schema.to_owned(),
                encoding: encoding.to_owned(),
            });
        }
    };
    // Whether an image is colour or depth is in the message.
    let of = match of {
        Conversion::Image(source, _) => Conversion::Image(source, raw(source, first)?.modality()?),
        other => other,
    };
    let mut made = Made::default();
    made.fill(of, first)?;
    Ok(Some((of, made.bytes.len())))
}

/// Name of the frames of a foreign topic.
pub fn name(topic: &str, modality: Modality) -> String {
    let mut parts: Vec<&str> = topic.split('/').filter(|part| !part.is_empty()).collect();
    if parts.len() >= 3 && parts.last() == Some(&modality.name()) {
        parts.pop();
    }
    if parts.len() < 2 {
        parts.insert(0, "foreign");
    }
    parts.push(modality.name());
    parts.join("/")
}

/// A frame that is being made of a message; its memory is used again.
#[derive(Debug, Default)]
struct Made {
    bytes: Vec<u8>,
    /// Width and height of images, number of elements and 1 of lists.
    size: [u32; 2],
    frame_id: String,
}

impl Made {
    fn fill(&mut self, of: Conversion, message: &[u8]) -> Result<(), ForeignError> {
        self.bytes.clear();
        match of {
            Conversion::Image(source, modality) => {
                let picture = raw(source, message)?;
                self.size = [picture.width, picture.height];
                self.frame_id.clone_from(&picture.frame_id);
                picture.write(modality, &mut self.bytes)
            }
            Conversion::CodedImage(source) => {
                let (frame_id, coded) = coded(source, message)?;
                self.frame_id = frame_id;
                self.size = picture::decode(&coded, &mut self.bytes)?;
                Ok(())
            }
            Conversion::Cloud(source) => {
                let cloud = match source {
                    Source::Foxglove => Cloud::of_foxglove(&decoded(message)?),
                    Source::Ros2 => Cloud::of_ros2(ros2::point_cloud(message)?),
                };
                self.size = [cloud.write(&mut self.bytes)?, 1];
                Ok(())
            }
            Conversion::Position(source) => {
                let [latitude_deg, longitude_deg, altitude_m] = match source {
                    Source::Foxglove => {
                        let fix: fox::LocationFix = decoded(message)?;
                        [fix.latitude, fix.longitude, fix.altitude]
                    }
                    Source::Ros2 => ros2::nav_sat_fix(message)?,
                };
                let sample = GnssSample {
                    latitude_deg,
                    longitude_deg,
                    altitude_m,
                    ..bytemuck::Zeroable::zeroed()
                };
                self.one(bytemuck::bytes_of(&sample))
            }
            Conversion::Inertial => {
                let sample: ImuSample = ros2::imu(message)?;
                self.one(bytemuck::bytes_of(&sample))
            }
        }
    }

    fn one(&mut self, sample: &[u8]) -> Result<(), ForeignError> {
        self.size = [1, 1];
        self.bytes.extend_from_slice(sample);
        Ok(())
    }
}

fn decoded<M: foxglove::Decode>(message: &[u8]) -> Result<M, ForeignError> {
    M::decode(message).map_err(|error| ForeignError::Protobuf(error.to_string()))
}

fn raw(source: Source, message: &[u8]) -> Result<Picture, ForeignError> {
    match source {
        Source::Foxglove => Ok(Picture::of_foxglove(decoded(message)?)),
        Source::Ros2 => Ok(Picture::of_ros2(ros2::image(message)?)),
    }
}

/// Name of the axes, and the file.
fn coded(source: Source, message: &[u8]) -> Result<(String, Vec<u8>), ForeignError> {
    match source {
        Source::Foxglove => {
            let image: fox::CompressedImage = decoded(message)?;
            Ok((image.frame_id, image.data.to_vec()))
        }
        Source::Ros2 => {
            let image = ros2::compressed_image(message)?;
            Ok((image.frame_id, image.file))
        }
    }
}

/// Makes frames of messages.
#[derive(Debug)]
pub struct Converter {
    topics: BTreeMap<Arc<str>, (usize, Conversion)>,
    calibrations: BTreeMap<Arc<str>, String>,
    /// By name of the axes: focal lengths and principal point, pixels.
    intrinsics: BTreeMap<String, [f64; 4]>,
    start_nanos: u64,
    /// Number of the tick, and the time of its first message.
    ticks: (u64, u64),
    made: Made,
    said: bool,
}

impl Converter {
    /// Converts topics, which have these numbers; the file begins at `start_nanos`.
    pub fn new(
        file: &RecordingFile,
        topics: impl Iterator<Item = (Arc<str>, (usize, Conversion))>,
        start_nanos: u64,
    ) -> Converter {
        let calibrations = file
            .topics()
            .iter()
            .filter(|topic| topic.schema == "foxglove.CameraCalibration")
            .map(|topic| (topic.name.clone(), topic.schema.clone()));
        Converter {
            topics: topics.collect(),
            calibrations: calibrations.collect(),
            intrinsics: BTreeMap::new(),
            start_nanos,
            ticks: (0, 0),
            made: Made::default(),
            said: false,
        }
    }

    /// Time of the file's first message.
    pub fn start_nanos(&self) -> u64 {
        self.start_nanos
    }

    /// Number of the tick, and its time.
    pub fn ticks(&self) -> (u64, u64) {
        self.ticks
    }

    /// Goes back to a tick.
    pub fn set_ticks(&mut self, ticks: (u64, u64)) {
        self.ticks = ticks;
    }

    /// The frame of a message: its topic's number in the plan, header and bytes; `None` if there is
    /// none.
    pub fn convert(
        &mut self,
        topic: &Arc<str>,
        message: &[u8],
        log_nanos: u64,
    ) -> Option<(usize, FrameHeader, &[u8])> {
        if self.calibrations.contains_key(topic) {
            self.calibrate(message);
            return None;
        }
        let (idx, of) = *self.topics.get(topic)?;
        if let Err(why) = self.made.fill(of, message) {
            if !std::mem::replace(&mut self.said, true) {
                tracing::warn!(
                    "a message of {topic} is left out: {why}; further ones without a line"
                );
            }
            return None;
        }
        let nanos = log_nanos.saturating_sub(self.start_nanos);
        let (tick, began) = self.ticks;
        if tick == 0 || nanos >= began.saturating_add(FOREIGN_TICK_NANOS) {
            self.ticks = (tick.saturating_add(1), nanos);
        }
        let modality = of.modality();
        let mut header = FrameHeader::new(modality);
        let [width, height] = self.made.size;
        header.set_image(width, height);
        header.sensor_id = u32::try_from(idx).unwrap_or(u32::MAX).saturating_add(1);
        (header.tick, header.sim_nanos) = self.ticks;
        header.episode = 1;
        if let Some(intrinsics) = self.intrinsics.get(&self.made.frame_id) {
            header.intrinsics_px = *intrinsics;
        }
        (header.payload_bytes == self.made.bytes.len() as u64).then_some((
            idx,
            header,
            &self.made.bytes[..],
        ))
    }

    /// Keeps what a calibration says about the images of its axes. It counts from pixel centres.
    fn calibrate(&mut self, message: &[u8]) {
        let Ok(found) = fox::CameraCalibration::decode(message) else {
            return;
        };
        if let [fx, _, cx, _, fy, cy, ..] = found.k[..] {
            self.intrinsics
                .insert(found.frame_id, [fx, fy, cx + 0.5, cy + 0.5]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_a_rig_a_sensor_and_a_modality() {
        for (topic, modality, expected) in [
            ("imu", Modality::Imu, "foreign/imu/imu"),
            ("camera/image", Modality::Rgb, "camera/image/rgb"),
            ("a/b/c/depth", Modality::Depth, "a/b/c/depth"),
            ("car/front/rgb", Modality::Rgb, "car/front/rgb"),
            ("car/rgb", Modality::Rgb, "car/rgb/rgb"),
        ] {
            assert_eq!(name(topic, modality), expected);
        }
    }
}
