//! The parameters of a window for the shader.

use bytemuck::{Pod, Zeroable};

/// Mirror of `Job` in `shader/events.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct EventJob {
    /// Width and height.
    pub size_px: [u32; 2],
    /// Tiles across and down.
    pub n_tiles: [u32; 2],
    /// Change of the level per event, upwards.
    pub threshold_up: f32,
    /// The same downwards.
    pub threshold_down: f32,
    /// What is added before the logarithm.
    pub log_eps: f32,
    /// Longest path between two samples, pixels.
    pub substep_px: f32,
    /// How much references sink in the window.
    pub leak: f32,
    /// Length of the window over that of the one before.
    pub ratio: f32,
    /// Length of the window, nanoseconds.
    pub nanos: u32,
    /// Refractory period.
    pub refractory_nanos: u32,
    /// Slices per time, times 2³².
    pub slices: [u32; 2],
    /// Capacity of the list.
    pub capacity: u32,
    /// Kind of level: 0 logarithm, 1 linear, 2 and 3 the same of encoded colour.
    pub level: u32,
    /// Whether images are warped along their motion.
    pub moves: u32,
    /// Whether thresholds vary from pixel to pixel.
    pub differs: u32,
    /// Whether the run writes events, or only counts them.
    pub writes: u32,
    /// Index of the image that ends the window.
    pub now: u32,
}

/// Distance between the job that counts and the one that writes: a multiple of every device's
/// offset alignment.
pub(super) const JOB_BYTES: u64 = 256;
