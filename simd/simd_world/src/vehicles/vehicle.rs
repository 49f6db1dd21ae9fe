//! One vehicle: a rigid body on wheels that find the ground by rays, with its powertrain, brakes,
//! steering and air drag.
//!
//! The body's origin and axes are the vehicle's: the origin lies on the ground midway between the
//! axles. Gravity and all forces at the wheels are solved in `sub_step.rs`; the engine moves the
//! body and resolves collisions.
//!
//! [`Vehicle`] holds the whole state: from a copy of it (or its serialised form) and of the
//! engine's world, a run continues bit for bit.

use std::sync::Arc;

use nalgebra::{Isometry3, Vector3};
use rapier3d::math::Vector;
use rapier3d::prelude::*;
use schema_frames::{AckermannGains, VehicleControl, VehiclePhysics};
use schema_types::Pose;
use serde::{Deserialize, Serialize};

use super::ackermann::{Ackermann, Seen};
use super::curve::along;
use super::doors::Doors;
use super::factory_data::{self, rest_load_ratios};
use super::footing::Footing;
use super::model::VehicleModel;
use super::powertrain::Powertrain;
use super::wheel::{Wheel, WheelSpec};
use crate::errors::PhysicsError;
use crate::physics::{GRAVITY_MPS2, Physics, collider_tag, narrow, widen};

/// A vehicle this far below the map's origin has fallen out of the world, metres.
const FALL_M: f32 = 500.0;
/// Most wheels that a record can show.
pub(crate) const MAX_WHEELS: usize = 6;
/// Mass of all wheels together as a share of the vehicle's mass.
const WHEEL_MASS_RATIO: f32 = 0.05;
/// Displacements of a vehicle without physics that are faster than this count as teleports, m/s.
const JUMP_MPS: f64 = 100.0;

/// The whole physical state of a vehicle.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Vehicle {
    #[serde(with = "super::model_list::by_type_id")]
    pub model: &'static VehicleModel,
    pub body: RigidBodyHandle,
    collider: ColliderHandle,
    /// Shared by copies of a world.
    #[serde(with = "crate::serde_forms::shared")]
    pub physics: Arc<VehiclePhysics>,
    pub powertrain: Powertrain,
    pub control: VehicleControl,
    pub ackermann: Option<Ackermann>,
    pub gains: AckermannGains,
    pub lamps: u32,
    pub doors: Doors,
    pub tint_rgb: [u8; 3],
    /// Mean angle of the front wheels, radians, positive to the left.
    pub steer_rad: f32,
    /// Lean that the rider of a two-wheeler aims at, radians, positive to the right.
    pub lean_rad: f32,
    pub wheels: Vec<Wheel>,
    pub switches: Switches,
    /// Whether a control was set since the last tick.
    is_new_control: bool,
    /// Pushes for the coming tick: force (N) and torque (N·m), world.
    pub force_n: [f32; 3],
    pub torque_nm: [f32; 3],
    pub quarantined: bool,
    last_good: Pose,
    /// Pose at the end of the last tick of a vehicle without physics, and the velocities that
    /// follow from its displacement.
    last_tick: Pose,
    carried: [[f64; 3]; 2],
    /// Cache; not saved because it follows from the place and the map.
    #[serde(skip)]
    pub footing: Footing,
}

/// Switches of a vehicle's body.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Switches {
    pub gravity: bool,
    /// Whether the engine moves it.
    pub simulated: bool,
    pub collides: bool,
    /// Whether a control stays until it is replaced; otherwise it is for one tick.
    pub sticky_control: bool,
    /// Velocity that is held, in the vehicle's axes, m/s.
    pub held_mps: Option<[f32; 3]>,
}

impl Vehicle {
    /// Adds the body of `model` at a world pose; contacts report it as `actor`.
    pub fn new(
        physics: &mut Physics,
        model: &'static VehicleModel,
        actor: u32,
        pose: &Isometry3<f64>,
    ) -> Self {
        let data = model.physics();
        let body = RigidBodyBuilder::dynamic()
            .pose(physics.engine_pose(pose))
            .additional_mass_properties(mass_properties(model, &data))
            .can_sleep(false)
            .gravity_scale(0.0);
        let (centre, half) = chassis_box(model);
        let collider = ColliderBuilder::cuboid(half.x, half.y, half.z)
            .translation(centre)
            .density(0.0)
            .friction(0.3)
            .restitution(0.05)
            .user_data(collider_tag(actor, model.class))
            .active_events(ActiveEvents::CONTACT_FORCE_EVENTS)
            .contact_force_event_threshold(0.0);
        let (body, collider) = physics.engine.insert(body, collider);
        // The engine would do this in its next step, but the wheels push before that.
        let engine = &mut physics.engine;
        engine.bodies[body].recompute_mass_properties_from_colliders(&engine.colliders);
        Vehicle {
            model,
            body,
            collider,
            wheels: wheel_specs(model, &data)
                .into_iter()
                .map(Wheel::new)
                .collect(),
            physics: Arc::new(data),
            powertrain: Powertrain::new(&model.engine),
            control: VehicleControl::default(),
            ackermann: None,
            gains: AckermannGains::default(),
            lamps: 0,
            doors: Doors::default(),
            tint_rgb: model.colors[0],
            steer_rad: 0.0,
            lean_rad: 0.0,
            switches: Switches {
                gravity: true,
                simulated: true,
                collides: true,
                sticky_control: true,
                held_mps: None,
            },
            is_new_control: false,
            force_n: [0.0; 3],
            torque_nm: [0.0; 3],
            quarantined: false,
            last_good: (*pose).into(),
            last_tick: (*pose).into(),
            carried: [[0.0; 3]; 2],
            footing: Footing::default(),
        }
    }

    /// Replaces the physical data, which must have been checked. The powertrain starts anew;
    /// velocities stay.
    pub fn set_physics(&mut self, physics: &mut Physics, mut data: VehiclePhysics) {
        for (wheel, now) in data.wheels.iter_mut().zip(&self.physics.wheels) {
            wheel.position_m = [now.position_m[0], now.position_m[1], wheel.radius_m];
        }
        for (wheel, spec) in self.wheels.iter_mut().zip(wheel_specs(self.model, &data)) {
            wheel.spec = spec;
        }
        let engine = &mut physics.engine;
        let body = &mut engine.bodies[self.body];
        let origin_mps = body.velocity_at_point(body.translation());
        body.set_additional_mass_properties(mass_properties(self.model, &data), true);
        body.recompute_mass_properties_from_colliders(&engine.colliders);
        let lever = body.center_of_mass() - body.translation();
        body.set_linvel(origin_mps + body.angvel().cross(lever), true);
        let gear = self
            .powertrain
            .gear
            .clamp(-1, data.forward_gears.len() as i32);
        self.powertrain = Powertrain::new(&self.model.engine);
        self.powertrain.gear = gear;
        self.physics = Arc::new(data);
    }

    /// Sets pedals and steering; ends an Ackermann control.
    pub fn set_control(&mut self, control: VehicleControl) {
        self.control = control.clamped();
        self.is_new_control = true;
        self.ackermann = None;
        self.wheels
            .iter_mut()
            .for_each(|wheel| wheel.shown_steer_rad = None);
    }

    /// Before the sub-steps of a tick: drops a control that was for one tick, and lets the
    /// Ackermann controllers set the pedals.
    pub fn begin_tick(&mut self, physics: &Physics, dt_secs: f32) {
        if !std::mem::take(&mut self.is_new_control) && !self.switches.sticky_control {
            self.control = VehicleControl::default();
        }
        let Some(mut ackermann) = self.ackermann else {
            return;
        };
        let speed_mps = self.forward_mps(physics);
        let max_steer_rad = self.max_steer_rad(speed_mps);
        self.control = ackermann.step(
            &self.gains,
            &Seen {
                speed_mps,
                max_steer_rad,
                dt_secs,
            },
        );
        self.ackermann = Some(ackermann);
    }

    /// After the sub-steps of a tick: pushes end and doors move. A vehicle without physics takes
    /// the velocity of its displacement.
    pub fn end_tick(&mut self, physics: &Physics, dt_secs: f64) {
        self.force_n = [0.0; 3];
        self.torque_nm = [0.0; 3];
        self.doors.step(dt_secs);
        if self.switches.simulated {
            return;
        }
        let pose = self.pose(physics);
        let before = self.last_tick.isometry();
        self.last_tick = pose.into();
        let velocity = (pose.translation.vector - before.translation.vector) / dt_secs;
        self.carried = if velocity.norm() <= JUMP_MPS {
            [
                velocity.into(),
                ((pose.rotation * before.rotation.inverse()).scaled_axis() / dt_secs).into(),
            ]
        } else {
            [[0.0; 3]; 2]
        };
        let forward_mps = (pose.rotation.inverse() * Vector3::from(self.carried[0])).x as f32;
        for wheel in &mut self.wheels {
            wheel.roll_radps = forward_mps / wheel.spec.physics.radius_m;
            wheel.roll(dt_secs as f32);
        }
    }

    /// Largest mean angle of the front wheels at a speed, radians.
    pub fn max_steer_rad(&self, speed_mps: f32) -> f32 {
        let lock = self
            .physics
            .wheels
            .iter()
            .map(|wheel| wheel.max_steer_rad)
            .fold(0.0, f32::max);
        lock * along(&self.physics.steering_curve, speed_mps.abs(), 1.0)
    }

    /// Forward speed of the centre of mass, m/s.
    pub fn forward_mps(&self, physics: &Physics) -> f32 {
        let (velocity, _) = self.velocity(physics);
        (self.pose(physics).rotation.inverse() * velocity).x as f32
    }

    /// After the engine's sub-step: a body whose state is not finite or absurd is put back to its
    /// last good pose and switched off. True if that happened in this sub-step.
    pub fn finish_step(&mut self, physics: &mut Physics) -> bool {
        if self.quarantined || !self.switches.simulated {
            return false;
        }
        let body = &physics.engine.bodies[self.body];
        // The engine switches a body off by itself when its state is not finite.
        let sane = body.is_enabled()
            && body.translation().is_finite()
            && body.rotation().is_finite()
            && body.linvel().is_finite()
            && body.angvel().is_finite()
            && body.translation().abs().max_element() < 1e5
            && body.translation().z > -FALL_M
            && body.linvel().length() < 500.0;
        if sane {
            self.last_good = physics.world_pose(body.position()).into();
            return false;
        }
        self.quarantined = true;
        // Values that are not finite must not come back with the next pose.
        self.wheels
            .iter_mut()
            .for_each(|wheel| *wheel = Wheel::new(wheel.spec));
        self.powertrain = Powertrain::new(&self.model.engine);
        (self.steer_rad, self.lean_rad) = (0.0, 0.0);
        let pose = physics.engine_pose(&self.last_good.isometry());
        let body = &mut physics.engine.bodies[self.body];
        body.set_position(pose, false);
        body.set_linvel(Vector::ZERO, false);
        body.set_angvel(Vector::ZERO, false);
        body.set_enabled(false);
        true
    }

    /// World pose of the origin.
    pub fn pose(&self, physics: &Physics) -> Isometry3<f64> {
        match self.quarantined {
            true => self.last_good.isometry(),
            false => physics.world_pose(physics.engine.bodies[self.body].position()),
        }
    }

    /// Velocity of the origin and angular velocity, world.
    pub fn velocity(&self, physics: &Physics) -> (Vector3<f64>, Vector3<f64>) {
        if !self.switches.simulated {
            return (self.carried[0].into(), self.carried[1].into());
        }
        let body = &physics.engine.bodies[self.body];
        (
            widen(body.velocity_at_point(body.translation())),
            widen(body.angvel()),
        )
    }

    /// Gives the origin a velocity; the rotation speed stays, and the wheels roll along.
    pub fn set_velocity(&mut self, physics: &mut Physics, velocity_in_world_mps: &Vector3<f64>) {
        let body = &mut physics.engine.bodies[self.body];
        let lever = body.center_of_mass() - body.translation();
        let linvel = narrow(velocity_in_world_mps) + body.angvel().cross(lever);
        let forward_mps = (body.rotation() * Vector::X).dot(linvel);
        if self.switches.simulated {
            body.set_linvel(linvel, true);
        }
        self.carried[0] = (*velocity_in_world_mps).into();
        for wheel in &mut self.wheels {
            wheel.roll_radps = forward_mps / wheel.spec.physics.radius_m;
            wheel.deflection_m = [0.0; 2];
        }
    }

    /// Sets the angular velocity about the centre of mass.
    pub fn set_angular_velocity(
        &mut self,
        physics: &mut Physics,
        angular_in_world_radps: &Vector3<f64>,
    ) {
        physics.engine.bodies[self.body].set_angvel(narrow(angular_in_world_radps), true);
    }

    /// Teleports the origin; velocities stay. Ends a quarantine.
    pub fn set_pose(&mut self, physics: &mut Physics, pose: &Isometry3<f64>) {
        let engine_pose = physics.engine_pose(pose);
        let body = &mut physics.engine.bodies[self.body];
        body.set_enabled(true);
        body.set_position(engine_pose, true);
        self.quarantined = false;
        self.last_good = (*pose).into();
        self.wheels.iter_mut().for_each(Wheel::lift);
    }

    /// Sets whether the engine moves the body. Velocities carry over from one state to the other.
    pub fn set_simulated(&mut self, physics: &mut Physics, simulated: bool) {
        if self.switches.simulated == simulated {
            return;
        }
        let pose = self.pose(physics);
        let (velocity, spin) = self.velocity(physics);
        self.switches.simulated = simulated;
        self.last_tick = pose.into();
        let body = &mut physics.engine.bodies[self.body];
        if simulated {
            body.set_body_type(RigidBodyType::Dynamic, true);
            body.set_angvel(narrow(&spin), true);
            self.set_velocity(physics, &velocity);
        } else {
            body.set_linvel(Vector::ZERO, true);
            body.set_angvel(Vector::ZERO, true);
            body.set_body_type(RigidBodyType::KinematicPositionBased, true);
            self.carried = [[0.0; 3]; 2];
            self.wheels.iter_mut().for_each(Wheel::lift);
        }
    }

    /// Sets whether the body collides with others.
    pub fn set_collides(&mut self, physics: &mut Physics, collides: bool) {
        self.switches.collides = collides;
        let groups = if collides {
            InteractionGroups::all()
        } else {
            InteractionGroups::none()
        };
        if let Some(collider) = physics.engine.colliders.get_mut(self.collider) {
            collider.set_collision_groups(groups);
        }
    }

    /// Whether it lies on its side or its roof.
    pub fn is_rolled_over(&self, physics: &Physics) -> bool {
        (physics.engine.bodies[self.body].rotation() * Vector::Z).z < 0.3
    }

    /// The wheels as they are shown.
    pub fn visible_wheels(&self) -> impl Iterator<Item = WheelState> + '_ {
        self.wheels.iter().map(|wheel| {
            let [x_m, y_m, _] = wheel.spec.physics.position_m;
            WheelState {
                x_m,
                y_m,
                travel_m: wheel.travel_m(),
                steer_rad: wheel.visible_steer_rad(),
                spin_rad: wheel.roll_rad,
                on_ground: wheel.on_ground,
            }
        })
    }

    /// Lamps that shine: those that are set, brake lamps while braking, and the reversing lamp in
    /// reverse.
    pub fn shining_lamps(&self) -> u32 {
        let brake = if self.control.brake_ratio > 0.01 {
            8
        } else {
            0
        };
        let reverse = if self.powertrain.gear < 0 { 64 } else { 0 };
        self.lamps | brake | reverse
    }
}

/// A wheel as it is shown after a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct WheelState {
    /// Forward of the origin, metres.
    pub x_m: f32,
    /// Left of the origin, metres.
    pub y_m: f32,
    /// Compressed from rest, metres.
    pub travel_m: f32,
    /// Angle about z, radians, positive to the left.
    pub steer_rad: f32,
    /// Roll angle, radians.
    pub spin_rad: f32,
    /// Touches the ground.
    pub on_ground: bool,
}

/// Static compression of the suspension, metres; it gives a heave frequency of 1.5 Hz.
fn sag_m(model: &VehicleModel) -> f32 {
    if model.is_two_wheeler() { 0.06 } else { 0.11 }
}

/// What a vehicle that was read from a checkpoint cannot be.
#[derive(Debug, thiserror::Error)]
pub(crate) enum WrongVehicle {
    #[error("its collider is not that of its body")]
    Collider,
    #[error("it has {found} wheels, its model has {needed}")]
    Wheels { found: usize, needed: usize },
    #[error("its gear is {gear}, but must be -1 to {most}")]
    Gear { gear: i32, most: usize },
    #[error(transparent)]
    Physics(#[from] PhysicsError),
}

/// Checks a vehicle that was read from a checkpoint, whose body is in the engine.
///
/// # Errors
/// The first thing that cannot be.
pub(crate) fn check_vehicle(vehicle: &Vehicle, engine: &PhysicsWorld) -> Result<(), WrongVehicle> {
    let collider = engine.colliders.get(vehicle.collider);
    if collider.is_none_or(|collider| collider.parent() != Some(vehicle.body)) {
        return Err(WrongVehicle::Collider);
    }
    let needed = vehicle.model.physics().wheels.len();
    for found in [vehicle.wheels.len(), vehicle.physics.wheels.len()] {
        if found != needed {
            return Err(WrongVehicle::Wheels { found, needed });
        }
    }
    factory_data::check(&vehicle.physics, needed)?;
    let (gear, most) = (vehicle.powertrain.gear, vehicle.physics.forward_gears.len());
    match gear >= -1 && usize::try_from(gear.max(0)).is_ok_and(|gear| gear <= most) {
        true => Ok(()),
        false => Err(WrongVehicle::Gear { gear, most }),
    }
}

fn wheel_specs(model: &VehicleModel, data: &VehiclePhysics) -> Vec<WheelSpec> {
    let sites: Vec<[f32; 2]> = data
        .wheels
        .iter()
        .map(|wheel| [wheel.position_m[0], wheel.position_m[1]])
        .collect();
    let loads = rest_load_ratios(&sites, data.center_of_mass_m[0]);
    let wheel_kg = WHEEL_MASS_RATIO * model.mass_kg as f32 / sites.len() as f32;
    let spec = |(physics, load): (&schema_frames::WheelPhysics, &f32)| WheelSpec {
        physics: *physics,
        rest_load_n: load * data.mass_kg * GRAVITY_MPS2 as f32,
        sag_m: sag_m(model),
        inertia_kgm2: 0.8 * wheel_kg * physics.radius_m * physics.radius_m,
        driven: if physics.position_m[0] > 0.0 {
            model.front_driven
        } else {
            model.rear_driven
        },
    };
    data.wheels.iter().zip(&loads).map(spec).collect()
}

/// Mass properties of a box of the body's size about the centre of mass.
fn mass_properties(model: &VehicleModel, data: &VehiclePhysics) -> MassProperties {
    let [l, w, h] = model.solid_half_m().map(|half| 2.0 * half as f32);
    let inertia = Vector::new(w * w + h * h, l * l + h * h, l * l + w * w) * (data.mass_kg / 12.0);
    MassProperties::new(data.center_of_mass_m.into(), data.mass_kg, inertia)
}

/// Centre and half extents of the solid body: the body box without the clearance below it. A
/// two-wheeler's box is narrow, so that it can lean.
pub(crate) fn chassis_box(model: &VehicleModel) -> (Vector, Vector) {
    let [x, y, z] = model.solid_half_m().map(|half| half as f32);
    let (y, clearance) = match model.is_two_wheeler() {
        true => (y.min(0.12), 0.34),
        false => (y, (0.6 * model.wheel_radius_m as f32).max(0.18)),
    };
    let half_z = 0.5 * (2.0 * z - clearance);
    (
        Vector::new(0.0, 0.0, clearance + half_z),
        Vector::new(x, y, half_z),
    )
}
