//! From a launch file to a running daemon, and from a map name to an episode.

use std::collections::BTreeMap;
use std::rc::Rc;
use std::sync::Arc;

use anyhow::Context as _;
use launch_cli::{Shutdown, wrong_usage};
use launch_spec::{Launch, LidarsOn, Rig as RigSpec};
use schema_bus::{Bus, mono_now, names};
use schema_roads::DEFAULT_GEO_REFERENCE;
use schema_types::time::TickClock;
use schema_types::{ActorId, Pose, SimTime, Tick};
use sensor_camera::{CameraRenderer, Quality};
use sensor_core::gnss::GeoReference;
use sensor_core::scene::SceneAssets;
use sensor_gpu::{CopyPath, Gpu, GpuOptions};
use sensor_ray::GpuRays;
use simd_world::{EgoSpawn, Scenario, World, WorldOptions};

use crate::cli::{Args, LidarsOnArg, QualityArg};
use crate::daemon::{Daemon, Episode, Ports};
use crate::documents::Documents;
use crate::frames::{Sensors, Stamp};
use crate::gate::Gate;
use crate::maps::{LoadedMap, Maps};
use crate::pace::Pace;
use crate::rig::{Rig, Sensor, SensorPlace, TopicOptions, noise_stream, schedule_of};

/// Most actors a snapshot can carry: 4096 records of 256 bytes are 1 MiB a slot.
const MAX_ACTORS: usize = 4096;

/// Reads and checks the launch file; without one, the built-in defaults.
pub fn read_launch(args: &Args) -> anyhow::Result<Launch> {
    let (text, name) = match &args.launch {
        Some(path) => (
            std::fs::read_to_string(path).map_err(|error| {
                wrong_usage(format!(
                    "cannot read launch file: {error}: {}",
                    path.display()
                ))
            })?,
            path.display().to_string(),
        ),
        None => (
            "version = 1\n[scenario]\nvehicles = 20\n".to_owned(),
            "built-in defaults".to_owned(),
        ),
    };
    // The last word counts, so `--map` comes after every `--set`.
    let map = args
        .map
        .iter()
        .map(|map| format!("scenario.map={}", toml_text(map)));
    let set: Vec<String> = args.set.iter().cloned().chain(map).collect();
    Launch::parse_with(&text, &name, &set).map_err(wrong_usage)
}

/// A text as TOML writes it.
fn toml_text(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

/// Whether `gpu` casts the lidars: if the command line or else the launch file asks, else if it is
/// a real one that can.
fn casts_lidars(gpu: &Gpu, asked: Option<LidarsOnArg>, in_file: LidarsOn) -> anyhow::Result<bool> {
    let missing = GpuRays::missing(gpu);
    let (on_gpu, whose) = match (asked, in_file) {
        (Some(asked), _) => (asked == LidarsOnArg::Gpu, "--lidars-on gpu"),
        (None, LidarsOn::Auto) => (missing.is_none() && !gpu.is_software(), ""),
        (None, asked) => (asked == LidarsOn::Gpu, "scenario.lidars_on = \"gpu\""),
    };
    match missing {
        Some(missing) if on_gpu => {
            return Err(wrong_usage(format!(
                "{whose}: {missing}; say cpu, or choose another --adapter"
            )));
        }
        Some(missing) if !gpu.is_software() => {
            tracing::info!(missing, "lidars are cast on the CPU")
        }
        _ => {}
    }
    Ok(on_gpu)
}

/// Brings everything up. Fails before anything is published if the domain is taken or memory is
/// short.
pub fn start(mut args: Args, shutdown: Shutdown) -> anyhow::Result<Daemon> {
    let launch = read_launch(&args)?;
    let bus = Bus::open(&args.common.domain, "simd")?;
    if bus.daemon_alive()? {
        return Err(wrong_usage(format!(
            "domain {0:?} already has a daemon; stop it, or choose another name with --domain",
            args.common.domain
        )));
    }
    check_memory(&launch, &args)?;
    let copies = if args.one_queue {
        CopyPath::Behind
    } else {
        CopyPath::Beside
    };
    let gpu = Gpu::open(&GpuOptions {
        adapter: args.adapter.clone(),
        allow_import: !args.staged,
        copies,
    })?;
    let quality = match args.quality {
        Some(QualityArg::Low) => Quality::Low,
        Some(QualityArg::High) => Quality::High,
        None => Quality::default_for(&gpu),
    };
    tracing::info!(
        adapter = gpu.name(),
        ?quality,
        import = gpu.can_import() && !args.staged,
        "rendering"
    );
    let lidars_on_gpu = casts_lidars(&gpu, args.lidars_on, launch.scenario.lidars_on)?;
    args.lidars_on = Some(if lidars_on_gpu {
        LidarsOnArg::Gpu
    } else {
        LidarsOnArg::Cpu
    });
    let renderer = CameraRenderer::new(&gpu, quality);
    let period_nanos = launch.scenario.period_nanos();
    let mut world = World::new(WorldOptions {
        seed: launch.scenario.seed,
        ..Default::default()
    });
    let epoch = new_epoch();
    let mut maps = Maps::new(
        &launch_cli::data_dir(args.data.as_deref())?,
        args.launch.as_deref(),
    );
    let map = maps.load(&launch.scenario.map, launch.scenario.seed)?;
    let episode = begin_episode(&mut world, &launch, &map, epoch, 1, SimTime(0))?;
    let sensors = open_sensors(
        &bus,
        &gpu,
        &mut world,
        &episode.scenario,
        &launch,
        &args,
        period_nanos,
    )?;
    let mut sensors = Sensors::new(
        gpu,
        renderer,
        sensors,
        args.frames_in_flight,
        args.hash,
        lidars_on_gpu,
    );
    sensors.load(&episode.assets)?;
    let ports = open_ports(&bus)?;
    let now = mono_now().0;
    let mut daemon = Daemon {
        gate: Gate::new(launch.scenario.mode),
        pace: Pace::new(now, period_nanos),
        clock: TickClock::new(period_nanos),
        tick: Tick(0),
        last_client_nanos: now,
        last_cleaned_nanos: now,
        running_alone: false,
        n_controls_refused: 0,
        checkpoints: Default::default(),
        debug: Default::default(),
        args,
        launch,
        sensors,
        ports,
        bus,
        world,
        maps,
        episode,
        shutdown,
    };
    daemon.mark_start();
    daemon.publish_documents()?;
    // Who must be ready before the first tick (lockstep, drivers) sees the world as it stands
    // before it.
    daemon.publish_snapshot(SimTime(0))?;
    tracing::info!(
        map = daemon.world.map().name,
        actors = daemon.world.snapshot_records().len(),
        "ready"
    );
    Ok(daemon)
}

/// The segments of all topics are summed before the first is made: half a rig is worse than none.
fn check_memory(launch: &Launch, args: &Args) -> anyhow::Result<()> {
    let segments = launch.memory_budget().into_iter().map(|topic| {
        let spec = schema_bus::FrameTopic {
            frames_in_flight: args.frames_in_flight as usize,
            ..schema_bus::FrameTopic::new(topic.modality, topic.max_payload_bytes)
        };
        spec.segment_bytes(topic.modality)
    });
    let need_bytes = schema_bus::shared_memory_needed(segments);
    schema_bus::check_shared_memory(need_bytes, 0).map_err(|short| {
        let mib = |bytes: u64| bytes.div_ceil(1 << 20);
        wrong_usage(format!(
            "the sensors need {} MiB of shared memory, but /dev/shm has {} MiB free; free space, make it larger (Docker: --shm-size={}m) or ask for fewer or smaller images",
            mib(need_bytes),
            mib(short.free_bytes.unwrap_or(0)),
            mib(need_bytes) + 64
        ))
    })
}

fn open_ports(bus: &Bus) -> anyhow::Result<Ports> {
    Ok(Ports {
        snapshot: bus.snapshot_publisher(MAX_ACTORS)?,
        snapshot_wake: bus.notifier(names::WORLD_SNAPSHOT)?,
        commands: bus.command_server()?,
        controls: bus.control_reader()?,
        acks: bus.ack_reader()?,
        wake: bus.listener(names::CONTROL_WAKE)?,
        documents: Documents::open(bus)?,
    })
}

/// Puts a map into the world and populates it as the launch file says. A map that cannot be used
/// leaves the running episode as it is.
pub fn begin_episode(
    world: &mut World,
    launch: &Launch,
    map: &LoadedMap,
    epoch: u64,
    episode: u32,
    start: SimTime,
) -> anyhow::Result<Episode> {
    let mut assets = SceneAssets {
        episode,
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
        epoch,
        episode,
        seed: launch.scenario.seed,
        geo_reference: GeoReference {
            latitude_deg,
            longitude_deg,
        },
    };
    let whole = Arc::new(assets);
    Ok(Episode {
        assets: whole.clone(),
        whole,
        scenery: world.scenery_revisions(),
        stamp,
        start,
        scenario,
    })
}

fn open_sensors(
    bus: &Bus,
    gpu: &Gpu,
    world: &mut World,
    scenario: &Scenario,
    launch: &Launch,
    args: &Args,
    period_nanos: u64,
) -> anyhow::Result<Vec<Sensor>> {
    let options = TopicOptions {
        frames_in_flight: args.frames_in_flight,
        staged: args.staged,
        lidars_on_gpu: args.lidars_on == Some(LidarsOnArg::Gpu),
        seed: launch.scenario.seed,
        on_demand: false,
        period_nanos,
    };
    let mut sensors: Vec<Sensor> = Vec::new();
    for placed in launch.placed_sensors() {
        let spec = launch
            .rigs
            .get(placed.rig)
            .expect("a checked launch file has every rig it names");
        let rig = match sensors.iter().find(|sensor| sensor.rig.name == placed.rig) {
            Some(sensor) => sensor.rig.clone(),
            None => Rc::new(Rig {
                name: placed.rig.to_owned(),
                wake: bus.notifier(&names::rig_tick(placed.rig))?,
            }),
        };
        let actor = spawn_sensor(world, scenario, spec, placed.spec, placed.name)?;
        let stream = noise_stream(&[placed.rig.as_bytes(), placed.name.as_bytes()]);
        let place = SensorPlace {
            rig,
            place: Some(*spec),
            name: placed.name.to_owned(),
            actor,
            stream,
        };
        let schedule = schedule_of(placed.spec, SimTime(0), period_nanos);
        let sensor = Sensor::open(bus, gpu, place, placed.spec.clone(), schedule, &options)?;
        world.set_topics(actor, sensor.topic_infos())?;
        sensors.push(sensor);
    }
    Ok(sensors)
}

/// Makes a sensor's passive actor on its rig's vehicle or place.
fn spawn_sensor(
    world: &mut World,
    scenario: &Scenario,
    rig: &RigSpec,
    spec: &sensor_spec::SensorSpec,
    name: &str,
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
    let actor = world.spawn(sensor_type(spec), pose, parent, name, &BTreeMap::new())?;
    world.set_attachment(actor, spec.mount().attachment)?;
    Ok(actor)
}

/// Catalogue id of a sensor's actor.
fn sensor_type(spec: &sensor_spec::SensorSpec) -> &'static str {
    use sensor_spec::SensorSpec;
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

impl Daemon {
    /// A new episode on another map (or the same one): the launch file's actors are made anew and
    /// its topics stay; sensors that
    /// commands made go.
    pub(crate) fn load_map(&mut self, map: &str) -> anyhow::Result<()> {
        self.sensors.finish_all()?;
        let sim_time = self.clock.time_of(self.tick);
        let stamp = self.episode.stamp;
        let loaded = self.maps.load(map, self.launch.scenario.seed)?;
        self.episode = begin_episode(
            &mut self.world,
            &self.launch,
            &loaded,
            stamp.epoch,
            stamp.episode + 1,
            sim_time,
        )?;
        self.sensors.remove(|sensor| sensor.place.is_none())?;
        for sensor in &mut self.sensors.sensors {
            let rig = sensor
                .place
                .as_ref()
                .expect("those without a place were removed");
            let actor = spawn_sensor(
                &mut self.world,
                &self.episode.scenario,
                rig,
                &sensor.spec,
                &sensor.name,
            )?;
            self.world.set_topics(actor, sensor.topic_infos())?;
            sensor.begin_episode(actor, sim_time, self.clock.period_nanos());
        }
        self.sensors.load(&self.episode.assets)?;
        self.debug.clear();
        self.mark_start();
        self.ports.documents.touch_info();
        tracing::info!(map, episode = self.episode.stamp.episode, "map loaded");
        Ok(())
    }
}

/// Tells one start of the daemon from another.
fn new_epoch() -> u64 {
    let wall = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .map_or(0, |since| since.as_nanos() as u64);
    schema_types::noise::mix(wall ^ schema_types::noise::mix(std::process::id() as u64))
}
