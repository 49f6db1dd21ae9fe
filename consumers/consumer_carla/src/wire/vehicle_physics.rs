//! How vehicles move, as CARLA writes it: physics control, Ackermann control, forces and impulses,
//! telemetry.

use schema_frames::{
    AckermannControl, AckermannGains, GearPhysics, PhysicsAction, VehiclePhysics, VehicleTelemetry,
    WheelPhysics,
};
use schema_types::Pose;

use crate::list;
use crate::wire::axes;
use crate::wire::fields::{Fields, Wrong};
use crate::wire::msgpack::Value;

/// Converts a torque (N·m) or an angular impulse (N·m·s) in either direction; they are axial
/// vectors and have no degrees.
fn axial([x, y, z]: [f64; 3]) -> [f64; 3] {
    [-x, y, -z]
}

/// Wheels of a two-wheeler.
const TWO: usize = 2;

/// A two-wheeler's wheels as CARLA writes them: front left, front right, rear left, rear right.
/// Each of a pair has half of what adds up, and all of what does not.
fn in_pairs(wheels: &[WheelPhysics]) -> Vec<WheelPhysics> {
    let half = |wheel: &WheelPhysics| WheelPhysics {
        damping_nms: 0.5 * wheel.damping_nms,
        max_brake_nm: 0.5 * wheel.max_brake_nm,
        max_hand_brake_nm: 0.5 * wheel.max_hand_brake_nm,
        long_stiffness_kg: 0.5 * wheel.long_stiffness_kg,
        ..*wheel
    };
    wheels.iter().flat_map(|wheel| [half(wheel); 2]).collect()
}

/// One wheel of a two-wheeler from the two of a pair: sums of what adds up, means of what does not.
fn joined(pair: &[WheelPhysics]) -> WheelPhysics {
    let sum = |of: fn(&WheelPhysics) -> f32| pair.iter().map(of).sum::<f32>();
    let mean = |of: fn(&WheelPhysics) -> f32| sum(of) / pair.len() as f32;
    WheelPhysics {
        friction: mean(|wheel| wheel.friction),
        damping_nms: sum(|wheel| wheel.damping_nms),
        max_steer_rad: mean(|wheel| wheel.max_steer_rad),
        radius_m: mean(|wheel| wheel.radius_m),
        max_brake_nm: sum(|wheel| wheel.max_brake_nm),
        max_hand_brake_nm: sum(|wheel| wheel.max_hand_brake_nm),
        lat_load_limit: mean(|wheel| wheel.lat_load_limit),
        lat_stiffness_per_rad: mean(|wheel| wheel.lat_stiffness_per_rad),
        long_stiffness_kg: sum(|wheel| wheel.long_stiffness_kg),
        position_m: pair[0].position_m,
    }
}

/// Fits an action that sets the physics control of a vehicle with `n_wheels`: of the four wheels
/// that CARLA gives a two-wheeler each pair becomes one.
pub fn fit_wheels(action: &mut PhysicsAction, n_wheels: Option<usize>) {
    if let PhysicsAction::SetVehiclePhysics { physics } = action
        && n_wheels == Some(TWO)
        && physics.wheels.len() == 2 * TWO
    {
        physics.wheels = physics.wheels.chunks(2).map(joined).collect();
    }
}

/// The action that sets a vehicle's physics control. Positions of wheels cannot be set (CARLA's are
/// in world space), so they are cleared.
pub fn set_physics(mut physics: VehiclePhysics) -> PhysicsAction {
    physics
        .wheels
        .iter_mut()
        .for_each(|wheel| wheel.position_m = [0.0; 3]);
    PhysicsAction::SetVehiclePhysics {
        physics: Box::new(physics),
    }
}

/// Reads an impulse at the centre of mass, N·s.
///
/// # Errors
/// [`Wrong`].
pub fn impulse(fields: &mut Fields<'_>) -> Result<PhysicsAction, Wrong> {
    Ok(PhysicsAction::AddImpulse {
        impulse_in_world_ns: axes::mirror(fields.vector()?),
        point_in_world_m: None,
    })
}

/// Reads a force at the centre of mass, N.
///
/// # Errors
/// [`Wrong`].
pub fn force(fields: &mut Fields<'_>) -> Result<PhysicsAction, Wrong> {
    Ok(PhysicsAction::AddForce {
        force_in_world_n: axes::mirror(fields.vector()?),
        point_in_world_m: None,
    })
}

/// Reads an angular impulse, N·m·s.
///
/// # Errors
/// [`Wrong`].
pub fn angular_impulse(fields: &mut Fields<'_>) -> Result<PhysicsAction, Wrong> {
    Ok(PhysicsAction::AddAngularImpulse {
        angular_impulse_in_world_nms: axial(fields.vector()?),
    })
}

/// Reads a torque, N·m.
///
/// # Errors
/// [`Wrong`].
pub fn torque(fields: &mut Fields<'_>) -> Result<PhysicsAction, Wrong> {
    Ok(PhysicsAction::AddTorque {
        torque_in_world_nm: axial(fields.vector()?),
    })
}

/// Reads an angular velocity.
///
/// # Errors
/// [`Wrong`].
pub fn angular_velocity(fields: &mut Fields<'_>) -> Result<PhysicsAction, Wrong> {
    Ok(PhysicsAction::SetAngularVelocity {
        angular_velocity_in_world_radps: axes::angular_velocity_rad(fields.vector()?),
    })
}

/// Reads whether the engine moves an actor.
///
/// # Errors
/// [`Wrong`].
pub fn simulated(fields: &mut Fields<'_>) -> Result<PhysicsAction, Wrong> {
    Ok(PhysicsAction::SetSimulated {
        enabled: fields.bool()?,
    })
}

/// Reads whether gravity pulls an actor.
///
/// # Errors
/// [`Wrong`].
pub fn gravity(fields: &mut Fields<'_>) -> Result<PhysicsAction, Wrong> {
    Ok(PhysicsAction::SetGravity {
        enabled: fields.bool()?,
    })
}

/// Reads an Ackermann control.
///
/// # Errors
/// [`Wrong`].
pub fn ackermann(fields: &mut Fields<'_>) -> Result<PhysicsAction, Wrong> {
    let mut wishes = fields.fields("an Ackermann control")?;
    let control = AckermannControl {
        steer_rad: axes::steer(wishes.f32()?),
        steer_rate_radps: wishes.f32()?,
        speed_mps: wishes.f32()?,
        acceleration_mps2: wishes.f32()?,
        jerk_mps3: wishes.f32()?,
    };
    Ok(PhysicsAction::ControlAckermann { control })
}

/// Reads the gains of the Ackermann controller.
///
/// # Errors
/// [`Wrong`].
pub fn read_gains(fields: &mut Fields<'_>) -> Result<PhysicsAction, Wrong> {
    let mut given = fields.fields("the settings of the Ackermann controller")?;
    let speed = [given.f32()?, given.f32()?, given.f32()?];
    let acceleration = [given.f32()?, given.f32()?, given.f32()?];
    Ok(PhysicsAction::SetAckermannGains {
        gains: AckermannGains {
            speed,
            acceleration,
        },
    })
}

/// Reads the points of a curve and multiplies their first coordinates by `x_unit`.
fn curve(fields: &mut Fields<'_>, x_unit: f32) -> Result<Vec<[f32; 2]>, Wrong> {
    let points = fields.list()?;
    let mut points_left = Fields::new("a curve", points);
    (0..points.len())
        .map(|_| {
            let mut point = points_left.fields("a point of a curve")?;
            Ok([point.f32()? * x_unit, point.f32()?])
        })
        .collect()
}

/// Reads a vehicle's physics control.
///
/// # Errors
/// [`Wrong`].
pub fn read_physics(fields: &mut Fields<'_>) -> Result<VehiclePhysics, Wrong> {
    let mut given = fields.fields("a vehicle's physics control")?;
    Ok(VehiclePhysics {
        torque_curve: curve(&mut given, 1.0)?,
        max_rpm: given.f32()?,
        engine_inertia_kgm2: given.f32()?,
        damping_full_throttle_nms: given.f32()?,
        damping_closed_engaged_nms: given.f32()?,
        damping_closed_open_nms: given.f32()?,
        automatic_gearbox: given.bool()?,
        gear_switch_secs: given.f32()?,
        clutch_strength_nms: given.f32()?,
        final_ratio: given.f32()?,
        forward_gears: read_gears(&mut given)?,
        mass_kg: given.f32()?,
        drag_coefficient: given.f32()?,
        center_of_mass_m: axes::mirror(given.vector()?).map(|x| x as f32),
        steering_curve: curve(&mut given, 1.0 / 3.6)?,
        wheels: read_wheels(&mut given)?,
        sweep_wheels: given.bool()?,
    })
}

fn read_gears(fields: &mut Fields<'_>) -> Result<Vec<GearPhysics>, Wrong> {
    let gears = fields.list()?;
    let mut left = Fields::new("the gears", gears);
    (0..gears.len())
        .map(|_| {
            let mut gear = left.fields("a gear")?;
            Ok(GearPhysics {
                ratio: gear.f32()?,
                down_ratio: gear.f32()?,
                up_ratio: gear.f32()?,
            })
        })
        .collect()
}

fn read_wheels(fields: &mut Fields<'_>) -> Result<Vec<WheelPhysics>, Wrong> {
    let wheels = fields.list()?;
    let mut left = Fields::new("the wheels", wheels);
    (0..wheels.len())
        .map(|_| {
            let mut wheel = left.fields("a wheel")?;
            Ok(WheelPhysics {
                friction: wheel.f32()?,
                damping_nms: wheel.f32()?,
                max_steer_rad: wheel.f32()?.to_radians(),
                radius_m: wheel.f32()? / 100.0,
                max_brake_nm: wheel.f32()?,
                max_hand_brake_nm: wheel.f32()?,
                lat_load_limit: wheel.f32()?,
                lat_stiffness_per_rad: wheel.f32()?,
                long_stiffness_kg: wheel.f32()?,
                position_m: axes::mirror(wheel.vector()?)
                    .map(|centimetres| (centimetres / 100.0) as f32),
            })
        })
        .collect()
}

fn points(curve: &[[f32; 2]], x_unit: f32) -> Value {
    Value::Array(curve.iter().map(|[x, y]| list![x * x_unit, *y]).collect())
}

/// CARLA's physics control of a vehicle at `world_from_vehicle`; the positions of its wheels are in
/// world space. A two-wheeler has four of them there.
pub fn write_physics(physics: &VehiclePhysics, world_from_vehicle: &Pose) -> Value {
    let gears: Vec<Value> = physics
        .forward_gears
        .iter()
        .map(|gear| list![gear.ratio, gear.down_ratio, gear.up_ratio])
        .collect();
    let wheel = |wheel: &WheelPhysics| {
        let place =
            world_from_vehicle.isometry() * nalgebra::Point3::from(wheel.position_m.map(f64::from));
        let [x, y, z] =
            axes::mirror(<[f64; 3]>::from(place.coords)).map(|metres| (metres * 100.0) as f32);
        list![
            wheel.friction,
            wheel.damping_nms,
            wheel.max_steer_rad.to_degrees(),
            wheel.radius_m * 100.0,
            wheel.max_brake_nm,
            wheel.max_hand_brake_nm,
            wheel.lat_load_limit,
            wheel.lat_stiffness_per_rad,
            wheel.long_stiffness_kg,
            list![x, y, z]
        ]
    };
    let wheels: Vec<Value> = match physics.wheels.len() {
        TWO => in_pairs(&physics.wheels).iter().map(wheel).collect(),
        _ => physics.wheels.iter().map(wheel).collect(),
    };
    let [x, y, z] = axes::mirror(physics.center_of_mass_m);
    list![
        points(&physics.torque_curve, 1.0),
        physics.max_rpm,
        physics.engine_inertia_kgm2,
        physics.damping_full_throttle_nms,
        physics.damping_closed_engaged_nms,
        physics.damping_closed_open_nms,
        physics.automatic_gearbox,
        physics.gear_switch_secs,
        physics.clutch_strength_nms,
        physics.final_ratio,
        gears,
        physics.mass_kg,
        physics.drag_coefficient,
        list![x, y + 0.0, z],
        points(&physics.steering_curve, 3.6),
        wheels,
        physics.sweep_wheels
    ]
}

/// CARLA's telemetry of a vehicle. Of the four wheels that a two-wheeler has there, each of a pair
/// has half of the forces.
pub fn write_telemetry(telemetry: &VehicleTelemetry) -> Value {
    let half = |wheel: &schema_frames::WheelTelemetry| schema_frames::WheelTelemetry {
        load_n: 0.5 * wheel.load_n,
        torque_nm: 0.5 * wheel.torque_nm,
        long_n: 0.5 * wheel.long_n,
        lat_n: 0.5 * wheel.lat_n,
        ..*wheel
    };
    let wheel = |wheel: &schema_frames::WheelTelemetry| {
        let rest_n = if wheel.load_ratio > 0.0 {
            wheel.load_n / wheel.load_ratio
        } else {
            f32::INFINITY
        };
        list![
            wheel.friction,
            -wheel.lat_slip_rad,
            wheel.long_slip_ratio,
            wheel.roll_radps,
            wheel.load_n,
            wheel.load_ratio,
            wheel.torque_nm,
            wheel.long_n,
            -wheel.lat_n,
            wheel.long_n / rest_n,
            -wheel.lat_n / rest_n
        ]
    };
    let wheels: Vec<Value> = match telemetry.wheels.len() {
        TWO => {
            let halves = telemetry.wheels.iter().flat_map(|of| [half(of); 2]);
            halves.map(|of| wheel(&of)).collect()
        }
        _ => telemetry.wheels.iter().map(wheel).collect(),
    };
    list![
        telemetry.speed_mps,
        axes::steer(telemetry.steer_ratio),
        telemetry.throttle_ratio,
        telemetry.brake_ratio,
        telemetry.engine_rpm,
        telemetry.gear,
        telemetry.drag_n,
        wheels
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A control as CARLA's client builds and sends it by default, with these wheels.
    fn control(wheels: Value) -> Value {
        list![
            list![list![0.0f32, 500.0f32], list![5000.0f32, 500.0f32]],
            5000.0f32,
            1.0f32,
            0.15f32,
            2.0f32,
            0.35f32,
            true,
            0.5f32,
            10.0f32,
            4.0f32,
            list![list![1.0f32, 0.5f32, 0.65f32]],
            1000.0f32,
            0.3f32,
            list![0.1f32, 0.2f32, 0.3f32],
            list![list![0.0f32, 1.0f32], list![120.0f32, 0.5f32]],
            wheels,
            false
        ]
    }

    /// Reading, writing and reading it again gives the same.
    #[test]
    fn physics_control_survives_there_and_back() {
        let wheel = |y: f32| {
            list![
                2.0f32,
                0.25f32,
                70.0f32,
                30.0f32,
                1500.0f32,
                3000.0f32,
                2.0f32,
                17.0f32,
                1000.0f32,
                list![100.0f32, y, 30.0f32]
            ]
        };
        let wheels = list![wheel(-50.0), wheel(50.0), wheel(-50.0), wheel(50.0)];
        let sent = list![control(wheels)];
        let Value::Array(items) = &sent else {
            unreachable!()
        };
        let read = read_physics(&mut Fields::new("test", items)).unwrap();
        assert_eq!(
            (read.center_of_mass_m, read.wheels[0].radius_m),
            ([0.1, -0.2, 0.3], 0.3)
        );
        assert!(
            (read.steering_curve[1][0] - 33.333_333).abs() < 1e-4
                && (read.wheels[1].max_steer_rad - 1.221_730_5).abs() < 1e-6
        );
        let written = Value::Array(vec![write_physics(&read, &Pose::IDENTITY)]);
        let Value::Array(items) = &written else {
            unreachable!()
        };
        let again = read_physics(&mut Fields::new("test", items)).unwrap();
        assert!((again.steering_curve[1][0] - read.steering_curve[1][0]).abs() < 1e-4);
        assert_eq!(again.wheels[1].position_m, [1.0, -0.5, 0.3]);
        assert_eq!(
            VehiclePhysics {
                steering_curve: read.steering_curve.clone(),
                wheels: read.wheels.clone(),
                ..again
            },
            read
        );
    }

    #[test]
    fn a_two_wheeler_has_four_wheels_there_and_two_here() {
        let wheel = |x: f32| WheelPhysics {
            friction: 1.0 + x,
            damping_nms: 0.3,
            max_steer_rad: 0.6,
            radius_m: 0.31,
            max_brake_nm: 701.0,
            max_hand_brake_nm: 55.0,
            lat_load_limit: 2.0,
            lat_stiffness_per_rad: 17.0,
            long_stiffness_kg: 1333.0,
            position_m: [x, 0.0, 0.31],
        };
        let without = [control(Value::Array(Vec::new()))];
        let own = VehiclePhysics {
            wheels: vec![wheel(0.7), wheel(-0.7)],
            ..read_physics(&mut Fields::new("test", &without)).unwrap()
        };
        let items = [write_physics(&own, &Pose::IDENTITY)];
        let mut sent = read_physics(&mut Fields::new("test", &items)).unwrap();
        assert_eq!(sent.wheels.len(), 4);
        assert_eq!(
            (sent.wheels[1].friction, sent.wheels[2].friction),
            (1.7, 1.0 - 0.7)
        );
        assert_eq!(
            sent.wheels.iter().map(|of| of.max_brake_nm).sum::<f32>(),
            1402.0
        );
        sent.wheels[0].max_brake_nm += 10.0;
        let mut action = PhysicsAction::SetVehiclePhysics {
            physics: Box::new(sent.clone()),
        };
        fit_wheels(&mut action, Some(4));
        assert!(
            matches!(&action, PhysicsAction::SetVehiclePhysics { physics } if **physics == sent)
        );
        fit_wheels(&mut action, Some(2));
        let PhysicsAction::SetVehiclePhysics { physics } = action else {
            unreachable!()
        };
        let joined: Vec<f32> = physics.wheels.iter().map(|of| of.max_brake_nm).collect();
        assert_eq!(joined, [711.0, 701.0]);
        assert_eq!(physics.wheels[1].friction, own.wheels[1].friction);
    }

    #[test]
    fn turning_left_is_left_in_both_worlds() {
        let wishes = list![list![0.3f32, 0.0f32, 8.0f32, 0.0f32, 0.0f32]];
        let Value::Array(items) = &wishes else {
            unreachable!()
        };
        let PhysicsAction::ControlAckermann { control } =
            ackermann(&mut Fields::new("test", items)).unwrap()
        else {
            unreachable!()
        };
        assert_eq!((control.steer_rad, control.speed_mps), (-0.3, 8.0));
        // CARLA's +z turns to the right, so an angular impulse along +z there is one along −z here.
        assert_eq!(axial([0.0, 0.0, 5.0]), [-0.0, 0.0, -5.0]);
    }
}
