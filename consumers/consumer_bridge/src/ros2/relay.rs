//! One topic of the domain as the topics of ROS 2 that it becomes.

use consumer_forms::ros2::cdr::Writer;
use consumer_forms::ros2::sensors::{self, FrameError};
use consumer_forms::ros2::types;
use consumer_forms::ros2::world::{self, Detection2d, Detection3d, MAP};
use consumer_kit::{Calibrations, Domain, Take, TopicId, Wish};
use schema_bus::{BusError, ResultSample, TopicDetails, TopicKind, names};
use schema_frames::{About, Box2d, Box3d, Calibration, FrameHeader, Modality, ResultType, Space};

use crate::ros2::graph::{Node, Topic};

/// Quality of compressed images.
const JPEG_QUALITY: u8 = 85;

/// One topic of the domain and what it becomes.
#[derive(Debug)]
pub struct Relay {
    topic: String,
    outputs: Vec<(Form, Topic)>,
    refusal_said: bool,
    /// Whether it was said that ROS 2 has no words for its lens.
    lens_said: bool,
}

/// How a topic is to be known; `None` if it becomes nothing.
pub fn wish(topic: &TopicDetails) -> Option<Wish> {
    let wish = Wish::on_demand(Take::All);
    let wish = match topic.kind {
        TopicKind::Frames => wish.quietly(),
        _ => wish,
    };
    (!outputs_of(topic).is_empty()).then_some(wish)
}

/// What a message is made as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    Image,
    CompressedImage,
    CameraInfo,
    Points,
    Imu,
    NavSatFix,
    Detections2d,
    Detections3d,
}

impl Relay {
    /// Offers what `topic` becomes.
    ///
    /// # Errors
    /// What zenoh says.
    pub fn new(
        node: &Node,
        topic: &TopicDetails,
        wake: impl Fn() + Clone + Send + Sync + 'static,
    ) -> anyhow::Result<Relay> {
        let mut outputs = Vec::new();
        for (form, name, of) in outputs_of(topic) {
            outputs.push((form, node.publish(&name, &of, wake.clone())?));
        }
        Ok(Relay {
            topic: topic.name.clone(),
            outputs,
            refusal_said: false,
            lens_said: false,
        })
    }

    /// Whether a node subscribes.
    pub fn is_wanted(&self) -> bool {
        self.outputs.iter().any(|(_, topic)| topic.is_wanted())
    }

    /// Says once that the topic cannot be read.
    pub fn refuse(&mut self, error: &BusError) {
        if !std::mem::replace(&mut self.refusal_said, true) {
            tracing::warn!(topic = self.topic, %error, "a node of ROS 2 wants the topic, but it cannot be read; trying again");
        }
    }

    /// Sends what waits.
    ///
    /// # Errors
    /// What zenoh or the bus say.
    pub fn pass_on(
        &mut self,
        id: TopicId,
        domain: &mut Domain,
        calibrations: &mut Calibrations,
    ) -> anyhow::Result<()> {
        while let Some(frame) = domain.take_frame(id)? {
            let header = frame.header();
            let lens = match header.lens_model() {
                0 => None,
                _ => calibrations.of(domain.bus(), header)?,
            };
            self.say_if_unsaid(lens.as_deref());
            send(&self.outputs, |form| {
                of_frame(form, &self.topic, header, lens.as_deref(), &frame)
            })?;
        }
        while let Some(result) = domain.take_result(id)? {
            let Some(results) = domain.results(id) else {
                break;
            };
            send(&self.outputs, |form| {
                of_result(form, &result, results.about())
            })?;
        }
        Ok(())
    }

    /// Says once that ROS 2 has no words for a lens.
    fn say_if_unsaid(&mut self, lens: Option<&Calibration>) {
        if let Some(lens) = lens
            && !sensors::has_words_for(lens.lens())
            && !std::mem::replace(&mut self.lens_said, true)
        {
            tracing::warn!(
                topic = self.topic,
                "ROS 2 has no words for a lens of model {}; its camera_info says that it is not calibrated. It can say {}",
                lens.lens().model().name(),
                sensors::KNOWN_LENSES
            );
        }
    }
}

fn send(outputs: &[(Form, Topic)], make: impl Fn(Form) -> Option<Vec<u8>>) -> anyhow::Result<()> {
    for (form, topic) in outputs {
        if topic.is_wanted()
            && let Some(message) = make(*form)
        {
            topic.send(message)?;
        }
    }
    Ok(())
}

/// Topics of ROS 2 that a topic of the domain becomes.
fn outputs_of(topic: &TopicDetails) -> Vec<(Form, String, types::Type)> {
    // A batch only repeats the images of its cameras.
    let modality = topic.modality.filter(|_| !names::is_batch(&topic.name));
    let own = || format!("/carla/{}", topic.name);
    match (modality, topic.result) {
        (Some(modality), _) => outputs_of_frames(&topic.name, modality),
        (None, Some(ResultType::Boxes2d)) => {
            vec![(Form::Detections2d, own(), types::DETECTIONS_2D)]
        }
        (None, Some(ResultType::Boxes3d)) => {
            vec![(Form::Detections3d, own(), types::DETECTIONS_3D)]
        }
        _ => Vec::new(),
    }
}

/// Topics of ROS 2 that a topic of frames becomes.
fn outputs_of_frames(topic: &str, modality: Modality) -> Vec<(Form, String, types::Type)> {
    let own = format!("/carla/{topic}");
    let sensor = own
        .rsplit_once('/')
        .map_or(own.as_str(), |(place, _)| place);
    let one = |form, of| vec![(form, sensor.to_owned(), of)];
    match modality {
        Modality::Lidar | Modality::SemanticLidar | Modality::LidarReturns | Modality::Radar => {
            one(Form::Points, types::POINT_CLOUD)
        }
        Modality::Imu => one(Form::Imu, types::IMU),
        Modality::Gnss => one(Form::NavSatFix, types::NAV_SAT_FIX),
        _ if !is_image(modality) => Vec::new(),
        _ => {
            // The colour image is the sensor's own; others stand beside it.
            let place = match modality {
                Modality::Rgb => sensor,
                _ => own.as_str(),
            };
            let mut outputs = vec![
                (Form::Image, format!("{place}/image"), types::IMAGE),
                (
                    Form::CameraInfo,
                    format!("{place}/camera_info"),
                    types::CAMERA_INFO,
                ),
            ];
            if modality == Modality::Rgb {
                outputs.push((
                    Form::CompressedImage,
                    format!("{place}/image/compressed"),
                    types::COMPRESSED_IMAGE,
                ));
            }
            outputs
        }
    }
}

/// Frame of a topic's sensor: `ego/front` of `ego/front/rgb`; of images the optical one.
fn frame_id(topic: &str) -> String {
    let (sensor, last) = topic.rsplit_once('/').unwrap_or((topic, ""));
    match Modality::from_name(last).is_some_and(is_image) {
        true => format!("{sensor}_optical"),
        false => sensor.to_owned(),
    }
}

/// Whether frames of this modality are images of the node; normals have no encoding that tools of ROS
/// show.
fn is_image(modality: Modality) -> bool {
    modality.is_image() && modality != Modality::Normals
}

/// A message in memory of its own.
pub(super) fn message(write: impl FnOnce(&mut Writer)) -> Vec<u8> {
    let mut out = Writer::default();
    write(&mut out);
    out.into_bytes()
}

/// Every message that a frame of `topic` becomes, with its type.
pub fn frame_messages(
    topic: &str,
    header: &FrameHeader,
    lens: Option<&Calibration>,
    payload: &[u8],
) -> Vec<(types::Type, Vec<u8>)> {
    let modality = header.modality();
    let outputs = modality.map_or_else(Vec::new, |modality| outputs_of_frames(topic, modality));
    let message = |(form, _, of)| Some((of, of_frame(form, topic, header, lens, payload)?));
    outputs.into_iter().filter_map(message).collect()
}

fn of_frame(
    form: Form,
    topic: &str,
    header: &FrameHeader,
    lens: Option<&Calibration>,
    payload: &[u8],
) -> Option<Vec<u8>> {
    let mut out = Writer::default();
    frame_message(form, &frame_id(topic), header, lens, payload, &mut out)
        .ok()?
        .then(|| out.into_bytes())
}

/// Writes the message of a frame; false if it has none in this form.
fn frame_message(
    form: Form,
    id: &str,
    header: &FrameHeader,
    lens: Option<&Calibration>,
    payload: &[u8],
    out: &mut Writer,
) -> Result<bool, FrameError> {
    match form {
        Form::Image => sensors::image(out, header, payload, id)?,
        Form::CompressedImage => {
            let Some(file) = crate::coding::jpeg(header, payload, JPEG_QUALITY) else {
                return Ok(false);
            };
            sensors::compressed_image(out, header, &file, id)?;
        }
        Form::CameraInfo => {
            let size_px = (header.width, header.height);
            sensors::camera_info(out, header, lens, size_px, id);
        }
        Form::Points => sensors::points(out, header, payload, id)?,
        Form::Imu => {
            let Some(sample) = first(payload) else {
                return Ok(false);
            };
            sensors::imu(out, header, &sample, id);
        }
        Form::NavSatFix => {
            let Some(sample) = first(payload) else {
                return Ok(false);
            };
            sensors::nav_sat_fix(out, header, &sample, id);
        }
        Form::Detections2d | Form::Detections3d => return Ok(false),
    }
    Ok(true)
}

/// The first sample of a payload.
fn first<T: bytemuck::AnyBitPattern>(payload: &[u8]) -> Option<T> {
    payload
        .get(..size_of::<T>())
        .map(bytemuck::pod_read_unaligned)
}

fn of_result(form: Form, result: &ResultSample, about: &About) -> Option<Vec<u8>> {
    let header = result.header();
    let input = result.inputs().first().map(|input| input.topic());
    let input = input.unwrap_or_default();
    let id = match header.space() {
        Some(Space::Image) => frame_id(&input),
        Some(Space::Sensor) => {
            let sensor = input.rsplit_once('/').map(|(sensor, _)| sensor);
            sensor.unwrap_or(MAP).to_owned()
        }
        Some(Space::Vehicle) => schema_bus::names::rig_of(&input).to_owned(),
        _ => MAP.to_owned(),
    };
    match form {
        Form::Detections2d => {
            let found: Vec<Detection2d> = result
                .records::<Box2d>()?
                .iter()
                .map(|it| Detection2d {
                    class: about.class_name(it.class),
                    score: it.score,
                    id: it.id,
                    min_px: it.min_px,
                    max_px: it.max_px,
                })
                .collect();
            Some(message(|out| {
                world::detections_2d(out, header.sim_nanos, &id, &found);
            }))
        }
        Form::Detections3d => {
            let found: Vec<Detection3d> = result
                .records::<Box3d>()?
                .iter()
                .map(|it| Detection3d {
                    class: about.class_name(it.class),
                    score: it.score,
                    id: it.id,
                    pose: it.pose,
                    size_m: it.half_m.map(|half| 2.0 * f64::from(half)),
                })
                .collect();
            Some(message(|out| {
                world::detections_3d(out, header.sim_nanos, &id, &found);
            }))
        }
        _ => None,
    }
}
