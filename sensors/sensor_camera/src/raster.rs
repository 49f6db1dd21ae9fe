//! Triangles to pixels without the GPU's rasteriser: pipelines and lists for `raster.wgsl` and
//! `resolve.wgsl`.
//!
//! GPUs made for computing have one or two per cent of their arithmetic behind the rasteriser.
//! There a compute shader finds the nearest triangle of every pixel, and a second one writes what
//! each modality keeps of it into the same targets that drawing fills. Processors do both in tiles.

mod chunks;
mod lists;
mod pass;
mod plan;
mod rasteriser;
mod stills;
mod tile_images;
mod tile_pass;
mod tile_resolve;
mod tile_shade;
mod tile_surfaces;
mod tiles;

pub(crate) use chunks::CHUNKS_WGSL;
pub use chunks::ChunkCounts;
pub(crate) use pass::{RasterPass, raster_wgsl, resolve_lanes_wgsl, resolve_wgsl};
pub use plan::{RasterDraw, RasterView};
pub(crate) use plan::{RasterJob, RasterPlan};
pub use rasteriser::Rasteriser;
pub(crate) use rasteriser::can_compute;
pub(crate) use stills::STILLS_WGSL;
pub use stills::{StillCounts, StillView};
pub use tile_images::TileImages;
pub(crate) use tile_pass::TilePass;
pub use tile_pass::exact_images;
pub(crate) use tile_shade::TileLight;
pub use tiles::{TILE_PX, Tile, TileInput, TileLists};
