//! Timeline semaphores: one queue signals rising numbers, and another queue or the CPU waits for
//! them.

use std::time::Duration;

use ash::vk;
use wgpu::hal::api::Vulkan;

/// Longest time that a submission may take. A software adapter may need seconds for large images;
/// a device that takes longer than this hangs.
pub const MAX_GPU_WAIT: Duration = Duration::from_secs(60);
/// Piece of such a wait. Pieces are counted instead of the time, which goes on while the process is
/// stopped, by a debugger or Ctrl-Z.
pub(crate) const WAIT_SLICE: Duration = Duration::from_millis(500);
/// Pieces of the longest wait.
pub(crate) const N_WAIT_SLICES: u64 = MAX_GPU_WAIT.as_secs() * 1000 / 500;
const _: () = assert!(N_WAIT_SLICES as u128 * WAIT_SLICE.as_millis() == MAX_GPU_WAIT.as_millis());
/// How long a waiting thread spins before it sleeps: short work on a dedicated GPU is done before a
/// sleeping thread would wake up.
pub(crate) const AWAKE: Duration = Duration::from_micros(500);

/// Waits until a timeline has reached a value, at most [`MAX_GPU_WAIT`].
///
/// # Errors
/// The driver's; [`vk::Result::TIMEOUT`] if it takes longer.
///
/// # Safety
/// The semaphore is a timeline of this device, and lives until the call returns.
pub(crate) unsafe fn wait_for(device: &ash::Device, moment: Moment) -> Result<(), vk::Result> {
    for _ in 0..N_WAIT_SLICES {
        // SAFETY: the caller promises what the call asks.
        match unsafe { wait_within(device, moment, WAIT_SLICE) } {
            Err(vk::Result::TIMEOUT) => {}
            done => return done,
        }
    }
    Err(vk::Result::TIMEOUT)
}

/// Waits until a timeline has reached a value, at most for `most`.
///
/// # Errors
/// As [`wait_for`].
///
/// # Safety
/// As [`wait_for`].
pub(crate) unsafe fn wait_within(
    device: &ash::Device,
    moment: Moment,
    most: Duration,
) -> Result<(), vk::Result> {
    let (semaphores, values) = ([moment.semaphore], [moment.value]);
    let info = vk::SemaphoreWaitInfo::default()
        .semaphores(&semaphores)
        .values(&values);
    // SAFETY: the caller promises what the call asks.
    unsafe { device.wait_semaphores(&info, most.as_nanos() as u64) }
}

/// A value of a timeline semaphore.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moment {
    pub semaphore: vk::Semaphore,
    pub value: u64,
}

/// A timeline that submissions count up when they are done.
#[derive(Debug)]
pub(crate) struct Timeline {
    semaphore: vk::Semaphore,
    /// Value that the newest submission signals.
    newest: u64,
}

impl Timeline {
    /// A timeline, if the device has them.
    pub fn new(device: &wgpu::Device, adapter: &wgpu::Adapter) -> Option<Timeline> {
        // SAFETY: the hal adapter is only read, and lives as long as this guard.
        if !has_timelines(&*unsafe { adapter.as_hal::<Vulkan>() }?) {
            return None;
        }
        // SAFETY: the guard only lends the device for the call below.
        let hal = unsafe { device.as_hal::<Vulkan>() }?;
        // SAFETY: wgpu enables the feature wherever the adapter has it (checked above).
        let semaphore = unsafe { timeline_semaphore(hal.raw_device()) }.ok()?;
        Some(Timeline {
            semaphore,
            newest: 0,
        })
    }

    /// The next moment; every call gives another one.
    pub fn next(&mut self) -> Moment {
        self.newest += 1;
        Moment {
            semaphore: self.semaphore,
            value: self.newest,
        }
    }

    /// Destroys the semaphore.
    ///
    /// # Safety
    /// It is of this device, and no submission that signals it is in flight.
    pub unsafe fn destroy(self, device: &wgpu::Device) {
        // SAFETY: the guard only lends the device for the call below.
        if let Some(hal) = unsafe { device.as_hal::<Vulkan>() } {
            // SAFETY: the caller promises what the call asks.
            unsafe { hal.raw_device().destroy_semaphore(self.semaphore, None) };
        }
    }
}

/// A timeline at 0.
///
/// # Safety
/// The device was opened with timelines.
pub(crate) unsafe fn timeline_semaphore(device: &ash::Device) -> Result<vk::Semaphore, vk::Result> {
    let mut kind = vk::SemaphoreTypeCreateInfo::default()
        .semaphore_type(vk::SemaphoreType::TIMELINE)
        .initial_value(0);
    let info = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
    // SAFETY: a well-formed create info, of a feature that is enabled (caller).
    unsafe { device.create_semaphore(&info, None) }
}

/// Whether an adapter has timeline semaphores in its core (Vulkan 1.2).
pub(crate) fn has_timelines(hal: &wgpu::hal::vulkan::Adapter) -> bool {
    let (instance, physical) = (
        hal.shared_instance().raw_instance(),
        hal.raw_physical_device(),
    );
    // SAFETY: instance and physical device belong together and live.
    if unsafe { instance.get_physical_device_properties(physical) }.api_version
        < vk::API_VERSION_1_2
    {
        return false;
    }
    let mut timelines = vk::PhysicalDeviceTimelineSemaphoreFeatures::default();
    let mut features = vk::PhysicalDeviceFeatures2::default().push_next(&mut timelines);
    // SAFETY: as above; the chained struct is part of Vulkan 1.2, which the device has.
    unsafe { instance.get_physical_device_features2(physical, &mut features) };
    timelines.timeline_semaphore == vk::TRUE
}
