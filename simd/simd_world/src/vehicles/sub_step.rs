//! One sub-step of one vehicle: steering, powertrain, brakes, air drag, springs and tyres, solved
//! into new velocities of its body.
//!
//! A vehicle reads the engine's world and changes only itself, so any number of threads can plan
//! vehicles with the same result, bit for bit. The new velocities are given to the engine
//! afterwards, in order.

use rapier3d::math::Vector;
use rapier3d::parry::math::Mat3;
use schema_frames::{VehicleTelemetry, WheelTelemetry};

use super::body_state::BodyState;
use super::footing::Feeler;
use super::powertrain::{PowertrainInput, PowertrainOutput, RADPS_PER_RPM};
use super::vehicle::{MAX_WHEELS, Vehicle};
use super::wheel::{Ground, ROLLING_RATIO, Wheel, WheelPose};
use super::wheel_forces::{contact, grip_torques, no_wheel, take_over};
use super::wheel_solver::{Chassis, Row, Softness, WheelRows, solve};
use crate::friction_areas::GroundGrip;
use crate::physics::{GRAVITY_MPS2, Physics};

/// Density of air, kg/m³.
pub(crate) const AIR_KGPM3: f32 = 1.2;
/// How fast the front wheels turn, rad/s.
const STEER_RATE_RADPS: f32 = 3.0;
/// Iterations of the solver in a sub-step.
const SOLVER_TURNS: u32 = 6;
/// Natural frequency with which a rider rights a two-wheeler, rad/s, and time constant with which
/// the wanted lean follows the bend, seconds.
const BALANCE_RADPS: f32 = 7.0;
const LEAN_SECS: f32 = 0.15;
/// Largest lean of a rider: as far as tyres hold.
const MOST_LEAN_RAD: f32 = 0.75;
/// Largest torque of a rider, as a share of the torque that would hold the bike lying.
const BALANCE_RATIO: f32 = 3.0;

/// New velocities of a body: of its centre of mass, and angular.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct NewVelocities {
    pub linear: Vector,
    pub angular: Vector,
}

/// What a vehicle needs to know of the world to plan a sub-step.
#[derive(Clone, Copy)]
pub(crate) struct Around<'a> {
    pub physics: &'a Physics,
    pub ground: GroundGrip<'a>,
    pub dt_secs: f32,
}

impl Vehicle {
    /// Plans a sub-step; `None` if nothing moves this vehicle.
    pub fn plan(&mut self, around: &Around<'_>) -> Option<NewVelocities> {
        if self.quarantined || !self.switches.simulated {
            return None;
        }
        let body = &around.physics.engine.bodies[self.body];
        let pose = *body.position();
        let [forward, left, up] =
            [Vector::X, Vector::Y, Vector::Z].map(|axis| pose.rotation * axis);
        let center = pose * Vector::from(self.physics.center_of_mass_m);
        let velocity = body.linvel();
        let (forward_mps, falling_mps) = (forward.dot(velocity), -up.dot(velocity));
        let start = BodyState {
            pose,
            center,
            forward,
            left,
            up,
            velocity,
            forward_mps,
            falling_mps,
        };
        let rotation = Mat3::from_cols(forward, left, up);
        let inertia = body.mass_properties().local_mprops.principal_inertia();
        let inv_inertia = rotation * Mat3::from_diagonal(1.0 / inertia) * rotation.transpose();
        let mass_kg = self.physics.mass_kg;
        let mut chassis = Chassis {
            linear: body.linvel(),
            angular: body.angvel(),
            inv_mass: 1.0 / mass_kg,
            inv_inertia,
        };
        self.steer(start.forward_mps, around.dt_secs);
        self.fly(&mut chassis, around.dt_secs);
        let powertrain = self.turn_powertrain(around.dt_secs);
        let grounds = self.feel(around, &start);
        let mut rows = [const { None::<WheelRows> }; MAX_WHEELS].map(|_| no_wheel());
        let n_wheels = self.wheels.len().min(MAX_WHEELS);
        for (i, row) in rows.iter_mut().enumerate().take(n_wheels) {
            *row = self.wheel_rows(i, &powertrain, &grounds, &start, &mut chassis, around);
        }
        let mut balance = self.balance(&start, &mut chassis, around.dt_secs);
        solve(
            &mut chassis,
            &mut rows[..n_wheels],
            balance.as_mut(),
            SOLVER_TURNS,
        );
        for (wheel, rows) in self.wheels.iter_mut().zip(&rows) {
            take_over(wheel, rows, &chassis, around.dt_secs);
        }
        self.hold_velocity(&start, &mut chassis);
        Some(NewVelocities {
            linear: chassis.linear,
            angular: chassis.angular,
        })
    }

    fn steer(&mut self, forward_mps: f32, dt_secs: f32) {
        let wanted_rad = self.control.steer_ratio * self.max_steer_rad(forward_mps);
        let most = STEER_RATE_RADPS * dt_secs;
        self.steer_rad += (wanted_rad - self.steer_rad).clamp(-most, most);
        // Ackermann: every front wheel's axle points to one centre on the line of the rear axle.
        let (tan, base_m) = (self.steer_rad.tan(), self.model.wheelbase_m as f32);
        let rear_ratio = self.control.steer_ratio;
        for wheel in &mut self.wheels {
            let [x_m, y_m, _] = wheel.spec.physics.position_m;
            let lock = wheel.spec.physics.max_steer_rad;
            let angle = if x_m > 0.0 {
                (base_m * tan).atan2(base_m - y_m * tan)
            } else {
                rear_ratio * lock
            };
            // In a sharp bend the centre may lie within the track, where no angle of the inner
            // wheel points to it.
            let angle = if angle * self.steer_rad < 0.0 {
                lock.copysign(self.steer_rad)
            } else {
                angle
            };
            wheel.steer_rad = angle.clamp(-lock, lock);
        }
    }

    /// Gravity, air drag and pushes from outside.
    ///
    /// Gravity is applied here and not by the engine: the engine spreads it over its solver's
    /// iterations while the springs answer at once, so at rest the difference would show as a
    /// constant vertical velocity.
    fn fly(&self, chassis: &mut Chassis, dt_secs: f32) {
        let drag_n = -self.drag_n(chassis.linear.length());
        let force_n = Vector::from(self.force_n) + chassis.linear.normalize_or_zero() * drag_n;
        chassis.linear += force_n * (chassis.inv_mass * dt_secs);
        chassis.angular += chassis.inv_inertia * (Vector::from(self.torque_nm) * dt_secs);
        if self.switches.gravity {
            chassis.linear.z -= GRAVITY_MPS2 as f32 * dt_secs;
        }
    }

    fn drag_n(&self, speed_mps: f32) -> f32 {
        let area_m2 = self.physics.drag_coefficient * self.model.frontal_area_m2() as f32;
        0.5 * AIR_KGPM3 * area_m2 * speed_mps * speed_mps
    }

    fn turn_powertrain(&mut self, dt_secs: f32) -> PowertrainOutput {
        let driven = || self.wheels.iter().filter(|wheel| wheel.spec.driven);
        let wheel_radps =
            driven().map(|wheel| wheel.roll_radps).sum::<f32>() / driven().count().max(1) as f32;
        let input = PowertrainInput {
            control: self.control,
            wheel_radps,
            dt_secs,
        };
        self.powertrain
            .step(&self.model.engine, &self.physics, &input)
    }

    /// The ground under each wheel; also sets the friction of each wheel there.
    fn feel(
        &mut self,
        around: &Around<'_>,
        start: &BodyState,
    ) -> [Option<(Ground, WheelPose)>; MAX_WHEELS] {
        // Ground that the body reaches within the sub-step counts already; otherwise a long
        // sub-step would let it fall deep into the ground.
        let reach_m = (start.falling_mps * around.dt_secs).max(0.0);
        let n_wheels = self.wheels.len().min(MAX_WHEELS);
        let mut grounds = [None; MAX_WHEELS];
        let mut feelers = [Feeler::NONE; MAX_WHEELS];
        for ((wheel, ground), feeler) in self.wheels.iter().zip(&mut grounds).zip(&mut feelers) {
            let wheel_pose = wheel.pose(start.pose, [start.forward, start.left, start.up]);
            *feeler = wheel.feeler(&wheel_pose, reach_m);
            *ground = Some((Ground::default(), wheel_pose));
        }
        let Physics { engine, still, .. } = around.physics;
        let sweep = self.physics.sweep_wheels;
        if !sweep {
            self.footing.prepare(
                &feelers[..n_wheels],
                start.velocity,
                still,
                &engine.colliders,
            );
        }
        for ((wheel, ground), feeler) in self.wheels.iter_mut().zip(&mut grounds).zip(&feelers) {
            let Some((_, wheel_pose)) = *ground else {
                continue;
            };
            let felt = match sweep {
                true => wheel.sweep(&wheel_pose, &around.physics.ground_query(), reach_m),
                false => self
                    .footing
                    .feel(feeler, still, &engine.colliders)
                    .map(|felt| wheel.ground(&wheel_pose, &felt)),
            };
            wheel.on_ground = felt.is_some_and(|ground| ground.compression_m >= 0.0);
            wheel.compression_m = felt.map_or(0.0, |ground| ground.compression_m);
            wheel.friction = wheel.spec.physics.friction * around.ground.grip_ratio;
            if let Some(felt) = felt.filter(|_| !around.ground.friction.is_empty()) {
                let inside = around
                    .ground
                    .friction
                    .iter()
                    .find(|area| area.contains(&around.physics.world_point(felt.point)));
                wheel.friction = inside.map_or(wheel.friction, |area| area.friction);
            }
            *ground = felt.map(|felt| (felt, wheel_pose));
        }
        grounds
    }

    fn wheel_rows(
        &mut self,
        i: usize,
        powertrain: &PowertrainOutput,
        grounds: &[Option<(Ground, WheelPose)>; MAX_WHEELS],
        start: &BodyState,
        chassis: &mut Chassis,
        around: &Around<'_>,
    ) -> WheelRows {
        let dt_secs = around.dt_secs;
        let share = self.drive_share(i);
        let n_driven = self
            .wheels
            .iter()
            .filter(|wheel| wheel.spec.driven)
            .count()
            .max(1) as f32;
        let foot = self.control.brake_ratio;
        let hand = self.control.hand_brake;
        let wheel = &mut self.wheels[i];
        let physics = wheel.spec.physics;
        let driven_ratio = if wheel.spec.driven {
            1.0 / n_driven
        } else {
            0.0
        };
        let inertia = wheel.spec.inertia_kgm2 + powertrain.inertia_kgm2 * driven_ratio;
        let (drive_most, brake_most) = grip_torques(wheel, inertia, start.forward_mps);
        wheel.drive_nm = (powertrain.torque_nm * share).clamp(-drive_most, drive_most);
        let brake_nm = (foot * physics.max_brake_nm).min(brake_most);
        let hand_nm = if hand { physics.max_hand_brake_nm } else { 0.0 };
        let rolling_nm = ROLLING_RATIO * wheel.load_n * physics.radius_m;
        let mut rows = WheelRows {
            contact: None,
            radps: wheel.roll_radps + wheel.drive_nm * dt_secs / inertia,
            inertia,
            most_brake: (brake_nm + hand_nm + rolling_nm) * dt_secs,
            brake_impulse: 0.0,
            damping: (physics.damping_nms + powertrain.damping_nms * driven_ratio) * dt_secs,
            damping_impulse: 0.0,
        };
        rows.damping_impulse = -rows.damping * wheel.roll_radps;
        rows.radps += rows.damping_impulse / inertia;
        let before = (wheel.brake_nm * dt_secs).clamp(-rows.most_brake, rows.most_brake);
        rows.brake_impulse = before;
        rows.radps += before / inertia;
        rows.contact = grounds[i].map(|(ground, wheel_pose)| {
            contact(
                wheel,
                &ground,
                &wheel_pose,
                start,
                chassis,
                &mut rows,
                dt_secs,
            )
        });
        rows
    }

    /// Share of the engine's torque that goes to a wheel: by load among the driven wheels, as
    /// limited-slip differentials distribute it.
    fn drive_share(&self, i: usize) -> f32 {
        if !self.wheels[i].spec.driven {
            return 0.0;
        }
        let driven = || self.wheels.iter().filter(|wheel| wheel.spec.driven);
        let load_n: f32 = driven().map(|wheel| wheel.load_n).sum();
        if load_n > 0.0 {
            self.wheels[i].load_n / load_n
        } else {
            1.0 / driven().count() as f32
        }
    }

    /// The row of a rider who leans into the bend and balances: a spring about the line through the
    /// wheels towards the lean that the bend needs.
    fn balance(
        &mut self,
        start: &BodyState,
        chassis: &mut Chassis,
        dt_secs: f32,
    ) -> Option<(Row, f32)> {
        // A bike that lies on its side is not balanced.
        if !self.model.is_two_wheeler() || start.up.z < 0.4 {
            return None;
        }
        let gravity = GRAVITY_MPS2 as f32;
        let lateral_mps2 = start.forward_mps * chassis.angular.z;
        let wanted = -(lateral_mps2 / gravity)
            .atan()
            .clamp(-MOST_LEAN_RAD, MOST_LEAN_RAD);
        self.lean_rad += (wanted - self.lean_rad) * (dt_secs / LEAN_SECS).min(1.0);
        let (height_m, mass_kg) = (self.physics.center_of_mass_m[2], self.physics.mass_kg);
        let inertia = 1.0 / start.forward.dot(chassis.inv_inertia * start.forward)
            + mass_kg * height_m * height_m;
        let stiffness = inertia * BALANCE_RADPS * BALANCE_RADPS;
        let lean = start.left.z.clamp(-1.0, 1.0).asin();
        let soft = Softness {
            push_n: stiffness * (self.lean_rad - lean),
            damping: 2.0 * inertia * BALANCE_RADPS + stiffness * dt_secs,
        };
        let row = Row::about(chassis, start.forward).soft(soft, dt_secs, 0.0, chassis, &mut 0.0);
        Some((row, BALANCE_RATIO * mass_kg * gravity * height_m * dt_secs))
    }

    /// A held velocity replaces the solved one, except for falling.
    fn hold_velocity(&self, start: &BodyState, chassis: &mut Chassis) {
        let Some([x, y, z]) = self.switches.held_mps else {
            return;
        };
        let held = start.forward * x + start.left * y + start.up * z;
        let origin = held + chassis.angular.cross(start.center - start.pose.translation);
        chassis.linear = Vector::new(
            origin.x,
            origin.y,
            if z == 0.0 { chassis.linear.z } else { origin.z },
        );
    }

    /// Telemetry of the last sub-step.
    pub fn telemetry(&self, physics: &Physics) -> VehicleTelemetry {
        let (velocity, _) = self.velocity(physics);
        let wheel = |wheel: &Wheel| {
            let (rest_n, grip_n) = (wheel.spec.rest_load_n, wheel.load_n);
            WheelTelemetry {
                friction: wheel.friction,
                lat_slip_rad: wheel.slip[1],
                long_slip_ratio: wheel.slip[0],
                roll_radps: wheel.roll_radps,
                load_n: grip_n,
                load_ratio: grip_n / rest_n,
                torque_nm: wheel.drive_nm + wheel.brake_nm,
                long_n: wheel.force_n[0],
                lat_n: wheel.force_n[1],
                steer_rad: wheel.visible_steer_rad(),
                roll_rad: wheel.roll_rad,
            }
        };
        VehicleTelemetry {
            speed_mps: self.forward_mps(physics),
            steer_ratio: self.control.steer_ratio,
            throttle_ratio: self.control.throttle_ratio,
            brake_ratio: self.control.brake_ratio,
            engine_rpm: self.powertrain.engine_radps / RADPS_PER_RPM,
            gear: self.powertrain.gear,
            drag_n: self.drag_n(velocity.norm() as f32),
            wheels: self.wheels.iter().map(wheel).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;

    use super::*;
    use crate::map_data::MapData;
    use crate::vehicles::vehicle_models;

    const DRY: GroundGrip<'static> = GroundGrip {
        friction: &[],
        grip_ratio: 1.0,
    };

    fn flat_ground() -> Physics {
        let map = std::sync::Arc::new(MapData::flat(100.0));
        let solids = crate::physics::Solids::default()
            .of(&map)
            .expect("the flat map is valid");
        Physics::with_solids(map.origin_m, &solids)
    }

    fn step(physics: &mut Physics, cars: &mut [Vehicle]) {
        physics.refresh_still();
        for car in cars {
            let around = Around {
                physics,
                ground: DRY,
                dt_secs: 0.01,
            };
            if let Some(motion) = car.plan(&around) {
                let body = &mut physics.engine.bodies[car.body];
                body.set_linvel(motion.linear, true);
                body.set_angvel(motion.angular, true);
            }
        }
        physics.step(0.01);
    }

    #[test]
    fn body_that_is_not_finite_is_put_back_and_harms_nobody_else() {
        let mut physics = flat_ground();
        let at = |x: f64| Isometry3::translation(x, 0.0, 0.1);
        let mut cars: Vec<Vehicle> = (0..2)
            .map(|i| {
                Vehicle::new(
                    &mut physics,
                    &vehicle_models()[0],
                    i + 1,
                    &at(20.0 * i as f64),
                )
            })
            .collect();
        let mut reports = 0;
        for i in 0..200 {
            if i == 100 {
                physics.engine.bodies[cars[0].body]
                    .set_linvel(Vector::new(f32::NAN, 0.0, 0.0), true);
            }
            step(&mut physics, &mut cars);
            reports += cars
                .iter_mut()
                .filter_map(|car| car.finish_step(&mut physics).then_some(()))
                .count();
        }
        assert_eq!(
            (reports, cars[0].quarantined, cars[1].quarantined),
            (1, true, false)
        );
        for (car, x_m) in cars.iter().zip([0.0, 20.0]) {
            let place = car.pose(&physics).translation.vector;
            assert!(
                (place.x - x_m).abs() < 0.01 && place.z.abs() < 0.02,
                "{place}"
            );
        }
        // Setting a pose ends the quarantine.
        cars[0].set_pose(&mut physics, &at(40.0));
        for _ in 0..300 {
            step(&mut physics, &mut cars);
            assert!(!cars[0].finish_step(&mut physics));
        }
        let (velocity, spin) = cars[0].velocity(&physics);
        assert!(
            velocity.norm() + spin.norm() < 0.01
                && cars[0].pose(&physics).translation.z.abs() < 0.02
        );
    }

    /// A vehicle comes back from its serialised form bit for bit.
    #[test]
    fn a_vehicle_survives_being_written_down() {
        let mut physics = flat_ground();
        let mut cars = [Vehicle::new(
            &mut physics,
            &vehicle_models()[1],
            1,
            &Isometry3::translation(0.0, 0.0, 0.1),
        )];
        cars[0].control.throttle_ratio = 0.7;
        cars[0].control.steer_ratio = 0.2;
        (0..150).for_each(|_| step(&mut physics, &mut cars));
        let text = serde_json::to_string(&cars[0]).unwrap();
        let mut again: Vehicle = serde_json::from_str(&text).unwrap();
        assert_eq!(serde_json::to_string(&again).unwrap(), text);
        let around = Around {
            physics: &physics,
            ground: DRY,
            dt_secs: 0.01,
        };
        assert_eq!(cars[0].plan(&around), again.plan(&around));
    }
}
