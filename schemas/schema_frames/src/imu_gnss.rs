//! Samples of IMU and GNSS.

use bytemuck::{Pod, Zeroable};

/// One IMU sample. 72 bytes, no padding.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ImuSample {
    /// Specific force in the sensor's space, m/s²; at rest and level z reads +9.81.
    pub specific_force_mps2: [f64; 3],
    /// Angular velocity in the sensor's space, rad/s.
    pub angular_velocity_radps: [f64; 3],
    /// Heading of the sensor's forward axis, radians clockwise from north (world +y), in [0, 2π).
    pub compass_rad: f64,
    /// Zero.
    pub reserved: [u64; 2],
}
const _: () = assert!(size_of::<ImuSample>() == 72 && align_of::<ImuSample>() == 8);

/// One GNSS fix. 40 bytes, no padding.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct GnssSample {
    /// Latitude, degrees (geodesy's own unit).
    pub latitude_deg: f64,
    /// Longitude, degrees.
    pub longitude_deg: f64,
    /// Altitude, metres.
    pub altitude_m: f64,
    /// Zero.
    pub reserved: [u64; 2],
}
const _: () = assert!(size_of::<GnssSample>() == 40 && align_of::<GnssSample>() == 8);
