//! What a driver does when nothing moves: wait, back off, make room.

use schema_frames::{VehicleControl, VehicleControlRecord};

use super::{Driver, LAMP_REVERSE, Obstacle, STUCK_SECS, Wait, forward_share};
use crate::path::wrap;
use crate::world::{Mover, World};

/// How long a driver reverses, seconds.
const REVERSE_SECS: f64 = 4.0;
/// How long it does so to let somebody pass, seconds.
const YIELD_SECS: f64 = 3.0;
/// How fast, m/s.
const REVERSE_MPS: f64 = 1.2;
/// How far a driver keeps to the side of what it backed off from, metres.
const AVOID_M: f64 = 0.7;

impl Driver {
    /// Notices that nothing moves although it should.
    pub(super) fn watch(
        &mut self,
        me: &Mover,
        world: &World,
        wanted: f64,
        obstacle: Option<Obstacle>,
        dt: f64,
    ) {
        if me.speed_mps.abs() > 0.5 {
            self.stuck_secs = (self.stuck_secs - 2.0 * dt).max(0.0);
            if me.speed_mps > 2.0 {
                (self.stuck_secs, self.n_rescues) = (0.0, 0);
            }
            return;
        }
        let pushing = wanted > 0.3;
        // A queue has a reason of its own; who blocks us across or head-on has not.
        let blocked = self.wait == Wait::Ahead
            && obstacle.and_then(|o| world.mover(o.id)).is_some_and(|o| {
                wrap(
                    o.yaw_rad
                        - self
                            .path
                            .at(self.foot.arc_m + me.front_m() + 2.0)
                            .heading_rad,
                )
                .abs()
                    > 0.6
            });
        if !pushing && !blocked {
            if self.wait != Wait::Ahead {
                self.stuck_secs = 0.0;
            }
            return;
        }
        self.stuck_secs += dt;
        // Ids differ, so two that block each other do not back off at once.
        let patience = 2.0 * STUCK_SECS + f64::from(self.id % 7) + if pushing { 0.0 } else { 6.0 };
        if self.stuck_secs > patience && self.room_behind(me, world) {
            (self.reverse_left_secs, self.is_yielding) = (REVERSE_SECS, false);
            let side = obstacle.map_or(0.0, |o| o.side);
            self.avoid = (-AVOID_M * side, self.foot.arc_m + 25.0);
            self.n_rescues += 1;
            self.stuck_secs = 0.0;
        }
    }

    fn room_behind(&self, me: &Mover, world: &World) -> bool {
        self.behind(me, world, 1.5).is_none()
    }

    /// Who is less than this behind it.
    pub(crate) fn behind(&self, me: &Mover, world: &World, room_m: f64) -> Option<u32> {
        let mut ghost = me.clone();
        ghost.half_m[0] += room_m;
        ghost.centre_m[0] -= room_m;
        let is_behind = |other: &&Mover| {
            other.id != me.id && ghost.overlaps(other, 0.2) && forward_share(me, other) < 0.0
        };
        world.movers.iter().find(is_behind).map(|other| other.id)
    }

    /// Backs off, steering the other way, then plans anew.
    pub(super) fn reverse(&mut self, me: &Mover, world: &World) -> VehicleControlRecord {
        let dt = world.period_secs;
        self.reverse_left_secs -= dt;
        let room_m = if self.is_yielding { 0.6 } else { 1.5 };
        let clear = self.behind(me, world, room_m).is_none() && me.speed_mps > -REVERSE_MPS;
        let aside = if self.foot.offset_m > 0.0 { 0.4 } else { -0.4 };
        let steer = self
            .steering
            .hold(if self.is_yielding { 0.0 } else { aside }, dt);
        let control = VehicleControl {
            throttle_ratio: if clear { 0.35 } else { 0.0 },
            brake_ratio: if clear && self.reverse_left_secs > 0.4 {
                0.0
            } else {
                0.3
            },
            steer_ratio: steer as f32,
            reverse: true,
            ..VehicleControl::default()
        };
        let mut record = VehicleControlRecord::new(self.id, control);
        record.lamps = LAMP_REVERSE;
        record
    }

    /// Backs off a little in its own lane, so that somebody else gets past.
    pub(crate) fn make_room(&mut self) {
        (self.reverse_left_secs, self.is_yielding) = (YIELD_SECS, true);
    }
}
