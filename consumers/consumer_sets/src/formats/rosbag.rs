//! ROS 2 bags: one folder per scenario, `<part>/<scenario>/`, with `metadata.yaml` and an MCAP file
//! that any ROS 2 from Humble on plays.

pub mod frames;
mod metadata;
mod objects;

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use anyhow::Context as _;
use consumer_forms::ros2::cdr::Writer;
use consumer_forms::ros2::types::{self, Type};
use consumer_forms::ros2::world::{self, MAP, Transform};
use schema_recording::bag::{BagFile, BagMessage};
use schema_recording::scenery::SceneryBox;
use schema_recording::write::ChunkCompression;
use serde_json::json;

use self::frames::ros_name;
use self::metadata::{TopicCount, quality_of_service, yaml};
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
    cdr: Writer,
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
    fn write(&mut self, topic: &str, kind: &Type, nanos: u64, cdr: &Writer) -> anyhow::Result<()> {
        if !self.channels.contains_key(topic) {
            let latched = *kind == types::TEXT || LATCHED.contains(&topic);
            let quality = ("offered_qos_profiles".into(), quality_of_service(latched));
            let id = self
                .file
                .channel(topic, &kind.schema(), &[quality].into())?;
            let count = TopicCount {
                name: topic.into(),
                kind: kind.full_name(),
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
            cdr: Writer::default(),
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
        let encoder = self.encoders.entry(frame.topic.clone()).or_default();
        let mut write = |topic: &str, kind: &Type, cdr: &Writer| {
            bag.write(topic, kind, frame.header.sim_nanos, cdr)
        };
        frames::messages(&mut self.cdr, encoder, &scenario.rig, frame, &mut write)
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
                parent_from_child: pose.into(),
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
                parent_from_child: pose.into(),
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
                    parent_from_child: world::optical(),
                });
            }
        }
        world::transforms(&mut self.cdr, start, &fixed);
        bag.write("/tf_static", &types::TF, start, &self.cdr)?;
        world::text(&mut self.cdr, &world_info(scenario));
        bag.write("/world/info", &types::TEXT, start, &self.cdr)?;
        if let Some(map) = &scenario.opendrive {
            world::text(&mut self.cdr, map);
            bag.write("/world/map", &types::TEXT, start, &self.cdr)?;
        }
        self.bag = Some(bag);
        Ok(())
    }

    fn tick(&mut self, scenario: &Scenario, tick: &TickSet, _: &Tree) -> anyhow::Result<()> {
        let mut bag = self.bag.take().context("a tick before its scenario")?;
        let nanos = tick.sim_nanos;
        world::clock(&mut self.cdr, nanos);
        bag.write("/clock", &types::CLOCK, nanos, &self.cdr)?;
        let transforms = Self::transforms(scenario, tick);
        if !transforms.is_empty() {
            world::transforms(&mut self.cdr, nanos, &transforms);
            bag.write("/tf", &types::TF, nanos, &self.cdr)?;
        }
        if let Some(now) = &tick.world {
            if let Some(record) = now.record(scenario.carrier_id) {
                let child = format!("{}/base_link", scenario.rig);
                world::odometry(&mut self.cdr, nanos, &child, record);
                let topic = format!("/{}/odom", ros_name(&scenario.rig));
                bag.write(&topic, &types::ODOMETRY, nanos, &self.cdr)?;
            }
            if now.scenery != self.scenery {
                self.scenery = now.scenery.clone();
                let bodies = self.scenery.iter().filter_map(Body::of_scenery);
                let found: Vec<_> = bodies.map(|body| objects::of_body(&body)).collect();
                world::detections_3d(&mut self.cdr, nanos, MAP, &found);
                let topic = "/world/scenery";
                bag.write(topic, &types::DETECTIONS_3D, nanos, &self.cdr)?;
            }
            world::detections_3d(&mut self.cdr, nanos, MAP, &objects::of_world(now));
            bag.write("/world/objects", &types::DETECTIONS_3D, nanos, &self.cdr)?;
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
