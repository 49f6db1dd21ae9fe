//! One driver: it follows its path, keeps clear of others, obeys lights and gets out of jams.

use schema_frames::{LightState, VehicleControl, VehicleControlRecord};
use schema_roads::{LaneKey, LanePosition, RoadMap, SignalKind};
use schema_types::noise::Noise;

use crate::path::{Foot, Path, wrap};
use crate::speed::{self, Pedals};
use crate::steer::{Geometry, Steering};
use crate::traffic::{Mover, Traffic};
use hindrance::Lookout;
use rescue::{Rescue, Situation};

mod hindrance;
mod lamps;
mod rescue;

pub use hindrance::Wait;
pub use lamps::{LAMP_BRAKE, LAMP_LEFT, LAMP_REVERSE, LAMP_RIGHT};

/// Smallest distance for which a path is planned ahead, metres.
const HORIZON_M: f64 = 90.0;
/// A vehicle counts as standing below this, m/s.
pub(crate) const STANDING_MPS: f64 = 0.3;
/// How far before a junction a driver waits for its turn, metres; long vehicles that leave the
/// junction swing out there.
const WAITING_M: f64 = 2.5;
/// The next junction on the path, or the one the vehicle is in.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// The junction.
    pub junction: u32,
    /// Path length at which it begins and at which it is left, metres.
    pub arc_m: [f64; 2],
    /// Change of direction within, radians, positive to the left.
    pub turn_rad: f64,
    /// Whether a traffic light guards this way.
    pub has_light: bool,
}

/// State of one driver.
#[derive(Clone, Debug)]
pub struct Driver {
    id: u32,
    speed_factor: f64,
    path: Path,
    foot: Foot,
    steering: Steering,
    pedals: Pedals,
    rescue: Rescue,
    wait: Wait,
    /// The actor that blocks the way, while the vehicle stands because of it.
    blocked_by: Option<u32>,
    blocked_secs: f64,
    entry: Option<Entry>,
    /// Whether it may enter the next junction; the fleet decides.
    pub(crate) may_enter: bool,
}

impl Driver {
    /// A driver for `me` on the lane it stands on; `None` if no lane is near.
    pub fn new(map: &RoadMap, me: &Mover, seed: u64, speed_factor: f64) -> Option<Driver> {
        let at = locate(map, me)?;
        let path = Path::new(
            map,
            at,
            Noise::new(seed, u64::from(me.id), 0x64_72_69_76_65),
            0,
        )?;
        let wheelbase_m = if me.half_m[0] < 1.3 {
            1.2 * me.half_m[0]
        } else {
            1.16 * me.half_m[0]
        };
        Some(Driver {
            id: me.id,
            speed_factor,
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
            entry: None,
            may_enter: true,
        })
    }

    /// Sets the true geometry of the vehicle, where it is known.
    pub fn set_geometry(&mut self, geometry: Geometry) {
        self.steering = Steering::new(geometry);
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
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

    /// The actor that keeps the vehicle from driving on, and for how long, in seconds; `None` while
    /// it moves.
    pub fn blocked_by(&self) -> Option<(u32, f64)> {
        self.blocked_by.map(|id| (id, self.blocked_secs))
    }

    /// Whether it is backing off.
    pub fn is_reversing(&self) -> bool {
        self.rescue.is_reversing()
    }

    /// Makes it back off a little in its own lane, so that another vehicle gets past.
    pub(crate) fn make_room(&mut self) {
        self.rescue.make_room();
    }

    /// The next junction, or the one it is in.
    pub fn entry(&self) -> Option<Entry> {
        self.entry
    }

    /// Whether more than its nose is inside a junction.
    pub(crate) fn is_inside(&self, traffic: &Traffic) -> bool {
        let Some((entry, me)) = self.entry.zip(traffic.mover(self.id)) else {
            return false;
        };
        self.foot.arc_m + me.front_m() > entry.arc_m[0] + WAITING_M
    }

    /// The lane it is on.
    pub fn lane(&self) -> Option<LaneKey> {
        self.path
            .legs()
            .get(self.path.leg_at(self.foot.arc_m))
            .map(|leg| leg.lane)
    }

    /// Finds its place on the path; plans a new path if it is not on it.
    pub fn localise(&mut self, map: &RoadMap, me: &Mover, seed: u64) {
        let point = [me.position_m[0], me.position_m[1]];
        self.foot = self
            .path
            .project(point, self.foot.arc_m - 10.0, self.foot.arc_m + 20.0);
        let lost =
            self.foot.offset_m.abs() > 3.5 || wrap(self.foot.heading_rad - me.yaw_rad).abs() > 1.9;
        if lost && let Some(at) = locate(map, me) {
            let n = self.path.n_choices() + 1;
            if let Some(path) = Path::new(
                map,
                at,
                Noise::new(seed, u64::from(self.id), 0x64_72_69_76_65),
                n,
            ) {
                self.path = path;
                self.steering.reset();
                self.foot = self.path.project(point, 0.0, 40.0);
            }
        }
        let until = self.foot.arc_m + HORIZON_M.max(6.0 * me.speed_mps);
        self.path.extend(map, self.foot.arc_m, until);
        self.entry = self.find_entry(map, me);
    }

    fn find_entry(&self, map: &RoadMap, me: &Mover) -> Option<Entry> {
        let legs = self.path.legs();
        let rear = self.foot.arc_m - me.rear_m();
        let first = legs
            .iter()
            .position(|leg| leg.arc_m[1] > rear && leg.junction.is_some())?;
        let junction = legs[first].junction?;
        let n = legs[first..]
            .iter()
            .take_while(|leg| leg.junction == Some(junction))
            .count();
        let arc_m = [legs[first].arc_m[0], legs[first + n - 1].arc_m[1]];
        let turn_rad = wrap(
            self.path.at(arc_m[1] - 0.1).heading_rad - self.path.at(arc_m[0] + 0.1).heading_rad,
        );
        let before = first.checked_sub(1).map(|idx| &legs[idx]);
        let guarded = |lane: LaneKey| {
            map.signal_stops(lane)
                .any(|(signal, _)| signal.kind == SignalKind::TrafficLight)
        };
        let has_light = guarded(legs[first].lane) || before.is_some_and(|leg| guarded(leg.lane));
        Some(Entry {
            junction,
            arc_m,
            turn_rad,
            has_light,
        })
    }

    /// What to do in this tick.
    pub fn control(
        &mut self,
        map: &RoadMap,
        me: &Mover,
        traffic: &Traffic,
    ) -> VehicleControlRecord {
        let dt = traffic.period_secs;
        if self.rescue.is_reversing() {
            return self
                .rescue
                .reverse(me, traffic, self.foot, &mut self.steering);
        }
        let creeping = self.rescue.is_creeping();
        let front = self.foot.arc_m + me.front_m();
        let obstacle = self
            .lookout(me)
            .obstacle(traffic, if creeping { 0.15 } else { 0.3 });
        let mut wanted = self.road_speed(me, front);
        let mut wait = Wait::No;
        // A vehicle that is already past the waiting line stops where it is: the line must not make
        // it brake hard.
        let waiting_line = |line: f64| match self.entry {
            Some(entry) if line < entry.arc_m[0] + WAITING_M => {
                line.min((entry.arc_m[0] - WAITING_M).max(front))
            }
            _ => line,
        };
        let mut consider = |accel: f64, why: Wait| {
            if accel < wanted {
                wanted = accel;
                wait = why;
            }
        };
        let end = self.path.end();
        if end.is_dead_end {
            consider(
                speed::stop_before(me.speed_mps, end.arc_m - front),
                Wait::End,
            );
        }
        if let Some(line) = self.light_line(map, traffic, me, front) {
            consider(
                speed::stop_before(me.speed_mps, waiting_line(line) - front),
                Wait::Light,
            );
        }
        if let Some(entry) = self.entry
            && !self.may_enter
            && front < entry.arc_m[0] + 1.0
        {
            consider(
                speed::stop_before(me.speed_mps, waiting_line(entry.arc_m[0]) - front),
                Wait::Turn,
            );
        }
        if let Some(obstacle) = obstacle {
            let gap = if creeping { 0.8 } else { 2.2 };
            consider(
                speed::follow(me.speed_mps, obstacle.along_mps, obstacle.gap_m, gap),
                Wait::Ahead,
            );
        }
        if creeping {
            wanted = wanted.min(speed::towards(me.speed_mps, 1.5));
        }
        self.wait = wait;
        let blocker = obstacle
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
                obstacle,
            },
            traffic,
        );
        let (throttle, brake) = self.pedals.press(me.speed_mps, wanted, dt);
        let steer = self
            .steering
            .ratio(me, &self.path, self.foot, self.side_offset(me), dt);
        let control = VehicleControl {
            throttle_ratio: throttle as f32,
            steer_ratio: steer as f32,
            brake_ratio: brake as f32,
            ..VehicleControl::default()
        };
        let mut record = VehicleControlRecord::new(self.id, control);
        record.lamps = self.blinkers(front) | if brake > 0.02 { LAMP_BRAKE } else { 0 };
        record
    }

    /// Acceleration that speed limits and bends allow, here and as far ahead as braking reaches.
    fn road_speed(&self, me: &Mover, front: f64) -> f64 {
        let v = me.speed_mps;
        let reach = front + 10.0 + v * v / 2.5;
        let mut wanted = f64::INFINITY;
        let rear = self.foot.arc_m - 0.5 * me.rear_m();
        for point in self.path.points() {
            if point.arc_m < rear {
                continue;
            }
            if point.arc_m > reach {
                break;
            }
            let limit =
                (self.speed_factor * point.limit_mps).min(speed::on_bend(point.curvature_per_m));
            let accel = if point.arc_m <= front {
                speed::towards(v, limit)
            } else {
                speed::ahead(v, limit, point.arc_m - front).max(-4.0)
            };
            wanted = wanted.min(accel);
        }
        if wanted.is_finite() {
            wanted
        } else {
            speed::towards(v, 5.0)
        }
    }

    /// Path length of the first stop line whose light says stop.
    fn light_line(&self, map: &RoadMap, traffic: &Traffic, me: &Mover, front: f64) -> Option<f64> {
        let legs = self.path.legs();
        let here = self.path.leg_at(self.foot.arc_m);
        // A vehicle inside a junction clears it whatever the light.
        if legs[here].junction.is_some() {
            return None;
        }
        let mut line: Option<f64> = None;
        for (idx, leg) in legs.iter().enumerate().skip(here) {
            if leg.arc_m[0] > front + 80.0 {
                break;
            }
            for (signal, stop) in map.signal_stops(leg.lane) {
                if signal.kind != SignalKind::TrafficLight {
                    continue;
                }
                let state = traffic
                    .lights
                    .get(&signal.id)
                    .copied()
                    .unwrap_or(LightState::Off);
                if !matches!(state, LightState::Red | LightState::Yellow) {
                    continue;
                }
                let on = [Some(leg), idx.checked_sub(1).map(|i| &legs[i])]
                    .into_iter()
                    .flatten()
                    .find(|l| l.lane == stop.stop.lane);
                let Some(arc) = on.map(|l| l.arc_at_m(stop.stop.s_m)) else {
                    continue;
                };
                let distance = arc - front;
                let needed = speed::to_stop(me.speed_mps, distance.max(0.0));
                let too_late = if state == LightState::Yellow {
                    -3.0
                } else {
                    -7.0
                };
                if distance > -3.0 && needed > too_late {
                    line = Some(line.map_or(arc, |l| l.min(arc)));
                }
            }
        }
        line
    }

    fn lookout<'d>(&'d self, me: &'d Mover) -> Lookout<'d> {
        Lookout {
            me,
            path: &self.path,
            foot: self.foot,
            wheelbase_m: self.steering.wheelbase_m(),
        }
    }

    /// Offset from the middle of the path, metres: towards the inside of a bend if the front swings
    /// out, and away from what was in the way.
    fn side_offset(&self, me: &Mover) -> f64 {
        self.lookout(me).inside_m() + self.rescue.aside_m(self.foot.arc_m)
    }

    fn blinkers(&self, front: f64) -> u32 {
        match self.entry {
            Some(entry) if entry.arc_m[0] - front < 30.0 && entry.turn_rad > 0.45 => LAMP_LEFT,
            Some(entry) if entry.arc_m[0] - front < 30.0 && entry.turn_rad < -0.45 => LAMP_RIGHT,
            _ => 0,
        }
    }
}

/// The lane a vehicle drives on: the nearest one that runs its way.
pub fn locate(map: &RoadMap, me: &Mover) -> Option<LanePosition> {
    let mut wrong: Vec<LaneKey> = Vec::new();
    let mut fallback = None;
    for _ in 0..8 {
        let at = map.nearest(me.position_m, |lane| {
            lane.kind.is_drivable() && !wrong.contains(&lane.key)
        })?;
        let heading = map.pose(at)?.rotation.euler_angles().2;
        if wrap(heading - me.yaw_rad).abs() < 0.8 {
            return Some(at);
        }
        fallback = fallback.or(Some(at));
        wrong.push(at.lane);
    }
    fallback
}
