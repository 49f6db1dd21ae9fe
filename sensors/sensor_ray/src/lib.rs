//! Ray sensors on the CPU: lidar, semantic lidar, radar and obstacle detector against the same
//! triangles that cameras draw.
//!
//! Two levels: bounding-volume hierarchies over the scenery (built once per episode) and over each
//! moving mesh (shared by its instances), and a small hierarchy over the instances of the tick, an
//! actor's parts in nodes that are fitted and not searched for. Rays with a common origin travel in
//! bundles of neighbours. Hits are found in `f32` about a near origin and then made exact in `f64`,
//! so that distances hold to well under a millimetre.

#![warn(missing_docs)]

mod ball;
mod bvh;
mod gpu;
pub mod lidar;
pub mod radar;
mod ray_scene;
mod rays;

pub use ball::{BallFilter, BallHit};
pub use gpu::{GpuRayOptions, GpuRays, ScanJob, ScanOutcome, Scans};
pub use lidar::{Lidar, SensorPath};
pub use radar::RadarPose;
pub use ray_scene::RayScene;
pub use rays::Hit;
