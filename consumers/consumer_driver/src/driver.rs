//! One driver: it follows its path, keeps clear of others, obeys lights and signs, changes lanes
//! and gets out of jams.

use std::collections::VecDeque;

use schema_frames::{VehicleControl, VehicleControlRecord};
use schema_roads::LaneKey;
use schema_types::noise::Noise;

use crate::crossing::{Passage, Refusal};
use crate::detour::Detour;
use crate::idm::{Idm, Leader};
use crate::lanes::network::{LanePlace, Network, TURN_RAD};
use crate::lanes::path::{Foot, Guide, Path};
use crate::lanes::strangers::locate;
use crate::parameters::{RoadOption, Rules};
use crate::plane::{Side, distance, wrap};
use crate::speed::{self, Pedals};
use crate::steer::{Geometry, Steering};
use crate::traffic::{Mover, STANDING_MPS};
use entry::find_entries;
use hindrance::Lookout;
use rescue::{Rescue, Situation};
use signals::{Ahead, Signals, WAITING_M};

mod entry;
mod hindrance;
mod lamps;
mod rescue;
mod signals;
mod view;

pub use entry::Entry;
pub(crate) use hindrance::Obstacle;
pub use hindrance::Wait;
pub use lamps::{
    LAMP_BRAKE, LAMP_FOG, LAMP_LEFT, LAMP_LOW_BEAM, LAMP_POSITION, LAMP_REVERSE, LAMP_RIGHT,
};
pub(crate) use view::{TickView, View};

/// Smallest distance for which a path is planned ahead, metres.
const HORIZON_M: f64 = 90.0;
/// The same for whoever may have to pass something over the lane of oncoming traffic, metres.
const PASS_HORIZON_M: f64 = 300.0;
/// A driver that has stood at the end of a lane for so long looks beside it, seconds and metres.
const DEAD_END_SECS: f64 = 4.0;
const BESIDE_M: f64 = 4.6;
/// Gap kept to a vehicle that is parked on the lane, so that there is room to go round it, metres.
const PARKED_GAP_M: f64 = 11.0;
/// Gap kept to somebody on foot, whoever is in a hurry, and to a vehicle that is crept past, metres.
const WALKER_GAP_M: f64 = 2.2;
const CREEP_GAP_M: f64 = 0.8;
/// A driver whose exit is full for so long takes another one, seconds.
const EXIT_PATIENCE_SECS: f64 = 8.0;
/// Desired speed where a path has no points to tell, m/s.
const SLOW_ROAD_MPS: f64 = 5.0;
/// Largest speed of a driver that creeps past something, m/s.
const CREEP_MPS: f64 = 1.5;
/// Hardest braking for a limit or a bend, m/s².
const ROAD_BRAKE_MPS2: f64 = 4.0;
/// Greatest change of the wanted acceleration, m/s³: upwards, and downwards without need.
const JERK_MPS3: [f64; 2] = [2.5, 4.0];
/// Stream of the choices at junctions.
const CHOICES: u64 = 0x64_72_69_76_65;

/// The actor that keeps a vehicle from driving on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blocker {
    /// Its id.
    pub id: u32,
    /// For how long it has been in the way, seconds.
    pub secs: f64,
}

/// State of one driver.
#[derive(Clone, Debug)]
pub struct Driver {
    id: u32,
    path: Path,
    foot: Foot,
    steering: Steering,
    pedals: Pedals,
    rescue: Rescue,
    wait: Wait,
    /// The actor that blocks the way, while the vehicle stands because of it.
    blocked_by: Option<u32>,
    blocked_secs: f64,
    pub(crate) obstacle: Option<Obstacle>,
    entries: Vec<Entry>,
    /// What it may do at each of the entries; the fleet decides.
    passages: Vec<Passage>,
    signals: Signals,
    /// Acceleration that was wanted last, m/s².
    wanted_mps2: f64,
    /// Speed that limits and bends allow where it is, m/s.
    pub(crate) desired_mps: f64,
    /// Acceleration that limits and bends allow, here and ahead, m/s².
    pub(crate) road_mps2: f64,
    /// Time before which it does not change lanes again, seconds.
    pub(crate) settled_until_secs: f64,
    /// Length that is left of the swerve under way, path metres.
    pub(crate) swerve_until_m: f64,
    /// The way round something that it drives, and whether it has broken one off.
    pub(crate) detour: Option<Detour>,
    pub(crate) has_gone_back: bool,
    /// What is left of the route and the places to come through, as last seen.
    route_left: Vec<RoadOption>,
    places_left: Vec<[f64; 3]>,
    seed: u64,
    n_plans: u64,
    /// When it chose another way because its exit was full, seconds.
    rerouted_at_secs: f64,
    /// Whether it moves without physics.
    pub(crate) glides: bool,
    /// How long it has stood at all, seconds.
    pub(crate) standing_secs: f64,
}

impl Driver {
    /// A driver for `me` on the lane it stands on; `None` if no lane is near.
    pub(crate) fn new(net: &mut Network, me: &Mover, seed: u64) -> Option<Driver> {
        let place = locate(net, me)?;
        let choices = Noise::new(seed, u64::from(me.number), CHOICES);
        let path = Path::new(net, place, choices, 0, Guide::default());
        let wheelbase_m = if me.half_m[0] < 1.3 {
            1.2 * me.half_m[0]
        } else {
            1.16 * me.half_m[0]
        };
        let mut driver = Driver {
            id: me.id,
            path,
            foot: Foot::default(),
            steering: Steering::new(Geometry {
                wheelbase_m,
                max_steer_rad: 0.6,
            }),
            pedals: Pedals::default(),
            rescue: Rescue::default(),
            wait: Wait::No,
            blocked_by: None,
            blocked_secs: 0.0,
            obstacle: None,
            entries: Vec::new(),
            passages: Vec::new(),
            signals: Signals::default(),
            wanted_mps2: 0.0,
            desired_mps: SLOW_ROAD_MPS,
            road_mps2: 0.0,
            settled_until_secs: 0.0,
            swerve_until_m: f64::NEG_INFINITY,
            detour: None,
            has_gone_back: false,
            route_left: Vec::new(),
            places_left: Vec::new(),
            seed,
            n_plans: 0,
            rerouted_at_secs: 0.0,
            glides: false,
            standing_secs: 0.0,
        };
        driver.foot = driver.path.project(me.origin(), 0.0, 60.0);
        Some(driver)
    }

    /// Sets the true geometry of the vehicle, where it is known.
    pub fn set_geometry(&mut self, geometry: Geometry) {
        self.steering = Steering::new(geometry);
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn path_mut(&mut self) -> &mut Path {
        &mut self.path
    }

    /// Where it is on its path.
    pub fn foot(&self) -> Foot {
        self.foot
    }

    /// Why it does not go on.
    pub fn wait(&self) -> Wait {
        self.wait
    }

    /// How often it has backed off since it last drove freely.
    pub fn n_rescues(&self) -> u32 {
        self.rescue.n_rescues()
    }

    /// The actor that keeps the vehicle from driving on; `None` while it moves.
    pub fn blocked_by(&self) -> Option<Blocker> {
        self.blocked_by.map(|id| Blocker {
            id,
            secs: self.blocked_secs,
        })
    }

    /// Whether it is backing off.
    pub fn is_reversing(&self) -> bool {
        self.rescue.is_reversing()
    }

    /// Makes it back off a little in its own lane, so that another vehicle gets past.
    pub(crate) fn make_room(&mut self) {
        self.rescue.make_room();
    }

    /// Goes back to the path that it left for a way round.
    pub(crate) fn go_back(&mut self, before: Path, me: &Mover) {
        self.path = before;
        self.foot = self
            .path
            .project(me.origin(), self.foot.arc_m - 5.0, self.foot.arc_m + 5.0);
        self.swerve_until_m = self.foot.arc_m;
        self.has_gone_back = true;
    }

    /// The junctions that it is in or comes to, the nearest first.
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// Whether more than its nose is inside a junction.
    pub(crate) fn is_inside(&self, me: &Mover) -> bool {
        let front = self.foot.arc_m + me.front_m();
        self.entries
            .first()
            .is_some_and(|entry| front > entry.arc_m[0] + WAITING_M)
    }

    /// The lane it is on.
    pub fn lane(&self) -> Option<LaneKey> {
        self.path
            .legs()
            .get(self.path.leg_at(self.foot.arc_m))
            .map(|leg| leg.way.key)
    }

    /// The lane it is on, by index, and the place there; the lane that it is leaving too.
    pub(crate) fn on_lanes(&self) -> impl Iterator<Item = LanePlace> + '_ {
        let arc_m = self.foot.arc_m;
        let leg = &self.path.legs()[self.path.leg_at(arc_m)];
        let here = LanePlace {
            lane: leg.lane,
            s_m: leg.s_at_m(arc_m),
        };
        let leaving = self.path.shift().and_then(|shift| {
            let is_under_way = shift.arc_m[0] <= arc_m;
            is_under_way.then_some(LanePlace {
                lane: shift.from,
                s_m: shift.from_s_less_arc_m + arc_m,
            })
        });
        std::iter::once(here).chain(leaving)
    }

    /// The lane of the path a little ahead, and the place on it.
    pub(crate) fn lane_after(&self, ahead_m: f64) -> Option<LanePlace> {
        let arc_m = self.foot.arc_m + ahead_m;
        let leg = self.path.legs().get(self.path.leg_at(arc_m))?;
        Some(LanePlace {
            lane: leg.lane,
            s_m: leg.s_at_m(arc_m),
        })
    }

    /// Takes what was decided for each of its junctions.
    pub(crate) fn take_passages(&mut self, decided: impl Fn(u32) -> Option<Passage>) {
        self.passages.clear();
        let passages = self
            .entries
            .iter()
            .map(|entry| decided(entry.zone).unwrap_or_default());
        self.passages.extend(passages);
    }

    /// Finds its place on the path; plans a new path if it is not on it, or if it is to go
    /// elsewhere.
    pub(crate) fn localise(&mut self, net: &mut Network, me: &Mover, view: View) {
        let (rules, seed) = (view.rules, view.seed);
        let point = me.origin();
        let (foot, apart) = self
            .path
            .descend(point, self.path.point_idx(self.foot.arc_m));
        self.foot = foot;
        let choices = Noise::new(seed, u64::from(me.number), CHOICES);
        let lost = apart > 3.5 + self.swerve_width()
            || wrap(self.foot.heading_rad - me.yaw_rad).abs() > 1.9;
        if lost && let Some(place) = locate(net, me) {
            let n = self.path.n_choices() + 1;
            let guide = self.path.guide().clone();
            self.path = Path::new(net, place, choices, n, guide);
            self.swerve_until_m = f64::NEG_INFINITY;
            self.detour = None;
            self.steering.reset();
            self.foot = self.path.project(point, 0.0, 60.0);
        }
        self.choose_free_exit(choices, me, view.traffic.time_secs);
        self.leave_dead_end(net, me, choices);
        let is_new = rules.own.route != self.route_left
            || rules.own.custom_path_m.len() != self.places_left.len()
            || rules.own.custom_path_m != self.places_left
            || seed != self.seed;
        if is_new {
            self.n_plans += 1;
            self.seed = seed;
            self.route_left = rules.own.route.clone();
            self.places_left = rules.own.custom_path_m.clone();
            let guide = Guide {
                route: self.route_left.iter().copied().collect(),
                lanes: self.lanes_to_places(net),
            };
            self.path.replan(self.foot.arc_m, choices, guide);
        }
        let horizon_m = if self.blocked_secs > 0.0 || self.detour.is_some() {
            PASS_HORIZON_M
        } else {
            HORIZON_M
        };
        let until = self.foot.arc_m + horizon_m.max(6.0 * me.speed_mps);
        self.path.extend(net, self.foot.arc_m, until);
        find_entries(&self.path, self.foot, me, &mut self.entries);
    }

    /// Takes another way out of a junction if the one it wants has been full for a while: vehicles
    /// that wait for each other's roads in a circle would wait for ever.
    fn choose_free_exit(&mut self, choices: Noise, me: &Mover, time_secs: f64) {
        let patience = EXIT_PATIENCE_SECS + f64::from(self.id % 8);
        let is_free_to_choose =
            self.path.guide().route.is_empty() && self.path.guide().lanes.is_empty();
        let first = self.entries.first().zip(self.passages.first());
        if let Some((entry, passage)) = first
            && passage.refusal == Some(Refusal::Exit)
            && is_free_to_choose
            && self.standing_secs > patience
            && time_secs > self.rerouted_at_secs + patience
            && self.foot.arc_m + me.front_m() < entry.arc_m[0]
            && entry.legs[0] > 0
        {
            self.rerouted_at_secs = time_secs;
            let before = self.path.legs()[entry.legs[0] - 1].arc_m;
            let guide = Guide::default();
            self.path
                .replan(0.5 * (before[0] + before[1]), choices, guide);
        }
    }

    /// At the end of a lane that leads nowhere: goes on along one beside it that does.
    fn leave_dead_end(&mut self, net: &mut Network, me: &Mover, choices: Noise) {
        if self.wait != Wait::End || self.standing_secs < DEAD_END_SECS {
            return;
        }
        let map = net.map();
        let at = map.nearest(me.position_m, |lane| {
            lane.kind.is_drivable() && net.lane(lane.key).is_some_and(|idx| net.goes_on(idx))
        });
        let place = at.and_then(|at| {
            let pose = map.pose(schema_roads::LanePosition::new(at.lane, at.s_m))?;
            let aside_m = distance([pose.translation.x, pose.translation.y], me.origin());
            let turn_rad = wrap(pose.rotation.euler_angles().2 - me.yaw_rad);
            let is_beside = aside_m < BESIDE_M && turn_rad.abs() < 0.8;
            let lane = net.lane(at.lane)?;
            is_beside.then_some(LanePlace { lane, s_m: at.s_m })
        });
        if let Some(place) = place {
            let (n, guide) = (self.path.n_choices() + 1, self.path.guide().clone());
            self.path = Path::new(net, place, choices, n, guide);
            self.foot = self.path.project(me.origin(), 0.0, 60.0);
            self.swerve_until_m = self.foot.arc_m + 20.0;
            self.steering.reset();
        }
    }

    /// Path length of the stop line of a light that holds it, metres.
    pub fn light_line_m(&self) -> Option<f64> {
        self.signals.light_line_m()
    }

    /// Why it may not enter the next junction yet.
    pub fn refusal(&self) -> Option<Refusal> {
        self.passages.first().and_then(|passage| passage.refusal)
    }

    fn swerve_width(&self) -> f64 {
        if self.foot.arc_m < self.swerve_until_m {
            2.0
        } else {
            0.0
        }
    }

    /// The lanes that lead past the places still to be reached.
    fn lanes_to_places(&self, net: &mut Network) -> VecDeque<u32> {
        let mut lanes = VecDeque::new();
        let mut from = self.path.legs()[self.path.leg_at(self.foot.arc_m)].lane;
        for place in self.places_left.iter().take(200) {
            let Some(to) = crate::lanes::route::nearest_lane(net, *place) else {
                continue;
            };
            let Some(way) = crate::lanes::route::between(net, from, to) else {
                continue;
            };
            lanes.extend(way.into_iter().skip(usize::from(!lanes.is_empty())));
            from = to;
        }
        lanes
    }

    /// Takes away what has been carried out of the route and the places, for the one who set them.
    pub(crate) fn note_progress(&mut self, me: &Mover) -> Option<(Vec<RoadOption>, Vec<[f64; 3]>)> {
        let near = |place: &[f64; 3]| {
            distance([place[0], place[1]], me.origin()) < 6.0 + 0.3 * me.speed_mps
        };
        let passed = self.places_left.iter().take(3).rposition(near);
        let n_route = self.path.guide().route.len();
        if passed.is_none() && n_route == self.route_left.len() {
            return None;
        }
        if let Some(last) = passed {
            self.places_left.drain(..=last);
        }
        self.route_left = self.path.guide().route.iter().copied().collect();
        Some((self.route_left.clone(), self.places_left.clone()))
    }

    /// The lane that a route wants beside the present one, and the side it is on.
    pub(crate) fn lane_wanted(&self) -> Option<Side> {
        let leg = &self.path.legs()[self.path.leg_at(self.foot.arc_m)];
        let lanes = &self.path.guide().lanes;
        let at = lanes.iter().take(8).position(|lane| *lane == leg.lane);
        let next = match at {
            Some(at) => *lanes.get(at + 1)?,
            None => *lanes.front()?,
        };
        if leg.way.left == Some(next) {
            Some(Side::Left)
        } else if leg.way.right == Some(next) {
            Some(Side::Right)
        } else {
            None
        }
    }

    /// What to do in this tick.
    pub(crate) fn control(&mut self, me: &Mover, view: View) -> VehicleControlRecord {
        let dt = view.traffic.period_secs;
        self.standing_secs = if me.speed_mps.abs() < STANDING_MPS {
            self.standing_secs + dt
        } else {
            0.0
        };
        if self.rescue.is_reversing() {
            self.wanted_mps2 = 0.0;
            return self.rescue.reverse(
                me,
                view.traffic,
                view.grid,
                self.foot,
                &mut self.steering,
                view.rules.updates_lights(),
            );
        }
        let creeping = self.rescue.is_creeping();
        let front = self.foot.arc_m + me.front_m();
        self.read_road(me, front, view.rules);
        if creeping {
            self.desired_mps = self.desired_mps.min(CREEP_MPS);
            let creep = self.idm(view.rules).free_accel(me.speed_mps);
            self.road_mps2 = self.road_mps2.min(creep);
        }
        self.obstacle = self.look_out(me, view, creeping);
        let (wanted, wait) = self.weigh(me, view, creeping);
        self.wait = wait;
        let blocker = self
            .obstacle
            .filter(|_| wait == Wait::Ahead && me.speed_mps.abs() < STANDING_MPS)
            .map(|o| o.id);
        self.blocked_secs = if blocker.is_some() && blocker == self.blocked_by {
            self.blocked_secs + dt
        } else {
            0.0
        };
        self.blocked_by = blocker;
        self.rescue.watch(
            &Situation {
                me,
                path: &self.path,
                foot: self.foot,
                wait,
                wanted_mps2: wanted,
                obstacle: self.obstacle,
            },
            view.traffic,
            view.grid,
        );
        self.press(me, view, wanted, front)
    }

    /// Acceleration of a driver that moves without physics, m/s².
    pub(crate) fn glide_accel(&mut self, me: &Mover, view: View) -> f64 {
        let front = self.foot.arc_m + me.front_m();
        self.read_road(me, front, view.rules);
        self.obstacle = self.look_out(me, view, false);
        let (wanted, wait) = self.weigh(me, view, false);
        self.wait = wait;
        self.standing_secs = if me.speed_mps.abs() < STANDING_MPS {
            self.standing_secs + view.traffic.period_secs
        } else {
            0.0
        };
        wanted
    }

    /// The smallest of the accelerations that road, lights, right of way and others allow, and
    /// whose it is.
    fn weigh(&mut self, me: &Mover, view: View, creeping: bool) -> (f64, Wait) {
        let v = me.speed_mps;
        let front = self.foot.arc_m + me.front_m();
        let ahead = Ahead {
            me,
            path: &self.path,
            foot: self.foot,
            entries: &self.entries,
        };
        let sign_line = self.signals.sign_line(&ahead, view);
        let mut least = (self.road_mps2, Wait::No);
        let mut consider = |accel: f64, why: Wait| {
            if accel < least.0 {
                least = (accel, why);
            }
        };
        let end = self.path.end();
        if end.is_dead_end {
            consider(speed::stop_before(v, end.arc_m - front), Wait::End);
        }
        if let Some(line) = self.signals.light_line_m() {
            let line = self.waiting_line(line, front);
            consider(speed::stop_before(v, line - front), Wait::Light);
        }
        if let Some(line) = sign_line {
            let line = self.waiting_line(line, front);
            consider(speed::stop_before(v, line - front), Wait::Sign);
        }
        let idm = self.idm(view.rules);
        for (entry, passage) in self.entries.iter().zip(&self.passages) {
            if !passage.may_enter {
                if front < entry.arc_m[0] + 1.0 {
                    let line = self.waiting_line(entry.line_m, front);
                    consider(speed::stop_before(v, line - front), Wait::Turn);
                }
                break;
            }
            if let Some(line) = passage.line_m {
                let left = entry.arc_m[0] + line - front;
                consider(speed::stop_before(v, left.max(0.0)), Wait::Turn);
            }
            if let Some(leader) = passage.behind {
                consider(speed::follow(v, &idm, leader), Wait::Turn);
            }
        }
        if let Some(obstacle) = self.obstacle {
            let parked = view.strangers;
            let standing_gap_m = if !obstacle.is_vehicle {
                WALKER_GAP_M
            } else if creeping {
                CREEP_GAP_M
            } else if parked.is_parked(obstacle.id, view.traffic.time_secs) {
                idm.standing_gap_m.max(PARKED_GAP_M)
            } else {
                idm.standing_gap_m
            };
            let idm = Idm {
                standing_gap_m,
                ..idm
            };
            let leader = Leader {
                gap_m: obstacle.gap_m,
                speed_mps: obstacle.along_mps,
            };
            consider(speed::follow(v, &idm, leader), Wait::Ahead);
        }
        least
    }

    /// A vehicle that is already past the waiting line stops where it is: the line must not make it
    /// brake hard.
    fn waiting_line(&self, line: f64, front: f64) -> f64 {
        let entry = self
            .entries
            .iter()
            .find(|entry| (entry.arc_m[0] - 0.5..entry.arc_m[0] + WAITING_M).contains(&line));
        match entry {
            Some(entry) => line.min((entry.arc_m[0] - WAITING_M).max(front)),
            None => line,
        }
    }

    fn look_out(&self, me: &Mover, view: View, creeping: bool) -> Option<Obstacle> {
        let own = view.rules.own;
        // A share that is ignored is drawn anew for every pair and second.
        let second = view.traffic.time_secs as u64;
        let sees = |other: &Mover| {
            let percent = if other.is_vehicle {
                own.ignore_vehicles_percent
            } else {
                own.ignore_walkers_percent
            };
            let is_ignored = percent > 0.0
                && 100.0
                    * Noise::new(view.seed, u64::from(me.number), second)
                        .uniform(other.number.into())
                    < percent;
            !is_ignored && !own.ignored.contains(&other.id)
        };
        Lookout {
            idm: self.idm(view.rules),
            ..self.lookout(me)
        }
        .obstacle(
            view.traffic,
            view.grid,
            if creeping { 0.15 } else { 0.3 },
            sees,
        )
    }

    fn press(
        &mut self,
        me: &Mover,
        view: View,
        wanted_mps2: f64,
        front: f64,
    ) -> VehicleControlRecord {
        let dt = view.traffic.period_secs;
        // Comfort gives way to need: hard braking is not delayed.
        let wanted = if wanted_mps2 < -3.5 {
            wanted_mps2
        } else {
            let low = self.wanted_mps2.min(0.5) - JERK_MPS3[1] * dt;
            let high = self.wanted_mps2.max(-0.5) + JERK_MPS3[0] * dt;
            wanted_mps2.clamp(low, high)
        };
        self.wanted_mps2 = wanted;
        let pressed = self.pedals.press(me.speed_mps, wanted, dt);
        let offset = self.side_offset(me, view.rules);
        let steer = self.steering.ratio(me, &self.path, self.foot, offset, dt);
        let control = VehicleControl {
            throttle_ratio: pressed.throttle_ratio as f32,
            brake_ratio: pressed.brake_ratio as f32,
            steer_ratio: steer as f32,
            ..VehicleControl::default()
        };
        let mut record = VehicleControlRecord::new(me.id, control);
        if view.rules.updates_lights() {
            record.lamps = self.lamps(view, front, pressed.brake_ratio);
        }
        record
    }

    /// Its parameters of the Intelligent Driver Model, where it is.
    pub(crate) fn idm(&self, rules: Rules) -> Idm {
        Idm {
            desired_mps: self.desired_mps,
            standing_gap_m: rules.standing_gap_m(),
        }
    }

    /// Notes the speed that limits and bends allow here, and the acceleration that they allow here
    /// and as far ahead as braking reaches.
    fn read_road(&mut self, me: &Mover, front: f64, rules: Rules) {
        let v = me.speed_mps;
        let reach = front + 6.0 + v * v / 3.0;
        let rear = self.foot.arc_m - 0.5 * me.rear_m();
        let points = self.path.points();
        // Where signs post another limit than the map states, theirs holds until the next one.
        let stated = self.path.at(self.foot.arc_m).limit_mps;
        let posted = Some(me.limit_mps).filter(|l| *l > 0.5 && (l - stated).abs() > 0.3);
        let (mut desired, mut ahead) = (f64::INFINITY, f64::INFINITY);
        for point in &points[self.path.point_idx(rear)..] {
            if point.arc_m > reach {
                break;
            }
            let limit = posted.unwrap_or(point.limit_mps);
            let limit = rules.speed_mps(limit).min(point.bend_mps);
            if point.arc_m <= front {
                desired = desired.min(limit);
            } else if limit < v {
                ahead = ahead.min(speed::ahead(v, limit, point.arc_m - front));
            }
        }
        self.desired_mps = if desired.is_finite() {
            desired
        } else {
            SLOW_ROAD_MPS
        };
        let here = self.idm(rules).free_accel(v);
        self.road_mps2 = here.min(ahead.max(-ROAD_BRAKE_MPS2));
    }

    /// Finds the first stop line whose light says stop.
    pub(crate) fn see_lights(&mut self, view: View, me: &Mover) {
        let ahead = Ahead {
            me,
            path: &self.path,
            foot: self.foot,
            entries: &self.entries,
        };
        self.signals.see_lights(&ahead, &self.passages, view);
    }

    /// Whether a light or sign holds it before a junction.
    pub(crate) fn is_held(&self, me: &Mover, entry: &Entry, view: View) -> bool {
        let ahead = Ahead {
            me,
            path: &self.path,
            foot: self.foot,
            entries: &self.entries,
        };
        self.signals.holds(&ahead, entry, view)
    }

    fn lookout<'d>(&'d self, me: &'d Mover) -> Lookout<'d> {
        Lookout {
            me,
            path: &self.path,
            foot: self.foot,
            wheelbase_m: self.steering.wheelbase_m(),
            idm: Idm {
                desired_mps: self.desired_mps,
                standing_gap_m: 2.0,
            },
        }
    }

    /// Offset from the middle of the path, metres: towards the inside of a bend if the front swings
    /// out, and away from what was in the way.
    fn side_offset(&self, me: &Mover, rules: Rules) -> f64 {
        self.lookout(me).inside_m() + self.rescue.aside_m(self.foot.arc_m) + rules.lane_offset_m()
    }

    fn lamps(&self, view: View, front: f64, brake: f64) -> u32 {
        let surroundings = view.rules.common.surroundings;
        let mut lamps = 0;
        if brake > 0.02 {
            lamps |= LAMP_BRAKE;
        }
        if surroundings.dark {
            lamps |= LAMP_POSITION | LAMP_LOW_BEAM;
        }
        if surroundings.foggy {
            lamps |= LAMP_POSITION | LAMP_LOW_BEAM | LAMP_FOG;
        }
        let side = match self.path.shift() {
            Some(shift) => Some(shift.side),
            None => self.entries.iter().find_map(|entry| {
                let is_near = entry.arc_m[0] - front < 30.0;
                match entry.turn_rad {
                    turn if is_near && turn > TURN_RAD => Some(Side::Left),
                    turn if is_near && turn < -TURN_RAD => Some(Side::Right),
                    _ => None,
                }
            }),
        };
        lamps
            | match side {
                Some(Side::Left) => LAMP_LEFT,
                Some(Side::Right) => LAMP_RIGHT,
                None => 0,
            }
    }
}
