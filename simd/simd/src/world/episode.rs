//! An episode: from one map load to the next.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::Context as _;
use launch_cli::wrong_usage;
use launch_spec::{Launch, Rig as RigSpec};
use nalgebra::{Point3, Vector3};
use schema_frames::SnapshotHeader;
use schema_roads::DEFAULT_GEO_REFERENCE;
use schema_types::{ActorId, Pose, SimTime, Tick};
use sensor_core::gnss::GeoReference;
use sensor_core::scene::SceneAssets;
use sensor_core::stream::Tiles;
use sensor_spec::SensorSpec;
use simd_world::{EgoSpawn, Scenario, SceneryRevisions, World};

use crate::world::maps::LoadedMap;
use crate::world::scenery_stream::SceneryStream;
use simd_frames::frames::{Sensors, Stamp};

/// The episode that runs.
pub struct Episode {
    /// The part of the map's static scenery that is visible.
    assets: Arc<SceneAssets>,
    /// The map's complete static scenery; `assets` is the part that is currently visible.
    whole: Arc<SceneAssets>,
    /// On a large map, what of the visible scenery is there.
    stream: Option<SceneryStream>,
    /// Revisions of the scenery that `assets` shows.
    shown: SceneryRevisions,
    /// What is the same in all headers.
    stamp: Stamp,
    /// Simulated time at which it began.
    start: SimTime,
    /// Ego and other vehicles.
    scenario: Scenario,
}

/// Which episode begins, and when.
#[derive(Clone, Copy, Debug)]
pub struct EpisodeId {
    /// Random number of the daemon's start.
    pub epoch: u64,
    /// Count of map loads, from 1.
    pub episode: u32,
    /// Simulated time at which it begins.
    pub start: SimTime,
}

/// What changed in the scenery.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SceneryChange {
    /// Objects were hidden or shown.
    pub objects: bool,
    /// Lamps were switched, or dusk or dawn switched them.
    pub lamps: bool,
}

impl SceneryChange {
    /// Flags of the snapshot that tells of the change.
    pub fn snapshot_flags(self) -> u32 {
        let flag = |changed: bool, flag: u32| if changed { flag } else { 0 };
        flag(self.objects, SnapshotHeader::SCENERY_CHANGED)
            | flag(self.lamps, SnapshotHeader::LAMPS_CHANGED)
    }
}

impl Episode {
    /// The part of the map's static scenery that is visible.
    pub fn assets(&self) -> &Arc<SceneAssets> {
        &self.assets
    }

    /// What is the same in all headers.
    pub fn stamp(&self) -> &Stamp {
        &self.stamp
    }

    /// Simulated time at which it began.
    pub fn start(&self) -> SimTime {
        self.start
    }

    /// Ego and other vehicles.
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// It counts as begun at another time.
    pub fn start_at(&mut self, start: SimTime) {
        self.start = start;
    }

    /// On a large map, brings the scenery near the sensors.
    ///
    /// # Errors
    /// When frames in flight cannot be sent.
    pub fn follow(
        &mut self,
        sensors: &mut Sensors,
        world: &World,
        Tick(tick): Tick,
    ) -> anyhow::Result<()> {
        if let Some(stream) = &mut self.stream {
            stream.follow(sensors, world, tick)?;
            self.assets = stream.shown().clone();
        }
        Ok(())
    }

    /// On a large map, brings the scenery that rays of a query pass.
    pub fn ask(
        &mut self,
        sensors: &mut Sensors,
        rays: &[(Point3<f64>, Vector3<f64>, f64)],
        Tick(tick): Tick,
    ) {
        if let Some(stream) = &mut self.stream {
            stream.ask(sensors, rays, tick);
        }
    }

    /// On a large map, the scenery that rays have.
    pub fn ray_scenery(&self) -> Option<Arc<SceneAssets>> {
        self.stream.as_ref().map(SceneryStream::hit)
    }

    /// Takes over what was hidden, shown or switched in the world since the last call; `None` if
    /// nothing was.
    pub fn take_scenery(&mut self, world: &World) -> Option<SceneryChange> {
        let (now, before) = (world.scenery_revisions(), self.shown);
        if now == before {
            return None;
        }
        let is_switched = now.lamps != before.lamps;
        let change = SceneryChange {
            objects: now.objects != before.objects,
            lamps: is_switched || now.is_dark != before.is_dark,
        };
        self.shown = now;
        // Sensors know the time of day from the weather.
        if change.objects || is_switched {
            let mut assets = self.whole.without(world.hidden_objects());
            assets.switched = world.switched_lamps();
            self.assets = Arc::new(assets);
            if let Some(stream) = &mut self.stream {
                stream.set_visible(self.assets.clone());
                self.assets = stream.shown().clone();
            }
        }
        Some(change)
    }
}

/// Puts a map into the world and populates it as the launch file says. A map that cannot be used
/// leaves the running episode as it is.
pub fn begin(
    world: &mut World,
    launch: &Launch,
    map: &LoadedMap,
    id: EpisodeId,
) -> anyhow::Result<Episode> {
    let mut assets = SceneAssets {
        episode: id.episode,
        ..map.assets.clone()
    };
    world.load_shared(&map.data)?;
    world.register_meshes(&mut assets);
    world
        .set_weather(launch.scenario.weather)
        .map_err(wrong_usage)?;
    world.set_weather_effects(launch.scenario.weather_effects);
    let ego = (!launch.ego.is_none()).then(|| EgoSpawn {
        type_id: &launch.ego.type_id,
        spawn_idx: launch.ego.spawn_point as usize % map.data.spawn_points.len().max(1),
    });
    let scenario = world.spawn_scenario(ego, launch.scenario.vehicles as usize)?;
    if scenario.others.len() < launch.scenario.vehicles as usize {
        tracing::warn!(
            asked = launch.scenario.vehicles,
            placed = scenario.others.len(),
            "the map has no free spawn point for more vehicles"
        );
    }
    let n_walkers = world.spawn_walkers(launch.scenario.walkers as usize).len();
    if n_walkers < launch.scenario.walkers as usize {
        tracing::warn!(
            asked = launch.scenario.walkers,
            placed = n_walkers,
            "the map has no room on its pavements for more walkers"
        );
    }
    let (latitude_deg, longitude_deg) = world
        .roads()
        .map_or(DEFAULT_GEO_REFERENCE, |roads| roads.geo_reference());
    let stamp = Stamp {
        epoch: id.epoch,
        episode: id.episode,
        seed: launch.scenario.seed,
        geo_reference: GeoReference {
            latitude_deg,
            longitude_deg,
        },
    };
    let tiles = Tiles::of(&mut assets);
    let whole = Arc::new(assets);
    let stream = tiles.map(|tiles| SceneryStream::new(tiles, whole.clone()));
    Ok(Episode {
        assets: stream.as_ref().map_or(&whole, SceneryStream::shown).clone(),
        whole,
        stream,
        shown: world.scenery_revisions(),
        stamp,
        start: id.start,
        scenario,
    })
}

/// Makes a sensor's passive actor on its rig's vehicle or place; one that is added to an old run
/// gets an id of a range of its own.
pub fn spawn_sensor(
    world: &mut World,
    scenario: &Scenario,
    rig: &RigSpec,
    spec: &SensorSpec,
    name: &str,
    is_added: bool,
) -> anyhow::Result<ActorId> {
    let mount = spec.mount().vehicle_from_sensor();
    let (parent, pose): (_, Pose) = match rig {
        RigSpec::Ego => (
            Some(
                scenario
                    .ego
                    .context("the sensor rides on the ego vehicle, but there is none")?,
            ),
            mount.into(),
        ),
        RigSpec::Other(idx) => {
            let other = scenario.others.get(*idx as usize);
            (
                Some(*other.with_context(|| {
                    format!("other vehicle {idx} could not be placed on the map")
                })?),
                mount.into(),
            )
        }
        RigSpec::Free(place) => (None, (place.pose().isometry() * mount).into()),
    };
    let type_id = sensor_type(spec);
    let actor = match is_added {
        true => world.spawn_added_sensor(type_id, pose, parent, name)?,
        false => world.spawn(type_id, pose, parent, name, &BTreeMap::new())?,
    };
    world.set_attachment(actor, spec.mount().attachment)?;
    Ok(actor)
}

/// Catalogue id of a sensor's actor.
fn sensor_type(spec: &SensorSpec) -> &'static str {
    match spec {
        SensorSpec::Camera(_) => "sensor.camera.view",
        SensorSpec::Lidar(lidar) if lidar.semantic => "sensor.lidar.ray_cast_semantic",
        SensorSpec::Lidar(_) => "sensor.lidar.ray_cast",
        SensorSpec::Imu(_) => "sensor.other.imu",
        SensorSpec::Gnss(_) => "sensor.other.gnss",
        SensorSpec::Radar(_) => "sensor.other.radar",
        SensorSpec::Obstacle(_) => "sensor.other.obstacle",
        SensorSpec::Collision(_) => "sensor.other.collision",
        SensorSpec::LaneInvasion(_) => "sensor.other.lane_invasion",
    }
}
