//! IMU: specific force, angular velocity and compass from the exact state of the body that carries
//! it.
//!
//! The specific force is what a strap-down unit integrates: the velocity gained by the sensor's own
//! point over the tick, divided by the tick, less gravity, in the sensor's orientation at the
//! middle of the tick. In theory it equals the second derivative of a quadratic through three
//! positions. It is taken from velocities instead, because the physics engine's `f32` positions
//! (6e-5 m at 1 km) would turn into 0.6 m/s² of noise at 100 Hz. Lever arm, mounting rotation and
//! centripetal terms are included.
//!
//! The model reads no clock and keeps no state but the last two ticks; noise is a function of
//! (seed, sensor, tick).

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use schema_frames::ImuSample;
use schema_types::SimTime;
use schema_types::noise::Noise;
use sensor_spec::ImuSpec;

/// Gravity where nothing else is given, m/s².
pub const STANDARD_GRAVITY_MPS2: f64 = 9.81;

/// State of the body that carries the sensor at the end of one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyState {
    /// Time of the state.
    pub sim_time: SimTime,
    /// Pose of the body's origin.
    pub world_from_vehicle: Isometry3<f64>,
    /// Velocity of the body's origin, m/s.
    pub velocity_in_world_mps: Vector3<f64>,
    /// Angular velocity, rad/s.
    pub angular_velocity_in_world_radps: Vector3<f64>,
}

impl BodyState {
    /// Velocity of a point fixed to the body.
    pub fn velocity_at(&self, point_in_vehicle_m: &Vector3<f64>) -> Vector3<f64> {
        let arm_in_world_m = self.world_from_vehicle.rotation * point_in_vehicle_m;
        self.velocity_in_world_mps + self.angular_velocity_in_world_radps.cross(&arm_in_world_m)
    }
}

/// The last two states of a body. Push one per tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BodyMotion {
    previous: Option<BodyState>,
    current: Option<BodyState>,
}

impl BodyMotion {
    /// Adds the state at the end of a tick. A time that does not lie ahead begins the history anew.
    pub fn push(&mut self, state: BodyState) {
        let ahead = self
            .current
            .is_some_and(|current| state.sim_time > current.sim_time);
        self.previous = if ahead { self.current } else { None };
        self.current = Some(state);
    }

    /// Forgets the history: after a teleport or a respawn, so that the jump does not read as an
    /// acceleration.
    pub fn reset(&mut self) {
        *self = BodyMotion::default();
    }

    /// What an IMU mounted at `vehicle_from_sensor` feels; `None` before the first state. With a
    /// single state the acceleration is zero.
    pub fn at(&self, vehicle_from_sensor: &Isometry3<f64>, gravity_mps2: f64) -> Option<ImuInput> {
        let now = self.current?;
        let arm_m = vehicle_from_sensor.translation.vector;
        let (acceleration_in_world_mps2, vehicle_mid) = match self.previous {
            Some(before) => {
                let dt_secs = (now.sim_time.0 - before.sim_time.0) as f64 * 1e-9;
                let gained_mps = now.velocity_at(&arm_m) - before.velocity_at(&arm_m);
                (
                    gained_mps / dt_secs,
                    halfway(
                        &before.world_from_vehicle.rotation,
                        &now.world_from_vehicle.rotation,
                    ),
                )
            }
            None => (Vector3::zeros(), now.world_from_vehicle.rotation),
        };
        Some(ImuInput {
            acceleration_in_world_mps2,
            world_from_sensor_mid: vehicle_mid * vehicle_from_sensor.rotation,
            angular_velocity_in_world_radps: now.angular_velocity_in_world_radps,
            world_from_sensor: now.world_from_vehicle.rotation * vehicle_from_sensor.rotation,
            gravity_mps2,
        })
    }
}

/// The rotation half-way between two; the second one if they are opposite.
fn halfway(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    a.try_slerp(b, 0.5, 1e-9).unwrap_or(*b)
}

/// Everything that a sample depends on, except noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuInput {
    /// Acceleration of the sensor's own point, averaged over the tick.
    pub acceleration_in_world_mps2: Vector3<f64>,
    /// Orientation of the sensor at the middle of that time.
    pub world_from_sensor_mid: UnitQuaternion<f64>,
    /// Angular velocity at the tick, rad/s.
    pub angular_velocity_in_world_radps: Vector3<f64>,
    /// Orientation of the sensor at the tick.
    pub world_from_sensor: UnitQuaternion<f64>,
    /// Gravity, positive, along world −z.
    pub gravity_mps2: f64,
}

/// One sample. The specific force takes noise samples 0–2 (x, y, z), the angular velocity 3–5.
pub fn sample(spec: &ImuSpec, input: &ImuInput, noise: Noise) -> ImuSample {
    let lift = Vector3::z() * input.gravity_mps2;
    let force = input
        .world_from_sensor_mid
        .inverse_transform_vector(&(input.acceleration_in_world_mps2 + lift));
    let turn = input
        .world_from_sensor
        .inverse_transform_vector(&input.angular_velocity_in_world_radps);
    let gaussian = |stddev: f64, number: u64| {
        if stddev > 0.0 {
            stddev * noise.gaussian(number)
        } else {
            0.0
        }
    };
    ImuSample {
        specific_force_mps2: std::array::from_fn(|axis| {
            force[axis] + gaussian(spec.noise_accel_stddev_mps2[axis], axis as u64)
        }),
        angular_velocity_radps: std::array::from_fn(|axis| {
            turn[axis]
                + spec.bias_gyro_radps[axis]
                + gaussian(spec.noise_gyro_stddev_radps[axis], 3 + axis as u64)
        }),
        compass_rad: compass_rad(&input.world_from_sensor),
        reserved: [0; 2],
    }
}

/// Heading of the sensor's forward axis, clockwise from north (world +y), in [0, 2π). East is world
/// +x.
///
/// A sensor that looks straight up or down reads 0.
pub fn compass_rad(world_from_sensor: &UnitQuaternion<f64>) -> f64 {
    let forward = world_from_sensor * Vector3::x();
    let angle = forward.x.atan2(forward.y).rem_euclid(std::f64::consts::TAU);
    // A tiny negative angle plus 2π rounds to 2π itself.
    if angle < std::f64::consts::TAU {
        angle
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI, TAU};

    const DT_NANOS: u64 = 10_000_000;

    /// States of a body at ticks 1 and 2 from a closed-form motion of time in seconds, then the
    /// noiseless sample.
    fn feel(
        mount: Isometry3<f64>,
        spec: &ImuSpec,
        state: impl Fn(f64) -> (Isometry3<f64>, Vector3<f64>, Vector3<f64>),
    ) -> ImuSample {
        let mut motion = BodyMotion::default();
        for tick in 1..=2 {
            let sim_time = SimTime(tick * DT_NANOS);
            let (world_from_vehicle, velocity_in_world_mps, angular_velocity_in_world_radps) =
                state(sim_time.as_secs());
            motion.push(BodyState {
                sim_time,
                world_from_vehicle,
                velocity_in_world_mps,
                angular_velocity_in_world_radps,
            });
        }
        sample(spec, &motion.at(&mount, 9.81).unwrap(), Noise::new(1, 2, 3))
    }

    fn close(found: [f64; 3], expected: [f64; 3], tolerance: f64) {
        assert!(
            (0..3).all(|axis| (found[axis] - expected[axis]).abs() < tolerance),
            "{found:?} is not {expected:?}"
        );
    }

    #[test]
    fn at_rest_z_reads_plus_9_81() {
        let sample = feel(Isometry3::identity(), &ImuSpec::default(), |_| {
            (Isometry3::identity(), Vector3::zeros(), Vector3::zeros())
        });
        close(sample.specific_force_mps2, [0.0, 0.0, 9.81], 1e-12);
        close(sample.angular_velocity_radps, [0.0; 3], 1e-12);
    }

    #[test]
    fn free_fall_reads_nothing() {
        let sample = feel(Isometry3::identity(), &ImuSpec::default(), |t| {
            (
                Isometry3::translation(3.0 * t, 0.0, -0.5 * 9.81 * t * t),
                Vector3::new(3.0, 0.0, -9.81 * t),
                Vector3::zeros(),
            )
        });
        close(sample.specific_force_mps2, [0.0; 3], 1e-9);
    }

    #[test]
    fn a_circle_at_constant_speed_reads_the_centripetal_acceleration_to_the_left() {
        // 15 m/s on a radius of 30 m, turning left: v²/r = 7.5 m/s² along y, v/r = 0.5 rad/s about
        // z.
        let sample = feel(Isometry3::identity(), &ImuSpec::default(), |t| {
            circle(15.0, 30.0, t)
        });
        // A chord over an angle of 0.005 rad is shorter than its arc by 0.005²/24 of it.
        close(sample.specific_force_mps2, [0.0, 7.5, 9.81], 7.5e-5);
        close(sample.angular_velocity_radps, [0.0, 0.0, 0.5], 1e-12);
    }

    #[test]
    fn a_mount_off_the_origin_adds_its_lever_arm() {
        // 10 m further out on the same turn: ω² r = 0.25 · 40.
        let mount = Isometry3::translation(0.0, -10.0, 1.0);
        let sample = feel(mount, &ImuSpec::default(), |t| circle(15.0, 30.0, t));
        close(sample.specific_force_mps2, [0.0, 10.0, 9.81], 1e-4);
    }

    fn circle(
        speed_mps: f64,
        radius_m: f64,
        t: f64,
    ) -> (Isometry3<f64>, Vector3<f64>, Vector3<f64>) {
        let (rate, angle) = (speed_mps / radius_m, speed_mps / radius_m * t);
        let position = Vector3::new(radius_m * angle.sin(), radius_m * (1.0 - angle.cos()), 0.0);
        let pose = Isometry3::new(position, Vector3::z() * angle);
        (
            pose,
            pose.rotation * Vector3::x() * speed_mps,
            Vector3::z() * rate,
        )
    }

    #[test]
    fn a_tilted_mount_splits_gravity_and_turn_between_its_axes() {
        // Nose down by 30° (positive pitch about y): gravity's reaction shows on −x, and so does a
        // turn about the vertical.
        let mount = Isometry3::rotation(Vector3::y() * (PI / 6.0));
        let spec = ImuSpec {
            bias_gyro_radps: [0.01, 0.02, 0.03],
            ..Default::default()
        };
        let sample = feel(mount, &spec, |t| {
            (
                Isometry3::rotation(Vector3::z() * 0.4 * t),
                Vector3::zeros(),
                Vector3::z() * 0.4,
            )
        });
        close(
            sample.specific_force_mps2,
            [-9.81 * 0.5, 0.0, 9.81 * (PI / 6.0).cos()],
            1e-9,
        );
        close(
            sample.angular_velocity_radps,
            [-0.2 + 0.01, 0.02, 0.4 * (PI / 6.0).cos() + 0.03],
            1e-12,
        );
    }

    #[test]
    fn compass_turns_clockwise_from_north() {
        let yaw = |angle: f64| compass_rad(&UnitQuaternion::from_euler_angles(0.0, 0.0, angle));
        assert!(
            yaw(FRAC_PI_2).abs() < 1e-12 || yaw(FRAC_PI_2) > TAU - 1e-12,
            "facing +y is north"
        );
        assert!((yaw(0.0) - FRAC_PI_2).abs() < 1e-12, "facing +x is east");
        assert!((yaw(-FRAC_PI_2) - PI).abs() < 1e-12, "facing −y is south");
        assert!((yaw(PI) - 1.5 * PI).abs() < 1e-12, "facing −x is west");
        for i in 0..1000 {
            assert!((0.0..TAU).contains(&yaw(FRAC_PI_2 + i as f64 * 1e-17)));
        }
    }

    #[test]
    fn the_first_state_and_a_teleport_feel_no_acceleration() {
        let state = |secs: f64, x: f64| BodyState {
            sim_time: SimTime((secs * 1e9) as u64),
            world_from_vehicle: Isometry3::translation(x, 0.0, 0.0),
            velocity_in_world_mps: Vector3::new(x, 0.0, 0.0),
            angular_velocity_in_world_radps: Vector3::zeros(),
        };
        let mut motion = BodyMotion::default();
        assert_eq!(motion.at(&Isometry3::identity(), 9.81), None);
        motion.push(state(1.0, 0.0));
        motion.reset();
        motion.push(state(1.1, 1e4));
        assert_eq!(
            motion
                .at(&Isometry3::identity(), 9.81)
                .unwrap()
                .acceleration_in_world_mps2,
            Vector3::zeros()
        );
        motion.push(state(1.1, 0.0));
        assert_eq!(
            motion
                .at(&Isometry3::identity(), 9.81)
                .unwrap()
                .acceleration_in_world_mps2,
            Vector3::zeros()
        );
    }

    #[test]
    fn noise_has_the_asked_spread_and_repeats_with_its_key() {
        let spec = ImuSpec {
            noise_accel_stddev_mps2: [0.1, 0.2, 0.3],
            noise_gyro_stddev_radps: [0.01, 0.02, 0.03],
            bias_gyro_radps: [1.0, 2.0, 3.0],
            ..Default::default()
        };
        let input = ImuInput {
            acceleration_in_world_mps2: Vector3::zeros(),
            world_from_sensor_mid: UnitQuaternion::identity(),
            angular_velocity_in_world_radps: Vector3::zeros(),
            world_from_sensor: UnitQuaternion::identity(),
            gravity_mps2: 9.81,
        };
        let n = 20_000;
        let (mut squares, mut gyro_sum) = ([0.0; 6], [0.0; 3]);
        for tick in 0..n {
            let found = sample(&spec, &input, Noise::new(5, 9, tick));
            assert_eq!(found, sample(&spec, &input, Noise::new(5, 9, tick)));
            for axis in 0..3 {
                squares[axis] += (found.specific_force_mps2[axis] - [0.0, 0.0, 9.81][axis]).powi(2);
                squares[3 + axis] +=
                    (found.angular_velocity_radps[axis] - spec.bias_gyro_radps[axis]).powi(2);
                gyro_sum[axis] += found.angular_velocity_radps[axis];
            }
        }
        for (i, expected) in [0.1, 0.2, 0.3, 0.01, 0.02, 0.03].into_iter().enumerate() {
            // Relative standard error of a standard deviation is 1/√(2n) = 0.5 %; five of them.
            assert!(
                ((squares[i] / n as f64).sqrt() / expected - 1.0).abs() < 0.025,
                "axis {i}"
            );
        }
        assert!(
            (0..3)
                .all(|axis| (gyro_sum[axis] / n as f64 - spec.bias_gyro_radps[axis]).abs() < 0.002)
        );
    }
}
