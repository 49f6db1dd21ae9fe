//! Who uses which junction, in this tick.

use std::collections::BTreeMap;

use schema_frames::LightState;
use schema_roads::SignalKind;

use crate::crossing::{EXIT_FREE_M, User};
use crate::driver::{Driver, Entry, LAMP_LEFT, LAMP_RIGHT, TickView, View};
use crate::lanes::network::{LanePlace, Network, TURN_RAD, Way};
use crate::lanes::table::LaneTable;
use crate::traffic::{Mover, Traffic};

/// A vehicle beyond a junction that is slower than this may stop in the exit, m/s.
const SLOW_MPS: f64 = 2.5;
/// How far before a junction a vehicle driven by others counts, metres.
const STRANGER_M: f64 = 40.0;

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
        class: class(
            net,
            entry.has_light
                && is_lit(
                    legs.iter()
                        .map(|leg| &*leg.way)
                        .chain(before.map(|idx| &*driver.path().legs()[idx].way)),
                    view.lights,
                ),
            entry.sign.is_some(),
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

/// A vehicle that others drive has one use for every way that its lane leads, or for the one to
/// which it blinks.
fn of_stranger(
    net: &mut Network,
    place: LanePlace,
    me: &Mover,
    lights: &[LightState],
    users: &mut Vec<User>,
) {
    let lane = place.lane;
    let way = net.way(lane);
    let arc_m = way.arc_at(place.s_m);
    if way.zone.is_some() {
        let from = match way.predecessors[..] {
            [only] => Some(only),
            _ => None,
        };
        users.extend(stranger(net, lane, from, arc_m + me.front_m(), me, lights));
        return;
    }
    let left_m = way.length_m() - arc_m - me.front_m();
    if left_m > STRANGER_M {
        return;
    }
    let turns = |lane: u32, net: &mut Network| net.way(lane).turn_rad;
    let blinks = me.lamps & (LAMP_LEFT | LAMP_RIGHT);
    let fits = |lane: u32, net: &mut Network| match blinks {
        LAMP_LEFT => turns(lane, net) > TURN_RAD,
        LAMP_RIGHT => turns(lane, net) < -TURN_RAD,
        _ => true,
    };
    let mut next: Vec<u32> = way.successors.clone();
    let fitting: Vec<u32> = next
        .iter()
        .copied()
        .filter(|lane| fits(*lane, net))
        .collect();
    if !fitting.is_empty() {
        next = fitting;
    }
    for next in next {
        users.extend(stranger(net, next, Some(lane), -left_m, me, lights));
    }
}

fn stranger(
    net: &mut Network,
    lane: u32,
    from: Option<u32>,
    front_m: f64,
    me: &Mover,
    lights: &[LightState],
) -> Option<User> {
    let way = net.way(lane);
    let zone = way.zone?;
    let before = from.map(|lane| net.way(lane));
    let guards = || {
        way.guards
            .iter()
            .chain(before.iter().flat_map(|way| &way.guards))
    };
    let is_red = guards().any(|guard| {
        guard.kind == SignalKind::TrafficLight
            && matches!(
                lights[guard.signal as usize],
                LightState::Red | LightState::Yellow
            )
    });
    let has_sign = guards().any(|guard| guard.kind != SignalKind::TrafficLight);
    let lit = is_lit(std::iter::once(&*way).chain(before.as_deref()), lights);
    Some(User {
        id: me.id,
        number: me.number,
        zone,
        is_driven: false,
        lanes: vec![(lane, 0.0)],
        from,
        to: way.successors.first().copied(),
        front_m,
        body_m: 2.0 * me.half_m[0],
        waits_m: 0.0,
        half_m: swept_half_m(me, way.turn_rad),
        speed_mps: me.speed_mps,
        pace_mps: way.pace_mps.min(30.0),
        turn_rad: way.turn_rad,
        class: class(net, lit, has_sign, way.turn_rad, way.circulates, Some(&way)),
        held: is_red && front_m < 0.0,
        room_m: EXIT_FREE_M,
    })
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
