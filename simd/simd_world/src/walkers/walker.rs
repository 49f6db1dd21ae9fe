//! One walker: a kinematic body that walks over the ground and is pushed and knocked down by
//! vehicles.
//!
//! A walker is no body of the physics engine: it asks the engine where walls and ground are and
//! moves by itself. An impact of a vehicle is an inelastic collision of two masses, so the vehicle
//! feels it too.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use schema_frames::{WalkerControl, WalkerPart};
use schema_types::Pose;
use serde::{Deserialize, Serialize};
use simd_body::person::{N_PARTS, Posture, Skeleton};

use super::control::{Lead, MAX_SPEED_MPS};
use super::model::{WalkerModel, walker_models};
use super::own_pose::OwnPose;
use super::standing::{Standing, Walls, ground_below};
use crate::physics::{GRAVITY_MPS2, Physics};

/// How fast a walker turns, rad/s.
const TURN_RADPS: f64 = 9.4;
/// How fast a body falls over, rad/s.
const TOPPLE_RADPS: f64 = 5.5;
/// Height of a lying body's middle, metres.
const LYING_M: f64 = 0.15;
/// Friction of a body that slides over the ground.
const SLIDING_FRICTION: f64 = 0.6;
/// A led walker whose leader is silent for this long stands still, seconds.
const LED_SECS: f64 = 0.3;

/// Rate at which the shown walking speed follows the real one, m/s².
const GAIT_MPS2: f64 = 6.0;

/// A walker that was knocked down.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Fall {
    /// Horizontal direction in which it was pushed.
    pub towards: [f64; 2],
    /// Angle from upright, radians.
    pub angle_rad: f64,
}

/// Pushes of a walker that last or are about to act.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Pushed {
    /// Force during the coming tick, N.
    pub force_n: [f64; 3],
    /// Torque about the upright axis during the coming tick, N·m.
    pub torque_nm: f64,
    /// Turn that pushes gave it, rad/s; dies away.
    pub radps: f64,
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
    /// Other pushes, by commands.
    pub pushed: Pushed,
    pub on_ground: bool,
    /// Whether it falls.
    pub gravity: bool,
    pub gait_rad: f64,
    pub gait_mps: f64,
    pub fall: Option<Fall>,
    pub invincible: bool,
    pub seated: bool,
    /// Whether it moves by its control and under gravity; a led walker does not.
    pub simulated: bool,
    /// Whether walls stop it and vehicles hit it.
    pub collides: bool,
    /// Speed that the leader stated, and seconds since then; `None` without a leader.
    pub led: Option<(f64, f64)>,
    /// Feet at the end of the last tick.
    pub last_feet_m: [f64; 3],
    /// Whether it fell out of the world.
    pub lost: bool,
    /// Bones that commands hold.
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
            pushed: Pushed::default(),
            on_ground: false,
            gravity: true,
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
            gravity_mps2: if self.gravity { GRAVITY_MPS2 } else { 0.0 },
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

    /// The posture of its limbs.
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

    /// Holds a control until it is replaced; the walker moves by itself from then on.
    pub fn hold_control(&mut self, control: WalkerControl) {
        self.control = control;
        (self.led, self.simulated) = (None, true);
    }

    /// Puts its feet on the ground nearest to the place that the leader states; a fallen walker
    /// stays down.
    pub fn lead(&mut self, lead: &Lead, physics: &Physics) {
        let mut feet_m = Vector3::from(lead.ground_point_m);
        feet_m.z -= ground_below(physics, &feet_m, 1.0, 1.5).unwrap_or(0.0);
        let lies = self.fall;
        self.put(feet_m, lead.yaw_rad);
        self.fall = lies;
        self.led = Some((lead.speed_mps, 0.0));
        (self.simulated, self.on_ground) = (false, true);
    }

    /// Puts the middle of its body at a pose; only the heading of the rotation counts.
    pub fn put_middle(&mut self, pose: &Pose) {
        let [x, y, z] = pose.translation_m;
        let feet_m = Vector3::new(x, y, z - 0.5 * self.model().shape.height_m);
        self.put(feet_m, pose.yaw_rad());
        self.on_ground = false;
        self.last_feet_m = feet_m.into();
    }

    /// Puts its feet somewhere and lets it stand up.
    fn put(&mut self, feet_m: Vector3<f64>, yaw_rad: f64) {
        (self.feet_m, self.yaw_rad) = (feet_m.into(), yaw_rad);
        (self.rise_mps, self.pushed_mps, self.fall, self.lost) = (0.0, [0.0; 2], None, false);
        self.pushed = Pushed::default();
    }

    /// Advances a walker that moves by itself by a part of a tick.
    pub fn walk(&mut self, physics: &Physics, dt_secs: f64) {
        let gravity_mps2 = if self.gravity { GRAVITY_MPS2 } else { 0.0 };
        self.heed_forces(self.model().mass_kg * gravity_mps2, dt_secs);
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
        let walls = if self.collides {
            Walls::Stop
        } else {
            Walls::Pass
        };
        standing.step(physics, velocity, dt_secs, walls);
        // A sliding body is slowed by friction; a standing one catches itself faster.
        let friction = if self.fall.is_some() {
            SLIDING_FRICTION
        } else {
            2.0 * SLIDING_FRICTION
        };
        let slowed = if standing.on_ground {
            pushed.norm() - friction * gravity_mps2 * dt_secs
        } else {
            pushed.norm()
        };
        let kept = pushed
            .try_normalize(1e-9)
            .map_or(Vector3::zeros(), |way| way * slowed.max(0.0));
        self.pushed_mps = [kept.x, kept.y];
        self.set_standing(&standing);
        // Two thirds of the radius is the mean lever of friction under a disc.
        let slow_radps2 = if standing.on_ground {
            friction * gravity_mps2 * (4.0 / 3.0) / standing.radius_m
        } else {
            0.0
        };
        self.spin(slow_radps2, dt_secs);
        if self.fall.is_none() && wish.norm() > 1e-3 {
            self.turn_to(wish.y.atan2(wish.x), dt_secs);
        }
    }

    /// Horizontal velocity that its control asks for, m/s.
    pub fn wish_mps(&self) -> Vector3<f64> {
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

    /// After a tick: updates the velocity, and moves the limbs by the distance walked.
    pub fn finish(&mut self, yaw_before_rad: f64, dt_secs: f64) {
        use std::f64::consts::{PI, TAU};
        let moved = Vector3::from(self.feet_m) - Vector3::from(self.last_feet_m);
        let way_m = moved.xy().norm();
        self.last_feet_m = self.feet_m;
        let mut speed_mps = way_m / dt_secs;
        if let Some((led_mps, secs)) = &mut self.led {
            speed_mps = if *secs < LED_SECS { *led_mps } else { 0.0 };
            *secs += dt_secs;
        }
        // A displacement faster than any run is a teleport.
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

    /// The shown bones in their parents' space.
    pub fn relative_bones(&self) -> Vec<Isometry3<f64>> {
        let skeleton = self.model().shape.skeleton();
        let mut shown = skeleton.relative_bones(self.posture());
        if let Some(own) = self.own_pose.as_ref().filter(|own| own.is_shown()) {
            own.mix_into(&mut shown, &skeleton);
        }
        shown
    }

    /// The shown poses of the body's parts, relative to the ground between the feet.
    pub fn parts(&self) -> [Isometry3<f64>; N_PARTS] {
        let skeleton = self.model().shape.skeleton();
        match &self.own_pose {
            Some(own) if own.is_shown() => {
                skeleton.parts_on(&Skeleton::chain(&self.relative_bones()))
            }
            _ => skeleton.parts(self.posture()),
        }
    }

    /// Pose of the ground under the middle of the body.
    pub fn world_from_ground(&self) -> Isometry3<f64> {
        self.pose() * Translation3::new(0.0, 0.0, -0.5 * self.model().shape.height_m)
    }

    /// The walker's part of its record.
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

/// The shown walking speed after `dt_secs` of walking at `speed_mps`.
pub fn eased_mps(shown_mps: f64, speed_mps: f64, dt_secs: f64) -> f64 {
    let most = GAIT_MPS2 * dt_secs;
    shown_mps + (speed_mps - shown_mps).clamp(-most, most)
}
