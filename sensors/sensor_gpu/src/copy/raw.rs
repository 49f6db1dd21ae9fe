//! Turns the items of a batch into raw copies.

use ash::vk;
use wgpu::hal::api::Vulkan;

use super::item::{Item, Source};
use super::place::ShmPlace;
use crate::device::Gpu;
use crate::queue::{RawCopies, RawCopy, Release};

/// Copies of items whose targets are imported. Their handles are valid as long as the items live.
/// What the device had no memory for has none, and is left out: its submission is refused anyway.
pub(super) fn raw_copies_of(gpu: &Gpu, items: &[&Item<'_>]) -> RawCopies {
    let mut groups: Vec<Vec<&Item<'_>>> = Vec::new();
    for item in items {
        match groups.iter_mut().find(|group| is_alike(group[0], item)) {
            Some(group) => group.push(item),
            None => groups.push(vec![item]),
        }
    }
    let exported = items.iter().filter_map(|item| {
        let place = item.exported()?;
        release(gpu, place, item.source.n_bytes())
    });
    RawCopies {
        copies: groups.iter().filter_map(|alike| copy_of(alike)).collect(),
        released: exported.collect(),
    }
}

/// The first `n_bytes` of a place in exported memory, to be handed over to other processes.
pub(super) fn release(gpu: &Gpu, place: &ShmPlace, n_bytes: usize) -> Option<Release> {
    // SAFETY: the guard only lends the device to ask for its family.
    let drawing = unsafe { gpu.device().as_hal::<Vulkan>() }?.queue_family_index();
    let is_shared = gpu
        .copy_queue()
        .is_some_and(|queue| !queue.families().is_empty());
    // SAFETY: the handle is used while its wgpu object lives: the place owns the target.
    let buffer = unsafe { place.target().imported()?.as_hal::<Vulkan>()?.raw_handle() };
    Some(Release {
        buffer,
        offset_bytes: place.offset_bytes() as u64,
        n_bytes: n_bytes.max(4) as u64,
        family: if is_shared {
            vk::QUEUE_FAMILY_IGNORED
        } else {
            drawing
        },
    })
}

impl Gpu {
    /// An encoder that holds these copies and nothing else.
    pub(super) fn gpu_release(&self, copies: &RawCopies) -> wgpu::CommandEncoder {
        let mut encoder = self.encoder("to other processes");
        // SAFETY: the guard only lends the device for recording.
        let Some(device) =
            (unsafe { self.device().as_hal::<Vulkan>() }).map(|device| device.raw_device().clone())
        else {
            return encoder;
        };
        // SAFETY: a release touches no bytes; nothing ordinary is recorded with this encoder.
        unsafe {
            encoder.as_hal_mut::<Vulkan, _, _>(|hal| {
                // A lost device has no encoder.
                if let Some(hal) = hal {
                    copies.record(&device, hal.raw_handle());
                }
            })
        };
        encoder
    }
}

fn copy_of(alike: &[&Item<'_>]) -> Option<RawCopy> {
    let raw = |buffer: &wgpu::Buffer| {
        // SAFETY: the handle is used while its wgpu object lives: the items own it until the
        // submission is done.
        unsafe { Some(buffer.as_hal::<Vulkan>()?.raw_handle()) }
    };
    let to = raw(alike[0]
        .imported()
        .expect("only items with an imported target are copied this way"))?;
    Some(match &alike[0].source {
        Source::Texture { texture, .. } => {
            // SAFETY: as for buffers.
            let from = unsafe { texture.as_hal::<Vulkan>()?.raw_handle() };
            RawCopy::Texture {
                from,
                to,
                regions: joined(
                    alike.iter().filter_map(|item| image_region(item)),
                    alike[0].source.n_bytes() as u64,
                ),
            }
        }
        Source::Buffer { buffer, .. } => RawCopy::Buffer {
            from: raw(buffer)?,
            to,
            regions: alike
                .iter()
                .filter_map(|item| buffer_region(item))
                .collect(),
        },
    })
}

/// Whether two copies read one texture or buffer and write one segment.
fn is_alike(a: &Item<'_>, b: &Item<'_>) -> bool {
    let same_source = match (&a.source, &b.source) {
        (Source::Texture { texture: a, .. }, Source::Texture { texture: b, .. }) => a == b,
        (Source::Buffer { buffer: a, .. }, Source::Buffer { buffer: b, .. }) => a == b,
        _ => false,
    };
    same_source && a.imported() == b.imported()
}

/// The same regions of one texture, whose layers have `layer_bytes` each, with neighbouring layers
/// that go to neighbouring places as one: a batch of cameras is one copy.
fn joined(
    regions: impl Iterator<Item = vk::BufferImageCopy>,
    layer_bytes: u64,
) -> Vec<vk::BufferImageCopy> {
    let mut joined: Vec<vk::BufferImageCopy> = Vec::new();
    for region in regions {
        if let Some(last) = joined.last_mut() {
            let layers = &mut last.image_subresource;
            let n = layers.layer_count;
            let is_next = region.image_subresource.base_array_layer == layers.base_array_layer + n
                && region.buffer_offset == last.buffer_offset + u64::from(n) * layer_bytes;
            if is_next {
                layers.layer_count += region.image_subresource.layer_count;
                continue;
            }
        }
        joined.push(region);
    }
    joined
}

fn image_region(item: &Item<'_>) -> Option<vk::BufferImageCopy> {
    let Source::Texture { texture, layer, .. } = &item.source else {
        return None;
    };
    let layers = vk::ImageSubresourceLayers {
        aspect_mask: vk::ImageAspectFlags::COLOR,
        mip_level: 0,
        base_array_layer: *layer,
        layer_count: 1,
    };
    let extent = vk::Extent3D {
        width: texture.width(),
        height: texture.height(),
        depth: 1,
    };
    Some(
        vk::BufferImageCopy::default()
            .buffer_offset(item.target_offset()?)
            .image_subresource(layers)
            .image_extent(extent),
    )
}

fn buffer_region(item: &Item<'_>) -> Option<vk::BufferCopy> {
    let Source::Buffer {
        offset_bytes,
        n_bytes,
        ..
    } = &item.source
    else {
        return None;
    };
    Some(vk::BufferCopy {
        src_offset: *offset_bytes,
        dst_offset: item.target_offset()?,
        size: *n_bytes as u64,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_that_go_to_neighbouring_places_are_one_region() {
        const LAYER_BYTES: u64 = 100;
        let region = |layer, place| {
            let layers = vk::ImageSubresourceLayers {
                aspect_mask: vk::ImageAspectFlags::COLOR,
                mip_level: 0,
                base_array_layer: layer,
                layer_count: 1,
            };
            vk::BufferImageCopy::default()
                .buffer_offset(place)
                .image_subresource(layers)
        };
        let regions = [
            region(0, 400),
            region(1, 500),
            region(2, 600),
            // A gap, then the place before, then a layer that is not the next.
            region(3, 704),
            region(4, 604),
            region(6, 704),
            region(7, 804),
        ];
        let found: Vec<_> = joined(regions.into_iter(), LAYER_BYTES)
            .iter()
            .map(|region| {
                let layers = region.image_subresource;
                (
                    layers.base_array_layer,
                    layers.layer_count,
                    region.buffer_offset,
                )
            })
            .collect();
        assert_eq!(found, [(0, 3, 400), (3, 1, 704), (4, 1, 604), (6, 2, 704)]);
    }
}
