//! Sensors that cast rays: lidar, semantic lidar, radar, obstacle detector, and what cameras with a
//! lens see beside colour, against the same triangles that cameras draw.
//!
//! [`RayScene`] holds bounding-volume hierarchies on two levels. The lower level is built once per
//! episode: one hierarchy per square of the scenery and one per mesh that can move. The upper level
//! is built in every tick over the moving instances. On the CPU, neighbouring rays with a common
//! origin walk the hierarchies together, as a bundle; on the GPU a compute shader walks the same
//! hierarchies ray by ray. Both find hits in `f32` relative to a near origin and then compute the
//! exact distance in `f64`, so that distances are right to well under a millimetre.
//!
//! Modules in reading order: `bvh` (hierarchies of boxes; they know neither scenes nor rays),
//! `ray_scene` (what rays can hit in one tick), `rays` (bundles, their walk, and what they hit),
//! [`lidar`], `camera` (images of a camera with a lens), [`radar`], `ball` (the obstacle detector's moving ball), `gpu` (lidars on the GPU).
//!
//! ```
//! use nalgebra::{Isometry3, Point3, Vector3};
//! use schema_types::{Class, ObjectId};
//! use sensor_core::mesh::Surface;
//! use sensor_core::{Material, MeshBuilder, SceneAssets, StaticInstance};
//! use sensor_ray::RayScene;
//!
//! // A wall 10 m ahead.
//! let mut wall = MeshBuilder::new("wall");
//! let surface = Surface::new(Class::WALLS, Material::Concrete, [128; 3]);
//! wall.cuboid(surface, [10.5, 0.0, 1.0], [0.5, 3.0, 1.0]);
//! let mut assets = SceneAssets::default();
//! let mesh = assets.add_mesh(wall.finish());
//! let object = ObjectId::scenery(1);
//! assets.statics.push(StaticInstance { mesh, world_from_mesh: Isometry3::identity(), object });
//!
//! let scene = RayScene::load(&assets);
//! let eye = Point3::new(0.0, 0.0, 1.0);
//! let hit = scene.cast(&eye, &Vector3::x(), 100.0).expect("the wall is in the way");
//! assert!((hit.distance_m - 10.0).abs() < 1e-4);
//! assert_eq!((hit.class, hit.object), (Class::WALLS, object));
//! ```

#![warn(missing_docs)]

mod ball;
mod bvh;
mod camera;
mod gpu;
pub mod lidar;
pub mod radar;
mod ray_scene;
mod rays;

pub use ball::{BallFilter, BallHit};
pub use camera::{LabelImages, NEAR_M, RayCamera};
pub use gpu::{GpuRayOptions, GpuRays, ScanJob, ScanOutcome, Scans, TooLarge};
pub use lidar::{Lidar, SensorPath};
pub use radar::RadarPose;
pub use ray_scene::RayScene;
pub use rays::Hit;
