//! Focus and motion blur: gathers radiance before it is developed. Views without either skip these
//! passes and make none of their pipelines.

use bytemuck::{Pod, Zeroable};
use sensor_gpu::Gpu;
use sensor_spec::{FocusSpec, Intrinsics, OpticsSpec};

use crate::binding_layout::{entry, sampler, texture, uniform};
use crate::target::{Image, Target, Targets, image};

/// Text of the shader.
pub(crate) const BLUR_WGSL: &str = include_str!("shader/blur.wgsl");

/// Mirror of `Blur` in `shader/blur.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct BlurData {
    /// Width and height.
    pub size_px: [f32; 2],
    /// Radius of blur at infinity.
    pub far_radius_px: f32,
    /// Distance that is sharp.
    pub focus_m: f32,
    /// Radius of haze at infinity.
    pub haze_px: f32,
    /// One over the distance at which haze has half of its radius.
    pub haze_per_m: f32,
    /// Longest radius and longest half streak.
    pub longest_px: f32,
    /// Half of the exposure over the time that flow covers.
    pub half_exposure_ratio: f32,
    /// Corners of the diaphragm; 0 for a circle.
    pub n_blades: f32,
    /// Curvature radius of its blades over that of its corners; 0 for straight ones.
    pub blade_radius: f32,
    /// Area of the diaphragm whose corners lie at 1.
    pub blades_area: f32,
    /// Unused.
    pub unused: u32,
}

/// Pixels of one workgroup.
const GROUP_PX: [u32; 2] = [16, 8];
/// Side of a tile, as the shader has it.
const TILE_PX: u32 = 16;
/// Longest radius of blur as a share of the width.
const LONGEST_RADIUS: f32 = 0.04;
/// Width of the image that radii of haze are given for, pixels.
const HAZE_WIDTH_PX: f32 = 1920.0;
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// One view's blur.
pub(crate) struct BlurJob<'b> {
    pub optics: &'b OpticsSpec,
    /// The picture's lens, without margins.
    pub lens: Intrinsics,
    pub targets: &'b Targets,
    pub layer: u32,
    /// Simulated time that flow covers.
    pub since_secs: f32,
}

impl BlurJob<'_> {
    fn focus_data(&self, size_px: [f32; 2]) -> Option<BlurData> {
        let focus = &self.optics.focus;
        if !self.optics.has_focus() {
            return None;
        }
        let (n_blades, blade_radius, blades_area) = diaphragm(focus);
        let width_px = self.lens.width_px as f32;
        Some(BlurData {
            far_radius_px: focus.far_radius_px(&self.lens) as f32,
            focus_m: focus.distance_m,
            haze_px: focus.haze_px * width_px / HAZE_WIDTH_PX,
            haze_per_m: 1.0 / focus.haze_half_m,
            longest_px: LONGEST_RADIUS * width_px,
            n_blades,
            blade_radius,
            blades_area,
            ..no_blur(size_px)
        })
    }

    fn streak_data(&self, size_px: [f32; 2]) -> Option<BlurData> {
        let blur = &self.optics.motion_blur;
        (self.optics.smears_motion() && self.since_secs > 0.0).then(|| BlurData {
            longest_px: 0.5 * blur.longest_ratio * self.lens.width_px as f32,
            half_exposure_ratio: 0.5 * blur.shutter_secs / self.since_secs,
            ..no_blur(size_px)
        })
    }
}

fn no_blur(size_px: [f32; 2]) -> BlurData {
    BlurData {
        size_px,
        ..BlurData::zeroed()
    }
}

/// Number of corners, curvature radius of the blades in units of the corners' distance, area.
fn diaphragm(focus: &FocusSpec) -> (f32, f32, f32) {
    use std::f32::consts::PI;
    if focus.fstop <= focus.min_fstop {
        return (0.0, 0.0, PI);
    }
    let (n, step) = (focus.blades as f32, 2.0 * PI / focus.blades as f32);
    let polygon = 0.5 * n * step.sin();
    if focus.min_fstop == 0.0 {
        return (n, 0.0, polygon);
    }
    // Each blade adds a segment of its circle to the polygon.
    let radius = focus.fstop / focus.min_fstop;
    let angle = 2.0 * ((0.5 * step).sin() / radius).asin();
    let segment = 0.5 * radius * radius * (angle - angle.sin());
    (n, radius, polygon + n * segment)
}

/// Pipelines.
#[derive(Debug)]
pub(crate) struct BlurPass {
    layout: wgpu::BindGroupLayout,
    radius_tiles: wgpu::ComputePipeline,
    focus: wgpu::ComputePipeline,
    streak_tiles: wgpu::ComputePipeline,
    streaks: wgpu::ComputePipeline,
    sampler: wgpu::Sampler,
    /// Bound where a step reads no tiles.
    no_tiles: Image,
}

impl BlurPass {
    pub fn new(gpu: &Gpu) -> Self {
        let device = gpu.device();
        let float = |filterable| wgpu::TextureSampleType::Float { filterable };
        let mut entries = [
            uniform(0, size_of::<BlurData>() as u64),
            texture(1, float(true)),
            texture(2, float(false)),
            texture(3, float(false)),
            texture(4, float(true)),
            sampler(5, wgpu::SamplerBindingType::Filtering),
            entry(
                6,
                wgpu::BindingType::StorageTexture {
                    access: wgpu::StorageTextureAccess::WriteOnly,
                    format: FORMAT,
                    view_dimension: wgpu::TextureViewDimension::D2,
                },
            ),
        ];
        entries
            .iter_mut()
            .for_each(|entry| entry.visibility = wgpu::ShaderStages::COMPUTE);
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("blur"),
            entries: &entries,
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("blur"),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let shader = gpu.shader("blur", BLUR_WGSL);
        let pipeline = |entry_point| {
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry_point),
                layout: Some(&pipeline_layout),
                module: &shader,
                entry_point: Some(entry_point),
                compilation_options: Default::default(),
                cache: None,
            })
        };
        BlurPass {
            radius_tiles: pipeline("cs_radius_tiles"),
            focus: pipeline("cs_focus"),
            streak_tiles: pipeline("cs_streak_tiles"),
            streaks: pipeline("cs_streaks"),
            layout,
            sampler: device.create_sampler(&wgpu::SamplerDescriptor {
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
            no_tiles: image(
                gpu,
                "no tiles",
                [1, 1],
                FORMAT,
                wgpu::TextureUsages::TEXTURE_BINDING,
            ),
        }
    }

    /// Blurs the radiance of a view: first what is out of focus, then what moves. `None` if
    /// nothing is blurred in this firing.
    pub fn record(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::ComputePass<'_>,
        job: &BlurJob<'_>,
    ) -> Option<Image> {
        let sharp = job.targets.get(Target::Radiance);
        let size_px = [sharp.texture.width(), sharp.texture.height()];
        let size = size_px.map(|side| side as f32);
        let steps = [
            (job.focus_data(size), [&self.radius_tiles, &self.focus]),
            (job.streak_data(size), [&self.streak_tiles, &self.streaks]),
        ];
        let mut blurred: Option<Image> = None;
        for (data, [tiling, gathering]) in steps {
            let Some(data) = data else { continue };
            let sharp = sharp.layer(job.layer);
            let from = blurred.as_ref().map_or(&sharp, |image| &image.view);
            let depth = job.targets.get(Target::Depth).layer(job.layer);
            // Focus reads no flow; any image stands in for it.
            let flow = match job.optics.smears_motion() {
                true => job.targets.get(Target::Flow).layer(job.layer),
                false => depth.clone(),
            };
            let data = gpu.buffer_with(
                "blur",
                bytemuck::bytes_of(&data),
                wgpu::BufferUsages::UNIFORM,
            );
            let usage = wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING;
            let n_tiles = size_px.map(|side| side.div_ceil(TILE_PX));
            let tiles = image(gpu, "blur tiles", n_tiles, FORMAT, usage);
            let out = image(gpu, "blurred", size_px, FORMAT, usage);
            let mut run = |pipeline: &wgpu::ComputePipeline,
                           [read, written]: [&wgpu::TextureView; 2],
                           [across, down]: [u32; 2]| {
                let bound = self.bind(gpu, &data, [from, &depth, &flow, read], written);
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, &bound, &[]);
                pass.dispatch_workgroups(across, down, 1);
            };
            run(
                tiling,
                [&self.no_tiles.view, &tiles.view],
                n_tiles.map(|n| n.div_ceil(8)),
            );
            run(
                gathering,
                [&tiles.view, &out.view],
                [
                    size_px[0].div_ceil(GROUP_PX[0]),
                    size_px[1].div_ceil(GROUP_PX[1]),
                ],
            );
            blurred = Some(out);
        }
        blurred
    }

    fn bind(
        &self,
        gpu: &Gpu,
        data: &wgpu::Buffer,
        read: [&wgpu::TextureView; 4],
        written: &wgpu::TextureView,
    ) -> wgpu::BindGroup {
        let view = |binding, view| wgpu::BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::TextureView(view),
        };
        gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("blur"),
            layout: &self.layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: data.as_entire_binding(),
                },
                view(1, read[0]),
                view(2, read[1]),
                view(3, read[2]),
                view(4, read[3]),
                wgpu::BindGroupEntry {
                    binding: 5,
                    resource: wgpu::BindingResource::Sampler(&self.sampler),
                },
                view(6, written),
            ],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Oracle: numeric area of a polygon with arcs, by its rim at a million directions.
    #[test]
    fn the_area_of_the_diaphragm_is_right() {
        let focus = FocusSpec {
            distance_m: 1.0,
            fstop: 2.8,
            min_fstop: 1.2,
            blades: 6,
            ..Default::default()
        };
        let (n, radius, area) = diaphragm(&focus);
        let (step, n_parts) = (std::f64::consts::TAU / n as f64, 100_000);
        let radius = radius as f64;
        let middle = (0.5 * step).cos() - (radius * radius - (0.5 * step).sin().powi(2)).sqrt();
        let rim = |angle: f64| {
            middle * angle.cos() + (radius * radius - (middle * angle.sin()).powi(2)).sqrt()
        };
        let by_angle: f64 = (0..n_parts)
            .map(|i| ((i as f64 + 0.5) / n_parts as f64 - 0.5) * step)
            .map(|angle| 0.5 * rim(angle).powi(2) * step / n_parts as f64)
            .sum();
        assert!(
            (area as f64 - n as f64 * by_angle).abs() < 1e-4,
            "{area} {by_angle}"
        );
        let open = FocusSpec {
            fstop: 1.2,
            ..focus
        };
        assert_eq!(diaphragm(&open).0, 0.0);
    }
}
