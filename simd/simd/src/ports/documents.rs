//! `world/info`, `world/map`, `world/actors`, `world/catalogue` and `world/spawn_points`: sent when
//! they change.

use anyhow::Context as _;
use schema_bus::{Bus, BusError, DocumentPublisher, names};
use schema_frames::calibration::Readout;
use schema_frames::{CameraInfo, SpawnPoints, WorldInfo};
use sensor_spec::SensorSpec;
use simd_world::World;

use crate::clock::Clock;
use crate::participants::Participants;
use crate::settings::adapter_of;
use crate::world::LiveWorld;
use simd_frames::frames::Sensors;
use simd_frames::sensor::Role;

/// Writers of the five documents, and what each sent last.
pub struct Documents {
    info: DocumentPublisher,
    /// The other four; `None` in a sealed world, whose `world/info` says less, too.
    truth: Option<Truth>,
    info_changed: bool,
    sent_info: Option<WorldInfo>,
    sent_actors: Option<u64>,
    /// Revision of the actors whose cameras `world/info` describes.
    described_actors: Option<u64>,
    /// Whether the newest list of actors could not be sent.
    is_list_late: bool,
    sent_episode: u32,
}

/// Writers of the documents that say how the world is.
struct Truth {
    map: DocumentPublisher,
    actors: DocumentPublisher,
    catalogue: DocumentPublisher,
    spawn_points: DocumentPublisher,
}

/// The state that the documents describe.
pub struct State<'a> {
    /// Has the actors, the weather, the catalogue, the map and the epoch.
    pub world: &'a LiveWorld,
    /// Have the mode and the names of those in lockstep.
    pub participants: &'a Participants,
    /// Has the tick after which the documents are true, and its length.
    pub clock: &'a Clock,
    /// Has the topics.
    pub sensors: &'a Sensors,
}

impl Documents {
    /// Opens the five services, of a sealed world `world/info` alone; that last, because its
    /// publisher says "a daemon is here".
    pub fn open(bus: &Bus, is_sealed: bool) -> anyhow::Result<Documents> {
        let open = |name| {
            bus.document_publisher(name)
                .with_context(|| format!("cannot publish {name:?}"))
        };
        let truth = || -> anyhow::Result<Truth> {
            Ok(Truth {
                map: open(names::WORLD_MAP)?,
                actors: open(names::WORLD_ACTORS)?,
                catalogue: open(names::WORLD_CATALOGUE)?,
                spawn_points: open(names::WORLD_SPAWN_POINTS)?,
            })
        };
        Ok(Documents {
            truth: (!is_sealed).then(truth).transpose()?,
            info: open(names::WORLD_INFO)?,
            info_changed: true,
            sent_info: None,
            sent_actors: None,
            described_actors: None,
            is_list_late: false,
            sent_episode: 0,
        })
    }

    /// Sends the latest documents to readers that joined since the last call.
    pub fn greet(&self) {
        self.info.greet();
        if let Some(truth) = &self.truth {
            [
                &truth.map,
                &truth.actors,
                &truth.catalogue,
                &truth.spawn_points,
            ]
            .into_iter()
            .for_each(DocumentPublisher::greet);
        }
    }

    /// Marks `world/info` as possibly changed, so that the next [`Documents::publish`] compares it.
    pub fn touch_info(&mut self) {
        self.info_changed = true;
    }

    /// Revision of the `world/actors` that lists the world's actors as they are, whether it was sent
    /// or is about to be. A snapshot names this revision. While lists cannot be sent it is that of
    /// the last one, so that nobody waits for a list that does not come.
    pub fn actors_revision(&self, world: &World) -> u64 {
        let Some(truth) = &self.truth else {
            return 0;
        };
        let is_due = self.sent_actors != Some(world.actors_revision()) && !self.is_list_late;
        truth.actors.revision() + u64::from(is_due)
    }

    /// Sends the documents that changed.
    ///
    /// # Errors
    /// [`BusError`] for the first one that cannot be sent; it and those after it are sent with the
    /// next call.
    pub fn publish(&mut self, state: &State<'_>) -> Result<(), BusError> {
        let (world, stamp) = (state.world.world(), state.world.episode().stamp());
        let (epoch, tick) = (stamp.epoch, state.clock.tick().0);
        let new_episode = self.sent_episode != stamp.episode;
        if let Some(truth) = self.truth.as_mut().filter(|_| new_episode) {
            truth.map.send(&world.map().open_drive, epoch, tick)?;
            truth.catalogue.send_json(world.catalogue(), epoch, tick)?;
            let points = world
                .map()
                .spawn_points
                .iter()
                .map(|pose| (*pose).into())
                .collect();
            truth
                .spawn_points
                .send_json(&SpawnPoints { points }, epoch, tick)?;
        }
        self.sent_episode = stamp.episode;
        let list = self.send_list(world, epoch, tick);
        let revision = Some(world.actors_revision());
        if self.info_changed || new_episode || self.described_actors != revision {
            let info = match self.truth {
                Some(_) => info(state),
                None => info(state).sealed(),
            };
            if self.sent_info.as_ref() != Some(&info) {
                self.info.send_json(&info, epoch, tick)?;
                self.sent_info = Some(info);
            }
            self.info_changed = false;
            self.described_actors = revision;
        }
        list
    }

    fn send_list(&mut self, world: &World, epoch: u64, tick: u64) -> Result<(), BusError> {
        let Some(truth) = &mut self.truth else {
            return Ok(());
        };
        if self.sent_actors == Some(world.actors_revision()) {
            return Ok(());
        }
        self.is_list_late = true;
        truth.actors.send_json(&world.actor_list(), epoch, tick)?;
        self.is_list_late = false;
        self.sent_actors = Some(world.actors_revision());
        Ok(())
    }
}

fn info(state: &State<'_>) -> WorldInfo {
    let (world, episode) = (state.world.world(), state.world.episode());
    let stamp = episode.stamp();
    let batches = state.sensors.batches.iter();
    let targets = state.sensors.topics().filter_map(|topic| topic.target());
    WorldInfo {
        source: "live".into(),
        version: env!("CARGO_PKG_VERSION").into(),
        epoch: stamp.epoch.to_string(),
        episode: stamp.episode,
        map: world.map().name.clone(),
        seed: stamp.seed,
        mode: state.participants.mode(),
        period_nanos: state.clock.period_nanos(),
        episode_start_nanos: episode.start().0,
        lockstep: state.participants.names(),
        weather: *world.weather(),
        adapter: adapter_of(state.sensors.gpu()).to_owned(),
        batches: batches
            .map(|batch| batch.info(&state.sensors.sensors))
            .collect(),
        cameras: cameras(state),
        cpu_copies: targets.map(|target| target.cpu_copies()).max().unwrap_or(0),
    }
}

/// The cameras of the run, without that of the spectator.
fn cameras(state: &State<'_>) -> Vec<CameraInfo> {
    let sensors = state.sensors.sensors.iter();
    let mut cameras: Vec<CameraInfo> = sensors
        .filter(|sensor| sensor.role == Role::Sensor)
        .filter_map(|sensor| {
            let SensorSpec::Camera(camera) = &sensor.spec else {
                return None;
            };
            Some(CameraInfo {
                name: format!("{}/{}", sensor.rig.name, sensor.name),
                sensor_id: sensor.actor.0,
                calibration: camera.calibration()?,
                mount: state.world.world().mount(sensor.actor).map(Into::into),
                readout: Readout::Global,
            })
        })
        .collect();
    cameras.sort_by_key(|camera| camera.sensor_id);
    cameras
}
