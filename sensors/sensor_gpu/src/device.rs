//! Opening a Vulkan device: which adapter, which extensions, which limits.

mod adapter;
mod health;
mod open;
mod staging;

use std::sync::Arc;
use std::time::Duration;

use ash::vk;

pub use adapter::{AdapterInfo, DeviceIds};
use adapter::{choose, enumerate, ids_of};
use health::{Fault, Health};
pub(crate) use open::{FD, ImportCaps, exported_usage};
use staging::StagingPool;

use crate::counters::Counters;
use crate::error::GpuError;
use crate::queue::{CopyPath, CopyQueue, DrawingQueue, MAX_GPU_WAIT};
use crate::timing::{Span, Timing};

/// What to open.
#[derive(Clone, Debug)]
pub struct GpuOptions {
    /// The adapter's number in [`Gpu::adapters`], the beginning of its UUID, or a part of its name,
    /// any case; `None` takes a hardware GPU if there is one, else a software adapter.
    pub adapter: Option<String>,
    /// Import shared memory where the driver can; `false` forces the staged path.
    pub allow_import: bool,
    /// Where frames are copied to imported memory.
    pub copies: CopyPath,
}

impl Default for GpuOptions {
    fn default() -> Self {
        GpuOptions {
            adapter: None,
            allow_import: true,
            copies: CopyPath::default(),
        }
    }
}

/// An open device with its queues. Cheap to clone; all clones are the same device.
#[derive(Clone, Debug)]
pub struct Gpu(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    name: String,
    software: bool,
    device: wgpu::Device,
    drawing: DrawingQueue,
    import: Option<ImportCaps>,
    can_export: bool,
    ids: DeviceIds,
    counters: Counters,
    timing: Timing,
    staging: StagingPool,
    health: Health,
    /// Present if copies have a queue of their own.
    copy_queue: Option<CopyQueue>,
}

impl Drop for Inner {
    fn drop(&mut self) {
        self.health.close();
        // If waiting fails, semaphores may still be in use, and are left to the driver.
        if self.health.wait(&self.device, None).is_err() {
            return;
        }
        // wgpu's own fence may be signalled before the timelines of the same submission are, and a
        // driver that still signals a destroyed one hangs or crashes. Idle queues signal nothing.
        // SAFETY: the guard only lends the device for the call below.
        if let Some(hal) = unsafe { self.device.as_hal::<wgpu::hal::api::Vulkan>() } {
            // SAFETY: the last handle that could submit is being dropped, so no queue of the device
            // is used while it waits.
            if unsafe { hal.raw_device().device_wait_idle() }.is_err() {
                return;
            }
        }
        if let Some(queue) = self.copy_queue.take() {
            // SAFETY: the drawing queue has finished everything, and the last handle that could
            // submit more is being dropped.
            unsafe { queue.close() };
        }
        if let Some(timeline) = self.drawing.take_timeline() {
            // SAFETY: made from this device, whose drawing queue has finished everything.
            unsafe { timeline.destroy(&self.device) };
        }
    }
}

impl Gpu {
    /// Every Vulkan adapter of the machine.
    pub fn adapters() -> Vec<AdapterInfo> {
        let adapters = enumerate();
        let numbered = adapters.iter().enumerate();
        numbered
            .map(|(index, adapter)| AdapterInfo::of(index, adapter))
            .collect()
    }

    /// Waits until the device has finished everything that was submitted and freed what was
    /// dropped.
    pub fn wait_idle(&self) {
        if self.fault().is_none()
            && let Err(error) = self.copy_queue().map_or(Ok(()), CopyQueue::wait_idle)
        {
            tracing::warn!(%error, "the GPU's copies did not end");
        }
        if let Err(error) = self.wait_for(None) {
            tracing::debug!(%error, "the GPU did not become idle");
        }
    }

    /// Waits for a submission, or for all of them.
    ///
    /// # Errors
    /// [`GpuError::Lost`], [`GpuError::Hung`] after [`MAX_GPU_WAIT`].
    pub(crate) fn wait_for(
        &self,
        submission: Option<&wgpu::SubmissionIndex>,
    ) -> Result<(), GpuError> {
        let waited = self.0.health.wait(&self.0.device, submission);
        waited.map_err(|fault| self.error_of(fault))
    }

    /// Whether a submission is done, after waiting for `most` at most. One that a lost device will
    /// never do counts as done.
    pub(crate) fn is_done_within(
        &self,
        submission: Option<&wgpu::SubmissionIndex>,
        most: Duration,
    ) -> bool {
        let wait = wgpu::PollType::Wait {
            submission_index: submission.cloned(),
            timeout: Some(most),
        };
        let polled = self.0.health.poll(&self.0.device, wait);
        !matches!(polled, Err(wgpu::PollError::Timeout))
    }

    /// Whether the device can still be used.
    ///
    /// # Errors
    /// [`GpuError::Lost`], [`GpuError::Hung`].
    pub fn check(&self) -> Result<(), GpuError> {
        match self.0.health.fault() {
            None => Ok(()),
            Some(fault) => Err(self.error_of(fault)),
        }
    }

    /// Whether the drawing queue took a submission: a device that is lost, and one that found no
    /// memory for what the commands use, does not.
    pub(crate) fn has_taken(&self, submission: &wgpu::SubmissionIndex) -> bool {
        let now = wgpu::PollType::Wait {
            submission_index: Some(submission.clone()),
            timeout: Some(std::time::Duration::ZERO),
        };
        let polled = self.0.health.poll(&self.0.device, now);
        !matches!(polled, Err(wgpu::PollError::WrongSubmissionIndex(..)))
    }

    /// Waits until the device does nothing any more, although single submissions cannot be waited
    /// for because some were not taken; not at all if it hangs.
    pub(crate) fn settle(&self) {
        if self.is_hung() {
            return;
        }
        // Nobody submits meanwhile; in this order, as everywhere.
        let _turn = self.copy_queue().map(CopyQueue::turn);
        let _drawing = self.drawing().lock();
        // SAFETY: the guard only lends the device for the call below.
        if let Some(hal) = unsafe { self.0.device.as_hal::<wgpu::hal::api::Vulkan>() } {
            // SAFETY: both queues are locked. A device that is lost says so at once.
            let _ = unsafe { hal.raw_device().device_wait_idle() };
        }
    }

    /// Whether the device may still write to memory that it was given, although nothing that was
    /// submitted can be waited for any more.
    pub(crate) fn is_hung(&self) -> bool {
        self.fault() == Some(Fault::Hung)
    }

    /// Ends the device as a driver's failure would, for tests of what follows.
    pub fn lose(&self) {
        self.0.device.destroy();
        // wgpu reports the end when it is next polled.
        let _ = self.0.health.poll(&self.0.device, wgpu::PollType::Poll);
        let words = "it was ended by --lose-gpu-when".to_owned();
        self.0.health.note(Fault::Lost(words));
    }

    /// Makes resources. If the device has no memory for them, or refuses them, what `make` returned
    /// is dropped; the device goes on, which without this it would not.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`] with `what` was to be made, [`GpuError::Lost`].
    pub fn try_to<T>(&self, what: &str, make: impl FnOnce() -> T) -> Result<T, GpuError> {
        let device = &self.0.device;
        let scopes = [
            wgpu::ErrorFilter::Internal,
            wgpu::ErrorFilter::Validation,
            wgpu::ErrorFilter::OutOfMemory,
        ]
        .map(|filter| device.push_error_scope(filter));
        let made = make();
        let [internal, validation, memory] = scopes;
        // The last that was opened is the first to be closed.
        let [memory, validation, internal] = [
            pollster::block_on(memory.pop()),
            pollster::block_on(validation.pop()),
            pollster::block_on(internal.pop()),
        ];
        self.check()?;
        // What lacks memory is invalid, so other errors follow from it.
        if memory.is_some() {
            return Err(GpuError::OutOfMemory {
                name: self.0.name.clone(),
                what: what.to_owned(),
            });
        }
        match validation.or(internal) {
            None => Ok(made),
            Some(error) => Err(self.lost(error)),
        }
    }

    fn fault(&self) -> Option<Fault> {
        self.0.health.fault()
    }

    fn error_of(&self, fault: Fault) -> GpuError {
        match fault {
            Fault::Lost(reason) => self.lost(reason),
            Fault::Hung => GpuError::Hung {
                name: self.0.name.clone(),
                limit_secs: MAX_GPU_WAIT.as_secs(),
            },
        }
    }

    /// Opens an adapter.
    ///
    /// # Errors
    /// No adapter, none that is called so (the message lists all), or the driver refuses.
    pub fn open(options: &GpuOptions) -> Result<Gpu, GpuError> {
        let adapter = choose(enumerate(), options.adapter.as_deref())?;
        let info = adapter.get_info();
        // Without imports only the CPU copies to readers.
        let copies = if options.allow_import {
            options.copies
        } else {
            CopyPath::Behind
        };
        let open::Opened {
            device,
            queue,
            caps,
            copying,
            can_export,
        } = open::open_device(&adapter, copies)?;
        let import = if options.allow_import { caps } else { None };
        let software = info.device_type == wgpu::DeviceType::Cpu;
        let copy_queue = match copying
            .map(|family| CopyQueue::new(&device, &adapter, family))
            .transpose()
        {
            Ok(queue) => queue,
            Err(error) => {
                tracing::warn!(%error, "frames are copied behind drawing, not beside it");
                None
            }
        };
        let beside = copy_queue.is_some();
        tracing::info!(
            adapter = info.name,
            driver = info.driver_info,
            software,
            can_import = import.is_some(),
            beside,
            "opened GPU"
        );
        Ok(Gpu(Arc::new(Inner {
            health: Health::of(&device),
            timing: Timing::new(&device, &queue),
            drawing: DrawingQueue::new(queue, &device, &adapter),
            name: info.name,
            software,
            device,
            import,
            can_export,
            ids: ids_of(&adapter),
            counters: Counters::default(),
            staging: StagingPool::default(),
            copy_queue,
        })))
    }

    /// Adapter name, e.g. `llvmpipe (LLVM 15.0.6, 256 bits)`.
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// Whether the CPU does the work.
    pub fn is_software(&self) -> bool {
        self.0.software
    }

    /// Whether host memory can be imported (allowed, and the driver has the extension).
    pub fn can_import(&self) -> bool {
        self.0.import.is_some()
    }

    /// Whether memory of the device can be given to other processes.
    pub fn can_export(&self) -> bool {
        self.0.can_export
    }

    /// What tells the device and its driver from others.
    pub fn ids(&self) -> DeviceIds {
        self.0.ids
    }

    /// Whether copies can run while the next submission is drawn.
    pub fn copies_beside(&self) -> bool {
        self.0.copy_queue.is_some()
    }

    /// Whether pipelines can take this many bytes with each draw call, without a buffer.
    pub fn has_immediates(&self, n_bytes: u32) -> bool {
        self.0
            .device
            .features()
            .contains(wgpu::Features::IMMEDIATES)
            && self.0.device.limits().max_immediate_size >= n_bytes
    }

    /// Whether shaders can use `f64` and `u64`.
    pub fn has_wide_numbers(&self) -> bool {
        self.0
            .device
            .features()
            .contains(wgpu::Features::SHADER_F64 | wgpu::Features::SHADER_INT64)
    }

    /// Whether indirect draw calls can begin at any instance.
    pub fn has_indirect_instances(&self) -> bool {
        self.0
            .device
            .features()
            .contains(wgpu::Features::INDIRECT_FIRST_INSTANCE)
    }

    /// Largest buffer, and so the largest segment that can be imported, bytes.
    pub fn max_buffer_bytes(&self) -> u64 {
        self.0.device.limits().max_buffer_size
    }

    /// The device, for pipelines and bind groups.
    pub fn device(&self) -> &wgpu::Device {
        &self.0.device
    }

    /// The queue, for uploads; submissions go through [`crate::CopyBatch::submit`] and
    /// [`Gpu::submit`].
    pub fn queue(&self) -> &wgpu::Queue {
        self.0.drawing.raw()
    }

    /// Counts of passes, draws, copies and submissions.
    pub fn counters(&self) -> &Counters {
        &self.0.counters
    }

    /// Gives commands to the drawing queue. Every submission goes through its lock, because one may
    /// wait for semaphores that are not meant for the others.
    pub fn submit(
        &self,
        commands: impl IntoIterator<Item = wgpu::CommandBuffer>,
    ) -> wgpu::SubmissionIndex {
        self.0.drawing.lock().submit(commands, None, None)
    }

    /// Whether shaders can write into imported memory and be waited for: see
    /// [`crate::ShmTarget::storage`].
    pub fn can_write_directly(&self) -> bool {
        self.can_import() && self.0.drawing.lock().has_timeline()
    }

    /// Begins or ends timing. `false` if the adapter has no timestamps.
    pub fn set_timing(&self, on: bool) -> bool {
        self.0.timing.set(on)
    }

    /// Times since the last call, by label.
    pub fn take_spans(&self) -> Vec<Span> {
        self.0.timing.take_spans()
    }

    /// Ends the span `label` of the submission that is being recorded; the first mark of a
    /// submission only begins one.
    pub fn mark(&self, encoder: &mut wgpu::CommandEncoder, label: &'static str) {
        self.0.timing.mark(encoder, label);
    }

    /// Does `work`, and counts its time as the CPU's.
    pub fn time<T>(&self, label: &'static str, work: impl FnOnce() -> T) -> T {
        self.0.timing.time(label, work)
    }

    pub(crate) fn drawing(&self) -> &DrawingQueue {
        &self.0.drawing
    }

    pub(crate) fn copy_queue(&self) -> Option<&CopyQueue> {
        self.0.copy_queue.as_ref()
    }

    pub(crate) fn timing(&self) -> &Timing {
        &self.0.timing
    }

    pub(crate) fn import_caps(&self) -> Option<ImportCaps> {
        self.0.import
    }

    /// A mappable buffer of `n_bytes`, a multiple of 4, from the pool of those that came back.
    pub(crate) fn take_staging(&self, n_bytes: u64) -> wgpu::Buffer {
        self.0.staging.take(n_bytes).unwrap_or_else(|| {
            self.device().create_buffer(&wgpu::BufferDescriptor {
                label: Some("staging"),
                size: n_bytes.max(4),
                usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        })
    }

    pub(crate) fn give_staging(&self, buffer: wgpu::Buffer) {
        self.0.staging.give(buffer);
    }

    /// The error of a wait of our own that the driver ended; [`vk::Result::TIMEOUT`] is a device
    /// that hangs. The device cannot be used any more.
    pub(crate) fn wait_failed(&self, error: vk::Result) -> GpuError {
        let fault = match error {
            vk::Result::TIMEOUT => Fault::Hung,
            other => Fault::Lost(other.to_string()),
        };
        self.0.health.note(fault.clone());
        self.error_of(self.fault().unwrap_or(fault))
    }

    pub(crate) fn lost(&self, reason: impl ToString) -> GpuError {
        GpuError::Lost {
            name: self.0.name.clone(),
            reason: reason.to_string(),
        }
    }
}
