//! Who uses which junction, in this tick.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use schema_frames::LightState;
use schema_roads::SignalKind;

use crate::crossing::{EXIT_FREE_M, User};
use crate::driver::{Driver, Entry, LAMP_LEFT, LAMP_RIGHT, TickView, View};
use crate::lanes::network::{LanePlace, Network, TURN_RAD, Way};
use crate::lanes::table::LaneTable;
use crate::traffic::{Mover, Traffic};

/// A vehicle beyond a junction that is slower than this may stop in the exit, m/s.
const SLOW_MPS: f64 = 2.5;
/// A vehicle driven by others counts at a junction that it reaches within this time at its speed,
/// seconds, and always within this distance, metres.
const STRANGER_SECS: f64 = 12.0;
const STRANGER_M: f64 = 40.0;
/// Lanes ahead of it that are searched for junctions, and ways through one junction.
const STRANGER_LANES: usize = 24;
const STRANGER_WAYS: usize = 12;
/// Hardest braking that is expected of it before a red light, m/s²: if it takes more, it runs it.
const LIGHT_BRAKE_MPS2: f64 = 4.5;

/// All users, by zone.
pub(super) fn users(
    net: &mut Network,
    drivers: &BTreeMap<u32, Driver>,
    lanes: &LaneTable,
    tick: &TickView<'_>,
) -> Vec<User> {
    let traffic = tick.traffic;
    let mut users = Vec::with_capacity(2 * traffic.movers.len());
    for (idx, me) in traffic.movers.iter().enumerate() {
        if !me.is_vehicle {
            continue;
        }
        match drivers.get(&me.id) {
            Some(driver) => {
                let view = tick.of(me.id);
                for entry in driver.entries() {
                    let room_m = room_behind(driver, entry, lanes, traffic, idx as u32);
                    users.push(own(net, driver, entry, me, view, room_m));
                }
            }
            None => {
                if let Some(place) = tick.strangers.at(me.id) {
                    of_stranger(net, place, me, tick.lights, &mut users);
                }
            }
        }
    }
    users.sort_by_key(|user| (user.zone, user.id));
    users
}

fn own(
    net: &mut Network,
    driver: &Driver,
    entry: &Entry,
    me: &Mover,
    view: View,
    room_m: f64,
) -> User {
    let legs = &driver.path().legs()[entry.legs[0]..entry.legs[1]];
    let front = driver.foot().arc_m + me.front_m();
    let before = entry.legs[0].checked_sub(1);
    let behind = driver.path().legs().get(entry.legs[1]);
    let last = legs.last().map(|leg| leg.way.clone());
    let near = || {
        let before = before.map(|idx| &*driver.path().legs()[idx].way);
        legs.iter().map(|leg| &*leg.way).chain(before)
    };
    User {
        id: me.id,
        number: me.number,
        zone: entry.zone,
        is_driven: true,
        lanes: legs
            .iter()
            // A leg that begins within its lane began before the path did.
            .map(|leg| {
                (
                    leg.lane,
                    leg.arc_m[0] - entry.arc_m[0] - leg.way.arc_at(leg.s_m[0]),
                )
            })
            .collect(),
        from: before.map(|idx| driver.path().legs()[idx].lane),
        to: behind.map(|leg| leg.lane),
        front_m: front - entry.arc_m[0],
        body_m: 2.0 * me.half_m[0],
        waits_m: entry.arc_m[0] - entry.line_m,
        half_m: swept_half_m(me, entry.turn_rad),
        speed_mps: me.speed_mps,
        pace_mps: legs.iter().map(|leg| leg.way.pace_mps).fold(30.0, f64::min),
        turn_rad: entry.turn_rad,
        heading_rad: legs.first().map_or(0.0, |leg| heading_rad(&leg.way)),
        class: class(
            net,
            entry.has_light && is_lit(near(), view.lights),
            entry.sign.is_some() || entry.has_light && is_dark(near(), view.lights),
            entry.turn_rad,
            legs.iter().any(|leg| leg.way.circulates),
            last.as_deref(),
        ),
        held: driver.is_held(me, entry, view),
        room_m,
    }
}

/// Whether one of the lights that guard these lanes works.
fn is_lit<'w>(ways: impl Iterator<Item = &'w Way>, lights: &[LightState]) -> bool {
    let mut guards = ways.flat_map(|way| &way.guards);
    guards.any(|guard| {
        guard.kind == SignalKind::TrafficLight
            && matches!(
                lights[guard.signal as usize],
                LightState::Red | LightState::Yellow | LightState::Green
            )
    })
}

/// Whether lights guard these lanes and all of them are dark.
fn is_dark<'w>(ways: impl Iterator<Item = &'w Way>, lights: &[LightState]) -> bool {
    let mut states = ways
        .flat_map(|way| &way.guards)
        .filter(|guard| guard.kind == SignalKind::TrafficLight)
        .map(|guard| lights[guard.signal as usize])
        .peekable();
    states.peek().is_some() && states.all(|state| state == LightState::Off)
}

/// Rank by signs, lights and shape: 0 goes before 1 before 2.
fn class(
    net: &mut Network,
    is_lit: bool,
    has_sign: bool,
    turn_rad: f64,
    circulates: bool,
    last: Option<&Way>,
) -> u8 {
    if is_lit {
        return u8::from(turn_rad > TURN_RAD);
    }
    if has_sign {
        return 2;
    }
    if circulates {
        return 0;
    }
    // Whoever comes into a roundabout waits for those in it.
    let next: Vec<u32> = last.map_or(Vec::new(), |way| way.successors.clone());
    let joins_ring = next.into_iter().any(|lane| {
        let way = net.way(lane);
        way.circulates || way.successors.iter().any(|lane| net.way(*lane).circulates)
    });
    u8::from(joins_ring)
}

/// Room between the end of a junction and the first slow vehicle behind it, metres.
fn room_behind(
    driver: &Driver,
    entry: &Entry,
    lanes: &LaneTable,
    traffic: &Traffic,
    my_idx: u32,
) -> f64 {
    let exit_m = entry.arc_m[1];
    let mut room_m = EXIT_FREE_M;
    for leg in &driver.path().legs()[entry.legs[1]..] {
        if leg.arc_m[0] > exit_m + room_m {
            break;
        }
        for it in lanes.on(leg.lane) {
            let other = &traffic.movers[it.mover as usize];
            if it.mover == my_idx || other.speed_mps.abs() > SLOW_MPS {
                continue;
            }
            let rear_m = leg.arc_at_m(it.at.s_m) - other.half_m[0] - exit_m;
            if rear_m > -2.0 * other.half_m[0] {
                room_m = room_m.min(rear_m);
            }
        }
    }
    room_m
}

/// A vehicle that others drive has one use for every way that its lane leads through the junctions
/// that it reaches soon; at the first of them, only for those to which it blinks.
fn of_stranger(
    net: &mut Network,
    place: LanePlace,
    me: &Mover,
    lights: &[LightState],
    users: &mut Vec<User>,
) {
    let reach_m = STRANGER_M.max(STRANGER_SECS * me.speed_mps);
    let here = net.way(place.lane);
    let from = match here.predecessors[..] {
        [only] if here.zone.is_some() => Some(only),
        _ => None,
    };
    let mut open = VecDeque::from([Ahead {
        lane: place.lane,
        from,
        front_m: here.arc_at(place.s_m) + me.front_m(),
        is_first: true,
    }]);
    for _ in 0..STRANGER_LANES {
        let Some(at) = open.pop_front() else { return };
        if -at.front_m > reach_m {
            continue;
        }
        let way = net.way(at.lane);
        if way.zone.is_none() {
            let front_m = at.front_m - way.length_m();
            let next = next_lanes(net, &way, if at.is_first { me.lamps } else { 0 });
            open.extend(next.into_iter().map(|lane| Ahead {
                lane,
                from: Some(at.lane),
                front_m,
                ..at
            }));
            continue;
        }
        for lanes in ways_through(net, at.lane) {
            let user = stranger(net, &lanes, &at, me, lights);
            let Some(&(last, last_m)) = lanes.last() else {
                continue;
            };
            let last = net.way(last);
            if let (Some(to), Some((from, _))) = (user.to, lanes.last()) {
                open.push_back(Ahead {
                    lane: to,
                    from: Some(*from),
                    front_m: at.front_m - last_m - last.length_m(),
                    is_first: false,
                });
            }
            users.push(user);
        }
    }
}

/// A lane ahead of a stranger.
#[derive(Clone, Copy)]
struct Ahead {
    lane: u32,
    /// The lane before it.
    from: Option<u32>,
    /// How far the front is beyond its beginning, metres; negative before it.
    front_m: f64,
    /// Whether no junction lies before it.
    is_first: bool,
}

/// The lanes that follow; of several, those to which lamps blink if there are any.
fn next_lanes(net: &mut Network, way: &Way, lamps: u32) -> Vec<u32> {
    let fits = |lane: &u32| {
        let turn_rad = net.way(*lane).turn_rad;
        match lamps & (LAMP_LEFT | LAMP_RIGHT) {
            LAMP_LEFT => turn_rad > TURN_RAD,
            LAMP_RIGHT => turn_rad < -TURN_RAD,
            _ => true,
        }
    };
    let fitting: Vec<u32> = way.successors.iter().copied().filter(fits).collect();
    if fitting.is_empty() {
        way.successors.clone()
    } else {
        fitting
    }
}

/// The chains of lanes from one lane of a junction to its ends, with how far beyond the first lane's
/// beginning each begins, metres.
fn ways_through(net: &mut Network, lane: u32) -> Vec<Vec<(u32, f64)>> {
    let zone = net.way(lane).zone;
    let mut open = vec![vec![(lane, 0.0)]];
    let mut found = Vec::new();
    while let Some(chain) = open.pop() {
        let Some(&(last, last_m)) = chain.last() else {
            continue;
        };
        let way = net.way(last);
        let is_full = found.len() + open.len() + 1 >= STRANGER_WAYS || chain.len() > 6;
        let inside: Vec<u32> = way.successors.clone();
        let inside: Vec<u32> = inside
            .into_iter()
            .filter(|next| net.way(*next).zone == zone)
            .collect();
        if inside.is_empty() || is_full {
            found.push(chain);
            continue;
        }
        let next_m = last_m + way.length_m();
        open.extend(inside.into_iter().map(|next| {
            let mut longer = chain.clone();
            longer.push((next, next_m));
            longer
        }));
    }
    found
}

fn stranger(
    net: &mut Network,
    lanes: &[(u32, f64)],
    at: &Ahead,
    me: &Mover,
    lights: &[LightState],
) -> User {
    let way = net.way(at.lane);
    let ways: Vec<Arc<Way>> = lanes.iter().map(|(lane, _)| net.way(*lane)).collect();
    let last = ways.last().cloned();
    let before = at.from.map(|lane| net.way(lane));
    let near = || std::iter::once(&*way).chain(before.as_deref());
    let guards = || near().flat_map(|way| &way.guards);
    let is_red = guards().any(|guard| {
        guard.kind == SignalKind::TrafficLight
            && matches!(
                lights[guard.signal as usize],
                LightState::Red | LightState::Yellow
            )
    });
    let has_sign = guards().any(|guard| guard.kind != SignalKind::TrafficLight);
    let turn_rad = ways.iter().map(|way| way.turn_rad).sum();
    let circulates = ways.iter().any(|way| way.circulates);
    let can_stop = me.speed_mps * me.speed_mps < -2.0 * LIGHT_BRAKE_MPS2 * at.front_m;
    User {
        id: me.id,
        number: me.number,
        zone: way.zone.unwrap_or(u32::MAX),
        is_driven: false,
        lanes: lanes.to_vec(),
        from: at.from,
        to: last
            .as_ref()
            .and_then(|way| way.successors.first().copied()),
        front_m: at.front_m,
        body_m: 2.0 * me.half_m[0],
        waits_m: 0.0,
        half_m: swept_half_m(me, turn_rad),
        speed_mps: me.speed_mps,
        pace_mps: ways.iter().map(|way| way.pace_mps).fold(30.0, f64::min),
        turn_rad,
        heading_rad: heading_rad(&way),
        class: class(
            net,
            is_lit(near(), lights),
            has_sign || is_dark(near(), lights),
            turn_rad,
            circulates,
            last.as_deref(),
        ),
        held: is_red && can_stop,
        room_m: EXIT_FREE_M,
    }
}

/// Direction of travel where a lane begins, radians.
fn heading_rad(way: &Way) -> f64 {
    way.points.first().map_or(0.0, |point| point.heading_rad)
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
