//! One topic of the domain as the topics of ROS 2 that it becomes.

use consumer_kit::{FollowedResult, Take};
use schema_bus::{Bus, BusError, Frame, FrameReader, ResultSample, ServicePorts, TopicKind, names};
use schema_frames::{About, Box2d, Box3d, Modality, ResultType, Space};

use crate::lookout::Left;
use crate::ros2::graph::{Node, Topic};
use crate::ros2::messages::{self, Found, MAP};
use crate::ros2::types;

/// One topic of the domain and what it becomes.
#[derive(Debug)]
pub struct Relay {
    topic: String,
    outputs: Vec<(Form, Topic)>,
    source: Source,
    /// Since when it has no writer.
    pub left: Left,
    refusal_said: bool,
}

#[derive(Debug)]
enum Source {
    Closed,
    Frames(FrameReader),
    Results(Box<FollowedResult>),
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
    /// Offers what `topic` becomes; `None` if it becomes nothing.
    ///
    /// # Errors
    /// What zenoh says.
    pub fn new(
        node: &Node,
        topic: &ServicePorts,
        wake: impl Fn() + Clone + Send + Sync + 'static,
    ) -> anyhow::Result<Option<Relay>> {
        let mut outputs = Vec::new();
        for (form, name, of) in outputs_of(topic) {
            outputs.push((form, node.publish(&name, &of, wake.clone())?));
        }
        Ok((!outputs.is_empty()).then(|| Relay {
            topic: topic.name.clone(),
            outputs,
            source: Source::Closed,
            left: Left::default(),
            refusal_said: false,
        }))
    }

    /// Name of the domain's topic.
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Whether it is read.
    pub fn is_open(&self) -> bool {
        !matches!(self.source, Source::Closed)
    }

    /// Begins to read if a node subscribes, and ends if none does. Returns whether it changed.
    ///
    /// # Errors
    /// None that waiting heals.
    pub fn open_or_close(&mut self, bus: &Bus) -> anyhow::Result<bool> {
        let is_wanted = self.outputs.iter().any(|(_, topic)| topic.is_wanted());
        if is_wanted == self.is_open() {
            return Ok(false);
        }
        self.source = Source::Closed;
        if !is_wanted {
            return Ok(true);
        }
        let opened = match self.outputs[0].0 {
            Form::Detections2d | Form::Detections3d => {
                let mut results = FollowedResult::new(&*self.topic, Take::All);
                let found = results.look(bus);
                found.map(|is_there| match is_there {
                    true => Source::Results(Box::new(results)),
                    false => Source::Closed,
                })
            }
            _ => bus.frame_reader(&self.topic).map(Source::Frames),
        };
        match opened {
            Ok(source) => self.source = source,
            Err(BusError::NoSuchTopic { .. } | BusError::Service { .. }) => {}
            Err(error) => {
                if !std::mem::replace(&mut self.refusal_said, true) {
                    tracing::warn!(topic = self.topic, %error, "a node of ROS 2 wants the topic, but it cannot be read; trying again");
                }
            }
        }
        Ok(self.is_open())
    }

    /// Sends what waits.
    ///
    /// # Errors
    /// What zenoh or the bus say.
    pub fn pass_on(&mut self, bus: &Bus) -> anyhow::Result<()> {
        match &mut self.source {
            Source::Closed => {}
            Source::Frames(reader) => {
                while let Some(frame) = passing_over(reader.next())? {
                    send(&self.outputs, |form| of_frame(form, &self.topic, &frame))?;
                }
            }
            Source::Results(results) => {
                // The description may come after the first result.
                results.look(bus)?;
                while let Some(result) = results.take()? {
                    send(&self.outputs, |form| {
                        of_result(form, &result, results.about())
                    })?;
                }
            }
        }
        Ok(())
    }
}

/// A sample that breaks the contract counts as none.
fn passing_over<T>(taken: Result<Option<T>, BusError>) -> Result<Option<T>, BusError> {
    match taken {
        Err(BusError::BadFrame { .. }) => Ok(None),
        other => other,
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
fn outputs_of(topic: &ServicePorts) -> Vec<(Form, String, types::Type)> {
    let own = format!("/carla/{}", topic.name);
    let last = topic.name.rsplit('/').next();
    let modality = last
        .and_then(Modality::from_name)
        // A batch only repeats the images of its cameras.
        .filter(|_| topic.kind() == TopicKind::Frames && !names::is_batch(&topic.name));
    match (modality, ResultType::from_name(&topic.result)) {
        (Some(modality), _) => {
            let sensor = own
                .rsplit_once('/')
                .map_or(own.as_str(), |(place, _)| place);
            let one = |form, of| vec![(form, sensor.to_owned(), of)];
            match modality {
                Modality::Lidar | Modality::SemanticLidar | Modality::Radar => {
                    one(Form::Points, types::POINT_CLOUD)
                }
                Modality::Imu => one(Form::Imu, types::IMU),
                Modality::Gnss => one(Form::NavSatFix, types::NAV_SAT_FIX),
                _ if !messages::is_image(modality) => Vec::new(),
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
        (None, Some(ResultType::Boxes2d)) => {
            vec![(Form::Detections2d, own, types::DETECTIONS_2D)]
        }
        (None, Some(ResultType::Boxes3d)) => {
            vec![(Form::Detections3d, own, types::DETECTIONS_3D)]
        }
        _ => Vec::new(),
    }
}

/// Frame of a topic's sensor: `ego/front` of `ego/front/rgb`; of images the optical one.
fn frame_id(topic: &str) -> String {
    let (sensor, last) = topic.rsplit_once('/').unwrap_or((topic, ""));
    match Modality::from_name(last).is_some_and(messages::is_image) {
        true => format!("{sensor}_optical"),
        false => sensor.to_owned(),
    }
}

fn of_frame(form: Form, topic: &str, frame: &Frame) -> Option<Vec<u8>> {
    let (header, id) = (frame.header(), frame_id(topic));
    match form {
        Form::Image => messages::image(header, frame, &id),
        Form::CompressedImage => messages::compressed_image(header, frame, &id),
        Form::CameraInfo => Some(messages::camera_info(header, &id)),
        Form::Points => messages::points(header, frame, &id),
        Form::Imu => messages::imu(header, frame, &id),
        Form::NavSatFix => messages::nav_sat_fix(header, frame, &id),
        Form::Detections2d | Form::Detections3d => None,
    }
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
    let found = Found {
        sim_nanos: header.sim_nanos,
        frame_id: &id,
        class_name: &|class| about.class_name(class),
    };
    match form {
        Form::Detections2d => Some(messages::detections_2d(&found, result.records::<Box2d>()?)),
        Form::Detections3d => Some(messages::detections_3d(&found, result.records::<Box3d>()?)),
        _ => None,
    }
}
