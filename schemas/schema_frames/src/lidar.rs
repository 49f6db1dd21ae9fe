//! Points of lidar and semantic lidar, and the returns of lidars as they are sold.

use bytemuck::{Pod, Zeroable};

/// One lidar return. 16 bytes, no padding. Points come channel after channel, azimuth rising within
/// each.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct LidarPoint {
    /// Hit point in the sensor's space (x forward, y left, z up), metres.
    pub hit_in_sensor_m: [f32; 3],
    /// Received over emitted energy; 0..=65535 maps to 0..=1.
    pub intensity: u16,
    /// Beam number, 0 is the highest elevation.
    pub channel: u16,
}
const _: () = assert!(size_of::<LidarPoint>() == 16 && align_of::<LidarPoint>() == 4);

/// One return of a semantic lidar. 24 bytes, no padding.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct SemanticLidarPoint {
    /// Hit point in the sensor's space (x forward, y left, z up), metres.
    pub hit_in_sensor_m: [f32; 3],
    /// Cosine between the incoming ray and the surface normal; 1 is head-on.
    pub cos_incidence: f32,
    /// Object hit.
    pub object_id: u32,
    /// Class hit.
    pub class: u8,
    /// Zero.
    pub reserved: u8,
    /// Beam number, 0 is the highest elevation.
    pub channel: u16,
}
const _: () =
    assert!(size_of::<SemanticLidarPoint>() == 24 && align_of::<SemanticLidarPoint>() == 4);

/// One return of a lidar as it is sold: when it was measured, by which beam, and what came back.
/// 32 bytes, no padding. Points come channel after channel, in the order of firing within each.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct LidarReturn {
    /// Hit point in the sensor's space (x forward, y left, z up) at the time of the firing, metres.
    pub hit_in_sensor_m: [f32; 3],
    /// Time of the firing, nanoseconds from `sim_nanos`; never positive.
    pub time_ns: i32,
    /// Object hit.
    pub object_id: u32,
    /// Received over emitted energy; 0..=65535 maps to 0..=1.
    pub intensity: u16,
    /// Number of the beam as the maker counts.
    pub ring: u16,
    /// Reflectivity of the surface in the maker's units; 0 where it is not measured.
    pub reflectivity: u8,
    /// Bits 0–3: which return of its firing, from 0; bits 4–7: how many the firing has.
    pub returns: u8,
    /// Class hit.
    pub class: u8,
    /// Bit 0: from the air (rain, fog, dust); 1: mirrored; 2: retro-reflector; 3: saturated.
    pub flags: u8,
    /// Ambient light in the maker's units; 0 where it is not measured.
    pub ambient: u16,
    /// Low 16 bits of the measured range in whole millimetres.
    pub range_mm_lsb: u16,
}
const _: () = assert!(size_of::<LidarReturn>() == 32 && align_of::<LidarReturn>() == 4);

impl LidarReturn {
    /// [`LidarReturn::returns`] of a firing's only return.
    pub const ONLY: u8 = 1 << 4;
}
