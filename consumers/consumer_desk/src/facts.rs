//! What is known of the world, as pages read it.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use consumer_kit::{FollowedDocument, Follower, WorldAt};
use parking_lot::Mutex;
use schema_bus::names;
use schema_frames::document::SpawnPoints;
use schema_frames::{ActorInfo, ActorKind, ActorList, Catalogue, LightState, StepMode, WorldInfo};
use schema_roads::RoadMap;
use serde_json::{Value, json};

/// How often the world is looked at while somebody asks.
const TURN: Duration = Duration::from_millis(100);
/// How long a page may be silent until the world is looked at no longer.
const SILENCE: Duration = Duration::from_secs(5);
/// Distance of the points of a lane's edge on the plan, metres.
const PLAN_STEP_M: f64 = 6.0;
/// Over how long the speed of time is measured.
const SPEED_WINDOW: Duration = Duration::from_secs(2);

/// What pages and the thread that looks share.
#[derive(Default)]
pub struct Facts {
    shared: Mutex<Shared>,
}

#[derive(Default)]
struct Shared {
    state: Arc<String>,
    town: Arc<String>,
    asked: Option<Instant>,
}

impl Facts {
    /// The world as it is now, JSON; empty before anything is known.
    pub fn state(&self) -> Arc<String> {
        let mut shared = self.shared.lock();
        shared.asked = Some(Instant::now());
        shared.state.clone()
    }

    /// What changes seldom: what can be spawned and where, and the plan of the town, JSON.
    pub fn town(&self) -> Arc<String> {
        self.shared.lock().town.clone()
    }

    /// Looks at the world while pages ask, until `ends`.
    ///
    /// # Errors
    /// If the bus cannot be joined.
    pub fn serve(&self, domain: &str, ends: &AtomicBool) -> anyhow::Result<()> {
        let program = format!("gantry-desk-{}", std::process::id());
        let mut look = Look::open(domain, &program)?;
        while !ends.load(Ordering::Acquire) {
            let is_asked = self
                .shared
                .lock()
                .asked
                .is_some_and(|at| at.elapsed() < SILENCE);
            if is_asked {
                if look.turn()? {
                    self.shared.lock().town = Arc::new(look.town());
                }
                let state = look.state();
                self.shared.lock().state = Arc::new(state);
            }
            std::thread::sleep(TURN);
        }
        Ok(())
    }
}

/// The thread's own view of the bus.
struct Look {
    // Dropped before the node that made them.
    info: FollowedDocument,
    actors: FollowedDocument,
    map: FollowedDocument,
    catalogue: FollowedDocument,
    points: FollowedDocument,
    follower: Follower,
    domain: String,
    now: Option<WorldInfo>,
    known: BTreeMap<u32, ActorInfo>,
    plan: Value,
    types: Value,
    places: Value,
    world: Option<Arc<WorldAt>>,
    clock: Clock,
    /// Counts changes of what changes seldom.
    revision: u64,
}

impl Look {
    fn open(domain: &str, program: &str) -> anyhow::Result<Look> {
        Ok(Look {
            info: FollowedDocument::new(names::WORLD_INFO),
            actors: FollowedDocument::new(names::WORLD_ACTORS),
            map: FollowedDocument::new(names::WORLD_MAP),
            catalogue: FollowedDocument::new(names::WORLD_CATALOGUE),
            points: FollowedDocument::optional(names::WORLD_SPAWN_POINTS),
            follower: Follower::open(domain, program)?,
            domain: domain.to_owned(),
            now: None,
            known: BTreeMap::new(),
            plan: json!([]),
            types: json!([]),
            places: json!([]),
            world: None,
            clock: Clock::default(),
            revision: 0,
        })
    }

    /// Takes over what is new; whether the town has changed.
    fn turn(&mut self) -> anyhow::Result<bool> {
        let bus = self.follower.bus();
        let before = self.revision;
        if let Some(document) = self.info.changed(bus)? {
            self.now = Some(document.json()?);
        }
        if let Some(document) = self.actors.changed(bus)? {
            let list: ActorList = document.json()?;
            let by_id = list.actors.into_iter().map(|actor| (actor.id, actor));
            self.known = by_id.collect();
        }
        if let Some(document) = self.map.changed(bus)? {
            self.plan = plan(&document.text);
            self.revision += 1;
        }
        if let Some(document) = self.catalogue.changed(bus)? {
            self.types = types(&document.json()?);
            self.revision += 1;
        }
        if let Some(document) = self.points.changed(bus)? {
            self.places = json!(document.json::<SpawnPoints>()?.points);
            self.revision += 1;
        }
        if let Some(world) = self.follower.newest_world()? {
            self.clock.note(world.header.tick, world.header.sim_nanos);
            self.world = Some(world);
        }
        Ok(self.revision != before)
    }

    fn town(&self) -> String {
        json!({
            "revision": self.revision,
            "lanes": self.plan,
            "types": self.types,
            "spawn_points": self.places,
        })
        .to_string()
    }

    fn state(&mut self) -> String {
        let Some((world, info)) = self.world.as_ref().zip(self.now.as_ref()) else {
            let domain = &self.domain;
            return json!({ "waits_for": domain }).to_string();
        };
        let body = |kind: ActorKind| {
            let records = world.records.iter();
            records.filter(move |record| record.kind() == Some(kind))
        };
        let place = |record: &schema_frames::ActorRecord| {
            let [x, y, _] = record.world_from_actor.translation_m;
            [rounded(x), rounded(y)]
        };
        let vehicles: Vec<Value> = body(ActorKind::Vehicle)
            .map(|record| {
                let known = self.known.get(&record.id);
                json!({
                    "id": record.id,
                    "type": known.map_or("", |actor| actor.type_id.as_str()),
                    "role": known.map_or("", |actor| actor.role.as_str()),
                    "at": place(record),
                    "yaw": rounded(yaw(record)),
                    "mps": rounded(record.speed_mps()),
                })
            })
            .collect();
        let walkers: Vec<Value> = body(ActorKind::Walker)
            .map(|record| json!({ "id": record.id, "at": place(record) }))
            .collect();
        let lights: Vec<Value> = body(ActorKind::TrafficLight)
            .filter_map(|record| {
                let state = LightState::from_code(record.traffic_light()?.state);
                Some(json!({ "at": place(record), "state": state.name() }))
            })
            .collect();
        let spectator = body(ActorKind::Spectator).next().map(|record| record.id);
        json!({
            "revision": self.revision,
            "map": info.map,
            "source": info.source,
            "seed": info.seed,
            "adapter": info.adapter,
            "paused": info.mode == StepMode::Stepped,
            "period_secs": info.period_nanos as f64 * 1e-9,
            "tick": world.header.tick,
            "sim_secs": world.header.sim_nanos as f64 * 1e-9,
            "speed": self.clock.speed(),
            "weather": info.weather,
            "vehicles": vehicles,
            "walkers": walkers,
            "lights": lights,
            "spectator": spectator,
        })
        .to_string()
    }
}

/// How fast simulated time goes by.
#[derive(Default)]
struct Clock {
    notes: std::collections::VecDeque<(Instant, u64, u64)>,
}

impl Clock {
    fn note(&mut self, tick: u64, sim_nanos: u64) {
        let is_back = self.notes.back().is_some_and(|(_, last, _)| *last > tick);
        if is_back {
            self.notes.clear();
        }
        self.notes.push_back((Instant::now(), tick, sim_nanos));
        while self.notes.len() > 2 && self.notes[0].0.elapsed() > SPEED_WINDOW {
            self.notes.pop_front();
        }
    }

    /// Simulated seconds per second.
    fn speed(&self) -> f64 {
        let (Some(first), Some(last)) = (self.notes.front(), self.notes.back()) else {
            return 0.0;
        };
        let wall_secs = (last.0 - first.0).as_secs_f64();
        match wall_secs > 0.2 {
            true => rounded(last.2.saturating_sub(first.2) as f64 * 1e-9 / wall_secs),
            false => 0.0,
        }
    }
}

/// To centimetres: more digits only make the answer longer.
fn rounded(x: f64) -> f64 {
    (x * 100.0).round() / 100.0
}

/// Heading, counter-clockwise from world x, radians.
fn yaw(record: &schema_frames::ActorRecord) -> f64 {
    let [x, y, z, w] = record.world_from_actor.rotation_xyzw;
    (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z))
}

/// Edges of the lanes as lists of points, metres; none of a map that cannot be read.
fn plan(open_drive: &str) -> Value {
    let Ok(map) = RoadMap::parse(open_drive) else {
        return json!([]);
    };
    let flat = |edge: Vec<[f64; 3]>| -> Vec<f64> {
        let points = edge.iter();
        points
            .flat_map(|[x, y, _]| [rounded(*x), rounded(*y)])
            .collect()
    };
    let drivable = map.lanes().iter().filter(|lane| lane.kind.is_drivable());
    let edges = drivable.flat_map(|lane| {
        let (left, right) = map.boundaries(lane.key, PLAN_STEP_M);
        [flat(left), flat(right)]
    });
    Value::from_iter(edges.collect::<Vec<_>>())
}

/// Names of what can be spawned.
fn types(catalogue: &Catalogue) -> Value {
    let kinds = ["vehicle", "walker", "prop"];
    let entries = catalogue.entries.iter();
    let wanted = entries.filter(|entry| kinds.contains(&entry.kind.as_str()));
    Value::from_iter(wanted.map(|entry| entry.type_id.as_str()))
}
