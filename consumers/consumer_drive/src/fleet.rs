//! All drivers of one process, and the right of way at junctions.

use std::collections::BTreeMap;
use std::sync::Arc;

use schema_frames::{Command, LightState, VehicleControlRecord};
use schema_roads::{LaneKey, RoadMap, SignalKind};

use crate::driver::{Driver, STANDING_MPS, Wait, locate};
use crate::parameters::{Action, RoadOption, Settings};
use crate::path::{distance, wrap};
use crate::steer::Geometry;
use crate::traffic::{Mover, Traffic};

/// A vehicle inside a junction that a waiting one has blocked for this long is given room, seconds.
const YIELD_AFTER_SECS: f64 = 5.0;
/// Largest number of vehicles in a queue that back off for it.
const MAX_QUEUE: usize = 6;
/// Smallest room between two vehicles whose ways do not conflict, metres.
const CLEARANCE_M: f64 = 0.4;
/// A vehicle beyond a junction that is slower than this may stop in the exit, m/s.
const SLOW_MPS: f64 = 2.5;
/// A vehicle nearer to a junction than this has arrived there, metres.
const ARRIVAL_M: f64 = 12.0;
/// A vehicle that does not go when it is its turn loses the turn after this long, seconds.
const PATIENCE_SECS: f64 = 6.0;

/// What a vehicle may use of a junction. A vehicle that this fleet does not drive has one claim for
/// every way that its lane leads.
#[derive(Clone, Debug)]
struct Claim {
    id: u32,
    junction: u32,
    inside: bool,
    /// Distance to the junction's entry, metres; negative inside.
    distance_m: f64,
    speed_mps: f64,
    /// Half the width it sweeps, metres.
    half_m: f64,
    /// Points it may still pass, a metre apart.
    way: Vec<[f64; 2]>,
    turn_rad: f64,
    /// Lane it enters by.
    from: Option<LaneKey>,
    /// Whether a red light or a full exit holds it.
    held: bool,
}

/// When a vehicle arrived at a junction, and how long it has stood there.
#[derive(Clone, Copy, Debug)]
struct Arrival {
    junction: u32,
    at_secs: f64,
    waiting_secs: f64,
}

/// What a fleet does in a tick.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Step {
    /// One record per driven vehicle that is there, by rising id.
    pub controls: Vec<VehicleControlRecord>,
    /// What is asked of the simulator besides: vehicles that are moved without physics, removed, or
    /// brought back.
    pub commands: Vec<Command>,
}

/// All drivers of one process.
#[derive(Clone, Debug)]
pub struct Fleet {
    map: Arc<RoadMap>,
    seed: u64,
    drivers: BTreeMap<u32, Driver>,
    arrivals: BTreeMap<u32, Arrival>,
}

impl Fleet {
    /// A fleet without drivers.
    pub fn new(map: Arc<RoadMap>) -> Fleet {
        Fleet {
            map,
            seed: 0,
            drivers: BTreeMap::new(),
            arrivals: BTreeMap::new(),
        }
    }

    /// The drivers by vehicle.
    pub fn drivers(&self) -> &BTreeMap<u32, Driver> {
        &self.drivers
    }

    /// Number of vehicles that are driven.
    pub fn len(&self) -> usize {
        self.drivers.len()
    }

    /// Whether nobody is driven.
    pub fn is_empty(&self) -> bool {
        self.drivers.is_empty()
    }

    /// Drives exactly these vehicles from now on. `geometry` returns the geometry of those for
    /// which it is known.
    pub fn assign(
        &mut self,
        ids: &[u32],
        traffic: &Traffic,
        geometry: impl Fn(u32) -> Option<Geometry>,
    ) {
        self.drivers.retain(|id, _| ids.contains(id));
        for id in ids {
            if self.drivers.contains_key(id) {
                continue;
            }
            let Some(me) = traffic.mover(*id) else {
                continue;
            };
            if let Some(mut driver) = Driver::new(&self.map, me, self.seed, 1.0) {
                if let Some(geometry) = geometry(*id) {
                    driver.set_geometry(geometry);
                }
                self.drivers.insert(*id, driver);
            }
        }
    }

    /// The decisions ahead of a vehicle, the next first; none for one that is not driven.
    pub fn actions(&self, id: u32) -> Vec<Action> {
        let entry = self.drivers.get(&id).and_then(|d| Some((d, d.entry()?)));
        let action = entry.map(|(driver, entry)| {
            let point = driver.path().at(entry.arc_m[0]);
            Action {
                option: match entry.turn_rad {
                    turn if turn > 0.45 => RoadOption::Left,
                    turn if turn < -0.45 => RoadOption::Right,
                    _ => RoadOption::Straight,
                },
                position_m: [point.position_m[0], point.position_m[1], 0.0],
                heading_rad: point.heading_rad,
            }
        });
        action.into_iter().collect()
    }

    /// What to do in this tick.
    pub fn step(&mut self, traffic: &Traffic, settings: &mut Settings) -> Step {
        self.seed = settings.seed;
        for (id, driver) in &mut self.drivers {
            if let Some(me) = traffic.mover(*id) {
                driver.localise(&self.map, me, self.seed);
            }
        }
        let claims: Vec<Claim> = traffic
            .movers
            .iter()
            .filter(|m| m.is_vehicle)
            .flat_map(|m| self.claims(m, traffic))
            .collect();
        self.note_arrivals(&claims, traffic);
        let turns: Vec<(u32, bool)> = self
            .drivers
            .keys()
            .map(|id| (*id, self.may_enter(*id, traffic, &claims)))
            .collect();
        self.make_room(traffic);
        let mut records = Vec::with_capacity(self.drivers.len());
        for (id, may_enter) in turns {
            let (Some(driver), Some(me)) = (self.drivers.get_mut(&id), traffic.mover(id)) else {
                continue;
            };
            driver.may_enter = may_enter;
            records.push(driver.control(&self.map, me, traffic));
        }
        Step {
            controls: records,
            commands: Vec::new(),
        }
    }

    /// Makes a vehicle that waits before a junction and blocks another one inside it back off,
    /// together with the queue behind it.
    fn make_room(&mut self, traffic: &Traffic) {
        let stuck = self
            .drivers
            .values()
            .filter(|d| d.is_inside(traffic))
            .filter_map(Driver::blocked_by);
        let blockers = stuck
            .filter(|(id, secs)| *secs > YIELD_AFTER_SECS && self.waits_at_junction(*id))
            .map(|(id, _)| id);
        for first in blockers.collect::<Vec<u32>>() {
            let mut next = Some(first);
            for _ in 0..MAX_QUEUE {
                let Some(id) = next else { break };
                let (Some(driver), Some(me)) = (self.drivers.get_mut(&id), traffic.mover(id))
                else {
                    break;
                };
                if driver.is_inside(traffic)
                    || driver.is_reversing()
                    || me.speed_mps.abs() > STANDING_MPS
                {
                    break;
                }
                next = traffic.behind(me, 2.0);
                driver.make_room();
            }
        }
    }

    fn waits_at_junction(&self, id: u32) -> bool {
        self.drivers
            .get(&id)
            .is_some_and(|driver| matches!(driver.wait(), Wait::Turn | Wait::Light))
    }

    /// What a vehicle may still use of junctions near it.
    fn claims(&self, mover: &Mover, traffic: &Traffic) -> Vec<Claim> {
        match self.drivers.get(&mover.id) {
            Some(driver) => self.own_claim(driver, mover, traffic).into_iter().collect(),
            None => self.foreign_claims(mover, traffic),
        }
    }

    fn own_claim(&self, driver: &Driver, mover: &Mover, traffic: &Traffic) -> Option<Claim> {
        let entry = driver.entry()?;
        let foot = driver.foot();
        let front = foot.arc_m + mover.front_m();
        let distance_m = entry.arc_m[0] - front;
        if distance_m > 40.0 {
            return None;
        }
        let legs = driver.path().legs();
        let first = legs
            .iter()
            .position(|leg| (leg.arc_m[0] - entry.arc_m[0]).abs() < 1e-6)?;
        let start = entry.arc_m[0].max(foot.arc_m - mover.rear_m());
        let end = entry.arc_m[1] + 2.0;
        let n = (end - start).max(0.0).ceil() as usize;
        Some(Claim {
            id: mover.id,
            junction: entry.junction,
            inside: distance_m < -1.0,
            distance_m,
            speed_mps: mover.speed_mps,
            half_m: swept_half_m(mover, entry.turn_rad),
            way: (0..=n)
                .map(|i| driver.path().at(start + i as f64).position_m)
                .collect(),
            turn_rad: entry.turn_rad,
            from: first.checked_sub(1).map(|idx| legs[idx].lane),
            // A vehicle whose exit is full does not go, so nobody needs to wait for it.
            held: self.is_held(
                legs[first].lane,
                first.checked_sub(1).map(|idx| legs[idx].lane),
                traffic,
            ) || !self.room_behind_junction(driver, mover, traffic, entry.arc_m[1]),
        })
    }

    /// Whether a light says stop to a vehicle that goes from lane `before` into `lane`.
    fn is_held(&self, lane: LaneKey, before: Option<LaneKey>, traffic: &Traffic) -> bool {
        let red = |lane: LaneKey| {
            self.map.signal_stops(lane).any(|(signal, _)| {
                let state = traffic
                    .lights
                    .get(&signal.id)
                    .copied()
                    .unwrap_or(LightState::Off);
                signal.kind == SignalKind::TrafficLight
                    && matches!(state, LightState::Red | LightState::Yellow)
            })
        };
        red(lane) || before.is_some_and(red)
    }

    fn foreign_claims(&self, mover: &Mover, traffic: &Traffic) -> Vec<Claim> {
        let Some(at) = locate(&self.map, mover) else {
            return Vec::new();
        };
        let Some(lane) = self.map.lane(at.lane) else {
            return Vec::new();
        };
        let left_m = lane.length_m - at.s_m;
        let claim = |lane: LaneKey, from: Option<LaneKey>, from_s: f64, distance_m: f64| {
            let l = self.map.lane(lane)?;
            let way = self.map.centreline(lane, 1.0);
            let skip = (from_s.max(0.0) as usize).min(way.len().saturating_sub(1));
            let heading = |s: f64| {
                Some(
                    self.map
                        .pose(schema_roads::LanePosition::new(lane, s))?
                        .rotation
                        .euler_angles()
                        .2,
                )
            };
            let turn_rad = wrap(heading(l.length_m)? - heading(0.0)?);
            Some(Claim {
                id: mover.id,
                junction: l.junction?,
                half_m: swept_half_m(mover, turn_rad),
                inside: distance_m < -1.0,
                distance_m,
                speed_mps: mover.speed_mps,
                way: way[skip..].iter().map(|p| [p[0], p[1]]).collect(),
                turn_rad,
                from,
                held: distance_m > -1.0 && self.is_held(lane, from, traffic),
            })
        };
        if lane.junction.is_some() {
            return claim(
                at.lane,
                None,
                at.s_m - mover.rear_m(),
                -at.s_m - mover.front_m(),
            )
            .into_iter()
            .collect();
        }
        if left_m > 40.0 {
            return Vec::new();
        }
        let next = self.map.successors(at.lane);
        next.iter()
            .filter_map(|key| claim(*key, Some(at.lane), 0.0, left_m - mover.front_m()))
            .collect()
    }

    fn note_arrivals(&mut self, claims: &[Claim], traffic: &Traffic) {
        self.arrivals.retain(|id, arrival| {
            claims
                .iter()
                .any(|c| c.id == *id && c.junction == arrival.junction)
        });
        for claim in claims.iter().filter(|c| c.distance_m < ARRIVAL_M) {
            let fresh = Arrival {
                junction: claim.junction,
                at_secs: traffic.time_secs,
                waiting_secs: 0.0,
            };
            let arrival = self.arrivals.entry(claim.id).or_insert(fresh);
            arrival.waiting_secs =
                if claim.speed_mps.abs() < STANDING_MPS && !claim.held && !claim.inside {
                    arrival.waiting_secs + traffic.period_secs
                } else {
                    0.0
                };
            if claim.held {
                arrival.at_secs = traffic.time_secs;
            }
        }
    }

    /// Whether a driver may enter the junction ahead of it now.
    fn may_enter(&self, id: u32, traffic: &Traffic, claims: &[Claim]) -> bool {
        let (Some(driver), Some(me)) = (self.drivers.get(&id), traffic.mover(id)) else {
            return true;
        };
        let Some(mine) = claims.iter().find(|c| c.id == id) else {
            return true;
        };
        let Some(entry) = driver.entry() else {
            return true;
        };
        // A vehicle that is inside, or too fast to stop before the junction, clears it.
        if mine.inside || mine.distance_m < 0.3 && me.speed_mps > 1.0 {
            return true;
        }
        if mine.distance_m - 1.0 < me.speed_mps * me.speed_mps / 10.0 && me.speed_mps > 2.0 {
            return true;
        }
        if !self.room_behind_junction(driver, me, traffic, entry.arc_m[1]) {
            return false;
        }
        let my_wait = self.arrivals.get(&id).map_or(0.0, |a| a.waiting_secs);
        let lost_patience = my_wait > PATIENCE_SECS + f64::from(id % 5) * 1.5;
        claims
            .iter()
            .filter(|c| c.id != id && c.junction == mine.junction)
            .all(|other| {
                if other.from.is_some() && other.from == mine.from || !conflict(mine, other) {
                    return true;
                }
                if other.inside {
                    // A vehicle that stands inside may be waiting for us. If it is really in the
                    // way, it is found as an obstacle.
                    return lost_patience && other.speed_mps.abs() < STANDING_MPS;
                }
                other.held || lost_patience || self.goes_first(mine, other, entry.has_light)
            })
    }

    /// Whether `mine` goes before `other`, which approaches the same junction.
    fn goes_first(&self, mine: &Claim, other: &Claim, has_light: bool) -> bool {
        if has_light {
            // Both have green: the one that turns left gives way.
            let (my_left, their_left) = (mine.turn_rad > 0.5, other.turn_rad > 0.5);
            let arrives_secs = other.distance_m.max(0.0) / other.speed_mps.max(2.5);
            if my_left != their_left {
                return !my_left || arrives_secs > 4.0;
            }
        }
        if other.distance_m > ARRIVAL_M {
            // Far away: only a fast vehicle would be in the way.
            return other.distance_m / other.speed_mps.max(0.1) > 4.0 || mine.distance_m < 3.0;
        }
        let order = |c: &Claim| {
            self.arrivals
                .get(&c.id)
                .map_or(f64::INFINITY, |a| a.at_secs)
        };
        (order(mine), mine.id) < (order(other), other.id)
    }

    /// Whether the exit has room for the whole vehicle between slow traffic.
    fn room_behind_junction(
        &self,
        driver: &Driver,
        me: &Mover,
        traffic: &Traffic,
        exit_m: f64,
    ) -> bool {
        let needed = 2.0 * me.half_m[0] + 3.0;
        !traffic.movers.iter().any(|other| {
            other.id != me.id
                && other.is_vehicle
                && other.speed_mps.abs() < SLOW_MPS
                && distance(
                    other.middle(),
                    driver.path().at(exit_m + 0.5 * needed).position_m,
                ) < needed + other.half_m[0]
                && other.outline().into_iter().any(|p| {
                    driver
                        .path()
                        .first_within(p, exit_m - 1.0, exit_m + needed, |_, _| me.half_m[1])
                        .is_some()
                })
        })
    }
}

/// Half the width that a vehicle sweeps on a way that turns by `turn_rad`; its corners swing out as
/// on a bend with a radius of about ten metres.
fn swept_half_m(mover: &Mover, turn_rad: f64) -> f64 {
    let swing = if turn_rad.abs() > 0.3 {
        mover.half_m[0] * mover.half_m[0] / 14.0
    } else {
        0.0
    };
    mover.half_m[1] + swing
}

/// Whether two ways come too near to each other.
fn conflict(a: &Claim, b: &Claim) -> bool {
    let apart = a.half_m + b.half_m + CLEARANCE_M;
    a.way
        .iter()
        .any(|p| b.way.iter().any(|q| distance(*p, *q) < apart))
}
