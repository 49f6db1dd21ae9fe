//! Points of lidar and semantic lidar.

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
