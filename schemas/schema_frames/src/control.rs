//! Bulk records on `control/vehicles` and `control/ack`.

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};

/// What a driver does with the pedals, the gear lever and the steering wheel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VehicleControl {
    /// Throttle pedal, 0..=1.
    pub throttle_ratio: f32,
    /// Steering as a share of the largest angle, −1..=1, positive to the left (CARLA's sign is the
    /// opposite).
    pub steer_ratio: f32,
    /// Brake pedal, 0..=1.
    pub brake_ratio: f32,
    /// Whether the hand brake is pulled.
    pub hand_brake: bool,
    /// Whether the throttle drives backwards.
    pub reverse: bool,
    /// Whether `gear` chooses the gear instead of the gearbox.
    pub manual_gear_shift: bool,
    /// Gear: −1 reverse, 0 neutral, 1 and up forward; used with `manual_gear_shift`.
    pub gear: i8,
}

impl VehicleControl {
    /// The control with every value clamped to its range; a value that is not finite becomes 0.
    pub fn clamped(self) -> Self {
        let clamp = |x: f32, low: f32| {
            if x.is_finite() {
                x.clamp(low, 1.0)
            } else {
                0.0
            }
        };
        VehicleControl {
            throttle_ratio: clamp(self.throttle_ratio, 0.0),
            steer_ratio: clamp(self.steer_ratio, -1.0),
            brake_ratio: clamp(self.brake_ratio, 0.0),
            ..self
        }
    }
}

/// What a walker is asked to do; held until it is replaced.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WalkerControl {
    /// Direction of the walk, world; only the direction of its horizontal part counts.
    pub direction: [f32; 3],
    /// Speed, m/s, 0 to 15.
    pub speed_mps: f32,
    /// Whether it jumps each time its feet touch the ground.
    pub jump: bool,
}

impl Default for WalkerControl {
    /// A walker that stands still.
    fn default() -> Self {
        WalkerControl {
            direction: [1.0, 0.0, 0.0],
            speed_mps: 0.0,
            jump: false,
        }
    }
}

/// One vehicle's control on `control/vehicles`. 32 bytes, no padding; a sample is a list of them.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct VehicleControlRecord {
    /// Actor id of the vehicle.
    pub actor_id: u32,
    /// See [`VehicleControl::throttle_ratio`].
    pub throttle_ratio: f32,
    /// See [`VehicleControl::steer_ratio`].
    pub steer_ratio: f32,
    /// See [`VehicleControl::brake_ratio`].
    pub brake_ratio: f32,
    /// Bit 0 hand brake, 1 reverse, 2 manual gear shift.
    pub flags: u32,
    /// See [`VehicleControl::gear`].
    pub gear: i32,
    /// Lamp bits to set (`VehiclePart::lamps`), or `u32::MAX` to leave them alone.
    pub lamps: u32,
    /// Zero.
    pub reserved: u32,
}
const _: () = assert!(size_of::<VehicleControlRecord>() == 32);

impl VehicleControlRecord {
    /// Record for `actor_id` that leaves its lamps alone.
    pub fn new(actor_id: u32, control: VehicleControl) -> Self {
        VehicleControlRecord {
            actor_id,
            throttle_ratio: control.throttle_ratio,
            steer_ratio: control.steer_ratio,
            brake_ratio: control.brake_ratio,
            flags: control.hand_brake as u32
                | (control.reverse as u32) << 1
                | (control.manual_gear_shift as u32) << 2,
            gear: control.gear as i32,
            lamps: u32::MAX,
            reserved: 0,
        }
    }

    /// The control, clamped.
    pub fn control(&self) -> VehicleControl {
        VehicleControl {
            throttle_ratio: self.throttle_ratio,
            steer_ratio: self.steer_ratio,
            brake_ratio: self.brake_ratio,
            hand_brake: self.flags & 1 != 0,
            reverse: self.flags & 2 != 0,
            manual_gear_shift: self.flags & 4 != 0,
            gear: self.gear.clamp(-1, 20) as i8,
        }
        .clamped()
    }
}

/// User header of a sample on `control/vehicles`: iceoryx2 type name `GantryControlHeader`, 64
/// bytes.
///
/// If several controls for one actor meet between two ticks, the last one by (writer name, `seq`)
/// counts.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ControlHeader {
    /// [`CONTROL_MAGIC`].
    pub magic: u32,
    /// [`crate::SCHEMA_VERSION`].
    pub schema_version: u16,
    /// Zero.
    pub reserved0: u16,
    /// Tick of the snapshot these controls answer.
    pub tick: u64,
    /// Writer's own count, from 1.
    pub seq: u64,
    /// Writer's name, UTF-8, padded with zeros.
    pub writer: [u8; 40],
}
const _: () = assert!(size_of::<ControlHeader>() == 64);

/// "GCTL" read as a little-endian `u32`.
pub const CONTROL_MAGIC: u32 = u32::from_le_bytes(*b"GCTL");

/// A lockstep participant is done with a tick: fixed-size sample on `control/ack`, type name
/// `GantryAck`. 32 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct AckRecord {
    /// Number from the reply to `join_lockstep`.
    pub participant: u32,
    /// Zero.
    pub reserved: u32,
    /// Epoch the tick belongs to.
    pub epoch: u64,
    /// The tick that is done.
    pub tick: u64,
    /// Zero.
    pub reserved1: u64,
}
const _: () = assert!(size_of::<AckRecord>() == 32);

/// The simulator has sent every frame of a tick: fixed-size sample on `world/complete`, type name
/// `GantryComplete`. 32 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct CompleteRecord {
    /// Epoch the tick belongs to.
    pub epoch: u64,
    /// The tick that is complete.
    pub tick: u64,
    /// Zero.
    pub reserved: [u64; 2],
}
const _: () = assert!(size_of::<CompleteRecord>() == 32);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_survives_the_record_and_nan_becomes_zero() {
        let control = VehicleControl {
            throttle_ratio: 0.5,
            steer_ratio: -0.25,
            reverse: true,
            gear: 3,
            ..Default::default()
        };
        assert_eq!(VehicleControlRecord::new(9, control).control(), control);
        let wild = VehicleControl {
            throttle_ratio: f32::NAN,
            steer_ratio: 7.0,
            ..Default::default()
        };
        assert_eq!(wild.clamped().throttle_ratio, 0.0);
        assert_eq!(wild.clamped().steer_ratio, 1.0);
    }
}
