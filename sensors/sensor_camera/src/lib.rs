//! Views: cameras that give colour, depth, classes, instances, flow, normals and events from one
//! drawing of the scene.
//!
//! - A [`View`] is a lens and its memory from firing to firing; [`CameraRenderer`] draws all views
//!   of a tick in one submission, unless
//!   their shadow maps do not fit their memory.
//! - Geometry is drawn once per view into exactly the targets that have readers; without readers
//!   nothing is drawn at all.
//! - Depth, class, instance, flow and normals are exact and the same in every [`Quality`]; only
//!   colour differs.
//! - Positions reach the GPU relative to the camera as `f32`, computed in `f64`: far from the
//!   origin is as sharp as at it.
//!
//! Nothing here publishes: bytes go to a [`Place`] that the caller gives.

#![warn(missing_docs)]

mod assets;
mod debug;
mod draw;
pub mod dvs;
mod lamps;
mod light;
mod material;
mod merge;
mod pass;
mod pool;
mod post;
mod raster;
mod renderer;
mod shade;
mod shadow;
mod sky;
mod submission;
mod switched;
mod targets;
mod uniform;
mod view;

pub use dvs::gpu::EventJob;
pub use post::PostData;
pub use raster::{RasterDraw, RasterView, Rasteriser};
pub use renderer::{CameraRenderer, Quality, RenderError};
pub use sensor_gpu::Place;
pub use submission::{OutputResult, Submission, ViewResult};
pub use uniform::{InstanceData, LampData, LightData, ViewData};
pub use view::{Output, View, ViewJob, ViewSpec};

/// Text of every shader, by name, as it is given to the GPU; for validation without one.
pub fn shader_sources() -> Vec<(&'static str, String)> {
    vec![
        ("geometry", pass::geometry_wgsl(false, false, false)),
        ("geometry, slim", pass::geometry_wgsl(false, true, false)),
        (
            "geometry, attached",
            pass::geometry_wgsl(true, false, false),
        ),
        (
            "geometry, attached, slim",
            pass::geometry_wgsl(true, true, false),
        ),
        (
            "geometry, attached, slim, switched",
            pass::geometry_wgsl(true, true, true),
        ),
        ("shade, computed", shade::shade_wgsl(false)),
        ("shade, drawn", shade::shade_wgsl(true)),
        ("raster", raster::raster_wgsl()),
        ("resolve", raster::resolve_wgsl()),
        ("post", post::post_wgsl()),
        ("shadow", shadow::SHADOW_WGSL.to_owned()),
        ("events", dvs::gpu::events_wgsl()),
    ]
}
