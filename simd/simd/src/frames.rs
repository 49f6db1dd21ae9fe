//! From a scene to published frames: what fires, loan, GPU submission, CPU sensors, headers, send,
//! wake-ups.

use std::rc::Rc;
use std::sync::Arc;

use nalgebra::Vector3;
use schema_bus::{Bus, FrameLoan, mono_now};
use schema_frames::{FrameHeader, Modality};
use schema_types::{ActorId, Pose, Tick};
use sensor_camera::CameraRenderer;
use sensor_core::gnss::GeoReference;
use sensor_core::imu::BodyState;
use sensor_core::lane_marks::{Corners, PaintedLines};
use sensor_core::scene::{Scene, SceneAssets};
use sensor_core::schedule::Firing;
use sensor_gpu::Gpu;
use sensor_ray::{GpuRayOptions, GpuRays, RayScene};

use crate::hash::BytesHash;
use crate::rig::{Rig, Sensor, Topic};
pub use cpu::TickEvents;
use in_flight::InFlight;
use views::PendingViews;

mod cpu;
mod in_flight;
mod lidar;
mod views;

/// State of an actor that sensors need: its own and that of the body that carries it.
#[derive(Clone, Copy, Debug)]
pub struct Carrier {
    /// Body the sensor sits on; 0 if free.
    pub parent: ActorId,
    /// Pose of the sensor in the world, the very value of the snapshot.
    pub world_from_sensor: Pose,
    /// Velocity of the sensor's own point, m/s.
    pub velocity_in_world_mps: Vector3<f64>,
    /// State of the body.
    pub body: BodyState,
    /// Lower corners of the body's box, world.
    pub lower_corners: Corners,
}

/// What is the same in every header of one tick.
#[derive(Clone, Copy, Debug)]
pub struct Stamp {
    /// Random number of the daemon's start.
    pub epoch: u64,
    /// Count of map loads.
    pub episode: u32,
    /// Seed of the run.
    pub seed: u64,
    /// Geographic place of the map's origin.
    pub geo_reference: GeoReference,
}

/// All sensors of the daemon and what makes their frames.
pub struct Sensors {
    /// Sensors by rising actor id.
    pub sensors: Vec<Sensor>,
    gpu: Gpu,
    renderer: CameraRenderer,
    rays: Option<RayScene>,
    /// Casts lidars; `None` leaves that to the CPU.
    lidar_gpu: Option<GpuRays>,
    /// The GPU had to leave them to the CPU once.
    lidars_were_refused: bool,
    /// Made when a lane invasion detector first asks.
    painted: Option<PaintedLines>,
    /// Length of the tick that the topics' memory was made for.
    fitted_period_nanos: u64,
    in_flight: InFlight<PendingViews>,
    read_everything: bool,
    n_lidar_turns: u64,
}

impl Sensors {
    /// Sensors that render, and cast lidars if `lidars_on_gpu`, on `gpu` with at most
    /// `max_in_flight` ticks on their way; `read_everything` treats every topic as read (`--hash`).
    pub fn new(
        gpu: Gpu,
        renderer: CameraRenderer,
        sensors: Vec<Sensor>,
        max_in_flight: u32,
        read_everything: bool,
        lidars_on_gpu: bool,
    ) -> Self {
        let lidar_gpu = lidars_on_gpu.then(|| GpuRays::new(&gpu, GpuRayOptions::default()));
        let max_in_flight = if read_everything {
            1
        } else {
            u64::from(max_in_flight)
        };
        Sensors {
            sensors,
            gpu,
            renderer,
            rays: None,
            lidar_gpu,
            lidars_were_refused: false,
            painted: None,
            fitted_period_nanos: 0,
            in_flight: InFlight::new(max_in_flight),
            read_everything,
            n_lidar_turns: 0,
        }
    }

    /// Turns that were cast.
    pub fn n_lidar_turns(&self) -> u64 {
        self.n_lidar_turns
    }

    /// The world that rays see, as in `scene`.
    pub fn rays(&mut self, scene: &Scene) -> &RayScene {
        let for_gpu = self.lidar_gpu.is_some();
        let rays = self
            .rays
            .get_or_insert_with(|| load_rays(&scene.assets, for_gpu));
        rays.update(&scene.dynamics);
        rays
    }

    /// The GPU they render on.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Takes over a new episode's static world.
    pub fn load(&mut self, assets: &Arc<SceneAssets>) -> anyhow::Result<()> {
        self.finish_all()?;
        self.renderer.load(assets);
        // Building takes the better part of a second: now, and not in the tick in which the first
        // reader comes. Hiding something takes less.
        if !self.rays.as_mut().is_some_and(|rays| rays.hide(assets)) {
            let casts_rays = self.sensors.iter().any(|sensor| sensor.model.casts_rays());
            self.rays = casts_rays.then(|| load_rays(assets, self.lidar_gpu.is_some()));
        }
        self.painted = None;
        Ok(())
    }

    /// A tick begins: frames that are on their way are one tick later.
    pub fn start_tick(&mut self, tick: Tick) {
        self.in_flight.start_tick(tick.0);
    }

    /// Fires what is due at the scene's tick, which was started. Frames of the GPU may still be on
    /// their way when this returns, CPU-made ones are sent.
    pub fn fire(
        &mut self,
        scene: &Scene,
        stamp: &Stamp,
        events: &TickEvents<'_>,
        carrier: impl Fn(ActorId) -> Option<Carrier>,
    ) -> anyhow::Result<()> {
        while let Some((views, late)) = self.in_flight.pop_due() {
            self.finish_views(views, late)?;
        }
        let mut due = Vec::with_capacity(self.sensors.len());
        for (idx, sensor) in self.sensors.iter_mut().enumerate() {
            let Some(carrier) = carrier(sensor.actor) else {
                continue;
            };
            sensor.model.follow(&carrier);
            if let Some(firing) = sensor.schedule.due(scene.sim_time) {
                due.push((idx, firing, carrier));
            }
        }
        let lidars = self.submit_lidars(scene, stamp, &due);
        let pending = self.submit_views(scene, stamp, &due)?;
        let mut waking = self.fire_on_cpu(scene, stamp, events, &due, lidars.is_some())?;
        if let Some(lidars) = lidars {
            self.finish_lidars(lidars, &mut waking)?;
        }
        match pending {
            Some(pending) => {
                // Rigs with pictures on their way are woken when those are sent.
                waking.retain(|rig| {
                    !pending
                        .frames
                        .iter()
                        .any(|frame| Rc::ptr_eq(&self.sensors[frame.sensor_idx].rig, rig))
                });
                wake(&waking);
                self.in_flight.push(pending);
            }
            None => wake(&waking),
        }
        if self.read_everything {
            self.finish_all()?;
        }
        Ok(())
    }

    /// Takes in a sensor made at run time; its actor id is the highest.
    pub fn add(&mut self, sensor: Sensor, assets: &Arc<SceneAssets>) {
        if sensor.model.casts_rays() && self.rays.is_none() {
            self.rays = Some(load_rays(assets, self.lidar_gpu.is_some()));
        }
        self.sensors.push(sensor);
    }

    /// Ends sensors whose actors are gone: no more firing, wait for what is on its way, then give
    /// their memory back.
    pub fn remove(&mut self, is_gone: impl Fn(&Sensor) -> bool) -> anyhow::Result<()> {
        if !self.sensors.iter().any(&is_gone) {
            return Ok(());
        }
        self.finish_all()?;
        let (gone, kept) = std::mem::take(&mut self.sensors)
            .into_iter()
            .partition(is_gone);
        self.sensors = kept;
        let gone: Vec<Sensor> = gone;
        for topic in gone.into_iter().flat_map(|sensor| sensor.topics) {
            topic.close(&self.gpu);
        }
        Ok(())
    }

    /// Gives memory to topics that found their first reader, and takes it from those that lost
    /// their last a while ago.
    ///
    /// A longer tick needs more room for what counts points per second; it comes here too.
    pub fn settle_topics(
        &mut self,
        bus: &Bus,
        staged: bool,
        period_nanos: u64,
    ) -> anyhow::Result<()> {
        let now_nanos = mono_now().0;
        if period_nanos > self.fitted_period_nanos {
            self.fitted_period_nanos = period_nanos;
            self.sensors
                .iter_mut()
                .for_each(|sensor| sensor.fit_topics(period_nanos));
        }
        let unsettled = |topic: &mut Topic| topic.is_unsettled(now_nanos);
        if !self
            .sensors
            .iter_mut()
            .flat_map(|sensor| &mut sensor.topics)
            .any(unsettled)
        {
            return Ok(());
        }
        self.finish_all()?;
        for topic in self
            .sensors
            .iter_mut()
            .flat_map(|sensor| &mut sensor.topics)
        {
            if topic.is_unsettled(now_nanos)
                && let Err(error) = topic.settle(bus, &self.gpu, staged)
            {
                tracing::warn!(
                    topic = topic.name,
                    error = format!("{error:#}"),
                    "a topic did not get the memory that it needs"
                );
            }
        }
        Ok(())
    }

    /// Whether frames are on their way.
    pub fn is_busy(&self) -> bool {
        !self.in_flight.is_empty()
    }

    /// Waits for everything on its way and sends it.
    pub fn finish_all(&mut self) -> anyhow::Result<()> {
        while let Some((views, late)) = self.in_flight.pop() {
            self.finish_views(views, late)?;
        }
        Ok(())
    }

    /// Finishes what is on its way and gives all memory back.
    pub fn close(mut self) -> anyhow::Result<()> {
        let finished = self.finish_all();
        while self.in_flight.pop().is_some() {}
        drop(self.renderer);
        for topic in self.sensors.into_iter().flat_map(|sensor| sensor.topics) {
            topic.close(&self.gpu);
        }
        finished
    }
}

/// The world as rays see it.
fn load_rays(assets: &SceneAssets, for_gpu: bool) -> RayScene {
    if for_gpu {
        RayScene::load_for_gpu(assets)
    } else {
        RayScene::load(assets)
    }
}

/// Notes a rig whose readers are to be woken, once.
fn remember(waking: &mut Vec<Rc<Rig>>, rig: &Rc<Rig>) {
    if !waking.iter().any(|known| Rc::ptr_eq(known, rig)) {
        waking.push(rig.clone());
    }
}

fn wake(rigs: &[Rc<Rig>]) {
    for rig in rigs {
        rig.wake.notify();
    }
}

impl Topic {
    /// A slot if somebody reads and one is free. No slot: the frame is dropped and counted, and its
    /// `seq` is spent.
    fn loan_if_read(&mut self, read_everything: bool) -> Option<FrameLoan> {
        if !read_everything && self.n_readers() == 0 {
            return None;
        }
        match self.loan() {
            Ok(loan) => Some(loan),
            Err(error) => {
                if self.n_dropped == 0 {
                    tracing::warn!(topic = self.name, %error, "frame dropped; further drops are only counted");
                }
                self.n_dropped += 1;
                None
            }
        }
    }

    fn send(&mut self, mut loan: FrameLoan, header: FrameHeader, print_hash: bool) {
        *loan.header_mut() = header;
        if print_hash {
            let payload = &loan.payload_mut()[..header.payload_bytes as usize];
            let hash = BytesHash::new()
                .chunk(header.hashed_bytes())
                .chunk(payload)
                .finish();
            println!("{} {} {hash:016x}", header.tick, self.name);
        }
        match loan.send() {
            Ok(_) => {
                self.n_sent += 1;
                if self.wake.n_listeners() > 0 {
                    self.wake.notify();
                }
            }
            Err(error) => {
                tracing::warn!(topic = self.name, %error, "frame could not be sent");
                self.n_dropped += 1;
            }
        }
    }
}

fn base_header(
    modality: Modality,
    scene: &Scene,
    stamp: &Stamp,
    actor: ActorId,
    firing: &Firing,
    carrier: &Carrier,
) -> FrameHeader {
    FrameHeader {
        sensor_id: actor.0,
        tick: scene.tick.0,
        sim_nanos: scene.sim_time.0,
        seq: firing.seq,
        episode: stamp.episode,
        window_nanos: firing.window_nanos,
        world_from_sensor: carrier.world_from_sensor,
        parent_id: carrier.parent.0,
        epoch: stamp.epoch,
        ..FrameHeader::new(modality)
    }
}
