//! Roads cut at junctions, lanes joined by connecting roads, traffic lights and signs; the network
//! as OpenDRIVE text, and where vehicles start.

mod build;
mod connect;
mod elevation;
pub mod guide;
pub mod kerb;
pub mod lane_lines;
mod model;
pub mod open_drive;
mod right_of_way;
mod spawn_points;

pub use model::{
    Arm, CROSSWALK_M, KERB_HEIGHT_M, Network, PARAPET_M, Road, STOP_M, Signal, SignalKind, facing,
};
pub use spawn_points::spawn_points;
