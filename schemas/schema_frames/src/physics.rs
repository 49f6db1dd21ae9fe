//! Physics of actors in commands, as JSON: a vehicle's physical data, actions on bodies, and
//! telemetry.

use serde::{Deserialize, Serialize};

/// Physical data of one vehicle. `set_vehicle_physics` replaces all of it, and
/// `get_vehicle_physics` reads it back.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VehiclePhysics {
    /// Torque at full throttle over engine speed: points (rpm, N·m) by rising rpm, with straight
    /// lines between them, a constant before the first and 0 after the last.
    pub torque_curve: Vec<[f32; 2]>,
    /// Engine speed beyond which there is no torque, rpm.
    pub max_rpm: f32,
    /// Moment of inertia of engine and flywheel, kg·m².
    pub engine_inertia_kgm2: f32,
    /// Torque that slows the engine at full throttle, per engine speed, N·m·s.
    pub damping_full_throttle_nms: f32,
    /// The same with the throttle shut and the clutch engaged: engine braking, N·m·s.
    pub damping_closed_engaged_nms: f32,
    /// The same with the throttle shut and the clutch open, N·m·s.
    pub damping_closed_open_nms: f32,
    /// Whether the gearbox shifts by itself.
    pub automatic_gearbox: bool,
    /// Time without torque during a shift, seconds.
    pub gear_switch_secs: f32,
    /// Strength of the clutch, N·m·s: the torque it carries before it slips is this times
    /// 60 rad/s.
    pub clutch_strength_nms: f32,
    /// Ratio of the final drive.
    pub final_ratio: f32,
    /// Forward gears, lowest first; 1 to 20.
    pub forward_gears: Vec<GearPhysics>,
    /// Mass, kg.
    pub mass_kg: f32,
    /// Drag coefficient, for the frontal area of the body box.
    pub drag_coefficient: f32,
    /// Centre of mass in vehicle space (x forward, y left, z up from the ground), metres.
    pub center_of_mass_m: [f32; 3],
    /// Share of the largest steering angle over speed: points (m/s, ratio) by rising speed, with
    /// straight lines between them. An empty list means 1 at every speed.
    pub steering_curve: Vec<[f32; 2]>,
    /// Wheels: front left, front right, rear left, rear right, …; of two-wheelers front and rear.
    pub wheels: Vec<WheelPhysics>,
    /// Whether wheels find the ground by casting their whole shape instead of one ray each.
    pub sweep_wheels: bool,
}

/// One forward gear.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GearPhysics {
    /// Gearbox ratio.
    pub ratio: f32,
    /// Share of `max_rpm` below which the gearbox shifts down at full throttle.
    pub down_ratio: f32,
    /// Share of `max_rpm` above which the gearbox shifts up at full throttle.
    pub up_ratio: f32,
}

/// One wheel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WheelPhysics {
    /// Coefficient of friction on the road.
    pub friction: f32,
    /// Torque that slows the wheel, per wheel speed, N·m·s.
    pub damping_nms: f32,
    /// Largest steering angle, radians; 0 for a wheel that does not steer.
    pub max_steer_rad: f32,
    /// Radius, metres.
    pub radius_m: f32,
    /// Torque of the full foot brake, N·m.
    pub max_brake_nm: f32,
    /// Torque of the hand brake, N·m.
    pub max_hand_brake_nm: f32,
    /// Longitudinal stiffness at the wheel's load at rest: force per unit of slip in kilograms,
    /// that is newtons divided by 9.81.
    pub long_stiffness_kg: f32,
    /// Lateral stiffness: force over load at rest, per radian of slip angle, once the load reaches
    /// `lat_load_limit`.
    pub lat_stiffness_per_rad: f32,
    /// Load over load at rest at which the lateral stiffness stops growing.
    pub lat_load_limit: f32,
    /// Middle of the wheel at rest in vehicle space, metres. Read-only: a value that is set is
    /// ignored.
    #[serde(default)]
    pub position_m: [f32; 3],
}

/// Control by steering angle and speed; a controller turns it into pedals.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AckermannControl {
    /// Mean angle of the front wheels, radians, positive to the left.
    pub steer_rad: f32,
    /// How fast the angle may change, rad/s; 0: as fast as the wheels can.
    pub steer_rate_radps: f32,
    /// Speed, m/s; negative drives backwards.
    pub speed_mps: f32,
    /// Largest acceleration until that speed is reached, m/s²; 0: the controller's own limits, +3
    /// and −8.
    pub acceleration_mps2: f32,
    /// Largest change of acceleration, m/s³; 0: no limit.
    pub jerk_mps3: f32,
}

/// Gains of the two controllers behind [`AckermannControl`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AckermannGains {
    /// Proportional, integral and derivative gain from speed to acceleration.
    pub speed: [f32; 3],
    /// The same from acceleration to pedals.
    pub acceleration: [f32; 3],
}

impl Default for AckermannGains {
    /// CARLA's default gains.
    fn default() -> Self {
        AckermannGains {
            speed: [0.15, 0.0, 0.25],
            acceleration: [0.01, 0.0, 0.01],
        }
    }
}

/// An action on an actor's body, or a question about it; vectors are in world axes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "act", rename_all = "snake_case", deny_unknown_fields)]
pub enum PhysicsAction {
    /// Answers with the vehicle's [`VehiclePhysics`].
    GetVehiclePhysics,
    /// Replaces the vehicle's [`VehiclePhysics`]; the number of wheels must stay the same.
    SetVehiclePhysics {
        /// The physical data, complete.
        physics: Box<VehiclePhysics>,
    },
    /// Holds this control until another control of either kind arrives.
    ControlAckermann {
        /// The control.
        control: AckermannControl,
    },
    /// Answers with the vehicle's [`AckermannGains`].
    GetAckermannGains,
    /// Replaces the vehicle's [`AckermannGains`].
    SetAckermannGains {
        /// The gains, complete.
        gains: AckermannGains,
    },
    /// Sets the angular velocity.
    SetAngularVelocity {
        /// Angular velocity, rad/s.
        angular_velocity_in_world_radps: [f64; 3],
    },
    /// Holds a velocity along the vehicle's own axes (x forward, y left) until `null` ends it. The
    /// vehicle still falls.
    HoldVelocity {
        /// Velocity, m/s.
        velocity_in_vehicle_mps: Option<[f64; 3]>,
    },
    /// Changes the velocity at once, by impulse over mass.
    AddImpulse {
        /// Impulse, N·s.
        impulse_in_world_ns: [f64; 3],
        /// Point at which it acts, world, metres; the centre of mass if absent.
        #[serde(default)]
        point_in_world_m: Option<[f64; 3]>,
    },
    /// Applies a force during the next tick.
    AddForce {
        /// Force, N.
        force_in_world_n: [f64; 3],
        /// Point at which it acts, world, metres; the centre of mass if absent.
        #[serde(default)]
        point_in_world_m: Option<[f64; 3]>,
    },
    /// Changes the angular velocity at once.
    AddAngularImpulse {
        /// Angular impulse, N·m·s.
        angular_impulse_in_world_nms: [f64; 3],
    },
    /// Applies a torque during the next tick.
    AddTorque {
        /// Torque, N·m.
        torque_in_world_nm: [f64; 3],
    },
    /// Sets whether gravity acts on the actor.
    SetGravity {
        /// Whether it does.
        enabled: bool,
    },
    /// Sets whether the physics engine moves the actor. If not, only `set_pose` moves it, and its
    /// velocity is its displacement over the tick.
    SetSimulated {
        /// Whether it does.
        enabled: bool,
    },
    /// Sets whether the actor collides with others; wheels stand on the ground in any case.
    SetCollisions {
        /// Whether it does.
        enabled: bool,
    },
    /// Shows a wheel at a steering angle until the next control, without an effect on driving.
    ShowWheelSteer {
        /// Wheel, counted as in [`VehiclePhysics::wheels`].
        wheel: u8,
        /// Angle, radians, positive to the left.
        steer_rad: f32,
    },
    /// Turns a wheel about its axle to an angle, from which it rolls on.
    ShowWheelRoll {
        /// Wheel, counted as in [`VehiclePhysics::wheels`].
        wheel: u8,
        /// Angle, radians, positive in the direction of rolling forwards.
        roll_rad: f32,
    },
    /// Answers with [`VehicleTelemetry`].
    GetTelemetry,
}

/// Answer to an action that asks for something.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PhysicsAnswer {
    /// Answer to `get_vehicle_physics`.
    VehiclePhysics(Box<VehiclePhysics>),
    /// Answer to `get_ackermann_gains`.
    AckermannGains(AckermannGains),
    /// Answer to `get_telemetry`.
    Telemetry(VehicleTelemetry),
}

/// State of a vehicle's engine and wheels in the last sub-step.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct VehicleTelemetry {
    /// Forward speed, m/s.
    pub speed_mps: f32,
    /// Steering of its control, −1..=1, positive to the left.
    pub steer_ratio: f32,
    /// Throttle of its control, 0..=1.
    pub throttle_ratio: f32,
    /// Brake of its control, 0..=1.
    pub brake_ratio: f32,
    /// Engine speed, rpm.
    pub engine_rpm: f32,
    /// Gear engaged: −1 reverse, 0 neutral, 1 and up forward.
    pub gear: i32,
    /// Air drag, N.
    pub drag_n: f32,
    /// The wheels, as in [`VehiclePhysics::wheels`].
    pub wheels: Vec<WheelTelemetry>,
}

/// State of one wheel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WheelTelemetry {
    /// Coefficient of friction in force.
    pub friction: f32,
    /// Slip angle, radians, positive when the wheel slides to the left.
    pub lat_slip_rad: f32,
    /// Slip along the wheel: (roll − travel) / travel.
    pub long_slip_ratio: f32,
    /// Speed about its axle, rad/s, forwards.
    pub roll_radps: f32,
    /// Load, N.
    pub load_n: f32,
    /// Load over load at rest.
    pub load_ratio: f32,
    /// Torque of engine and brakes, N·m.
    pub torque_nm: f32,
    /// Force of the road along the wheel, N, forwards.
    pub long_n: f32,
    /// Force of the road across the wheel, N, to the left.
    pub lat_n: f32,
    /// Steering angle, radians, positive to the left.
    pub steer_rad: f32,
    /// Angle about its axle, radians, 0..2π.
    pub roll_rad: f32,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Command, CommandBatch};

    #[test]
    fn an_action_reads_as_documented() {
        let text = r#"{"v":1,"commands":[
            {"do":"physics","actor_id":9,"action":{"act":"add_impulse","impulse_in_world_ns":[1,2,3]}},
            {"do":"physics","actor_id":9,"action":{"act":"hold_velocity","velocity_in_vehicle_mps":null}},
            {"do":"physics","actor_id":9,"action":{"act":"get_telemetry"}}]}"#;
        let batch: CommandBatch = serde_json::from_str(text).unwrap();
        let action = PhysicsAction::AddImpulse {
            impulse_in_world_ns: [1.0, 2.0, 3.0],
            point_in_world_m: None,
        };
        assert_eq!(
            batch.commands[0],
            Command::Physics {
                actor_id: 9,
                action
            }
        );
        let again: CommandBatch =
            serde_json::from_str(&serde_json::to_string(&batch).unwrap()).unwrap();
        assert_eq!(batch, again);
        let wrong = r#"{"v":1,"commands":[{"do":"physics","actor_id":9,"action":{"act":"set_gravity","enabled":true,"pull":2}}]}"#;
        assert!(
            serde_json::from_str::<CommandBatch>(wrong)
                .unwrap_err()
                .to_string()
                .contains("pull")
        );
    }
}
