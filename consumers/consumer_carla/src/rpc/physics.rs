//! Calls about how vehicles move: physics control, Ackermann control, forces and impulses, physics
//! switches, telemetry, wheels.

use schema_frames::{Command, CommandReply, PhysicsAction, PhysicsAnswer, VehicleTelemetry};

use crate::gateway::Gateway;
use crate::rpc::batch_item::{Commands, Item};
use crate::rpc::call::{Call, Calls};
use crate::wire::axes;
use crate::wire::fields::{Fields, Wrong};
use crate::wire::msgpack::Value;
use crate::wire::requests::{Answer, Failure, Outcome};
use crate::wire::vehicle_physics;

pub(crate) const CALLS: Calls = &[
    ("get_physics_control", physics_control),
    ("apply_physics_control", |gateway, call| {
        tell_physics(gateway, call, |fields| {
            Ok(vehicle_physics::set_physics(vehicle_physics::read_physics(
                fields,
            )?))
        })
    }),
    ("apply_ackermann_control_to_vehicle", |gateway, call| {
        tell_physics(gateway, call, vehicle_physics::ackermann)
    }),
    ("get_ackermann_controller_settings", ackermann_settings),
    ("apply_ackermann_controller_settings", |gateway, call| {
        tell_physics(gateway, call, vehicle_physics::read_gains)
    }),
    ("get_telemetry_data", telemetry_data),
    ("show_vehicle_debug_telemetry", |gateway, call| {
        let actor_id = call.known_actor(gateway)?;
        let shown = call.bool()?;
        gateway
            .commander
            .tell(Command::ShowTelemetry { actor_id, shown });
        Ok(Answer::Void)
    }),
    ("set_actor_target_angular_velocity", |gateway, call| {
        tell_physics(gateway, call, vehicle_physics::angular_velocity)
    }),
    ("enable_actor_constant_velocity", |gateway, call| {
        tell_physics(gateway, call, |fields| {
            Ok(PhysicsAction::HoldVelocity {
                velocity_in_vehicle_mps: Some(axes::mirror(fields.vector()?)),
            })
        })
    }),
    ("disable_actor_constant_velocity", |gateway, call| {
        tell_physics(gateway, call, |_| {
            Ok(PhysicsAction::HoldVelocity {
                velocity_in_vehicle_mps: None,
            })
        })
    }),
    ("add_actor_impulse", |gateway, call| {
        tell_physics(gateway, call, vehicle_physics::impulse)
    }),
    ("add_actor_impulse_at_location", |gateway, call| {
        tell_physics(gateway, call, |fields| {
            let (impulse, point) = (
                axes::mirror(fields.vector()?),
                axes::mirror(fields.vector()?),
            );
            Ok(PhysicsAction::AddImpulse {
                impulse_in_world_ns: impulse,
                point_in_world_m: Some(point),
            })
        })
    }),
    ("add_actor_force", |gateway, call| {
        tell_physics(gateway, call, vehicle_physics::force)
    }),
    ("add_actor_force_at_location", |gateway, call| {
        tell_physics(gateway, call, |fields| {
            let (force, point) = (
                axes::mirror(fields.vector()?),
                axes::mirror(fields.vector()?),
            );
            Ok(PhysicsAction::AddForce {
                force_in_world_n: force,
                point_in_world_m: Some(point),
            })
        })
    }),
    ("add_actor_angular_impulse", |gateway, call| {
        tell_physics(gateway, call, vehicle_physics::angular_impulse)
    }),
    ("add_actor_torque", |gateway, call| {
        tell_physics(gateway, call, vehicle_physics::torque)
    }),
    ("set_actor_simulate_physics", simulate_physics),
    ("set_actor_collisions", |gateway, call| {
        ask_physics(gateway, call, |fields| {
            Ok(PhysicsAction::SetCollisions {
                enabled: fields.bool()?,
            })
        })
    }),
    ("set_actor_enable_gravity", |gateway, call| {
        tell_physics(gateway, call, vehicle_physics::gravity)
    }),
    ("set_wheel_steer_direction", |gateway, call| {
        tell_physics(gateway, call, |fields| {
            let (wheel, degrees) = (fields.u8()?, fields.f32()?);
            Ok(PhysicsAction::ShowWheelSteer {
                wheel,
                steer_rad: -degrees.to_radians(),
            })
        })
    }),
    ("get_wheel_steer_angle", |gateway, call| {
        wheel_angle(gateway, call, |wheel| -wheel.steer_rad.to_degrees())
    }),
    ("set_wheel_pitch_angle", |gateway, call| {
        tell_physics(gateway, call, |fields| {
            let (wheel, degrees) = (fields.u8()?, fields.f32()?);
            Ok(PhysicsAction::ShowWheelRoll {
                wheel,
                roll_rad: degrees.to_radians(),
            })
        })
    }),
    ("get_wheel_pitch_angle", |gateway, call| {
        wheel_angle(gateway, call, |wheel| wheel.roll_rad.to_degrees())
    }),
];

pub(crate) const BATCH: Commands = &[
    (3, |actor, fields| {
        batched(actor, vehicle_physics::ackermann(fields)?)
    }),
    (5, |actor, fields| {
        batched(
            actor,
            vehicle_physics::set_physics(vehicle_physics::read_physics(fields)?),
        )
    }),
    (9, |actor, fields| {
        batched(actor, vehicle_physics::angular_velocity(fields)?)
    }),
    (10, |actor, fields| {
        batched(actor, vehicle_physics::impulse(fields)?)
    }),
    (11, |actor, fields| {
        batched(actor, vehicle_physics::force(fields)?)
    }),
    (12, |actor, fields| {
        batched(actor, vehicle_physics::angular_impulse(fields)?)
    }),
    (13, |actor, fields| {
        batched(actor, vehicle_physics::torque(fields)?)
    }),
    (14, |actor, fields| {
        batched(actor, vehicle_physics::simulated(fields)?)
    }),
    (15, |actor, fields| {
        batched(actor, vehicle_physics::gravity(fields)?)
    }),
    (17, |actor, fields| {
        Ok(Item::ask(
            actor,
            Command::ShowTelemetry {
                actor_id: actor,
                shown: fields.bool()?,
            },
        ))
    }),
];

fn batched(actor: u32, action: PhysicsAction) -> Result<Item<'static>, Wrong> {
    Ok(Item::ask(
        actor,
        Command::Physics {
            actor_id: actor,
            action,
        },
    ))
}

/// Sends an action whose answer the client does not read.
fn tell_physics(
    gateway: &Gateway,
    call: &mut Call<'_>,
    read: impl FnOnce(&mut Fields<'_>) -> Result<PhysicsAction, Wrong>,
) -> Outcome {
    let actor_id = call.known_actor(gateway)?;
    let mut action = read(call)?;
    let is_set = matches!(action, PhysicsAction::SetVehiclePhysics { .. });
    if is_set {
        let n_wheels = gateway.world.known().n_wheels(actor_id);
        vehicle_physics::fit_wheels(&mut action, n_wheels);
    }
    gateway
        .commander
        .tell(Command::Physics { actor_id, action });
    if is_set {
        gateway.recorder.note_physics(actor_id);
    }
    Ok(Answer::Void)
}

/// Sends an action and waits for its success.
fn ask_physics(
    gateway: &Gateway,
    call: &mut Call<'_>,
    read: impl FnOnce(&mut Fields<'_>) -> Result<PhysicsAction, Wrong>,
) -> Outcome {
    let actor_id = call.known_actor(gateway)?;
    let action = read(call)?;
    gateway
        .commander
        .ask_one(Command::Physics { actor_id, action })?;
    Ok(Answer::Void)
}

/// Never fails: an error would end a client whose Traffic Manager takes over a vehicle that has
/// just gone.
fn simulate_physics(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let (actor_id, action) = (call.u32()?, vehicle_physics::simulated(call)?);
    if gateway.world.known().has_actor(actor_id)
        && let Err(error) = gateway
            .commander
            .ask_one(Command::Physics { actor_id, action })
    {
        tracing::debug!(actor_id, %error, "set_actor_simulate_physics did nothing");
    }
    Ok(Answer::Void)
}

fn ask_answer(
    gateway: &Gateway,
    actor_id: u32,
    action: PhysicsAction,
) -> Result<PhysicsAnswer, Failure> {
    match gateway
        .commander
        .ask_one(Command::Physics { actor_id, action })?
        .0
    {
        CommandReply::Physics { answer } => Ok(answer),
        reply => Err(Failure::Refused(format!(
            "{reply:?} is no answer to a question about physics"
        ))),
    }
}

fn physics_control(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let id = call.known_actor(gateway)?;
    let PhysicsAnswer::VehiclePhysics(physics) =
        ask_answer(gateway, id, PhysicsAction::GetVehiclePhysics)?
    else {
        return Err(Failure::Refused(
            "the simulator answered something else".to_owned(),
        ));
    };
    let snapshot = gateway.world.known().snapshot.clone();
    let pose = snapshot
        .and_then(|at| at.actor(id).map(|record| record.world_from_actor))
        .unwrap_or_default();
    Ok(Answer::Value(vehicle_physics::write_physics(
        &physics, &pose,
    )))
}

fn ackermann_settings(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let id = call.known_actor(gateway)?;
    let PhysicsAnswer::AckermannGains(gains) =
        ask_answer(gateway, id, PhysicsAction::GetAckermannGains)?
    else {
        return Err(Failure::Refused(
            "the simulator answered something else".to_owned(),
        ));
    };
    Ok(Answer::Value(Value::Array(
        gains
            .speed
            .into_iter()
            .chain(gains.acceleration)
            .map(Value::from)
            .collect(),
    )))
}

fn telemetry(gateway: &Gateway, id: u32) -> Result<VehicleTelemetry, Failure> {
    match ask_answer(gateway, id, PhysicsAction::GetTelemetry)? {
        PhysicsAnswer::Telemetry(telemetry) => Ok(telemetry),
        _ => Err(Failure::Refused(
            "the simulator answered something else".to_owned(),
        )),
    }
}

fn telemetry_data(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let id = call.known_actor(gateway)?;
    Ok(Answer::Value(vehicle_physics::write_telemetry(&telemetry(
        gateway, id,
    )?)))
}

fn wheel_angle(
    gateway: &Gateway,
    call: &mut Call<'_>,
    angle: impl Fn(&schema_frames::WheelTelemetry) -> f32,
) -> Outcome {
    let (id, idx) = (call.known_actor(gateway)?, call.u8()?);
    let telemetry = telemetry(gateway, id)?;
    let n_wheels = telemetry.wheels.len();
    let wheel = match (n_wheels, idx) {
        // `Back_Wheel` of a two-wheeler is 1, and its pair of rear wheels are 2 and 3.
        (2, 1..=3) => telemetry.wheels.get(1),
        _ => telemetry.wheels.get(usize::from(idx)),
    };
    let wheel = wheel.ok_or_else(|| {
        Failure::Refused(format!("wheel is {idx}, but must be 0 to {}", n_wheels - 1))
    })?;
    Ok(Answer::Value(angle(wheel).into()))
}
