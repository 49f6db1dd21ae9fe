//! The queue between the reading thread and the writer thread, bounded in bytes.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, TrySendError, bounded};

use schema_recording::messages::Batch;

/// Something for the writer to do.
#[derive(Debug)]
pub enum Job {
    /// Messages.
    Batch(Batch),
    /// A file to attach: name, media type, bytes, simulated time.
    Attach {
        /// File name.
        name: String,
        /// Media type.
        media_type: &'static str,
        /// Contents.
        data: Vec<u8>,
        /// Simulated time, nanoseconds.
        log_nanos: u64,
    },
    /// A metadata record.
    Metadata {
        /// Its name.
        name: String,
        /// Its pairs.
        pairs: BTreeMap<String, String>,
    },
}

impl Job {
    fn queued_bytes(&self) -> usize {
        match self {
            Job::Batch(batch) => batch.queued_bytes(),
            Job::Attach { data, .. } => data.len(),
            Job::Metadata { .. } => 0,
        }
    }
}

/// Largest number of waiting jobs; the bound in bytes is reached first in practice.
const MAX_JOBS: usize = 65_536;
/// Number of buffers kept for reuse: a fresh large allocation would fault in new pages for every
/// frame.
const MAX_SPARE_BUFFERS: usize = 32;
/// Smaller buffers are not worth keeping.
const MIN_SPARE_BYTES: usize = 64 << 10;

/// The reading side.
#[derive(Debug)]
pub struct Queue {
    jobs: Sender<Job>,
    shared: Arc<Shared>,
    limit_bytes: usize,
}

/// The writer's side.
#[derive(Debug)]
pub struct Outlet {
    jobs: Receiver<Job>,
    shared: Arc<Shared>,
}

#[derive(Debug, Default)]
struct Shared {
    bytes: AtomicUsize,
    spare: Mutex<Vec<Vec<u8>>>,
}

/// A queue that holds at most `limit_bytes` of messages (one larger job fits into an empty queue).
pub fn queue(limit_bytes: usize) -> (Queue, Outlet) {
    let (sender, receiver) = bounded(MAX_JOBS);
    let shared = Arc::new(Shared::default());
    (
        Queue {
            jobs: sender,
            shared: shared.clone(),
            limit_bytes,
        },
        Outlet {
            jobs: receiver,
            shared,
        },
    )
}

/// Why a job was not queued.
#[derive(Debug)]
pub enum Refused {
    /// No room; the job comes back.
    Full(Job),
    /// The writer has ended.
    Closed,
}

impl Queue {
    /// Queues without waiting.
    ///
    /// # Errors
    /// [`Refused`] if there is no room or no writer.
    pub fn offer(&self, job: Job) -> Result<(), Refused> {
        let n_bytes = job.queued_bytes();
        let waiting = self.shared.bytes.load(Ordering::Acquire);
        if waiting > 0 && waiting.saturating_add(n_bytes) > self.limit_bytes {
            let writer_is_gone = Arc::strong_count(&self.shared) == 1;
            return Err(if writer_is_gone {
                Refused::Closed
            } else {
                Refused::Full(job)
            });
        }
        self.shared.bytes.fetch_add(n_bytes, Ordering::AcqRel);
        self.jobs.try_send(job).map_err(|error| {
            self.shared.bytes.fetch_sub(n_bytes, Ordering::AcqRel);
            match error {
                TrySendError::Full(job) => Refused::Full(job),
                TrySendError::Disconnected(_) => Refused::Closed,
            }
        })
    }

    /// Queues, waiting for room as long as the writer lives.
    ///
    /// # Errors
    /// [`Refused::Closed`] if the writer has ended.
    pub fn push(&self, mut job: Job) -> Result<(), Refused> {
        loop {
            match self.offer(job) {
                Err(Refused::Full(back)) => job = back,
                other => return other,
            }
            std::thread::sleep(Duration::from_micros(200));
        }
    }

    /// Bytes that wait.
    pub fn waiting_bytes(&self) -> usize {
        self.shared.bytes.load(Ordering::Acquire)
    }

    /// An empty buffer of at least this capacity; a used one if its capacity is at most about twice
    /// as large.
    pub fn buffer(&self, capacity: usize) -> Vec<u8> {
        if capacity >= MIN_SPARE_BYTES {
            let mut spare = self
                .shared
                .spare
                .lock()
                .unwrap_or_else(|poisoned| poisoned.into_inner());
            let fits = |buffer: &Vec<u8>| {
                buffer.capacity() >= capacity && buffer.capacity() / 2 <= capacity
            };
            if let Some(idx) = spare.iter().position(fits) {
                return spare.swap_remove(idx);
            }
        }
        Vec::with_capacity(capacity)
    }
}

impl Outlet {
    /// The next job; `None` after `timeout` without one, `Err` once the reading side is gone and
    /// everything was taken.
    ///
    /// # Errors
    /// `Err(())` when nothing can come any more.
    #[allow(clippy::result_unit_err)]
    pub fn next(&self, timeout: Duration) -> Result<Option<Job>, ()> {
        match self.jobs.recv_timeout(timeout) {
            Ok(job) => Ok(Some(job)),
            Err(crossbeam_channel::RecvTimeoutError::Timeout) => Ok(None),
            Err(crossbeam_channel::RecvTimeoutError::Disconnected) => Err(()),
        }
    }

    /// Notes that a job of `n_bytes` is written, and takes its buffers back for reuse.
    pub fn done(&self, n_bytes: usize, buffers: impl Iterator<Item = Vec<u8>>) {
        self.shared.bytes.fetch_sub(n_bytes, Ordering::AcqRel);
        let mut spare = self
            .shared
            .spare
            .lock()
            .unwrap_or_else(|poisoned| poisoned.into_inner());
        for mut buffer in buffers.filter(|buffer| buffer.capacity() >= MIN_SPARE_BYTES) {
            if spare.len() == MAX_SPARE_BUFFERS {
                spare.remove(0);
            }
            buffer.clear();
            spare.push(buffer);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use schema_recording::messages::{Content, Entry};

    fn batch(n_bytes: usize) -> Job {
        let entry = Entry {
            topic: "/a".to_string(),
            content: Content::Frame,
            bytes: vec![0; n_bytes],
        };
        Job::Batch(Batch {
            source: "a".into(),
            sequence: 0,
            log_nanos: 0,
            publish_nanos: 0,
            entries: vec![entry],
        })
    }

    #[test]
    fn a_full_queue_refuses_and_takes_again_after_room_was_made() {
        let (queue, outlet) = queue(300_000);
        queue.offer(batch(200_000)).unwrap();
        assert!(matches!(queue.offer(batch(200_000)), Err(Refused::Full(_))));
        let Ok(Some(Job::Batch(taken))) = outlet.next(Duration::ZERO) else {
            panic!("a batch waits")
        };
        outlet.done(
            taken.queued_bytes(),
            taken.entries.into_iter().map(|entry| entry.bytes),
        );
        assert_eq!(queue.waiting_bytes(), 0);
        assert_eq!(
            queue.buffer(150_000).capacity(),
            200_000,
            "the written buffer comes back"
        );
        queue.offer(batch(200_000)).unwrap();
    }

    #[test]
    fn one_job_larger_than_the_limit_still_fits_into_an_empty_queue() {
        let (queue, outlet) = queue(1000);
        queue.offer(batch(5000)).unwrap();
        drop(outlet);
        assert!(
            matches!(queue.push(batch(1)), Err(Refused::Closed)),
            "a dead writer is noticed, not waited for"
        );
    }
}
