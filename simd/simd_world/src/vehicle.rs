//! One vehicle: a rigid body on ray-cast wheels, with its drive train, brakes, steering and air drag.
//!
//! rapier's controller gives suspension and side forces and has no notion of an engine or of grip along the wheel, so both are ours:
//! each wheel gets a driving force or a braking impulse that is never more than friction allows on its load of the last sub-step
//! (the ideal anti-lock brake and traction control). The body's frame is the vehicle's: origin on the ground midway between the axles.
//! Two-wheelers stand on four contact points close together, so that they do not fall over; one sees two wheels.

use nalgebra::{Isometry3, Vector3};
use rapier3d::control::{DynamicRayCastVehicleController, WheelTuning};
use rapier3d::math::Vector;
use rapier3d::prelude::*;
use schema_frames::VehicleControl;
use serde::{Deserialize, Serialize};

use crate::drive::{DriveInput, DriveTrain};
use crate::models::VehicleModel;
use crate::physics::{GRAVITY_MPS2, Physics, collider_tag, narrow, widen};

/// Friction between tyre and road.
pub(crate) const TYRE_FRICTION: f32 = 1.0;
/// Rolling resistance per wheel load.
pub(crate) const ROLLING_RATIO: f32 = 0.012;
/// Full brake asks for this share of the grip, so that 0.9 of the pedal already reaches the limit.
const BRAKE_GRIP_RATIO: f32 = 1.1;
/// Density of air, kg/m³.
pub(crate) const AIR_KGPM3: f32 = 1.2;
/// How fast the front wheels turn, rad/s.
const STEER_RATE_RADPS: f32 = 1.5;
/// Share of full lock over speed, m/s: what tyres could use anyway.
const STEER_LIMIT: [(f32, f32); 4] = [(0.0, 1.0), (6.0, 1.0), (16.0, 0.55), (33.0, 0.3)];
/// Length of the unloaded spring, metres.
const SPRING_M: f32 = 0.30;
/// Share of critical damping.
const DAMPING_RATIO: f32 = 0.5;
/// Below this speed a vehicle that nothing drives is held against gravity, m/s.
const HOLD_MPS: f32 = 0.08;
/// A vehicle this far below the map's origin has fallen out of the world, metres.
const FALL_M: f32 = 500.0;
/// Most wheels that a record can show.
pub(crate) const MAX_WHEELS: usize = 6;

/// A vehicle's physical state. Everything about one sub-step happens in [`Vehicle::pre_step`] and [`Vehicle::finish_step`].
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct Vehicle {
    #[serde(with = "crate::plain::model")]
    pub model: &'static VehicleModel,
    pub body: RigidBodyHandle,
    pub train: DriveTrain,
    pub control: VehicleControl,
    pub lamps: u32,
    pub tint_rgb: [u8; 3],
    /// Mean angle of the front wheels, radians, positive to the left.
    pub steer_rad: f32,
    /// Roll of each contact wheel, radians in 0..2π.
    pub spin_rad: [f32; MAX_WHEELS],
    pub quarantined: bool,
    controller: DynamicRayCastVehicleController,
    #[serde(with = "crate::plain::isometry")]
    last_good: Isometry3<f64>,
}

impl Vehicle {
    /// Adds the body of `model` at a world pose; `actor` is what contacts report.
    pub fn new(physics: &mut Physics, model: &'static VehicleModel, actor: u32, pose: &Isometry3<f64>) -> Self {
        let body = RigidBodyBuilder::dynamic()
            .pose(physics.engine_pose(pose))
            .additional_mass_properties(mass_properties(model))
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
        let (body, _) = physics.engine.insert(body, collider);
        // The engine would do this in its next step, but the wheels push already before that.
        let engine = &mut physics.engine;
        engine.bodies[body].recompute_mass_properties_from_colliders(&engine.colliders);
        let mut controller = DynamicRayCastVehicleController::new(body);
        controller.index_up_axis = 2;
        controller.index_forward_axis = 0;
        for site in contact_sites(model) {
            let tuning = tuning(model, site.load_ratio);
            let radius = model.wheel_radius_m as f32;
            let hard_point = Vector::new(site.x_m, site.y_m, radius + SPRING_M - sag_m(model));
            controller.add_wheel(hard_point, -Vector::Z, -Vector::Y, SPRING_M, radius, &tuning);
        }
        Vehicle {
            model,
            body,
            train: DriveTrain::new(&model.engine),
            control: VehicleControl::default(),
            lamps: 0,
            tint_rgb: model.colors[0],
            steer_rad: 0.0,
            spin_rad: [0.0; MAX_WHEELS],
            quarantined: false,
            controller,
            last_good: *pose,
        }
    }

    /// Everything before the engine's sub-step: steering, drive train, brakes, air, wheels.
    pub fn pre_step(&mut self, physics: &mut Physics, dt_secs: f32) {
        if self.quarantined {
            return;
        }
        let body = &physics.engine.bodies[self.body];
        let forward_mps = (body.rotation() * Vector::X).dot(body.linvel());
        self.steer(forward_mps, dt_secs);
        let wheel_radius_m = self.model.wheel_radius_m as f32;
        let input = DriveInput { control: self.control, wheel_radps: forward_mps / wheel_radius_m, wheel_radius_m, dt_secs };
        let force = self.train.step(&self.model.engine, &input);
        self.set_wheels(forward_mps, force.drive_n, force.resist_n, dt_secs);
        self.push_body(physics, force.drive_n == 0.0, dt_secs);
        let engine = &mut physics.engine;
        let filter = QueryFilter::exclude_dynamic().exclude_rigid_body(self.body);
        let dispatcher = engine.narrow_phase.query_dispatcher();
        let pipeline = engine.broad_phase.as_query_pipeline_mut(dispatcher, &mut engine.bodies, &mut engine.colliders, filter);
        self.controller.update_vehicle(dt_secs, pipeline);
        for (wheel, spin_rad) in self.controller.wheels_mut().iter_mut().zip(&mut self.spin_rad) {
            *spin_rad = (*spin_rad + wheel.rotation).rem_euclid(std::f32::consts::TAU);
            wheel.rotation = 0.0;
        }
    }

    /// After the engine's sub-step: a body whose state is not finite or absurd is put back and switched off. True if that happened now.
    pub fn finish_step(&mut self, physics: &mut Physics) -> bool {
        if self.quarantined {
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
            self.last_good = physics.world_pose(body.position());
            return false;
        }
        self.quarantined = true;
        let pose = physics.engine_pose(&self.last_good);
        let body = &mut physics.engine.bodies[self.body];
        body.set_position(pose, false);
        body.set_linvel(Vector::ZERO, false);
        body.set_angvel(Vector::ZERO, false);
        body.set_enabled(false);
        true
    }

    fn steer(&mut self, forward_mps: f32, dt_secs: f32) {
        let speed_mps = forward_mps.abs();
        let limit = STEER_LIMIT.windows(2).find(|pair| speed_mps < pair[1].0).map_or(STEER_LIMIT[3].1, |pair| {
            let [(a, low), (b, high)] = [pair[0], pair[1]];
            low + (high - low) * (speed_mps - a) / (b - a)
        });
        let max_rad = self.model.max_steer_rad() as f32;
        let wanted_rad = (self.control.steer_ratio * max_rad).clamp(-limit * max_rad, limit * max_rad);
        let most = STEER_RATE_RADPS * dt_secs;
        self.steer_rad += (wanted_rad - self.steer_rad).clamp(-most, most);
        // Ackermann: every wheel's axle points to one centre on the line of the rear axle.
        let (tan, base_m) = (self.steer_rad.tan(), self.model.wheelbase_m as f32);
        for wheel in self.controller.wheels_mut().iter_mut().take(2) {
            let y_m = wheel.chassis_connection_point_cs.y;
            wheel.steering = (base_m * tan).atan2(base_m - y_m * tan);
        }
    }

    /// Splits drive and brakes over the wheels by their load and keeps each within its grip.
    fn set_wheels(&mut self, forward_mps: f32, drive_n: f32, resist_n: f32, dt_secs: f32) {
        let control = self.control;
        let driven = |i: usize, model: &VehicleModel| if i < 2 { model.front_driven } else { model.rear_driven };
        let loads: [f32; MAX_WHEELS] =
            std::array::from_fn(|i| self.controller.wheels().get(i).map_or(0.0, |wheel| wheel.wheel_suspension_force));
        let n_wheels = self.controller.wheels().len();
        let driven_load: f32 = (0..n_wheels).filter(|i| driven(*i, self.model)).map(|i| loads[i]).sum();
        for (i, wheel) in self.controller.wheels_mut().iter_mut().enumerate() {
            let grip_n = TYRE_FRICTION * loads[i];
            let share = if driven_load > 0.0 && driven(i, self.model) { loads[i] / driven_load } else { 0.0 };
            let drive = drive_n * share;
            let brake = control.brake_ratio * BRAKE_GRIP_RATIO * grip_n;
            let hand = if control.hand_brake && i >= 2 { grip_n } else { 0.0 };
            let resist = brake + hand + resist_n * share + ROLLING_RATIO * loads[i];
            let way = if forward_mps.abs() > 0.05 { forward_mps.signum() } else { drive.signum() };
            if drive * way > resist {
                wheel.engine_force = (drive - way * resist).clamp(-grip_n, grip_n);
                wheel.brake = 0.0;
            } else {
                wheel.engine_force = 0.0;
                wheel.brake = (resist - drive * way).min(grip_n) * dt_secs;
            }
        }
    }

    /// Gravity and air drag, and on a slope the static friction of a vehicle at rest, which velocity-based friction cannot give.
    ///
    /// Gravity comes from here and not from the engine: the engine spreads it over its solver's iterations, the suspension's answer comes at
    /// once, and at rest the difference would show as a constant vertical velocity.
    fn push_body(&self, physics: &mut Physics, coasting: bool, dt_secs: f32) {
        let body = &mut physics.engine.bodies[self.body];
        let velocity = body.linvel();
        let mass_kg = self.model.mass_kg as f32;
        let gravity = Vector::new(0.0, 0.0, -GRAVITY_MPS2 as f32);
        let drag_n = velocity * (-0.5 * AIR_KGPM3 * self.model.drag_area_m2 as f32 * velocity.length());
        let held = if coasting && velocity.length() < HOLD_MPS {
            self.held_mps2(*body.rotation() * Vector::X, gravity, dt_secs)
        } else {
            Vector::ZERO
        };
        body.apply_impulse((drag_n + (gravity - held) * mass_kg) * dt_secs, true);
    }

    /// The part of gravity along the ground that standing tyres hold: sideways always, along the wheels as far as the brakes go.
    fn held_mps2(&self, forward: Vector, gravity: Vector, dt_secs: f32) -> Vector {
        let wheels = self.controller.wheels();
        let normal: Vector = wheels.iter().filter(|w| w.raycast_info().is_in_contact).map(|w| w.raycast_info().contact_normal_ws).sum();
        let Some(normal) = normal.try_normalize() else { return Vector::ZERO };
        let along_slope = gravity - normal * normal.dot(gravity);
        let brakes_n: f32 = wheels.iter().map(|w| w.brake / dt_secs).sum();
        let roll = forward * forward.dot(along_slope);
        let rolls_away = roll.length() * self.model.mass_kg as f32 > brakes_n;
        if rolls_away { along_slope - roll } else { along_slope }
    }

    /// World pose of the origin.
    pub fn pose(&self, physics: &Physics) -> Isometry3<f64> {
        if self.quarantined { self.last_good } else { physics.world_pose(physics.engine.bodies[self.body].position()) }
    }

    /// Velocity of the origin and angular velocity, world.
    pub fn velocity(&self, physics: &Physics) -> (Vector3<f64>, Vector3<f64>) {
        let body = &physics.engine.bodies[self.body];
        (widen(body.velocity_at_point(body.translation())), widen(body.angvel()))
    }

    /// Gives the origin a velocity; rotation stays.
    pub fn set_velocity(&self, physics: &mut Physics, velocity_in_world_mps: &Vector3<f64>) {
        let body = &mut physics.engine.bodies[self.body];
        let lever = body.center_of_mass() - body.translation();
        let linvel = narrow(velocity_in_world_mps) + body.angvel().cross(lever);
        body.set_linvel(linvel, true);
    }

    /// Teleports the origin; velocities stay. Ends a quarantine.
    pub fn set_pose(&mut self, physics: &mut Physics, pose: &Isometry3<f64>) {
        let engine_pose = physics.engine_pose(pose);
        let body = &mut physics.engine.bodies[self.body];
        body.set_enabled(true);
        body.set_position(engine_pose, true);
        self.quarantined = false;
        self.last_good = *pose;
    }

    /// Contact wheels: travel from rest (compressed is positive, metres), angle (radians) and whether on the ground.
    pub fn wheels(&self) -> impl Iterator<Item = WheelState> + '_ {
        self.controller.wheels().iter().zip(&self.spin_rad).map(|(wheel, spin_rad)| {
            let info = wheel.raycast_info();
            WheelState {
                x_m: wheel.chassis_connection_point_cs.x,
                y_m: wheel.chassis_connection_point_cs.y,
                travel_m: SPRING_M - sag_m(self.model) - info.suspension_length,
                steer_rad: wheel.steering,
                spin_rad: *spin_rad,
                on_ground: info.is_in_contact,
            }
        })
    }

    /// Wheels that one sees: a two-wheeler's pairs are one wheel each.
    pub fn visible_wheels(&self) -> impl Iterator<Item = WheelState> + '_ {
        let two = self.model.is_two_wheeler();
        self.wheels()
            .enumerate()
            .filter(move |(i, _)| !two || i % 2 == 0)
            .map(move |(_, wheel)| if two { WheelState { y_m: 0.0, ..wheel } } else { wheel })
    }

    /// Lamps that shine: those that are set, the brake lamps while braking, the reversing lamp in reverse.
    pub fn shining_lamps(&self) -> u32 {
        let brake = if self.control.brake_ratio > 0.01 { 8 } else { 0 };
        let reverse = if self.train.gear < 0 { 64 } else { 0 };
        self.lamps | brake | reverse
    }
}

/// One wheel after a step.
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

struct ContactSite {
    x_m: f32,
    y_m: f32,
    load_ratio: f32,
}

/// Static compression of the suspension, metres: 1.5 Hz in heave. The narrow stance of a two-wheeler needs hard springs to stay upright.
fn sag_m(model: &VehicleModel) -> f32 {
    if model.is_two_wheeler() { 0.04 } else { 0.11 }
}

/// Front left, front right, rear left, rear right, with their share of the weight.
fn contact_sites(model: &VehicleModel) -> [ContactSite; 4] {
    let x_m = 0.5 * model.wheelbase_m as f32;
    let y_m = if model.is_two_wheeler() { 0.20 } else { model.solid_half_m()[1] as f32 - 0.17 };
    let front = 0.5 * model.front_load_ratio() as f32;
    let rear = 0.5 - front;
    [(x_m, y_m, front), (x_m, -y_m, front), (-x_m, y_m, rear), (-x_m, -y_m, rear)].map(|(x_m, y_m, load_ratio)| ContactSite {
        x_m,
        y_m,
        load_ratio,
    })
}

/// Stiffness and damping are per kg of the whole body; by load share, so that every spring sags alike and the body rests level.
fn tuning(model: &VehicleModel, load_ratio: f32) -> WheelTuning {
    let gravity = GRAVITY_MPS2 as f32;
    let damping = 2.0 * DAMPING_RATIO * (gravity / sag_m(model)).sqrt() * load_ratio;
    WheelTuning {
        suspension_stiffness: gravity / sag_m(model) * load_ratio,
        suspension_compression: 0.8 * damping,
        suspension_damping: 1.2 * damping,
        max_suspension_travel: 0.22,
        side_friction_stiffness: 1.0,
        friction_slip: TYRE_FRICTION,
        max_suspension_force: 8.0 * model.mass_kg as f32 * gravity * load_ratio,
    }
}

fn mass_properties(model: &VehicleModel) -> MassProperties {
    let [l, w, h] = model.solid_half_m().map(|half| 2.0 * half as f32);
    let mass = model.mass_kg as f32;
    let inertia = Vector::new(w * w + h * h, l * l + h * h, l * l + w * w) * (mass / 12.0);
    let forward_m = (model.front_load_ratio() as f32 - 0.5) * model.wheelbase_m as f32;
    MassProperties::new(Vector::new(forward_m, 0.0, model.mass_height_m() as f32), mass, inertia)
}

/// Centre and half extents of the solid body: the body box less the room below it.
pub(crate) fn chassis_box(model: &VehicleModel) -> (Vector, Vector) {
    let [x, y, z] = model.solid_half_m().map(|half| half as f32);
    let clearance = (0.6 * model.wheel_radius_m as f32).max(0.18);
    let half_z = 0.5 * (2.0 * z - clearance);
    (Vector::new(0.0, 0.0, clearance + half_z), Vector::new(x, y, half_z))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::MapData;
    use crate::vehicle_models;

    #[test]
    fn body_that_is_not_finite_is_put_back_and_harms_nobody_else() {
        let map = std::sync::Arc::new(MapData::flat(100.0));
        let solids = crate::solids::Solids::default().of(&map).expect("the flat map is valid");
        let mut physics = Physics::with_solids(map.origin_m, &solids);
        let at = |x: f64| Isometry3::translation(x, 0.0, 0.1);
        let mut cars: Vec<Vehicle> =
            (0..2).map(|i| Vehicle::new(&mut physics, &vehicle_models()[0], i + 1, &at(20.0 * i as f64))).collect();
        let mut reports = 0;
        for step in 0..200 {
            if step == 100 {
                physics.engine.bodies[cars[0].body].set_linvel(Vector::new(f32::NAN, 0.0, 0.0), true);
            }
            cars.iter_mut().for_each(|car| car.pre_step(&mut physics, 0.01));
            physics.step(0.01);
            reports += cars.iter_mut().filter_map(|car| car.finish_step(&mut physics).then_some(())).count();
        }
        assert_eq!((reports, cars[0].quarantined, cars[1].quarantined), (1, true, false));
        for (car, x_m) in cars.iter().zip([0.0, 20.0]) {
            let place = car.pose(&physics).translation.vector;
            assert!((place.x - x_m).abs() < 0.01 && place.z.abs() < 0.02, "{place}");
        }
        // A new pose brings it back to life.
        cars[0].set_pose(&mut physics, &at(40.0));
        for _ in 0..200 {
            cars[0].pre_step(&mut physics, 0.01);
            physics.step(0.01);
            assert!(!cars[0].finish_step(&mut physics));
        }
        let (velocity, spin) = cars[0].velocity(&physics);
        assert!(velocity.norm() + spin.norm() < 0.01 && cars[0].pose(&physics).translation.z.abs() < 0.02);
    }
}
