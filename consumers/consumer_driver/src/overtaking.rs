//! Changes of lanes and ways round what stands: whether one is wanted, and whether there is room.
//!
//! Whether a change is wanted is MOBIL's question (Kesting, Treiber, Helbing 2007): what we gain in
//! acceleration against what the new follower loses, with the accelerations of the Intelligent
//! Driver Model. A change that the way ahead, the route or somebody else demands needs no gain, only
//! room.

use crate::driver::{Blocker, Driver};
use crate::lanes::network::{LanePlace, Network};
use crate::lanes::table::{LaneTable, Neighbour, Search};
use crate::parameters::Rules;
use crate::plane::Side;
use crate::speed;
use crate::traffic::{Grid, Mover, Traffic};
use schema_types::noise::Noise;

/// Time between two thoughts about another lane, seconds.
const THINK_SECS: f64 = 0.5;
/// Time between a change and the next one without need, seconds.
const SETTLE_SECS: f64 = 12.0;
/// Gain that a change without need must bring, m/s².
const GAIN_MPS2: f64 = 0.5;
/// How much the new follower's loss counts.
const POLITENESS: f64 = 0.4;
/// Hardest braking that a change may ask of the new follower, m/s².
const SAFE_BRAKE_MPS2: f64 = 2.0;
/// Time that a change takes, seconds, and its least and greatest length, metres.
const CHANGE_SECS: f64 = 3.2;
const CHANGE_M: [f64; 2] = [14.0, 70.0];
/// How far we look along another lane, metres.
const SIGHT_M: f64 = 90.0;
/// How near the end of a lane a change becomes urgent, metres.
const URGENT_M: f64 = 150.0;
/// A vehicle ahead that stands for so long without a queue before it is passed, seconds.
const PASS_SECS: f64 = 7.0;
/// Room to begin a way round, metres.
const PASS_ROOM_M: f64 = 7.5;
/// Stream of the chances of lane changes.
const CHANCES: u64 = 0x6c61_6e65;

/// What is known around a driver.
pub(crate) struct Around<'a> {
    pub traffic: &'a Traffic,
    pub grid: &'a Grid,
    pub lanes: &'a LaneTable,
    pub rules: Rules<'a>,
    pub seed: u64,
}

/// A change of lanes that is thought about.
struct LaneChange {
    from: LanePlace,
    to_lane: u32,
    /// Length of the way on which it is made, metres.
    length_m: f64,
}

/// A change that has begun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Change {
    pub side: Side,
    /// Whether somebody else had demanded it.
    pub was_forced: bool,
}

/// Begins a change of lanes if one is due.
pub(crate) fn consider(
    net: &mut Network,
    driver: &mut Driver,
    me: &Mover,
    my_idx: u32,
    around: &Around,
) -> Option<Change> {
    let Around { traffic, rules, .. } = around;
    let foot = driver.foot();
    if driver.path().shift().is_some()
        || driver.is_reversing()
        || foot.arc_m < driver.swerve_until_m
    {
        return None;
    }
    let forced = rules.own.forced_lane_change;
    let phase = f64::from(me.id % 10) * 0.1 * THINK_SECS;
    let beat = |t: f64| ((t + phase) / THINK_SECS) as u64;
    let is_beat = beat(traffic.time_secs) != beat(traffic.time_secs - traffic.period_secs);
    if !is_beat {
        return None;
    }
    let idx = driver.path().leg_at(foot.arc_m);
    let leg = driver.path().legs()[idx].clone();
    if leg.zone().is_some() || leg.way.left.is_none() && leg.way.right.is_none() {
        return None;
    }
    let front = foot.arc_m + me.front_m();
    let to_junction = driver
        .path()
        .legs()
        .iter()
        .find(|leg| leg.zone().is_some() && leg.arc_m[1] > front)
        .map_or(f64::INFINITY, |leg| leg.arc_m[0] - front);
    let length_m = (CHANGE_SECS * me.speed_mps).clamp(CHANGE_M[0], CHANGE_M[1]);
    let end = driver.path().end();
    let to_end = if end.is_dead_end {
        end.arc_m - front
    } else {
        f64::INFINITY
    };
    let wanted_by_route = driver.lane_wanted();
    let demanded = forced.or(wanted_by_route);
    // A lane that leads to an end of the road only is left while there is one that goes on.
    let is_dying = !net.goes_on(leg.lane);
    let goes_on = |lane: Option<u32>, net: &Network| lane.is_some_and(|lane| net.goes_on(lane));
    let must_leave = is_dying && (goes_on(leg.way.left, net) || goes_on(leg.way.right, net));
    let is_urgent = demanded.is_some() || to_end < URGENT_M || must_leave;
    let room_m = if is_urgent { 2.0 } else { 20.0 };
    if length_m + room_m > to_junction.min(to_end) {
        return None;
    }
    if demanded.is_none() && !rules.own.changes_lanes && to_end > URGENT_M && !must_leave {
        return None;
    }
    if !is_urgent
        && (traffic.time_secs < driver.settled_until_secs
            || me.speed_mps < 1.0 && driver.standing_secs < 3.0)
    {
        return None;
    }
    let chance =
        Noise::new(around.seed, u64::from(me.number), CHANCES).uniform(beat(traffic.time_secs));
    let s_m = leg.s_at_m(foot.arc_m);
    let mut best: Option<(f64, Side)> = None;
    for side in [Side::Right, Side::Left] {
        let target = match side {
            Side::Left => leg.way.left,
            Side::Right => leg.way.right,
        };
        let Some(target) = target else { continue };
        if demanded.is_some_and(|wanted| wanted != side) {
            continue;
        }
        let at = schema_roads::LanePosition::new(leg.way.key, s_m);
        let is_marked = match side {
            Side::Left => net.map().may_change_left(at),
            Side::Right => net.map().may_change_right(at),
        };
        if !is_marked && forced.is_none() {
            continue;
        }
        let is_needed = demanded == Some(side);
        if !is_needed && !net.goes_on(target) && (must_leave || !is_dying) {
            continue;
        }
        let random = match side {
            Side::Left => rules.own.random_left_percent,
            Side::Right => rules
                .own
                .random_right_percent
                .max(rules.own.keep_right_percent),
        };
        let is_by_chance = 100.0 * chance < random;
        let needs_gain = !is_urgent && !is_by_chance;
        let ignores_others = forced.is_some() && rules.own.ignore_vehicles_percent >= 100.0;
        let change = LaneChange {
            from: LanePlace {
                lane: leg.lane,
                s_m,
            },
            to_lane: target,
            length_m,
        };
        let gain = gain(net, driver, me, my_idx, around, &change);
        let Some(gain) = gain.or(ignores_others.then_some(0.0)) else {
            continue;
        };
        if needs_gain && gain < GAIN_MPS2 {
            continue;
        }
        if best.is_none_or(|(most, _)| gain > most) {
            best = Some((gain, side));
        }
    }
    let (_, side) = best?;
    if !driver
        .path_mut()
        .change_lane(net, foot.arc_m, length_m, side)
    {
        return None;
    }
    driver.settled_until_secs = traffic.time_secs + SETTLE_SECS;
    Some(Change {
        side,
        was_forced: forced.is_some(),
    })
}

/// What a change brings, m/s²; `None` if there is no room for it.
fn gain(
    net: &mut Network,
    driver: &Driver,
    me: &Mover,
    my_idx: u32,
    around: &Around,
    change: &LaneChange,
) -> Option<f64> {
    let (s_m, target) = (change.from.s_m, change.to_lane);
    let from = |lane: u32| Search {
        from: LanePlace { lane, s_m },
        within_m: SIGHT_M,
        me: my_idx,
    };
    let movers = &around.traffic.movers;
    let table = around.lanes;
    let v = me.speed_mps;
    let standing_gap = around.rules.standing_gap_m();
    let free = driver.road_mps2;
    let gap_to = |distance: f64, other: &Mover| distance - me.half_m[0] - other.half_m[0];
    let leader_accel = |found: Option<Neighbour>| {
        found.map_or((free, f64::INFINITY), |found| {
            let other = &movers[found.mover as usize];
            let gap = gap_to(found.distance_m, other);
            (
                free.min(speed::follow(v, other.speed_mps, gap, standing_gap)),
                gap,
            )
        })
    };
    let (now, _) = leader_accel(table.ahead(net, &from(change.from.lane)));
    // A vehicle whose middle is beside ours counts as ahead of us and behind us.
    let beside = [s_m - me.half_m[0] - 4.0, s_m + me.half_m[0] + 4.0];
    let is_beside = table.on(target).iter().any(|it| {
        let other = &movers[it.mover as usize];
        it.mover != my_idx
            && (beside[0] - other.half_m[0]..beside[1] + other.half_m[0]).contains(&it.at.s_m)
            && (it.at.s_m - s_m).abs() < me.half_m[0] + other.half_m[0] + 1.0
    });
    if is_beside {
        return None;
    }
    let (then, gap_ahead) = leader_accel(table.ahead(net, &from(target)));
    if then < -SAFE_BRAKE_MPS2 || gap_ahead < 2.0 + 0.3 * v {
        return None;
    }
    let behind = table.behind(net, &from(target));
    let loss = match behind {
        Some(found) => {
            let other = &movers[found.mover as usize];
            let gap = gap_to(found.distance_m, other);
            let after = speed::follow(other.speed_mps, v, gap, standing_gap);
            if gap < 2.0 + 0.4 * other.speed_mps || after < -SAFE_BRAKE_MPS2 {
                return None;
            }
            (0.5 - after).max(0.0)
        }
        None => 0.0,
    };
    // Somebody who comes into the same lane from its other side.
    let middle = me.point(0.5 * change.length_m, 0.0);
    let reach = 0.5 * change.length_m + 10.0;
    let low = [middle[0] - reach, middle[1] - reach];
    let high = [middle[0] + reach, middle[1] + reach];
    let far_side = around.grid.within(low, high).any(|idx| {
        let other = &movers[idx as usize];
        let blinks = other.lamps & (crate::driver::LAMP_LEFT | crate::driver::LAMP_RIGHT) != 0;
        let [dx, dy] = [
            other.position_m[0] - me.position_m[0],
            other.position_m[1] - me.position_m[1],
        ];
        let (sin, cos) = me.yaw_rad.sin_cos();
        let (ahead, left) = (dx * cos + dy * sin, dy * cos - dx * sin);
        idx != my_idx && blinks && ahead.abs() < 12.0 && (4.0..9.0).contains(&left.abs())
    });
    if far_side {
        return None;
    }
    Some(then - now - POLITENESS * loss)
}

/// Goes round a vehicle that stands on the lane for no reason, through the lane of oncoming
/// traffic if nobody comes.
pub(crate) fn pass_standing(
    driver: &mut Driver,
    me: &Mover,
    around: &Around,
    is_queueing: impl Fn(u32) -> bool,
) -> bool {
    let foot = driver.foot();
    let Some(Blocker { id: blocker, secs }) = driver.blocked_by() else {
        return false;
    };
    if !around.rules.own.changes_lanes
        || secs < PASS_SECS
        || foot.arc_m < driver.swerve_until_m
        || driver.path().shift().is_some()
    {
        return false;
    }
    let Some(other) = around.traffic.mover(blocker) else {
        return false;
    };
    let is_along = crate::plane::wrap(other.yaw_rad - foot.heading_rad).abs() < 0.5;
    if !other.is_vehicle || !is_along || other.speed_mps.abs() > 0.2 || is_queueing(blocker) {
        return false;
    }
    let front = foot.arc_m + me.front_m();
    let (their, _) = driver
        .path()
        .descend(other.middle(), driver.path().point_idx(front));
    let offset_m = their.offset_m + other.half_m[1] + me.half_m[1] + 0.7;
    let gap_m = their.arc_m - other.half_m[0] - front;
    if gap_m < PASS_ROOM_M {
        return false;
    }
    let between = [
        their.arc_m - other.half_m[0] - me.front_m() - 0.5,
        their.arc_m + other.half_m[0] + me.rear_m() + 1.5,
    ];
    // It begins where we are.
    let length_m = (between[0] - foot.arc_m).clamp(1.0, 14.0);
    let until = between[1] + length_m;
    // Not into a junction, and not without room to begin.
    let near_junction = driver
        .entries()
        .iter()
        .any(|entry| entry.arc_m[0] < until + 3.0);
    if near_junction || offset_m > 4.5 || driver.path().end().arc_m < until + 20.0 {
        return false;
    }
    // Nobody may be on the way round, nor come along it, for as long as it takes.
    let sight_m = 70.0;
    let middle = driver.path().at(0.5 * (front + until)).position_m;
    let reach = 0.5 * (until - front) + sight_m;
    let low = [middle[0] - reach, middle[1] - reach];
    let high = [middle[0] + reach, middle[1] + reach];
    let is_taken = around.grid.within(low, high).any(|idx| {
        let mover = &around.traffic.movers[idx as usize];
        if mover.id == me.id || mover.id == blocker {
            return false;
        }
        let start = driver.path().point_idx(their.arc_m);
        let (at, _) = driver.path().descend(mover.middle(), start);
        let aside = mover.half_m[1] + 0.6;
        let in_strip = at.offset_m + aside > offset_m - me.half_m[1] - 1.0
            && at.offset_m - aside < offset_m + me.half_m[1] + 0.5;
        let comes = mover.velocity_mps[0] * at.heading_rad.cos()
            + mover.velocity_mps[1] * at.heading_rad.sin()
            < -0.5;
        let overlaps = at.arc_m > foot.arc_m - 12.0 && at.arc_m < until + 4.0;
        let far = if comes { until + sight_m } else { until + 4.0 };
        let behind_blocker_in_lane =
            at.arc_m > their.arc_m && at.arc_m < until + 6.0 && at.offset_m.abs() < 1.5;
        in_strip && (overlaps || comes && at.arc_m > foot.arc_m && at.arc_m < far)
            || behind_blocker_in_lane
    });
    if is_taken {
        return false;
    }
    driver.path_mut().swerve(between, offset_m, length_m);
    driver.swerve_until_m = until;
    true
}
