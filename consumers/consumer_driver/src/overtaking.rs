//! Changes of lanes and ways round what stands: whether one is wanted, and whether there is room.
//!
//! Whether a change is worth it and safe is decided by [`crate::mobil`]. One that the way ahead, the
//! route or somebody else demands needs no gain, but room and a follower that need not brake hard.

use crate::detour::{BEGUN_MARGIN_SECS, Detour, Scene};
use crate::driver::{Blocker, Driver};
use crate::idm::{Idm, Leader};
use crate::lanes::network::{LanePlace, Network};
use crate::lanes::path::Foot;
use crate::lanes::table::{LaneTable, Neighbour, Search};
use crate::mobil::{Outlook, Prospect, SAFE_BRAKE_MPS2};
use crate::parameters::Rules;
use crate::plane::{Side, wrap};
use crate::speed;
use crate::traffic::{Grid, Mover, Traffic};
use schema_types::noise::Noise;

/// Time between two thoughts about another lane, seconds.
const THINK_SECS: f64 = 0.5;
/// Time between a change and the next one without need, seconds.
const SETTLE_SECS: f64 = 12.0;
/// Time that a change takes, seconds, and its least and greatest length, metres.
const CHANGE_SECS: f64 = 3.2;
const CHANGE_M: [f64; 2] = [14.0, 70.0];
/// How far we look along a lane, ahead and behind, metres. At 130 km/h, somebody behind us who drives
/// 50 km/h faster than we do wants a gap of 153 m.
const SIGHT_M: f64 = 90.0;
const SIGHT_BEHIND_M: f64 = 250.0;
/// Gap in standstill that followers are taken to keep, metres.
const FOLLOWER_GAP_M: f64 = 2.0;
/// How near the end of a lane a change becomes urgent, metres.
const URGENT_M: f64 = 150.0;
/// A vehicle ahead that stands for so long without a queue before it is passed, seconds.
const PASS_SECS: f64 = 7.0;
/// Room to begin a way round, metres.
const PASS_ROOM_M: f64 = 7.5;
/// Greatest curvature of a way round in units of its offset over its length squared.
const SWERVE_BEND: f64 = 5.8;
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

impl<'a> Around<'a> {
    fn scene(&self, foot: Foot, me: &'a Mover) -> Scene<'a> {
        Scene {
            me,
            foot,
            traffic: self.traffic,
            grid: self.grid,
        }
    }
}

/// A change of lanes that is thought about.
struct LaneChange {
    from: LanePlace,
    to_lane: u32,
    side: Side,
    keeps_right: bool,
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
    let keeps_right = 100.0 * chance < rules.own.keep_right_percent;
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
            Side::Right => rules.own.random_right_percent,
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
            side,
            keeps_right,
            length_m,
        };
        let prospect = prospect(net, driver, me, my_idx, around, &change);
        let gain = prospect.map(|prospect| prospect.incentive_mps2());
        let Some(gain) = gain.or(ignores_others.then_some(0.0)) else {
            continue;
        };
        if needs_gain && gain <= 0.0 {
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

/// What a change would mean for us and for both followers; `None` if there is no room for it.
fn prospect(
    net: &mut Network,
    driver: &Driver,
    me: &Mover,
    my_idx: u32,
    around: &Around,
    change: &LaneChange,
) -> Option<Prospect> {
    let (s_m, target) = (change.from.s_m, change.to_lane);
    let search = |lane: u32, within_m: f64| Search {
        from: LanePlace { lane, s_m },
        within_m,
        me: my_idx,
    };
    let movers = &around.traffic.movers;
    let table = around.lanes;
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
    let found = |at: Neighbour| Ranked {
        at_m: at.distance_m,
        mover: &movers[at.mover as usize],
    };
    let [old_leader, new_leader] =
        [change.from.lane, target].map(|lane| table.ahead(net, &search(lane, SIGHT_M)).map(found));
    let ours = Ranked {
        at_m: 0.0,
        mover: me,
    };
    let own_idm = driver.idm(around.rules);
    let own_accel = |leader: Option<Ranked>| {
        let accel =
            leader.map(|leader| speed::follow(me.speed_mps, &own_idm, ours.behind(&leader)));
        accel.map_or(driver.road_mps2, |accel| accel.min(driver.road_mps2))
    };
    let own = Outlook {
        before_mps2: own_accel(old_leader),
        after_mps2: own_accel(new_leader),
    };
    let gap_ahead_m = new_leader.map_or(f64::INFINITY, |it| ours.behind(&it).gap_m);
    if own.after_mps2 < -SAFE_BRAKE_MPS2 || gap_ahead_m < 2.0 + 0.3 * me.speed_mps {
        return None;
    }
    let [old_follower, new_follower] = [change.from.lane, target].map(|lane| {
        let it = table
            .behind(net, &search(lane, SIGHT_BEHIND_M))
            .map(found)?;
        Some(Ranked {
            at_m: -it.at_m,
            ..it
        })
    });
    if let Some(it) = new_follower
        && it.behind(&ours).gap_m < 2.0 + 0.4 * it.mover.speed_mps
    {
        return None;
    }
    let outlook = |follower: Option<Ranked>, now: Option<Ranked>, then: Option<Ranked>| {
        follower.map_or(Outlook::default(), |it| Outlook {
            before_mps2: it.accel(driver.desired_mps, now),
            after_mps2: it.accel(driver.desired_mps, then),
        })
    };
    let prospect = Prospect {
        side: change.side,
        keeps_right: change.keeps_right,
        own,
        old_follower: outlook(old_follower, Some(ours), old_leader),
        new_follower: outlook(new_follower, new_leader, Some(ours)),
    };
    if !prospect.is_safe() {
        return None;
    }
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
    Some(prospect)
}

/// A vehicle in a row of vehicles.
#[derive(Clone, Copy)]
struct Ranked<'m> {
    /// How far ahead of us its middle is, metres.
    at_m: f64,
    mover: &'m Mover,
}

impl Ranked<'_> {
    /// What it has before it if it drives behind `ahead`.
    fn behind(&self, ahead: &Ranked) -> Leader {
        Leader {
            gap_m: ahead.at_m - self.at_m - ahead.mover.half_m[0] - self.mover.half_m[0],
            speed_mps: ahead.mover.speed_mps,
        }
    }

    /// Its acceleration by the model. Nobody knows its desired speed: it is the road's, or the one
    /// that it drives if that is greater.
    fn accel(&self, road_mps: f64, ahead: Option<Ranked>) -> f64 {
        let idm = Idm {
            desired_mps: road_mps.max(self.mover.speed_mps),
            standing_gap_m: FOLLOWER_GAP_M,
        };
        let v = self.mover.speed_mps;
        ahead.map_or_else(
            || idm.free_accel(v),
            |ahead| speed::follow(v, &idm, self.behind(&ahead)),
        )
    }
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
    let is_along = wrap(other.yaw_rad - foot.heading_rad).abs() < 0.5;
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
        // One that broke off stands too near to begin again.
        if driver.has_gone_back {
            driver.has_gone_back = false;
            driver.make_room();
        }
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
    let detour = Detour {
        blocker,
        between_m: between,
        until_m: until,
        offset_m,
        pace_mps: speed::on_bend(SWERVE_BEND * offset_m / (length_m * length_m))
            .min(driver.path().at(front).limit_mps),
        before: Box::new(driver.path().clone()),
    };
    if detour.is_taken(&around.scene(foot, me), &is_queueing) {
        return false;
    }
    driver.path_mut().swerve(between, offset_m, length_m);
    driver.swerve_until_m = until;
    driver.detour = Some(detour);
    true
}

/// Breaks off a way round while the vehicle is not yet beside what it passes, if somebody comes that
/// was not foreseen: it goes back onto its lane and stops there.
pub(crate) fn watch_detour(driver: &mut Driver, me: &Mover, around: &Around) {
    let foot = driver.foot();
    let Some(detour) = driver.detour.take() else {
        return;
    };
    if foot.arc_m >= detour.until_m || foot.arc_m >= driver.swerve_until_m {
        return;
    }
    let can_go_back = foot.arc_m < detour.between_m[0];
    if can_go_back && detour.meets_oncoming(&around.scene(foot, me), BEGUN_MARGIN_SECS) {
        driver.go_back(*detour.before, me);
    } else {
        driver.detour = Some(detour);
    }
}
