//! Cameras: colour, depth, classes, instances, flow, normals and events from one drawing of the
//! scene.
//!
//! - A [`View`] is a lens and its state from firing to firing. [`CameraRenderer`] draws all views
//!   of a tick in one submission, unless their shadow maps exceed the memory they may use.
//! - Geometry is drawn once per view into exactly the targets that have readers; without readers
//!   nothing is drawn at all.
//! - Depth, class, instance, flow and normals are exact and the same in every [`Quality`]; only
//!   colour differs.
//! - Positions are computed in `f64` and reach the GPU as `f32` relative to the camera, so images
//!   are as sharp far from the origin as at it.
//!
//! Nothing here publishes: bytes go to a [`Place`] that the caller provides.
//!
//! | Modules, in reading order | What they hold |
//! |---|---|
//! | `quality`, `uniform`, `vertex` | what Rust and WGSL agree on |
//! | `camera_motion`, `assets`, `target` | poses, meshes on the GPU, render targets |
//! | `occlusion`, `visible`, `lamps`, `light`, `shadow` | what a view sees, and the light it is seen in |
//! | `binding_layout`, `bindings`, `kept_groups` | bind groups that several passes share, or that are kept |
//! | `geometry`, `raster`, `shade`, `blur`, `post`, `debug`, `lens`, `faces` | the passes, each beside its shaders |
//! | `overlay` | what the spectator alone sees: texts, lines on the screen |
//! | [`dvs`] | the event camera, on the CPU and on the GPU |
//! | `view` | what is asked of a camera, and the results |
//! | `renderer` | the tick: who has readers, what is drawn in which order |
//! | `tile_renderer` | views on processors, without a GPU |
//!
//! ```no_run
//! use nalgebra::Isometry3;
//! use schema_frames::Modality;
//! use sensor_camera::{CameraRenderer, Output, Place, Quality, View, ViewJob, ViewSpec};
//! use sensor_gpu::{Gpu, GpuOptions};
//! use sensor_spec::Intrinsics;
//!
//! # fn example(scene: &sensor_core::Scene) -> Result<(), Box<dyn std::error::Error>> {
//! let gpu = Gpu::open(&GpuOptions::default())?;
//! let mut renderer = CameraRenderer::new(&gpu, Quality::default_for(&gpu));
//! let lens = Intrinsics::from_fov(640, 480, 90f64.to_radians());
//! let mut view = View::new(&gpu, ViewSpec::pinhole(lens));
//! let mut bytes = vec![0; view.payload_bytes(Modality::Depth)];
//! let job = ViewJob {
//!     view: &mut view,
//!     world_from_sensor: Isometry3::translation(0.0, 0.0, 1.6),
//!     outputs: vec![Output {
//!         modality: Modality::Depth,
//!         place: Place::Memory(&mut bytes),
//!     }],
//! };
//! let results = renderer.render(scene, vec![job])?.wait()?;
//! assert_eq!(results[0].outputs[0].n_bytes, 4 * 640 * 480);
//! # Ok(())
//! # }
//! ```

#![warn(missing_docs)]

mod quality;
mod uniform;
mod vertex;

mod camera_motion;

mod assets;
mod target;

mod contact;
mod lamps;
mod light;
mod occlusion;
mod shadow;
mod visible;

mod binding_layout;
mod bindings;
mod kept_groups;

mod blur;
mod debug;
mod faces;
mod geometry;
mod lens;
mod overlay;
mod post;
mod raster;
mod shade;

pub mod dvs;

mod view;

mod renderer;
mod shader_sources;
mod tile_renderer;

pub use blur::BlurData;
pub use dvs::EventJob;
pub use lens::LensData;
pub use post::PostData;
pub use quality::Quality;
pub use raster::{
    ChunkCounts, RasterDraw, RasterView, Rasteriser, StillCounts, StillView, TILE_PX, Tile,
    TileImages, TileInput, TileLists, exact_images,
};
pub use renderer::{CameraRenderer, HeldImages, RenderError};
pub use sensor_gpu::Place;
pub use shader_sources::shader_sources;
pub use tile_renderer::{TileCamera, TileRenderer};
pub use uniform::{
    AmbientData, FogData, InstanceData, LampData, LightData, MapPlace, SceneryLampsData, StillData,
    SunData, ViewData, WaterData,
};
pub use view::{Output, OutputResult, Submission, View, ViewJob, ViewResult, ViewSpec};
