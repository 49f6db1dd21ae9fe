//! Watches the bus during a trial: snapshots, the truth camera, results and controls, each with the
//! time at which it was sent or seen.

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use consumer_kit::items::ResultParts;
use consumer_kit::{FollowedResult, FollowedTopic, Take};
use nalgebra::{Isometry3, Translation3, Vector3};
use schema_bus::{Bus, ControlReader, SnapshotReader, mono_now};
use schema_frames::{ActorRecord, FrameHeader, ResultType, SnapshotHeader};

use super::stage::{Claim, Obstacle, Truth, brakes, claim, is_judged, tangents};
use super::suite::{Suite, TruthCamera};
use super::visible::{Shown, shown};
use crate::capture::Clock;

/// Rest between two looks. Controls carry no time of their own, so this is how exactly a brake
/// command is timed on an idle machine.
const REST: Duration = Duration::from_micros(200);
/// Most ticks, and most results and controls of all stages, that are kept of one trial.
const MAX_TICKS: usize = 100_000;
const MAX_CLAIMS: usize = 100_000;
/// Most objects that all of them may name together, about 100 MB.
const MAX_OBJECTS: usize = 500_000;
/// How often a topic that is missing, and a description, is looked for.
const LOOK_EVERY: Duration = Duration::from_millis(100);
/// Images of each view that wait for the other view of their tick.
const MAX_IMAGES: usize = 4;
/// Name under which the benchmark itself writes controls. It sorts before letters, so that of two
/// controls for one car and tick the program's counts.
pub const OWN_WRITER: &str = "0-reaction";

/// Whom a trial is about.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cast {
    /// The ego vehicle.
    pub ego: u32,
    /// What the truth camera looks for: the obstacle, or the traffic light.
    pub subject: u32,
    /// Middle of the subject's box in its own space, metres.
    pub centre_m: [f32; 3],
}

/// A tick of a trial.
#[derive(Clone, Copy, Debug)]
pub struct Tick {
    /// Simulated time, nanoseconds.
    pub sim_nanos: u64,
    /// When its snapshot was sent, nanoseconds of the monotonic clock.
    pub mono_nanos: u64,
    /// The ego vehicle.
    pub ego: Option<ActorRecord>,
    /// The subject.
    pub subject: Option<ActorRecord>,
    /// What the truth camera shows of the subject; `None` if it sent nothing of this tick.
    pub view: Option<View>,
}

/// What the truth camera shows.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// Pixels of the subject.
    pub shown: Shown,
    /// Rectangle round the visible ones as in [`Truth::rectangle`].
    pub rectangle: Option<[f64; 4]>,
    /// Focal length, pixels.
    pub focal_px: f64,
    /// The camera.
    pub world_from_sensor: Isometry3<f64>,
}

/// What a stage published.
#[derive(Clone, Debug)]
pub struct Said {
    /// Index of the stage.
    pub stage: usize,
    /// Tick that it answers; of a control 0 if its writer does not say.
    pub tick: u64,
    /// When it was published; of a control, when it was seen. Nanoseconds of the monotonic clock.
    pub mono_nanos: u64,
    /// By how much that may be too late: a control was sent since the look before. 0 of results.
    pub within_nanos: u64,
    /// When the oldest sensor frame behind it was published; 0 without one, and of controls.
    pub origin_mono_nanos: u64,
    /// What it says.
    pub claim: Claim,
}

/// All of a trial.
#[derive(Clone, Debug, Default)]
pub struct Log {
    /// Whom it is about.
    pub cast: Cast,
    /// By tick.
    pub ticks: BTreeMap<u64, Tick>,
    /// In order of arrival.
    pub said: Vec<Said>,
    /// Simulated time over the monotonic clock.
    pub clock: Clock,
    /// Objects that these name.
    n_objects: usize,
    /// What was left out because there was too much of it.
    pub n_left_out: u64,
    /// Longest time between two looks, nanoseconds.
    pub longest_gap_nanos: u64,
    /// Whether another simulator publishes now than when the trial began.
    pub is_other_epoch: bool,
}

impl Log {
    /// What is true about a tick; `None` if its snapshot is missing.
    pub fn truth(&self, tick: u64) -> Option<Truth> {
        let tick = self.ticks.get(&tick)?;
        Some(Truth {
            obstacle: tick
                .subject
                .and_then(|it| obstacle(&it, self.cast.centre_m)),
            world_from_ego: tick.ego?.world_from_actor.isometry(),
            rectangle: tick.view.and_then(|view| view.rectangle),
        })
    }

    /// The newest tick.
    pub fn newest(&self) -> Option<(u64, &Tick)> {
        self.ticks.last_key_value().map(|(tick, at)| (*tick, at))
    }
}

fn obstacle(record: &ActorRecord, centre_m: [f32; 3]) -> Option<Obstacle> {
    let half_m = Vector3::from(record.half_box_m.map(f64::from));
    (half_m.min() > 0.0).then(|| Obstacle {
        world_from_box: record.world_from_actor.isometry()
            * Translation3::from(centre_m.map(f64::from)),
        half_m,
    })
}

/// A topic of results with the stages that watch it.
#[derive(Debug)]
struct Watched {
    results: FollowedResult,
    stages: Vec<usize>,
    kind_said: bool,
}

/// The benchmark's ports.
#[derive(Debug)]
pub struct Observer {
    snapshots: SnapshotReader,
    labels: FollowedTopic,
    colours: Option<FollowedTopic>,
    /// Colour images by tick, which wait for their labels, and labels that wait for their colours:
    /// the two views of a tick are sent one after the other.
    images: VecDeque<(u64, Vec<u8>)>,
    unlit: VecDeque<(FrameHeader, Vec<u32>)>,
    results: Vec<Watched>,
    controls: ControlReader,
    looked_nanos: u64,
    next_look: Instant,
    epoch: Option<u64>,
    /// Sentences about what cannot be judged, each once.
    pub remarks: Vec<String>,
}

impl Observer {
    /// Opens the ports; the simulator must run.
    ///
    /// # Errors
    /// If the bus refuses.
    pub fn open(bus: &Bus, suite: &Suite, camera_topic: &str) -> anyhow::Result<Observer> {
        let mut results: Vec<Watched> = Vec::new();
        for (index, stage) in suite.stage.iter().enumerate() {
            let Some(topic) = &stage.topic else { continue };
            match results.iter_mut().find(|it| it.results.topic() == topic) {
                Some(watched) => watched.stages.push(index),
                None => results.push(Watched {
                    results: FollowedResult::new(topic, Take::All),
                    stages: vec![index],
                    kind_said: false,
                }),
            }
        }
        let view =
            |modality: &str| FollowedTopic::new(format!("{camera_topic}/{modality}"), Take::All);
        Ok(Observer {
            snapshots: bus.snapshot_reader().context("cannot read snapshots")?,
            labels: view("instance"),
            colours: (suite.truth.min_luma > 0).then(|| view("rgb")),
            images: VecDeque::new(),
            unlit: VecDeque::new(),
            results,
            controls: bus.control_reader().context("cannot watch controls")?,
            looked_nanos: mono_now().0,
            next_look: Instant::now(),
            epoch: None,
            remarks: Vec::new(),
        })
    }

    /// Topics of stages that have no living writer now.
    pub fn silent(&mut self, bus: &Bus) -> anyhow::Result<Vec<String>> {
        let mut silent = Vec::new();
        for watched in &mut self.results {
            if !watched.results.look(bus)? || !watched.results.has_writer() {
                silent.push(watched.results.topic().to_owned());
            }
        }
        Ok(silent)
    }

    /// Forgets what waits from before a trial.
    ///
    /// # Errors
    /// As [`Observer::look`].
    pub fn skip(&mut self, bus: &Bus, suite: &Suite) -> anyhow::Result<()> {
        self.look(bus, suite, &mut Log::default())?;
        self.images.clear();
        self.unlit.clear();
        Ok(())
    }

    /// Rests for a moment, then takes all that has come.
    ///
    /// # Errors
    /// What waiting cannot heal: no place left for a reader, a topic of another kind.
    pub fn rest_and_look(&mut self, bus: &Bus, suite: &Suite, log: &mut Log) -> anyhow::Result<()> {
        std::thread::sleep(REST);
        self.look(bus, suite, log)
    }

    fn look(&mut self, bus: &Bus, suite: &Suite, log: &mut Log) -> anyhow::Result<()> {
        let before = self.looked_nanos;
        self.looked_nanos = mono_now().0;
        let batches = self.controls.drain()?;
        let seen = mono_now().0;
        let within_nanos = seen.saturating_sub(before);
        log.longest_gap_nanos = log.longest_gap_nanos.max(within_nanos);
        for batch in batches.iter().filter(|batch| batch.writer != OWN_WRITER) {
            for (index, stage) in suite.stage.iter().enumerate() {
                let wanted = stage
                    .control
                    .as_deref()
                    .is_some_and(|name| name == "*" || name == batch.writer);
                // The last record about the ego is the one that counts.
                let says = batch
                    .records
                    .iter()
                    .rev()
                    .find_map(|it| brakes(stage, it, log.cast.ego));
                if let Some(says) = says.filter(|_| wanted) {
                    log.keep(Said {
                        stage: index,
                        tick: batch.tick,
                        mono_nanos: seen,
                        within_nanos,
                        origin_mono_nanos: 0,
                        claim: Claim::Plain(says),
                    });
                }
            }
        }
        self.take_snapshots(log)?;
        self.take_views(&suite.truth, log)?;
        self.take_results(suite, log)?;
        if Instant::now() >= self.next_look {
            self.next_look = Instant::now() + LOOK_EVERY;
            self.labels.look(bus)?;
            if let Some(colours) = &mut self.colours {
                colours.look(bus)?;
            }
            for watched in &mut self.results {
                watched.results.look(bus)?;
            }
        }
        Ok(())
    }

    fn take_snapshots(&mut self, log: &mut Log) -> anyhow::Result<()> {
        while let Some(snapshot) = self.snapshots.next()? {
            let header: SnapshotHeader = *snapshot.header();
            if *self.epoch.get_or_insert(header.epoch) != header.epoch {
                log.is_other_epoch = true;
            }
            log.clock
                .push(header.sim_nanos, header.published_mono_nanos);
            if log.ticks.len() >= MAX_TICKS {
                log.n_left_out += 1;
                continue;
            }
            let tick = Tick {
                sim_nanos: header.sim_nanos,
                mono_nanos: header.published_mono_nanos,
                ego: snapshot.actor(log.cast.ego).copied(),
                subject: snapshot.actor(log.cast.subject).copied(),
                view: None,
            };
            log.ticks.insert(header.tick, tick);
        }
        Ok(())
    }

    fn take_views(&mut self, truth: &TruthCamera, log: &mut Log) -> anyhow::Result<()> {
        if let Some(colours) = &mut self.colours {
            while let Some(frame) = colours.take()? {
                self.images.push_back((frame.header().tick, frame.to_vec()));
                if self.images.len() > MAX_IMAGES {
                    self.images.pop_front();
                }
            }
        }
        while let Some(frame) = self.labels.take()? {
            if let Some(ids) = frame.elements::<u32>() {
                self.unlit.push_back((*frame.header(), ids.to_vec()));
            }
            if self.unlit.len() > MAX_IMAGES {
                self.unlit.pop_front();
            }
        }
        let is_lit = self.colours.is_some();
        let images = &self.images;
        self.unlit.retain(|(header, ids)| {
            let image = images.iter().find(|(tick, _)| *tick == header.tick);
            let image = image.map(|(_, image)| image.as_slice());
            if is_lit && image.is_none() {
                return true;
            }
            if let Some(tick) = log.ticks.get_mut(&header.tick) {
                tick.view = Some(view(header, ids, image, log.cast.subject, truth));
            }
            false
        });
        Ok(())
    }

    fn take_results(&mut self, suite: &Suite, log: &mut Log) -> anyhow::Result<()> {
        for watched in &mut self.results {
            while let Some(result) = watched.results.take()? {
                let header = *result.header();
                judge_type(watched, result.kind(), &mut self.remarks);
                let parts = ResultParts::of(&result, watched.results.about());
                let truth = log
                    .ticks
                    .get(&header.tick)
                    .and_then(|tick| obstacle(&tick.subject?, log.cast.centre_m));
                for index in &watched.stages {
                    log.keep(Said {
                        stage: *index,
                        tick: header.tick,
                        mono_nanos: header.published_mono_nanos,
                        within_nanos: 0,
                        origin_mono_nanos: header.origin_mono_nanos,
                        claim: claim(&suite.stage[*index], &parts, truth.as_ref()),
                    });
                }
            }
        }
        Ok(())
    }
}

/// What an image of labels and its colours show of the subject.
fn view(
    header: &FrameHeader,
    ids: &[u32],
    image: Option<&[u8]>,
    subject: u32,
    truth: &TruthCamera,
) -> View {
    let shown = shown(ids, header.width, subject, image, truth.min_luma);
    View {
        shown,
        rectangle: (shown.visible > 0)
            .then(|| tangents(shown.bounds.map(f64::from), header.intrinsics_px))
            .flatten(),
        focal_px: header.intrinsics_px[0],
        world_from_sensor: header.world_from_sensor.isometry(),
    }
}

fn judge_type(watched: &mut Watched, kind: ResultType, remarks: &mut Vec<String>) {
    if !is_judged(kind) && !std::mem::replace(&mut watched.kind_said, true) {
        remarks.push(format!(
            "{} carries {}, of which nobody can say whether they are correct; watch boxes2d, boxes3d, tracks, masks, points, scalars, text, json or control",
            watched.results.topic(),
            kind.name()
        ));
    }
}

impl Log {
    fn keep(&mut self, said: Said) {
        let n_objects = match &said.claim {
            Claim::Objects(objects) => objects.len(),
            Claim::Plain(_) => 0,
        };
        if self.said.len() < MAX_CLAIMS && self.n_objects + n_objects <= MAX_OBJECTS {
            self.n_objects += n_objects;
            self.said.push(said);
        } else {
            self.n_left_out += 1;
        }
    }
}
