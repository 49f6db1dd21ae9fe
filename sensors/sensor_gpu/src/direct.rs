//! Submissions whose shaders write into their readers' memory themselves. They need no copies and
//! no mapping, and are awaited by a semaphore of our own, so the bytes are handed on before wgpu
//! does its bookkeeping.

use std::time::Instant;

use ash::vk;
use wgpu::hal::api::Vulkan;
use wgpu::wgt;

use crate::device::Gpu;
use crate::error::GpuError;
use crate::memory::DirectTarget;
use crate::queue::{AWAKE, Moment, wait_for};
use crate::timing::Pending;

/// A submission in flight whose shaders write to targets. Dropping it waits too.
#[derive(Debug)]
#[must_use = "the bytes are there only after wait_awake()"]
pub struct Direct {
    gpu: Gpu,
    done: Moment,
    submission: wgpu::SubmissionIndex,
    pending: Option<Pending>,
    /// Kept until the GPU no longer uses them.
    _targets: Vec<DirectTarget>,
    is_done: bool,
}

impl Gpu {
    /// Submits `encoder`, whose shaders write to `targets`, and makes what they wrote visible to
    /// the host.
    ///
    /// Panics unless [`Gpu::can_write_directly`].
    pub fn submit_direct(
        &self,
        mut encoder: wgpu::CommandEncoder,
        targets: Vec<DirectTarget>,
    ) -> Direct {
        let mut buffers: Vec<&wgpu::Buffer> = Vec::with_capacity(targets.len());
        for buffer in targets.iter().filter_map(DirectTarget::imported) {
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
        let pending = self.timing().close_marks(&mut encoder);
        let commands = encoder.finish();
        let mut drawing = self.drawing().lock();
        let done = drawing
            .next_moment()
            .expect("the caller asked whether the GPU can");
        let submission = self.time("submit", || drawing.submit([commands], None, Some(done)));
        drop(drawing);
        self.counters().add_submission(0);
        if let Some(pending) = &pending {
            pending.map();
        }
        Direct {
            gpu: self.clone(),
            done,
            submission,
            pending,
            _targets: targets,
            is_done: false,
        }
    }
}

impl Direct {
    /// Waits until the bytes are written; spins for the first half millisecond.
    ///
    /// # Errors
    /// [`GpuError::Lost`], [`GpuError::Hung`].
    pub fn wait_awake(mut self) -> Result<(), GpuError> {
        self.wait_for_semaphore()?;
        if let Some(pending) = self.pending.take() {
            self.gpu.wait_for(Some(&self.submission))?;
            self.gpu.timing().read_marks(&pending);
        }
        Ok(())
    }

    fn wait_for_semaphore(&mut self) -> Result<(), GpuError> {
        self.is_done = true;
        // What a lost device was given may never be signalled.
        if let Err(error) = self.gpu.check() {
            self.gpu.settle();
            return Err(error);
        }
        // SAFETY: the guard only lends the device for the calls below.
        let hal = unsafe { self.gpu.device().as_hal::<Vulkan>() }
            .expect("the device was opened as Vulkan");
        let raw = hal.raw_device();
        let lost = |error: vk::Result| self.gpu.wait_failed(error);
        let begin = Instant::now();
        while !self.gpu.is_software() && begin.elapsed() < AWAKE {
            // SAFETY: the semaphore is of this device and lives as long as it.
            if unsafe { raw.get_semaphore_counter_value(self.done.semaphore) }.map_err(lost)?
                >= self.done.value
            {
                return Ok(());
            }
            std::hint::spin_loop();
        }
        // SAFETY: as above.
        unsafe { wait_for(raw, self.done) }.map_err(lost)
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
