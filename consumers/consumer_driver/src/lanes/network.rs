//! The lanes of a map as drivers use them: points every metre, signals, neighbours, and which lanes
//! of a junction get into each other's way. Made lane by lane as somebody comes there, so that a
//! network of hundreds of kilometres costs nothing where nobody drives.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::sync::Arc;

use schema_roads::{Lane, LaneKey, LanePosition, RoadMap, SignalKind};
use schema_types::noise::mix;

use crate::plane::{PathPoint, distance, wrap};
use crate::speed;

/// Distance between points, metres.
const STEP_M: f64 = 1.0;
/// Speed limit where the map states none (30 km/h, as in CARLA's towns), m/s.
const DEFAULT_LIMIT_MPS: f64 = 30.0 / 3.6;
/// A lane between two junctions that is shorter than this has no room to wait in: the junctions are
/// crossed as one, metres.
const ROOM_TO_WAIT_M: f64 = 9.0;
/// A ring of lanes longer than this is no roundabout, metres.
const LONGEST_RING_M: f64 = 400.0;
/// A ring with a straight piece longer than this is a block of houses, metres.
const STRAIGHT_IN_RING_M: f64 = 18.0;
/// Turns less than this go straight on, radians.
pub(crate) const TURN_RAD: f64 = 0.45;

/// A place on a lane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LanePlace {
    /// The lane, by its index in the map.
    pub lane: u32,
    /// Lane s, metres.
    pub s_m: f64,
}

/// A sign or light on a lane, and where to stop for it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Guard {
    /// Index into [`RoadMap::signals`].
    pub signal: u32,
    pub kind: SignalKind,
    /// Lane of the stop line, and the place on it, metres.
    pub lane: u32,
    pub s_m: f64,
}

/// A lane.
#[derive(Clone, Debug)]
pub(crate) struct Way {
    pub key: LaneKey,
    /// Junction, or several that are crossed as one.
    pub zone: Option<u32>,
    /// Points about a metre apart, both ends included; `arc_m` counts from the start.
    pub points: Vec<PathPoint>,
    /// Length along the reference line, metres: the scale of lane s.
    pub span_m: f64,
    /// Change of direction from end to end, radians, positive to the left.
    pub turn_rad: f64,
    /// Least speed of its points, m/s.
    pub pace_mps: f64,
    pub guards: Vec<Guard>,
    pub successors: Vec<u32>,
    pub predecessors: Vec<u32>,
    /// Lanes beside it that cars may use.
    pub left: Option<u32>,
    pub right: Option<u32>,
    /// Whether it is part of a roundabout.
    pub circulates: bool,
}

impl Way {
    /// Length of the lane's middle, metres.
    pub fn length_m(&self) -> f64 {
        self.points.last().map_or(0.0, |p| p.arc_m)
    }

    /// Lane s at a length of its middle.
    pub fn s_at(&self, arc_m: f64) -> f64 {
        arc_m * self.span_m / self.length_m().max(1e-6)
    }

    /// Length of its middle at a lane s.
    pub fn arc_at(&self, s_m: f64) -> f64 {
        s_m * self.length_m() / self.span_m.max(1e-6)
    }
}

/// Where two lanes of a junction are too near to each other: lengths along the one and the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Meet {
    pub mine_m: [f64; 2],
    pub theirs_m: [f64; 2],
    /// Whether they go on as one.
    pub merges: bool,
}

/// Hashes small numbers of our own quickly: they are looked up for every pair of vehicles at a
/// junction in every tick.
#[derive(Clone, Copy, Debug, Default)]
struct Mix(u64);
type MixState = BuildHasherDefault<Mix>;

impl Hasher for Mix {
    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|byte| self.write_u8(*byte));
    }

    fn write_u8(&mut self, number: u8) {
        self.0 = mix(self.0 ^ u64::from(number));
    }

    fn write_u32(&mut self, number: u32) {
        self.0 = mix(self.0 ^ u64::from(number));
    }

    fn finish(&self) -> u64 {
        self.0
    }
}

/// The lanes of a map.
#[derive(Clone, Debug)]
pub(crate) struct Network {
    map: Arc<RoadMap>,
    ways: Vec<Option<Arc<Way>>>,
    /// Zone by lane; `u32::MAX` outside junctions.
    zones: Vec<u32>,
    /// Whether a lane leads on for ever.
    goes_on: Vec<bool>,
    meets: HashMap<(u32, u32, u8), Option<Meet>, MixState>,
    signals: HashMap<String, u32>,
}

impl Network {
    pub fn new(map: Arc<RoadMap>) -> Network {
        let signals = map
            .signals()
            .iter()
            .enumerate()
            .map(|(idx, signal)| (signal.id.clone(), idx as u32))
            .collect();
        Network {
            ways: vec![None; map.lanes().len()],
            zones: zones(&map),
            goes_on: goes_on(&map),
            meets: HashMap::default(),
            signals,
            map,
        }
    }

    pub fn map(&self) -> &RoadMap {
        &self.map
    }

    /// Index of a signal by its OpenDRIVE id.
    pub fn signal(&self, id: &str) -> Option<u32> {
        self.signals.get(id).copied()
    }

    /// Whether a lane leads on for ever, rather than to the ends of roads only.
    pub fn goes_on(&self, lane: u32) -> bool {
        self.goes_on[lane as usize]
    }

    /// Index of a lane.
    pub fn lane(&self, key: LaneKey) -> Option<u32> {
        self.map.lane_idx(key).map(|idx| idx as u32)
    }

    /// A lane by index.
    pub fn way(&mut self, lane: u32) -> Arc<Way> {
        if let Some(way) = &self.ways[lane as usize] {
            return way.clone();
        }
        let way = Arc::new(self.make(lane));
        self.ways[lane as usize] = Some(way.clone());
        way
    }

    fn make(&self, idx: u32) -> Way {
        let map = &*self.map;
        let lane = &map.lanes()[idx as usize];
        let points = points(map, lane);
        let index = |key: LaneKey| map.lane_idx(key).map(|idx| idx as u32);
        let beside = |key: Option<LaneKey>| {
            let key = key?;
            map.lane(key).filter(|l| l.kind.is_drivable())?;
            index(key)
        };
        let turn_rad = match (points.first(), points.last()) {
            (Some(a), Some(b)) => wrap(b.heading_rad - a.heading_rad),
            _ => 0.0,
        };
        let zone = self.zones[idx as usize];
        let guards = map
            .signal_stops(lane.key)
            .filter_map(|(signal, stop)| {
                Some(Guard {
                    signal: self.signal(&signal.id)?,
                    kind: signal.kind,
                    lane: index(stop.stop.lane)?,
                    s_m: stop.stop.s_m,
                })
            })
            .filter(|guard| {
                matches!(
                    guard.kind,
                    SignalKind::TrafficLight | SignalKind::Stop | SignalKind::Yield
                )
            });
        Way {
            key: lane.key,
            zone: (zone != u32::MAX).then_some(zone),
            pace_mps: points
                .iter()
                .map(|p| p.limit_mps.min(p.bend_mps))
                .fold(50.0, f64::min),
            span_m: lane.length_m,
            turn_rad,
            guards: guards.collect(),
            successors: drivable(map, map.successors(lane.key)),
            predecessors: drivable(map, map.predecessors(lane.key)),
            left: beside(lane.left),
            right: beside(lane.right),
            circulates: zone != u32::MAX && circulates(map, lane),
            points,
        }
    }

    /// Where two lanes come nearer to each other than `apart_m`, which is rounded up to 20 cm.
    pub fn meet(&mut self, mine: u32, theirs: u32, apart_m: f64) -> Option<Meet> {
        let grade = (apart_m / 0.2).ceil().clamp(0.0, 250.0) as u8;
        if let Some(known) = self.meets.get(&(mine, theirs, grade)) {
            return *known;
        }
        let (a, b) = (self.way(mine), self.way(theirs));
        let found = meet(&a, &b, f64::from(grade) * 0.2);
        let mirrored = found.map(|meet| Meet {
            mine_m: meet.theirs_m,
            theirs_m: meet.mine_m,
            merges: meet.merges,
        });
        self.meets.insert((mine, theirs, grade), found);
        self.meets.insert((theirs, mine, grade), mirrored);
        found
    }
}

fn drivable(map: &RoadMap, keys: &[LaneKey]) -> Vec<u32> {
    let is_drivable = |key: &&LaneKey| map.lane(**key).is_some_and(|lane| lane.kind.is_drivable());
    keys.iter()
        .filter(is_drivable)
        .filter_map(|key| map.lane_idx(*key))
        .map(|idx| idx as u32)
        .collect()
}

/// Whether each lane leads on for ever: lanes without a successor do not, nor do those all of whose
/// successors do not.
fn goes_on(map: &RoadMap) -> Vec<bool> {
    let lanes = map.lanes();
    let next: Vec<Vec<u32>> = lanes
        .iter()
        .map(|lane| drivable(map, map.successors(lane.key)))
        .collect();
    let mut left: Vec<usize> = next.iter().map(Vec::len).collect();
    let mut before: Vec<Vec<u32>> = vec![Vec::new(); lanes.len()];
    for (lane, list) in next.iter().enumerate() {
        for to in list {
            before[*to as usize].push(lane as u32);
        }
    }
    let mut ended: Vec<u32> = (0..lanes.len() as u32)
        .filter(|lane| left[*lane as usize] == 0)
        .collect();
    while let Some(lane) = ended.pop() {
        for from in &before[lane as usize] {
            left[*from as usize] -= 1;
            if left[*from as usize] == 0 {
                ended.push(*from);
            }
        }
    }
    left.into_iter().map(|n| n > 0).collect()
}

fn points(map: &RoadMap, lane: &Lane) -> Vec<PathPoint> {
    let pieces = (lane.length_m / STEP_M).ceil().max(1.0) as usize;
    let mut points: Vec<PathPoint> = Vec::with_capacity(pieces + 1);
    for i in 0..=pieces {
        let at = LanePosition::new(lane.key, lane.length_m * i as f64 / pieces as f64);
        let Some(pose) = map.pose(at) else { continue };
        let position_m = [pose.translation.x, pose.translation.y];
        let arc_m = points.last().map_or(0.0, |last| {
            last.arc_m + distance(last.position_m, position_m)
        });
        let curvature_per_m = map.curvature_per_m(at);
        points.push(PathPoint {
            position_m,
            height_m: pose.translation.z,
            heading_rad: pose.rotation.euler_angles().2,
            curvature_per_m,
            limit_mps: map.speed_limit_mps(at).unwrap_or(DEFAULT_LIMIT_MPS),
            bend_mps: speed::on_bend(curvature_per_m),
            arc_m,
        });
    }
    points
}

/// Number of the zone of each lane: its junction, where those that are joined by very short lanes
/// count as one.
fn zones(map: &RoadMap) -> Vec<u32> {
    let mut parent: HashMap<u32, u32> = HashMap::new();
    fn root(parent: &HashMap<u32, u32>, mut of: u32) -> u32 {
        while let Some(up) = parent.get(&of).filter(|up| **up != of) {
            of = *up;
        }
        of
    }
    let junction_of = |key: &LaneKey| map.lane(*key).and_then(|lane| lane.junction);
    let is_link = |lane: &Lane| {
        lane.junction.is_none()
            && lane.kind.is_drivable()
            && lane.length_m < ROOM_TO_WAIT_M
            // A light between the two is obeyed.
            && map.signal_stops(lane.key).next().is_none()
            && map
                .successors(lane.key)
                .iter()
                .all(|next| map.signal_stops(*next).next().is_none())
            && !map.successors(lane.key).is_empty()
            && !map.predecessors(lane.key).is_empty()
            && map
                .successors(lane.key)
                .iter()
                .chain(map.predecessors(lane.key))
                .all(|key| junction_of(key).is_some())
    };
    for lane in map.lanes().iter().filter(|lane| is_link(lane)) {
        let ends = map
            .successors(lane.key)
            .iter()
            .chain(map.predecessors(lane.key));
        let joined: Vec<u32> = ends
            .filter_map(junction_of)
            .map(|j| root(&parent, j))
            .collect();
        let Some(least) = joined.iter().min().copied() else {
            continue;
        };
        for junction in joined {
            parent.insert(junction, least);
        }
    }
    map.lanes()
        .iter()
        .map(|lane| {
            let junction = lane.junction.or_else(|| {
                is_link(lane).then(|| map.successors(lane.key).first().and_then(junction_of))?
            });
            junction.map_or(u32::MAX, |junction| root(&parent, junction))
        })
        .collect()
}

/// Whether following the ring of lanes inwards leads back to this lane, in one steady turn.
fn circulates(map: &RoadMap, lane: &Lane) -> bool {
    [1.0, -1.0].iter().any(|side| is_ring(map, lane, *side))
}

fn is_ring(map: &RoadMap, start: &Lane, side: f64) -> bool {
    let (mut lane, mut length, mut turned, mut straight) = (start, 0.0, 0.0, 0.0f64);
    for _ in 0..64 {
        let pieces = (lane.length_m / 4.0).ceil().max(1.0) as usize;
        let heading = |i: usize| {
            let at = LanePosition::new(lane.key, lane.length_m * i as f64 / pieces as f64);
            map.pose(at)
                .map_or(0.0, |pose| pose.rotation.euler_angles().2)
        };
        for i in 0..pieces {
            let (step, turn) = (
                lane.length_m / pieces as f64,
                wrap(heading(i + 1) - heading(i)),
            );
            turned += side * turn;
            straight = if side * turn < step / 100.0 {
                straight + step
            } else {
                0.0
            };
            if straight > STRAIGHT_IN_RING_M {
                return false;
            }
        }
        length += lane.length_m;
        let next = drivable(map, map.successors(lane.key));
        let turn_of = |idx: &u32| {
            let lane = &map.lanes()[*idx as usize];
            let heading = |s: f64| {
                map.pose(LanePosition::new(lane.key, s))
                    .map_or(0.0, |pose| pose.rotation.euler_angles().2)
            };
            side * wrap(heading(lane.length_m.min(15.0)) - heading(0.0))
        };
        let Some(inner) = next.iter().max_by(|a, b| turn_of(a).total_cmp(&turn_of(b))) else {
            return false;
        };
        lane = &map.lanes()[*inner as usize];
        if lane.key == start.key {
            return (turned - std::f64::consts::TAU).abs() < 0.6;
        }
        if length > LONGEST_RING_M {
            return false;
        }
    }
    false
}

/// Where the two come nearer to each other than `apart_m`.
fn meet(a: &Way, b: &Way, apart_m: f64) -> Option<Meet> {
    let (mut mine, mut theirs) = ([f64::INFINITY, 0.0f64], [f64::INFINITY, 0.0f64]);
    for p in &a.points {
        for q in &b.points {
            if (p.height_m - q.height_m).abs() < 3.0
                && distance(p.position_m, q.position_m) < apart_m
            {
                mine = [mine[0].min(p.arc_m), mine[1].max(p.arc_m)];
                theirs = [theirs[0].min(q.arc_m), theirs[1].max(q.arc_m)];
            }
        }
    }
    let merges = a.key == b.key || a.successors.iter().any(|next| b.successors.contains(next));
    mine[0].is_finite().then_some(Meet {
        mine_m: mine,
        theirs_m: theirs,
        merges,
    })
}
