//! The queue that draws: one submission is given to it at a time.

use ash::vk;
use parking_lot::{Mutex, MutexGuard};
use wgpu::hal::api::Vulkan;

use super::timeline::{Moment, Timeline};

/// The queue and its timeline.
#[derive(Debug)]
pub(crate) struct DrawingQueue {
    queue: wgpu::Queue,
    /// Locked while a submission is given to the queue; `None` if the device has no timelines.
    timeline: Mutex<Option<Timeline>>,
}

impl DrawingQueue {
    /// The queue of this device.
    pub fn new(queue: wgpu::Queue, device: &wgpu::Device, adapter: &wgpu::Adapter) -> Self {
        DrawingQueue {
            queue,
            timeline: Mutex::new(Timeline::new(device, adapter)),
        }
    }

    /// The queue, for uploads.
    pub fn raw(&self) -> &wgpu::Queue {
        &self.queue
    }

    /// Locks the queue for one submitter: wgpu attaches semaphores to whichever submission comes
    /// next, so no other may come between.
    pub fn lock(&self) -> Drawing<'_> {
        Drawing {
            queue: &self.queue,
            timeline: self.timeline.lock(),
        }
    }

    /// Takes the timeline out, so that it can be destroyed.
    pub fn take_timeline(&mut self) -> Option<Timeline> {
        self.timeline.get_mut().take()
    }
}

/// The drawing queue while it is locked.
pub(crate) struct Drawing<'q> {
    queue: &'q wgpu::Queue,
    timeline: MutexGuard<'q, Option<Timeline>>,
}

impl Drawing<'_> {
    /// The next moment of the queue's own timeline, to be signalled by a submission; `None` if the
    /// device has no timelines.
    pub fn next_moment(&mut self) -> Option<Moment> {
        self.timeline.as_mut().map(Timeline::next)
    }

    /// Whether the queue has a timeline of its own.
    pub fn has_timeline(&self) -> bool {
        self.timeline.is_some()
    }

    /// Submits commands that begin after `wait` and signal `signal` when they are done.
    pub fn submit(
        &mut self,
        commands: impl IntoIterator<Item = wgpu::CommandBuffer>,
        wait: Option<Moment>,
        signal: Option<Moment>,
    ) -> wgpu::SubmissionIndex {
        if wait.is_some() || signal.is_some() {
            // SAFETY: the guard only lends the queue; the semaphores live as long as the device,
            // and their values only rise.
            let queue =
                unsafe { self.queue.as_hal::<Vulkan>() }.expect("the device was opened as Vulkan");
            if let Some(Moment { semaphore, value }) = wait {
                queue.add_wait_semaphore(
                    semaphore,
                    Some(value),
                    vk::PipelineStageFlags::ALL_COMMANDS,
                );
            }
            if let Some(Moment { semaphore, value }) = signal {
                queue.add_signal_semaphore(semaphore, Some(value));
            }
        }
        self.queue.submit(commands)
    }
}
