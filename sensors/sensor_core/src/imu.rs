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
//! The model reads no clock and keeps no state but the last two ticks, and what its bandwidth let
//! through of earlier ones. Noise is a function of (seed, sensor, tick), drift one of (seed, sensor,
//! time).
//!
//! Sources: IEEE Std 952, *Specification Format Guide and Test Procedure for Single-Axis
//! Interferometric Fiber Optic Gyros*, annex C, for noise density, bias instability and random walk.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use schema_frames::ImuSample;
use schema_types::SimTime;
use schema_types::noise::Noise;
use sensor_spec::ImuSpec;

use crate::drift::Drift;

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

/// What an IMU remembers: the motion of its body, and what its bandwidth lets through.
#[derive(Clone, Debug, PartialEq)]
pub struct ImuState {
    motion: BodyMotion,
    /// Bandwidths of specific force and angular velocity, hertz; 0 is no limit.
    bandwidths_hz: [f64; 2],
    passed: Option<(SimTime, Felt)>,
}

impl ImuState {
    /// An IMU that has felt nothing yet.
    pub fn new(spec: &ImuSpec) -> Self {
        ImuState {
            motion: BodyMotion::default(),
            bandwidths_hz: [spec.bandwidth_accel_hz, spec.bandwidth_gyro_hz],
            passed: None,
        }
    }

    /// Adds the state of the body at the end of a tick.
    pub fn push(
        &mut self,
        state: BodyState,
        vehicle_from_sensor: &Isometry3<f64>,
        gravity_mps2: f64,
    ) {
        self.motion.push(state);
        if self.bandwidths_hz == [0.0; 2] {
            return;
        }
        let Some(input) = self.motion.at(vehicle_from_sensor, gravity_mps2) else {
            return;
        };
        let mut now = input.felt();
        if let Some((time, before)) = self.passed.filter(|(time, _)| *time < state.sim_time) {
            let secs = (state.sim_time.0 - time.0) as f64 * 1e-9;
            let kept = self.bandwidths_hz.map(|hz| kept(hz, secs));
            now.force_mps2 += (before.force_mps2 - now.force_mps2) * kept[0];
            now.turn_radps += (before.turn_radps - now.turn_radps) * kept[1];
        }
        self.passed = Some((state.sim_time, now));
    }

    /// What it measures now, without errors: what it feels, and its orientation. `None` before the
    /// first state.
    pub fn at(
        &self,
        vehicle_from_sensor: &Isometry3<f64>,
        gravity_mps2: f64,
    ) -> Option<(Felt, UnitQuaternion<f64>)> {
        let input = self.motion.at(vehicle_from_sensor, gravity_mps2)?;
        let felt = self
            .passed
            .map_or_else(|| input.felt(), |(_, passed)| passed);
        Some((felt, input.world_from_sensor))
    }

    /// Forgets everything: after a teleport or a respawn.
    pub fn reset(&mut self) {
        self.motion.reset();
        self.passed = None;
    }
}

/// Share of what a low-pass of first order held that is left after a time; 0 without a limit.
fn kept(bandwidth_hz: f64, secs: f64) -> f64 {
    if bandwidth_hz > 0.0 {
        (-std::f64::consts::TAU * bandwidth_hz * secs).exp()
    } else {
        0.0
    }
}

/// What an IMU feels along its own axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Felt {
    /// Specific force, m/s².
    pub force_mps2: Vector3<f64>,
    /// Angular velocity, rad/s.
    pub turn_radps: Vector3<f64>,
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

impl ImuInput {
    /// What the sensor feels along its own axes.
    pub fn felt(&self) -> Felt {
        let lift = Vector3::z() * self.gravity_mps2;
        Felt {
            force_mps2: self
                .world_from_sensor_mid
                .inverse_transform_vector(&(self.acceleration_in_world_mps2 + lift)),
            turn_radps: self
                .world_from_sensor
                .inverse_transform_vector(&self.angular_velocity_in_world_radps),
        }
    }
}

/// Where the random numbers of a sample come from.
#[derive(Clone, Copy, Debug)]
pub struct ImuNoise {
    /// Key of the tick. The specific force takes samples 0–2 (x, y, z), the angular velocity 3–5; white
    /// noise by its density takes 6–8 and 9–11.
    pub of_tick: Noise,
    /// Slow errors.
    pub drift: Drift,
    /// Time since the sample before, seconds.
    pub window_secs: f64,
}

/// Correlation times of the Gauss-Markov processes that make a bias instability: one a decade, so that
/// the Allan deviation is level within 5 % from 4 s to 600 s.
const INSTABILITY_SECS: [f64; 4] = [1.0, 10.0, 100.0, 1000.0];

/// Numbers of an axis' processes: its random walk, its white noise within the bandwidth, and its bias
/// instability from the third on.
const AXIS_PROCESSES: u64 = 8;

/// Errors of the accelerometer or of the gyroscope.
struct Triad<'a> {
    /// Number of its first axis among all.
    first: u64,
    stddev: &'a [f64; 3],
    density: &'a [f64; 3],
    instability: &'a [f64; 3],
    walk: &'a [f64; 3],
    bias: &'a [f64; 3],
    scale: &'a [f64; 3],
    misalignment: &'a [f64; 6],
    bandwidth_hz: f64,
    range: f64,
}

impl Triad<'_> {
    /// What it measures where it feels `felt`, along each of its axes; `shown` is added.
    fn measure(&self, felt: &Vector3<f64>, shown: [f64; 3], noise: &ImuNoise) -> [f64; 3] {
        let others = [[1, 2], [0, 2], [0, 1]];
        std::array::from_fn(|axis| {
            let aside: f64 = (0..2)
                .map(|i| self.misalignment[2 * axis + i] * felt[others[axis][i]])
                .sum();
            let exact = self.scale[axis] * felt[axis] + aside + shown[axis];
            let measured = exact + self.bias[axis] + self.error(axis, noise);
            if self.range > 0.0 {
                measured.clamp(-self.range, self.range)
            } else {
                measured
            }
        })
    }

    /// Random errors of an axis.
    fn error(&self, axis: usize, noise: &ImuNoise) -> f64 {
        let number = self.first + axis as u64;
        let process = AXIS_PROCESSES * number;
        let mut error = 0.0;
        if self.stddev[axis] > 0.0 {
            error += self.stddev[axis] * noise.of_tick.gaussian(number);
        }
        if self.density[axis] > 0.0 {
            // A density N gives samples that are Δt apart a variance of N²/Δt.
            let spread = self.density[axis] / noise.window_secs.max(1e-9).sqrt();
            let kept = kept(self.bandwidth_hz, noise.window_secs);
            error += if kept > 1e-9 {
                // The low-pass makes it a process that forgets, with the same density at frequency 0.
                let correlation_secs = 1.0 / (std::f64::consts::TAU * self.bandwidth_hz);
                let value = noise.drift.gauss_markov(process + 1, correlation_secs);
                spread * ((1.0 - kept) / (1.0 + kept)).sqrt() * value
            } else {
                spread * noise.of_tick.gaussian(6 + number)
            };
        }
        if self.instability[axis] > 0.0 {
            // The spectrum B²/2πf as a sum of processes of equal variance, a decade apart.
            let spread =
                self.instability[axis] * (std::f64::consts::LN_10 / std::f64::consts::PI).sqrt();
            for (i, correlation_secs) in (2..).zip(INSTABILITY_SECS) {
                error += spread * noise.drift.gauss_markov(process + i, correlation_secs);
            }
        }
        if self.walk[axis] > 0.0 {
            error += self.walk[axis] * noise.drift.walk(process);
        }
        error
    }
}

/// One sample of what an IMU feels, with its orientation.
pub fn sample(
    spec: &ImuSpec,
    (felt, world_from_sensor): &(Felt, UnitQuaternion<f64>),
    noise: &ImuNoise,
) -> ImuSample {
    let accel = Triad {
        first: 0,
        stddev: &spec.noise_accel_stddev_mps2,
        density: &spec.density_accel_mps2_rthz,
        instability: &spec.instability_accel_mps2,
        walk: &spec.walk_accel_mps2_rts,
        bias: &spec.bias_accel_mps2,
        scale: &spec.scale_accel_ratio,
        misalignment: &spec.misalignment_accel_rad,
        bandwidth_hz: spec.bandwidth_accel_hz,
        range: spec.range_accel_mps2,
    };
    let gyro = Triad {
        first: 3,
        stddev: &spec.noise_gyro_stddev_radps,
        density: &spec.density_gyro_radps_rthz,
        instability: &spec.instability_gyro_radps,
        walk: &spec.walk_gyro_radps_rts,
        bias: &spec.bias_gyro_radps,
        scale: &spec.scale_gyro_ratio,
        misalignment: &spec.misalignment_gyro_rad,
        bandwidth_hz: spec.bandwidth_gyro_hz,
        range: spec.range_gyro_radps,
    };
    let shown = |axis: usize| spec.g_sensitivity_radps_mps2[axis] * felt.force_mps2[axis];
    ImuSample {
        specific_force_mps2: accel.measure(&felt.force_mps2, [0.0; 3], noise),
        angular_velocity_radps: gyro.measure(&felt.turn_radps, [0, 1, 2].map(shown), noise),
        compass_rad: compass_rad(world_from_sensor),
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
        let mut motion = ImuState::new(spec);
        for tick in 1..=2 {
            let sim_time = SimTime(tick * DT_NANOS);
            let (world_from_vehicle, velocity_in_world_mps, angular_velocity_in_world_radps) =
                state(sim_time.as_secs());
            let now = BodyState {
                sim_time,
                world_from_vehicle,
                velocity_in_world_mps,
                angular_velocity_in_world_radps,
            };
            motion.push(now, &mount, 9.81);
        }
        sample(spec, &motion.at(&mount, 9.81).unwrap(), &noise(1, 3))
    }

    /// Numbers of a tick of an IMU that fires at every tick.
    fn noise(seed: u64, tick: u64) -> ImuNoise {
        ImuNoise {
            of_tick: Noise::new(seed, 2, tick),
            drift: Drift {
                seed,
                stream: 2,
                age_nanos: tick * DT_NANOS,
            },
            window_secs: DT_NANOS as f64 * 1e-9,
        }
    }

    /// What stands still, level.
    fn rest() -> (Felt, UnitQuaternion<f64>) {
        let felt = Felt {
            force_mps2: Vector3::z() * 9.81,
            turn_radps: Vector3::zeros(),
        };
        (felt, UnitQuaternion::identity())
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
        let n = 20_000;
        let (mut squares, mut gyro_sum) = ([0.0; 6], [0.0; 3]);
        for tick in 0..n {
            let found = sample(&spec, &rest(), &noise(5, tick));
            assert_eq!(found, sample(&spec, &rest(), &noise(5, tick)));
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

    #[test]
    fn scale_misalignment_g_sensitivity_bias_and_range_do_what_their_names_say() {
        let spec = ImuSpec {
            scale_accel_ratio: [1.01, 1.0, 0.98],
            misalignment_accel_rad: [0.1, 0.2, 0.3, 0.4, 0.5, 0.6],
            bias_accel_mps2: [0.0, 0.0, 1.0],
            scale_gyro_ratio: [1.5, 1.0, 1.0],
            misalignment_gyro_rad: [0.0, 0.0, 0.0, 0.0, 0.1, 0.0],
            g_sensitivity_radps_mps2: [0.001, 0.002, 0.003],
            ..ImuSpec::default()
        };
        let felt = Felt {
            force_mps2: Vector3::new(1.0, 2.0, 3.0),
            turn_radps: Vector3::new(0.4, 0.0, 1.0),
        };
        let found = sample(&spec, &(felt, UnitQuaternion::identity()), &noise(1, 1));
        close(
            found.specific_force_mps2,
            [1.01 + 0.2 + 0.6, 2.0 + 0.3 + 1.2, 2.94 + 0.5 + 1.2 + 1.0],
            1e-12,
        );
        close(
            found.angular_velocity_radps,
            [0.6 + 0.001, 0.004, 1.0 + 0.04 + 0.009],
            1e-12,
        );
        let limited = ImuSpec {
            range_accel_mps2: 2.5,
            range_gyro_radps: 0.5,
            ..ImuSpec::default()
        };
        let felt = Felt {
            force_mps2: Vector3::new(1.0, -20.0, 3.0),
            turn_radps: Vector3::new(0.4, -0.9, 1.0),
        };
        let found = sample(&limited, &(felt, UnitQuaternion::identity()), &noise(1, 1));
        close(found.specific_force_mps2, [1.0, -2.5, 2.5], 1e-15);
        close(found.angular_velocity_radps, [0.4, -0.5, 0.5], 1e-15);
    }

    /// A step passes a low-pass of first order as 1 − exp(−2πft).
    #[test]
    fn bandwidth_delays_what_is_felt() {
        let spec = ImuSpec {
            bandwidth_accel_hz: 5.0,
            ..ImuSpec::default()
        };
        let mut state = ImuState::new(&spec);
        let mount = Isometry3::identity();
        let (mut speed_mps, mut passed) = (0.0, Vec::new());
        for tick in 1..=30_u64 {
            if tick > 10 {
                speed_mps += 2.0 * DT_NANOS as f64 * 1e-9;
            }
            let now = BodyState {
                sim_time: SimTime(tick * DT_NANOS),
                world_from_vehicle: Isometry3::identity(),
                velocity_in_world_mps: Vector3::x() * speed_mps,
                angular_velocity_in_world_radps: Vector3::z() * (tick % 2) as f64,
            };
            state.push(now, &mount, 9.81);
            passed.push(state.at(&mount, 9.81).unwrap().0);
        }
        for (i, felt) in passed.iter().enumerate().skip(10) {
            let secs = (i - 9) as f64 * 0.01;
            let wanted = 2.0 * (1.0 - (-TAU * 5.0 * secs).exp());
            assert!((felt.force_mps2.x - wanted).abs() < 1e-9, "{i} {felt:?}");
            // The gyroscope has no limit.
            assert_eq!(felt.turn_radps.z, ((i + 1) % 2) as f64);
        }
        state.reset();
        assert_eq!(state.at(&mount, 9.81), None);
    }

    /// A density N gives samples Δt apart the variance N²/Δt, and the mean of a second the variance N²,
    /// with and without a bandwidth.
    #[test]
    fn white_noise_has_its_density_whatever_the_bandwidth() {
        for bandwidth_gyro_hz in [0.0, 10.0] {
            let spec = ImuSpec {
                density_gyro_radps_rthz: [0.0, 0.02, 0.0],
                bandwidth_gyro_hz,
                ..ImuSpec::default()
            };
            let (mut squares, mut of_means) = (0.0, 0.0);
            let n = 2000;
            for second in 0..n {
                let mut sum = 0.0;
                for tick in 0..100 {
                    let found = sample(&spec, &rest(), &noise(5, second * 100 + tick));
                    let y = found.angular_velocity_radps[1];
                    squares += y * y;
                    sum += y;
                }
                of_means += (sum / 100.0) * (sum / 100.0);
            }
            // Relative standard error of a variance is √(2/n) = 3.2 %; four of them, and what a
            // low-pass carries over from second to second.
            assert!(
                (of_means / n as f64 / 4e-4 - 1.0).abs() < 0.16,
                "{bandwidth_gyro_hz}"
            );
            let ratio = squares / (100 * n) as f64 / (4e-4 / 0.01);
            let kept = (-TAU * bandwidth_gyro_hz * 0.01).exp();
            let wanted = if bandwidth_gyro_hz > 0.0 {
                (1.0 - kept) / (1.0 + kept)
            } else {
                1.0
            };
            assert!((ratio / wanted - 1.0).abs() < 0.05, "{ratio} {wanted}");
        }
    }

    /// Allan variance of means of `tau` seconds, of a signal that is asked for once a second.
    fn allan_variance(values: &[f64], tau: usize) -> f64 {
        let means: Vec<f64> = values
            .chunks_exact(tau)
            .map(|it| it.iter().sum::<f64>() / tau as f64)
            .collect();
        let squares = means.windows(2).map(|pair| (pair[1] - pair[0]).powi(2));
        0.5 * squares.sum::<f64>() / (means.len() - 1) as f64
    }

    #[test]
    fn drift_has_the_allan_deviations_of_its_parameters() {
        let run = |spec: ImuSpec| -> Vec<f64> {
            let at = |second: u64| {
                let found = sample(&spec, &rest(), &noise(8, second * 100));
                found.angular_velocity_radps[0]
            };
            (0..40_000).map(at).collect()
        };
        let walk = run(ImuSpec {
            walk_gyro_radps_rts: [1e-4, 0.0, 0.0],
            ..ImuSpec::default()
        });
        // K²τ/3; at 20 s there are 2000 means.
        let found = allan_variance(&walk, 20) / (1e-8 * 20.0 / 3.0);
        assert!((found - 1.0).abs() < 0.15, "{found}");
        let instability = run(ImuSpec {
            instability_gyro_radps: [1e-4, 0.0, 0.0],
            ..ImuSpec::default()
        });
        // (2 ln 2 / π) B², whatever the time.
        for tau in [8, 40, 100] {
            let level = 2.0 * std::f64::consts::LN_2 / PI * 1e-8;
            let found = (allan_variance(&instability, tau) / level).sqrt();
            assert!((found - 1.0).abs() < 0.12, "{tau} {found}");
        }
    }
}
