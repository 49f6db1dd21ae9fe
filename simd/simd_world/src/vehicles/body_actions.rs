//! What can be done to an actor's body: its physical data, pushes, switches, Ackermann control,
//! telemetry.

use nalgebra::Vector3;
use rapier3d::math::Vector;
use schema_frames::{
    AckermannControl, AckermannGains, CommandReply, PhysicsAction, PhysicsAnswer, VehiclePhysics,
    VehicleTelemetry,
};
use schema_types::ActorId;

use crate::ackermann::Ackermann;
use crate::physical;
use crate::physics::{Physics, narrow};
use crate::vehicle::Vehicle;
use crate::world::{ActorError, World};

/// Largest push: N·s, N, N·m·s or N·m.
const MOST_PUSH: f64 = 1e9;
/// Largest angular velocity, rad/s.
const MOST_RADPS: f64 = 100.0;

impl World {
    /// Carries out an action; a refused one changes nothing.
    pub(crate) fn act(&mut self, actor: ActorId, action: &PhysicsAction) -> CommandReply {
        let result = self.try_act(actor, action);
        if matches!(result, Ok(None)) {
            self.refresh_actor(actor);
        }
        match result {
            Ok(None) => CommandReply::Done,
            Ok(Some(answer)) => CommandReply::Physics { answer },
            Err(error) => CommandReply::Refused { error },
        }
    }

    fn try_act(
        &mut self,
        actor: ActorId,
        action: &PhysicsAction,
    ) -> Result<Option<PhysicsAnswer>, String> {
        use PhysicsAction::*;
        let text = |error: ActorError| error.to_string();
        match action {
            GetVehiclePhysics => {
                let physics = self.vehicle_physics(actor).map_err(text)?.clone();
                return Ok(Some(PhysicsAnswer::VehiclePhysics(Box::new(physics))));
            }
            GetAckermannGains => {
                return Ok(Some(PhysicsAnswer::AckermannGains(
                    self.vehicle_mut(actor).map_err(text)?.gains,
                )));
            }
            GetTelemetry => {
                return Ok(Some(PhysicsAnswer::Telemetry(
                    self.telemetry(actor).map_err(text)?,
                )));
            }
            SetVehiclePhysics { physics } => self.set_vehicle_physics(actor, physics)?,
            SetAckermannGains { gains } => self.set_ackermann_gains(actor, *gains)?,
            ControlAckermann { control } => self.set_ackermann(actor, *control).map_err(text)?,
            SetGravity { enabled } => self
                .switch(actor, |vehicle, _| vehicle.switches.gravity = *enabled)
                .map_err(text)?,
            SetSimulated { enabled } if self.walkers.contains_key(&actor) => {
                self.walker_mut(actor).map_err(text)?.simulated = *enabled
            }
            SetCollisions { enabled } if self.walkers.contains_key(&actor) => {
                self.walker_mut(actor).map_err(text)?.collides = *enabled
            }
            SetSimulated { enabled } => self
                .switch(actor, |vehicle, physics| {
                    vehicle.set_simulated(physics, *enabled)
                })
                .map_err(text)?,
            SetCollisions { enabled } => self
                .switch(actor, |vehicle, physics| {
                    vehicle.set_collides(physics, *enabled)
                })
                .map_err(text)?,
            HoldVelocity {
                velocity_in_vehicle_mps,
            } => self
                .hold_velocity(actor, *velocity_in_vehicle_mps)
                .map_err(text)?,
            ShowWheelSteer { wheel, steer_rad } => {
                self.show_wheel(actor, *wheel, *steer_rad, false)?
            }
            ShowWheelRoll { wheel, roll_rad } => self.show_wheel(actor, *wheel, *roll_rad, true)?,
            SetAngularVelocity {
                angular_velocity_in_world_radps,
            } => {
                let spin = check(
                    actor,
                    "angular velocity",
                    *angular_velocity_in_world_radps,
                    MOST_RADPS,
                )
                .map_err(text)?;
                self.act_on(actor, |vehicle, physics| {
                    vehicle.set_angular_velocity(physics, &spin)
                })
                .map_err(text)?;
            }
            AddImpulse { .. } | AddForce { .. } | AddAngularImpulse { .. } | AddTorque { .. } => {
                self.push(actor, action).map_err(text)?;
            }
        }
        Ok(None)
    }

    /// Runs `change` on a vehicle and the engine's world.
    pub(crate) fn act_on<T>(
        &mut self,
        actor: ActorId,
        change: impl FnOnce(&mut Vehicle, &mut Physics) -> T,
    ) -> Result<T, ActorError> {
        self.vehicle_mut(actor)?;
        let vehicle = self
            .vehicles
            .get_mut(&actor)
            .expect("the line above found it");
        Ok(change(vehicle, &mut self.physics))
    }

    /// As [`World::act_on`]; actors that the engine does not move anyway have nothing to switch.
    fn switch(
        &mut self,
        actor: ActorId,
        change: impl FnOnce(&mut Vehicle, &mut Physics),
    ) -> Result<(), ActorError> {
        match self.actors.contains_key(&actor) && !self.vehicles.contains_key(&actor) {
            true => Ok(()),
            false => self.act_on(actor, change),
        }
    }

    /// Physical data in force.
    ///
    /// # Errors
    /// If it is no vehicle.
    pub fn vehicle_physics(&mut self, actor: ActorId) -> Result<&VehiclePhysics, ActorError> {
        Ok(&self.vehicle_mut(actor)?.physics)
    }

    /// Replaces a vehicle's physical data.
    ///
    /// # Errors
    /// A sentence that names the value and what is allowed.
    pub fn set_vehicle_physics(
        &mut self,
        actor: ActorId,
        data: &VehiclePhysics,
    ) -> Result<(), String> {
        let n_wheels = self
            .vehicle_mut(actor)
            .map_err(|error| error.to_string())?
            .wheels
            .len();
        physical::check(data, n_wheels)?;
        self.act_on(actor, |vehicle, physics| {
            vehicle.set_physics(physics, data.clone())
        })
        .map_err(|error| error.to_string())
    }

    /// What a vehicle feels.
    ///
    /// # Errors
    /// If it is no vehicle.
    pub fn telemetry(&mut self, actor: ActorId) -> Result<VehicleTelemetry, ActorError> {
        self.act_on(actor, |vehicle, physics| vehicle.telemetry(physics))
    }

    /// Holds an Ackermann control until another control comes. What is not finite counts as 0.
    ///
    /// # Errors
    /// If it is no vehicle.
    pub fn set_ackermann(
        &mut self,
        actor: ActorId,
        control: AckermannControl,
    ) -> Result<(), ActorError> {
        let vehicle = self.vehicle_mut(actor)?;
        vehicle.ackermann = Some(Ackermann::wish(
            vehicle.ackermann,
            control,
            vehicle.steer_rad,
        ));
        Ok(())
    }

    fn set_ackermann_gains(&mut self, actor: ActorId, gains: AckermannGains) -> Result<(), String> {
        let vehicle = self.vehicle_mut(actor).map_err(|error| error.to_string())?;
        match gains
            .speed
            .iter()
            .chain(&gains.acceleration)
            .find(|gain| !(-1e3..=1e3).contains(*gain))
        {
            Some(gain) => Err(format!("a gain is {gain}, but must be -1000 to 1000")),
            None => {
                vehicle.gains = gains;
                Ok(())
            }
        }
    }

    fn hold_velocity(&mut self, actor: ActorId, held: Option<[f64; 3]>) -> Result<(), ActorError> {
        let held = held
            .map(|held| check(actor, "velocity", held, 300.0))
            .transpose()?;
        self.vehicle_mut(actor)?.switches.held_mps = held.map(|held| narrow(&held).to_array());
        Ok(())
    }

    fn show_wheel(
        &mut self,
        actor: ActorId,
        wheel: u8,
        angle_rad: f32,
        roll: bool,
    ) -> Result<(), String> {
        let wheels = &mut self
            .vehicle_mut(actor)
            .map_err(|error| error.to_string())?
            .wheels;
        let n_wheels = wheels.len();
        let wheel = wheels
            .get_mut(usize::from(wheel))
            .ok_or_else(|| format!("wheel is {wheel}, but must be 0 to {}", n_wheels - 1))?;
        if !angle_rad.is_finite() {
            return Err(format!(
                "angle of a wheel is {angle_rad}, but must be finite"
            ));
        }
        match roll {
            true => wheel.roll_rad = angle_rad.rem_euclid(std::f32::consts::TAU),
            false => wheel.shown_steer_rad = Some(angle_rad),
        }
        Ok(())
    }

    fn push(&mut self, actor: ActorId, action: &PhysicsAction) -> Result<(), ActorError> {
        let checked = |what, value| check(actor, what, value, MOST_PUSH).map(|push| narrow(&push));
        let place = |point: Option<[f64; 3]>| {
            point
                .map(|point| check(actor, "point", point, 1e6))
                .transpose()
        };
        match action {
            PhysicsAction::AddImpulse {
                impulse_in_world_ns,
                point_in_world_m,
            } => {
                let (impulse, point) = (
                    checked("impulse", *impulse_in_world_ns)?,
                    place(*point_in_world_m)?,
                );
                self.act_on(actor, |vehicle, physics| {
                    let point = point.map(|point| physics.engine_point(point.into()));
                    let body = &mut physics.engine.bodies[vehicle.body];
                    let at = point.unwrap_or_else(|| body.center_of_mass());
                    body.apply_impulse_at_point(impulse, at, true);
                })
            }
            PhysicsAction::AddAngularImpulse {
                angular_impulse_in_world_nms,
            } => {
                let impulse = checked("angular impulse", *angular_impulse_in_world_nms)?;
                self.act_on(actor, |vehicle, physics| {
                    physics.engine.bodies[vehicle.body].apply_torque_impulse(impulse, true)
                })
            }
            PhysicsAction::AddForce {
                force_in_world_n,
                point_in_world_m,
            } => {
                let (force, point) = (
                    checked("force", *force_in_world_n)?,
                    place(*point_in_world_m)?,
                );
                self.act_on(actor, |vehicle, physics| {
                    let point = point.map(|point| physics.engine_point(point.into()));
                    let centre = physics.engine.bodies[vehicle.body].center_of_mass();
                    let torque = point.map_or(Vector::ZERO, |point| (point - centre).cross(force));
                    vehicle.force_n = (Vector::from(vehicle.force_n) + force).to_array();
                    vehicle.torque_nm = (Vector::from(vehicle.torque_nm) + torque).to_array();
                })
            }
            PhysicsAction::AddTorque { torque_in_world_nm } => {
                let torque = checked("torque", *torque_in_world_nm)?;
                self.act_on(actor, |vehicle, _| {
                    vehicle.torque_nm = (Vector::from(vehicle.torque_nm) + torque).to_array()
                })
            }
            _ => Ok(()),
        }
    }
}

fn check(
    actor: ActorId,
    what: &'static str,
    value: [f64; 3],
    most: f64,
) -> Result<Vector3<f64>, ActorError> {
    let value = Vector3::from(value);
    if value.norm() <= most {
        return Ok(value);
    }
    let problem = match what {
        "angular velocity" => "must be finite and at most 100 rad/s",
        "velocity" => "must be finite and at most 300 m/s",
        "point" => "must be finite and within 1000 km",
        _ => "must be finite and at most 1e9",
    };
    Err(ActorError::Value {
        actor,
        what,
        problem,
    })
}
