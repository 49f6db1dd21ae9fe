//! From a scene to published frames: which sensors fire, loans, GPU submissions, sensors on the CPU,
//! headers, sending, and wake-ups.

mod batches;
mod cpu;
mod in_flight;
mod lens;
mod lidar;
mod rays;
mod shot;
mod views;

use std::sync::Arc;
use std::time::Duration;

use launch_cli::wrong_usage;
use schema_bus::{Bus, mono_now};
use schema_frames::{Modality, SceneFiring};
use schema_types::{ActorId, SimTime, Tick};
use sensor_camera::{CameraRenderer, View};
use sensor_core::lane_marks::PaintedLines;
use sensor_core::scene::{Scene, SceneAssets};
use sensor_core::schedule::Firing;
use sensor_gpu::Gpu;
use sensor_ray::RayScene;
use sensor_spec::SensorSpec;

use crate::batch::Batch;
use crate::carrier::Carrier;
use crate::rig::Waking;
use crate::sensor::{Maker, Model, Role, Sensor};
use crate::stages;
use crate::topic::{Audience, FrameCounts, FrameOptions, Topic};
use in_flight::InFlight;
use rays::Rays;
use shot::{Due, Shot};
pub use shot::{Stamp, TickView};
use views::{Drawing, PendingViews, Sources};

/// Says whether frames that are ready are still this process's to send.
pub type MaySend = Box<dyn FnMut() -> bool>;

/// All sensors of a process and what makes their frames.
pub struct Sensors {
    /// Dropped first, so that what the GPU works on ends before anything it may use.
    in_flight: InFlight<PendingViews>,
    /// Sensors by rising actor id.
    pub sensors: Vec<Sensor>,
    /// Cameras whose images come as one frame.
    pub batches: Vec<Batch>,
    /// `None` in a process that renders nothing.
    gpu: Option<Gpu>,
    renderer: Option<CameraRenderer>,
    options: FrameOptions,
    rays: Rays,
    /// The map's painted lines, made when a lane invasion detector first needs them.
    painted: Option<PaintedLines>,
    /// Longest tick that the topics' memory was made for.
    fitted_period_nanos: u64,
    n_lidar_turns: u64,
    /// Counts of topics that have been closed.
    closed_counts: FrameCounts,
    /// Topics of sensors that ended after the last tick, whose frames may not have been taken yet.
    parting: Vec<Topic>,
    /// Ticks from one at which cameras and lidars may fire to the next.
    fire_every: u64,
    may_send: MaySend,
    moves: Moves,
}

/// How often what makes frames was given to another process than the one before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Moves {
    /// Cameras and lidars.
    pub n_sensors: u64,
    /// Batches.
    pub n_batches: u64,
}

/// The sensors that fire in a tick.
pub struct Firings {
    /// Those whose frames this process makes.
    due: Vec<Due>,
    /// Those whose frames other processes make.
    away: Vec<SceneFiring>,
    /// Whether one of them sees what moves where it was before the tick.
    look_back: bool,
}

impl Firings {
    /// Whether a sensor that fires sees what moves where it was before the tick, so that the scene
    /// needs its past.
    pub fn look_back(&self) -> bool {
        self.look_back
    }
}

impl Sensors {
    /// Sensors that render on the GPU that is given; without one, only other processes render.
    pub fn new(
        drawing: Option<(Gpu, CameraRenderer)>,
        sensors: Vec<Sensor>,
        options: FrameOptions,
    ) -> Self {
        let max_in_flight = match options.audience {
            Audience::Hash => 1,
            Audience::Readers => u64::from(options.frames_in_flight),
        };
        let (gpu, renderer) = drawing.unzip();
        Sensors {
            sensors,
            batches: Vec::new(),
            rays: Rays::new(gpu.as_ref(), options.lidars_on),
            gpu,
            renderer,
            options,
            painted: None,
            fitted_period_nanos: 0,
            in_flight: InFlight::new(max_in_flight),
            n_lidar_turns: 0,
            closed_counts: FrameCounts::default(),
            parting: Vec::new(),
            fire_every: 1,
            may_send: Box::new(|| true),
            moves: Moves::default(),
        }
    }

    /// Asks `may_send` before frames of the GPU are sent; where it says no, they are dropped.
    pub fn send_while(&mut self, may_send: MaySend) {
        self.may_send = may_send;
    }

    /// Lets cameras and lidars fire at every n-th tick only, where they are due by their rate.
    pub fn fire_every(&mut self, n_ticks: u64) {
        self.fire_every = n_ticks.max(1);
    }

    /// Lidar turns that were cast.
    pub fn n_lidar_turns(&self) -> u64 {
        self.n_lidar_turns
    }

    /// Frames of all topics so far, those of sensors that have ended among them.
    pub fn counts(&self) -> FrameCounts {
        self.topics()
            .fold(self.closed_counts, |sum, topic| sum.with(&topic.counts))
    }

    /// All topics, those of batches last.
    pub fn topics(&self) -> impl Iterator<Item = &Topic> {
        let of_sensors = self.sensors.iter().flat_map(|sensor| &sensor.topics);
        of_sensors.chain(self.batches.iter().flat_map(|batch| &batch.topics))
    }

    fn topics_mut(&mut self) -> impl Iterator<Item = &mut Topic> {
        let of_sensors = self
            .sensors
            .iter_mut()
            .flat_map(|sensor| &mut sensor.topics);
        let batches = self.batches.iter_mut();
        of_sensors.chain(batches.flat_map(|batch| &mut batch.topics))
    }

    /// The scene as rays see it.
    pub fn rays(&mut self, scene: &Scene) -> &RayScene {
        self.rays.at(scene)
    }

    /// The oldest tick to which the next frame of a sensor looks back; `None` if none does.
    pub fn look_back_to(&self, now: SimTime) -> Option<SimTime> {
        let ticks = self.sensors.iter();
        ticks.filter_map(|sensor| sensor.looks_back_to(now)).min()
    }

    /// The GPU they render on.
    pub fn gpu(&self) -> Option<&Gpu> {
        self.gpu.as_ref()
    }

    /// Whether the GPU still answers; one that is not there never fails.
    ///
    /// # Errors
    /// [`sensor_gpu::GpuError`].
    pub fn check_gpu(&self) -> Result<(), sensor_gpu::GpuError> {
        self.gpu.as_ref().map_or(Ok(()), Gpu::check)
    }

    /// Topics whose frames are made from the last firing on, or no longer, where that matters to
    /// later frames, since the last call.
    pub fn take_audience_changes(&mut self) -> Vec<(String, bool)> {
        self.sensors
            .iter_mut()
            .flat_map(|sensor| &mut sensor.topics)
            .filter_map(|topic| topic.take_change().map(|made| (topic.name.clone(), made)))
            .collect()
    }

    /// Follows what a journal says about frames of a topic.
    pub fn tell(&mut self, topic: &str, is_made: bool) {
        let topics = self
            .sensors
            .iter_mut()
            .filter(|sensor| !sensor.is_added)
            .flat_map(|sensor| &mut sensor.topics);
        topics
            .filter(|of_sensor| of_sensor.name == topic)
            .for_each(|of_sensor| of_sensor.tell(Some(is_made)));
    }

    /// All topics follow their readers again.
    pub fn follow_readers(&mut self) {
        self.sensors
            .iter_mut()
            .flat_map(|sensor| &mut sensor.topics)
            .for_each(|topic| topic.tell(None));
    }

    /// How frames are made.
    pub fn options(&self) -> &FrameOptions {
        &self.options
    }

    /// Takes over other static scenery.
    pub fn load(&mut self, assets: &Arc<SceneAssets>) -> anyhow::Result<()> {
        self.load_for(assets, |_| true)
    }

    /// Takes over other static scenery for the sensors that `stays` names; the others are about to
    /// be removed.
    pub fn load_for(
        &mut self,
        assets: &Arc<SceneAssets>,
        stays: impl Fn(&Sensor) -> bool,
    ) -> anyhow::Result<()> {
        self.load_views(assets)?;
        let casts_rays = self
            .sensors
            .iter()
            .any(|sensor| stays(sensor) && sensor.model.casts_rays());
        self.load_rays(assets, casts_rays && !assets.streamed);
        self.painted = None;
        Ok(())
    }

    /// Takes over other static scenery for cameras.
    pub fn load_views(&mut self, assets: &Arc<SceneAssets>) -> anyhow::Result<()> {
        self.finish_all()?;
        let (Some(gpu), Some(renderer)) = (&self.gpu, &mut self.renderer) else {
            return Ok(());
        };
        let loaded = gpu.try_to("the map", || renderer.load(assets));
        loaded.inspect_err(|_| renderer.recover())?;
        Ok(())
    }

    /// Takes over other static scenery for rays; `is_needed` says whether any are cast.
    pub fn load_rays(&mut self, assets: &Arc<SceneAssets>, is_needed: bool) {
        self.rays.load(assets, is_needed);
    }

    /// Whether the scenery is there for rays.
    pub fn has_rays(&self) -> bool {
        self.rays.is_loaded()
    }

    /// A tick begins, so frames in flight become one tick late.
    pub fn start_tick(&mut self, tick: Tick) {
        self.close_parting();
        self.in_flight.start_tick(tick.0);
    }

    /// Fires the sensors that are due at a tick that has been started. When this returns, all frames
    /// but those of views have been sent; views may still be in flight. `hand_out` gets the firings
    /// of sensors whose frames other processes make, before anything is drawn here.
    pub fn fire(
        &mut self,
        tick: &TickView<'_>,
        firings: Firings,
        hand_out: impl FnOnce(Vec<SceneFiring>),
    ) -> anyhow::Result<()> {
        let Firings { due, away, .. } = firings;
        let mut waking = Waking::default();
        self.fire_motion(tick, &due, &mut waking);
        hand_out(away);
        self.fire_due(tick, &due, waking)
    }

    /// Fires what another process says is due at a tick that has been started: cameras, lidars and
    /// batches of cameras. Views may still be in flight when this returns.
    pub fn fire_given(
        &mut self,
        tick: &TickView<'_>,
        firings: &[SceneFiring],
    ) -> anyhow::Result<()> {
        let mut due = Vec::with_capacity(firings.len());
        for (sensor_idx, sensor) in self.sensors.iter_mut().enumerate() {
            let is_own = |firing: &&SceneFiring| firing.sensor_id == sensor.actor.0;
            let Some(given) = firings.iter().find(is_own) else {
                continue;
            };
            if !sensor.model.is_costly() {
                continue;
            }
            lidar::begin_turn(&mut sensor.model, given);
            for topic in &mut sensor.topics {
                topic.ask(given.outputs & SceneFiring::output(topic.modality) != 0);
            }
            let parent = ActorId(given.parent_id);
            due.push(Due {
                sensor_idx,
                firing: Firing {
                    seq: given.seq,
                    window_nanos: given.window_nanos,
                    previous: (given.previous_nanos != u64::MAX)
                        .then_some(SimTime(given.previous_nanos)),
                },
                carrier: Carrier::of_camera(parent, given.world_from_sensor, tick.scene.sim_time),
            });
        }
        batches::ask(&mut self.batches, firings);
        let fired = self.fire_due(tick, &due, Waking::default());
        self.topics_mut().for_each(Topic::ask_no_more);
        fired
    }

    fn fire_due(
        &mut self,
        tick: &TickView<'_>,
        due: &[Due],
        mut waking: Waking,
    ) -> anyhow::Result<()> {
        let mut later = Vec::new();
        while let Some((mut views, late)) = self.in_flight.pop_due() {
            // Other threads make their events while this one records the next images.
            if views.begin_events() || !later.is_empty() {
                later.push((views, late));
            } else {
                self.finish(views, late)?;
            }
        }
        let audience = self.options.audience;
        let lidars = lidar::submit(&mut self.sensors, &mut self.rays, tick, due, audience);
        let views = match (&self.gpu, &mut self.renderer) {
            (Some(gpu), Some(renderer)) => {
                let sources = Sources {
                    sensors: &mut self.sensors,
                    batches: &mut self.batches,
                };
                let drawing = Drawing { gpu, renderer };
                views::submit(sources, drawing, tick, due, audience)?
            }
            _ => None,
        };
        for (views, late) in later {
            self.finish(views, late)?;
        }
        self.fire_on_cpu(tick, due, lidars.is_some(), &mut waking)?;
        if let Some(lidars) = lidars {
            self.n_lidar_turns += lidar::finish(
                &mut self.sensors,
                self.gpu.as_ref(),
                lidars,
                &mut waking,
                audience,
            )?;
        }
        if let Some(views) = views {
            // If a rig still has images in flight, its wake-up is sent with the last of them.
            for sensor_idx in views.sensor_idxs() {
                waking.postpone(&self.sensors[sensor_idx].rig);
            }
            waking.wake();
            self.in_flight.push(views);
        } else {
            waking.wake();
        }
        if audience == Audience::Hash {
            self.finish_all()?;
        }
        Ok(())
    }

    /// Fires the spectator alone, once more in a tick that is over. Returns its firing if another
    /// process makes its image.
    pub fn fire_spectator(
        &mut self,
        tick: &TickView<'_>,
        carrier: impl Fn(ActorId) -> Option<Carrier>,
    ) -> anyhow::Result<Option<SceneFiring>> {
        let is_spectator = |sensor: &Sensor| sensor.role == Role::Spectator;
        let Some(sensor_idx) = self.sensors.iter().position(is_spectator) else {
            return Ok(None);
        };
        let sensor = &mut self.sensors[sensor_idx];
        let Some(carrier) = carrier(sensor.actor) else {
            return Ok(None);
        };
        let due = Due {
            sensor_idx,
            firing: sensor.schedule.fire_again(),
            carrier,
        };
        if let Maker::Worker(worker) = sensor.maker {
            let audience = self.options.audience;
            return Ok(Some(given_away(sensor, worker, &due, tick.scene, audience)));
        }
        let (Some(gpu), Some(renderer)) = (&self.gpu, &mut self.renderer) else {
            return Ok(None);
        };
        let (drawing, audience) = (Drawing { gpu, renderer }, self.options.audience);
        let sources = Sources {
            sensors: &mut self.sensors,
            batches: &mut self.batches,
        };
        if let Some(views) = views::submit(sources, drawing, tick, &[due], audience)? {
            self.in_flight.push(views);
        }
        self.finish_all()?;
        Ok(None)
    }

    /// Shows every model its carrier, and lists the sensors that fire in this tick, in their order.
    pub fn schedule(
        &mut self,
        scene: &Scene,
        carrier: impl Fn(ActorId) -> Option<Carrier>,
    ) -> Firings {
        let (mut due, mut away) = (Vec::with_capacity(self.sensors.len()), Vec::new());
        let mut fired_away = Vec::new();
        let is_full = scene.tick.0 % self.fire_every == 1 % self.fire_every;
        let audience = self.options.audience;
        let mut look_back = false;
        for (sensor_idx, sensor) in self.sensors.iter_mut().enumerate() {
            let Some(carrier) = carrier(sensor.actor) else {
                continue;
            };
            sensor.model.follow(&carrier);
            if !is_full && sensor.model.is_costly() {
                continue;
            }
            let Some(firing) = sensor.schedule.due(scene.sim_time) else {
                continue;
            };
            look_back |= sensor.model.looks_back();
            let fires = Due {
                sensor_idx,
                firing,
                carrier,
            };
            match sensor.maker {
                Maker::Here => due.push(fires),
                Maker::Worker(worker) => {
                    away.push(given_away(sensor, worker, &fires, scene, audience));
                    fired_away.push(sensor_idx);
                }
                Maker::Nobody => {}
            }
        }
        if !fired_away.is_empty() {
            let sensors = &mut self.sensors;
            batches::give_away(&mut self.batches, sensors, &fired_away, &mut away);
        }
        Firings {
            due,
            away,
            look_back,
        }
    }

    /// Fires the due sensors whose frames take microseconds. They wait for nothing else of the tick,
    /// not even for views of earlier ticks that the GPU still draws.
    fn fire_motion(&mut self, tick: &TickView<'_>, due: &[Due], waking: &mut Waking) {
        let _span = stages::OTHER_SENSORS.span();
        for due in due {
            let sensor = &mut self.sensors[due.sensor_idx];
            if !sensor.model.is_motion() {
                continue;
            }
            let shot = Shot::new(tick, due, sensor, self.options.audience);
            if cpu::motion(&shot, sensor) {
                waking.add(&sensor.rig);
            }
        }
    }

    /// Fires the other due sensors whose frames the CPU makes.
    fn fire_on_cpu(
        &mut self,
        tick: &TickView<'_>,
        due: &[Due],
        lidars_are_cast: bool,
        waking: &mut Waking,
    ) -> anyhow::Result<()> {
        let _span = stages::OTHER_SENSORS.span();
        let mut rays = self.rays.of_tick(tick.scene);
        for due in due {
            let sensor = &mut self.sensors[due.sensor_idx];
            let shot = Shot::new(tick, due, sensor, self.options.audience);
            let is_sent = match &sensor.model {
                Model::View(_) => continue,
                model if model.is_motion() => continue,
                model if lidars_are_cast && lidar::fits_gpu(model) => continue,
                Model::Lidar { .. } => {
                    let is_cast = lidar::cast_on_cpu(
                        &shot,
                        sensor,
                        &mut rays,
                        self.gpu.as_ref(),
                        &mut *self.may_send,
                    )?;
                    self.n_lidar_turns += u64::from(is_cast);
                    is_cast
                }
                Model::Lens(_) => lens::cast(
                    &shot,
                    sensor,
                    &mut rays,
                    self.gpu.as_ref(),
                    &mut *self.may_send,
                )?,
                _ => cpu::fire(&shot, sensor, &mut rays, &mut self.painted),
            };
            if is_sent {
                waking.add(&sensor.rig);
            }
        }
        Ok(())
    }

    /// Waits for views and sends them.
    fn finish(&mut self, views: PendingViews, ticks_in_flight: u32) -> anyhow::Result<()> {
        let sources = Sources {
            sensors: &mut self.sensors,
            batches: &mut self.batches,
        };
        views::finish(
            sources,
            self.gpu.as_ref(),
            views,
            ticks_in_flight,
            self.options.audience,
            &mut *self.may_send,
        )
    }

    /// Whether the images of one more sensor fit the GPU.
    ///
    /// # Errors
    /// A sentence that names what does not fit.
    pub fn admit(&self, spec: &SensorSpec) -> anyhow::Result<()> {
        if let Some(renderer) = &self.renderer
            && let model = Model::new(spec, 0, 0, false)
            && let Some(view) = model.view()
        {
            let modalities = spec.modalities().into_iter();
            let rendered: Vec<Modality> = modalities.filter(|it| model.renders(*it)).collect();
            renderer.admit(view, &rendered, self.image_bytes(renderer))?;
        }
        Ok(())
    }

    /// Whether the images of all sensors fit the GPU together, if that is limited.
    ///
    /// # Errors
    /// A sentence that names the first camera that does not fit; it ends a program with 2.
    pub fn check_fit(&self) -> anyhow::Result<()> {
        let Some(renderer) = &self.renderer else {
            return Ok(());
        };
        let mut used_bytes = 0;
        for (sensor, view) in self.cameras() {
            let modalities = sensor.rendered();
            renderer
                .admit(view, &modalities, used_bytes)
                .map_err(|error| wrong_usage(format!("sensor {:?}: {error}", sensor.name)))?;
            used_bytes += renderer.target_bytes(view, &modalities);
        }
        Ok(())
    }

    /// Bytes that the images of all cameras take on the GPU once they are read.
    fn image_bytes(&self, renderer: &CameraRenderer) -> u64 {
        let bytes_of =
            |(sensor, view): (&Sensor, &View)| renderer.target_bytes(view, &sensor.rendered());
        self.cameras().map(bytes_of).sum()
    }

    /// The cameras that measure and are drawn here, with their views: not the spectator, which is shown while there is
    /// room.
    fn cameras(&self) -> impl Iterator<Item = (&Sensor, &View)> {
        self.sensors
            .iter()
            .filter(|sensor| sensor.role == Role::Sensor && sensor.maker == Maker::Here)
            .filter_map(|sensor| Some((sensor, sensor.model.view()?)))
    }

    /// Adds a sensor made at run time.
    pub fn add(&mut self, sensor: Sensor, assets: &SceneAssets) {
        if sensor.model.casts_rays() && !assets.streamed {
            self.rays.require(assets);
        }
        let at = self
            .sensors
            .partition_point(|other| other.actor < sensor.actor);
        self.sensors.insert(at, sensor);
    }

    /// Ends the sensors that `is_gone` names: they fire no more, frames in flight are sent, and
    /// their memory is given back, with the next tick if `stay` says that readers are owed the
    /// frames of this one: what a publisher sent is gone with it.
    pub fn remove(&mut self, is_gone: impl Fn(&Sensor) -> bool, stay: bool) -> anyhow::Result<()> {
        if !self.sensors.iter().any(&is_gone) {
            return Ok(());
        }
        self.finish_all()?;
        let (gone, kept): (Vec<Sensor>, _) = std::mem::take(&mut self.sensors)
            .into_iter()
            .partition(is_gone);
        self.sensors = kept;
        for topic in gone.into_iter().flat_map(|sensor| sensor.topics) {
            self.closed_counts = self.closed_counts.with(&topic.counts);
            self.parting.push(topic);
        }
        if !stay {
            self.close_parting();
        }
        Ok(())
    }

    fn close_parting(&mut self) {
        for topic in self.parting.drain(..) {
            topic.close(self.gpu.as_ref());
        }
    }

    /// Gives memory to topics that found their first reader, and takes it from those that lost
    /// their last a while ago. A longer tick needs more room for what counts points per second,
    /// which is made here too.
    pub fn settle_topics(&mut self, bus: &Bus, period_nanos: u64) -> anyhow::Result<()> {
        let now_nanos = mono_now().0;
        if period_nanos > self.fitted_period_nanos {
            self.fitted_period_nanos = period_nanos;
            self.sensors
                .iter_mut()
                .for_each(|sensor| sensor.fit_topics(period_nanos));
        }
        if !self.topics_mut().any(|topic| topic.is_unsettled(now_nanos)) {
            return Ok(());
        }
        self.finish_all()?;
        let gpu = self.gpu.clone();
        for topic in self.topics_mut() {
            if topic.is_unsettled(now_nanos) {
                topic.settle(bus, gpu.as_ref());
            }
        }
        Ok(())
    }

    /// Tick of the oldest frames in flight.
    pub fn oldest_in_flight(&self) -> Option<u64> {
        self.in_flight.oldest_tick()
    }

    /// Another process makes the frames of these sensors and batches, or this one does again. All
    /// frames in flight are sent first.
    ///
    /// # Errors
    /// When frames in flight cannot be sent.
    pub fn hand_over(
        &mut self,
        bus: &Bus,
        of_sensor: impl Fn(&Sensor) -> Maker,
        of_batch: impl Fn(&Batch) -> Maker,
    ) -> anyhow::Result<()> {
        let stays = |sensor: &Sensor| of_sensor(sensor) == sensor.maker;
        let batch_stays = |batch: &Batch| of_batch(batch) == batch.maker;
        if self.sensors.iter().all(stays) && self.batches.iter().all(batch_stays) {
            return Ok(());
        }
        self.finish_all()?;
        for sensor in &mut self.sensors {
            let maker = of_sensor(sensor);
            if maker != sensor.maker {
                self.moves.n_sensors += u64::from(maker != Maker::Nobody);
                sensor.hand_over(maker, bus, self.gpu.as_ref());
            }
        }
        for batch in &mut self.batches {
            let maker = of_batch(batch);
            if maker != batch.maker {
                self.moves.n_batches += u64::from(maker != Maker::Nobody);
                batch.hand_over(maker, bus, self.gpu.as_ref());
            }
        }
        Ok(())
    }

    /// What was given to another process than the one before.
    pub fn moves(&self) -> Moves {
        self.moves
    }

    /// Whether images of a sensor are made, for its own topics or for a batch.
    pub fn is_read(&self, sensor: &Sensor) -> bool {
        let audience = self.options.audience;
        let mut topics = sensor.topics.iter();
        topics.any(|topic| topic.is_read(audience)) || self.is_read_in_batch(sensor)
    }

    fn is_read_in_batch(&self, sensor: &Sensor) -> bool {
        let mut batches = self.batches.iter();
        batches.any(|batch| batch.is_read() && batch.has_camera(sensor))
    }

    /// Ends the batches that `is_gone` names: frames in flight are sent, and their memory is given
    /// back.
    ///
    /// # Errors
    /// When frames in flight cannot be sent.
    pub fn remove_batches(&mut self, is_gone: impl Fn(&Batch) -> bool) -> anyhow::Result<()> {
        if !self.batches.iter().any(&is_gone) {
            return Ok(());
        }
        self.finish_all()?;
        let gone = self.batches.extract_if(.., |batch| is_gone(batch));
        for topic in gone.flat_map(|batch| batch.topics) {
            self.closed_counts = self.closed_counts.with(&topic.counts);
            topic.close(self.gpu.as_ref());
        }
        Ok(())
    }

    /// Whether frames are in flight.
    pub fn is_busy(&self) -> bool {
        !self.in_flight.is_empty()
    }

    /// Sends the oldest frames in flight once the GPU has drawn them; gives up after waiting for
    /// `most`, so that the world can go on meanwhile.
    pub fn finish_oldest_within(&mut self, most: Duration) -> anyhow::Result<()> {
        let oldest = self.in_flight.oldest();
        if oldest.is_some_and(|views| views.are_drawn_within(most))
            && let Some((views, late)) = self.in_flight.pop()
        {
            self.finish(views, late)?;
        }
        Ok(())
    }

    /// Waits for everything in flight and sends it.
    pub fn finish_all(&mut self) -> anyhow::Result<()> {
        while let Some((views, late)) = self.in_flight.pop() {
            self.finish(views, late)?;
        }
        Ok(())
    }

    /// Sends what is in flight and gives all memory back.
    pub fn close(mut self) -> anyhow::Result<()> {
        let finished = self.finish_all();
        while self.in_flight.pop().is_some() {}
        self.close_parting();
        drop(self.renderer);
        let of_sensors = self.sensors.into_iter().flat_map(|sensor| sensor.topics);
        let of_batches = self.batches.into_iter().flat_map(|batch| batch.topics);
        for topic in of_sensors.chain(of_batches) {
            topic.close(self.gpu.as_ref());
        }
        finished
    }
}

/// The firing of a sensor whose frames `worker` makes.
fn given_away(
    sensor: &mut Sensor,
    worker: u32,
    due: &Due,
    scene: &Scene,
    audience: Audience,
) -> SceneFiring {
    let world_from_sensor = due.carrier.world_from_sensor;
    let turned = lidar::turn_head(sensor, world_from_sensor.isometry(), scene.period_nanos);
    let audience = sensor.audience(audience);
    let mut outputs = 0;
    for topic in &mut sensor.topics {
        if topic.ask_away(audience) {
            outputs |= SceneFiring::output(topic.modality);
        }
    }
    SceneFiring {
        sensor_id: sensor.actor.0,
        worker,
        seq: due.firing.seq,
        window_nanos: due.firing.window_nanos,
        previous_nanos: due.firing.previous.map_or(u64::MAX, |time| time.0),
        outputs,
        parent_id: due.carrier.parent.0,
        world_from_sensor,
        world_from_sensor_start: turned.map_or(world_from_sensor, |(start, _)| start.into()),
        turned_nanos: turned.map_or(0, |(_, nanos)| nanos),
    }
}
