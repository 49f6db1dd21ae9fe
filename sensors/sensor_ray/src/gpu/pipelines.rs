//! Pipelines of the lidar shader.

use sensor_gpu::{Gpu, prefix_sum_wgsl};

use super::shader::{Dispatch, LANES, MAX_SIDE, OUTPUT_BUFFERS, SCENE_BUFFERS, WORKGROUP_BYTES};

/// What a GPU lacks for lidars, in a sentence.
pub(super) fn missing(gpu: &Gpu) -> Option<String> {
    if !gpu.has_wide_numbers() {
        return Some(format!(
            "{:?} cannot cast lidars: its shaders have no 64-bit numbers",
            gpu.name()
        ));
    }
    let immediates = size_of::<Dispatch>() as u32;
    if !gpu.has_immediates(immediates) {
        return Some(format!(
            "{:?} cannot cast lidars: its shaders take no {immediates} bytes with a dispatch",
            gpu.name()
        ));
    }
    missing_limit(&gpu.device().limits())
        .map(|lack| format!("{:?} cannot cast lidars: {lack}", gpu.name()))
}

/// The first limit that is too low.
fn missing_limit(limits: &wgpu::Limits) -> Option<String> {
    let needed = [
        (
            "storage buffers in a shader",
            limits.max_storage_buffers_per_shader_stage,
            SCENE_BUFFERS + OUTPUT_BUFFERS,
        ),
        ("groups of bindings", limits.max_bind_groups, 2),
        (
            "bindings in a group",
            limits.max_bindings_per_bind_group,
            OUTPUT_BUFFERS.max(SCENE_BUFFERS),
        ),
        (
            "lanes in a workgroup",
            limits
                .max_compute_invocations_per_workgroup
                .min(limits.max_compute_workgroup_size_x),
            LANES,
        ),
        (
            "bytes of memory in a workgroup",
            limits.max_compute_workgroup_storage_size,
            WORKGROUP_BYTES,
        ),
        (
            "workgroups along a side of a dispatch",
            limits.max_compute_workgroups_per_dimension,
            MAX_SIDE,
        ),
    ];
    let (what, has, needs) = needed.into_iter().find(|(_, has, needs)| has < needs)?;
    Some(format!("it has {has} {what}, {needs} are needed"))
}

/// Pipelines and the layouts of what is bound to them.
pub(super) struct Pipelines {
    /// Scene, lidars and scratch memory.
    pub scene: wgpu::BindGroupLayout,
    /// Totals and outputs.
    pub outputs: wgpu::BindGroupLayout,
    trace: wgpu::ComputePipeline,
    pack: wgpu::ComputePipeline,
    both: wgpu::ComputePipeline,
}

impl Pipelines {
    pub fn new(gpu: &Gpu, block_columns: u32) -> Self {
        let scene = layout(gpu, "lidars", SCENE_BUFFERS, 5);
        let outputs = layout(gpu, "lidar outputs", OUTPUT_BUFFERS, 0);
        let of_pipeline = gpu
            .device()
            .create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("lidars"),
                bind_group_layouts: &[Some(&scene), Some(&outputs)],
                immediate_size: size_of::<Dispatch>() as u32,
            });
        let text = prefix_sum_wgsl(LANES) + include_str!("lidar.wgsl");
        #[expect(
            unsafe_code,
            reason = "checks of indices and loops cost a part of the rays per second; the block carries its proof"
        )]
        // SAFETY: nodes, triangles and instances are numbered by `Packed` and `GpuScene`, which
        // fill the buffers. Rays, chunks and words are numbered by `Submission`; the buffers are
        // sized and the outputs checked after that. A walk visits a node once, its stack holds what
        // `GpuScene::update` lets through, and all other loops count bits, lanes or words.
        let shader = unsafe { gpu.shader_unchecked("lidars", &text) };
        let pipeline = |entry_point: &str| {
            let constants: &[(&str, f64)] = if entry_point == "pack" {
                &[]
            } else {
                &[("block_columns", block_columns as f64)]
            };
            gpu.device()
                .create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                    label: Some(entry_point),
                    layout: Some(&of_pipeline),
                    module: &shader,
                    entry_point: Some(entry_point),
                    compilation_options: wgpu::PipelineCompilationOptions {
                        constants,
                        zero_initialize_workgroup_memory: false,
                    },
                    cache: None,
                })
        };
        let [trace, pack, both] = ["trace", "pack", "both"].map(pipeline);
        Pipelines {
            scene,
            outputs,
            trace,
            pack,
            both,
        }
    }

    /// The pipeline of a dispatch, and the label of its timing.
    pub fn of(&self, dispatch: &Dispatch) -> (&wgpu::ComputePipeline, &'static str) {
        match (dispatch.n_traced > 0, dispatch.n_packed > 0) {
            (true, false) if dispatch.fits() => (&self.trace, "lidar trace"),
            (false, _) if dispatch.fits() => (&self.pack, "lidar pack"),
            _ => (&self.both, "lidar trace and pack"),
        }
    }
}

/// Layout of `n` storage buffers, the first `n_read` of them read-only.
fn layout(gpu: &Gpu, label: &str, n: u32, n_read: u32) -> wgpu::BindGroupLayout {
    let entry = |binding: u32| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Storage {
                read_only: binding < n_read,
            },
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        count: None,
    };
    let entries: Vec<_> = (0..n).map(entry).collect();
    gpu.device()
        .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(label),
            entries: &entries,
        })
}

/// Binds whole buffers in order.
pub(super) fn bind<'b>(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    buffers: impl IntoIterator<Item = &'b wgpu::Buffer>,
) -> wgpu::BindGroup {
    let entry = |(i, buffer): (usize, &'b wgpu::Buffer)| wgpu::BindGroupEntry {
        binding: i as u32,
        resource: buffer.as_entire_binding(),
    };
    let entries: Vec<_> = buffers.into_iter().enumerate().map(entry).collect();
    gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout,
        entries: &entries,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gpu_that_lacks_something_is_told_what() {
        // WebGPU's least: 8 storage buffers where the shader binds 16.
        let least = wgpu::Limits::default();
        assert_eq!(
            missing_limit(&least).as_deref(),
            Some("it has 8 storage buffers in a shader, 16 are needed")
        );
        let enough = wgpu::Limits {
            max_storage_buffers_per_shader_stage: 16,
            ..least
        };
        assert_eq!(missing_limit(&enough), None);
        let small = wgpu::Limits {
            max_compute_workgroup_storage_size: 1024,
            ..enough
        };
        assert_eq!(
            missing_limit(&small).as_deref(),
            Some("it has 1024 bytes of memory in a workgroup, 1280 are needed")
        );
    }
}
