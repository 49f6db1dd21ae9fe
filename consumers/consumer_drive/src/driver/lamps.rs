//! Lamps that a driver switches: bits of `VehiclePart::lamps`.

/// Brake lamp, `VehiclePart::lamps`.
pub const LAMP_BRAKE: u32 = 8;
/// Right blinker.
pub const LAMP_RIGHT: u32 = 16;
/// Left blinker.
pub const LAMP_LEFT: u32 = 32;
/// Reversing lamp.
pub const LAMP_REVERSE: u32 = 64;
