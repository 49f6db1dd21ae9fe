//! What sensors see of the world, when they fire, and which process makes their frames.

mod debug_shapes;
mod sharing;
pub mod spectator;
mod workers;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use anyhow::ensure;
use schema_bus::Bus;
use schema_frames::{CollisionEvent, DebugKind, DebugShape, RenderedRecord};
use schema_stages::Stage;
use schema_types::{ActorId, SimTime};
use sensor_core::PoseHistory;
use sensor_core::scene::{Overlay, Scene, SceneAssets};
use sensor_gpu::GpuError;
use simd_frames::frames::{Firings, Sensors, TickView};
use simd_frames::sensor::Sensor;
use simd_frames::topic::{Audience, FrameCounts};

use crate::clock::Clock;
use crate::faults::Faults;
use crate::participants::Participants;
use crate::world::LiveWorld;
use debug_shapes::{DebugShapes, Visible};
pub use sharing::Surroundings;
use spectator::Still;
pub use workers::{Parting, Workers};

/// What sensors see, made of the world.
static SCENE: Stage = Stage::new("scene");

/// Sensors, and the workers that make frames for them.
pub struct Sensing {
    sensors: Sensors,
    workers: Workers,
    shapes: DebugShapes,
    /// Where things were at earlier ticks, as far as a turning lidar looks back.
    history: PoseHistory,
    /// What the spectator's last image shows.
    still: Still,
    /// File whose appearance ends the GPU, in tests.
    lose_gpu_when: Option<PathBuf>,
}

/// What sensors see of a tick, and which of them fire in it.
pub struct DueSensors {
    scene: Scene,
    collisions: Vec<(ActorId, CollisionEvent)>,
    firings: Firings,
}

/// Frames of all processes together.
#[derive(Clone, Copy, Debug)]
pub struct AllFrames {
    /// Frames that were sent.
    pub n_sent: u64,
    /// Frames that were lost.
    pub n_dropped: u64,
}

impl Sensing {
    /// Sensors that are open, before the first tick.
    pub fn new(sensors: Sensors, workers: Workers, lose_gpu_when: Option<PathBuf>) -> Sensing {
        Sensing {
            sensors,
            workers,
            shapes: DebugShapes::default(),
            history: PoseHistory::default(),
            still: Still::default(),
            lose_gpu_when,
        }
    }

    /// The sensors.
    pub fn sensors(&self) -> &Sensors {
        &self.sensors
    }

    /// The sensors, to be changed.
    pub fn sensors_mut(&mut self) -> &mut Sensors {
        &mut self.sensors
    }

    /// Whether other processes render, so that cameras which are made now are not this process's.
    pub fn has_workers(&self) -> bool {
        self.workers.has_any()
    }

    /// Number of workers that have a share.
    pub fn n_workers(&self) -> usize {
        self.workers.n_working()
    }

    /// What all workers together have sent, lost and drawn.
    pub fn of_workers(&self) -> RenderedRecord {
        self.workers.totals()
    }

    /// Frames of this process and of all workers.
    pub fn all_frames(&self) -> AllFrames {
        let FrameCounts {
            n_sent, n_dropped, ..
        } = self.sensors.counts();
        let of_workers = self.workers.totals();
        AllFrames {
            n_sent: n_sent + of_workers.n_sent,
            n_dropped: n_dropped + of_workers.n_dropped,
        }
    }

    /// Whether hashes of all frames are printed.
    pub fn prints_hashes(&self) -> bool {
        self.sensors.options().audience == Audience::Hash
    }

    /// Ends the GPU if a test asks for it.
    pub fn lose_gpu_if_asked(&self) {
        if let Some(file) = &self.lose_gpu_when
            && let Some(gpu) = self.sensors.gpu()
            && std::fs::remove_file(file).is_ok()
        {
            gpu.lose();
        }
    }

    /// Whether the GPU still answers.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn check_gpu(&self) -> Result<(), GpuError> {
        self.sensors.check_gpu()
    }

    /// Hears the workers, and gives cameras their places.
    ///
    /// # Errors
    /// When frames cannot be sent.
    pub fn attend_workers(
        &mut self,
        around: &Surroundings<'_>,
        participants: &Participants,
        faults: &mut Faults,
    ) -> anyhow::Result<()> {
        self.workers
            .keep_whole_ticks(participants.want_whole_ticks());
        sharing::attend(&mut self.sensors, &mut self.workers, around, faults)
    }

    /// Looks after workers for which the world waits.
    pub fn look_after_workers(&mut self, clock: &Clock, participants: &Participants) {
        sharing::look_after(&self.sensors, &mut self.workers, clock, participants);
    }

    /// Whether the next tick may start as far as workers are concerned.
    pub fn let_start(&self, clock: &Clock, participants: &Participants) -> bool {
        sharing::let_go_on(&self.sensors, &self.workers, clock, participants)
    }

    /// Whether commands may be answered as far as workers are concerned.
    pub fn let_answer(&self, participants: &Participants) -> bool {
        sharing::let_answer(&self.workers, participants)
    }

    /// Whether workers have sent all frames of all ticks.
    pub fn workers_have_sent_all(&self) -> bool {
        self.workers.has_sent_all()
    }

    /// Whether workers are expected to answer soon.
    pub fn workers_are_busy(&self) -> bool {
        !self.workers.has_sent_all() || !self.workers.is_settled()
    }

    /// Whether frames are in flight.
    pub fn is_busy(&self) -> bool {
        self.sensors.is_busy()
    }

    /// Sends the oldest frames in flight if they are drawn within `most`.
    ///
    /// # Errors
    /// When they cannot be sent.
    pub fn finish_oldest_within(&mut self, most: Duration) -> anyhow::Result<()> {
        self.sensors.finish_oldest_within(most)
    }

    /// Waits for everything in flight and sends it.
    ///
    /// # Errors
    /// When it cannot be sent.
    pub fn finish_all(&mut self) -> anyhow::Result<()> {
        self.sensors.finish_all()
    }

    /// A tick begins, so frames in flight become one tick late.
    pub fn start_tick(&mut self, clock: &Clock) {
        self.sensors.start_tick(clock.tick());
    }

    /// Gives memory to topics that found their first reader, and takes it from those that lost their
    /// last.
    ///
    /// # Errors
    /// When frames in flight cannot be sent.
    pub fn settle_topics(&mut self, bus: &Bus, clock: &Clock) -> anyhow::Result<()> {
        self.sensors.settle_topics(bus, clock.period_nanos())
    }

    /// Makes the scene of the current tick, and finds the sensors that fire in it.
    ///
    /// # Errors
    /// When the scenery cannot be shown.
    pub fn schedule(&mut self, world: &mut LiveWorld, clock: &Clock) -> anyhow::Result<DueSensors> {
        let scene_span = SCENE.span();
        world.stream_scenery(&mut self.sensors, clock)?;
        let visible = self.shapes.at(clock.now());
        let mut scene = self.scene_with(visible, world, clock);
        drop(scene_span);
        self.still.note(&self.sensors, world.world(), &self.shapes);
        let firings = self
            .sensors
            .schedule(&scene, |actor| world.carrier_of(actor, clock.now()));
        self.look_back(&mut scene, &firings, world);
        Ok(DueSensors {
            scene,
            collisions: world.collisions(),
            firings,
        })
    }

    /// Gives the scene its past if a sensor that fires needs it, and remembers the scene for as long
    /// as one will.
    fn look_back(&mut self, scene: &mut Scene, firings: &Firings, world: &LiveWorld) {
        let _span = SCENE.span();
        let Some(keep_from) = self.sensors.look_back_to(scene.sim_time) else {
            self.history.clear();
            return;
        };
        let jumped = world.world().jumped();
        if firings.look_back() {
            scene.past = self.history.past_of(scene, &jumped);
        }
        self.history.push(scene, jumped, keep_from);
    }

    /// Makes the frames of sensors that are due, or has workers make them.
    ///
    /// # Errors
    /// When the GPU fails.
    pub fn fire(
        &mut self,
        due: DueSensors,
        world: &LiveWorld,
        faults: &mut Faults,
    ) -> anyhow::Result<()> {
        let tick = TickView {
            scene: &due.scene,
            stamp: world.episode().stamp(),
            collisions: &due.collisions,
            roads: world.world().roads().map(Arc::as_ref),
        };
        let workers = &mut self.workers;
        self.sensors.fire(&tick, due.firings, |away| {
            if let Err(error) = workers.send_scene(&tick, away) {
                faults.unsent("the scene for render workers", &error);
            }
        })
    }

    /// Topics whose frames are made from the last firing on, or no longer, where that matters to
    /// later frames, since the last call.
    pub fn take_audience_changes(&mut self) -> Vec<(String, bool)> {
        self.sensors.take_audience_changes()
    }

    /// Makes the spectator's image anew while the world stands still, if it is read and shows
    /// something else than its last one. No other sensor fires.
    ///
    /// # Errors
    /// When the GPU fails.
    pub fn show_again(
        &mut self,
        world: &mut LiveWorld,
        clock: &Clock,
        bus: &Bus,
        faults: &mut Faults,
    ) -> anyhow::Result<()> {
        if clock.tick().0 == 0 || clock.idle_nanos() < spectator::STILL_NANOS {
            return Ok(());
        }
        self.settle_topics(bus, clock)?;
        if !self.still.note(&self.sensors, world.world(), &self.shapes) {
            return Ok(());
        }
        world.stream_scenery(&mut self.sensors, clock)?;
        let visible = self.shapes.all();
        let scene = self.scene_with(visible, world, clock);
        let tick = TickView {
            scene: &scene,
            stamp: world.episode().stamp(),
            collisions: &[],
            roads: world.world().roads().map(Arc::as_ref),
        };
        let carrier = |actor| world.carrier_of(actor, clock.now());
        let away = self.sensors.fire_spectator(&tick, carrier)?;
        if let Err(error) = self.workers.send_scene(&tick, Vec::from_iter(away)) {
            faults.unsent("the scene for render workers", &error);
        }
        Ok(())
    }

    /// Draws debug shapes.
    ///
    /// # Errors
    /// If one of them cannot be drawn; then none is.
    pub fn draw(&mut self, shapes: &[DebugShape]) -> anyhow::Result<()> {
        self.shapes.draw(shapes)
    }

    /// Removes debug shapes of a kind.
    pub fn clear(&mut self, what: DebugKind) {
        self.shapes.clear(what);
    }

    /// Shows a vehicle's telemetry in the spectator's image, or hides it.
    ///
    /// # Errors
    /// If the actor is no vehicle.
    pub fn show_telemetry(
        &mut self,
        world: &mut LiveWorld,
        vehicle: ActorId,
        shown: bool,
    ) -> anyhow::Result<()> {
        ensure!(
            !shown || !spectator::telemetry_lines(world.world_mut(), vehicle).is_empty(),
            "actor {vehicle} is no vehicle, and only vehicles have telemetry"
        );
        self.shapes.show_telemetry(vehicle, shown);
        Ok(())
    }

    /// Ends the sensors of actors that are gone. If `is_owed`, readers are owed the frames of the
    /// current tick, and those stay until the next one.
    ///
    /// # Errors
    /// When frames in flight cannot be sent.
    pub fn remove(&mut self, gone: &[ActorId], is_owed: bool) -> anyhow::Result<()> {
        self.sensors
            .remove(|sensor| gone.contains(&sensor.actor), is_owed)
    }

    /// All sensors forget what they saw, because the world jumped to another state.
    pub fn forget(&mut self) {
        self.history.clear();
        self.sensors.sensors.iter_mut().for_each(Sensor::forget);
    }

    /// Leaves actors out of a camera's images; `false` if there is no such camera.
    pub fn hide(&mut self, camera: ActorId, actors: &[ActorId]) -> bool {
        let found = self.sensors.sensors.iter_mut();
        found
            .filter(|sensor| sensor.actor == camera)
            .filter_map(|sensor| sensor.hide(actors).then_some(()))
            .count()
            > 0
    }

    /// The sensors that outlive an episode.
    pub fn staying(&self) -> impl Iterator<Item = &Sensor> {
        self.sensors.sensors.iter().filter(|sensor| stays(sensor))
    }

    /// Takes the scenery of the next episode over for the sensors that outlive this one. If that
    /// fails, they have that of this one, `now`, again.
    ///
    /// # Errors
    /// When the scenery does not fit.
    pub fn load_next(
        &mut self,
        next: &Arc<SceneAssets>,
        now: &Arc<SceneAssets>,
    ) -> anyhow::Result<()> {
        if let Err(error) = self.sensors.load_for(next, stays) {
            self.sensors.load(now)?;
            return Err(error);
        }
        Ok(())
    }

    /// A new episode has begun: sensors that outlive theirs start over on these actors, in their
    /// order, and the others end, as in [`Sensing::remove`].
    ///
    /// # Errors
    /// When frames in flight cannot be sent.
    pub fn begin_episode(
        &mut self,
        actors: Vec<ActorId>,
        start: SimTime,
        clock: &Clock,
        is_owed: bool,
    ) -> anyhow::Result<()> {
        self.sensors.remove(|sensor| !stays(sensor), is_owed)?;
        for (sensor, actor) in self.sensors.sensors.iter_mut().zip(actors) {
            sensor.begin_episode(actor, clock.tick(), start, clock.period_nanos());
        }
        self.shapes.clear(DebugKind::All);
        self.history.clear();
        Ok(())
    }

    /// Follows what a journal says about frames of a topic.
    pub fn tell(&mut self, topic: &str, is_made: bool) {
        self.sensors.tell(topic, is_made);
    }

    /// All topics follow their readers again.
    pub fn follow_readers(&mut self) {
        self.sensors.follow_readers();
    }

    /// Lets cameras and lidars fire at every n-th tick only.
    pub fn fire_every(&mut self, n_ticks: u64) {
        self.sensors.fire_every(n_ticks);
    }

    /// Sends what is in flight and gives all memory of frames back.
    ///
    /// # Errors
    /// When something cannot be sent.
    pub fn close(self) -> anyhow::Result<()> {
        self.sensors.close()
    }

    /// The scene of the current tick with what is drawn for debugging.
    fn scene_with(&self, visible: Visible, world: &mut LiveWorld, clock: &Clock) -> Scene {
        let Visible {
            mut strokes,
            overlay,
        } = visible;
        let sensors = &self.sensors.sensors;
        strokes.extend(spectator::traces(sensors, world.world(), clock.now()));
        let panel = match self.shapes.telemetry_of() {
            Some(vehicle) => spectator::telemetry_lines(world.world_mut(), vehicle),
            None => overlay.panel,
        };
        Scene {
            debug: strokes,
            overlay: Overlay { panel, ..overlay },
            ..world.scene(clock)
        }
    }
}

/// Whether a sensor outlives its episode.
fn stays(sensor: &Sensor) -> bool {
    !sensor.is_of_episode()
}
