//! Walkers that stroll by themselves: from place to place over the walkable mesh, across crosswalks
//! when the traffic's light is red.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};
use std::sync::Arc;

use nalgebra::{Isometry2, Vector2, Vector3};
use schema_frames::{LightState, WalkerControl};
use schema_roads::walkable::{Ground, WalkMesh};
use schema_types::noise::Noise;
use schema_types::{ActorId, Pose};
use serde::{Deserialize, Serialize};

use super::detour::{self, Obstacle, Step};
use super::walker_models;
use crate::vehicle::Vehicle;
use crate::world::World;

/// Keeps this lottery apart from every other use of the seed.
const STREAM: u64 = 0x77a1_4e20;
/// Farthest that a stroll goes, metres as the crow flies.
const REACH_M: f64 = 160.0;
/// A corner of the path counts as reached from this far, metres.
const ARRIVED_M: f64 = 0.35;
/// Distance that paths keep from the ends of the edges they cross, metres.
const ASIDE_M: f64 = 0.3;
/// Who gets no further for this long chooses another way, seconds.
const PATIENCE_SECS: f64 = 4.0;
/// A vehicle that could be at a crosswalk within this time keeps walkers from stepping on it,
/// seconds.
const GAP_SECS: f64 = 4.0;
/// A vehicle slower than this stands, m/s.
const STANDS_MPS: f64 = 0.3;
/// Vehicles beyond this are not looked at, metres between the middles.
const SEES_M: f64 = 12.0;
/// A vehicle whose middle is this much higher or lower is on another level, metres.
const LEVEL_M: f64 = 4.0;
/// Farthest that a light's stop line may lie from the crosswalk that it guards, metres.
const GUARD_M: f64 = 16.0;

/// One who strolls.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Stroller {
    actor: ActorId,
    speed_mps: f32,
    /// Corners of the way, and which faces they lead into (`u32::MAX` for the end).
    path: Vec<([f64; 2], u32)>,
    next: usize,
    /// Strolls begun, and how long it has not come nearer.
    n_strolls: u64,
    stuck_secs: f64,
    nearest_m: f64,
}

/// Everybody who strolls, and where.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Crowd {
    strollers: Vec<Stroller>,
    #[serde(skip)]
    pub ground: Option<Arc<Pavements>>,
}

/// The mesh with what guards its crosswalks.
#[derive(Clone, Debug)]
pub(crate) struct Pavements {
    mesh: WalkMesh,
    middles_m: Vec<[f64; 3]>,
    /// Pavement faces with the sum of their areas up to each, for drawing places by lot.
    places: Vec<(usize, f64)>,
    /// Per crosswalk face the signals (by OpenDRIVE id) of the traffic over it.
    guards: BTreeMap<usize, Vec<String>>,
    /// Faces by the squares that they may reach into, by rising number.
    squares: BTreeMap<(i64, i64), Vec<usize>>,
}

/// Side of the squares in which faces are looked up, metres.
const SQUARE_M: f64 = 8.0;

fn square([x, y, _]: [f64; 3]) -> (i64, i64) {
    ((x / SQUARE_M).floor() as i64, (y / SQUARE_M).floor() as i64)
}

fn squares(mesh: &WalkMesh) -> BTreeMap<(i64, i64), Vec<usize>> {
    let mut squares: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for face in 0..mesh.faces.len() {
        let start = ([f64::MAX; 3], [f64::MIN; 3]);
        let wider = |(low, high): ([f64; 3], [f64; 3]), p: [f64; 3]| {
            (
                [0, 1, 2].map(|i| low[i].min(p[i])),
                [0, 1, 2].map(|i| high[i].max(p[i])),
            )
        };
        let (low, high) = mesh.corners_m(face).fold(start, wider);
        let (low, high) = (square(low), square(high));
        for x in low.0..=high.0 {
            (low.1..=high.1).for_each(|y| squares.entry((x, y)).or_default().push(face));
        }
    }
    squares
}

impl Pavements {
    fn new(roads: &schema_roads::RoadMap) -> Pavements {
        let mesh = roads.walkable(false);
        let middles_m: Vec<[f64; 3]> = (0..mesh.faces.len())
            .map(|face| mesh.middle_m(face))
            .collect();
        let mut places = Vec::new();
        let mut sum_m2 = 0.0;
        let parts = parts(&mesh);
        for face in (0..mesh.faces.len())
            .filter(|face| mesh.faces[*face].ground == Ground::Sidewalk && parts[*face])
        {
            sum_m2 += mesh.area_m2(face);
            places.push((face, sum_m2));
        }
        let lights = || {
            roads
                .signals()
                .iter()
                .filter(|signal| signal.kind == schema_roads::SignalKind::TrafficLight)
        };
        let mut guards: BTreeMap<usize, Vec<String>> = BTreeMap::new();
        for face in
            (0..mesh.faces.len()).filter(|face| mesh.faces[*face].ground == Ground::Crosswalk)
        {
            // The lights of the road that the crosswalk lies on, at this end of it.
            let Some(lane) = roads.nearest(middles_m[face], |lane| {
                lane.kind.is_drivable() && lane.junction.is_none()
            }) else {
                continue;
            };
            let guards_it = |stop: &schema_roads::SignalStop| {
                let line = roads
                    .pose(stop.stop)
                    .filter(|_| stop.stop.lane.road == lane.lane.road);
                line.is_some_and(|line| {
                    (line.translation.x - middles_m[face][0])
                        .hypot(line.translation.y - middles_m[face][1])
                        < GUARD_M
                })
            };
            let ids = lights()
                .filter(|signal| signal.stops.iter().any(guards_it))
                .map(|signal| signal.id.clone())
                .collect();
            guards.insert(face, ids);
        }
        let squares = squares(&mesh);
        Pavements {
            mesh,
            middles_m,
            places,
            guards,
            squares,
        }
    }

    /// A pavement face by lot, larger ones more often.
    fn place(&self, lot: f64) -> Option<usize> {
        let (_, all_m2) = self.places.last()?;
        let idx = self.places.partition_point(|(_, sum)| *sum < lot * all_m2);
        self.places
            .get(idx.min(self.places.len() - 1))
            .map(|(face, _)| *face)
    }

    /// The face under somebody's feet.
    fn face_at(&self, at: [f64; 3]) -> Option<usize> {
        let faces = self.squares.get(&square(at))?.iter().copied();
        let is_level = |face: &usize| (self.middles_m[*face][2] - at[2]).abs() < 3.0;
        faces
            .filter(is_level)
            .find(|face| self.mesh.contains(*face, at))
    }

    fn face_near(&self, at: [f64; 3]) -> Option<usize> {
        self.face_at(at).or_else(|| {
            let away = |face: &usize| {
                (self.middles_m[*face][0] - at[0]).powi(2)
                    + (self.middles_m[*face][1] - at[1]).powi(2)
            };
            (0..self.middles_m.len())
                .min_by(|a, b| away(a).total_cmp(&away(b)))
                .filter(|face| away(face) < 9.0)
        })
    }

    /// Faces from one to another by the shortest way over their middles.
    fn way(&self, from: usize, to: usize) -> Option<Vec<usize>> {
        let away = |a: usize, b: usize| {
            let (p, q) = (self.middles_m[a], self.middles_m[b]);
            (p[0] - q[0]).hypot(p[1] - q[1])
        };
        let mut best: BTreeMap<usize, (f64, usize)> = BTreeMap::from([(from, (0.0, from))]);
        // Lengths in tenths of a millimetre: whole numbers have an order.
        let key = |metres: f64| (metres * 1e4) as u64;
        let mut open = BinaryHeap::from([Reverse((key(away(from, to)), from))]);
        while let Some(Reverse((_, face))) = open.pop() {
            if face == to {
                let mut way = vec![to];
                while way[way.len() - 1] != from {
                    way.push(best[&way[way.len() - 1]].1);
                }
                way.reverse();
                return Some(way);
            }
            let so_far = best[&face].0;
            for next in self.mesh.faces[face]
                .neighbours
                .iter()
                .flatten()
                .map(|next| *next as usize)
            {
                let length = so_far + away(face, next);
                if length < 4.0 * REACH_M
                    && best
                        .get(&next)
                        .is_none_or(|(known, _)| length < known - 1e-9)
                {
                    best.insert(next, (length, face));
                    open.push(Reverse((key(length + away(next, to)), next)));
                }
            }
        }
        None
    }

    /// Corners of a path through faces: the point of each edge crossed that is nearest to the
    /// straight way, then the end.
    fn corners(&self, way: &[usize], from: [f64; 2]) -> Vec<([f64; 2], u32)> {
        let end = self.middles_m[way[way.len() - 1]];
        let mut at = Vector2::from(from);
        let end = Vector2::new(end[0], end[1]);
        let mut corners = Vec::new();
        for pair in way.windows(2) {
            let face = &self.mesh.faces[pair[0]];
            let Some(i) = face
                .neighbours
                .iter()
                .position(|next| *next == Some(pair[1] as u32))
            else {
                continue;
            };
            let corner = |k: usize| {
                let p = self.mesh.vertices_m[face.corners[k % face.corners.len()] as usize];
                Vector2::new(p[0], p[1])
            };
            let (a, b) = (corner(i), corner(i + 1));
            let length = (b - a).norm();
            let margin = (ASIDE_M / length.max(1e-6)).min(0.5);
            // Where the straight line to the end crosses the edge, kept off its ends.
            let (edge, ahead) = (b - a, end - at);
            let across = edge.perp(&ahead);
            let share = if across.abs() > 1e-9 {
                (at - a).perp(&ahead) / across
            } else {
                0.5
            };
            at = a + edge * share.clamp(margin, 1.0 - margin);
            corners.push((at.into(), pair[1] as u32));
        }
        corners.push((end.into(), u32::MAX));
        corners
    }
}

/// Whether each face belongs to the largest part that hangs together.
fn parts(mesh: &WalkMesh) -> Vec<bool> {
    let mut of = vec![usize::MAX; mesh.faces.len()];
    let mut largest = (0.0, usize::MAX);
    for start in 0..mesh.faces.len() {
        if of[start] != usize::MAX {
            continue;
        }
        let (mut open, mut area_m2) = (vec![start], 0.0);
        of[start] = start;
        while let Some(face) = open.pop() {
            area_m2 += mesh.area_m2(face);
            for next in mesh.faces[face]
                .neighbours
                .iter()
                .flatten()
                .map(|next| *next as usize)
            {
                if of[next] == usize::MAX {
                    of[next] = start;
                    open.push(next);
                }
            }
        }
        if area_m2 > largest.0 {
            largest = (area_m2, start);
        }
    }
    of.into_iter().map(|part| part == largest.1).collect()
}

impl World {
    /// Puts `n` walkers on pavements, who stroll from then on; fewer if the map has no room. Who
    /// they are follows from the seed.
    pub fn spawn_walkers(&mut self, n: usize) -> Vec<ActorId> {
        let Some(roads) = self.roads.clone().filter(|_| n > 0) else {
            return Vec::new();
        };
        let ground = Arc::new(Pavements::new(&roads));
        let mut crowd = Vec::new();
        for attempt in 0..4 * n as u64 {
            let draw = Noise::new(self.options.seed, STREAM, attempt);
            let Some(face) = ground.place(draw.uniform(0)).filter(|_| crowd.len() < n) else {
                break;
            };
            let models = walker_models();
            let model = &models[(draw.bits(1) % models.len() as u64) as usize];
            let [x, y, z] = ground.middles_m[face];
            let pose = Pose::from_xyz_yaw(
                x,
                y,
                z + 0.5 * model.shape.height_m + 0.2,
                std::f64::consts::TAU * draw.uniform(2),
            );
            if let Ok(actor) =
                self.spawn(&model.type_id, pose, None, "pedestrian", &BTreeMap::new())
            {
                let speed_mps = (model.speeds_mps[0] * (0.85 + 0.3 * draw.uniform(3))) as f32;
                let stroller = Stroller {
                    actor,
                    speed_mps,
                    path: Vec::new(),
                    next: 0,
                    n_strolls: 0,
                    stuck_secs: 0.0,
                    nearest_m: f64::MAX,
                };
                self.crowd.strollers.push(stroller);
                crowd.push(actor);
            }
        }
        self.crowd.ground = Some(ground);
        crowd
    }

    /// Tells everybody who strolls where to go, before the walkers move.
    pub(crate) fn lead_crowd(&mut self, dt_secs: f64) {
        if self.crowd.strollers.is_empty() {
            return;
        }
        if self.crowd.ground.is_none() {
            self.crowd.ground = self
                .roads
                .as_ref()
                .map(|roads| Arc::new(Pavements::new(roads)));
        }
        let Some(ground) = self.crowd.ground.clone() else {
            return;
        };
        let mut strollers = std::mem::take(&mut self.crowd.strollers);
        strollers.retain(|stroller| self.walkers.contains_key(&stroller.actor));
        let vehicles = self.obstacles();
        for stroller in &mut strollers {
            let control = self.stroll(&ground, stroller, &vehicles, dt_secs);
            if let Some(walker) = self
                .walkers
                .get_mut(&stroller.actor)
                .filter(|walker| walker.led.is_none())
            {
                walker.control = control;
            }
        }
        self.crowd.strollers = strollers;
    }

    fn stroll(
        &self,
        ground: &Pavements,
        stroller: &mut Stroller,
        vehicles: &[(Vector3<f64>, Obstacle)],
        dt_secs: f64,
    ) -> WalkerControl {
        let walker = &self.walkers[&stroller.actor];
        let at = walker.feet_m;
        if stroller.next >= stroller.path.len() || stroller.stuck_secs > PATIENCE_SECS {
            self.choose(ground, stroller, at);
        }
        let away = |corner: &[f64; 2]| (corner[0] - at[0]).hypot(corner[1] - at[1]);
        while stroller
            .path
            .get(stroller.next)
            .is_some_and(|(corner, _)| away(corner) < ARRIVED_M)
        {
            let (_, into) = stroller.path[stroller.next];
            if !self.may_enter(ground, at, into as usize) {
                return WalkerControl {
                    speed_mps: 0.0,
                    ..walker.control
                };
            }
            stroller.next += 1;
            stroller.nearest_m = f64::MAX;
        }
        let stands = WalkerControl {
            speed_mps: 0.0,
            ..walker.control
        };
        let Some(&(corner, into)) = stroller.path.get(stroller.next) else {
            return stands;
        };
        let left_m = away(&corner);
        if left_m < stroller.nearest_m - 0.05 {
            (stroller.nearest_m, stroller.stuck_secs) = (left_m, 0.0);
        } else {
            stroller.stuck_secs += dt_secs;
        }
        let is_near = |middle: &Vector3<f64>| {
            let (x, y, z) = (middle.x - at[0], middle.y - at[1], middle.z - at[2]);
            x * x + y * y < SEES_M * SEES_M && z.abs() < LEVEL_M
        };
        let near: Vec<Obstacle> = vehicles
            .iter()
            .filter(|(middle, _)| is_near(middle))
            .map(|(_, obstacle)| *obstacle)
            .collect();
        let is_walkable = |place: Vector2<f64>| ground.face_at([place.x, place.y, at[2]]).is_some();
        let here = Vector2::new(at[0], at[1]);
        let to = match detour::step(
            here,
            corner.into(),
            walker.model().radius_m(),
            &near,
            &is_walkable,
        ) {
            Step::Ahead => Vector2::from(corner),
            Step::Via(place) => place,
            Step::Wait => return stands,
            Step::Taken => {
                let beyond = stroller
                    .path
                    .get(stroller.next + 1)
                    .map(|(corner, _)| Vector2::from(*corner));
                let leads_on =
                    beyond.is_none_or(|beyond| detour::is_on_ground(here, beyond, &is_walkable));
                if leads_on && self.may_enter(ground, at, into as usize) {
                    stroller.next += 1;
                    stroller.nearest_m = f64::MAX;
                }
                return stands;
            }
        };
        WalkerControl {
            direction: [(to.x - at[0]) as f32, (to.y - at[1]) as f32, 0.0],
            speed_mps: stroller.speed_mps,
            jump: false,
        }
    }

    /// Every vehicle with its middle.
    fn obstacles(&self) -> Vec<(Vector3<f64>, Obstacle)> {
        let obstacle = |vehicle: &Vehicle| {
            let pose = vehicle.pose(&self.physics);
            let [length, width, _] = vehicle.model.solid_half_m();
            let forward = pose.rotation * Vector3::x();
            let world_from_box =
                Isometry2::new(pose.translation.vector.xy(), forward.y.atan2(forward.x));
            let moves = vehicle.velocity(&self.physics).0.norm() > STANDS_MPS;
            (
                pose.translation.vector,
                Obstacle {
                    world_from_box,
                    half_m: Vector2::new(length, width),
                    moves,
                },
            )
        };
        self.vehicles
            .values()
            .filter(|vehicle| vehicle.switches.collides)
            .map(obstacle)
            .collect()
    }

    /// A new way to a place within reach; stays put for a while if there is none.
    fn choose(&self, ground: &Pavements, stroller: &mut Stroller, at: [f64; 3]) {
        (
            stroller.path,
            stroller.next,
            stroller.stuck_secs,
            stroller.nearest_m,
        ) = (Vec::new(), 0, 0.0, f64::MAX);
        let Some(from) = ground.face_near(at) else {
            return;
        };
        for _ in 0..8 {
            stroller.n_strolls += 1;
            let draw = Noise::new(
                self.options.seed,
                STREAM + 1 + u64::from(stroller.actor.0),
                stroller.n_strolls,
            );
            let Some(to) = ground.place(draw.uniform(0)) else {
                return;
            };
            let [x, y, _] = ground.middles_m[to];
            if to == from || (x - at[0]).hypot(y - at[1]) > REACH_M {
                continue;
            }
            if let Some(way) = ground.way(from, to) {
                stroller.path = ground.corners(&way, [at[0], at[1]]);
                return;
            }
        }
    }

    /// Whether one may step into a face: onto a crosswalk only when the traffic over it has red,
    /// or, without lights, a gap.
    fn may_enter(&self, ground: &Pavements, at: [f64; 3], into: usize) -> bool {
        let is_crosswalk = |face: usize| {
            ground
                .mesh
                .faces
                .get(face)
                .is_some_and(|face| face.ground == Ground::Crosswalk)
        };
        let here = ground.face_at(at);
        if !is_crosswalk(into) || here.is_some_and(is_crosswalk) {
            return true;
        }
        let guards = ground.guards.get(&into).map_or(&[][..], Vec::as_slice);
        let is_red = |id: &String| {
            self.lights
                .lights
                .iter()
                .filter(|light| light.signal_id == *id)
                .all(|light| light.state == LightState::Red)
        };
        if !guards.iter().all(is_red) {
            return false;
        }
        let [x, y, _] = ground.middles_m[into];
        let place = Vector3::new(x, y, at[2]);
        !self.vehicles.values().any(|vehicle| {
            let pose = vehicle.pose(&self.physics);
            let (velocity, _) = vehicle.velocity(&self.physics);
            let between = place - pose.translation.vector;
            let reach_m = vehicle.model.half_m[0]
                + 2.0
                + velocity.norm() * if guards.is_empty() { GAP_SECS } else { 1.0 };
            between.xy().norm() < reach_m
                && velocity.norm() > 0.3
                && (velocity.dot(&between) > 0.0 || between.xy().norm() < 6.0)
        })
    }
}
