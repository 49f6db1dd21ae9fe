//! People on foot: kinematic bodies that walk over the ground, are pushed and knocked down by
//! vehicles, and show it.
//!
//! A walker is no body of the physics engine: it asks the engine where walls and ground are and
//! moves by itself. What a vehicle does to it
//! is an inelastic collision of two masses, so that the vehicle feels it too.

mod bones;
mod crowd;
mod detour;
mod impact;
#[path = "model.rs"]
mod models;
#[path = "standing.rs"]
mod motion;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use schema_frames::{ActorKind, WalkerControl, WalkerPart};
use schema_types::{ActorId, Pose};
use serde::{Deserialize, Serialize};
use simd_body::person::Posture;

pub(crate) use bones::OwnPose;
pub(crate) use crowd::Crowd;
pub use models::{WalkerModel, walker_models};
use motion::{MAX_PIECE_SECS, Standing, eased_mps, ground_below};

use crate::physics::{GRAVITY_MPS2, Physics};
use crate::world::{ActorError, World};

/// How fast a walker turns, rad/s.
const TURN_RADPS: f64 = 9.4;
/// Fastest that a control can ask for, m/s.
pub const MAX_SPEED_MPS: f32 = 15.0;
/// How fast a body falls over, rad/s.
const TOPPLE_RADPS: f64 = 5.5;
/// Height of a lying body's middle, metres.
const LYING_M: f64 = 0.15;
/// Friction of a body that slides over the ground.
const SLIDING_FRICTION: f64 = 0.6;
/// A led walker that is not told where to go stands still after this time, seconds.
const LED_SECS: f64 = 0.3;
/// Longest time that strollers walk on without looking where they go, seconds: no further than they
/// see a corner as reached.
const LEAD_SECS: f64 = 0.2;
/// Farthest below the map that a walker may fall, metres.
const FALL_M: f64 = 500.0;

/// A walker that was knocked down.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Fall {
    /// Horizontal direction in which it was pushed.
    pub towards: [f64; 2],
    /// Angle from upright, radians.
    pub angle_rad: f64,
}

/// A walker's state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Walker {
    /// Index into [`walker_models`].
    pub model_idx: u16,
    pub control: WalkerControl,
    /// Point between the feet, world, metres.
    pub feet_m: [f64; 3],
    pub yaw_rad: f64,
    pub yaw_radps: f64,
    /// Velocity over the last tick, m/s.
    pub velocity_mps: [f64; 3],
    /// Horizontal velocity that a vehicle gave it, m/s; dies away.
    pub pushed_mps: [f64; 2],
    pub rise_mps: f64,
    pub on_ground: bool,
    pub gait_rad: f64,
    pub gait_mps: f64,
    pub fall: Option<Fall>,
    pub invincible: bool,
    pub seated: bool,
    /// Moves by its control, under gravity; not while somebody leads it.
    pub simulated: bool,
    /// Is stopped by walls and hit by vehicles.
    pub collides: bool,
    /// Speed that whoever leads it says, and seconds since.
    pub led: Option<(f64, f64)>,
    /// Where it was at the end of the last tick.
    pub last_feet_m: [f64; 3],
    /// Fell out of the world.
    pub lost: bool,
    /// Bones that somebody holds.
    pub own_pose: Option<OwnPose>,
}

impl Walker {
    pub fn new(model_idx: u16, feet_m: [f64; 3], yaw_rad: f64) -> Walker {
        Walker {
            model_idx,
            control: WalkerControl::default(),
            feet_m,
            yaw_rad,
            yaw_radps: 0.0,
            velocity_mps: [0.0; 3],
            pushed_mps: [0.0; 2],
            rise_mps: 0.0,
            on_ground: false,
            gait_rad: 0.0,
            gait_mps: 0.0,
            fall: None,
            invincible: true,
            seated: false,
            simulated: true,
            collides: true,
            led: None,
            last_feet_m: feet_m,
            lost: false,
            own_pose: None,
        }
    }

    pub fn model(&self) -> &'static WalkerModel {
        &walker_models()[self.model_idx as usize]
    }

    pub fn standing(&self) -> Standing {
        let model = self.model();
        Standing {
            feet_m: self.feet_m.into(),
            radius_m: model.radius_m(),
            height_m: model.shape.height_m,
            rise_mps: self.rise_mps,
            on_ground: self.on_ground,
        }
    }

    fn set_standing(&mut self, standing: &Standing) {
        self.feet_m = standing.feet_m.into();
        (self.rise_mps, self.on_ground) = (standing.rise_mps, standing.on_ground);
    }

    /// Pose of the middle of the body.
    pub fn pose(&self) -> Isometry3<f64> {
        let half_m = 0.5 * self.model().shape.height_m;
        let upright = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.yaw_rad);
        let (rotation, middle_m) = match self.fall {
            None => (upright, half_m),
            Some(fall) => {
                let axis = nalgebra::Unit::new_normalize(Vector3::new(
                    -fall.towards[1],
                    fall.towards[0],
                    0.0,
                ));
                let turn = UnitQuaternion::from_axis_angle(&axis, fall.angle_rad);
                (
                    turn * upright,
                    half_m * fall.angle_rad.cos() + LYING_M * fall.angle_rad.sin(),
                )
            }
        };
        let [x, y, z] = self.feet_m;
        Isometry3::from_parts(Translation3::new(x, y, z + middle_m), rotation)
    }

    /// What the limbs do.
    pub fn posture(&self) -> Posture {
        if self.fall.is_some_and(|fall| fall.angle_rad > 0.4) {
            Posture::Lying
        } else if self.seated {
            Posture::Seated
        } else if !self.on_ground && self.simulated {
            Posture::Airborne
        } else {
            Posture::Upright {
                phase_rad: self.gait_rad,
                speed_mps: self.gait_mps,
            }
        }
    }

    /// Puts its feet somewhere and lets it stand up.
    fn put(&mut self, feet_m: Vector3<f64>, yaw_rad: f64) {
        (self.feet_m, self.yaw_rad) = (feet_m.into(), yaw_rad);
        (self.rise_mps, self.pushed_mps, self.fall, self.lost) = (0.0, [0.0; 2], None, false);
    }

    /// One piece of time of a walker that moves by itself.
    fn walk(&mut self, physics: &Physics, dt_secs: f64) {
        let mut standing = self.standing();
        let wish = self.wish_mps();
        if let Some(fall) = &mut self.fall {
            fall.angle_rad =
                (fall.angle_rad + TOPPLE_RADPS * dt_secs).min(std::f64::consts::FRAC_PI_2);
        } else if self.control.jump {
            standing.jump();
        }
        let pushed = Vector3::new(self.pushed_mps[0], self.pushed_mps[1], 0.0);
        let velocity = if self.fall.is_some() {
            pushed
        } else {
            wish + pushed
        };
        standing.step(physics, velocity, dt_secs, self.collides);
        // A body that slides is slowed by friction; one that stands catches itself faster.
        let friction = if self.fall.is_some() {
            SLIDING_FRICTION
        } else {
            2.0 * SLIDING_FRICTION
        };
        let slowed = if standing.on_ground {
            pushed.norm() - friction * GRAVITY_MPS2 * dt_secs
        } else {
            pushed.norm()
        };
        let kept = pushed
            .try_normalize(1e-9)
            .map_or(Vector3::zeros(), |way| way * slowed.max(0.0));
        self.pushed_mps = [kept.x, kept.y];
        self.set_standing(&standing);
        if self.fall.is_none() && wish.norm() > 1e-3 {
            self.turn_to(wish.y.atan2(wish.x), dt_secs);
        }
    }

    /// Horizontal velocity that its control asks for.
    fn wish_mps(&self) -> Vector3<f64> {
        let [x, y, _] = self.control.direction.map(f64::from);
        let direction = Vector3::new(x, y, 0.0)
            .try_normalize(1e-6)
            .unwrap_or_default();
        direction * f64::from(self.control.speed_mps)
    }

    fn turn_to(&mut self, yaw_rad: f64, dt_secs: f64) {
        use std::f64::consts::{PI, TAU};
        let away = (yaw_rad - self.yaw_rad + PI).rem_euclid(TAU) - PI;
        let turn = away.clamp(-TURN_RADPS * dt_secs, TURN_RADPS * dt_secs);
        self.yaw_rad = (self.yaw_rad + turn + PI).rem_euclid(TAU) - PI;
    }

    /// After a tick: velocity, and the limbs by the way gone.
    fn finish(&mut self, yaw_before_rad: f64, dt_secs: f64) {
        use std::f64::consts::{PI, TAU};
        let moved = Vector3::from(self.feet_m) - Vector3::from(self.last_feet_m);
        let way_m = moved.xy().norm();
        self.last_feet_m = self.feet_m;
        let mut speed_mps = way_m / dt_secs;
        if let Some((led_mps, secs)) = &mut self.led {
            speed_mps = if *secs < LED_SECS { *led_mps } else { 0.0 };
            *secs += dt_secs;
        }
        // What jumps further than anybody runs was put there.
        let jumped = moved.norm() > f64::from(MAX_SPEED_MPS) * dt_secs + 0.5;
        self.velocity_mps = if jumped {
            [0.0; 3]
        } else {
            (moved / dt_secs).into()
        };
        self.yaw_radps = if jumped {
            0.0
        } else {
            ((self.yaw_rad - yaw_before_rad + PI).rem_euclid(TAU) - PI) / dt_secs
        };
        if self.fall.is_some() || jumped || (self.simulated && !self.on_ground) {
            return;
        }
        self.gait_mps = eased_mps(
            self.gait_mps,
            speed_mps.min(f64::from(MAX_SPEED_MPS)),
            dt_secs,
        );
        let stride_m = self.model().shape.skeleton().stride_m(self.gait_mps);
        self.gait_rad = (self.gait_rad + TAU * way_m / stride_m).rem_euclid(TAU);
    }

    /// What the snapshot says.
    pub fn part(&self) -> WalkerPart {
        let flag = |bit: u32, on: bool| if on { bit } else { 0 };
        WalkerPart {
            direction: self.control.direction,
            speed_mps: self.control.speed_mps,
            gait_rad: self.gait_rad as f32,
            flags: flag(WalkerPart::JUMP, self.control.jump)
                | flag(WalkerPart::DOWN, self.fall.is_some())
                | flag(WalkerPart::AIRBORNE, self.simulated && !self.on_ground)
                | flag(WalkerPart::SEATED, self.seated),
            gait_mps: self.gait_mps as f32,
            reserved: [0; 68],
        }
    }
}

impl World {
    /// Leads the strollers and moves the walkers by one tick, after the vehicles; a long tick in
    /// pieces, so that nobody walks past a corner.
    pub(crate) fn move_walkers(&mut self, dt_secs: f64) {
        let n_leads = (dt_secs / LEAD_SECS - 1e-9).ceil().max(1.0) as u32;
        let yaws_before_rad: Vec<f64> =
            self.walkers.values().map(|walker| walker.yaw_rad).collect();
        for _ in 0..n_leads {
            self.lead_crowd(dt_secs / f64::from(n_leads));
            self.walk_all(dt_secs / f64::from(n_leads));
        }
        for (walker, yaw_before_rad) in self.walkers.values_mut().zip(yaws_before_rad) {
            walker.finish(yaw_before_rad, dt_secs);
        }
        self.part_walkers();
    }

    /// Whoever moves by itself walks on for one piece of a tick.
    fn walk_all(&mut self, dt_secs: f64) {
        let n_pieces = (dt_secs / MAX_PIECE_SECS - 1e-9).ceil().max(1.0) as u32;
        let piece_secs = dt_secs / f64::from(n_pieces);
        let floor_m = self.map.origin_m[2] - FALL_M;
        for (id, walker) in &mut self.walkers {
            if walker.simulated && !walker.lost {
                (0..n_pieces).for_each(|_| walker.walk(&self.physics, piece_secs));
                if !(walker.feet_m.iter().all(|x| x.is_finite()) && walker.feet_m[2] > floor_m) {
                    tracing::error!(
                        actor = id.0,
                        "walker fell out of the world and was stopped; destroy it or set its pose"
                    );
                    walker.feet_m = walker.last_feet_m;
                    walker.lost = true;
                }
            }
        }
    }

    /// Holds a walker's control until it is replaced.
    ///
    /// # Errors
    /// [`ActorError`] for another kind of actor and for numbers that cannot be used.
    pub fn control_walker(
        &mut self,
        actor: ActorId,
        control: WalkerControl,
    ) -> Result<(), ActorError> {
        let value = |problem| ActorError::Value {
            actor,
            what: "walker control",
            problem,
        };
        if !control
            .direction
            .iter()
            .all(|x| x.is_finite() && x.abs() < 1e6)
        {
            return Err(value("must have a finite direction"));
        }
        if !(0.0..=MAX_SPEED_MPS).contains(&control.speed_mps) {
            return Err(value("must have a speed of 0 to 15 m/s"));
        }
        let walker = self.walker_mut(actor)?;
        walker.control = control;
        (walker.led, walker.simulated) = (None, true);
        self.refresh_records(None);
        Ok(())
    }

    /// Puts a walker's feet on the ground nearest to a point, facing `yaw_rad`; its limbs move as
    /// at `speed_mps`.
    ///
    /// # Errors
    /// As [`World::control_walker`].
    pub fn lead_walker(
        &mut self,
        actor: ActorId,
        ground_point_m: [f64; 3],
        yaw_rad: f64,
        speed_mps: f64,
    ) -> Result<(), ActorError> {
        let value = |what, problem| ActorError::Value {
            actor,
            what,
            problem,
        };
        if !ground_point_m
            .iter()
            .all(|x| x.is_finite() && x.abs() < 1e5)
            || !yaw_rad.is_finite()
        {
            return Err(value(
                "place",
                "must be finite and within 100 km of the origin",
            ));
        }
        if !(0.0..=f64::from(MAX_SPEED_MPS)).contains(&speed_mps) {
            return Err(value("speed", "must be 0 to 15 m/s"));
        }
        self.walker_mut(actor)?;
        let mut feet_m = Vector3::from(ground_point_m);
        feet_m.z -= ground_below(&self.physics, &feet_m, 1.0, 1.5).unwrap_or(0.0);
        let walker = self.walker_mut(actor)?;
        let lies = walker.fall;
        walker.put(feet_m, yaw_rad);
        walker.fall = lies;
        walker.led = Some((speed_mps, 0.0));
        (walker.simulated, walker.on_ground) = (false, true);
        self.refresh_records(None);
        Ok(())
    }

    /// Puts the middle of a walker's body at a pose; only the heading of the rotation counts.
    pub(crate) fn put_walker(&mut self, actor: ActorId, pose: &Pose) {
        if let Some(walker) = self.walkers.get_mut(&actor) {
            let [x, y, z] = pose.translation_m;
            let feet_m = Vector3::new(x, y, z - 0.5 * walker.model().shape.height_m);
            walker.put(feet_m, pose.yaw_rad());
            walker.on_ground = false;
            walker.last_feet_m = feet_m.into();
        }
    }

    pub(crate) fn walker_mut(&mut self, actor: ActorId) -> Result<&mut Walker, ActorError> {
        match self.walkers.get_mut(&actor) {
            Some(walker) => Ok(walker),
            None => Err(match self.actors.get(&actor) {
                None => ActorError::Unknown(actor),
                Some(other) => {
                    let type_id = self.catalogue.entries[other.catalogue_idx as usize]
                        .type_id
                        .clone();
                    ActorError::WrongKind {
                        actor,
                        type_id,
                        needed: "walker",
                    }
                }
            }),
        }
    }

    /// Lets a new walker stand on the ground if its feet would be in it.
    pub(crate) fn lifted(&self, feet_m: Vector3<f64>, height_m: f64) -> Vector3<f64> {
        match ground_below(&self.physics, &feet_m, height_m, 0.0) {
            Some(down_m) if down_m < 0.0 => feet_m - Vector3::z() * down_m,
            _ => feet_m,
        }
    }

    /// Whether this kind of actor is moved by this module.
    pub(crate) fn is_walker(kind: ActorKind) -> bool {
        kind == ActorKind::Walker
    }
}
