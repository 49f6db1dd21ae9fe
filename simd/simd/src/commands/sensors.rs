//! Sensors that commands make and end while the world runs.

use std::collections::BTreeMap;

use anyhow::{Context as _, bail, ensure};
use schema_frames::{Attachment, CommandReply, MAX_HIDDEN};
use schema_types::{ActorId, Pose};
use sensor_core::schedule::Schedule;
use sensor_spec::SensorSpec;

use crate::daemon::Daemon;
use simd_frames::sensor::{NoiseStream, OpenContext, Role, Sensor, SensorIdentity, shared_rig};
use simd_frames::topic::MemoryLife;

/// Most sensors at a time. Each needs several files and services.
const MAX_SENSORS: usize = 512;

/// What `spawn_sensor` asks for.
pub struct SensorWish<'a> {
    /// Catalogue id under which it is listed.
    pub type_id: &'a str,
    /// World pose, or pose on the parent.
    pub pose: Pose,
    /// Actor that it is attached to.
    pub parent: Option<ActorId>,
    /// How it follows that actor.
    pub attachment: Attachment,
    /// Time between firings; 0 fires at every tick.
    pub interval_nanos: u64,
    /// The keys of a launch file's `[sensor.NAME]`.
    pub spec: &'a serde_json::Map<String, serde_json::Value>,
    /// Attributes for `world/actors`.
    pub attributes: &'a BTreeMap<String, String>,
}

/// Makes the actor and its topics. The topics have no memory until somebody reads them.
pub fn spawn(daemon: &mut Daemon, wish: &SensorWish<'_>) -> anyhow::Result<CommandReply> {
    ensure!(
        daemon.sensors.sensors.len() < MAX_SENSORS,
        "there are {MAX_SENSORS} sensors already, which is the most; destroy one first"
    );
    let spec = read_spec(wish.spec, daemon.clock.period_nanos())?;
    if !daemon.workers.has_any() {
        daemon.sensors.admit(&spec)?;
    }
    let actor = daemon
        .world
        .spawn(wish.type_id, wish.pose, wish.parent, "", wish.attributes)?;
    let made = daemon
        .world
        .set_attachment(actor, wish.attachment)
        .map_err(anyhow::Error::from);
    match made.and_then(|()| open(daemon, wish, spec, actor)) {
        Ok(topics) => Ok(CommandReply::Spawned {
            actor_id: actor.0,
            topics,
        }),
        Err(error) => {
            daemon
                .world
                .destroy(actor)
                .context("the sensor's actor could not be taken back")?;
            Err(error)
        }
    }
}

/// Removes an actor and everything attached to it. Sensors among these end.
pub fn destroy(daemon: &mut Daemon, actor: ActorId) -> anyhow::Result<CommandReply> {
    let gone = daemon.world.destroy(actor)?;
    let is_owed = !daemon.gate.participants().is_empty();
    daemon
        .sensors
        .remove(|sensor| gone.contains(&sensor.actor), is_owed)?;
    // It says whose images batches have.
    daemon.ports.documents.touch_info();
    Ok(CommandReply::Done)
}

/// Leaves actors out of a camera's images.
pub fn hide(daemon: &mut Daemon, camera: ActorId, actors: &[u32]) -> anyhow::Result<CommandReply> {
    ensure!(
        actors.len() <= MAX_HIDDEN,
        "{} actors are to be left out, at most {MAX_HIDDEN} can be",
        actors.len()
    );
    let actors: Vec<ActorId> = actors.iter().map(|id| ActorId(*id)).collect();
    let found = daemon.sensors.sensors.iter_mut();
    let n_found = found
        .filter(|sensor| sensor.actor == camera)
        .filter_map(|sensor| sensor.hide(&actors).then_some(()))
        .count();
    ensure!(
        n_found > 0,
        "actor {camera} is no camera; only cameras leave actors out"
    );
    Ok(CommandReply::Done)
}

fn open(
    daemon: &mut Daemon,
    wish: &SensorWish<'_>,
    spec: SensorSpec,
    actor: ActorId,
) -> anyhow::Result<Vec<String>> {
    let name = wish
        .parent
        .map_or("free".to_owned(), |parent| format!("actor_{parent}"));
    let rig = shared_rig(&daemon.sensors.sensors, &daemon.bus, &name)?;
    let stream = stream_of(daemon, wish, &spec)?;
    let identity = SensorIdentity {
        rig,
        launch_rig: None,
        name: format!("s{actor}"),
        actor,
        stream,
        is_added: false,
        role: Role::Sensor,
    };
    let context = OpenContext {
        bus: &daemon.bus,
        gpu: daemon.sensors.gpu(),
        server: daemon.gpu_server.as_ref(),
        frames: daemon.sensors.options(),
        memory: MemoryLife::OnDemand,
        limits: &|topic| daemon.settings.launch.limits_of(topic),
        seed: daemon.episode.stamp.seed,
        tick: daemon.tick,
        period_nanos: daemon.clock.period_nanos(),
        is_told: daemon.player.is_some(),
        cameras_are_away: daemon.workers.has_any(),
    };
    let schedule = Schedule::new(daemon.now(), wish.interval_nanos);
    let sensor = Sensor::open(&context, identity, spec, schedule)?;
    daemon.world.set_topics(actor, sensor.topic_infos())?;
    let topics = sensor
        .topics
        .iter()
        .map(|topic| topic.name.clone())
        .collect();
    daemon.sensors.add(sensor, &daemon.episode.assets);
    Ok(topics)
}

/// The stream of noise of a sensor: from its specification, its mount, its role and its carrier's
/// type and role.
fn stream_of(
    daemon: &Daemon,
    wish: &SensorWish<'_>,
    spec: &SensorSpec,
) -> anyhow::Result<NoiseStream> {
    let keys = serde_json::to_vec(spec).context("the sensor's specification cannot be written")?;
    let role = wish.attributes.get("role_name").map_or("", String::as_str);
    let mut parts: Vec<&[u8]> = vec![
        wish.type_id.as_bytes(),
        &keys,
        bytemuck::bytes_of(&wish.pose),
        role.as_bytes(),
    ];
    if let Some((type_id, role)) = wish.parent.and_then(|it| daemon.world.type_and_role(it)) {
        parts.extend([type_id.as_bytes(), role.as_bytes()]);
    }
    let living = daemon.sensors.sensors.iter().map(|other| &other.stream);
    Ok(NoiseStream::made(&parts, wish.parent, living))
}

/// Reads the specification like a launch file's. Rate and mount are not part of it, because the
/// command has an interval and a pose of its own.
fn read_spec(
    keys: &serde_json::Map<String, serde_json::Value>,
    period_nanos: u64,
) -> anyhow::Result<SensorSpec> {
    for foreign in ["mount", "rate_hz"] {
        if keys.contains_key(foreign) {
            bail!(
                "the specification has {foreign:?}, which the command says itself (pose, interval_nanos); leave it out"
            );
        }
    }
    let tick_hz = 1e9 / period_nanos as f64;
    let mut keys = keys.clone();
    let kind = keys
        .get("kind")
        .and_then(|kind| kind.as_str())
        .unwrap_or("");
    if SensorSpec::default_of(kind).is_some_and(|spec| spec.rate_hz().is_some()) {
        keys.insert("rate_hz".into(), tick_hz.into());
    }
    let spec: SensorSpec =
        serde_json::from_value(keys.into()).context("the sensor's specification cannot be read")?;
    if let Err(errors) = spec.check(tick_hz) {
        let sentences: Vec<String> = errors.iter().map(ToString::to_string).collect();
        bail!(
            "the sensor's specification cannot be used: {}",
            sentences.join("; ")
        );
    }
    Ok(spec)
}
