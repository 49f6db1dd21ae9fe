//! Who is at fault when a stranger and a vehicle of the fleet touch: decided by a table on what both
//! did in the last seconds, without looking into any driver. In doubt it is the fleet's.
//!
//! | What happened | At fault |
//! |---|---|
//! | the fleet's vehicle stood for 2 s, outside junctions | the stranger |
//! | one ran into the rear of the other, which was on its lane for 4 s | who ran into it |
//! | one ran into the rear of the other, which came to its lane within 4 s | who came |
//! | side by side or head on, one of them off its lane or on a new one, the other not | that one |
//! | in a junction, one of them came in on red, or past a stop or yield sign which the other had not | that one |
//! | all else | the fleet |

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use consumer_driver::plane::wrap;
use consumer_driver::{Mover, Traffic};
use schema_frames::LightState;
use schema_roads::{LaneKey, RoadMap, SignalKind};

/// How long what somebody did is kept, seconds.
const KEPT_SECS: f64 = 12.0;
/// Contacts of one pair within this time are one, seconds.
const ONE_CONTACT_SECS: f64 = 3.0;
/// Vehicles whose headings differ by less go the same way.
const SAME_WAY_RAD: f64 = 0.6;

/// What a vehicle did in one tick.
#[derive(Clone, Debug)]
struct Moment {
    time_secs: f64,
    at_m: [f64; 2],
    yaw_rad: f64,
    speed_mps: f64,
    lane: Option<LaneKey>,
    junction: Option<u32>,
    /// How far it is from the middle of its lane, as a share of half the lane's width.
    aside: f64,
    /// What stood before its lane's end or the junction's way: the light, or the sign.
    light: Option<LightState>,
    sign: bool,
}

/// Whose fault a contact is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    Fleet,
    Stranger,
}

/// The last seconds of all vehicles, and the contacts of strangers.
pub struct Faults {
    roads: Arc<RoadMap>,
    past: BTreeMap<u32, VecDeque<Moment>>,
    last: BTreeMap<[u32; 2], f64>,
    pub n_fleet: u32,
    pub n_stranger: u32,
}

impl Faults {
    pub fn new(roads: &Arc<RoadMap>) -> Faults {
        Faults {
            roads: roads.clone(),
            past: BTreeMap::new(),
            last: BTreeMap::new(),
            n_fleet: 0,
            n_stranger: 0,
        }
    }

    /// Notes what vehicles do.
    pub fn note(&mut self, traffic: &Traffic) {
        for mover in traffic.movers.iter().filter(|it| it.is_vehicle) {
            let moment = moment(&self.roads, traffic, mover);
            let past = self.past.entry(mover.id).or_default();
            past.push_back(moment);
            while past
                .front()
                .is_some_and(|it| it.time_secs < traffic.time_secs - KEPT_SECS)
            {
                past.pop_front();
            }
        }
    }

    /// Judges a contact; prints it with the five seconds before.
    pub fn judge(&mut self, stranger: &Mover, other: &Mover, now_secs: f64) {
        let pair = [stranger.id, other.id];
        let before = self.last.insert(pair, now_secs);
        if before.is_some_and(|at| now_secs < at + ONE_CONTACT_SECS) {
            return;
        }
        let (Some(theirs), Some(ours)) = (self.past.get(&stranger.id), self.past.get(&other.id))
        else {
            return;
        };
        let (fault, why) = decide(stranger, theirs, other, ours);
        match fault {
            Fault::Fleet => self.n_fleet += 1,
            Fault::Stranger => self.n_stranger += 1,
        }
        println!("contact at {now_secs:.2} s, fault of the {fault:?}: {why}");
        for (name, past) in [("stranger", theirs), ("fleet", ours)] {
            for back in [5.0, 3.0, 2.0, 1.0, 0.5, 0.0] {
                if let Some(it) = at(past, now_secs - back) {
                    println!(
                        "  {name} {:>4.1} s before: ({:.1}, {:.1}) {:.0}°, {:.1} m/s, lane {}, junction {:?}, aside {:.2}, light {:?}, sign {}",
                        back,
                        it.at_m[0],
                        it.at_m[1],
                        it.yaw_rad.to_degrees(),
                        it.speed_mps,
                        it.lane.map_or(String::new(), |lane| lane.to_string()),
                        it.junction,
                        it.aside,
                        it.light,
                        it.sign,
                    );
                }
            }
        }
    }
}

fn moment(roads: &RoadMap, traffic: &Traffic, mover: &Mover) -> Moment {
    let ahead = |lane: &schema_roads::Lane| lane.kind.is_drivable();
    let [x, y] = mover.middle();
    let place = [x, y, mover.position_m[2]];
    let heads = |key: LaneKey| {
        let on = roads.project(key, place)?;
        let yaw_rad = roads.pose(on)?.rotation.euler_angles().2;
        Some(wrap(yaw_rad - mover.yaw_rad).abs() < SAME_WAY_RAD)
    };
    let found = roads
        .nearest(place, |lane| ahead(lane) && heads(lane.key) == Some(true))
        .or_else(|| roads.nearest(place, ahead));
    let lane = found.and_then(|on| roads.lane(on.lane));
    let aside = found.map_or(0.0, |on| {
        on.offset_m.abs() / (0.5 * roads.width_m(on)).max(0.5)
    });
    let stops = lane.into_iter().flat_map(|lane| {
        let ways = roads.successors(lane.key).iter();
        let all = std::iter::once(&lane.key).chain(ways);
        all.flat_map(|key| roads.signal_stops(*key))
    });
    let (mut light, mut sign) = (None, false);
    for (signal, _) in stops {
        match signal.kind {
            SignalKind::TrafficLight => light = traffic.lights.get(&signal.id).copied().or(light),
            SignalKind::Stop | SignalKind::Yield => sign = true,
            _ => {}
        }
    }
    Moment {
        time_secs: traffic.time_secs,
        at_m: [x, y],
        yaw_rad: mover.yaw_rad,
        speed_mps: mover.speed_mps,
        lane: lane.map(|lane| lane.key),
        junction: lane.and_then(|lane| lane.junction),
        aside,
        light,
        sign,
    }
}

fn at(past: &VecDeque<Moment>, time_secs: f64) -> Option<&Moment> {
    past.iter()
        .rev()
        .find(|it| it.time_secs <= time_secs + 1e-6)
}

/// The table.
fn decide(
    stranger: &Mover,
    theirs: &VecDeque<Moment>,
    other: &Mover,
    ours: &VecDeque<Moment>,
) -> (Fault, &'static str) {
    let (Some(them), Some(us)) = (theirs.back(), ours.back()) else {
        return (Fault::Fleet, "nothing is known");
    };
    let now = us.time_secs;
    let recent = |past: &VecDeque<Moment>, secs: f64| -> Vec<Moment> {
        past.iter()
            .filter(|it| it.time_secs >= now - secs)
            .cloned()
            .collect()
    };
    if us.junction.is_none() && recent(ours, 2.0).iter().all(|it| it.speed_mps.abs() < 0.3) {
        return (Fault::Stranger, "the fleet's vehicle stood");
    }
    let [dx, dy] = [us.at_m[0] - them.at_m[0], us.at_m[1] - them.at_m[1]];
    let in_front = |mover: &Mover, sign: f64| {
        let (sin, cos) = mover.yaw_rad.sin_cos();
        let along = sign * (dx * cos + dy * sin);
        let aside = (dy * cos - dx * sin).abs();
        along > 0.5 * mover.half_m[0] && aside < 1.6 * mover.half_m[1]
    };
    let same_way = wrap(stranger.yaw_rad - other.yaw_rad).abs() < SAME_WAY_RAD;
    // A change of lanes: another lane side by side, not the next one of the way.
    let has_come = |past: &VecDeque<Moment>| {
        recent(past, 4.0)
            .windows(2)
            .any(|pair| match (pair[0].lane, pair[1].lane) {
                (Some(a), Some(b)) => {
                    a.road == b.road && a.section == b.section && a.lane != b.lane
                }
                _ => false,
            })
    };
    if same_way && in_front(stranger, 1.0) {
        return match has_come(ours) {
            true => (Fault::Fleet, "came before the stranger"),
            false => (Fault::Stranger, "ran into the rear of the fleet's vehicle"),
        };
    }
    if same_way && in_front(other, -1.0) {
        return match has_come(theirs) {
            true => (Fault::Stranger, "came before the fleet's vehicle"),
            false => (Fault::Fleet, "ran into the stranger's rear"),
        };
    }
    let is_off = |past: &VecDeque<Moment>| {
        has_come(past) || recent(past, 1.0).iter().any(|it| it.aside > 0.6)
    };
    if them.junction.is_none() && us.junction.is_none() {
        return match (is_off(theirs), is_off(ours)) {
            (true, false) => (Fault::Stranger, "left its lane"),
            _ => (Fault::Fleet, "side by side or head on"),
        };
    }
    // The last moment before the junction.
    let entry =
        |past: &VecDeque<Moment>| past.iter().rev().find(|it| it.junction.is_none()).cloned();
    let (Some(they_came), Some(we_came)) = (entry(theirs), entry(ours)) else {
        return (Fault::Fleet, "in a junction for long");
    };
    let is_red = |it: &Moment| it.light == Some(LightState::Red);
    if is_red(&they_came) && !is_red(&we_came) {
        return (Fault::Stranger, "came on red");
    }
    let has_sign = |it: &Moment| it.sign && it.light.is_none();
    if has_sign(&they_came) && !has_sign(&we_came) {
        return (Fault::Stranger, "came past a sign");
    }
    (Fault::Fleet, "in a junction")
}
