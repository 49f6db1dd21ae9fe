//! What sensors share: the scene they look at, the schedule by which they fire, and the models of
//! IMU, GNSS and lane invasion.
//!
//! A sensor never publishes: it fills memory that it is given. Nothing here knows physics, the GPU
//! or shared memory.
//!
//! Modules in reading order: [`scene`] (what sensors see in one tick), [`mesh`] (the triangles that
//! cameras draw and rays hit), [`history`] (where things were at the ticks before), [`schedule`] (which
//! sensors fire at a tick), [`imu`], [`drift`] (its slow errors), [`gnss`], [`lane_marks`] (painted
//! lines and who crosses them), [`vector_lanes`] (vector instructions with the same results on every
//! processor).
//!
//! ```
//! use schema_types::SimTime;
//! use sensor_core::Schedule;
//!
//! // A sensor that fires once a second, in a simulation with ticks of 50 ms.
//! let mut schedule = Schedule::from_interval_secs(SimTime(0), 1.0);
//! let fires = |tick: &u64| schedule.due(SimTime(tick * 50_000_000)).is_some();
//! assert_eq!((1..=50).filter(fires).collect::<Vec<_>>(), [1, 21, 41]);
//! ```

#![warn(missing_docs)]

pub mod drift;
pub mod gnss;
pub mod history;
pub mod imu;
pub mod lane_marks;
pub mod mesh;
pub mod scene;
pub mod schedule;
pub mod stream;
pub mod vector_lanes;

pub use drift::Drift;
pub use gnss::GeoReference;
pub use history::{InstancePoses, PoseHistory};
pub use imu::{BodyMotion, BodyState, Felt, ImuInput, ImuNoise, ImuState};
pub use lane_marks::{PaintedLine, PaintedLines};
pub use mesh::{Lod, Material, Mesh, MeshBuilder, Vertex};
pub use scene::{
    DynamicInstance, LampSetting, MeshId, Past, Scene, SceneAssets, StaticInstance, Sun,
};
pub use schedule::{Firing, Schedule};
