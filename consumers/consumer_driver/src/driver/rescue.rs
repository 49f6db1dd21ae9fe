//! What a driver does when nothing moves: wait, back off, make room.

use schema_frames::{VehicleControl, VehicleControlRecord};

use super::hindrance::{Obstacle, Wait};
use super::lamps::LAMP_REVERSE;
use crate::lanes::path::{Foot, Path};
use crate::plane::wrap;
use crate::steer::Steering;
use crate::traffic::{Grid, Mover, Traffic};

/// A driver that has stood this long without a reason helps itself, seconds.
const STUCK_SECS: f64 = 6.0;
/// How long a driver reverses, seconds.
const REVERSE_SECS: f64 = 4.0;
/// How long it reverses to let another vehicle pass, seconds.
const YIELD_SECS: f64 = 3.0;
/// How fast it reverses, m/s.
const REVERSE_MPS: f64 = 1.2;
/// Offset to the side of the obstacle that a driver backed off from, metres.
const AVOID_M: f64 = 0.7;

/// What a driver has decided in a tick, and why.
pub(super) struct Situation<'d> {
    pub me: &'d Mover,
    pub path: &'d Path,
    pub foot: Foot,
    pub wait: Wait,
    pub wanted_mps2: f64,
    pub obstacle: Option<Obstacle>,
}

/// How long a driver has stood without a reason, and how it gets going again.
#[derive(Clone, Debug, Default)]
pub(super) struct Rescue {
    stuck_secs: f64,
    reverse_left_secs: f64,
    /// Whether it backs off for another vehicle, in its own lane.
    is_yielding: bool,
    /// Offset to keep from the path after backing off, metres, positive to the left.
    avoid_m: f64,
    /// Path length up to which that offset is kept, metres.
    avoid_until_m: f64,
    n_rescues: u32,
}

impl Rescue {
    /// Whether it has stood so long that it tries to creep past.
    pub fn is_creeping(&self) -> bool {
        self.stuck_secs > STUCK_SECS
    }

    pub fn is_reversing(&self) -> bool {
        self.reverse_left_secs > 0.0
    }

    /// How often it backed off since it last drove freely.
    pub fn n_rescues(&self) -> u32 {
        self.n_rescues
    }

    /// Offset to keep from the path at a path length, metres.
    pub fn aside_m(&self, arc_m: f64) -> f64 {
        if arc_m < self.avoid_until_m {
            self.avoid_m
        } else {
            0.0
        }
    }

    /// Notices that nothing moves although it should.
    pub fn watch(&mut self, situation: &Situation, traffic: &Traffic, grid: &Grid) {
        let Situation {
            me,
            path,
            foot,
            wait,
            wanted_mps2,
            obstacle,
        } = *situation;
        let dt = traffic.period_secs;
        if me.speed_mps.abs() > 0.5 {
            self.stuck_secs = (self.stuck_secs - 2.0 * dt).max(0.0);
            if me.speed_mps > 2.0 {
                (self.stuck_secs, self.n_rescues) = (0.0, 0);
            }
            return;
        }
        let pushing = wanted_mps2 > 0.3;
        // A vehicle that queues ahead has its own reason to stand; one that stands across our path
        // or head-on blocks us.
        let blocked = wait == Wait::Ahead
            && obstacle.and_then(|o| traffic.mover(o.id)).is_some_and(|o| {
                wrap(o.yaw_rad - path.at(foot.arc_m + me.front_m() + 2.0).heading_rad).abs() > 0.6
            });
        if !pushing && !blocked {
            if wait != Wait::Ahead {
                self.stuck_secs = 0.0;
            }
            return;
        }
        self.stuck_secs += dt;
        // The id makes the patience differ, so that two vehicles that block each other do not back
        // off at the same time.
        let patience =
            2.0 * STUCK_SECS + f64::from(me.number % 7) + if pushing { 0.0 } else { 6.0 };
        if self.stuck_secs > patience && traffic.behind(me, 1.5, grid).is_none() {
            (self.reverse_left_secs, self.is_yielding) = (REVERSE_SECS, false);
            let side = obstacle.map_or(0.0, |o| o.side);
            (self.avoid_m, self.avoid_until_m) = (-AVOID_M * side, foot.arc_m + 25.0);
            self.n_rescues += 1;
            self.stuck_secs = 0.0;
        }
    }

    /// Backs off, steering the other way, then plans anew.
    pub fn reverse(
        &mut self,
        me: &Mover,
        traffic: &Traffic,
        grid: &Grid,
        foot: Foot,
        steering: &mut Steering,
        updates_lights: bool,
    ) -> VehicleControlRecord {
        let dt = traffic.period_secs;
        self.reverse_left_secs -= dt;
        // Room for braking and for somebody who backs off too.
        let room_m = if self.is_yielding { 1.0 } else { 1.5 } + 1.2 * me.speed_mps.abs();
        let is_free = traffic.behind(me, room_m, grid).is_none();
        let clear = is_free && me.speed_mps > -REVERSE_MPS;
        let aside = if foot.offset_m > 0.0 { 0.4 } else { -0.4 };
        let steer = steering.hold(if self.is_yielding { 0.0 } else { aside }, dt);
        let control = VehicleControl {
            throttle_ratio: if clear { 0.35 } else { 0.0 },
            brake_ratio: if clear && self.reverse_left_secs > 0.4 {
                0.0
            } else {
                if is_free { 0.3 } else { 1.0 }
            },
            steer_ratio: steer as f32,
            reverse: true,
            ..VehicleControl::default()
        };
        let mut record = VehicleControlRecord::new(me.id, control);
        if updates_lights {
            record.lamps = LAMP_REVERSE;
        }
        record
    }

    /// Backs off a little in its own lane, so that somebody else gets past.
    pub fn make_room(&mut self) {
        (self.reverse_left_secs, self.is_yielding) = (YIELD_SECS, true);
    }
}
