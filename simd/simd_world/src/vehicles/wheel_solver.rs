//! Solves the forces between a chassis and the ground together: springs, tyres, brakes, and a
//! rider's balance.
//!
//! Each force is a row: a direction in which a velocity is wanted, and how softly. Rows are
//! spring-dampers evaluated at the *end* of the sub-step (implicitly), so no stiffness and no step
//! length makes them unstable. They are solved in turn for a fixed number of iterations (projected
//! Gauss-Seidel), starting from the impulses of the previous sub-step. Impulses of springs only
//! push; those of tyres stay within the friction of the load.

use rapier3d::math::Vector;
use rapier3d::parry::math::Mat3;

/// Velocities of a chassis while its rows are solved.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Chassis {
    /// Velocity of the centre of mass, m/s.
    pub linear: Vector,
    /// Angular velocity, rad/s.
    pub angular: Vector,
    pub inv_mass: f32,
    /// In world axes.
    pub inv_inertia: Mat3,
}

/// A spring-damper at the end of the sub-step: force = `push_n` − `damping` · speed along the row.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Softness {
    pub push_n: f32,
    pub damping: f32,
}

/// One direction of one force.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Row {
    linear: Vector,
    angular: Vector,
    inv_angular: Vector,
    /// Lever by which the wheel's speed counts in the row's speed, metres.
    wheel_m: f32,
    wheel_inv_inertia: f32,
    /// Change of impulse per error in speed.
    gain: f32,
    softness: f32,
    bias: f32,
    /// Impulse so far, N·s.
    pub impulse: f32,
}

impl Row {
    /// A force along `direction` at `lever` from the centre of mass that turns a wheel of
    /// `radius_m` backwards (0 for none).
    pub fn at(
        chassis: &Chassis,
        direction: Vector,
        lever: Vector,
        radius_m: f32,
        wheel_inv_inertia: f32,
    ) -> Row {
        let angular = lever.cross(direction);
        let row = Row {
            linear: direction,
            angular,
            wheel_m: -radius_m,
            wheel_inv_inertia,
            ..Row::default()
        };
        row.ready(chassis, chassis.inv_mass)
    }

    /// A torque about `axis`.
    pub fn about(chassis: &Chassis, axis: Vector) -> Row {
        Row {
            angular: axis,
            ..Row::default()
        }
        .ready(chassis, 0.0)
    }

    fn ready(mut self, chassis: &Chassis, inv_mass: f32) -> Row {
        self.inv_angular = chassis.inv_inertia * self.angular;
        self.gain = inv_mass
            + self.angular.dot(self.inv_angular)
            + self.wheel_m * self.wheel_m * self.wheel_inv_inertia;
        self
    }

    /// Sets the spring-damper, and applies the impulse to start with.
    pub fn soft(
        mut self,
        soft: Softness,
        dt_secs: f32,
        impulse: f32,
        chassis: &mut Chassis,
        wheel_radps: &mut f32,
    ) -> Row {
        let damping = soft.damping.max(1e-6);
        self.softness = 1.0 / (dt_secs * damping);
        self.bias = -soft.push_n / damping;
        self.gain = 1.0 / (self.gain + self.softness);
        self.push(impulse, chassis, wheel_radps);
        self
    }

    /// Impulse that this row alone would choose.
    fn wanted(&self, chassis: &Chassis, wheel_radps: f32) -> f32 {
        self.impulse
            - self.gain
                * (self.speed(chassis, wheel_radps) + self.bias + self.softness * self.impulse)
    }

    /// Speed along the row.
    pub fn speed(&self, chassis: &Chassis, wheel_radps: f32) -> f32 {
        self.linear.dot(chassis.linear)
            + self.angular.dot(chassis.angular)
            + self.wheel_m * wheel_radps
    }

    fn push(&mut self, impulse: f32, chassis: &mut Chassis, wheel_radps: &mut f32) {
        self.impulse += impulse;
        chassis.linear += self.linear * (impulse * chassis.inv_mass);
        chassis.angular += self.inv_angular * impulse;
        *wheel_radps += self.wheel_m * self.wheel_inv_inertia * impulse;
    }

    /// Solves this row within bounds.
    pub fn solve(&mut self, low: f32, high: f32, chassis: &mut Chassis, wheel_radps: &mut f32) {
        let change = self.wanted(chassis, *wheel_radps).clamp(low, high) - self.impulse;
        self.push(change, chassis, wheel_radps);
    }
}

/// One wheel on the ground.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Contact {
    pub spring: Row,
    pub long: Row,
    pub lat: Row,
    /// Largest impulse of the spring, N·s.
    pub most_load: f32,
    pub friction: f32,
}

/// One wheel: free or braked, on the ground or not.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WheelRows {
    pub contact: Option<Contact>,
    pub radps: f32,
    pub inertia: f32,
    /// Largest angular impulse of brakes and rolling resistance in the sub-step, N·m·s.
    pub most_brake: f32,
    pub brake_impulse: f32,
    /// Viscous resistance times the sub-step, N·m·s per rad/s.
    pub damping: f32,
    pub damping_impulse: f32,
}

impl WheelRows {
    fn solve(&mut self, chassis: &mut Chassis) {
        if self.damping > 0.0 {
            // Implicit: the impulse follows from the speed after it.
            let change = -(self.damping * self.radps + self.damping_impulse)
                / (1.0 + self.damping / self.inertia);
            self.damping_impulse += change;
            self.radps += change / self.inertia;
        }
        if self.most_brake > 0.0 {
            let wanted = self.brake_impulse - self.radps * self.inertia;
            let change = wanted.clamp(-self.most_brake, self.most_brake) - self.brake_impulse;
            self.brake_impulse += change;
            self.radps += change / self.inertia;
        }
        let Some(contact) = &mut self.contact else {
            return;
        };
        contact
            .spring
            .solve(0.0, contact.most_load, chassis, &mut self.radps);
        let grip = contact.friction * contact.spring.impulse;
        let (long, lat) = (
            contact.long.wanted(chassis, self.radps),
            contact.lat.wanted(chassis, self.radps),
        );
        let size = (long * long + lat * lat).sqrt();
        let share = if size > grip { grip / size } else { 1.0 };
        let (long_change, lat_change) = (
            share * long - contact.long.impulse,
            share * lat - contact.lat.impulse,
        );
        contact.long.push(long_change, chassis, &mut self.radps);
        contact.lat.push(lat_change, chassis, &mut self.radps);
    }
}

/// Solves all rows in turn, `n_turns` times.
pub(crate) fn solve(
    chassis: &mut Chassis,
    wheels: &mut [WheelRows],
    balance: Option<&mut (Row, f32)>,
    n_turns: u32,
) {
    let mut balance = balance;
    for _ in 0..n_turns {
        if let Some((row, most)) = balance.as_deref_mut() {
            row.solve(-*most, *most, chassis, &mut 0.0);
        }
        wheels.iter_mut().for_each(|wheel| wheel.solve(chassis));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block() -> Chassis {
        Chassis {
            linear: Vector::ZERO,
            angular: Vector::ZERO,
            inv_mass: 0.01,
            inv_inertia: Mat3::IDENTITY * 0.02,
        }
    }

    /// One implicit step of a spring-damper on a mass has a closed form: v' = (v + dt·push/m) / (1
    /// + dt·c/m).
    #[test]
    fn one_row_is_the_implicit_step_for_any_stiffness() {
        for (damping, dt) in [(1e2, 0.01), (1e5, 0.01), (1e8, 0.1)] {
            let mut chassis = block();
            chassis.linear = Vector::new(0.0, 0.0, -2.0);
            let soft = Softness {
                push_n: 500.0,
                damping,
            };
            let mut row = Row::at(&chassis, Vector::Z, Vector::ZERO, 0.0, 0.0).soft(
                soft,
                dt,
                0.0,
                &mut chassis,
                &mut 0.0,
            );
            row.solve(0.0, f32::INFINITY, &mut chassis, &mut 0.0);
            let expected = (-2.0 + dt * 500.0 * 0.01) / (1.0 + dt * damping * 0.01);
            assert!(
                (chassis.linear.z - expected).abs() < 1e-4 * expected.abs().max(0.01),
                "{} {expected}",
                chassis.linear.z
            );
        }
    }

    #[test]
    fn tyre_and_wheel_exchange_momentum_and_stay_within_friction() {
        let mut chassis = block();
        chassis.linear = Vector::new(10.0, 0.0, 0.0);
        let mut radps = 0.0;
        let rigid = Softness {
            push_n: 0.0,
            damping: 1e9,
        };
        let row = |chassis: &mut Chassis, radps: &mut f32, direction, radius_m, inv_inertia| {
            Row::at(chassis, direction, Vector::ZERO, radius_m, inv_inertia)
                .soft(rigid, 0.01, 0.0, chassis, radps)
        };
        let spring = Row::at(&chassis, Vector::Z, Vector::ZERO, 0.0, 0.0).soft(
            Softness {
                push_n: 1000.0,
                damping: 1.0,
            },
            0.01,
            0.0,
            &mut chassis,
            &mut radps,
        );
        let long = row(&mut chassis, &mut radps, Vector::X, 0.5, 1.0);
        let lat = row(&mut chassis, &mut radps, Vector::Y, 0.0, 0.0);
        let contact = Contact {
            spring,
            long,
            lat,
            most_load: 1e9,
            friction: 100.0,
        };
        let mut rows = [WheelRows {
            contact: Some(contact),
            radps,
            inertia: 1.0,
            most_brake: 0.0,
            brake_impulse: 0.0,
            damping: 0.0,
            damping_impulse: 0.0,
        }];
        solve(&mut chassis, &mut rows, None, 8);
        // The wheel rolls without slip, and it gained the momentum that the body lost: m (v0 − v) =
        // I ω / r.
        let (v, w) = (chassis.linear.x, rows[0].radps);
        assert!((v - 0.5 * w).abs() < 1e-3, "{v} m/s at {w} rad/s");
        assert!(
            (100.0 * (10.0 - v) - w / 0.5).abs() < 0.05,
            "{v} m/s at {w} rad/s"
        );
        // With little friction the tyre only drags: µ N dt.
        let mut chassis = block();
        chassis.linear = Vector::new(10.0, 0.0, 0.0);
        rows[0].radps = 0.0;
        let contact = rows[0].contact.as_mut().unwrap();
        (
            contact.spring.impulse,
            contact.long.impulse,
            contact.lat.impulse,
            contact.friction,
        ) = (0.0, 0.0, 0.0, 0.3);
        solve(&mut chassis, &mut rows, None, 8);
        let contact = rows[0].contact.unwrap();
        assert!(
            (contact.long.impulse + 0.3 * contact.spring.impulse).abs() < 1e-4,
            "{contact:?}"
        );
    }
}
