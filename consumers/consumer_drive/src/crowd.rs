//! People on foot: fills the pavements of a map and leads everybody from place to place, across
//! crosswalks when the traffic has red or leaves a gap, round each other and round what stands.
//!
//! Nothing here knows the bus. The same traffic, seed and options give the same commands.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use nalgebra::{Isometry2, Vector2};
use schema_frames::limits::MAX_COMMANDS;
use schema_frames::{Catalogue, Command, LightState, WalkerControl};
use schema_roads::RoadMap;
use schema_roads::walkable::detour::{self, Obstacle, Step as Detour};
use schema_roads::walkable::pavements::REACH_M;
use schema_roads::walkable::{Ground, Pavements};
use schema_types::Pose;
use schema_types::noise::Noise;

use crate::traffic::{Mover, Traffic};

/// Role of the people that are led here; a process that takes over knows them by it.
pub const ROLE: &str = "crowd";

/// Random stream of the crowd: no other use of the seed has this number.
const STREAM: u64 = 0x77a2_9d00;
/// A corner of the way counts as reached from this far, metres.
const ARRIVED_M: f64 = 0.35;
/// Who gets no nearer for this long chooses another way, seconds.
const PATIENCE_SECS: f64 = 4.0;
/// Who lies for this long is taken away, and somebody else comes, seconds.
const LIES_SECS: f64 = 20.0;
/// A vehicle that could be there within this time keeps people from stepping on a crosswalk, or on a
/// road beside one, seconds.
const GAP_SECS: [f64; 2] = [4.0, 6.0];
/// A vehicle slower than this counts as standing, m/s.
const STANDS_MPS: f64 = 0.3;
/// Vehicles farther away than this, between the middles, are not seen, metres.
const SEES_M: f64 = 12.0;
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
    /// Corners of the way, and the face that each leads into (`u32::MAX` for the end).
    path: Vec<([f64; 2], u32)>,
    next: usize,
    n_ways: u64,
    stuck_secs: f64,
    nearest_m: f64,
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
        let face = self.ground.place(draw.uniform(0))?;
        let kind = &self.kinds[(draw.bits(1) % self.kinds.len() as u64) as usize];
        let [x, y, z] = self.ground.middles_m[face];
        let pose = Pose::from_xyz_yaw(x, y, z + kind.half_height_m + 0.2, TAU * draw.uniform(2));
        Some(Command::Spawn {
            type_id: kind.type_id.clone(),
            pose: pose.into(),
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
        let speed_mps = kind.map_or(1.3, |kind| kind.speed_mps) * (0.85 + 0.3 * draw.uniform(0));
        let person = Person {
            speed_mps,
            crosses_anywhere: 100.0 * draw.uniform(1) < self.options.crossing_percent,
            path: Vec::new(),
            next: 0,
            n_ways: number << 32,
            stuck_secs: 0.0,
            nearest_m: f64::MAX,
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
        let view = View::new(&self.ground, traffic, self.seed);
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
    ground: &'v Pavements,
    traffic: &'v Traffic,
    seed: u64,
    vehicles: Vec<(&'v Mover, Obstacle)>,
    walkers: BTreeMap<[i64; 2], Vec<&'v Mover>>,
}

/// Cell of the grid in which people find each other.
fn cell([x, y]: [f64; 2]) -> [i64; 2] {
    [x, y].map(|x| (x / 2.0).floor() as i64)
}

impl<'v> View<'v> {
    fn new(ground: &'v Pavements, traffic: &'v Traffic, seed: u64) -> View<'v> {
        let obstacle = |vehicle: &Mover| Obstacle {
            world_from_box: Isometry2::new(Vector2::from(vehicle.middle()), vehicle.yaw_rad),
            half_m: Vector2::from(vehicle.half_m),
            moves: vehicle.speed_mps.abs() > STANDS_MPS,
        };
        let (vehicles, people): (Vec<_>, Vec<_>) =
            traffic.movers.iter().partition(|mover| mover.is_vehicle);
        let mut walkers: BTreeMap<_, Vec<&Mover>> = BTreeMap::new();
        for person in people {
            walkers
                .entry(cell(person.origin()))
                .or_default()
                .push(person);
        }
        View {
            ground,
            traffic,
            seed,
            vehicles: vehicles.into_iter().map(|v| (v, obstacle(v))).collect(),
            walkers,
        }
    }

    /// The direction of the next step; `None` to stand.
    fn walk(&self, me: &Mover, person: &mut Person, dt_secs: f64) -> Option<Vector2<f64>> {
        let at = me.position_m;
        let here = Vector2::from(me.origin());
        if person.next >= person.path.len() || person.stuck_secs > PATIENCE_SECS {
            self.choose(person, at);
        }
        let away = |corner: &[f64; 2]| (Vector2::from(*corner) - here).norm();
        while let Some((corner, into)) = person.path.get(person.next) {
            if away(corner) >= ARRIVED_M {
                break;
            }
            if !self.may_enter(at, *into as usize) {
                return None;
            }
            person.next += 1;
            person.nearest_m = f64::MAX;
        }
        let &(corner, into) = person.path.get(person.next)?;
        let left_m = away(&corner);
        if left_m < person.nearest_m - 0.05 {
            (person.nearest_m, person.stuck_secs) = (left_m, 0.0);
        } else {
            person.stuck_secs += dt_secs;
        }
        let is_near = |vehicle: &Mover| {
            (Vector2::from(vehicle.middle()) - here).norm() < SEES_M
                && (vehicle.position_m[2] - at[2]).abs() < 4.0
        };
        let near: Vec<Obstacle> = self
            .vehicles
            .iter()
            .filter(|(vehicle, _)| is_near(vehicle))
            .map(|(_, obstacle)| *obstacle)
            .collect();
        let is_walkable = |p: Vector2<f64>| self.ground.face_at([p.x, p.y, at[2]]).is_some();
        let radius_m = me.half_m[0].max(me.half_m[1]);
        let to = Vector2::from(corner);
        match detour::step(here, to, radius_m, &near, &is_walkable) {
            Detour::Ahead => Some(self.past_people(me, to - here, &is_walkable)),
            Detour::Via(place) => Some(place - here),
            Detour::Wait => None,
            Detour::Taken => {
                let beyond = person
                    .path
                    .get(person.next + 1)
                    .map(|it| Vector2::from(it.0));
                let leads_on =
                    beyond.is_none_or(|beyond| detour::is_on_ground(here, beyond, &is_walkable));
                if leads_on && self.may_enter(at, into as usize) {
                    person.next += 1;
                    person.nearest_m = f64::MAX;
                }
                None
            }
        }
    }

    /// The direction, turned to the right while somebody is close ahead and there is ground.
    fn past_people(
        &self,
        me: &Mover,
        way: Vector2<f64>,
        is_walkable: &impl Fn(Vector2<f64>) -> bool,
    ) -> Vector2<f64> {
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
        if meets_somebody && is_walkable(here + 0.6 * aside) {
            aside
        } else {
            forward
        }
    }

    /// Chooses a new way to a place within reach; leaves nobody with a way that leads nowhere.
    fn choose(&self, person: &mut Person, at: [f64; 3]) {
        (person.path, person.next) = (Vec::new(), 0);
        (person.stuck_secs, person.nearest_m) = (0.0, f64::MAX);
        let Some(from) = self.ground.face_near(at) else {
            return;
        };
        for _ in 0..8 {
            person.n_ways += 1;
            let draw = Noise::new(self.seed, STREAM + 2, person.n_ways);
            let Some(to) = self.ground.place(draw.uniform(0)) else {
                return;
            };
            let [x, y, _] = self.ground.middles_m[to];
            if to == from || (x - at[0]).hypot(y - at[1]) > REACH_M {
                continue;
            }
            if let Some(way) = self.ground.way(from, to, person.crosses_anywhere) {
                person.path = self.ground.corners(&way, [at[0], at[1]]);
                return;
            }
        }
    }

    /// Whether somebody may step into a face: onto a crosswalk while the traffic over it has red or,
    /// where there are no lights, a gap; onto a road in a longer gap.
    fn may_enter(&self, at: [f64; 3], into: usize) -> bool {
        let ground_of = |face: usize| self.ground.mesh.faces.get(face).map(|face| face.ground);
        let is_open =
            |ground: Option<Ground>| matches!(ground, Some(Ground::Crosswalk | Ground::Road));
        let here = self.ground.face_at(at).and_then(ground_of);
        let to = ground_of(into);
        if !is_open(to) || is_open(here) {
            return true;
        }
        let guards = self.ground.guards.get(&into).map_or(&[][..], Vec::as_slice);
        let is_red = |id: &String| {
            let state = self.traffic.lights.get(id);
            state.is_none_or(|state| *state == LightState::Red)
        };
        if !guards.iter().all(is_red) {
            return false;
        }
        let gap_secs = match (guards.is_empty(), to) {
            (false, _) => 1.0,
            (true, Some(Ground::Road)) => GAP_SECS[1],
            (true, _) => GAP_SECS[0],
        };
        let [x, y, _] = self.ground.middles_m[into];
        !self.vehicles.iter().any(|(vehicle, _)| {
            let middle = vehicle.middle();
            let between = Vector2::new(x - middle[0], y - middle[1]);
            let velocity = Vector2::from(vehicle.velocity_mps);
            let reach_m = vehicle.half_m[0] + 2.0 + velocity.norm() * gap_secs;
            between.norm() < reach_m
                && velocity.norm() > STANDS_MPS
                && (velocity.dot(&between) > 0.0 || between.norm() < 6.0)
        })
    }
}
