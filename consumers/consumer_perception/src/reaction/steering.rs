//! Keeps a car on a line along the road and at a speed: the ego until it reacts, and the other cars.

use schema_frames::{ActorRecord, VehicleControl};

use super::scene::Road;

/// Heading towards the line for each metre aside, radians.
const RAD_PER_M: f64 = 0.09;
/// Greatest angle to the road, radians.
const MAX_ANGLE_RAD: f64 = 0.2;
/// Steering for each radian of wrong heading, as a share of the largest angle.
const STEER_PER_RAD: f64 = 1.2;
/// Throttle that holds a speed against drag, and what is added for each m/s that is missing.
const THROTTLE: f64 = 0.15;
const THROTTLE_PER_MPS: f64 = 0.35;

/// Where a car shall be and how fast.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Course {
    /// Left of the middle of the ego's lane, metres.
    pub y_m: f64,
    /// Speed, m/s.
    pub speed_mps: f64,
    /// How hard it brakes; it does not keep its speed then.
    pub brake_ratio: Option<f64>,
}

/// The pedals and the wheel that bring `car` onto its course. It brakes only if it shall, so that
/// its brake lamps mean something.
pub fn control(road: &Road, car: &ActorRecord, course: &Course) -> VehicleControl {
    let road_from_car = road.of(car);
    let forward = road_from_car.rotation * nalgebra::Vector3::x();
    let yaw_rad = forward.y.atan2(forward.x);
    let aside_m = course.y_m - road_from_car.translation.y;
    let wanted_rad = (RAD_PER_M * aside_m).clamp(-MAX_ANGLE_RAD, MAX_ANGLE_RAD);
    let steer = (STEER_PER_RAD * (wanted_rad - yaw_rad)).clamp(-0.4, 0.4);
    let missing_mps = course.speed_mps - car.speed_mps();
    let throttle = match course.brake_ratio {
        None if course.speed_mps > 0.0 => THROTTLE + THROTTLE_PER_MPS * missing_mps,
        _ => 0.0,
    };
    VehicleControl {
        throttle_ratio: throttle.clamp(0.0, 0.9) as f32,
        steer_ratio: steer as f32,
        brake_ratio: course.brake_ratio.unwrap_or(0.0) as f32,
        ..VehicleControl::default()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;
    use schema_types::Pose;

    use super::*;

    #[test]
    fn it_steers_towards_its_line_gives_gas_when_slow_and_brakes_only_when_asked() {
        let road = Road {
            world_from_road: Isometry3::identity(),
        };
        let car = |y: f64, yaw: f64, speed: f64| ActorRecord {
            world_from_actor: Pose::from_xyz_yaw(0.0, y, 0.0, yaw),
            velocity_in_world_mps: [speed, 0.0, 0.0],
            ..bytemuck::Zeroable::zeroed()
        };
        let course = Course {
            y_m: 0.0,
            speed_mps: 8.0,
            brake_ratio: None,
        };
        let left = control(&road, &car(1.0, 0.0, 8.0), &course);
        assert!(left.steer_ratio < 0.0 && left.brake_ratio == 0.0);
        let turned = control(&road, &car(0.0, -0.1, 8.0), &course);
        assert!(turned.steer_ratio > 0.0);
        assert!(control(&road, &car(0.0, 0.0, 5.0), &course).throttle_ratio > 0.5);
        let fast = control(&road, &car(0.0, 0.0, 12.0), &course);
        assert_eq!((fast.throttle_ratio, fast.brake_ratio), (0.0, 0.0));
        let stop = Course {
            brake_ratio: Some(0.8),
            ..course
        };
        let stopping = control(&road, &car(0.0, 0.0, 5.0), &stop);
        assert_eq!((stopping.throttle_ratio, stopping.brake_ratio), (0.0, 0.8));
    }
}
