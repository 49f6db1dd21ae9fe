//! Submissions whose shaders write into their readers' memory themselves: no copies, no mapping,
//! and a semaphore of our own to wait for,
//! so that nobody looks after wgpu's books before the bytes are handed on.

use std::sync::{Arc, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use ash::vk;
use wgpu::hal::api::Vulkan;
use wgpu::wgt;

use crate::device::{Gpu, GpuError};
use crate::target::ShmTarget;
use crate::timing::Pending;

/// How long a thread that waits awake stays so: short work on a GPU of its own is over before a
/// thread wakes up.
pub(crate) const AWAKE: Duration = Duration::from_micros(500);

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

    /// Gives the semaphore back.
    ///
    /// # Safety
    /// It is of this device, and no submission that signals it is on its way.
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

/// The drawing queue in the hands of who submits: what a submission waits for and signals must not
/// come to be another's.
pub(crate) struct Drawing<'g>(MutexGuard<'g, Option<Timeline>>);

impl Drawing<'_> {
    /// Submits; `wait` and `signal` are timelines with their values.
    pub fn submit(
        &mut self,
        gpu: &Gpu,
        commands: impl IntoIterator<Item = wgpu::CommandBuffer>,
        wait: Option<(vk::Semaphore, u64)>,
        signal: Option<(vk::Semaphore, u64)>,
    ) -> wgpu::SubmissionIndex {
        if wait.is_some() || signal.is_some() {
            // SAFETY: the guard only lends the queue; the semaphores live as long as the device,
            // and their values only rise.
            let queue =
                unsafe { gpu.queue().as_hal::<Vulkan>() }.expect("the device was opened as Vulkan");
            if let Some((semaphore, value)) = wait {
                queue.add_wait_semaphore(
                    semaphore,
                    Some(value),
                    vk::PipelineStageFlags::ALL_COMMANDS,
                );
            }
            if let Some((semaphore, value)) = signal {
                queue.add_signal_semaphore(semaphore, Some(value));
            }
        }
        gpu.queue().submit(commands)
    }
}

/// A submission on its way that writes to targets by itself. Dropping it waits too.
#[derive(Debug)]
#[must_use = "the bytes are there only after wait_awake()"]
pub struct Direct {
    gpu: Gpu,
    semaphore: vk::Semaphore,
    value: u64,
    submission: wgpu::SubmissionIndex,
    pending: Option<Pending>,
    /// Kept until the GPU has let go of them.
    _targets: Vec<Arc<ShmTarget>>,
    is_done: bool,
}

impl Gpu {
    /// Whether shaders can write into imported memory and be waited for: see
    /// [`ShmTarget::storage`].
    pub fn can_write_directly(&self) -> bool {
        self.can_import() && self.drawing().0.is_some()
    }

    /// Gives commands to the GPU; all submissions go through here, because one may have to be told
    /// from the others.
    pub fn submit(
        &self,
        commands: impl IntoIterator<Item = wgpu::CommandBuffer>,
    ) -> wgpu::SubmissionIndex {
        self.drawing().submit(self, commands, None, None)
    }

    /// The drawing queue, for one at a time.
    pub(crate) fn drawing(&self) -> Drawing<'_> {
        Drawing(
            self.timeline()
                .lock()
                .unwrap_or_else(PoisonError::into_inner),
        )
    }

    /// Submits `encoder`, whose shaders write to `targets`, and makes what they wrote visible to
    /// the host.
    ///
    /// Panics unless [`Gpu::can_write_directly`].
    pub fn submit_direct(
        &self,
        mut encoder: wgpu::CommandEncoder,
        targets: Vec<Arc<ShmTarget>>,
    ) -> Direct {
        let mut buffers: Vec<&wgpu::Buffer> = Vec::with_capacity(targets.len());
        for buffer in targets.iter().filter_map(|target| target.imported()) {
            if !buffers.contains(&buffer) {
                buffers.push(buffer);
            }
        }
        let visible = buffers.iter().map(|buffer| wgt::BufferTransition {
            buffer: *buffer,
            state: wgt::BufferUses::MAP_READ,
        });
        encoder.transition_resources(
            visible,
            std::iter::empty::<wgt::TextureTransition<&wgpu::Texture>>(),
        );
        self.mark(&mut encoder, "visible");
        let pending = self.close_marks(&mut encoder);
        let commands = encoder.finish();
        let mut drawing = self.drawing();
        let timeline = drawing
            .0
            .as_mut()
            .expect("the caller asked whether the GPU can");
        timeline.newest += 1;
        let (semaphore, value) = (timeline.semaphore, timeline.newest);
        let submission = self.time("submit", || {
            drawing.submit(self, [commands], None, Some((semaphore, value)))
        });
        drop(drawing);
        self.counters().add_submission(0);
        if let Some(pending) = &pending {
            pending.map();
        }
        Direct {
            gpu: self.clone(),
            semaphore,
            value,
            submission,
            pending,
            _targets: targets,
            is_done: false,
        }
    }
}

impl Direct {
    /// Waits until the bytes are there, awake for the first half millisecond.
    ///
    /// # Errors
    /// The device was lost.
    pub fn wait_awake(mut self) -> Result<(), GpuError> {
        self.wait_for_semaphore()?;
        if let Some(pending) = self.pending.take() {
            let wait = wgpu::PollType::Wait {
                submission_index: Some(self.submission.clone()),
                timeout: None,
            };
            self.gpu
                .device()
                .poll(wait)
                .map_err(|error| self.gpu.lost(error))?;
            self.gpu.read_marks(&pending);
        }
        Ok(())
    }

    fn wait_for_semaphore(&mut self) -> Result<(), GpuError> {
        self.is_done = true;
        // SAFETY: the guard only lends the device for the calls below.
        let hal = unsafe { self.gpu.device().as_hal::<Vulkan>() }
            .expect("the device was opened as Vulkan");
        let raw = hal.raw_device();
        let lost = |error: vk::Result| self.gpu.lost(error);
        let begin = Instant::now();
        while !self.gpu.is_software() && begin.elapsed() < AWAKE {
            // SAFETY: the semaphore is of this device and lives as long as it.
            if unsafe { raw.get_semaphore_counter_value(self.semaphore) }.map_err(lost)?
                >= self.value
            {
                return Ok(());
            }
            std::hint::spin_loop();
        }
        let (semaphores, values) = ([self.semaphore], [self.value]);
        let info = vk::SemaphoreWaitInfo::default()
            .semaphores(&semaphores)
            .values(&values);
        // SAFETY: as above.
        unsafe { raw.wait_semaphores(&info, u64::MAX) }.map_err(lost)
    }
}

impl Drop for Direct {
    fn drop(&mut self) {
        if !self.is_done
            && let Err(error) = self.wait_for_semaphore()
        {
            tracing::error!(%error, "a submission was given up");
        }
    }
}
