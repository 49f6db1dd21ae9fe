//! What the event-like sensors report: collisions, crossed lane markings, obstacles ahead.
//!
//! Such a sensor sends a frame only for ticks in which something happened.

use bytemuck::{Pod, Zeroable};

/// The sensor's carrier and another thing pushed each other during the tick. 64 bytes, no padding.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct CollisionEvent {
    /// Actor that was touched; 0 is scenery.
    pub other_id: u32,
    /// Class of what was touched, in scenery the hardest contact; 0 for ground without one.
    pub class: u8,
    /// Zero.
    pub reserved: [u8; 3],
    /// Impulse on the carrier, summed over the tick, N·s; it points away from what was touched.
    pub impulse_in_world_ns: [f64; 3],
    /// Mean of the contact points, weighted with their impulses, metres.
    pub point_in_world_m: [f64; 3],
    /// Zero.
    pub reserved1: u64,
}
const _: () = assert!(size_of::<CollisionEvent>() == 64 && align_of::<CollisionEvent>() == 8);

/// A corner of the carrier's box went over a painted line during the tick. 32 bytes, no padding.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct LaneCrossing {
    /// 1 solid, 2 broken, 3 solid solid, 4 solid broken, 5 broken solid, 6 broken broken, 7 Botts'
    /// dots, 8 grass, 9 kerb, 10 other.
    pub mark: u8,
    /// 0 white, 1 yellow, 2 blue, 3 green, 4 red, 5 orange, 6 violet.
    pub colour: u8,
    /// Lane changes that the mark allows, seen along rising s of the road: bit 0 to the right, bit
    /// 1 to the left.
    pub lane_change: u8,
    /// OpenDRIVE's id of the lane whose outer edge is marked; 0 is the road's centre line.
    pub lane: i8,
    /// Width of the line, metres.
    pub width_m: f32,
    /// OpenDRIVE's road id if that is a number; otherwise a number above all such ids, assigned by
    /// the simulator.
    pub road: u32,
    /// Nanoseconds since the tick began (`sim_nanos − window_nanos`) at which the first corner
    /// crossed.
    pub nanos_in_window: u32,
    /// Place of the crossing, world, metres.
    pub crossing_in_world_m: [f32; 3],
    /// Zero.
    pub reserved: u32,
}
const _: () = assert!(size_of::<LaneCrossing>() == 32 && align_of::<LaneCrossing>() == 4);

/// The nearest thing in the way of the ball that an obstacle detector sends forward. 32 bytes, no
/// padding.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ObstacleEvent {
    /// Distance that the ball's centre travels until the ball touches something, metres; 0 if it
    /// touches at its start.
    pub distance_m: f32,
    /// Object touched.
    pub object_id: u32,
    /// Class touched.
    pub class: u8,
    /// Zero.
    pub reserved: [u8; 3],
    /// Point of contact in the sensor's space, metres.
    pub contact_in_sensor_m: [f32; 3],
    /// Zero.
    pub reserved1: [u32; 2],
}
const _: () = assert!(size_of::<ObstacleEvent>() == 32 && align_of::<ObstacleEvent>() == 4);
