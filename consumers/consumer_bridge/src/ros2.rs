//! ROS 2: sensors, vehicles and detections as topics of a node, over zenoh as `rmw_zenoh_cpp` speaks
//! it, without an installation of ROS 2.
//!
//! `/carla/RIG/SENSOR/image` and its like carry what the topics of the domain carry; a sensor is read
//! only while a node subscribes. `ackermann_cmd` and `vehicle_control_cmd` drive.

pub(crate) mod cdr;
mod drive;
mod graph;
pub(crate) mod messages;
mod relay;
pub mod types;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Duration;

use consumer_kit::{FollowedDocument, WakeUps};
use schema_bus::{Bus, ServicePorts, SnapshotReader, TopicKind, names};
use schema_frames::{ActorInfo, ActorList};
use schema_types::Pose;
use zenoh::Session;

use crate::lookout::{View, is_left_over};
use crate::options::{Options, Ros2Options};
use drive::{Driver, Vehicle};
use graph::{Node, Topic};
use messages::Link;
use relay::Relay;

/// Longest wait for a frame.
const WAIT: Duration = Duration::from_millis(50);
/// Rigs at most: each has topics and subscriptions of its own.
const MAX_RIGS: usize = 64;

/// The node.
#[derive(Debug)]
pub struct Ros2 {
    // Ports go before their node.
    relays: BTreeMap<String, Relay>,
    snapshots: Option<SnapshotReader>,
    actors: FollowedDocument,
    rigs: BTreeMap<String, Rig>,
    wake_ups: WakeUps,
    bus: Bus,
    node: Arc<Node>,
    clock: Option<Topic>,
    tf: Topic,
    driver: Driver,
    options: Options,
    woken: Arc<AtomicBool>,
    view: View,
    failure_said: bool,
}

/// A vehicle with sensors.
#[derive(Debug)]
struct Rig {
    actor: u32,
    odometry: Topic,
    status: Topic,
    _vehicle: Vehicle,
    sensors: Sensors,
}

/// Id, name, and whether it is a camera, of each sensor.
type Sensors = Vec<(u32, String, bool)>;

impl Ros2 {
    /// Appears in the graph of ROS 2.
    ///
    /// # Errors
    /// [`schema_bus::BusError`], and what zenoh says.
    pub(crate) fn open(
        session: &Session,
        options: &Options,
        ros2: &Ros2Options,
        view: View,
    ) -> anyhow::Result<Ros2> {
        let bus = Bus::open_with(&options.domain, "gantry-bridge", &options.bus)?;
        let node = Arc::new(Node::new(session, ros2.domain_id)?);
        let clock = ros2
            .clock
            .then(|| node.publish("/clock", &types::CLOCK, || {}))
            .transpose()?;
        Ok(Ros2 {
            relays: BTreeMap::new(),
            snapshots: None,
            actors: FollowedDocument::optional(names::WORLD_ACTORS),
            rigs: BTreeMap::new(),
            wake_ups: WakeUps::new(),
            clock,
            tf: node.publish("/tf", &types::TF, || {})?,
            driver: Driver::start(options)?,
            bus,
            node,
            options: options.clone(),
            woken: Arc::new(AtomicBool::new(true)),
            view,
            failure_said: false,
        })
    }

    /// One turn: sends what waits, and waits for more, never longer than a twentieth of a second.
    ///
    /// # Errors
    /// What going on cannot heal.
    pub fn turn(&mut self) -> anyhow::Result<()> {
        if let Some(services) = self.view.changed() {
            self.look_at_topics(&services)?;
            self.look_at_rigs()?;
            self.woken.store(true, Relaxed);
        }
        if self.woken.swap(false, Relaxed) {
            self.open_and_close()?;
        }
        // One that fails keeps no other from sending.
        let mut sent = self.send_world();
        for relay in self.relays.values_mut() {
            sent = sent.and(relay.pass_on(&self.bus));
        }
        if let Err(error) = sent
            && !std::mem::replace(&mut self.failure_said, true)
        {
            tracing::warn!("ROS 2: {error:#}; further ones are not said");
        }
        self.wake_ups.wait(WAIT)?;
        Ok(())
    }

    /// Finds sensors and detectors that came and went.
    fn look_at_topics(&mut self, services: &[ServicePorts]) -> anyhow::Result<()> {
        let mut here = BTreeSet::new();
        for topic in services {
            let is_one = match topic.kind() {
                TopicKind::Frames => {
                    let is_here = !is_left_over(topic);
                    let known = self.relays.get_mut(&topic.name);
                    known.map_or(is_here, |known| !known.left.is_over(is_here))
                }
                TopicKind::Results => !topic.writers.is_empty(),
                _ => false,
            };
            if !is_one || !self.options.has(&topic.name) {
                continue;
            }
            here.insert(topic.name.clone());
            if !self.relays.contains_key(&topic.name) {
                let woken = self.woken.clone();
                let wake = move || woken.store(true, Relaxed);
                if let Some(relay) = Relay::new(&self.node, topic, wake)? {
                    self.relays.insert(topic.name.clone(), relay);
                }
            }
        }
        self.relays.retain(|name, _| here.contains(name));
        Ok(())
    }

    /// Finds the vehicles that carry sensors.
    fn look_at_rigs(&mut self) -> anyhow::Result<()> {
        let Some(document) = self.actors.changed(&self.bus)? else {
            return Ok(());
        };
        let list: ActorList = document.json()?;
        let mut found: BTreeMap<String, (u32, Sensors)> = BTreeMap::new();
        for sensor in list.actors.iter().filter(|actor| actor.kind == "sensor") {
            if let Some((rig, name, is_camera)) = sensor_name(sensor)
                && sensor.parent_id != 0
            {
                let (_, sensors) = found
                    .entry(rig.to_owned())
                    .or_insert((sensor.parent_id, Vec::new()));
                sensors.push((sensor.id, name.to_owned(), is_camera));
            }
        }
        self.rigs.retain(|name, rig| {
            found
                .get(name)
                .is_some_and(|(actor, _)| *actor == rig.actor)
        });
        for (name, (actor, sensors)) in found.into_iter().take(MAX_RIGS) {
            if let Some(rig) = self.rigs.get_mut(&name) {
                rig.sensors = sensors;
                continue;
            }
            let topic = |last: &str| format!("/carla/{name}/{last}");
            let rig = Rig {
                actor,
                odometry: self
                    .node
                    .publish(&topic("odometry"), &types::ODOMETRY, || {})?,
                status: self.node.publish(
                    &topic("vehicle_status"),
                    &types::VEHICLE_STATUS,
                    || {},
                )?,
                _vehicle: self.driver.listen(&self.node, &name, actor)?,
                sensors,
            };
            tracing::info!(rig = name, "ROS 2 nodes see it as /carla/{name}");
            self.rigs.insert(name, rig);
        }
        Ok(())
    }

    fn open_and_close(&mut self) -> anyhow::Result<()> {
        let mut is_changed = false;
        for relay in self.relays.values_mut() {
            is_changed |= relay.open_or_close(&self.bus)?;
        }
        let is_wanted = self.clock.as_ref().is_some_and(Topic::is_wanted)
            || self.tf.is_wanted()
            || self
                .rigs
                .values()
                .any(|rig| rig.odometry.is_wanted() || rig.status.is_wanted());
        if is_wanted != self.snapshots.is_some() {
            self.snapshots = match is_wanted && self.bus.exists(names::WORLD_SNAPSHOT) {
                // It may be made or removed at this moment; the next look tries again.
                true => self.bus.snapshot_reader().ok(),
                false => None,
            };
            is_changed = true;
        }
        if is_changed {
            self.wake_ups = WakeUps::new();
            let read: Vec<&str> = self
                .relays
                .values()
                .filter(|relay| relay.is_open())
                .map(Relay::topic)
                .collect();
            for topic in &read {
                self.wake_ups
                    .attach(&self.bus, topic, read.iter().copied())?;
            }
            if self.snapshots.is_some() {
                self.wake_ups.listen(&self.bus, names::WORLD_SNAPSHOT)?;
            }
        }
        Ok(())
    }

    /// Clock, transforms and vehicles after every tick.
    fn send_world(&mut self) -> anyhow::Result<()> {
        let Some(snapshots) = &mut self.snapshots else {
            return Ok(());
        };
        while let Some(world) = snapshots.next()? {
            let sim_nanos = world.header().sim_nanos;
            if let Some(clock) = self.clock.as_ref().filter(|clock| clock.is_wanted()) {
                clock.send(messages::clock(sim_nanos))?;
            }
            let mut links: Vec<(String, String, Pose)> = Vec::new();
            for (name, rig) in &self.rigs {
                let Some(actor) = world.actor(rig.actor) else {
                    continue;
                };
                if rig.odometry.is_wanted() {
                    rig.odometry
                        .send(messages::odometry(actor, sim_nanos, name))?;
                }
                if let Some(part) = actor.vehicle().filter(|_| rig.status.is_wanted()) {
                    let status = messages::vehicle_status(actor, &part, sim_nanos, name);
                    rig.status.send(status)?;
                }
                if !self.tf.is_wanted() {
                    continue;
                }
                links.push((
                    name.clone(),
                    messages::MAP.to_owned(),
                    actor.world_from_actor,
                ));
                let from_world = actor.world_from_actor.isometry().inverse();
                for (id, sensor, is_camera) in &rig.sensors {
                    let Some(record) = world.actor(*id) else {
                        continue;
                    };
                    let frame = format!("{name}/{sensor}");
                    let mount = from_world * record.world_from_actor.isometry();
                    if *is_camera {
                        links.push((
                            format!("{frame}_optical"),
                            frame.clone(),
                            messages::optical(),
                        ));
                    }
                    links.push((frame, name.clone(), mount.into()));
                }
            }
            if !links.is_empty() {
                let links: Vec<Link<'_>> = links
                    .iter()
                    .map(|(frame, parent, pose)| (frame.as_str(), parent.as_str(), *pose))
                    .collect();
                self.tf.send(messages::transforms(&links, sim_nanos))?;
            }
        }
        Ok(())
    }
}

/// Rig and name of a sensor by its first topic, and whether it is a camera.
fn sensor_name(sensor: &ActorInfo) -> Option<(&str, &str, bool)> {
    let first = sensor.topics.first()?;
    let (place, _) = first.topic.rsplit_once('/')?;
    let (rig, name) = place.split_once('/')?;
    let modality = schema_frames::Modality::from_name(&first.modality)?;
    let is_camera = modality.sensor_kind() == schema_frames::SensorKind::Camera;
    Some((rig, name, is_camera))
}
