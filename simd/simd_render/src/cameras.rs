//! The cameras and batches of this worker, as the simulator lists them.

use std::sync::Arc;

use schema_bus::{Bus, GpuServer};
use schema_frames::document::BATCH_RIG;
use schema_types::{ActorId, SimTime, Tick};
use sensor_gpu::Gpu;
use simd_frames::batch::{Batch, BatchPlan};
use simd_frames::frames::Sensors;
use simd_frames::rig::Rig;
use simd_frames::sensor::{
    NoiseStream, OpenContext, Role, Sensor, SensorIdentity, schedule_of, shared_rig,
};
use simd_frames::share::{Camera, CameraList, SceneryCopy};
use simd_frames::topic::MemoryLife;

/// What opening cameras needs besides them.
pub struct Surroundings<'a> {
    pub bus: &'a Bus,
    pub gpu: &'a Gpu,
    pub server: Option<&'a Arc<GpuServer>>,
    pub scenery: &'a SceneryCopy,
    pub seed: u64,
    pub period_nanos: u64,
}

impl Surroundings<'_> {
    /// What opens topics of this worker, which have memory while they are read, and no limits but
    /// those that they are opened with.
    fn context<'a>(&'a self, sensors: &'a Sensors) -> OpenContext<'a> {
        OpenContext {
            bus: self.bus,
            gpu: Some(self.gpu),
            server: self.server,
            frames: sensors.options(),
            memory: MemoryLife::OnDemand,
            limits: &|_| Default::default(),
            seed: self.seed,
            tick: Tick(0),
            period_nanos: self.period_nanos,
            is_told: false,
            cameras_are_away: false,
        }
    }
}

/// Takes a list over: closes what is not on it, before anything is opened.
///
/// # Errors
/// When frames in flight cannot be sent.
pub fn take_over(
    sensors: &mut Sensors,
    list: &CameraList,
    around: &Surroundings<'_>,
) -> anyhow::Result<()> {
    sensors.finish_all()?;
    let entry_of = |sensor: &Sensor| {
        let is_it = |camera: &&Camera| {
            (&camera.rig, &camera.name, &camera.spec)
                == (&sensor.rig.name, &sensor.name, &sensor.spec)
        };
        list.cameras.iter().find(is_it)
    };
    sensors.remove(|sensor| entry_of(sensor).is_none(), false)?;
    sensors.remove_batches(|batch| !list.batches.contains(&batch.plan))?;
    for sensor in &mut sensors.sensors {
        let Some(camera) = entry_of(sensor) else {
            continue;
        };
        (sensor.actor, sensor.made_at) = (camera.actor, camera.made_at);
        if sensor.n_beginnings != camera.n_beginnings {
            sensor.forget();
            sensor.n_beginnings = camera.n_beginnings;
        }
        hide(sensor, camera);
    }
    sensors.sensors.sort_by_key(|sensor| sensor.actor);
    for camera in &list.cameras {
        if sensors
            .sensors
            .iter()
            .any(|sensor| sensor.actor == camera.actor)
        {
            continue;
        }
        // One that finds no room now asks again while somebody reads.
        let opened = open(sensors, camera, camera.life, around).or_else(|error| {
            tracing::warn!(
                rig = camera.rig,
                camera = camera.name,
                error = format!("{error:#}"),
                "a camera did not get its memory; asking again while somebody reads it"
            );
            open(sensors, camera, MemoryLife::WhileRoom, around)
        });
        match opened {
            Ok(sensor) => sensors.add(sensor, around.scenery.assets()),
            Err(error) => tracing::warn!(
                rig = camera.rig,
                camera = camera.name,
                error = format!("{error:#}"),
                "a camera cannot be opened and has no frames"
            ),
        }
    }
    for plan in &list.batches {
        if sensors.batches.iter().any(|batch| batch.plan == *plan) {
            continue;
        }
        match open_batch(sensors, plan, around) {
            Ok(batch) => sensors.batches.push(batch),
            Err(error) => tracing::warn!(
                batch = plan.name,
                error = format!("{error:#}"),
                "a batch cannot be opened and has no frames"
            ),
        }
    }
    Ok(())
}

fn open_batch(
    sensors: &Sensors,
    plan: &BatchPlan,
    around: &Surroundings<'_>,
) -> anyhow::Result<Batch> {
    let rig = match sensors.batches.first() {
        Some(batch) => batch.rig.clone(),
        None => Rig::open(around.bus, BATCH_RIG)?,
    };
    Batch::open(&around.context(sensors), &rig, plan.clone())
}

fn open(
    sensors: &Sensors,
    camera: &Camera,
    memory: MemoryLife,
    around: &Surroundings<'_>,
) -> anyhow::Result<Sensor> {
    let modalities = camera.spec.modalities();
    let limits_of = |topic: &str| {
        let last = topic.rsplit('/').next();
        let idx = modalities.iter().position(|it| Some(it.name()) == last);
        idx.and_then(|idx| camera.limits.get(idx).copied())
            .unwrap_or_default()
    };
    let identity = SensorIdentity {
        rig: shared_rig(&sensors.sensors, around.bus, &camera.rig)?,
        launch_rig: None,
        name: camera.name.clone(),
        actor: camera.actor,
        stream: NoiseStream::of_number(camera.stream),
        is_added: false,
        role: camera.role,
    };
    let context = OpenContext {
        server: around.server.filter(|_| camera.role == Role::Sensor),
        memory,
        tick: camera.made_at,
        limits: &limits_of,
        ..around.context(sensors)
    };
    // The simulator says when it fires.
    let schedule = schedule_of(&camera.spec, SimTime(0), around.period_nanos);
    let mut sensor = Sensor::open(&context, identity, camera.spec.clone(), schedule)?;
    sensor.n_beginnings = camera.n_beginnings;
    hide(&mut sensor, camera);
    Ok(sensor)
}

fn hide(sensor: &mut Sensor, camera: &Camera) {
    let hidden: Vec<ActorId> = camera.hidden.iter().map(|id| ActorId(*id)).collect();
    if sensor.hidden != hidden {
        sensor.hide(&hidden);
    }
}
