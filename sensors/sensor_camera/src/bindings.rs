//! What the passes of a submission read together: light, views, instances and lamps, and the bind
//! groups that hold them.

use sensor_gpu::{Gpu, Uploads};

use crate::binding_layout::{
    grow, sampler, storage, texture, texture_of, uniform, uniform_at_offset,
};
use crate::kept_groups::KeptGroups;
use crate::lamps::LampLists;
use crate::light;
use crate::target::{TargetSet, Targets};
use crate::uniform::{InstanceData, LampData, LightData, MAX_TOGETHER, ViewData};

/// Distance between two views' uniforms; Vulkan's largest required alignment is 256.
const VIEW_BYTES: u64 = size_of::<ViewData>() as u64;
const _: () = assert!(VIEW_BYTES.is_multiple_of(256));
/// What one binding holds.
pub(crate) const VIEWS_BYTES: u64 = VIEW_BYTES * MAX_TOGETHER as u64;

const LAMP_BYTES: u64 = size_of::<LampData>() as u64;

pub(crate) const INSTANCE_BYTES: u64 = size_of::<InstanceData>() as u64;

/// Consecutive views whose targets are layers of the same textures: one dispatch handles them
/// together.
pub(crate) struct Together<'t> {
    pub targets: &'t Targets,
    /// All kinds that the targets have, wanted or not.
    pub kept: TargetSet,
    pub first: usize,
    pub n: usize,
}

/// Buffers, samplers and layouts that passes share.
#[derive(Debug)]
pub(crate) struct Bindings {
    pub scene_layout: wgpu::BindGroupLayout,
    /// Layout of one drawn view.
    pub view_layout: wgpu::BindGroupLayout,
    /// Layout of computed views.
    pub views_layout: wgpu::BindGroupLayout,
    sky_sampler: wgpu::Sampler,
    noise: wgpu::TextureView,
    noise_sampler: wgpu::Sampler,
    shadow_sampler: wgpu::Sampler,
    pub light: wgpu::Buffer,
    pub views: wgpu::Buffer,
    /// The instances of all views, unless they come as vertex attributes.
    pub instances: wgpu::Buffer,
    lamps: wgpu::Buffer,
    lamp_tiles: wgpu::Buffer,
    kept_scene: KeptGroups,
    kept_views: KeptGroups,
}

impl Bindings {
    pub fn new(gpu: &Gpu) -> Self {
        let device = gpu.device();
        let scene_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("scene"),
            entries: &[
                uniform(0, size_of::<LightData>() as u64),
                storage(1),
                texture(2, wgpu::TextureSampleType::Float { filterable: true }),
                sampler(3, wgpu::SamplerBindingType::Filtering),
                texture(4, wgpu::TextureSampleType::Float { filterable: true }),
                sampler(5, wgpu::SamplerBindingType::Filtering),
                storage(6),
            ],
        });
        let layout_of_views = |view_dimension| {
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("view"),
                entries: &[
                    uniform_at_offset(0, VIEWS_BYTES),
                    texture_of(1, wgpu::TextureSampleType::Depth, view_dimension),
                    sampler(2, wgpu::SamplerBindingType::Comparison),
                    storage(3),
                    storage(4),
                    texture_of(5, wgpu::TextureSampleType::Depth, view_dimension),
                ],
            })
        };
        let [view_layout, views_layout] = [
            wgpu::TextureViewDimension::D2,
            wgpu::TextureViewDimension::D2Array,
        ]
        .map(layout_of_views);
        let linear = wgpu::SamplerDescriptor {
            label: Some("sky"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Nearest,
            ..Default::default()
        };
        let compare = wgpu::SamplerDescriptor {
            label: Some("shadow"),
            compare: Some(wgpu::CompareFunction::LessEqual),
            mipmap_filter: wgpu::MipmapFilterMode::Nearest,
            ..linear.clone()
        };
        let repeat = wgpu::SamplerDescriptor {
            label: Some("noise"),
            address_mode_u: wgpu::AddressMode::Repeat,
            address_mode_v: wgpu::AddressMode::Repeat,
            ..linear.clone()
        };
        Bindings {
            sky_sampler: device.create_sampler(&linear),
            noise: light::noise_texture(gpu),
            noise_sampler: device.create_sampler(&repeat),
            shadow_sampler: device.create_sampler(&compare),
            scene_layout,
            view_layout,
            views_layout,
            kept_scene: KeptGroups::up_to(1),
            kept_views: KeptGroups::up_to(1),
            light: gpu.buffer(
                "light",
                size_of::<LightData>() as u64,
                wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            ),
            views: gpu.buffer(
                "views",
                VIEWS_BYTES,
                wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            ),
            instances: gpu.buffer(
                "instances",
                INSTANCE_BYTES,
                wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            ),
            lamps: gpu.buffer(
                "lamps",
                LAMP_BYTES,
                wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            ),
            lamp_tiles: gpu.buffer(
                "lamp tiles",
                8,
                wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            ),
        }
    }

    /// The list of instances, enlarged to hold `n`.
    pub fn room_for_instances(&mut self, gpu: &Gpu, n: usize) -> &wgpu::Buffer {
        grow(gpu, &mut self.instances, INSTANCE_BYTES * n as u64);
        &self.instances
    }

    /// Uploads light, views and lamps, which change from tick to tick.
    pub fn upload(
        &mut self,
        gpu: &Gpu,
        (uploads, encoder): (&mut Uploads, &mut wgpu::CommandEncoder),
        light: &LightData,
        views: &[ViewData],
        lamps: &LampLists,
    ) {
        // The binding of the last view extends beyond its uniform.
        grow(
            gpu,
            &mut self.views,
            VIEW_BYTES * views.len() as u64 + VIEWS_BYTES,
        );
        grow(gpu, &mut self.lamps, LAMP_BYTES * lamps.lamps.len() as u64);
        grow(gpu, &mut self.lamp_tiles, 8 * lamps.tiles.len() as u64);
        let lists: [(&wgpu::Buffer, &[u8]); 4] = [
            (&self.light, bytemuck::bytes_of(light)),
            (&self.views, bytemuck::cast_slice(views)),
            (&self.lamps, bytemuck::cast_slice(&lamps.lamps)),
            (&self.lamp_tiles, bytemuck::cast_slice(&lamps.tiles)),
        ];
        for (to, bytes) in lists {
            uploads.write(encoder, to, 0, bytes);
        }
    }

    /// Bind group of what all views share.
    pub fn bind_scene(
        &self,
        gpu: &Gpu,
        sky: &wgpu::TextureView,
        switched: &wgpu::Buffer,
    ) -> wgpu::BindGroup {
        self.kept_scene.bind(
            gpu,
            "scene",
            &self.scene_layout,
            &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: self.light.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: self.instances.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 2,
                    resource: wgpu::BindingResource::TextureView(sky),
                },
                wgpu::BindGroupEntry {
                    binding: 3,
                    resource: wgpu::BindingResource::Sampler(&self.sky_sampler),
                },
                wgpu::BindGroupEntry {
                    binding: 4,
                    resource: wgpu::BindingResource::TextureView(&self.noise),
                },
                wgpu::BindGroupEntry {
                    binding: 5,
                    resource: wgpu::BindingResource::Sampler(&self.noise_sampler),
                },
                wgpu::BindGroupEntry {
                    binding: 6,
                    resource: switched.as_entire_binding(),
                },
            ],
        )
    }

    /// Forgets what groups of computed views bound, shadow maps above all, so that they can go.
    pub fn forget(&self) {
        self.kept_scene.clear();
        self.kept_views.clear();
    }

    /// Bind group of a view that is drawn and the lamps of all.
    pub fn bind_view(&self, gpu: &Gpu, shadows: [&wgpu::TextureView; 2]) -> wgpu::BindGroup {
        let entries = self.entries(shadows);
        gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("view"),
            layout: &self.view_layout,
            entries: &entries,
        })
    }

    /// Bind group of computed views, whose shadow maps are layers of one texture, and the lamps of
    /// all.
    pub fn bind_views(&self, gpu: &Gpu, shadows: [&wgpu::TextureView; 2]) -> wgpu::BindGroup {
        let entries = self.entries(shadows);
        self.kept_views
            .bind(gpu, "views", &self.views_layout, &entries)
    }

    fn entries<'e>(
        &'e self,
        [near, far]: [&'e wgpu::TextureView; 2],
    ) -> [wgpu::BindGroupEntry<'e>; 6] {
        let view = wgpu::BufferBinding {
            buffer: &self.views,
            offset: 0,
            size: std::num::NonZeroU64::new(VIEWS_BYTES),
        };
        [
            wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::Buffer(view),
            },
            wgpu::BindGroupEntry {
                binding: 1,
                resource: wgpu::BindingResource::TextureView(near),
            },
            wgpu::BindGroupEntry {
                binding: 2,
                resource: wgpu::BindingResource::Sampler(&self.shadow_sampler),
            },
            wgpu::BindGroupEntry {
                binding: 3,
                resource: self.lamps.as_entire_binding(),
            },
            wgpu::BindGroupEntry {
                binding: 4,
                resource: self.lamp_tiles.as_entire_binding(),
            },
            wgpu::BindGroupEntry {
                binding: 5,
                resource: wgpu::BindingResource::TextureView(far),
            },
        ]
    }

    /// Where a view's uniform begins.
    pub fn offset_of(view_idx: usize) -> u32 {
        (view_idx as u64 * VIEW_BYTES) as u32
    }
}
