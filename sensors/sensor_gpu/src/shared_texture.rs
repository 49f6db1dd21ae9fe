//! Textures that the drawing queue writes and the copy queue reads.

use std::sync::atomic::Ordering::Relaxed;

use ash::vk;
use wgpu::hal::api::Vulkan;
use wgpu::hal::vulkan::TextureMemory;
use wgpu::wgt;

use crate::device::Gpu;

/// A texture of several layers and one level.
#[derive(Clone, Debug)]
pub struct LayeredTexture {
    /// The texture.
    pub texture: wgpu::Texture,
    /// Whether the copy queue may read it while the next submission is drawn.
    pub is_shared: bool,
}

impl Gpu {
    /// Number of shared textures from [`Gpu::shared_texture_layers`] that have not been freed.
    pub fn n_shared_textures(&self) -> u32 {
        self.copy_queue()
            .map_or(0, |queue| queue.room.n.load(Relaxed))
    }

    /// A texture of several layers and one level, shared with the copy queue if there is one and
    /// the driver allows it; what a shared texture asks of its user is told at
    /// [`crate::CopyBatch::shared_layer`]. Its contents are undefined.
    pub fn shared_texture_layers(
        &self,
        label: &str,
        size_px: [u32; 2],
        n_layers: u32,
        format: wgpu::TextureFormat,
        usage: wgpu::TextureUsages,
    ) -> LayeredTexture {
        let size = wgpu::Extent3d {
            width: size_px[0],
            height: size_px[1],
            depth_or_array_layers: n_layers,
        };
        let descriptor = wgpu::TextureDescriptor {
            label: Some(label),
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage,
            view_formats: &[],
        };
        match self.make_shared(&descriptor) {
            Some(texture) => LayeredTexture {
                texture,
                is_shared: true,
            },
            None => LayeredTexture {
                texture: self.texture_layers(label, size_px, n_layers, format, usage),
                is_shared: false,
            },
        }
    }

    fn make_shared(&self, descriptor: &wgpu::TextureDescriptor<'_>) -> Option<wgpu::Texture> {
        let queue = self.copy_queue()?;
        let is_empty = [
            descriptor.size.width,
            descriptor.size.height,
            descriptor.size.depth_or_array_layers,
        ]
        .contains(&0);
        if is_empty {
            return None;
        }
        let room = queue.room.clone();
        let (usage, uses) = usage_of(descriptor.usage)?;
        // SAFETY: the hal adapter is only read, and lives as long as this guard.
        let format =
            unsafe { room.adapter.as_hal::<Vulkan>() }?.texture_format_as_raw(descriptor.format);
        // SAFETY: the guard only lends the device for the calls below.
        let hal = unsafe { self.device().as_hal::<Vulkan>() }?;
        if room.n.fetch_add(1, Relaxed) >= room.most {
            room.n.fetch_sub(1, Relaxed);
            return None;
        }
        let sharing = if queue.families().is_empty() {
            vk::SharingMode::EXCLUSIVE
        } else {
            vk::SharingMode::CONCURRENT
        };
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format)
            .extent(vk::Extent3D {
                width: descriptor.size.width,
                height: descriptor.size.height,
                depth: 1,
            })
            .mip_levels(1)
            .array_layers(descriptor.size.depth_or_array_layers)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(usage)
            .sharing_mode(sharing)
            .queue_family_indices(queue.families())
            .initial_layout(vk::ImageLayout::UNDEFINED);
        // SAFETY: a well-formed create info, of families that are the device's; unsupported usages
        // were refused above.
        let Ok((image, memory)) = (unsafe { create(&hal, &info) }) else {
            room.n.fetch_sub(1, Relaxed);
            return None;
        };
        let raw = hal.raw_device().clone();
        let give_back = move || {
            // SAFETY: wgpu calls this after its last use of both, which are ours, and keeps the
            // device until then.
            unsafe {
                raw.destroy_image(image, None);
                raw.free_memory(memory, None);
            }
            room.n.fetch_sub(1, Relaxed);
        };
        let hal_descriptor = wgpu::hal::TextureDescriptor {
            label: descriptor.label,
            size: descriptor.size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: descriptor.dimension,
            format: descriptor.format,
            usage: uses,
            memory_flags: wgpu::hal::MemoryFlags::empty(),
            view_formats: Vec::new(),
        };
        // SAFETY: image and memory were made from this device as the descriptor says, and live
        // until wgpu calls back.
        let texture = unsafe {
            hal.texture_from_raw(
                image,
                &hal_descriptor,
                Some(Box::new(give_back)),
                TextureMemory::External,
            )
        };
        drop(hal);
        // SAFETY: made from this device as the descriptor says. Its contents are undefined, and
        // nobody reads it before it was drawn.
        Some(unsafe {
            self.device().create_texture_from_hal::<Vulkan>(
                texture,
                descriptor,
                wgt::TextureUses::UNINITIALIZED,
            )
        })
    }
}

/// The usage in Vulkan's flags and in wgpu-hal's; `None` for usages that render targets do not
/// have.
fn usage_of(usage: wgpu::TextureUsages) -> Option<(vk::ImageUsageFlags, wgt::TextureUses)> {
    let words = [
        (
            wgpu::TextureUsages::COPY_SRC,
            vk::ImageUsageFlags::TRANSFER_SRC,
            wgt::TextureUses::COPY_SRC,
        ),
        (
            wgpu::TextureUsages::TEXTURE_BINDING,
            vk::ImageUsageFlags::SAMPLED,
            wgt::TextureUses::RESOURCE,
        ),
        (
            wgpu::TextureUsages::STORAGE_BINDING,
            vk::ImageUsageFlags::STORAGE,
            wgt::TextureUses::STORAGE_WRITE_ONLY,
        ),
        (
            wgpu::TextureUsages::RENDER_ATTACHMENT,
            vk::ImageUsageFlags::COLOR_ATTACHMENT,
            wgt::TextureUses::COLOR_TARGET,
        ),
    ];
    let known = words
        .iter()
        .fold(wgpu::TextureUsages::empty(), |known, word| known | word.0);
    let mut both = (vk::ImageUsageFlags::empty(), wgt::TextureUses::empty());
    for (wgpu, vulkan, hal) in words {
        if usage.contains(wgpu) {
            both = (both.0 | vulkan, both.1 | hal);
        }
    }
    known.contains(usage).then_some(both)
}

/// An image with memory of its own on the device.
///
/// # Safety
/// The create info is well formed, and its sides and layers are not 0.
unsafe fn create(
    hal: &wgpu::hal::vulkan::Device,
    info: &vk::ImageCreateInfo<'_>,
) -> Result<(vk::Image, vk::DeviceMemory), vk::Result> {
    let raw = hal.raw_device();
    let instance = hal.shared_instance().raw_instance();
    // SAFETY: instance and physical device belong together and live.
    let limits = unsafe {
        let physical = hal.raw_physical_device();
        instance.get_physical_device_image_format_properties(
            physical,
            info.format,
            info.image_type,
            info.tiling,
            info.usage,
            info.flags,
        )
    }?;
    let (asked, most) = (info.extent, limits.max_extent);
    if asked.width > most.width
        || asked.height > most.height
        || info.array_layers > limits.max_array_layers
    {
        return Err(vk::Result::ERROR_FORMAT_NOT_SUPPORTED);
    }
    // SAFETY: the create info is well formed (caller) and within the limits checked above; on
    // failure the image is destroyed below.
    let image = unsafe { raw.create_image(info, None) }?;
    // SAFETY: the image was just made from this device.
    let needs = unsafe { raw.get_image_memory_requirements(image) };
    // SAFETY: instance and physical device belong together.
    let known =
        unsafe { instance.get_physical_device_memory_properties(hal.raw_physical_device()) };
    let is_local = |i: &u32| {
        let flags = known.memory_types[*i as usize].property_flags;
        needs.memory_type_bits & (1 << i) != 0
            && flags.contains(vk::MemoryPropertyFlags::DEVICE_LOCAL)
    };
    let allocated = (0..known.memory_type_count)
        .find(is_local)
        .ok_or(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY)
        .and_then(|memory_type| {
            let mut dedicated = vk::MemoryDedicatedAllocateInfo::default().image(image);
            let info = vk::MemoryAllocateInfo::default()
                .allocation_size(needs.size)
                .memory_type_index(memory_type)
                .push_next(&mut dedicated);
            // SAFETY: size and type are what the image asks for, and the memory is for it alone.
            unsafe { raw.allocate_memory(&info, None) }
        });
    let bound = allocated.and_then(|memory| {
        // SAFETY: fresh image, fresh memory of the size it asks for, offset 0; freed if binding
        // fails.
        unsafe { raw.bind_image_memory(image, memory, 0) }
            .map(|()| memory)
            .inspect_err(|_| unsafe { raw.free_memory(memory, None) })
    });
    // SAFETY: the image is ours and was never used.
    bound
        .map(|memory| (image, memory))
        .inspect_err(|_| unsafe { raw.destroy_image(image, None) })
}
