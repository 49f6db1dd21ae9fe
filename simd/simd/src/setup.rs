//! From settings to a running daemon.

use launch_cli::wrong_usage;
use launch_spec::Launch;
use schema_bus::{Bus, FrameTopic, mono_now, names};
use schema_frames::JournalFile;
use schema_frames::document::BATCH_RIG;
use schema_types::{SimTime, Tick};
use sensor_camera::{CameraRenderer, Quality};
use sensor_gpu::Gpu;
use simd_world::{Scenario, World, WorldOptions};

use crate::clock::Clock;
use crate::daemon::Daemon;
use crate::files::Files;
use crate::history::{self, Act, History, Journal, Player};
use crate::participants::Participants;
use crate::ports::{Ports, Services};
use crate::sensing::{Sensing, Workers, spectator};
use crate::settings::{Settings, adapter_of};
use crate::world::LiveWorld;
use crate::world::checkpoints::Checkpoints;
use crate::world::episode::{self, EpisodeId};
use crate::world::maps::Maps;
use simd_frames::batch::{Batch, BatchPlan};
use simd_frames::frames::Sensors;
use simd_frames::rig::Rig;
use simd_frames::sensor::{
    NoiseStream, OpenContext, Role, Sensor, SensorIdentity, schedule_of, shared_rig,
};
use simd_frames::topic::{MemoryLife, Transfer, gpu_server, limited};

/// Brings everything up. Fails before anything is published if the domain is taken or memory is
/// short.
pub fn start(settings: Settings) -> anyhow::Result<Daemon> {
    let bus = Bus::open(&settings.domain, "simd")?;
    let claim = bus.claim_world()?;
    let (Some(claim), false) = (claim, bus.daemon_alive()?) else {
        return Err(wrong_usage(format!(
            "domain {0:?} already has a daemon; stop it, or choose another name with --domain",
            settings.domain
        )));
    };
    let launch = &settings.launch;
    check_memory(launch, settings.frames_in_flight)?;
    let gpu = settings.gpu.as_ref().map(Gpu::open).transpose()?;
    let quality = match (settings.quality, &gpu) {
        (Some(quality), _) => quality,
        (None, Some(gpu)) => Quality::default_for(gpu),
        (None, None) => Quality::Low,
    };
    match &gpu {
        Some(gpu) => tracing::info!(
            adapter = gpu.name(),
            ?quality,
            import = gpu.can_import() && settings.transfer == Transfer::Imported,
            "rendering"
        ),
        None => tracing::info!("no GPU is opened; render workers make the images"),
    }
    check_gpu_memory(&settings, gpu.as_ref())?;
    let gpu_server = gpu_server(&bus, gpu.as_ref());
    let frames = settings.frame_options(gpu.as_ref())?;
    let drawing = gpu.clone().map(|gpu| {
        let mut renderer = CameraRenderer::new(&gpu, quality);
        if let Some(most_bytes) = settings.gpu_memory_bytes {
            renderer.limit_target_bytes(most_bytes);
        }
        (gpu, renderer)
    });
    let period_nanos = launch.scenario.period_nanos();
    let mut world = World::new(WorldOptions {
        seed: launch.scenario.seed,
        ..Default::default()
    });
    let mut maps = Maps::new(&settings.data_folder, settings.launch_folder.clone());
    let (mut player, journal_reader) = settings
        .journal
        .as_deref()
        .map(|file| Player::open(file, settings.journal_until_nanos))
        .transpose()?
        .unzip();
    if let Some(player) = &mut player {
        warn_of_differences(player, adapter_of(gpu.as_ref()));
        for act in player.first_files() {
            if let Act::File {
                name, title, bytes, ..
            } = act
            {
                maps.provide(name, title, &bytes);
            }
        }
    }
    let map = maps.load(&launch.scenario.map, launch.scenario.seed)?;
    let id = EpisodeId {
        epoch: new_epoch(),
        episode: 1,
        start: SimTime(0),
    };
    let episode = episode::begin(&mut world, launch, &map, id)?;
    let context = OpenContext {
        bus: &bus,
        gpu: gpu.as_ref(),
        server: gpu_server.as_ref(),
        frames: &frames,
        memory: MemoryLife::Lasting,
        limits: &|topic| launch.limits_of(topic),
        seed: launch.scenario.seed,
        tick: Tick(0),
        period_nanos,
        is_told: player.is_some(),
        cameras_are_away: settings.run.n_awaited_workers > 0,
    };
    let mut sensors = open_sensors(
        &context,
        &mut world,
        episode.scenario(),
        launch,
        &settings.added_sensors,
    )?;
    // It has the least actor id, and sensors are in the order of theirs.
    sensors.insert(0, spectator::open(&context, &mut world, launch)?);
    let batches = open_batches(&context, launch)?;
    let mut sensors = Sensors::new(drawing, sensors, frames);
    sensors.batches = batches;
    sensors.check_fit()?;
    sensors.load(episode.assets())?;
    let head = history::head(&history::Surroundings {
        settings: &settings,
        epoch: episode.stamp().epoch,
        map: &map.data.name,
        open_drive: &map.data.open_drive,
        adapter: adapter_of(sensors.gpu()),
        quality,
        lidars_on: sensors.options().lidars_on,
    });
    let mut journal = Journal::new(head, settings.journal_bytes);
    if let Some(text) = maps.file_text(&launch.scenario.map)? {
        let (name, title) = (&launch.scenario.map, &map.data.name);
        journal.note_file(JournalFile::Map, name, title, text.as_bytes());
        journal.end_round(0);
    }
    let (epoch, n_awaited) = (episode.stamp().epoch, settings.run.n_awaited_workers);
    let workers = Workers::open(&bus, epoch, n_awaited)?;
    let services = Services::open(&bus, settings.seal.clone())?;
    let now_nanos = mono_now().0;
    let clock = Clock::new(period_nanos, &settings.run, now_nanos);
    let participants = Participants::new(&settings, now_nanos);
    let wake = bus.notifier(names::CONTROL_WAKE)?;
    let files = Files::start(
        maps,
        &settings.data_folder,
        launch.scenario.seed,
        journal_reader,
        wake,
    )?;
    let checkpoints = Checkpoints::default();
    Daemon::new(
        Sensing::new(sensors, workers, settings.lose_gpu_when),
        files,
        Ports::new(services, gpu_server, claim, bus),
        LiveWorld::new(world, episode, checkpoints, settings.launch),
        clock,
        participants,
        History::new(journal, player),
    )
}

/// Checks the shared memory of all topics together, before the first segment is made. Otherwise the
/// daemon could fail with half of its sensors open.
fn check_memory(launch: &Launch, frames_in_flight: u32) -> anyhow::Result<()> {
    let segments = launch.memory_budget().into_iter().map(|topic| {
        let usual = FrameTopic::new(topic.modality, topic.max_payload_bytes);
        let spec = FrameTopic {
            frames_in_flight: frames_in_flight as usize,
            ..limited(usual, topic.limits)
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

/// Checks the GPU's memory for the topics that the launch file keeps there: their slots are
/// committed memory. Where render workers make the frames, they do.
fn check_gpu_memory(settings: &Settings, gpu: Option<&Gpu>) -> anyhow::Result<()> {
    let awaits_workers = settings.run.n_awaited_workers > 0;
    let kept: Vec<_> = settings
        .launch
        .memory_budget()
        .into_iter()
        .filter(|topic| topic.limits.gpu)
        .collect();
    if kept.is_empty() || awaits_workers {
        return Ok(());
    }
    let Some(gpu) = gpu else {
        return Err(wrong_usage(format!(
            "topic {:?} has gpu = true, but the simulator opens no GPU; remove gpu, or --no-gpu, or let it wait for a render worker (--await-workers 1)",
            kept[0].topic
        )));
    };
    if !gpu.can_export() {
        return Err(wrong_usage(format!(
            "topic {:?} has gpu = true, but the driver of {:?} lacks VK_KHR_external_memory_fd; remove gpu, or take another --adapter",
            kept[0].topic,
            gpu.name()
        )));
    }
    let bytes_of = |topic: &launch_spec::TopicBudget| {
        let usual = FrameTopic::on_gpu(settings.frames_in_flight as usize);
        let spec = FrameTopic {
            max_readers: topic
                .limits
                .gpu_readers
                .map_or(usual.max_readers, |n| n as usize),
            ..usual
        };
        (topic.max_payload_bytes * spec.n_slots()) as u64
    };
    let need_bytes: u64 = kept.iter().map(bytes_of).sum();
    let free_bytes = gpu.free_memory_bytes();
    if need_bytes <= free_bytes {
        return Ok(());
    }
    let mib = |bytes: u64| bytes.div_ceil(1 << 20);
    Err(wrong_usage(format!(
        "the {} topics with gpu = true need {} MiB on the GPU, but {:?} has {} MiB free; give them fewer gpu_readers, or fewer or smaller images",
        kept.len(),
        mib(need_bytes),
        gpu.name(),
        mib(free_bytes)
    )))
}

/// Opens the batches of the launch file.
fn open_batches(context: &OpenContext<'_>, launch: &Launch) -> anyhow::Result<Vec<Batch>> {
    if launch.batches.is_empty() {
        return Ok(Vec::new());
    }
    let rig = Rig::open(context.bus, BATCH_RIG)?;
    let budget = launch.batch_budget();
    let open = |(number, (name, batch)): (u32, (&String, &launch_spec::Batch))| {
        let topics = batch.modalities.iter().filter_map(|modality| {
            let topic = launch_spec::Batch::topic(name, *modality);
            budget.iter().find(|it| it.topic == topic).cloned()
        });
        let plan = BatchPlan {
            number,
            name: name.clone(),
            cameras: batch.cameras.clone(),
            topics: topics.collect(),
        };
        Batch::open(context, &rig, plan)
    };
    (0..).zip(&launch.batches).map(open).collect()
}

/// Opens the sensors of the launch file and makes their actors.
fn open_sensors(
    context: &OpenContext<'_>,
    world: &mut World,
    scenario: &Scenario,
    launch: &Launch,
    added: &[String],
) -> anyhow::Result<Vec<Sensor>> {
    let mut sensors: Vec<Sensor> = Vec::new();
    // Added sensors come last, in the order in which they are named.
    let place_of = |name: &str| added.iter().position(|other| other == name);
    let mut all = launch.placed_sensors();
    all.sort_by_key(|placed| place_of(placed.name));
    for placed in all {
        let launch_rig = launch
            .rigs
            .get(placed.rig)
            .expect("a checked launch file has every rig it names");
        let rig = shared_rig(&sensors, context.bus, placed.rig)?;
        let is_added = place_of(placed.name).is_some();
        let actor = episode::spawn_sensor(
            world,
            scenario,
            launch_rig,
            placed.spec,
            placed.name,
            is_added,
        )?;
        let identity = SensorIdentity {
            rig,
            launch_rig: Some(*launch_rig),
            name: placed.name.to_owned(),
            actor,
            stream: NoiseStream::named(placed.rig, placed.name),
            is_added,
            role: Role::Sensor,
        };
        let schedule = schedule_of(placed.spec, SimTime(0), context.period_nanos);
        let sensor = Sensor::open(context, identity, placed.spec.clone(), schedule)?;
        world.set_topics(actor, sensor.topic_infos())?;
        sensors.push(sensor);
    }
    sensors.sort_by_key(|sensor| sensor.actor);
    Ok(sensors)
}

/// Says what may make the bytes of a run differ from those of its journal.
fn warn_of_differences(player: &Player, adapter: &str) {
    let (head, build) = (player.head(), history::build());
    if head.build != build {
        tracing::warn!(
            recorded = head.version,
            "the journal is of another build of the simulator, so frames may differ: {} then, {build} now",
            head.build
        );
    }
    if head.adapter != adapter {
        tracing::warn!(
            "the journal's run rendered on {:?} and this one does on {adapter:?}, so images may differ",
            head.adapter
        );
    }
}

/// Tells one start of the daemon from another.
fn new_epoch() -> u64 {
    let wall = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .map_or(0, |since| since.as_nanos() as u64);
    schema_types::noise::mix(wall ^ schema_types::noise::mix(std::process::id() as u64))
}
