//! The texts of all shaders, for validation without a GPU.

use crate::geometry::{GeometryShader, Instances, SceneryLamps};
use crate::shade::Shading;
use crate::target::Surfaces;
use crate::{blur, dvs, faces, lens, post, raster, shade, shadow};

/// The text of every shader by name, as the GPU gets it.
pub fn shader_sources() -> Vec<(&'static str, String)> {
    let geometry = |instances, surfaces, lamps| {
        let shader = GeometryShader {
            instances,
            surfaces,
            lamps,
        };
        shader.wgsl()
    };
    use Instances::{Attached, Listed};
    use SceneryLamps::{AsBuilt, Switched};
    use Surfaces::{Slim, Wide};
    vec![
        ("geometry", geometry(Listed, Wide, AsBuilt)),
        ("geometry, slim", geometry(Listed, Slim, AsBuilt)),
        ("geometry, attached", geometry(Attached, Wide, AsBuilt)),
        (
            "geometry, attached, slim",
            geometry(Attached, Slim, AsBuilt),
        ),
        (
            "geometry, attached, slim, switched",
            geometry(Attached, Slim, Switched),
        ),
        ("shade, computed", shade::shade_wgsl(Shading::Computed)),
        ("shade, drawn", shade::shade_wgsl(Shading::Drawn)),
        ("shade, in lanes", shade::lanes_wgsl()),
        ("chunks", raster::CHUNKS_WGSL.to_owned()),
        ("stills", raster::STILLS_WGSL.to_owned()),
        ("raster", raster::raster_wgsl()),
        ("resolve", raster::resolve_wgsl()),
        ("resolve, in lanes", raster::resolve_lanes_wgsl()),
        ("blur", blur::BLUR_WGSL.to_owned()),
        ("post", post::post_wgsl()),
        ("lens", lens::LENS_WGSL.to_owned()),
        ("faces", faces::FACES_WGSL.to_owned()),
        ("shadow", shadow::SHADOW_WGSL.to_owned()),
        ("events", dvs::events_wgsl()),
    ]
}
