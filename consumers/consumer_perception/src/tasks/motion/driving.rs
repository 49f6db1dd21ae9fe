//! Driving in closed loop: the route, collisions, comfort and time to collision of the run itself.
//!
//! The truth is the recording of that very run, because every drive is another one. Progress is what
//! the vehicle covers along the direction of the nearest lane for cars; what of it was beside that
//! lane was off the road. A red light is run if the vehicle leaves a red light's stop box
//! forwards, faster than [`CREEP_MPS`].

use std::collections::{BTreeMap, HashSet};
use std::sync::Arc;

use anyhow::Context as _;
use consumer_metrics::driving::{Body, Collector, CollisionWith, Drive, Infraction, Settings};
use consumer_truth::recording::{TickReader, scenario, scenario_name};
use consumer_truth::ticks::{TickSet, World};
use nalgebra::Vector3;
use schema_frames::{ActorRecord, CollisionEvent, LightState, Modality};
use schema_recording::read::RecordingFile;
use schema_roads::RoadMap;

use crate::capture::Capture;
use crate::evidence::moment::Moment;
use crate::evidence::queries::Answers;
use crate::picture::Picture;
use crate::report::TaskScore;
use crate::tasks::{AnyTask, Context, Scored, Spec};

/// Slower than this nobody runs a red light, m/s.
pub const CREEP_MPS: f64 = 0.5;

/// Others farther away play no part, metres.
const REACH_M: f64 = 100.0;

/// Others higher or lower than this are on another road, metres.
const LEVEL_M: f64 = 4.0;

/// Ticks without a push after which the next one is a new collision, seconds.
const APART_SECS: f64 = 1.0;

/// The task.
pub struct Driving {
    spec: Spec,
    all: Collector,
    now: Collector,
    answers: Answers,
}

impl Driving {
    /// For a task.
    pub fn new(spec: &Spec) -> Driving {
        let settings = Settings {
            ttc_limit_secs: 1.5,
            smooth_secs: 1.5,
        };
        Driving {
            spec: spec.clone(),
            all: Collector::new(settings),
            now: Collector::new(settings),
            answers: Answers::default(),
        }
    }

    fn score(&self, of: &Collector) -> TaskScore {
        let scores = of.scores();
        TaskScore {
            task: self.spec.name.clone(),
            topic: self.spec.topic.clone(),
            headline: "driving_score".into(),
            higher_is_better: true,
            streaming: scores.named(),
            n_scored: scores.n_drives,
            ..TaskScore::default()
        }
    }
}

/// An actor as seen from above.
fn body_of(world: &World, record: &ActorRecord) -> Body {
    let info = world.actors.by_id.get(&record.id);
    let centre = info.map_or([0.0; 3], |info| info.body_box.centre_m);
    let pose = record.world_from_actor.isometry();
    let at = pose * nalgebra::Point3::from(centre.map(f64::from));
    let [vx, vy, _] = record.velocity_in_world_mps;
    Body {
        centre_m: [at.x, at.y],
        heading_rad: pose.rotation.euler_angles().2,
        velocity_mps: [vx, vy],
        half_m: [record.half_box_m[0], record.half_box_m[1]].map(f64::from),
    }
}

/// What is known from one tick to the next.
struct Follow<'a> {
    drive: Drive,
    map: Option<&'a RoadMap>,
    before: Option<Vector3<f64>>,
    light: Option<(u32, bool)>,
    /// When each thing was touched last, simulated nanoseconds.
    touched: BTreeMap<u32, u64>,
    completed_m: f64,
}

impl Follow<'_> {
    fn tick(&mut self, set: &TickSet, ego_id: u32) {
        let Some(world) = set.world.as_deref() else {
            return;
        };
        let Some(ego) = world.record(ego_id) else {
            return;
        };
        let own = body_of(world, ego);
        let height = ego.world_from_actor.translation_m[2];
        let others = world.records.iter().filter(|other| {
            let kind = other.kind().map(|kind| kind as u16);
            let [x, y, z] = other.world_from_actor.translation_m;
            matches!(kind, Some(1 | 2))
                && other.id != ego_id
                && (x - own.centre_m[0]).hypot(y - own.centre_m[1]) < REACH_M
                && (z - height).abs() < LEVEL_M
        });
        let others: Vec<Body> = others.map(|other| body_of(world, other)).collect();
        let [_, _, yaw_rate] = ego.angular_velocity_in_world_radps;
        self.drive.add(&own, yaw_rate, &others);
        self.progress(ego);
        self.red_light(ego);
        for frame in &set.frames {
            if frame.modality == Modality::Collision && frame.header.parent_id == ego_id {
                self.collisions(world, set.sim_nanos, &frame.elements::<CollisionEvent>());
            }
        }
    }

    fn progress(&mut self, ego: &ActorRecord) {
        let at = Vector3::from(ego.world_from_actor.translation_m);
        let Some(before) = self.before.replace(at) else {
            return;
        };
        let step = at - before;
        // A jump is no way: the vehicle was put there.
        if step.norm() > 20.0 {
            return;
        }
        let Some(map) = self.map else {
            self.completed_m += step.norm();
            self.drive.complete(self.completed_m);
            return;
        };
        let place = map.nearest(at.into(), |lane| lane.kind.is_drivable());
        let Some((pose, place)) = place.and_then(|place| Some((map.pose(place)?, place))) else {
            return;
        };
        let along = (pose.rotation * Vector3::x()).dot(&step);
        let on_lane = place.offset_m.abs() <= map.width_m(place) / 2.0;
        self.completed_m += along.max(0.0);
        self.drive.complete(self.completed_m);
        if !on_lane {
            self.drive.off_road(along.max(0.0));
        }
    }

    fn red_light(&mut self, ego: &ActorRecord) {
        let Some(part) = ego.vehicle() else { return };
        let is_red = LightState::from_code(part.light_state) == LightState::Red;
        let now = (part.light_actor_id != 0).then_some((part.light_actor_id, is_red));
        if let Some((light, true)) = self.light
            && now.is_none_or(|(other, _)| other != light)
        {
            let pose = ego.world_from_actor.isometry();
            let ahead = pose.rotation * Vector3::x();
            let speed = ahead.dot(&Vector3::from(ego.velocity_in_world_mps));
            if speed > CREEP_MPS {
                self.drive.infringe(Infraction::RedLight);
            }
        }
        self.light = now;
    }

    fn collisions(&mut self, world: &World, at_nanos: u64, events: &[CollisionEvent]) {
        for event in events {
            let last = self.touched.insert(event.other_id, at_nanos);
            let apart =
                last.is_none_or(|last| (at_nanos.saturating_sub(last)) as f64 / 1e9 > APART_SECS);
            if !apart {
                continue;
            }
            let kind = world.record(event.other_id).map(|record| record.kind);
            let with = match kind {
                Some(1) => CollisionWith::Vehicle,
                Some(2) => CollisionWith::Walker,
                _ => CollisionWith::Static,
            };
            let impulse = Vector3::from(event.impulse_in_world_ns).norm();
            self.drive.collide(with, impulse);
        }
    }
}

impl AnyTask for Driving {
    fn begin(&mut self, _: &Context<'_>, answers: Answers, _: u64) -> anyhow::Result<()> {
        self.answers = answers;
        Ok(())
    }

    fn tick(&mut self, _: &Moment<'_>, _: &Capture, _: bool) {}

    fn end(&mut self, capture: &Capture) -> anyhow::Result<Scored> {
        let mut scored = Scored::default();
        let settings = Settings {
            ttc_limit_secs: 1.5,
            smooth_secs: 1.5,
        };
        self.now = Collector::new(settings);
        if let Some(path) = &capture.drive_recording {
            let drive = drive(path, self.spec.options.route_m)
                .with_context(|| format!("cannot score the drive in {}", path.display()))?;
            self.now.add(&drive);
        } else {
            scored.first_fault = Some("the drive was not recorded, so it has no score".into());
        }
        self.all.merge(&self.now);
        scored.score = self.score(&self.now);
        Ok(scored)
    }

    fn total(&self) -> TaskScore {
        self.score(&self.all)
    }

    fn answers(&self) -> &Answers {
        &self.answers
    }

    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn draw(
        &mut self,
        _: &mut Picture,
        _: &mut Picture,
        _: &Moment<'_>,
        _: &Capture,
        _: Option<usize>,
    ) {
    }

    fn coco(&mut self) -> Option<crate::evidence::coco_keep::Kept> {
        None
    }
}

/// The actor that the simulator calls the ego vehicle; 0 without one.
fn hero(world: &World) -> u32 {
    let mut actors = world.actors.by_id.values();
    actors
        .find(|actor| actor.role == "ego_vehicle")
        .map_or(0, |actor| actor.id)
}

/// The drive in a recording.
fn drive(path: &std::path::Path, route_m: f64) -> anyhow::Result<Drive> {
    let file = RecordingFile::open(path)?;
    let about = scenario(&file, &scenario_name(path), 0, "", None)?;
    let map = about.opendrive.as_deref().map(RoadMap::parse).transpose()?;
    let topics: HashSet<Arc<str>> = about
        .with(Modality::Collision)
        .filter_map(|sensor| sensor.topic(Modality::Collision))
        .map(|topic| topic.name.clone())
        .collect();
    let interval = about.info.period_nanos as f64 / 1e9;
    let mut follow = Follow {
        drive: Drive::new(interval, route_m),
        map: map.as_ref(),
        before: None,
        light: None,
        touched: BTreeMap::new(),
        completed_m: 0.0,
    };
    let mut ticks = TickReader::new(&file, (0, u64::MAX), &topics)?;
    let mut ego_id = about.carrier_id;
    while let Some(set) = ticks.next_tick()? {
        if ego_id == 0 {
            ego_id = set.world.as_deref().map_or(0, hero);
        }
        follow.tick(&set, ego_id);
    }
    Ok(follow.drive)
}
