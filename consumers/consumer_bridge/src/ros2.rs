//! ROS 2: sensors, vehicles and detections as topics of a node, over zenoh as `rmw_zenoh_cpp`
//! speaks it, without an installation of ROS 2.
//!
//! `/carla/RIG/SENSOR/image` and its like carry what the topics of the domain carry; a sensor is
//! read only while a node subscribes. `ackermann_cmd` and `vehicle_control_cmd` drive.

mod drive;
mod graph;
mod relay;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Duration;

use consumer_forms::ros2::types;
use consumer_forms::ros2::world::{self, MAP, Transform};
use consumer_kit::{
    Calibrations, Change, Domain, FollowedDocument, ListedTopic, Listing, TopicId, Wish,
};
use schema_bus::{TopicKind, names};
use schema_frames::{ActorInfo, ActorList};
use zenoh::Session;

use crate::lookout;
use crate::options::{Options, Ros2Options};
use drive::{Driver, Vehicle};
use graph::{Node, Topic};
pub use relay::frame_messages;
use relay::{Relay, message};

/// Longest wait for a frame.
const WAIT: Duration = Duration::from_millis(50);
/// Rigs at most: each has topics and subscriptions of its own.
const MAX_RIGS: usize = 64;

/// The node.
#[derive(Debug)]
pub struct Ros2 {
    // Ports go before their node.
    actors: FollowedDocument,
    calibrations: Calibrations,
    domain: Domain,
    relays: BTreeMap<TopicId, Relay>,
    snapshots: TopicId,
    rigs: BTreeMap<String, Rig>,
    node: Arc<Node>,
    clock: Option<Topic>,
    tf: Topic,
    driver: Driver,
    options: Options,
    woken: Arc<AtomicBool>,
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
        listing: Listing,
    ) -> anyhow::Result<Ros2> {
        let mut domain = lookout::join(options, listing)?;
        let node = Arc::new(Node::new(session, ros2.domain_id)?);
        let clock = ros2
            .clock
            .then(|| node.publish("/clock", &types::CLOCK, || {}))
            .transpose()?;
        Ok(Ros2 {
            relays: BTreeMap::new(),
            snapshots: domain.snapshots_on_demand(),
            domain,
            actors: FollowedDocument::optional(names::WORLD_ACTORS),
            calibrations: Calibrations::new(),
            rigs: BTreeMap::new(),
            clock,
            tf: node.publish("/tf", &types::TF, || {})?,
            driver: Driver::start(options)?,
            node,
            options: options.clone(),
            woken: Arc::new(AtomicBool::new(true)),
            failure_said: false,
        })
    }

    /// One turn: sends what waits, and waits for more, never longer than a twentieth of a second.
    ///
    /// # Errors
    /// What going on cannot heal.
    pub fn turn(&mut self) -> anyhow::Result<()> {
        let options = &self.options;
        let is_new = lookout::look(&mut self.domain, |listed| wish(listed, options));
        self.take_over()?;
        if is_new {
            self.look_at_rigs()?;
        }
        if self.woken.swap(false, Relaxed) || is_new {
            self.open_and_close()?;
        }
        // One that fails keeps no other from sending.
        let mut sent = self.send_world();
        for (id, relay) in &mut self.relays {
            let passed = relay.pass_on(*id, &mut self.domain, &mut self.calibrations);
            sent = sent.and(passed);
        }
        if let Err(error) = sent
            && !std::mem::replace(&mut self.failure_said, true)
        {
            tracing::warn!("ROS 2: {error:#}; further ones are not said");
        }
        self.domain.wait(WAIT)?;
        Ok(())
    }

    /// Begins and ends to offer topics as they came and went.
    fn take_over(&mut self) -> anyhow::Result<()> {
        while let Some(change) = self.domain.change() {
            match change {
                Change::Found { id, details } => {
                    let woken = self.woken.clone();
                    let wake = move || woken.store(true, Relaxed);
                    self.relays
                        .insert(id, Relay::new(&self.node, &details, wake)?);
                }
                Change::Refused { id, error } => {
                    if let Some(relay) = self.relays.get_mut(&id) {
                        relay.refuse(&error);
                    }
                }
                Change::Ended(id) | Change::Unlisted(id) => {
                    self.domain.leave(id);
                    self.relays.remove(&id);
                }
                Change::Full(_) | Change::Silent(_) => {}
            }
        }
        Ok(())
    }

    /// Finds the vehicles that carry sensors.
    fn look_at_rigs(&mut self) -> anyhow::Result<()> {
        let Some(document) = self.actors.changed(self.domain.bus())? else {
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
        for (id, relay) in &self.relays {
            self.domain.want(*id, relay.is_wanted());
        }
        let is_wanted = self.clock.as_ref().is_some_and(Topic::is_wanted)
            || self.tf.is_wanted()
            || self
                .rigs
                .values()
                .any(|rig| rig.odometry.is_wanted() || rig.status.is_wanted());
        self.domain.want(self.snapshots, is_wanted);
        self.domain.open()?;
        self.take_over()
    }

    /// Clock, transforms and vehicles after every tick.
    fn send_world(&mut self) -> anyhow::Result<()> {
        while let Some(now) = self.domain.take_snapshot(self.snapshots)? {
            let sim_nanos = now.header().sim_nanos;
            if let Some(clock) = self.clock.as_ref().filter(|clock| clock.is_wanted()) {
                clock.send(message(|out| world::clock(out, sim_nanos)))?;
            }
            let mut links: Vec<Transform> = Vec::new();
            for (name, rig) in &self.rigs {
                let Some(actor) = now.actor(rig.actor) else {
                    continue;
                };
                if rig.odometry.is_wanted() {
                    rig.odometry
                        .send(message(|out| world::odometry(out, sim_nanos, name, actor)))?;
                }
                if let Some(part) = actor.vehicle().filter(|_| rig.status.is_wanted()) {
                    rig.status.send(message(|out| {
                        world::vehicle_status(out, sim_nanos, name, actor, &part);
                    }))?;
                }
                if !self.tf.is_wanted() {
                    continue;
                }
                links.push(Transform {
                    child: name.clone(),
                    parent: MAP.to_owned(),
                    parent_from_child: actor.world_from_actor,
                });
                let from_world = actor.world_from_actor.isometry().inverse();
                for (id, sensor, is_camera) in &rig.sensors {
                    let Some(record) = now.actor(*id) else {
                        continue;
                    };
                    let frame = format!("{name}/{sensor}");
                    let mount = from_world * record.world_from_actor.isometry();
                    if *is_camera {
                        links.push(Transform {
                            child: format!("{frame}_optical"),
                            parent: frame.clone(),
                            parent_from_child: world::optical(),
                        });
                    }
                    links.push(Transform {
                        child: frame,
                        parent: name.clone(),
                        parent_from_child: mount.into(),
                    });
                }
            }
            if !links.is_empty() {
                self.tf
                    .send(message(|out| world::transforms(out, sim_nanos, &links)))?;
            }
        }
        Ok(())
    }
}

/// How a listed topic is to be known; `None` of one that no node of ROS 2 can read.
fn wish(listed: ListedTopic<'_>, options: &Options) -> Option<Wish> {
    let topic = listed.details;
    let has_ended = topic.kind == TopicKind::Results && topic.publishers == 0;
    let is_one = !has_ended && options.has(&topic.name);
    relay::wish(topic).filter(|_| is_one)
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
