//! Which queue copies finished frames, and the family it belongs to.

use ash::vk;

use super::timeline::has_timelines;

/// Where finished frames are copied to their readers' memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CopyPath {
    /// Concurrently with the drawing of the next submission, by a queue that only copies. On
    /// adapters without such a queue this is `Behind`.
    #[default]
    Beside,
    /// After the drawing of the same submission, by the queue that drew it.
    Behind,
    /// As `Beside`, but on the queue that draws. It saves no time: it is for tests, which can check
    /// lifetimes and bookkeeping with it on every adapter, though not the order of two queues.
    Apart,
}

/// A queue family that may be asked for when the device is opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Family {
    pub index: u32,
    /// Bits of its timestamps; 0 if it has none.
    pub timestamp_bits: u32,
    /// Number of the queue in its family; those before it are opened too and stay unused.
    pub queue: u32,
}

/// Upper limit of the queues of a family that are opened.
pub(crate) const MAX_QUEUES: usize = 8;

/// The family whose queues do nothing but copy, if the adapter has one and supports timelines.
pub(crate) fn family_for(hal: &wgpu::hal::vulkan::Adapter, path: CopyPath) -> Option<Family> {
    if path == CopyPath::Behind || !has_timelines(hal) {
        return None;
    }
    // SAFETY: instance and physical device belong together and live.
    let families = unsafe {
        hal.shared_instance()
            .raw_instance()
            .get_physical_device_queue_family_properties(hal.raw_physical_device())
    };
    let family = |(index, family): (u32, &vk::QueueFamilyProperties)| {
        // The last queue of the family: on an H200 the first of two was slower by a tenth.
        let queue = if path == CopyPath::Apart {
            0
        } else {
            family.queue_count.clamp(1, MAX_QUEUES as u32) - 1
        };
        (
            family.queue_flags,
            Family {
                index,
                timestamp_bits: family.timestamp_valid_bits,
                queue,
            },
        )
    };
    let works = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
    let video = vk::QueueFlags::VIDEO_DECODE_KHR | vk::QueueFlags::VIDEO_ENCODE_KHR;
    let others = works | video | vk::QueueFlags::OPTICAL_FLOW_NV;
    let copies = |(flags, family): &(vk::QueueFlags, Family)| match path {
        // wgpu draws on the first family.
        CopyPath::Apart => family.index == 0,
        _ => flags.contains(vk::QueueFlags::TRANSFER) && !flags.intersects(others),
    };
    (0..)
        .zip(&families)
        .map(family)
        .find(copies)
        .map(|(_, family)| family)
}
