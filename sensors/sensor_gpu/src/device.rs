//! Opening a Vulkan device: which adapter, which extensions, which limits.

use std::sync::{Arc, Mutex};

use crate::copy_queue::{CopyPath, CopyQueue};
use crate::counters::Counters;
use crate::direct::Timeline;
use crate::import::{self, ImportCaps};
use crate::timing::Timing;

/// What to open.
#[derive(Clone, Debug)]
pub struct GpuOptions {
    /// Part of the adapter's name, any case; `None` takes a hardware GPU if there is one, else a
    /// software adapter.
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

/// Why no device was opened, or why a submission did not come back.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// The Vulkan loader found nothing.
    #[error(
        "no Vulkan adapter found; install a driver (Debian: mesa-vulkan-drivers has the software adapter lavapipe)"
    )]
    NoAdapter,
    /// None has the name asked for.
    #[error("no Vulkan adapter's name contains {asked:?}; there are: {}", found.join(", "))]
    UnknownAdapter {
        /// What was asked for.
        asked: String,
        /// Names of all adapters.
        found: Vec<String>,
    },
    /// The driver refused to open the device.
    #[error("cannot open Vulkan adapter {name:?}: {reason}")]
    Open {
        /// Adapter.
        name: String,
        /// The driver's words.
        reason: String,
    },
    /// The device was lost or reported an error while a submission ran.
    #[error("GPU {name:?} failed while working on a frame: {reason}; restart the daemon")]
    Lost {
        /// Adapter.
        name: String,
        /// The driver's words.
        reason: String,
    },
}

/// An open device with its queues. Cheap to clone; all clones are the same device.
#[derive(Clone, Debug)]
pub struct Gpu(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    name: String,
    software: bool,
    device: wgpu::Device,
    queue: wgpu::Queue,
    import: Option<ImportCaps>,
    counters: Counters,
    timing: Timing,
    staging: Mutex<Vec<wgpu::Buffer>>,
    /// Held while a submission is given to the queue; `None` inside where there are none.
    timeline: Mutex<Option<Timeline>>,
    /// Copies beside the drawing, where there is a queue for them.
    copy_queue: Option<CopyQueue>,
}

impl Drop for Inner {
    fn drop(&mut self) {
        // What the drawing queue waits for or signals may be in use as long as nobody knows that it
        // is done: it is left to the driver then.
        if self
            .device
            .poll(wgpu::PollType::wait_indefinitely())
            .is_err()
        {
            return;
        }
        if let Some(queue) = self.copy_queue.take() {
            // SAFETY: the drawing queue has finished everything, and who could submit more is gone.
            unsafe { queue.close() };
        }
        let timeline = self
            .timeline
            .get_mut()
            .unwrap_or_else(std::sync::PoisonError::into_inner)
            .take();
        if let Some(timeline) = timeline {
            // SAFETY: made from this device, whose drawing queue has finished everything.
            unsafe { timeline.destroy(&self.device) };
        }
    }
}

/// A GPU that could be opened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdapterInfo {
    /// Name, e.g. `llvmpipe (LLVM 15.0.6, 256 bits)`.
    pub name: String,
    /// Driver and its version.
    pub driver: String,
    /// Whether the CPU does the work.
    pub is_software: bool,
    /// Whether the driver has the extension that frames without a copy need.
    pub can_import: bool,
}

impl Gpu {
    /// Every Vulkan adapter of the machine.
    pub fn adapters() -> Vec<AdapterInfo> {
        let describe = |adapter: &wgpu::Adapter| {
            let info = adapter.get_info();
            AdapterInfo {
                is_software: info.device_type == wgpu::DeviceType::Cpu,
                can_import: import::has_import(adapter),
                driver: format!("{} {}", info.driver, info.driver_info)
                    .trim()
                    .to_owned(),
                name: info.name,
            }
        };
        enumerate().iter().map(describe).collect()
    }

    /// Waits until the device has finished everything that was submitted and freed what was
    /// dropped.
    pub fn wait_idle(&self) {
        if let Err(error) = self.copy_queue().map_or(Ok(()), CopyQueue::wait_idle) {
            tracing::warn!(%error, "the GPU's copies did not end");
        }
        if let Err(error) = self.device().poll(wgpu::PollType::wait_indefinitely()) {
            tracing::warn!(%error, "the GPU did not become idle");
        }
    }

    /// Opens an adapter.
    ///
    /// # Errors
    /// No adapter, none of that name (the message lists all), or the driver refuses.
    pub fn open(options: &GpuOptions) -> Result<Gpu, GpuError> {
        let adapter = choose(enumerate(), options.adapter.as_deref())?;
        let info = adapter.get_info();
        // Without imports nothing is copied to readers but by the CPU.
        let copies = if options.allow_import {
            options.copies
        } else {
            CopyPath::Behind
        };
        let refused = |reason| GpuError::Open {
            name: info.name.clone(),
            reason,
        };
        let import::Opened {
            device,
            queue,
            caps,
            copying,
        } = import::open_device(&adapter, copies).map_err(refused)?;
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
            timeline: Mutex::new(Timeline::new(&device, &adapter)),
            name: info.name,
            software,
            device,
            queue,
            import,
            counters: Counters::default(),
            timing: Timing::default(),
            staging: Mutex::default(),
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

    /// Whether frames can be copied beside the drawing of the next ones.
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

    /// Whether shaders can count in `f64` and `u64`.
    pub fn has_wide_numbers(&self) -> bool {
        self.0
            .device
            .features()
            .contains(wgpu::Features::SHADER_F64 | wgpu::Features::SHADER_INT64)
    }

    /// Whether draw calls that lie in a buffer can begin at any instance.
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
        &self.0.queue
    }

    /// Counts of passes, draws, copies and submissions.
    pub fn counters(&self) -> &Counters {
        &self.0.counters
    }

    pub(crate) fn timeline(&self) -> &Mutex<Option<Timeline>> {
        &self.0.timeline
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

    /// A mappable buffer of at least `n_bytes` from the pool of those that came back.
    pub(crate) fn take_staging(&self, n_bytes: u64) -> wgpu::Buffer {
        let mut pool = self
            .0
            .staging
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some(i) = pool.iter().position(|buffer| buffer.size() == n_bytes) {
            return pool.swap_remove(i);
        }
        drop(pool);
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        self.buffer("staging", n_bytes, usage)
    }

    pub(crate) fn give_staging(&self, buffer: wgpu::Buffer) {
        let mut pool = self
            .0
            .staging
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner);
        // Sizes change when resolutions do: old ones fall out at the front.
        if pool.len() >= MAX_POOLED_STAGING {
            pool.remove(0);
        }
        pool.push(buffer);
    }

    pub(crate) fn lost(&self, reason: impl ToString) -> GpuError {
        GpuError::Lost {
            name: self.0.name.clone(),
            reason: reason.to_string(),
        }
    }
}

/// Staging buffers kept for reuse; eight cameras with six modalities in two frames in flight use
/// 96.
const MAX_POOLED_STAGING: usize = 128;

fn enumerate() -> Vec<wgpu::Adapter> {
    let descriptor = wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        // Checking draw calls that lie in a buffer costs a pass on the GPU, and ours are written by
        // us.
        flags: wgpu::InstanceFlags::default() - wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    };
    pollster::block_on(wgpu::Instance::new(descriptor).enumerate_adapters(wgpu::Backends::VULKAN))
}

fn choose(adapters: Vec<wgpu::Adapter>, asked: Option<&str>) -> Result<wgpu::Adapter, GpuError> {
    let found: Vec<String> = adapters
        .iter()
        .map(|adapter| adapter.get_info().name)
        .collect();
    if adapters.is_empty() {
        return Err(GpuError::NoAdapter);
    }
    let named = |adapter: &wgpu::Adapter| {
        asked.is_none_or(|part| {
            adapter
                .get_info()
                .name
                .to_lowercase()
                .contains(&part.to_lowercase())
        })
    };
    adapters
        .into_iter()
        .filter(named)
        .min_by_key(|adapter| match adapter.get_info().device_type {
            wgpu::DeviceType::DiscreteGpu => 0,
            wgpu::DeviceType::IntegratedGpu => 1,
            wgpu::DeviceType::VirtualGpu => 2,
            wgpu::DeviceType::Other => 3,
            wgpu::DeviceType::Cpu => 4,
        })
        .ok_or_else(|| GpuError::UnknownAdapter {
            asked: asked.unwrap_or_default().to_owned(),
            found,
        })
}
