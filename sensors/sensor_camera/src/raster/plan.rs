//! Which views form a batch, and where their entries in the lists are.

use bytemuck::{Pod, Zeroable};

use crate::camera_motion::CameraMotion;
use crate::uniform::ViewData;
use crate::visible::Drawn;

/// Mirror of `RasterView` in `raster.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct RasterView {
    /// Focal length x, y, principal point x, y, pixels.
    pub lens_px: [f32; 4],
    /// Width, height.
    pub size_px: [u32; 2],
    /// Where its pixels begin in the list of what was seen.
    pub first_pixel: u32,
    /// Near plane.
    pub near_m: f32,
}

/// Mirror of `Draw` in `raster.wgsl` and `resolve.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct RasterDraw {
    /// Number of its first triangle among those of the view.
    pub first_triangle: u32,
    /// Triangles.
    pub n_triangles: u32,
    /// First index of the mesh's range.
    pub first_idx: u32,
    /// What is added to each index.
    pub base_vertex: u32,
    /// Index in the list of instances.
    pub instance: u32,
    /// Number of the view.
    pub view: u32,
    /// Where its chunks begin in their list.
    pub first_chunk: u32,
    /// Unused.
    pub rest: u32,
}

impl RasterDraw {
    /// Those of a view of this number, in their order. The chunks of the first begin at
    /// `first_chunk`.
    pub(crate) fn all_of(
        drawn: &Drawn,
        view: u32,
        first_chunk: u32,
    ) -> impl Iterator<Item = RasterDraw> {
        let (mut next_triangle, mut next_chunk) = (0, first_chunk);
        drawn.calls.iter().map(move |call| {
            let (first_triangle, n_triangles) = (next_triangle, call.mesh.n_indices / 3);
            next_triangle += n_triangles;
            let first_chunk = next_chunk;
            next_chunk += n_triangles.div_ceil(CHUNK);
            RasterDraw {
                first_triangle,
                n_triangles,
                first_idx: call.mesh.first_idx,
                base_vertex: call.mesh.base_vertex as u32,
                instance: drawn.instance(call),
                view,
                first_chunk,
                rest: 0,
            }
        })
    }
}

/// Mirror of `Batch` in `raster.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct RasterBatch {
    pub first_chunk: u32,
    pub n_chunks: u32,
    pub n_across: u32,
    pub max_tiles: u32,
}

/// Triangles of a workgroup.
pub(super) const CHUNK: u32 = 64;
/// A view to rasterise.
pub(crate) struct RasterJob<'r> {
    pub lens_px: [f32; 4],
    pub size_px: [u32; 2],
    pub drawn: &'r Drawn,
    pub motion: &'r CameraMotion,
}

impl<'r> RasterJob<'r> {
    pub fn new(view: &ViewData, drawn: &'r Drawn, motion: &'r CameraMotion) -> Self {
        RasterJob {
            lens_px: view.lens_px,
            size_px: view.size_px.map(|side| side as u32),
            drawn,
            motion,
        }
    }
}

/// Where a view's entries in the lists are.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ViewLists {
    /// Views of one batch are rasterised together.
    pub batch: usize,
    pub(super) first_draw: u32,
    pub(super) n_draws: u32,
    pub(super) first_chunk: u32,
    pub(super) first_pixel: u32,
}

impl ViewLists {
    /// Writes the place of the view's draw calls and pixels into its uniform.
    pub fn tell(&self, view: &mut ViewData) {
        view.first_draw = self.first_draw;
        view.n_draws = self.n_draws;
        view.first_pixel = self.first_pixel;
    }
}

/// Result of [`crate::raster::RasterPass::upload`].
#[derive(Debug, Default)]
pub(crate) struct RasterPlan {
    pub views: Vec<ViewLists>,
    pub(super) batches: Vec<RasterBatch>,
    pub(super) n_pixels: Vec<u64>,
}

impl RasterPlan {
    /// Number of the batch that a view is rasterised with.
    pub fn batch_of(&self, view_idx: usize) -> usize {
        self.views[view_idx].batch
    }
}
