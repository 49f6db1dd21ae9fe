//! The copy queue: it copies what one submission drew while the next one is drawn.
//!
//! Its commands wait on the GPU until the drawing queue has signalled the submission's number on
//! one timeline. They signal the same number on another timeline when the bytes have reached the
//! readers' memory, and a submission that draws into the copied textures again waits for that on
//! the GPU. Textures and imported memory that both queues use are made `CONCURRENT`, so no queue
//! family owns them and wgpu's state tracking stays correct. wgpu also tracks the layouts: it
//! leaves a texture in the layout for copies, and the copy does not change it.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use ash::vk;
use parking_lot::{Mutex, MutexGuard};
use wgpu::hal::api::Vulkan;

use super::family::Family;
use super::raw_copy::RawCopies;
use super::room::Room;
use super::timeline::{AWAKE, Moment, timeline_semaphore, wait_for, wait_within};

/// The copy queue, its command buffers, and the semaphores it shares with the drawing queue.
pub(crate) struct CopyQueue {
    raw: ash::Device,
    queue: vk::Queue,
    pub family: Family,
    /// Families that share textures and memory; empty if both queues are of one family.
    families: Vec<u32>,
    /// The drawing queue signals it, and copies wait for it.
    pub drawn: vk::Semaphore,
    /// Copies signal it.
    pub copied: vk::Semaphore,
    pub room: Arc<Room>,
    turn: Mutex<Turn>,
}

impl std::fmt::Debug for CopyQueue {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("CopyQueue")
            .field("family", &self.family)
            .finish_non_exhaustive()
    }
}

/// State that each submission changes; its lock puts submissions in order.
#[derive(Debug)]
pub(crate) struct Turn {
    pool: vk::CommandPool,
    /// Number of the newest attempt.
    newest: u64,
    /// Number of the newest submitted copy.
    submitted: u64,
    /// Command buffers in use, by rising number.
    busy: VecDeque<(u64, vk::CommandBuffer)>,
}

impl Turn {
    /// A number for the next submission.
    pub fn next(&mut self) -> u64 {
        self.newest += 1;
        self.newest
    }
}

impl CopyQueue {
    /// The queue of a device that was opened with a queue of this family.
    pub fn new(
        device: &wgpu::Device,
        adapter: &wgpu::Adapter,
        family: Family,
    ) -> Result<CopyQueue, vk::Result> {
        // SAFETY: the guard only lends the device for the calls below.
        let hal =
            unsafe { device.as_hal::<Vulkan>() }.ok_or(vk::Result::ERROR_INITIALIZATION_FAILED)?;
        let raw = hal.raw_device().clone();
        let drawing = hal.queue_family_index();
        // SAFETY: the device was opened with this queue, the drawing family's with its own.
        let queue = unsafe { raw.get_device_queue(family.index, family.queue) };
        let families = if family.index == drawing {
            Vec::new()
        } else {
            vec![drawing, family.index]
        };
        let flags = vk::CommandPoolCreateFlags::TRANSIENT
            | vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER;
        let info = vk::CommandPoolCreateInfo::default()
            .queue_family_index(family.index)
            .flags(flags);
        // SAFETY: a well-formed create info for a family of this device.
        let pool = unsafe { raw.create_command_pool(&info, None) }?;
        // SAFETY: the device has timelines, or the family would not have been asked for.
        let (drawn, copied) = unsafe { (timeline_semaphore(&raw), timeline_semaphore(&raw)) };
        let (drawn, copied) = match (drawn, copied) {
            (Ok(drawn), Ok(copied)) => (drawn, copied),
            (drawn, copied) => {
                // SAFETY: they are ours and were never used.
                unsafe {
                    [drawn, copied]
                        .into_iter()
                        .flatten()
                        .for_each(|semaphore| raw.destroy_semaphore(semaphore, None));
                    raw.destroy_command_pool(pool, None);
                }
                return Err(drawn
                    .and(copied)
                    .err()
                    .unwrap_or(vk::Result::ERROR_OUT_OF_HOST_MEMORY));
            }
        };
        let room = Arc::new(Room::of(&hal, adapter));
        drop(hal);
        let turn = Mutex::new(Turn {
            pool,
            newest: 0,
            submitted: 0,
            busy: VecDeque::new(),
        });
        Ok(CopyQueue {
            raw,
            queue,
            family,
            families,
            drawn,
            copied,
            room,
            turn,
        })
    }

    /// Families that share textures and memory; empty if both queues are of one family.
    pub fn families(&self) -> &[u32] {
        &self.families
    }

    /// Locks the queue for one submitter. This lock is taken before that on the drawing queue.
    pub fn turn(&self) -> MutexGuard<'_, Turn> {
        self.turn.lock()
    }

    /// Submits copies, which wait for `number` on `drawn` and signal it on `copied`.
    ///
    /// # Safety
    /// The submission that signals `number` was given to the drawing queue, and the conditions of
    /// [`RawCopies::record`] hold until `copied` reaches it. If the drawing queue copies too, the
    /// caller holds its lock.
    pub unsafe fn submit(
        &self,
        turn: &mut Turn,
        number: u64,
        copies: &RawCopies,
        marks: Option<&CopyMarks>,
    ) -> Result<(), vk::Result> {
        let commands = self.free_commands(turn)?;
        let begin = vk::CommandBufferBeginInfo::default()
            .flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the command buffer is new or its copies are done, it is of a pool that `turn`
        // guards, and the marks' queries were reset by the submission that `drawn` waits for.
        let recorded = unsafe {
            self.raw
                .begin_command_buffer(commands, &begin)
                .and_then(|()| {
                    self.mark(commands, marks, 0);
                    copies.record(&self.raw, commands);
                    let written = vk::MemoryBarrier::default()
                        .src_access_mask(vk::AccessFlags::TRANSFER_WRITE)
                        .dst_access_mask(vk::AccessFlags::HOST_READ);
                    let (from, to) = (
                        vk::PipelineStageFlags::TRANSFER,
                        vk::PipelineStageFlags::HOST,
                    );
                    self.raw.cmd_pipeline_barrier(
                        commands,
                        from,
                        to,
                        vk::DependencyFlags::empty(),
                        &[written],
                        &[],
                        &[],
                    );
                    self.mark(commands, marks, 1);
                    self.raw.end_command_buffer(commands)
                })
        };
        if let Err(error) = recorded {
            turn.busy.push_front((0, commands));
            return Err(error);
        }
        let (numbers, buffers) = ([number], [commands]);
        let (waits, signals, stages) = (
            [self.drawn],
            [self.copied],
            [vk::PipelineStageFlags::ALL_COMMANDS],
        );
        let mut timelines = vk::TimelineSemaphoreSubmitInfo::default()
            .wait_semaphore_values(&numbers)
            .signal_semaphore_values(&numbers);
        let info = vk::SubmitInfo::default()
            .wait_semaphores(&waits)
            .wait_dst_stage_mask(&stages)
            .command_buffers(&buffers)
            .signal_semaphores(&signals)
            .push_next(&mut timelines);
        // SAFETY: `turn` is the lock of a queue of our own, the caller holds that of a shared one,
        // and numbers only rise.
        if let Err(error) = unsafe {
            self.raw
                .queue_submit(self.queue, &[info], vk::Fence::null())
        } {
            turn.busy.push_front((0, commands));
            return Err(error);
        }
        turn.submitted = number;
        turn.busy.push_back((number, commands));
        Ok(())
    }

    /// A command buffer that is not in use.
    fn free_commands(&self, turn: &mut Turn) -> Result<vk::CommandBuffer, vk::Result> {
        let done = self.reached()?;
        if turn.busy.front().is_some_and(|(number, _)| *number <= done)
            && let Some((_, commands)) = turn.busy.pop_front()
        {
            // SAFETY: its copies are done; the pool allows it.
            unsafe {
                self.raw
                    .reset_command_buffer(commands, vk::CommandBufferResetFlags::empty())
            }?;
            return Ok(commands);
        }
        let info = vk::CommandBufferAllocateInfo::default()
            .command_pool(turn.pool)
            .command_buffer_count(1);
        // SAFETY: a pool of this device, which `turn` guards.
        Ok(unsafe { self.raw.allocate_command_buffers(&info) }?[0])
    }

    /// Number of the newest copy that is done.
    pub fn reached(&self) -> Result<u64, vk::Result> {
        // SAFETY: the semaphore is of this device and lives as long as `self`.
        unsafe { self.raw.get_semaphore_counter_value(self.copied) }
    }

    /// Spins for a short while; the result states whether copy `number` is done.
    pub fn wait_awake(&self, number: u64) -> Result<bool, vk::Result> {
        let begin = Instant::now();
        while begin.elapsed() < AWAKE {
            if self.reached()? >= number {
                return Ok(true);
            }
            std::hint::spin_loop();
        }
        Ok(false)
    }

    /// Waits until copy `number`, which was submitted, is done; a copy that takes too long is
    /// [`vk::Result::TIMEOUT`].
    pub fn wait(&self, number: u64) -> Result<(), vk::Result> {
        let copied = Moment {
            semaphore: self.copied,
            value: number,
        };
        // SAFETY: the semaphore is of this device and lives as long as `self`.
        unsafe { wait_for(&self.raw, copied) }
    }

    /// Whether copy `number`, which was submitted, is done, after waiting for `most` at most. A copy
    /// that a lost device will never do counts as done.
    pub fn is_done_within(&self, number: u64, most: Duration) -> bool {
        let copied = Moment {
            semaphore: self.copied,
            value: number,
        };
        // SAFETY: the semaphore is of this device and lives as long as `self`.
        let waited = unsafe { wait_within(&self.raw, copied, most) };
        waited != Err(vk::Result::TIMEOUT)
    }

    /// Waits until every copy is done.
    pub fn wait_idle(&self) -> Result<(), vk::Result> {
        let submitted = self.turn().submitted;
        self.wait(submitted)
    }

    /// Destroys everything once all copies are done. If waiting fails, it is left to the driver.
    ///
    /// # Safety
    /// No submission of the drawing queue that waits for `copied` or signals `drawn` is in flight,
    /// and none will come.
    pub unsafe fn close(self) {
        if self.wait_idle().is_err() {
            return;
        }
        let turn = self.turn.into_inner();
        // SAFETY: made from this device, both of whose queues are done with them (the other by the
        // caller's promise); command buffers go with their pool.
        unsafe {
            self.raw.destroy_command_pool(turn.pool, None);
            self.raw.destroy_semaphore(self.drawn, None);
            self.raw.destroy_semaphore(self.copied, None);
        }
    }
}

/// Two timestamps of the copy queue: begin and end.
#[derive(Debug)]
pub(crate) struct CopyMarks(vk::QueryPool);

impl CopyQueue {
    /// Marks for one submission, if the queue has timestamps. The drawing queue must reset their
    /// queries, because a queue that only copies cannot.
    pub fn new_marks(&self) -> Option<CopyMarks> {
        if self.family.timestamp_bits == 0 {
            return None;
        }
        let info = vk::QueryPoolCreateInfo::default()
            .query_type(vk::QueryType::TIMESTAMP)
            .query_count(2);
        // SAFETY: a well-formed create info.
        unsafe { self.raw.create_query_pool(&info, None) }
            .ok()
            .map(CopyMarks)
    }

    /// Records the reset of marks on the drawing queue.
    pub fn reset_marks(&self, encoder: &mut wgpu::CommandEncoder, marks: &CopyMarks) {
        // SAFETY: the encoder is of this device and holds nothing else; the pool lives until its
        // copies are done.
        unsafe {
            encoder.as_hal_mut::<Vulkan, _, _>(|hal| {
                if let Some(hal) = hal {
                    self.raw
                        .cmd_reset_query_pool(hal.raw_handle(), marks.0, 0, 2);
                }
            });
        }
    }

    /// # Safety
    /// The command buffer is being recorded, and the query was reset and not used since.
    unsafe fn mark(&self, commands: vk::CommandBuffer, marks: Option<&CopyMarks>, query: u32) {
        if let Some(CopyMarks(pool)) = marks {
            // SAFETY: the caller promises what the call asks.
            unsafe {
                self.raw.cmd_write_timestamp(
                    commands,
                    vk::PipelineStageFlags::TRANSFER,
                    *pool,
                    query,
                )
            };
        }
    }

    /// Clock steps between the marks of copies that are done; destroys the marks.
    pub fn take_marks(&self, CopyMarks(pool): CopyMarks) -> Option<u64> {
        let mut times = [0u64; 2];
        // SAFETY: a pool of this device with two queries; `TYPE_64` is what `times` takes.
        let read = unsafe {
            self.raw
                .get_query_pool_results(pool, 0, &mut times, vk::QueryResultFlags::TYPE_64)
        };
        // SAFETY: ours, and its copies are done.
        unsafe { self.raw.destroy_query_pool(pool, None) };
        let bits = u64::MAX >> (64 - self.family.timestamp_bits.clamp(1, 64));
        read.ok().map(|()| times[1].wrapping_sub(times[0]) & bits)
    }
}
