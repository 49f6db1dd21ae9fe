//! Turns the items of a batch into raw copies.

use ash::vk;
use wgpu::hal::api::Vulkan;

use super::item::{Item, Source};
use crate::queue::{RawCopies, RawCopy};

/// Copies of items whose targets are imported. Their handles are valid as long as the items live.
/// What the device had no memory for has none, and is left out: its submission is refused anyway.
pub(super) fn raw_copies_of(items: &[&Item<'_>]) -> RawCopies {
    let mut groups: Vec<Vec<&Item<'_>>> = Vec::new();
    for item in items {
        match groups.iter_mut().find(|group| is_alike(group[0], item)) {
            Some(group) => group.push(item),
            None => groups.push(vec![item]),
        }
    }
    RawCopies(groups.iter().filter_map(|alike| copy_of(alike)).collect())
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
                regions: alike.iter().filter_map(|item| image_region(item)).collect(),
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
