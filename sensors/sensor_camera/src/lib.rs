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

#![warn(missing_docs)]

mod quality;
mod uniform;
mod vertex;

mod binding_layout;
mod bindings;

mod assets;
mod camera_motion;
mod target;
mod visible;

mod lamps;
mod light;
mod shadow;

mod debug;
mod geometry;
mod post;
mod raster;
mod shade;

pub mod dvs;

mod view;

mod renderer;
mod shader_sources;

pub use dvs::EventJob;
pub use post::PostData;
pub use quality::Quality;
pub use raster::{RasterDraw, RasterView, Rasteriser};
pub use renderer::{CameraRenderer, RenderError};
pub use sensor_gpu::Place;
pub use shader_sources::shader_sources;
pub use uniform::{
    AmbientData, FogData, InstanceData, LampData, LightData, MapPlace, SceneryLampsData, SunData,
    ViewData, WaterData,
};
pub use view::{Output, OutputResult, Submission, View, ViewJob, ViewResult, ViewSpec};
