//! Foxglove: a websocket server with the domain's topics in the messages that recordings have, with
//! parameters and services, for people who look.
//!
//! A sensor is read only while a client subscribes to one of its channels; results are read while a
//! client is connected.

mod channels;
mod world;

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use consumer_kit::items::ResultParts;
use consumer_kit::{FollowedDocument, FollowedResult, Take, WakeUps};
use consumer_record::frames::{TopicName, frame_entries};
use consumer_record::results::ResultConverter;
use consumer_record::snapshots::{BOXES_TOPIC, SnapshotConverter, TRANSFORMS_TOPIC};
use foxglove::websocket::Capability;
use foxglove::{RawChannel, WebSocketServer, WebSocketServerHandle};
use schema_bus::{Bus, BusError, FrameReader, ServicePorts, SnapshotReader, TopicKind, names};
use schema_frames::{ActorList, Modality};
use schema_recording::messages::{Content, Entry};

use crate::lookout::{Left, View, is_left_over};
use crate::options::Options;
use channels::Channels;
use world::{Parameters, World};

/// Longest wait for a frame.
const WAIT: Duration = Duration::from_millis(50);
/// Messages that wait for a slow client; beyond that it loses the oldest.
const BACKLOG: usize = 64;
/// Topic of the world's lossless messages, which no client can show.
const LOSSLESS: &str = "/gantry";

/// The server and what it shows.
pub struct People {
    // Ports go before their node.
    frames: BTreeMap<String, Sensor>,
    results: BTreeMap<String, FollowedResult>,
    snapshots: Option<SnapshotReader>,
    actors: FollowedDocument,
    wake_ups: WakeUps,
    bus: Bus,
    converter: SnapshotConverter,
    of_results: ResultConverter,
    channels: Channels,
    server: Option<WebSocketServerHandle>,
    world: Arc<World>,
    options: Options,
    view: View,
}

/// One topic of frames.
struct Sensor {
    name: TopicName,
    reader: Option<FrameReader>,
    shown: Arc<RawChannel>,
    left: Left,
    refusal_said: bool,
}

impl People {
    /// Begins to listen on `address`.
    ///
    /// # Errors
    /// A sentence if the address is taken; [`BusError`].
    pub fn open(options: &Options, address: SocketAddr, view: View) -> anyhow::Result<People> {
        let bus = Bus::open_with(&options.domain, "gantry-bridge", &options.bus)?;
        let world = Arc::new(World::new(options));
        let context = foxglove::Context::new();
        let mut capabilities = vec![Capability::Time, Capability::Parameters];
        if options.control {
            capabilities.push(Capability::Services);
        }
        let mut server = WebSocketServer::new()
            .name(format!("Gantry, domain {}", options.domain))
            .bind(address.ip().to_string(), address.port())
            .capabilities(capabilities)
            .supported_encodings(["json"])
            .parameter_handler(Arc::new(Parameters::start(&world)?))
            .message_backlog_size(BACKLOG)
            .context(&context);
        if options.control {
            server = server.services(world::services(&world)?);
        }
        let server = server.start_blocking().with_context(|| {
            format!("cannot listen on {address} for Foxglove; is it taken? --foxglove HOST:PORT chooses another")
        })?;
        tracing::info!(
            "Foxglove connects to ws://{}:{}",
            address.ip(),
            server.port()
        );
        Ok(People {
            frames: BTreeMap::new(),
            results: BTreeMap::new(),
            snapshots: None,
            actors: FollowedDocument::optional(names::WORLD_ACTORS),
            wake_ups: WakeUps::new(),
            bus,
            converter: SnapshotConverter::default(),
            of_results: ResultConverter::default(),
            channels: Channels::new(context),
            server: Some(server),
            world,
            options: options.clone(),
            view,
        })
    }

    /// One turn: sends what waits, and waits for more, never longer than a twentieth of a second.
    ///
    /// # Errors
    /// What going on cannot heal.
    pub fn turn(&mut self) -> anyhow::Result<()> {
        if let Some(services) = self.view.changed() {
            self.look_at_topics(&services)?;
            self.world.look(&self.bus, self.server.as_ref())?;
        }
        self.open_and_close()?;
        self.send_world()?;
        self.send_frames()?;
        self.send_results()?;
        self.wake_ups.wait(WAIT)?;
        Ok(())
    }

    fn n_clients(&self) -> usize {
        self.server
            .as_ref()
            .map_or(0, WebSocketServerHandle::client_count)
    }

    fn look_at_topics(&mut self, services: &[ServicePorts]) -> anyhow::Result<()> {
        self.channels
            .offer(TRANSFORMS_TOPIC, &Content::FrameTransforms)?;
        self.channels.offer(BOXES_TOPIC, &Content::SceneUpdate)?;
        let has_clients = self.n_clients() > 0;
        let (mut sensors, mut results) = (BTreeSet::new(), BTreeSet::new());
        for topic in services {
            // A batch only repeats the images of its cameras.
            if !self.options.has(&topic.name) || names::is_batch(&topic.name) {
                continue;
            }
            let modality = topic.name.rsplit('/').next().and_then(Modality::from_name);
            match (topic.kind(), modality) {
                (TopicKind::Frames, Some(modality)) => {
                    let is_here = !is_left_over(topic);
                    let known = self.frames.get_mut(&topic.name);
                    if known.is_some_and(|known| !known.left.is_over(is_here)) {
                        sensors.insert(topic.name.clone());
                    } else if is_here {
                        sensors.insert(topic.name.clone());
                        self.add_sensor(&topic.name, modality)?;
                    }
                }
                (TopicKind::Results, _) if has_clients && !topic.writers.is_empty() => {
                    results.insert(topic.name.clone());
                    self.results
                        .entry(topic.name.clone())
                        .or_insert_with(|| FollowedResult::new(&*topic.name, Take::All));
                }
                _ => {}
            }
        }
        let gone: Vec<String> = self
            .frames
            .keys()
            .filter(|name| !sensors.contains(*name))
            .cloned()
            .collect();
        let n_followed = self.frames.len() + self.results.len();
        for name in gone {
            let Some(Sensor { name, .. }) = self.frames.remove(&name) else {
                continue;
            };
            self.channels.end(&name.channel);
            let mut others = self.frames.values();
            if !others.any(|other| other.name.sensor_channel == name.sensor_channel) {
                let calibration = format!("{}/calibration", name.sensor_channel);
                self.channels.end(&calibration);
            }
        }
        self.results.retain(|name, _| {
            let is_kept = results.contains(name);
            if !is_kept {
                self.channels.end(&format!("/{name}"));
                self.channels.end(&format!("/{name}/space"));
            }
            is_kept
        });
        match self.frames.len() + self.results.len() < n_followed {
            true => self.listen(),
            false => Ok(()),
        }
    }

    fn add_sensor(&mut self, topic: &str, modality: Modality) -> anyhow::Result<()> {
        let (Some(name), Some(content)) = (TopicName::new(topic), content_of(modality)) else {
            return Ok(());
        };
        let shown = self.channels.offer(&name.channel, &content)?;
        let sensor = Sensor {
            name,
            reader: None,
            shown,
            left: Left::default(),
            refusal_said: false,
        };
        self.frames.insert(topic.to_owned(), sensor);
        Ok(())
    }

    /// Reads what clients subscribe to, and nothing else.
    fn open_and_close(&mut self) -> anyhow::Result<()> {
        let mut is_changed = false;
        for (topic, sensor) in &mut self.frames {
            let is_wanted = sensor.shown.has_sinks();
            if is_wanted == sensor.reader.is_some() {
                continue;
            }
            is_changed = true;
            sensor.reader = match is_wanted.then(|| self.bus.frame_reader(topic)).transpose() {
                Ok(reader) => reader,
                Err(BusError::NoSuchTopic { .. } | BusError::Service { .. }) => None,
                Err(error) => {
                    if !std::mem::replace(&mut sensor.refusal_said, true) {
                        tracing::warn!(topic, %error, "a client wants the topic, but it cannot be read; trying again");
                    }
                    None
                }
            };
        }
        for results in self.results.values_mut() {
            if !results.found() {
                is_changed |= results.look(&self.bus)?;
            } else {
                results.look(&self.bus)?;
            }
        }
        let is_wanted = self.n_clients() > 0 && self.bus.exists(names::WORLD_SNAPSHOT);
        if is_wanted != self.snapshots.is_some() {
            self.snapshots = is_wanted
                .then(|| self.bus.snapshot_reader())
                .and_then(Result::ok);
            is_changed = true;
        }
        if is_changed {
            self.listen()?;
        }
        Ok(())
    }

    fn listen(&mut self) -> anyhow::Result<()> {
        self.wake_ups = WakeUps::new();
        let read = self
            .frames
            .iter()
            .filter(|(_, sensor)| sensor.reader.is_some());
        let read: Vec<&str> = read.map(|(topic, _)| topic.as_str()).collect();
        for topic in &read {
            self.wake_ups
                .attach(&self.bus, topic, read.iter().copied())?;
        }
        for topic in self.results.keys() {
            self.wake_ups.listen(&self.bus, topic)?;
        }
        if self.snapshots.is_some() {
            self.wake_ups.listen(&self.bus, names::WORLD_SNAPSHOT)?;
        }
        Ok(())
    }

    fn send_world(&mut self) -> anyhow::Result<()> {
        if let Ok(Some(document)) = self.actors.changed(&self.bus)
            && let Ok(list) = document.json::<ActorList>()
        {
            self.converter.set_actors(&list);
        }
        let Some(snapshots) = &mut self.snapshots else {
            return Ok(());
        };
        while let Some(world) = snapshots.next()? {
            let header = world.header();
            if let Some(server) = &self.server {
                server.broadcast_time(header.sim_nanos);
            }
            let entries = self.converter.snapshot_entries(header, world.records());
            send(&mut self.channels, entries, header.sim_nanos)?;
        }
        Ok(())
    }

    fn send_frames(&mut self) -> anyhow::Result<()> {
        for sensor in self.frames.values_mut() {
            let Some(reader) = &mut sensor.reader else {
                continue;
            };
            // People look at the newest; what came before it is late already.
            let frame = match reader.latest() {
                Ok(Some(frame)) => frame,
                Ok(None) | Err(BusError::BadFrame { .. }) => continue,
                Err(error) => return Err(error.into()),
            };
            let header = frame.header();
            let extras = self.converter.frame_extras(&sensor.name, header);
            let entries =
                frame_entries(&sensor.name, header, &frame, &mut |n| Vec::with_capacity(n));
            let all = extras.into_iter().chain(entries).collect();
            send(&mut self.channels, all, header.sim_nanos)?;
        }
        Ok(())
    }

    fn send_results(&mut self) -> anyhow::Result<()> {
        for results in self.results.values_mut() {
            while let Some(result) = results.take()? {
                let sim_nanos = result.header().sim_nanos;
                let parts = ResultParts::of(&result, results.about());
                let entries = self
                    .of_results
                    .entries(&parts, sim_nanos, &mut |n| Vec::with_capacity(n));
                send(&mut self.channels, entries, sim_nanos)?;
            }
        }
        Ok(())
    }
}

impl Drop for People {
    fn drop(&mut self) {
        if let Some(server) = self.server.take() {
            // Clients see the end; nothing waits for slow ones.
            drop(server.stop());
        }
        self.world.leave();
    }
}

/// Sends the messages that clients can show; channels that are new are offered.
fn send(channels: &mut Channels, entries: Vec<Entry>, sim_nanos: u64) -> anyhow::Result<()> {
    for entry in entries {
        let is_lossless = matches!(
            entry.content,
            Content::Frame | Content::Result | Content::Snapshot | Content::Document
        );
        if !is_lossless && !entry.topic.ends_with(LOSSLESS) {
            channels.send(&entry, sim_nanos)?;
        }
    }
    Ok(())
}

/// What a client is shown of frames; `None` of what no client can show.
fn content_of(modality: Modality) -> Option<Content> {
    Some(match modality {
        Modality::Rgb
        | Modality::Depth
        | Modality::Semantic
        | Modality::Instance
        | Modality::Dvs => Content::RawImage,
        Modality::Lidar | Modality::SemanticLidar => Content::PointCloud,
        Modality::Imu => Content::Imu,
        Modality::Gnss => Content::LocationFix,
        _ => return None,
    })
}
