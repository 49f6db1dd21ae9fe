//! From what keys and mouse ask for to poses of the spectator: free flight, behind an actor, from
//! above.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

use consumer_kit::WorldAt;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use schema_frames::{ActorKind, ActorList, ActorRecord};
use schema_types::Pose;

use crate::input::{Held, Input};

/// Speed at first, and its limits, m/s.
const SPEED_MPS: Scale = Scale::new(10.0, [0.5, 500.0]);
/// Distance behind an actor at first, and its limits, metres.
const DISTANCE_M: Scale = Scale::new(8.0, [2.0, 200.0]);
/// Height of the top view at first, and its limits, metres.
const HEIGHT_M: Scale = Scale::new(50.0, [5.0, 2000.0]);
/// What Shift multiplies the speed by.
const FAST_RATIO: f64 = 4.0;
/// What one notch of the wheel multiplies by.
const NOTCH_RATIO: f64 = 1.2;
/// Speed of looking around by keys, rad/s.
const TURN_RADPS: f64 = 1.2;
/// Steepest view up or down, radians.
const MAX_PITCH_RAD: f64 = 1.55;
/// How the view behind an actor looks down at first, radians.
const CHASE_PITCH_RAD: f64 = 0.3;
/// Time in which the view behind an actor turns with it, seconds.
const CHASE_SECS: f64 = 0.3;
/// Point above an actor's origin that the view behind it looks at, metres.
const LOOK_ABOVE_M: f64 = 1.2;
/// How long after the last key a pose that others set is taken over, seconds.
const HANDS_OFF_SECS: f64 = 0.7;
/// A move that is smaller is none: metres and radians.
const LEAST_MOVE: f64 = 1e-6;

/// State of a flight.
#[derive(Debug)]
pub struct Pilot {
    held: BTreeSet<Held>,
    position_m: Vector3<f64>,
    /// Heading, counter-clockwise from world x.
    yaw_rad: f64,
    /// Positive looks down.
    pitch_rad: f64,
    speed_mps: f64,
    /// Actor that is followed, and the view's turn around it from behind.
    followed: Option<u32>,
    around_rad: f64,
    chase_pitch_rad: f64,
    /// Heading of the followed actor, smoothed.
    chased_yaw_rad: Option<f64>,
    distance_m: f64,
    from_above: bool,
    height_m: f64,
    /// Time since a key or the mouse acted, seconds.
    idle_secs: f64,
    /// What was asked for since the last step.
    turned_rad: [f64; 2],
    notches: f64,
    follow_steps: i64,
    /// Actor that was asked for by its id since the last step.
    wanted: Option<u32>,
    has_pose: bool,
    sent: Option<Pose>,
    /// Tick of the newest world when it was sent.
    sent_tick: u64,
    episode: u32,
    names: BTreeMap<u32, String>,
    egos: BTreeSet<u32>,
}

impl Default for Pilot {
    fn default() -> Self {
        Pilot {
            held: BTreeSet::new(),
            position_m: Vector3::zeros(),
            yaw_rad: 0.0,
            pitch_rad: 0.0,
            speed_mps: SPEED_MPS.first,
            followed: None,
            around_rad: 0.0,
            chase_pitch_rad: CHASE_PITCH_RAD,
            chased_yaw_rad: None,
            distance_m: DISTANCE_M.first,
            from_above: false,
            height_m: HEIGHT_M.first,
            idle_secs: f64::INFINITY,
            turned_rad: [0.0; 2],
            notches: 0.0,
            follow_steps: 0,
            wanted: None,
            has_pose: false,
            sent: None,
            sent_tick: 0,
            episode: 0,
            names: BTreeMap::new(),
            egos: BTreeSet::new(),
        }
    }
}

impl Pilot {
    /// Takes over what actors are called.
    pub fn set_actors(&mut self, list: &ActorList) {
        let is_ego = |role: &str| ["ego_vehicle", "hero"].contains(&role);
        let actors = || list.actors.iter();
        self.egos = actors()
            .filter(|actor| is_ego(&actor.role))
            .map(|actor| actor.id)
            .collect();
        self.names = actors()
            .map(|actor| (actor.id, format!("{} {}", actor.type_id, actor.id)))
            .collect();
    }

    /// Takes note of what a key or the mouse asks for; [`Pilot::advance`] acts on it.
    pub fn take(&mut self, input: Input) {
        match input {
            Input::Hold(key, true) => drop(self.held.insert(key)),
            Input::Hold(key, false) => drop(self.held.remove(&key)),
            Input::ReleaseAll => self.held.clear(),
            Input::Turn { yaw_rad, pitch_rad } => {
                self.turned_rad[0] += yaw_rad;
                self.turned_rad[1] += pitch_rad;
            }
            Input::Wheel(notches) => self.notches += notches,
            Input::Follow { next } => self.follow_steps += if next { 1 } else { -1 },
            Input::FollowActor(id) => (self.wanted, self.follow_steps) = (Some(id), 0),
            Input::Free => {
                (self.wanted, self.followed, self.from_above) = (None, None, false);
                self.pitch_rad = self.pitch_rad.min(MAX_PITCH_RAD);
            }
            Input::Top => self.toggle_top(),
            Input::Close => {}
        }
    }

    /// Goes on by `step_secs` in the world as it is now. Returns the pose that the spectator is to
    /// have, or `None` if it stays with whoever else moves it.
    pub fn advance(&mut self, step_secs: f64, world: &WorldAt) -> Option<Pose> {
        if world.header.episode != self.episode {
            self.episode = world.header.episode;
            (self.followed, self.sent, self.has_pose, self.sent_tick) = (None, None, false, 0);
        }
        self.choose(world);
        let turn = self.turn(step_secs);
        let moves = self.moves();
        let notches = std::mem::take(&mut self.notches);
        let is_busy = turn != [0.0; 2] || moves != Vector3::zeros() || notches != 0.0;
        self.idle_secs = if is_busy {
            0.0
        } else {
            self.idle_secs + step_secs
        };
        self.take_over(world);
        let target = self
            .followed
            .and_then(|id| world.records.iter().find(|record| record.id == id))
            .map(|record| ahead(record, world.header.period_nanos as f64 * 1e-9));
        if target.is_none() {
            self.followed = None;
        }
        match (target, self.from_above) {
            (target, true) => self.look_down(step_secs, turn, moves, notches, target),
            (Some(target), false) => self.chase(step_secs, turn, moves, notches, &target),
            (None, false) => self.fly(step_secs, turn, moves, notches),
        }
        self.move_to_send(world.header.tick)
    }

    /// Mode, place and speed in words.
    pub fn describe(&self) -> String {
        let name = |id: &u32| {
            self.names
                .get(id)
                .cloned()
                .unwrap_or_else(|| id.to_string())
        };
        let followed = self.followed.as_ref().map(name);
        let [x, y, z] = <[f64; 3]>::from(self.position_m);
        let at = format!("x {x:.1} y {y:.1} z {z:.1} m");
        match (followed, self.from_above) {
            (Some(name), false) => format!("behind {name} | {at}"),
            (Some(name), true) => format!("above {name} | {at}"),
            (None, true) => format!("from above | {at}"),
            (None, false) => format!("free, {:.1} m/s | {at}", self.speed_mps),
        }
    }

    fn toggle_top(&mut self) {
        self.from_above = !self.from_above;
        if self.from_above {
            // What was in the middle of the view stays there.
            if self.followed.is_none() && self.pitch_rad > 0.1 {
                let reach_m = (self.position_m.z.max(0.0) / self.pitch_rad.tan()).min(100.0);
                self.position_m += heading(self.yaw_rad) * reach_m;
            }
        } else {
            self.pitch_rad = self.pitch_rad.min(0.8);
        }
    }

    /// Goes on to another actor as often as was asked for.
    fn choose(&mut self, world: &WorldAt) {
        if let Some(id) = self.wanted.take() {
            self.followed = Some(id);
            (self.chased_yaw_rad, self.around_rad) = (None, 0.0);
        }
        let steps = std::mem::take(&mut self.follow_steps);
        let all = self.order(world);
        if steps == 0 || all.is_empty() {
            return;
        }
        let n = all.len() as i64;
        let at = self
            .followed
            .and_then(|id| all.iter().position(|other| *other == id));
        let to = match at {
            Some(at) => (at as i64 + steps).rem_euclid(n),
            None if steps > 0 => (steps - 1).rem_euclid(n),
            None => steps.rem_euclid(n),
        };
        self.followed = Some(all[to as usize]);
        self.chased_yaw_rad = None;
        self.around_rad = 0.0;
    }

    /// Who can be followed: egos first, then vehicles, then walkers.
    fn order(&self, world: &WorldAt) -> Vec<u32> {
        let rank = |record: &ActorRecord| match record.kind()? {
            ActorKind::Vehicle if self.egos.contains(&record.id) => Some(0),
            ActorKind::Vehicle => Some(1),
            ActorKind::Walker => Some(2),
            _ => None,
        };
        let mut all: Vec<(i32, u32)> = world
            .records
            .iter()
            .filter_map(|record| Some((rank(record)?, record.id)))
            .collect();
        all.sort_unstable();
        all.into_iter().map(|(_, id)| id).collect()
    }

    /// By how much to look left and down, from mouse and keys.
    fn turn(&mut self, step_secs: f64) -> [f64; 2] {
        let by_mouse = std::mem::take(&mut self.turned_rad);
        let by_keys = [
            self.axis(Held::TurnLeft, Held::TurnRight),
            self.axis(Held::LookDown, Held::LookUp),
        ];
        [0, 1].map(|i| by_mouse[i] + by_keys[i] * TURN_RADPS * step_secs)
    }

    /// Forward, left and up, each −1..=1, longer with Shift.
    fn moves(&self) -> Vector3<f64> {
        let moves = Vector3::new(
            self.axis(Held::Forward, Held::Back),
            self.axis(Held::Left, Held::Right),
            self.axis(Held::Up, Held::Down),
        );
        let ratio = if self.held.contains(&Held::Fast) {
            FAST_RATIO
        } else {
            1.0
        };
        moves * ratio
    }

    fn axis(&self, plus: Held, minus: Held) -> f64 {
        let is = |key: Held| f64::from(u8::from(self.held.contains(&key)));
        is(plus) - is(minus)
    }

    /// Begins where the spectator is, and goes along with others that move it while no key is held.
    fn take_over(&mut self, world: &WorldAt) {
        // While the world stands still, its newest snapshot does not have the pose that was sent.
        let is_on_its_way = world.header.tick < self.sent_tick + 2;
        let is_ours = self.followed.is_some()
            || self.from_above
            || self.idle_secs < HANDS_OFF_SECS
            || is_on_its_way;
        if self.has_pose && is_ours {
            return;
        }
        let is_spectator = |record: &&ActorRecord| record.kind() == Some(ActorKind::Spectator);
        let Some(record) = world.records.iter().find(is_spectator) else {
            return;
        };
        let pose = record.world_from_actor;
        let forward = pose.isometry().rotation * Vector3::x();
        self.position_m = Vector3::from(pose.translation_m);
        self.pitch_rad = (-forward.z).clamp(-1.0, 1.0).asin();
        if forward.xy().norm() > 1e-3 {
            self.yaw_rad = forward.y.atan2(forward.x);
        }
        self.has_pose = true;
        self.sent = Some(self.pose());
    }

    fn fly(&mut self, step_secs: f64, turn: [f64; 2], moves: Vector3<f64>, notches: f64) {
        self.speed_mps = SPEED_MPS.after(self.speed_mps, notches);
        self.yaw_rad += turn[0];
        if turn[1] != 0.0 {
            self.pitch_rad = (self.pitch_rad + turn[1]).clamp(-MAX_PITCH_RAD, MAX_PITCH_RAD);
        }
        let view = rotation(self.yaw_rad, self.pitch_rad);
        let along = view * Vector3::new(moves.x, moves.y, 0.0) + Vector3::z() * moves.z;
        self.position_m += along * self.speed_mps * step_secs;
    }

    fn chase(
        &mut self,
        step_secs: f64,
        turn: [f64; 2],
        moves: Vector3<f64>,
        notches: f64,
        target: &Target,
    ) {
        // The wheel away from the user comes nearer; W and S do too.
        let nearer = notches + moves.x * step_secs * 5.0;
        self.distance_m = DISTANCE_M.after(self.distance_m, -nearer);
        self.around_rad += turn[0] - moves.y * TURN_RADPS * step_secs;
        self.chase_pitch_rad =
            (self.chase_pitch_rad + turn[1] + moves.z * TURN_RADPS * 0.5 * step_secs)
                .clamp(-0.2, MAX_PITCH_RAD);
        let before = self.chased_yaw_rad.unwrap_or(target.yaw_rad);
        let share = 1.0 - (-step_secs / CHASE_SECS).exp();
        let chased = before + wrapped(target.yaw_rad - before) * share;
        self.chased_yaw_rad = Some(chased);
        self.yaw_rad = chased + self.around_rad;
        self.pitch_rad = self.chase_pitch_rad;
        let view = rotation(self.yaw_rad, self.pitch_rad) * Vector3::x();
        let at = target.position_m + Vector3::z() * LOOK_ABOVE_M;
        self.position_m = at - view * self.distance_m;
    }

    fn look_down(
        &mut self,
        step_secs: f64,
        turn: [f64; 2],
        moves: Vector3<f64>,
        notches: f64,
        target: Option<Target>,
    ) {
        let higher = moves.z * step_secs * 5.0 - notches;
        self.height_m = HEIGHT_M.after(self.height_m, higher);
        self.yaw_rad += turn[0];
        self.pitch_rad = FRAC_PI_2;
        let ground_m = match target {
            Some(target) => {
                self.position_m = target.position_m;
                target.position_m.z
            }
            None => {
                let along = rotation(self.yaw_rad, 0.0) * Vector3::new(moves.x, moves.y, 0.0);
                // The same part of the image at any height.
                self.position_m += along * self.height_m * 0.5 * step_secs;
                0.0
            }
        };
        self.position_m.z = ground_m + self.height_m;
    }

    fn pose(&self) -> Pose {
        Pose::from(Isometry3::from_parts(
            Translation3::from(self.position_m),
            rotation(self.yaw_rad, self.pitch_rad),
        ))
    }

    /// The pose if it is another than that sent last.
    fn move_to_send(&mut self, tick: u64) -> Option<Pose> {
        if !self.has_pose {
            return None;
        }
        let pose = self.pose();
        let is_same = self.sent.is_some_and(|sent| {
            let moved = sent.isometry().inverse() * pose.isometry();
            moved.translation.vector.norm() < LEAST_MOVE && moved.rotation.angle() < LEAST_MOVE
        });
        if is_same {
            return None;
        }
        self.sent = Some(pose);
        self.sent_tick = tick;
        Some(pose)
    }
}

/// An actor that is followed, where it will be when the next image is made.
#[derive(Clone, Copy, Debug)]
struct Target {
    position_m: Vector3<f64>,
    yaw_rad: f64,
}

fn ahead(record: &ActorRecord, secs: f64) -> Target {
    let pose = record.world_from_actor.isometry();
    let forward = pose.rotation * Vector3::x();
    Target {
        position_m: pose.translation.vector + Vector3::from(record.velocity_in_world_mps) * secs,
        yaw_rad: forward.y.atan2(forward.x) + record.angular_velocity_in_world_radps[2] * secs,
    }
}

/// Heading and pitch; positive pitch looks down.
fn rotation(yaw_rad: f64, pitch_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad)
        * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), pitch_rad)
}

fn heading(yaw_rad: f64) -> Vector3<f64> {
    Vector3::new(yaw_rad.cos(), yaw_rad.sin(), 0.0)
}

/// A number that the wheel turns up and down.
struct Scale {
    /// Its value at first.
    first: f64,
    /// Its least and greatest value.
    limits: [f64; 2],
}

impl Scale {
    const fn new(first: f64, limits: [f64; 2]) -> Scale {
        Scale { first, limits }
    }

    /// What the wheel makes of a value.
    fn after(&self, value: f64, notches: f64) -> f64 {
        (value * NOTCH_RATIO.powf(notches)).clamp(self.limits[0], self.limits[1])
    }
}

/// The angle within −π..=π.
fn wrapped(angle_rad: f64) -> f64 {
    (angle_rad + PI).rem_euclid(TAU) - PI
}

#[cfg(test)]
#[path = "pilot_tests.rs"]
mod tests;
