//! The pass that makes the matrices of static instances, in `f64` from the scenery's poses, which are
//! uploaded once.

use bytemuck::{Pod, Zeroable};
use sensor_gpu::{Gpu, Uploads};

use super::plan::RasterJob;
use crate::assets::matrix_rows;
use crate::binding_layout::{compute_pass, grow, storage, written_storage};
use crate::kept_groups::KeptGroups;
use crate::visible::static_previous;

/// Text of the shader.
pub(crate) const STILLS_WGSL: &str = include_str!("../shader/stills.wgsl");

/// Mirror of `StillView` in `stills.wgsl`: how a view sees static instances.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct StillView {
    /// World to camera space: rows of `[rotation | translation]`.
    pub camera_from_world: [[f64; 4]; 3],
    /// Camera space now to camera space at the previous firing.
    pub previous_from_camera: [[f32; 4]; 3],
    /// Where its numbers begin.
    pub first: u32,
    /// How many they are.
    pub n: u32,
    /// 1 if the camera moved.
    pub moved: u32,
    /// Unused.
    pub rest: u32,
}

/// Mirror of `Counts` in `stills.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct StillCounts {
    /// Instances that lie before those that are made.
    pub n_before: u32,
    /// Unused.
    pub rest: [u32; 3],
}

/// Threads of a workgroup, as `stills.wgsl` has it.
const N_LANES: u32 = 64;

/// The pipeline, and what it reads of each view.
#[derive(Debug)]
pub(super) struct StillPass {
    layout: wgpu::BindGroupLayout,
    kept: KeptGroups,
    pipeline: wgpu::ComputePipeline,
    views: wgpu::Buffer,
    counts: wgpu::Buffer,
}

impl StillPass {
    /// Forgets what it bound.
    pub fn forget(&self) {
        self.kept.clear();
    }

    /// `None` if shaders have no `f64`.
    pub fn new(gpu: &Gpu) -> Option<StillPass> {
        if !gpu.has_wide_numbers() {
            return None;
        }
        let entries = [0, 1, 2, 4].map(storage);
        let entries = [
            entries[0],
            entries[1],
            entries[2],
            written_storage(3),
            entries[3],
        ];
        let (layout, pipeline) = compute_pass(gpu, "stills", STILLS_WGSL, "cs_instances", &entries);
        let list = |label, n_bytes: usize| {
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
            gpu.buffer(label, n_bytes as u64, usage)
        };
        Some(StillPass {
            layout,
            kept: KeptGroups::up_to(1),
            pipeline,
            views: list("views of stills", size_of::<StillView>()),
            counts: list("counts of stills", size_of::<StillCounts>()),
        })
    }

    /// Uploads what [`StillPass::dispatch`] needs of the views. Returns its workgroups; `None` if no
    /// view sees anything that stands still.
    pub fn upload(
        &mut self,
        gpu: &Gpu,
        (uploads, encoder): (&mut Uploads, &mut wgpu::CommandEncoder),
        jobs: &[RasterJob<'_>],
    ) -> Option<[u32; 2]> {
        let (mut n_before, mut first) = (0, 0);
        let mut views = Vec::with_capacity(jobs.len());
        for RasterJob { drawn, motion, .. } in jobs {
            let n = drawn.still.len() as u32;
            n_before += drawn.instances.len() as u32;
            views.push(StillView {
                camera_from_world: matrix_rows(&motion.camera_from_world),
                previous_from_camera: static_previous(motion),
                first,
                n,
                moved: motion.moved().into(),
                rest: 0,
            });
            first += n;
        }
        if first == 0 {
            return None;
        }
        grow(gpu, &mut self.views, size_of_val(&views[..]) as u64);
        let counts = StillCounts {
            n_before,
            rest: [0; 3],
        };
        uploads.write(encoder, &self.views, 0, bytemuck::cast_slice(&views));
        uploads.write(encoder, &self.counts, 0, bytemuck::bytes_of(&counts));
        let most = views.iter().map(|view| view.n).max().unwrap_or(0);
        Some([most.div_ceil(N_LANES), views.len() as u32])
    }

    /// Makes the instances of `stills` that `numbers` lists, behind those that were uploaded.
    pub fn dispatch(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::ComputePass<'_>,
        [stills, numbers, instances]: [&wgpu::Buffer; 3],
        [across, down]: [u32; 2],
    ) {
        let lists = [&self.views, stills, numbers, instances, &self.counts];
        let bound = self.kept.bind_whole(gpu, "stills", &self.layout, &lists);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &bound, &[]);
        pass.dispatch_workgroups(across, down, 1);
    }
}
