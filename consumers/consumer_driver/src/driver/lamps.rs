//! Lamps that a driver switches: bits of `VehiclePart::lamps`.

/// Position lamps, `VehiclePart::lamps`.
pub const LAMP_POSITION: u32 = 1;
/// Low beam.
pub const LAMP_LOW_BEAM: u32 = 2;
/// Brake lamp.
pub const LAMP_BRAKE: u32 = 8;
/// Right blinker.
pub const LAMP_RIGHT: u32 = 16;
/// Left blinker.
pub const LAMP_LEFT: u32 = 32;
/// Reversing lamp.
pub const LAMP_REVERSE: u32 = 64;
/// Fog lamps.
pub const LAMP_FOG: u32 = 128;
