//! Events of the event camera.

use bytemuck::{Pod, Zeroable};

/// One brightness change. 16 bytes, no padding. A frame's events are sorted by time, then y, then
/// x.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct DvsEvent {
    /// Nanoseconds since the frame's window began (`sim_nanos − window_nanos`).
    pub nanos_in_window: u32,
    /// Pixel column.
    pub x_px: u16,
    /// Pixel row.
    pub y_px: u16,
    /// Object id at this pixel when the window ended.
    pub object_id: u32,
    /// 1: brighter, 0: darker.
    pub polarity: u8,
    /// Class at this pixel when the window ended.
    pub class: u8,
    /// Zero.
    pub reserved: u16,
}
const _: () = assert!(size_of::<DvsEvent>() == 16 && align_of::<DvsEvent>() == 4);
