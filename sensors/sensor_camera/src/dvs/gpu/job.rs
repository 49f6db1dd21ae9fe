//! What the shader is told about a window.

use bytemuck::{Pod, Zeroable};

/// Mirror of `Job` in `shader/events.wgsl`, which says what is what.
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
    /// Leak of the window.
    pub leak: f32,
    /// Length over that of the window before.
    pub ratio: f32,
    /// Length.
    pub nanos: u32,
    /// Refractory period.
    pub refractory_nanos: u32,
    /// Slices per time, times 2³².
    pub slices: [u32; 2],
    /// Events that the list takes.
    pub capacity: u32,
    /// What a level is.
    pub level: u32,
    /// Whether pictures are moved.
    pub moves: u32,
    /// Whether thresholds differ.
    pub differs: u32,
    /// Whether the run writes, or only counts.
    pub writes: u32,
    /// Which of two pictures is the end of the window.
    pub now: u32,
}

/// Distance of the job that counts from the one that writes: a multiple of what any device asks of
/// offsets.
pub(super) const JOB_BYTES: u64 = 256;
