//! Sensors that commands make and end while the world runs.

use std::collections::BTreeMap;

use anyhow::{Context as _, bail, ensure};
use schema_frames::{Attachment, CommandReply, MAX_HIDDEN};
use schema_types::{ActorId, Pose};
use sensor_core::schedule::Schedule;
use sensor_spec::SensorSpec;

use crate::clock::Clock;
use crate::ports::Ports;
use crate::sensing::Sensing;
use crate::world::LiveWorld;
use simd_frames::sensor::{NoiseStream, OpenContext, Role, Sensor, SensorIdentity, shared_rig};
use simd_frames::topic::MemoryLife;
use simd_world::World;

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

/// What making a sensor touches.
pub struct Context<'a> {
    pub world: &'a mut LiveWorld,
    pub sensing: &'a mut Sensing,
    pub ports: &'a Ports,
    pub clock: &'a Clock,
    /// Whether a journal that is run again tells which topics have frames.
    pub is_told: bool,
}

/// Makes the actor and its topics. The topics have no memory until somebody reads them.
pub fn spawn(context: &mut Context<'_>, wish: &SensorWish<'_>) -> anyhow::Result<CommandReply> {
    let sensors = context.sensing.sensors();
    ensure!(
        sensors.sensors.len() < MAX_SENSORS,
        "there are {MAX_SENSORS} sensors already, which is the most; destroy one first"
    );
    let spec = read_spec(wish.spec, context.clock.period_nanos())?;
    if !context.sensing.has_workers() {
        sensors.admit(&spec)?;
    }
    let world = context.world.world_mut();
    let actor = world.spawn(wish.type_id, wish.pose, wish.parent, "", wish.attributes)?;
    let made = world
        .set_attachment(actor, wish.attachment)
        .map_err(anyhow::Error::from);
    match made.and_then(|()| open(context, wish, spec, actor)) {
        Ok(topics) => Ok(CommandReply::Spawned {
            actor_id: actor.0,
            topics,
        }),
        Err(error) => {
            let world = context.world.world_mut();
            world
                .destroy(actor)
                .context("the sensor's actor could not be taken back")?;
            Err(error)
        }
    }
}

/// Removes an actor and everything attached to it. Sensors among these end; those in lockstep are
/// owed their last frames if `is_owed`.
pub fn destroy(
    world: &mut LiveWorld,
    sensing: &mut Sensing,
    ports: &mut Ports,
    actor: ActorId,
    is_owed: bool,
) -> anyhow::Result<CommandReply> {
    let gone = world.world_mut().destroy(actor)?;
    sensing.remove(&gone, is_owed)?;
    // It says whose images batches have.
    ports.touch_info();
    Ok(CommandReply::Done)
}

/// Leaves actors out of a camera's images.
pub fn hide(
    sensing: &mut Sensing,
    camera: ActorId,
    actors: &[u32],
) -> anyhow::Result<CommandReply> {
    ensure!(
        actors.len() <= MAX_HIDDEN,
        "{} actors are to be left out, at most {MAX_HIDDEN} can be",
        actors.len()
    );
    let actors: Vec<ActorId> = actors.iter().map(|id| ActorId(*id)).collect();
    ensure!(
        sensing.hide(camera, &actors),
        "actor {camera} is no camera; only cameras leave actors out"
    );
    Ok(CommandReply::Done)
}

fn open(
    context: &mut Context<'_>,
    wish: &SensorWish<'_>,
    spec: SensorSpec,
    actor: ActorId,
) -> anyhow::Result<Vec<String>> {
    let Context {
        world,
        sensing,
        ports,
        clock,
        is_told,
    } = context;
    let name = wish
        .parent
        .map_or("free".to_owned(), |parent| format!("actor_{parent}"));
    let sensors = sensing.sensors();
    let rig = shared_rig(&sensors.sensors, ports.bus(), &name)?;
    let stream = stream_of(world.world(), &sensors.sensors, wish, &spec)?;
    let identity = SensorIdentity {
        rig,
        launch_rig: None,
        name: format!("s{actor}"),
        actor,
        stream,
        is_added: false,
        role: Role::Sensor,
    };
    let opening = OpenContext {
        bus: ports.bus(),
        gpu: sensors.gpu(),
        server: ports.gpu_server(),
        frames: sensors.options(),
        memory: MemoryLife::OnDemand,
        limits: &|topic| world.launch().limits_of(topic),
        seed: world.episode().stamp().seed,
        tick: clock.tick(),
        period_nanos: clock.period_nanos(),
        is_told: *is_told,
        cameras_are_away: sensing.has_workers(),
    };
    let schedule = Schedule::new(clock.now(), wish.interval_nanos);
    let sensor = Sensor::open(&opening, identity, spec, schedule)?;
    world.world_mut().set_topics(actor, sensor.topic_infos())?;
    let topics = sensor
        .topics
        .iter()
        .map(|topic| topic.name.clone())
        .collect();
    sensing.sensors_mut().add(sensor, world.episode().assets());
    Ok(topics)
}

/// The stream of noise of a sensor: from its specification, its mount, its role and its carrier's
/// type and role.
fn stream_of(
    world: &World,
    living: &[Sensor],
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
    if let Some((type_id, role)) = wish.parent.and_then(|it| world.type_and_role(it)) {
        parts.extend([type_id.as_bytes(), role.as_bytes()]);
    }
    let living = living.iter().map(|other| &other.stream);
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
