//! What every sensor shares: the scene it looks at, when it fires, its noise, IMU and GNSS models.
//!
//! A sensor never publishes: it fills memory that it is given. Nothing here knows physics, GPU or
//! shared memory.

#![warn(missing_docs)]

pub mod gnss;
pub mod imu;
pub mod lane_marks;
pub mod lanes;
pub mod mesh;
pub mod scene;
pub mod schedule;
pub mod vector;

pub use gnss::GeoReference;
pub use imu::{BodyMotion, BodyState, ImuInput};
pub use lane_marks::{PaintedLine, PaintedLines};
pub use mesh::{Lod, Material, Mesh, MeshBuilder, Vertex};
pub use scene::{DynamicInstance, LampSetting, MeshId, Scene, SceneAssets, StaticInstance, Sun};
pub use schedule::{Firing, Schedule};
