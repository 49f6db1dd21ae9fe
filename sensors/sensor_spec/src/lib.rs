//! What a launch file or a blueprint may ask of each sensor, and the checks. No GPU, no scene.
//!
//! Units are in the keys. Every check answers with what, which value, what is allowed.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod camera;
mod check;
mod dvs;
mod events;
mod gnss;
mod imu;
mod lidar;
mod mount;
mod optics;
mod radar;
mod sensor;

pub use camera::{CameraSpec, Intrinsics, SIDE_PX};
pub use check::SpecError;
pub use dvs::{DvsMode, DvsSpec};
pub use events::{CollisionSpec, LaneInvasionSpec, MAX_EVENTS_PER_TICK, ObstacleSpec};
pub use gnss::GnssSpec;
pub use imu::ImuSpec;
pub use lidar::{LidarScan, LidarSpec, MAX_CHANNELS, MAX_POINTS_PER_SECOND};
pub use mount::{Attachment, MountSpec};
pub use optics::{ExposureMode, ExposureSpec, OpticsSpec};
pub use radar::RadarSpec;
pub use sensor::SensorSpec;
