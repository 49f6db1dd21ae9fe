//! People on foot: fills the pavements of a map and leads everybody from place to place.
//!
//! How they go is told in [`schema_roads::walkable::stroll`]; here they also pass each other on the
//! right, and those who were knocked down are taken away after a while. The same traffic, seed and
//! options give the same commands.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use nalgebra::{Isometry2, Vector2, Vector3};
use schema_frames::limits::MAX_COMMANDS;
use schema_frames::{Catalogue, Command, LightState, WalkerControl};
use schema_roads::RoadMap;
use schema_roads::walkable::Pavements;
use schema_roads::walkable::detour::Obstacle;
use schema_roads::walkable::stroll::{
    OnFoot, STANDS_MPS, SeenVehicle, Stroll, StrollStep, StrollView, draw_newcomer, draw_speed_mps,
};
use schema_types::noise::Noise;

use crate::traffic::{Mover, Traffic};

/// Role of the people that are led here; a process that takes over knows them by it.
pub const ROLE: &str = "crowd";

/// Random stream of the crowd: no other use of the seed has this number.
const STREAM: u64 = 0x77a2_9d00;
/// A person that lies for this long is taken away, and another one comes, seconds.
const LIES_SECS: f64 = 20.0;
/// People who come this near ahead are passed on the right, metres, and by how much of a step aside.
const MEETS_M: f64 = 1.6;
const ASIDE_RATIO: f64 = 0.6;
/// A control is sent again once its direction has turned by this much, radians.
const TURNED_RAD: f64 = 0.03;

/// How many people, and what they do.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CrowdOptions {
    /// How many; fewer where the map has no room.
    pub walkers: usize,
    /// Share of them that crosses roads anywhere and not on crosswalks alone, percent.
    pub crossing_percent: f64,
}

/// A kind of person.
#[derive(Clone, Debug)]
struct Kind {
    type_id: String,
    half_height_m: f64,
    speed_mps: f64,
}

/// Somebody on the way.
#[derive(Clone, Debug)]
struct Person {
    speed_mps: f64,
    crosses_anywhere: bool,
    stroll: Stroll,
    lies_secs: f64,
    /// What was sent last: direction and speed.
    sent: Option<(f64, f64)>,
}

/// The people of one map.
#[derive(Debug)]
pub struct Crowd {
    options: CrowdOptions,
    seed: u64,
    ground: Pavements,
    kinds: Vec<Kind>,
    people: BTreeMap<u32, Person>,
    n_tries: u64,
    n_vain: u64,
}

impl Crowd {
    /// Nobody yet, on this map.
    pub fn new(map: &RoadMap, catalogue: &Catalogue, options: CrowdOptions, seed: u64) -> Crowd {
        let kind = |entry: &schema_frames::CatalogueEntry| {
            let walks = entry.recommended.get("speed").and_then(|all| all.get(1));
            Kind {
                type_id: entry.type_id.clone(),
                half_height_m: f64::from(entry.body_box.half_m[2]),
                speed_mps: walks.and_then(|text| text.parse().ok()).unwrap_or(1.3),
            }
        };
        let walkers = catalogue.entries.iter().filter(|e| e.kind == "walker");
        Crowd {
            options,
            seed,
            ground: Pavements::new(map, options.crossing_percent > 0.0),
            kinds: walkers.map(kind).collect(),
            people: BTreeMap::new(),
            n_tries: 0,
            n_vain: 0,
        }
    }

    /// Number of people.
    pub fn len(&self) -> usize {
        self.people.len()
    }

    /// Whether there is nobody.
    pub fn is_empty(&self) -> bool {
        self.people.is_empty()
    }

    /// Everybody's id, rising.
    pub fn ids(&self) -> impl Iterator<Item = u32> + '_ {
        self.people.keys().copied()
    }

    /// Spawns for those that are still to come. Each answer goes to [`Crowd::came`]. Nothing once the
    /// map seems to be full.
    pub fn missing(&mut self) -> Vec<Command> {
        let n = self.options.walkers.saturating_sub(self.people.len()) as u64;
        let is_full = self.n_vain > 20 * self.options.walkers as u64 + 100;
        if n == 0 || is_full || self.kinds.is_empty() {
            return Vec::new();
        }
        // A request takes no more commands; the others come with the next.
        let n = n.min(MAX_COMMANDS as u64);
        (0..n).filter_map(|_| self.candidate()).collect()
    }

    fn candidate(&mut self) -> Option<Command> {
        let draw = Noise::new(self.seed, STREAM, self.n_tries);
        self.n_tries += 1;
        let half_height_m = |kind: usize| self.kinds[kind].half_height_m;
        let newcomer = draw_newcomer(&self.ground, draw, self.kinds.len(), half_height_m)?;
        Some(Command::Spawn {
            type_id: self.kinds[newcomer.kind].type_id.clone(),
            pose: newcomer.pose.into(),
            parent_id: None,
            role: ROLE.to_owned(),
            attributes: BTreeMap::new(),
        })
    }

    /// Somebody came; returns false if there are enough already and this one should go again.
    pub fn came(&mut self, id: u32, type_id: &str) -> bool {
        if self.people.len() >= self.options.walkers {
            return false;
        }
        let kind = self.kinds.iter().find(|kind| kind.type_id == type_id);
        // Ids go on counting when a map is loaded again, and the same people must choose the same.
        let number = self.people.len() as u64;
        let draw = Noise::new(self.seed, STREAM + 1, number);
        let usual_mps = kind.map_or(1.3, |kind| kind.speed_mps);
        let person = Person {
            speed_mps: draw_speed_mps(usual_mps, draw.uniform(0)),
            crosses_anywhere: 100.0 * draw.uniform(1) < self.options.crossing_percent,
            stroll: Stroll::new(number << 32),
            lies_secs: 0.0,
            sent: None,
        };
        self.people.insert(id, person);
        self.n_vain = 0;
        true
    }

    /// A place was taken.
    pub fn was_refused(&mut self) {
        self.n_vain += 1;
    }

    /// What everybody does next; who has gone from the world is forgotten.
    pub fn step(&mut self, traffic: &Traffic) -> Vec<Command> {
        if self.people.is_empty() {
            return Vec::new();
        }
        let vehicles: Vec<SeenVehicle> = traffic
            .movers
            .iter()
            .filter(|mover| mover.is_vehicle)
            .map(seen_vehicle)
            .collect();
        let is_red = |id: &str| {
            let state = traffic.lights.get(id);
            state.is_none_or(|state| *state == LightState::Red)
        };
        let view = View {
            stroll: StrollView {
                ground: &self.ground,
                vehicles: &vehicles,
                is_red: &is_red,
            },
            walkers: walkers_by_cell(traffic),
            seed: self.seed,
        };
        let mut commands = Vec::new();
        // Who was spawned after this snapshot is not in it yet.
        let newest = traffic.movers.last().map_or(0, |mover| mover.id);
        self.people
            .retain(|id, _| traffic.mover(*id).is_some() || *id > newest);
        let mut gone = Vec::new();
        for (id, person) in &mut self.people {
            let Some(me) = traffic.mover(*id) else {
                continue;
            };
            person.lies_secs = match me.lies {
                true => person.lies_secs + traffic.period_secs,
                false => 0.0,
            };
            if person.lies_secs > LIES_SECS {
                commands.push(Command::Destroy { actor_id: *id });
                gone.push(*id);
                continue;
            }
            let aim = view.walk(me, person, traffic.period_secs);
            let (yaw_rad, speed_mps) = match aim {
                Some(to) => (to.y.atan2(to.x), person.speed_mps),
                None => (person.sent.map_or(me.yaw_rad, |(yaw, _)| yaw), 0.0),
            };
            let is_new = person.sent.is_none_or(|(yaw, speed)| {
                let turned = (yaw_rad - yaw + 1.5 * TAU).rem_euclid(TAU) - 0.5 * TAU;
                speed != speed_mps || turned.abs() > TURNED_RAD
            });
            if is_new {
                person.sent = Some((yaw_rad, speed_mps));
                commands.push(Command::ControlWalker {
                    actor_id: *id,
                    control: WalkerControl {
                        direction: [yaw_rad.cos() as f32, yaw_rad.sin() as f32, 0.0],
                        speed_mps: speed_mps as f32,
                        jump: false,
                    },
                });
            }
        }
        for id in gone {
            self.people.remove(&id);
        }
        commands
    }
}

/// What people see in one tick.
struct View<'v> {
    stroll: StrollView<'v>,
    walkers: BTreeMap<[i64; 2], Vec<&'v Mover>>,
    seed: u64,
}

/// Cell of the grid in which people find each other.
fn cell([x, y]: [f64; 2]) -> [i64; 2] {
    [x, y].map(|x| (x / 2.0).floor() as i64)
}

fn walkers_by_cell(traffic: &Traffic) -> BTreeMap<[i64; 2], Vec<&Mover>> {
    let mut walkers: BTreeMap<_, Vec<&Mover>> = BTreeMap::new();
    for person in traffic.movers.iter().filter(|mover| !mover.is_vehicle) {
        walkers
            .entry(cell(person.origin()))
            .or_default()
            .push(person);
    }
    walkers
}

fn seen_vehicle(vehicle: &Mover) -> SeenVehicle {
    let [x, y] = vehicle.middle();
    let [vx, vy] = vehicle.velocity_mps;
    SeenVehicle {
        middle_m: Vector3::new(x, y, vehicle.position_m[2]),
        velocity_mps: Vector3::new(vx, vy, 0.0),
        half_length_m: vehicle.half_m[0],
        obstacle: Some(Obstacle {
            world_from_box: Isometry2::new(Vector2::new(x, y), vehicle.yaw_rad),
            half_m: Vector2::from(vehicle.half_m),
            moves: vehicle.speed_mps.abs() > STANDS_MPS,
        }),
    }
}

impl View<'_> {
    /// The direction of the next step; `None` to stand.
    fn walk(&self, me: &Mover, person: &mut Person, dt_secs: f64) -> Option<Vector2<f64>> {
        let here = Vector2::from(me.origin());
        let on_foot = OnFoot {
            at_m: me.position_m,
            radius_m: me.half_m[0].max(me.half_m[1]),
            crosses_anywhere: person.crosses_anywhere,
        };
        let lot = |n_ways: u64| Noise::new(self.seed, STREAM + 2, n_ways).uniform(0);
        match self.stroll.step(&on_foot, &mut person.stroll, dt_secs, lot) {
            StrollStep::Stand => None,
            StrollStep::Ahead(to) => Some(self.past_people(me, to - here)),
            StrollStep::Around(place) => Some(place - here),
        }
    }

    /// The direction, turned to the right while somebody is close ahead and there is ground.
    fn past_people(&self, me: &Mover, way: Vector2<f64>) -> Vector2<f64> {
        let here = Vector2::from(me.origin());
        let Some(forward) = way.try_normalize(1e-6) else {
            return way;
        };
        let [x, y] = cell(me.origin());
        let around = (x - 1..=x + 1).flat_map(|x| (y - 1..=y + 1).map(move |y| [x, y]));
        let meets = |other: &&&Mover| {
            let between = Vector2::from(other.origin()) - here;
            other.id != me.id
                && between.norm() < MEETS_M
                && (other.position_m[2] - me.position_m[2]).abs() < 2.0
                && between.dot(&forward) > 0.5 * between.norm()
                // Who walks ahead at least as fast is no obstacle.
                && Vector2::from(other.velocity_mps).dot(&forward) < 0.8
        };
        let meets_somebody = around
            .filter_map(|at| self.walkers.get(&at))
            .flatten()
            .any(|other| meets(&other));
        let right = Vector2::new(forward.y, -forward.x);
        let aside = forward + ASIDE_RATIO * right;
        let is_walkable = |place| self.stroll.is_walkable(place, me.position_m[2]);
        if meets_somebody && is_walkable(here + 0.6 * aside) {
            aside
        } else {
            forward
        }
    }
}
