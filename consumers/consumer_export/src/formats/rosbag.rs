//! ROS 2 bags: one folder per scenario, `<part>/<scenario>/`, with `metadata.yaml` and an MCAP file
//! that any ROS 2 from Humble on plays.

mod cdr;
mod definitions;
mod messages;
mod metadata;

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use anyhow::Context as _;
use nalgebra::Isometry3;
use schema_frames::{GnssSample, ImuSample, Modality};
use schema_recording::bag::{BagFile, BagMessage};
use schema_recording::scenery::SceneryBox;
use schema_recording::write::ChunkCompression;
use schema_types::space::sensor_from_camera;
use serde_json::json;

use self::cdr::Cdr;
use self::definitions::Message;
use self::messages::{MAP, Transform};
use self::metadata::{TopicCount, quality_of_service, yaml};
use super::evt3;
use super::evt3::words::Encoder;
use crate::exporter::{DoneScenario, Exporter};
use crate::options::Options;
use crate::tree::{PartFile, Tree};
use consumer_truth::Body;
use consumer_truth::scenario::{Scenario, Topic};
use consumer_truth::ticks::{TickFrame, TickSet};

/// Topics whose newest message holds until the next one, besides those of texts.
const LATCHED: [&str; 2] = ["/tf_static", "/world/scenery"];

/// Writes bags for ROS 2.
#[derive(Debug)]
pub struct Ros2Bag {
    cameras: Vec<String>,
    bag: Option<Bag>,
    cdr: Cdr,
    /// Words of event cameras, by topic.
    encoders: HashMap<Arc<str>, Encoder>,
    /// Objects of the map when their boxes were written last.
    scenery: Arc<[SceneryBox]>,
}

/// A bag under construction.
struct Bag {
    file: BagFile<PartFile>,
    channels: BTreeMap<String, (u16, TopicCount)>,
    /// Time of the first and the last message, nanoseconds.
    span: Option<(u64, u64)>,
}

impl std::fmt::Debug for Bag {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.debug_struct("Bag")
            .field("span", &self.span)
            .finish_non_exhaustive()
    }
}

impl Bag {
    fn write(&mut self, topic: &str, kind: Message, nanos: u64, cdr: &Cdr) -> anyhow::Result<()> {
        if !self.channels.contains_key(topic) {
            let latched = matches!(kind, Message::Text) || LATCHED.contains(&topic);
            let quality = ("offered_qos_profiles".into(), quality_of_service(latched));
            let id = self
                .file
                .channel(topic, &kind.schema(), &[quality].into())?;
            let count = TopicCount {
                name: topic.into(),
                kind: kind.name(),
                latched,
                n_messages: 0,
            };
            self.channels.insert(topic.into(), (id, count));
        }
        let (channel_id, count) = self.channels.get_mut(topic).context("it was just added")?;
        count.n_messages += 1;
        let (first, _) = self.span.unwrap_or((nanos, nanos));
        self.span = Some((first, nanos));
        let message = BagMessage {
            channel_id: *channel_id,
            sequence: count.n_messages as u32,
            log_nanos: nanos,
            publish_nanos: nanos,
        };
        self.file.write(message, cdr.bytes())
    }
}

/// A name as ROS allows it in topics: letters, digits and `_`, and no digit first.
fn ros_name(name: &str) -> String {
    let mut safe: String = name
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() { c } else { '_' })
        .collect();
    if safe.starts_with(|c: char| c.is_ascii_digit()) || safe.is_empty() {
        safe.insert(0, '_');
    }
    safe
}

/// What `world/info` says about the run, without what differs from start to start.
fn world_info(scenario: &Scenario) -> String {
    let info = &scenario.info;
    json!({
        "map": info.map, "seed": info.seed, "period_nanos": info.period_nanos,
        "weather": info.weather, "version": info.version, "adapter": info.adapter,
    })
    .to_string()
}

impl Ros2Bag {
    /// An exporter of all sensors; of cameras those that the options name, or all.
    pub fn new(options: &Options) -> Ros2Bag {
        Ros2Bag {
            cameras: options.cameras.clone(),
            bag: None,
            cdr: Cdr::new(),
            encoders: HashMap::new(),
            scenery: Arc::default(),
        }
    }

    fn frame(
        &mut self,
        scenario: &Scenario,
        frame: &TickFrame,
        bag: &mut Bag,
    ) -> anyhow::Result<()> {
        let (rig, sensor) = (&scenario.rig, frame.sensor());
        let base = format!("/{}/{}", ros_name(rig), ros_name(sensor));
        let own = format!("{rig}/{sensor}");
        let optical = format!("{own}_optical");
        let header = &frame.header;
        let cdr = &mut self.cdr;
        let nanos = header.sim_nanos;
        match frame.modality {
            modality if modality.is_image() => {
                let base = format!("{base}/{}", modality.name());
                messages::image(cdr, frame, &optical)?;
                bag.write(&format!("{base}/image_raw"), Message::Image, nanos, cdr)?;
                messages::camera_info(cdr, header, (header.width, header.height), &optical);
                bag.write(
                    &format!("{base}/camera_info"),
                    Message::CameraInfo,
                    nanos,
                    cdr,
                )
            }
            Modality::Dvs => {
                let size_px = evt3::size_px(header);
                let mut words = Vec::new();
                let encoder = self.encoders.entry(frame.topic.clone()).or_default();
                encoder.encode(&evt3::events(frame), &mut words)?;
                encoder.pass_time(nanos / 1000, &mut words);
                messages::events(cdr, header, size_px, &words, &optical)?;
                bag.write(
                    &format!("{base}/dvs/events"),
                    Message::EventPacket,
                    nanos,
                    cdr,
                )?;
                messages::camera_info(cdr, header, size_px, &optical);
                bag.write(
                    &format!("{base}/dvs/camera_info"),
                    Message::CameraInfo,
                    nanos,
                    cdr,
                )
            }
            Modality::Lidar | Modality::SemanticLidar | Modality::Radar => {
                let leaf = match frame.modality {
                    Modality::Lidar => "points",
                    Modality::SemanticLidar => "semantic_points",
                    _ => "detections",
                };
                messages::cloud(cdr, frame, &own)?;
                bag.write(&format!("{base}/{leaf}"), Message::PointCloud2, nanos, cdr)
            }
            Modality::Imu => {
                for sample in frame.elements::<ImuSample>() {
                    messages::imu(cdr, header, &sample, &own);
                    bag.write(&format!("{base}/data"), Message::Imu, nanos, cdr)?;
                }
                Ok(())
            }
            Modality::Gnss => {
                for sample in frame.elements::<GnssSample>() {
                    messages::fix(cdr, header, &sample, &own);
                    bag.write(&format!("{base}/fix"), Message::NavSatFix, nanos, cdr)?;
                }
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// Where the carrier and the sensors that have a frame are.
    fn transforms(scenario: &Scenario, tick: &TickSet) -> Vec<Transform> {
        let carrier = tick
            .world
            .as_ref()
            .and_then(|world| world.record(scenario.carrier_id))
            .map(|record| record.world_from_actor.isometry());
        let base = format!("{}/base_link", scenario.rig);
        let mut found: Vec<Transform> = Vec::new();
        if let Some(pose) = carrier {
            found.push(Transform {
                parent: MAP.into(),
                child: base.clone(),
                pose,
            });
        } else if scenario.carrier_id != 0 {
            return found;
        }
        for frame in &tick.frames {
            let child = format!("{}/{}", scenario.rig, frame.sensor());
            if found.iter().any(|it| it.child == child) {
                continue;
            }
            let world_from_sensor = frame.header.world_from_sensor.isometry();
            let (parent, pose) = match carrier {
                Some(carrier) => (base.clone(), carrier.inverse() * world_from_sensor),
                None => (MAP.into(), world_from_sensor),
            };
            found.push(Transform {
                parent,
                child,
                pose,
            });
        }
        found
    }
}

impl Exporter for Ros2Bag {
    fn check(&mut self, scenario: &Scenario) -> anyhow::Result<()> {
        scenario.cameras(&self.cameras).map(drop)
    }

    fn wants(&self, scenario: &Scenario, topic: &Topic) -> bool {
        let is_camera = topic.modality.sensor_kind() == schema_frames::SensorKind::Camera;
        let is_wanted = |camera: &&consumer_truth::scenario::Sensor| camera.name == *topic.sensor;
        let cameras = || scenario.cameras(&self.cameras).unwrap_or_default();
        !topic.modality.is_event() && (!is_camera || cameras().iter().any(is_wanted))
    }

    fn keys(&self, _: &Scenario) -> Vec<Arc<str>> {
        Vec::new()
    }

    fn begin(
        &mut self,
        scenario: &Scenario,
        _: &[DoneScenario],
        tree: &Tree,
    ) -> anyhow::Result<()> {
        self.encoders.clear();
        self.scenery = Arc::default();
        let name = &scenario.name;
        let part = tree.begin(&format!("{}/{name}/{name}_0.mcap", scenario.split))?;
        // LZ4's bytes are the same on every machine, whatever its number of cores.
        let mut bag = Bag {
            file: BagFile::create(part, "ros2", ChunkCompression::Lz4)?,
            channels: BTreeMap::new(),
            span: None,
        };
        let start = scenario.start_nanos;
        let mut fixed = Vec::new();
        for sensor in &scenario.sensors {
            if sensor.kind == schema_frames::SensorKind::Camera {
                let parent = format!("{}/{}", scenario.rig, sensor.name);
                fixed.push(Transform {
                    child: format!("{parent}_optical"),
                    parent,
                    pose: Isometry3::from_parts(Default::default(), sensor_from_camera()),
                });
            }
        }
        messages::transforms(&mut self.cdr, start, &fixed);
        bag.write("/tf_static", Message::Transforms, start, &self.cdr)?;
        self.cdr.start().text(&world_info(scenario));
        bag.write("/world/info", Message::Text, start, &self.cdr)?;
        if let Some(map) = &scenario.opendrive {
            self.cdr.start().text(map);
            bag.write("/world/map", Message::Text, start, &self.cdr)?;
        }
        self.bag = Some(bag);
        Ok(())
    }

    fn tick(&mut self, scenario: &Scenario, tick: &TickSet, _: &Tree) -> anyhow::Result<()> {
        let mut bag = self.bag.take().context("a tick before its scenario")?;
        let nanos = tick.sim_nanos;
        messages::stamp(self.cdr.start(), nanos);
        bag.write("/clock", Message::Clock, nanos, &self.cdr)?;
        let transforms = Self::transforms(scenario, tick);
        if !transforms.is_empty() {
            messages::transforms(&mut self.cdr, nanos, &transforms);
            bag.write("/tf", Message::Transforms, nanos, &self.cdr)?;
        }
        if let Some(world) = &tick.world {
            if let Some(record) = world.record(scenario.carrier_id) {
                let child = format!("{}/base_link", scenario.rig);
                messages::odometry(&mut self.cdr, nanos, &child, record);
                let topic = format!("/{}/odom", ros_name(&scenario.rig));
                bag.write(&topic, Message::Odometry, nanos, &self.cdr)?;
            }
            if world.scenery != self.scenery {
                self.scenery = world.scenery.clone();
                let bodies = self.scenery.iter().filter_map(Body::of_scenery);
                messages::scenery(&mut self.cdr, nanos, &bodies.collect::<Vec<_>>());
                let topic = "/world/scenery";
                bag.write(topic, Message::Detection3DArray, nanos, &self.cdr)?;
            }
            messages::objects(&mut self.cdr, nanos, world);
            bag.write(
                "/world/objects",
                Message::Detection3DArray,
                nanos,
                &self.cdr,
            )?;
        }
        for frame in &tick.frames {
            self.frame(scenario, frame, &mut bag)
                .with_context(|| format!("{} at tick {}", frame.topic, tick.tick))?;
        }
        self.bag = Some(bag);
        Ok(())
    }

    fn end(&mut self, scenario: &Scenario, tree: &Tree) -> anyhow::Result<serde_json::Value> {
        let bag = self.bag.take().context("an end before its scenario")?;
        bag.file.finish()?.finish()?;
        let topics: Vec<TopicCount> = bag.channels.into_values().map(|it| it.1).collect();
        let (start, end) = bag.span.unwrap_or_default();
        let (name, split) = (&scenario.name, &scenario.split);
        tree.write(&format!("{split}/{name}/metadata.yaml"), || {
            Ok(yaml(&format!("{name}_0.mcap"), start, end, &topics).into_bytes())
        })?;
        let counts: serde_json::Map<_, _> = topics
            .into_iter()
            .map(|topic| (topic.name, topic.n_messages.into()))
            .collect();
        Ok(json!({ "messages": counts }))
    }

    fn finish(&mut self, _: &[DoneScenario], _: &Tree) -> anyhow::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_what_ros_allows() {
        assert_eq!(ros_name("front-left.2"), "front_left_2");
        assert_eq!(ros_name("2nd"), "_2nd");
    }
}
