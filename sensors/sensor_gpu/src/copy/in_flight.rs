//! Submissions in flight, and the outcome of their copies.

use std::time::Duration;

use ash::vk;

use super::item::{Item, Sink};
use crate::device::Gpu;
use crate::error::GpuError;
use crate::queue::{AWAKE, CopyMarks};
use crate::timing::Pending;

/// A submission in flight. Dropping it waits too, so that the GPU never writes to memory after the
/// caller has taken it back.
#[derive(Debug)]
#[must_use = "the copies are done only after wait()"]
pub struct InFlight<'a> {
    gpu: Gpu,
    /// They own sources and targets until the copies are done.
    items: Vec<Item<'a>>,
    submission: Option<wgpu::SubmissionIndex>,
    beside: Option<Beside>,
    pending: Option<Pending>,
}

/// Copies on the copy queue.
#[derive(Debug)]
pub(crate) struct Beside {
    /// The number that the queue signals once they are done.
    pub number: u64,
    /// Whether they were submitted.
    pub submitted: Result<(), vk::Result>,
    pub marks: Option<CopyMarks>,
}

/// Bytes left mapped for the CPU.
#[derive(Debug)]
pub struct Mapped {
    view: Option<wgpu::BufferView>,
    buffer: wgpu::Buffer,
    gpu: Gpu,
    row_bytes: usize,
    stride_bytes: usize,
}

/// Rows of an image with padding between them.
#[derive(Clone, Copy, Debug)]
pub struct PaddedRows<'m> {
    /// All bytes.
    pub bytes: &'m [u8],
    /// Used bytes of a row.
    pub row_bytes: usize,
    /// Distance from one row to the next.
    pub stride_bytes: usize,
}

impl Mapped {
    /// Row `y` without padding.
    pub fn row(&self, y: usize) -> &[u8] {
        let begin = y * self.stride_bytes;
        &self.view.as_ref().expect("the view lives as long as self")[begin..begin + self.row_bytes]
    }

    /// All rows with their padding.
    pub fn padded(&self) -> PaddedRows<'_> {
        PaddedRows {
            bytes: self.view.as_ref().expect("the view lives as long as self"),
            row_bytes: self.row_bytes,
            stride_bytes: self.stride_bytes,
        }
    }
}

impl Drop for Mapped {
    fn drop(&mut self) {
        self.view = None;
        self.buffer.unmap();
        self.gpu.give_staging(self.buffer.clone());
    }
}

/// Outcome of one copy.
#[derive(Debug)]
pub struct CopyOutcome {
    /// Bytes written; 0 for a mapped one.
    pub n_bytes: usize,
    /// Copies by the CPU: 0 or 1.
    pub cpu_copies: u32,
    /// The bytes, if they were asked to be left mapped.
    pub mapped: Option<Mapped>,
}

impl<'a> InFlight<'a> {
    pub(crate) fn new(
        gpu: &Gpu,
        items: Vec<Item<'a>>,
        submission: wgpu::SubmissionIndex,
        beside: Option<Beside>,
        pending: Option<Pending>,
    ) -> InFlight<'a> {
        InFlight {
            gpu: gpu.clone(),
            items,
            submission: Some(submission),
            beside,
            pending,
        }
    }

    /// Waits until all bytes are at their places; returns one outcome per copy, in order of
    /// recording.
    ///
    /// # Errors
    /// [`GpuError::Lost`], [`GpuError::Hung`].
    pub fn wait(mut self) -> Result<Vec<CopyOutcome>, GpuError> {
        self.wait_for_gpu()?;
        if let Some(pending) = self.pending.take() {
            self.gpu.timing().read_marks(&pending);
        }
        std::mem::take(&mut self.items)
            .into_iter()
            .map(|item| finish(&self.gpu, item))
            .collect()
    }

    /// As [`InFlight::wait`], but it spins for the first half millisecond: short work on a
    /// dedicated GPU is done before a sleeping thread would wake up.
    ///
    /// # Errors
    /// As [`InFlight::wait`].
    pub fn wait_awake(self) -> Result<Vec<CopyOutcome>, GpuError> {
        if !self.gpu.is_software() {
            match (&self.beside, self.gpu.copy_queue()) {
                (
                    Some(Beside {
                        number,
                        submitted: Ok(()),
                        ..
                    }),
                    Some(queue),
                ) => {
                    queue
                        .wait_awake(*number)
                        .map_err(|error| self.gpu.wait_failed(error))?;
                }
                _ => self.poll_awake(),
            }
        }
        self.wait()
    }

    fn poll_awake(&self) {
        let begin = std::time::Instant::now();
        let is_done = || {
            self.gpu
                .is_done_within(self.submission.as_ref(), Duration::ZERO)
        };
        while begin.elapsed() < AWAKE && !is_done() {
            std::hint::spin_loop();
        }
    }

    /// Whether [`InFlight::wait`] would not wait for the GPU, after waiting here for `most` at
    /// most. What a lost GPU will never do counts as done, and waiting then tells why.
    pub fn is_done_within(&self, most: Duration) -> bool {
        match (&self.beside, self.gpu.copy_queue()) {
            (
                Some(Beside {
                    number,
                    submitted: Ok(()),
                    ..
                }),
                Some(queue),
            ) => queue.is_done_within(*number, most),
            _ => self.gpu.is_done_within(self.submission.as_ref(), most),
        }
    }

    fn wait_for_gpu(&mut self) -> Result<(), GpuError> {
        let Some(submission) = self.submission.take() else {
            return Ok(());
        };
        // Copies on the copy queue end after the drawing, so polling wgpu is unnecessary unless
        // something that it maps is awaited.
        let is_plain =
            self.pending.is_none() && self.items.iter().all(|item| item.staging.is_none());
        let copied = self
            .beside
            .take()
            .map(|beside| self.gpu.time("wait", || wait_beside(&self.gpu, beside)));
        if is_plain && matches!(copied, Some(Ok(()))) {
            return self.gpu.check();
        }
        let drawn = self
            .gpu
            .time("wait", || self.gpu.wait_for(Some(&submission)));
        copied.unwrap_or(Ok(())).and(drawn)
    }
}

fn wait_beside(
    gpu: &Gpu,
    Beside {
        number,
        submitted,
        marks,
    }: Beside,
) -> Result<(), GpuError> {
    let queue = gpu.copy_queue().expect("only its copies are beside");
    // What a lost device was given may never be signalled.
    if let Err(error) = gpu.check() {
        gpu.settle();
        return Err(error);
    }
    let done = submitted
        .and_then(|()| queue.wait(number))
        .map_err(|error| gpu.wait_failed(error));
    // If waiting failed, the marks are never freed, because the submission that resets them may
    // still be in flight.
    if done.is_ok()
        && let Some(steps) = marks.and_then(|marks| queue.take_marks(marks))
    {
        gpu.timing().add_span("copies", steps);
    }
    done
}

impl Drop for InFlight<'_> {
    fn drop(&mut self) {
        if let Err(error) = self.wait_for_gpu() {
            tracing::error!(%error, "a submission was given up");
        }
    }
}

fn finish(gpu: &Gpu, item: Item<'_>) -> Result<CopyOutcome, GpuError> {
    let n_bytes = item.source.n_bytes();
    let Some(buffer) = item.staging else {
        return Ok(CopyOutcome {
            n_bytes,
            cpu_copies: 0,
            mapped: None,
        });
    };
    let (row_bytes, stride_bytes) = item.source.staged_rows();
    let view = buffer
        .get_mapped_range(..)
        .map_err(|error| gpu.lost(error))?;
    let mapped = Mapped {
        view: Some(view),
        buffer,
        gpu: gpu.clone(),
        row_bytes,
        stride_bytes,
    };
    let Sink::Place(mut place) = item.sink else {
        return Ok(CopyOutcome {
            n_bytes: 0,
            cpu_copies: 0,
            mapped: Some(mapped),
        });
    };
    for (y, row) in place.bytes_mut()[..n_bytes]
        .chunks_exact_mut(row_bytes)
        .enumerate()
    {
        row.copy_from_slice(mapped.row(y));
    }
    Ok(CopyOutcome {
        n_bytes,
        cpu_copies: 1,
        mapped: None,
    })
}
