//! The pass that splits draw calls into chunks of triangles.

use bytemuck::{Pod, Zeroable};
use sensor_gpu::{Gpu, Uploads};

use super::plan::CHUNK;
use crate::binding_layout::{compute_pass, storage, written_storage};
use crate::kept_groups::KeptGroups;

/// Text of the shader.
pub(crate) const CHUNKS_WGSL: &str = include_str!("../shader/chunks.wgsl");
const _: () = assert!(CHUNK == 64, "chunks.wgsl has it");

/// Mirror of `Counts` in `chunks.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ChunkCounts {
    /// Draw calls.
    pub n_draws: u32,
    /// Workgroups per row of the dispatch.
    pub n_across: u32,
    /// Unused.
    pub rest: [u32; 2],
}

/// Threads of a workgroup, as `chunks.wgsl` has it.
const N_LANES: u32 = 64;
/// Limit of workgroups across a dispatch.
const MAX_ACROSS: u32 = 32_768;

/// The pipeline.
#[derive(Debug)]
pub(super) struct ChunkPass {
    layout: wgpu::BindGroupLayout,
    kept: KeptGroups,
    pipeline: wgpu::ComputePipeline,
    counts: wgpu::Buffer,
}

impl ChunkPass {
    pub fn new(gpu: &Gpu) -> ChunkPass {
        let entries = [storage(0), written_storage(1), storage(2)];
        let (layout, pipeline) = compute_pass(gpu, "chunks", CHUNKS_WGSL, "cs_main", &entries);
        ChunkPass {
            layout,
            kept: KeptGroups::up_to(1),
            pipeline,
            counts: gpu.buffer(
                "counts of draws",
                size_of::<ChunkCounts>() as u64,
                wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            ),
        }
    }

    /// Uploads how many draw calls [`ChunkPass::dispatch`] splits; returns its workgroups.
    pub fn upload(
        &self,
        (uploads, encoder): (&mut Uploads, &mut wgpu::CommandEncoder),
        n_draws: u32,
    ) -> [u32; 2] {
        let n_groups = n_draws.div_ceil(N_LANES).max(1);
        let n_across = n_groups.min(MAX_ACROSS);
        let counts = ChunkCounts {
            n_draws,
            n_across,
            rest: [0; 2],
        };
        uploads.write(encoder, &self.counts, 0, bytemuck::bytes_of(&counts));
        [n_across, n_groups.div_ceil(n_across)]
    }

    /// Splits the first draw calls of their list.
    pub fn dispatch(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::ComputePass<'_>,
        [draws, chunks]: [&wgpu::Buffer; 2],
        [across, down]: [u32; 2],
    ) {
        let lists = [draws, chunks, &self.counts];
        let bound = self.kept.bind_whole(gpu, "chunks", &self.layout, &lists);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &bound, &[]);
        pass.dispatch_workgroups(across, down, 1);
    }
}
