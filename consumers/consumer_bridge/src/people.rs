//! Foxglove: a websocket server with the domain's topics in the messages that recordings have, with
//! parameters and services, for people who look.
//!
//! A sensor is read only while a client subscribes to one of its channels; results are read while a
//! client is connected.

mod channels;
pub mod gate;
mod world;

use std::collections::BTreeMap;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use consumer_forms::foxglove::frames::{TopicName, frame_entries};
use consumer_forms::foxglove::results::ResultConverter;
use consumer_forms::foxglove::snapshots::{BOXES_TOPIC, SnapshotConverter, TRANSFORMS_TOPIC};
use consumer_kit::items::ResultParts;
use consumer_kit::{Change, Domain, FollowedDocument, ListedTopic, Listing, Take, TopicId, Wish};
use foxglove::websocket::Capability;
use foxglove::{RawChannel, WebSocketServer, WebSocketServerHandle};
use schema_bus::{TopicDetails, names};
use schema_frames::{ActorList, Modality};
use schema_recording::messages::{Content, Entry};

use crate::lookout;
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
    actors: FollowedDocument,
    domain: Domain,
    frames: BTreeMap<TopicId, Sensor>,
    /// Topics of results by their numbers.
    results: BTreeMap<TopicId, String>,
    snapshots: TopicId,
    converter: SnapshotConverter,
    of_results: ResultConverter,
    channels: Channels,
    server: Option<WebSocketServerHandle>,
    world: Arc<World>,
    options: Options,
}

/// One topic of frames.
struct Sensor {
    topic: String,
    name: TopicName,
    shown: Arc<RawChannel>,
    refusal_said: bool,
}

impl People {
    /// Begins to listen on `address`.
    ///
    /// # Errors
    /// A sentence if the address is taken; [`BusError`].
    pub fn open(
        options: &Options,
        address: SocketAddr,
        listing: Listing,
    ) -> anyhow::Result<People> {
        let mut domain = lookout::join(options, listing)?;
        let world = Arc::new(World::new(options));
        let context = foxglove::Context::new();
        let mut capabilities = vec![Capability::Time, Capability::Parameters];
        if options.control {
            capabilities.push(Capability::Services);
        }
        let listener = TcpListener::bind(address).with_context(|| {
            format!("cannot listen on {address} for Foxglove; is it taken? --foxglove HOST:PORT chooses another")
        })?;
        let address = listener.local_addr()?;
        let hidden = gate::hidden()?;
        let mut server = WebSocketServer::new()
            .name(format!("Gantry, domain {}", options.domain))
            .bind(hidden.to_string(), 0)
            .capabilities(capabilities)
            .supported_encodings(["json"])
            .parameter_handler(Arc::new(Parameters::start(&world)?))
            .message_backlog_size(BACKLOG)
            .context(&context);
        if options.control {
            server = server.services(world::services(&world)?);
        }
        let server = server
            .start_blocking()
            .context("cannot start the server of Foxglove's library")?;
        let behind = SocketAddr::new(hidden, server.port());
        let allowed = gate::Allowed::new(&options.foxglove_allow);
        gate::open(listener, behind, allowed)?;
        tracing::info!("Foxglove connects to ws://{address}");
        Ok(People {
            frames: BTreeMap::new(),
            results: BTreeMap::new(),
            snapshots: domain.snapshots_on_demand(),
            domain,
            actors: FollowedDocument::optional(names::WORLD_ACTORS),
            converter: SnapshotConverter::default(),
            of_results: ResultConverter::default(),
            channels: Channels::new(context),
            server: Some(server),
            world,
            options: options.clone(),
        })
    }

    /// One turn: sends what waits, and waits for more, never longer than a twentieth of a second.
    ///
    /// # Errors
    /// What going on cannot heal.
    pub fn turn(&mut self) -> anyhow::Result<()> {
        if self.look_at_topics()? {
            self.world.look(self.domain.bus(), self.server.as_ref())?;
        }
        self.open_and_close()?;
        self.send_world()?;
        self.send_frames()?;
        self.send_results()?;
        self.domain.wait(WAIT)?;
        self.take_over()
    }

    fn n_clients(&self) -> usize {
        self.server
            .as_ref()
            .map_or(0, WebSocketServerHandle::client_count)
    }

    /// Goes through the newest list of topics, if there is one that was not seen.
    fn look_at_topics(&mut self) -> anyhow::Result<bool> {
        let (options, has_clients) = (&self.options, self.n_clients() > 0);
        let is_new = lookout::look(&mut self.domain, |listed| {
            wish(listed, has_clients).filter(|_| options.has(&listed.details.name))
        });
        if is_new {
            self.channels
                .offer(TRANSFORMS_TOPIC, &Content::FrameTransforms)?;
            self.channels.offer(BOXES_TOPIC, &Content::SceneUpdate)?;
        }
        self.take_over()?;
        Ok(is_new)
    }

    /// Begins and ends to offer topics as they came and went.
    fn take_over(&mut self) -> anyhow::Result<()> {
        while let Some(change) = self.domain.change() {
            match change {
                Change::Found { id, details } => match details.result {
                    Some(_) => {
                        self.domain.want(id, true);
                        self.results.insert(id, details.name);
                    }
                    None => self.add_sensor(id, &details)?,
                },
                Change::Refused { id, error } => {
                    if self.results.contains_key(&id) {
                        return Err(error.into());
                    }
                    if let Some(sensor) = self.frames.get_mut(&id)
                        && !std::mem::replace(&mut sensor.refusal_said, true)
                    {
                        tracing::warn!(topic = sensor.topic, %error, "a client wants the topic, but it cannot be read; trying again");
                    }
                }
                Change::Ended(id) | Change::Unlisted(id) => self.end(id),
                Change::Full(_) | Change::Silent(_) => {}
            }
        }
        Ok(())
    }

    fn end(&mut self, id: TopicId) {
        self.domain.leave(id);
        if let Some(Sensor { name, .. }) = self.frames.remove(&id) {
            self.channels.end(&name.channel);
            let mut others = self.frames.values();
            if !others.any(|other| other.name.sensor_channel == name.sensor_channel) {
                let calibration = format!("{}/calibration", name.sensor_channel);
                self.channels.end(&calibration);
            }
        }
        if let Some(name) = self.results.remove(&id) {
            self.channels.end(&format!("/{name}"));
            self.channels.end(&format!("/{name}/space"));
        }
    }

    fn add_sensor(&mut self, id: TopicId, details: &TopicDetails) -> anyhow::Result<()> {
        let content = details.modality.and_then(content_of);
        let (Some(name), Some(content)) = (TopicName::new(&details.name), content) else {
            return Ok(());
        };
        let shown = self.channels.offer(&name.channel, &content)?;
        let sensor = Sensor {
            topic: details.name.clone(),
            name,
            shown,
            refusal_said: false,
        };
        self.frames.insert(id, sensor);
        Ok(())
    }

    /// Reads what clients subscribe to, and nothing else.
    fn open_and_close(&mut self) -> anyhow::Result<()> {
        for (id, sensor) in &self.frames {
            self.domain.want(*id, sensor.shown.has_sinks());
        }
        self.domain.want(self.snapshots, self.n_clients() > 0);
        self.domain.open()?;
        self.take_over()
    }

    fn send_world(&mut self) -> anyhow::Result<()> {
        if let Ok(Some(document)) = self.actors.changed(self.domain.bus())
            && let Ok(list) = document.json::<ActorList>()
        {
            self.converter.set_actors(&list);
        }
        while let Some(world) = self.domain.take_snapshot(self.snapshots)? {
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
        for (id, sensor) in &self.frames {
            let Some(frame) = self.domain.take_frame(*id)? else {
                continue;
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
        for id in self.results.keys() {
            while let Some(result) = self.domain.take_result(*id)? {
                let Some(results) = self.domain.results(*id) else {
                    break;
                };
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

/// How a listed topic is to be known; `None` of one that no client can be shown. Results are read
/// while a client is connected, of sensors what it subscribes to: people look at the newest; what
/// came before it is late already.
fn wish(listed: ListedTopic<'_>, has_clients: bool) -> Option<Wish> {
    let topic = listed.details;
    // A batch only repeats the images of its cameras.
    if names::is_batch(&topic.name) {
        return None;
    }
    match (topic.result, topic.modality) {
        (Some(_), _) => (has_clients && topic.publishers > 0).then(|| Wish::on_demand(Take::All)),
        (None, Some(modality)) => {
            content_of(modality).map(|_| Wish::on_demand(Take::Newest).quietly())
        }
        (None, None) => None,
    }
}

/// What a client is shown of frames; `None` of what no client can show.
fn content_of(modality: Modality) -> Option<Content> {
    Some(match modality {
        Modality::Rgb
        | Modality::Depth
        | Modality::Semantic
        | Modality::Instance
        | Modality::Dvs => Content::RawImage,
        Modality::Lidar | Modality::SemanticLidar | Modality::LidarReturns => Content::PointCloud,
        Modality::Imu => Content::Imu,
        Modality::Gnss => Content::LocationFix,
        _ => return None,
    })
}
