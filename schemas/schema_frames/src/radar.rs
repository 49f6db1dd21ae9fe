//! Detections of a radar.

use bytemuck::{Pod, Zeroable};

/// One radar detection. 32 bytes, no padding.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct RadarDetection {
    /// Rate at which the distance grows, m/s: velocity of what was hit minus the radar's own, along
    /// the ray; negative if it comes nearer.
    pub velocity_mps: f32,
    /// Direction in the sensor's xy plane, radians counter-clockwise from x (positive to the left).
    pub azimuth_rad: f32,
    /// Direction above the sensor's xy plane, radians.
    pub altitude_rad: f32,
    /// Distance along the ray, metres.
    pub depth_m: f32,
    /// Cosine between the incoming ray and the surface normal; 1 is head-on.
    pub cos_incidence: f32,
    /// Object hit.
    pub object_id: u32,
    /// Class hit.
    pub class: u8,
    /// Zero.
    pub reserved: [u8; 7],
}
const _: () = assert!(size_of::<RadarDetection>() == 32 && align_of::<RadarDetection>() == 4);
