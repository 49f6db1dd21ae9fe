//! Right of way: who may enter a junction, and who lets whom pass inside it.
//!
//! A vehicle asks before it enters; once granted, its turn has a number, and of two vehicles whose
//! ways meet the one with the greater number lets the other pass. Numbers are a total order, so
//! nobody waits in a circle. Who is granted first follows from lights, signs, roundabouts and the
//! time of arrival; a later one goes before an earlier one if it is out of the way in time (gap
//! acceptance).
//!
//! Vehicles that others drive are strangers. They have the right of way that the rules give them, are
//! counted by their time to arrival, are never asked to brake harder than comfort, and inside a
//! junction they go first. Waiting long gains nothing against them; among driven vehicles it does.

use std::collections::BTreeMap;

use crate::idm::{COMFORT_BRAKE_MPS2, Leader};
use crate::lanes::network::{Meet, Network, TURN_RAD};
use crate::plane::wrap;
use crate::speed::travel_secs;
use crate::traffic::STANDING_MPS;

/// Smallest room between two vehicles whose ways do not meet, metres.
const CLEARANCE_M: f64 = 0.4;
/// A vehicle nearer to a junction than this has arrived there, metres.
const ARRIVAL_M: f64 = 12.0;
/// A vehicle that waits longer is let in by driven ones that have the right of way, seconds.
const PATIENCE_SECS: f64 = 12.0;
/// A vehicle that another keeps waiting without going itself loses its turn after this, seconds.
const COURTESY_SECS: f64 = 6.0;
/// A granted vehicle that stands outside for so long asks again, seconds.
const IDLE_SECS: f64 = 2.5;
/// Time between one vehicle leaving a place and another one reaching it, seconds.
const GAP_SECS: f64 = 0.9;
/// Time between two vehicles that go on one behind the other, seconds.
const MERGE_SECS: f64 = 1.8;
/// The same between a vehicle that has begun to go and a stranger with the right of way: less, so
/// that a turn is not taken back for a prediction that was a little off.
const BEGUN_GAP_SECS: f64 = 0.4;
const BEGUN_MERGE_SECS: f64 = 1.0;
/// Vehicles that arrive within this time arrive together: the one on the right goes first, seconds.
const TOGETHER_SECS: f64 = 1.0;
/// Direction of travel to ours of a vehicle that comes from the right, and of an oncoming one,
/// radians to the left.
const FROM_RIGHT_RAD: [f64; 2] = [0.6, 2.3];
/// Acceleration with which a vehicle goes at least, m/s².
const CALM_ACCEL_MPS2: f64 = 1.4;
/// Hardest braking before a junction that a vehicle is asked for, m/s².
const BRAKE_MPS2: f64 = 4.5;
/// Room that is kept beyond a vehicle in the exit, metres.
const EXIT_GAP_M: f64 = 2.5;
/// An exit with so much room is free, metres.
pub(crate) const EXIT_FREE_M: f64 = 40.0;

/// One vehicle's use of a junction. A vehicle that this process does not drive has one for every
/// way that it may take.
#[derive(Clone, Debug)]
pub(crate) struct User {
    pub id: u32,
    /// Number by which its patience differs, [`crate::Mover::number`].
    pub number: u32,
    pub zone: u32,
    pub is_driven: bool,
    /// Lanes, and how far beyond the entry each begins, metres.
    pub lanes: Vec<(u32, f64)>,
    /// Lane that it enters by, and the first one behind.
    pub from: Option<u32>,
    pub to: Option<u32>,
    /// How far the front is beyond the entry, metres; negative before it.
    pub front_m: f64,
    pub body_m: f64,
    /// How far before the entry it waits for its turn, metres: a stop line may lie well before it.
    pub waits_m: f64,
    /// Half the width that it sweeps, metres.
    pub half_m: f64,
    pub speed_mps: f64,
    /// Speed that its way allows, m/s.
    pub pace_mps: f64,
    pub turn_rad: f64,
    /// Direction of travel where it enters, radians.
    pub heading_rad: f64,
    /// 0 goes before 1 before 2.
    pub class: u8,
    /// Whether a light, or a sign at which it has not stopped yet, holds it.
    pub held: bool,
    /// Room behind the junction before the first slow vehicle, at most [`EXIT_FREE_M`], metres.
    pub room_m: f64,
}

impl User {
    fn is_inside(&self) -> bool {
        self.front_m > 0.3
    }

    fn has_arrived(&self) -> bool {
        self.front_m > -ARRIVAL_M - self.waits_m
    }

    fn can_stop(&self) -> bool {
        self.speed_mps * self.speed_mps < -2.0 * BRAKE_MPS2 * self.front_m.min(-0.05)
            || self.speed_mps < 1.0
    }

    /// Whether it can still stop before the junction without braking harder than comfort.
    fn can_stop_gently(&self) -> bool {
        self.speed_mps * self.speed_mps < -2.0 * COMFORT_BRAKE_MPS2 * self.front_m.min(-0.05)
            || self.speed_mps < 1.0
    }

    /// How far the other's direction of travel is to the left of ours, radians.
    fn turned_rad(&self, other: &User) -> f64 {
        wrap(other.heading_rad - self.heading_rad)
    }

    fn has_on_its_right(&self, other: &User) -> bool {
        (FROM_RIGHT_RAD[0]..FROM_RIGHT_RAD[1]).contains(&self.turned_rad(other))
    }

    fn is_met_by(&self, other: &User) -> bool {
        self.turned_rad(other).abs() > FROM_RIGHT_RAD[1]
    }

    fn can_stop_before(&self, at_m: f64) -> bool {
        self.speed_mps * self.speed_mps < 2.0 * 8.0 * (at_m - self.front_m).max(0.05)
    }

    /// Distance from which it asks, metres before the entry.
    fn asks_from_m(&self) -> f64 {
        8.0 + self.waits_m + 1.6 * self.speed_mps + self.speed_mps * self.speed_mps / 4.0
    }

    /// Earliest time at which the front is at a place, seconds.
    fn soonest_secs(&self, at_m: f64) -> f64 {
        travel_secs(
            at_m - self.front_m,
            self.speed_mps,
            self.speed_mps.max(1.15 * self.pace_mps),
            2.8,
        )
    }

    /// Latest time at which the rear is beyond a place, seconds, if nothing stops it.
    fn latest_secs(&self, at_m: f64) -> f64 {
        let pause = if self.speed_mps < 1.0 { 0.4 } else { 0.0 };
        let distance = at_m + self.body_m - self.front_m;
        pause + travel_secs(distance, self.speed_mps, self.calm_mps(), CALM_ACCEL_MPS2)
    }

    /// Speed and acceleration with which it goes at least.
    fn calm_mps(&self) -> f64 {
        0.8 * self.pace_mps
    }

    /// Its speed when its rear is beyond a place, at least, m/s.
    fn speed_beyond_mps(&self, at_m: f64) -> f64 {
        let distance = (at_m + self.body_m - self.front_m).max(0.0);
        let reached = (self.speed_mps * self.speed_mps + 2.0 * CALM_ACCEL_MPS2 * distance).sqrt();
        reached.min(self.calm_mps()).max(0.0)
    }
}

/// What a driver may do at a junction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Passage {
    pub may_enter: bool,
    pub refusal: Option<Refusal>,
    /// Where to stop inside, metres beyond the entry.
    pub line_m: Option<f64>,
    /// A vehicle to fall in behind, with the gap to it if both stood in one line.
    pub behind: Option<Leader>,
}

/// A vehicle's turn at a junction.
#[derive(Clone, Copy, Debug)]
struct Turn {
    grant: Option<u64>,
    arrived_secs: Option<f64>,
    /// How long it has stood there without being held.
    waiting_secs: f64,
    /// How long it has stood at all.
    idle_secs: f64,
    /// Why it was not granted in this tick.
    refusal: Option<Refusal>,
    seen_tick: u64,
}

/// A vehicle that waits for its turn, and when it is considered.
#[derive(Clone, Copy, Debug)]
struct Claim<'u> {
    /// 0 goes before 1 before 2.
    class: u8,
    /// When it has arrived or will arrive, seconds.
    arrives_secs: f64,
    user: &'u User,
}

/// Why a vehicle may not enter yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// There is no room for it behind the junction.
    Exit,
    /// This vehicle goes first.
    Vehicle(u32),
}

/// All turns.
#[derive(Clone, Debug, Default)]
pub(crate) struct Crossings {
    turns: BTreeMap<(u32, u32), Turn>,
    n_grants: u64,
}

/// The time of a decision.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Now {
    pub tick: u64,
    pub time_secs: f64,
    pub period_secs: f64,
}

impl Crossings {
    /// What each driven vehicle may do; `users` are sorted by zone.
    pub fn decide(
        &mut self,
        net: &mut Network,
        users: &[User],
        now: Now,
    ) -> BTreeMap<(u32, u32), Passage> {
        let mut passages = BTreeMap::new();
        for group in users.chunk_by(|a, b| a.zone == b.zone) {
            self.note(group, now);
            self.withdraw(net, group, now);
            self.grant(net, group, now);
            for user in group.iter().filter(|user| user.is_driven) {
                passages.insert((user.id, user.zone), self.passage(net, user, group, now));
            }
        }
        self.turns.retain(|_, turn| turn.seen_tick == now.tick);
        passages
    }

    /// Whether a vehicle has been granted its turn.
    pub fn is_granted(&self, id: u32, zone: u32) -> bool {
        self.turn(id, zone).is_some_and(|turn| turn.grant.is_some())
    }

    fn turn(&self, id: u32, zone: u32) -> Option<&Turn> {
        self.turns.get(&(id, zone))
    }

    /// Counts arrivals and waiting, and takes back turns that are not used.
    fn note(&mut self, group: &[User], now: Now) {
        for user in group {
            let turn = self.turns.entry((user.id, user.zone)).or_insert(Turn {
                grant: None,
                arrived_secs: None,
                waiting_secs: 0.0,
                idle_secs: 0.0,
                refusal: None,
                seen_tick: now.tick.wrapping_sub(1),
            });
            // A stranger has several uses of one junction; its time counts once.
            if turn.seen_tick == now.tick {
                continue;
            }
            turn.seen_tick = now.tick;
            turn.refusal = None;
            let stands = user.speed_mps.abs() < STANDING_MPS;
            turn.idle_secs = if stands {
                turn.idle_secs + now.period_secs
            } else {
                0.0
            };
            if user.has_arrived() && turn.arrived_secs.is_none() && !user.held {
                turn.arrived_secs = Some(now.time_secs);
            }
            if stands && !user.held && user.has_arrived() {
                turn.waiting_secs += now.period_secs;
            }
            let idles = turn.idle_secs > IDLE_SECS;
            let is_stale = idles || user.held || user.room_m < user.body_m;
            if user.is_driven && is_stale && !user.is_inside() && user.can_stop() {
                turn.grant = None;
            }
        }
    }

    /// Takes back turns of vehicles that can still stop, if a stranger with the right of way has
    /// come too near meanwhile.
    fn withdraw(&mut self, net: &mut Network, group: &[User], now: Now) {
        let strangers = || group.iter().filter(|other| !other.is_driven);
        if strangers().next().is_none() {
            return;
        }
        let margin = Margin::begun();
        for user in group.iter().filter(|user| user.is_driven) {
            let may_still_wait = !user.is_inside() && user.can_stop();
            if !may_still_wait || !self.is_granted(user.id, user.zone) {
                continue;
            }
            let mut is_hindrance = |other: &&User| {
                other.id != user.id
                    && !other.is_inside()
                    && other.speed_mps > 1.0
                    && self.goes_before(other, user, group, now)
                    && meet(net, user, other)
                        .is_some_and(|meet| !leaves_in_time(user, other, &meet, margin))
            };
            if strangers().any(|other| is_hindrance(&other))
                && let Some(turn) = self.turns.get_mut(&(user.id, user.zone))
            {
                turn.grant = None;
            }
        }
    }

    /// Whether a stranger that is not inside yet goes before a driven vehicle by the rules of the
    /// road. One that cannot stop without braking hard does whatever the rules say; one that stands
    /// has given up its turn once the other has run out of courtesy.
    fn goes_before(&self, stranger: &User, user: &User, group: &[User], now: Now) -> bool {
        if stranger.held {
            return false;
        }
        if !stranger.can_stop_gently() {
            return true;
        }
        let has_priority_road = has_priority_road(group);
        let (theirs, mine) = (
            rank(stranger, has_priority_road),
            rank(user, has_priority_road),
        );
        if theirs != mine {
            return theirs < mine;
        }
        let is_met = user.is_met_by(stranger) && stranger.turn_rad < TURN_RAD;
        if user.turn_rad > TURN_RAD && is_met && user.class < 2 {
            return true;
        }
        let later = self.arrives_secs(stranger, now) - self.arrives_secs(user, now);
        if later.abs() < TOGETHER_SECS {
            user.has_on_its_right(stranger)
        } else {
            later < 0.0
        }
    }

    /// When a vehicle has arrived or will arrive, seconds.
    fn arrives_secs(&self, user: &User, now: Now) -> f64 {
        let arrived = self
            .turn(user.id, user.zone)
            .and_then(|turn| turn.arrived_secs);
        arrived.unwrap_or(now.time_secs + (-user.front_m).max(0.0) / user.speed_mps.max(3.0))
    }

    fn grant<'u>(&mut self, net: &mut Network, group: &'u [User], now: Now) {
        for user in group.iter().filter(|user| user.is_driven) {
            let is_new = !self.is_granted(user.id, user.zone);
            if is_new && (user.is_inside() || !user.can_stop() && !user.held) {
                self.give(user);
            }
        }
        let has_priority_road = has_priority_road(group);
        let order = |user: &'u User| {
            let turn = self.turn(user.id, user.zone);
            let waited = turn.map_or(0.0, |turn| turn.waiting_secs);
            Claim {
                class: if waited > PATIENCE_SECS {
                    0
                } else {
                    rank(user, has_priority_road)
                },
                arrives_secs: self.arrives_secs(user, now),
                user,
            }
        };
        let mut waiting: Vec<Claim<'_>> = group
            .iter()
            .filter(|user| !self.goes(user))
            .map(order)
            .collect();
        waiting.sort_by(|a, b| {
            a.class
                .cmp(&b.class)
                .then(a.arrives_secs.total_cmp(&b.arrives_secs))
                .then(a.user.id.cmp(&b.user.id))
        });
        // Of two that arrive together, the one on the right goes first.
        for idx in 1..waiting.len() {
            let (a, b) = (waiting[idx - 1], waiting[idx]);
            let together = b.arrives_secs - a.arrives_secs < TOGETHER_SECS;
            if a.class == b.class && together && a.user.has_on_its_right(b.user) {
                waiting.swap(idx - 1, idx);
            }
        }
        // Who stands behind one that waits cannot go before it, so nobody waits for it.
        let mut heads: BTreeMap<u32, f64> = BTreeMap::new();
        for Claim { user, .. } in &waiting {
            if let Some(from) = user.from {
                let head = heads.entry(from).or_insert(f64::NEG_INFINITY);
                *head = head.max(user.front_m);
            }
        }
        let is_head =
            |user: &User| user.from.and_then(|from| heads.get(&from)) <= Some(&user.front_m);
        for idx in 0..waiting.len() {
            let user = waiting[idx].user;
            let asks = user.is_driven && !user.held && -user.front_m < user.asks_from_m();
            if !asks {
                continue;
            }
            let refusal = if self.exit_is_free(user, group) {
                let before = Before {
                    group,
                    earlier: &waiting[..idx],
                    is_head: &is_head,
                    now,
                };
                self.refusal(net, user, &before)
            } else {
                Some(Refusal::Exit)
            };
            match refusal {
                None => self.give(user),
                Some(_) => {
                    if let Some(turn) = self.turns.get_mut(&(user.id, user.zone)) {
                        turn.refusal = refusal;
                    }
                }
            }
        }
    }

    fn give(&mut self, user: &User) {
        self.n_grants += 1;
        if let Some(turn) = self.turns.get_mut(&(user.id, user.zone)) {
            turn.grant = Some(self.n_grants);
        }
    }

    /// Whether it is inside or has been granted its turn.
    fn goes(&self, user: &User) -> bool {
        user.is_inside() || user.is_driven && self.is_granted(user.id, user.zone)
    }

    fn exit_is_free(&self, user: &User, group: &[User]) -> bool {
        if user.room_m >= EXIT_FREE_M {
            return true;
        }
        let before_us = group.iter().filter(|other| {
            other.id != user.id && other.to == user.to && user.to.is_some() && self.goes(other)
        });
        let taken: f64 = before_us.map(|other| other.body_m + EXIT_GAP_M).sum();
        user.room_m - taken > user.body_m + EXIT_GAP_M
    }

    fn refusal(&self, net: &mut Network, user: &User, before: &Before<'_>) -> Option<Refusal> {
        let Before {
            group,
            earlier,
            is_head,
            now,
        } = *before;
        let waited = self
            .turn(user.id, user.zone)
            .map_or(0.0, |turn| turn.waiting_secs);
        // The id makes the patience differ, so that two that wait for each other do not both go.
        let out_of_patience = waited > COURTESY_SECS + f64::from(user.number % 5) * 1.5;
        for other in group {
            if other.id == user.id {
                continue;
            }
            let idle_secs = self
                .turn(other.id, other.zone)
                .map_or(0.0, |turn| turn.idle_secs);
            if out_of_patience && idle_secs > 2.0 && !other.is_driven {
                continue;
            }
            if self.goes(other) {
                let Some(meet) = meet(net, user, other) else {
                    continue;
                };
                if other.front_m - other.body_m > meet.theirs_m[1] {
                    continue;
                }
                // A vehicle that stands inside may be waiting for us. If it is really in the way,
                // it is found as an obstacle.
                if out_of_patience && idle_secs > 2.0 {
                    continue;
                }
                let is_clear = if meet.merges {
                    gap_in_line_m(user, other, &meet) > 3.0 && idle_secs < 1.0
                } else {
                    idle_secs < 1.0
                        && user.soonest_secs(meet.mine_m[0])
                            > other.latest_secs(meet.theirs_m[1]) + GAP_SECS
                };
                if !is_clear {
                    return Some(Refusal::Vehicle(other.id));
                }
                continue;
            }
            let goes_before = if other.is_driven {
                !other.held && earlier.iter().any(|it| std::ptr::eq(it.user, other))
            } else {
                self.goes_before(other, user, group, now)
            };
            if goes_before {
                if other.room_m < other.body_m + EXIT_GAP_M || !is_head(other) {
                    continue;
                }
                let Some(meet) = meet(net, user, other) else {
                    continue;
                };
                if !leaves_in_time(user, other, &meet, Margin::before()) {
                    return Some(Refusal::Vehicle(other.id));
                }
            }
        }
        None
    }

    /// What `user` may do, and whom it lets pass.
    fn passage(&self, net: &mut Network, user: &User, group: &[User], now: Now) -> Passage {
        let turn = self.turn(user.id, user.zone);
        let Some(mine) = turn.and_then(|turn| turn.grant) else {
            return Passage {
                refusal: turn.and_then(|turn| turn.refusal),
                ..Passage::default()
            };
        };
        let mut passage = Passage {
            may_enter: true,
            ..Passage::default()
        };
        let yield_at = |passage: &mut Passage, meet: &Meet| {
            let line = meet.mine_m[0] - 0.5;
            passage.line_m = Some(passage.line_m.map_or(line, |it: f64| it.min(line)));
        };
        for other in group {
            if other.id == user.id {
                continue;
            }
            if !other.is_driven && !other.is_inside() {
                // A stranger that has come too near stops us before its way, while we can stop.
                if self.goes_before(other, user, group, now)
                    && other.speed_mps > 1.0
                    && let Some(meet) = meet(net, user, other)
                    && user.front_m < meet.mine_m[0]
                    && user.can_stop_before(meet.mine_m[0])
                    && !leaves_in_time(user, other, &meet, Margin::begun())
                {
                    yield_at(&mut passage, &meet);
                }
                continue;
            }
            if !self.goes(other) {
                continue;
            }
            let turn = self.turn(other.id, other.zone);
            let theirs = turn.and_then(|turn| turn.grant).unwrap_or(0);
            let Some(meet) = meet(net, user, other) else {
                continue;
            };
            if theirs > mine {
                // A later one that is there already cannot make way.
                let is_there = other.front_m > meet.theirs_m[0]
                    && other.front_m - other.body_m < meet.theirs_m[1];
                if is_there && user.front_m < meet.mine_m[0] && user.can_stop_before(meet.mine_m[0])
                {
                    yield_at(&mut passage, &meet);
                }
                continue;
            }
            if user.front_m > meet.mine_m[0] || other.front_m - other.body_m > meet.theirs_m[1] {
                continue;
            }
            let idle_secs = turn.map_or(0.0, |turn| turn.idle_secs);
            if idle_secs > COURTESY_SECS {
                continue;
            }
            let gap_m = gap_in_line_m(user, other, &meet);
            if meet.merges && gap_m > 0.0 {
                if passage.behind.is_none_or(|nearest| gap_m < nearest.gap_m) {
                    passage.behind = Some(Leader {
                        gap_m,
                        speed_mps: other.speed_mps.max(0.0),
                    });
                }
            } else if idle_secs > 1.0
                || user.soonest_secs(meet.mine_m[0])
                    < other.latest_secs(meet.theirs_m[1]) + 0.5 * GAP_SECS
            {
                yield_at(&mut passage, &meet);
            }
        }
        passage
    }
}

/// What a vehicle that asks is measured against.
#[derive(Clone, Copy)]
struct Before<'b> {
    group: &'b [User],
    earlier: &'b [Claim<'b>],
    /// Whether a waiting vehicle is the first in its lane.
    is_head: &'b dyn Fn(&User) -> bool,
    now: Now,
}

/// Times to keep to a vehicle that goes first, seconds.
#[derive(Clone, Copy, Debug)]
struct Margin {
    cross_secs: f64,
    merge_secs: f64,
}

impl Margin {
    /// Before a vehicle goes.
    fn before() -> Margin {
        Margin {
            cross_secs: GAP_SECS,
            merge_secs: MERGE_SECS,
        }
    }

    /// Once it has begun to.
    fn begun() -> Margin {
        Margin {
            cross_secs: BEGUN_GAP_SECS,
            merge_secs: BEGUN_MERGE_SECS,
        }
    }
}

/// Whether signs make one of the roads go before others.
fn has_priority_road(group: &[User]) -> bool {
    group.iter().any(|user| user.class > 1)
}

/// Rank by signs, lights, shape and turn: 0 goes before 1 before 2.
fn rank(user: &User, has_priority_road: bool) -> u8 {
    match user.class {
        0 if has_priority_road && user.turn_rad > TURN_RAD => 1,
        class => class,
    }
}

/// Whether a vehicle is out of the way of another one that goes first before that comes; where they
/// go on as one, whether the other need not brake harder than comfort behind it.
fn leaves_in_time(user: &User, other: &User, meet: &Meet, margin: Margin) -> bool {
    let comes_secs = other.soonest_secs(meet.theirs_m[0]);
    if !meet.merges {
        return user.latest_secs(meet.mine_m[1]) + margin.cross_secs < comes_secs;
    }
    let closing = (other.speed_mps - user.speed_beyond_mps(meet.mine_m[0])).max(0.0);
    let braking_m = closing * closing / (2.0 * COMFORT_BRAKE_MPS2);
    let braking_secs = braking_m / other.speed_mps.max(1.0);
    user.latest_secs(meet.mine_m[0]) + margin.merge_secs + braking_secs < comes_secs
}

/// Gap between our front and their rear if both stood in one line before the place where their ways
/// have become one, metres.
fn gap_in_line_m(user: &User, other: &User, meet: &Meet) -> f64 {
    (meet.mine_m[1] - user.front_m) - (meet.theirs_m[1] - other.front_m) - other.body_m
}

/// Where the ways of two vehicles meet, metres beyond their entries.
fn meet(net: &mut Network, a: &User, b: &User) -> Option<Meet> {
    // One behind the other.
    if a.from.is_some() && a.from == b.from {
        return None;
    }
    let apart = a.half_m + b.half_m + CLEARANCE_M;
    let mut all: Option<Meet> = None;
    for (mine, mine_m) in &a.lanes {
        for (theirs, theirs_m) in &b.lanes {
            let Some(one) = net.meet(*mine, *theirs, apart) else {
                continue;
            };
            let (m, t) = (
                one.mine_m.map(|x| x + mine_m),
                one.theirs_m.map(|x| x + theirs_m),
            );
            all = Some(match all {
                None => Meet {
                    mine_m: m,
                    theirs_m: t,
                    merges: one.merges,
                },
                Some(old) => Meet {
                    mine_m: [old.mine_m[0].min(m[0]), old.mine_m[1].max(m[1])],
                    theirs_m: [old.theirs_m[0].min(t[0]), old.theirs_m[1].max(t[1])],
                    merges: old.merges || one.merges,
                },
            });
        }
    }
    all
}
