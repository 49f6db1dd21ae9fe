//! What arrives from the link, between zenoh's threads and the one that publishes.

use std::collections::VecDeque;
use std::io::{Read as _, Write as _};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::time::Instant;

use anyhow::Context as _;
use parking_lot::Mutex;
use zenoh::bytes::ZBytes;
use zenoh::sample::Sample;

use crate::wire::Envelope;

/// Payloads that may wait in all inboxes of a bridge together, bytes. A topic's newest sample may
/// wait beyond that.
const MAX_WAITING_BYTES: usize = 1 << 30;

/// Wakes the thread that publishes, and counts what waits for it.
#[derive(Debug)]
pub struct Waker {
    waiting_bytes: AtomicUsize,
    pending: AtomicBool,
    writer: UnixStream,
    reader: UnixStream,
}

impl Waker {
    /// A pair of connected ends.
    ///
    /// # Errors
    /// If the system has no more of them.
    pub fn new() -> anyhow::Result<Arc<Waker>> {
        let no_pair = "the system gives no pair of sockets";
        let (writer, reader) = UnixStream::pair().context(no_pair)?;
        for end in [&writer, &reader] {
            end.set_nonblocking(true).context(no_pair)?;
        }
        Ok(Arc::new(Waker {
            waiting_bytes: AtomicUsize::new(0),
            pending: AtomicBool::new(false),
            writer,
            reader,
        }))
    }

    /// Wakes the other thread, or lets it not fall asleep.
    pub fn wake(&self) {
        if !self.pending.swap(true, Ordering::AcqRel) {
            // A full socket wakes as well.
            let _ = (&self.writer).write(&[0]);
        }
    }

    /// Takes back what woke it; call it before looking at what arrived.
    pub fn drain(&self) {
        let mut bytes = [0; 64];
        while (&self.reader).read(&mut bytes).is_ok_and(|n| n > 0) {}
        self.pending.store(false, Ordering::Release);
    }

    /// Readable while somebody has woken.
    pub fn as_fd(&self) -> BorrowedFd<'_> {
        self.reader.as_fd()
    }
}

/// A sample that has arrived.
#[derive(Debug)]
pub struct Arrived {
    /// Its envelope.
    pub envelope: Envelope,
    /// Its payload as it was sent.
    pub payload: ZBytes,
    /// When it came.
    pub at: Instant,
}

/// Samples of one topic that wait; the oldest goes when there are too many.
#[derive(Debug)]
pub struct Inbox {
    queue: Mutex<VecDeque<Arrived>>,
    limit: usize,
    dropped: AtomicU64,
    refused: AtomicU64,
    waker: Arc<Waker>,
}

impl Inbox {
    /// An empty one for at most `limit` samples.
    pub fn new(limit: usize, waker: &Arc<Waker>) -> Arc<Inbox> {
        Arc::new(Inbox {
            queue: Mutex::new(VecDeque::new()),
            limit,
            dropped: AtomicU64::new(0),
            refused: AtomicU64::new(0),
            waker: waker.clone(),
        })
    }

    /// Takes what zenoh delivers.
    pub fn push(&self, sample: Sample) {
        self.push_parts(sample.attachment(), sample.payload());
    }

    fn push_parts(&self, attachment: Option<&ZBytes>, payload: &ZBytes) {
        let envelope = match Envelope::open(attachment) {
            Ok(envelope) => envelope,
            Err(error) => {
                if self.refused.fetch_add(1, Ordering::Relaxed) == 0 {
                    tracing::warn!("refused a sample: {error:#}; further ones are only counted");
                }
                return;
            }
        };
        let arrived = Arrived {
            envelope,
            payload: payload.clone(),
            at: Instant::now(),
        };
        let waiting_bytes = &self.waker.waiting_bytes;
        waiting_bytes.fetch_add(arrived.payload.len(), Ordering::Relaxed);
        let mut queue = self.queue.lock();
        let is_full = |len: usize| {
            len >= self.limit || waiting_bytes.load(Ordering::Relaxed) > MAX_WAITING_BYTES
        };
        while is_full(queue.len())
            && let Some(oldest) = queue.pop_front()
        {
            waiting_bytes.fetch_sub(oldest.payload.len(), Ordering::Relaxed);
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
        queue.push_back(arrived);
        drop(queue);
        self.waker.wake();
    }

    /// The oldest sample that waits, if `is_due` lets it go.
    pub fn pop_if(&self, is_due: impl FnOnce(&Arrived) -> bool) -> Option<Arrived> {
        let mut queue = self.queue.lock();
        let arrived = queue.pop_front_if(|arrived| is_due(arrived))?;
        let n_bytes = arrived.payload.len();
        self.waker
            .waiting_bytes
            .fetch_sub(n_bytes, Ordering::Relaxed);
        Some(arrived)
    }

    /// The oldest sample that waits.
    pub fn pop(&self) -> Option<Arrived> {
        self.pop_if(|_| true)
    }

    /// Samples that were dropped and that were refused since the last call.
    pub fn take_counts(&self) -> (u64, u64) {
        (
            self.dropped.swap(0, Ordering::Relaxed),
            self.refused.swap(0, Ordering::Relaxed),
        )
    }
}

impl Drop for Inbox {
    fn drop(&mut self) {
        while self.pop().is_some() {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coding::Coding;

    #[test]
    fn the_oldest_goes_when_there_are_too_many() {
        let waker = Waker::new().unwrap();
        let inbox = Inbox::new(2, &waker);
        for n in 0..5u64 {
            let envelope = Envelope::pack(&n.to_le_bytes(), &[], 0, Coding::None);
            inbox.push_parts(Some(&ZBytes::from(envelope)), &ZBytes::new());
        }
        inbox.push_parts(None, &ZBytes::new());
        let numbers: Vec<u64> = std::iter::from_fn(|| inbox.pop())
            .map(|arrived| arrived.envelope.header::<u64>().unwrap().0)
            .collect();
        assert_eq!(numbers, [3, 4]);
        assert_eq!(inbox.take_counts(), (3, 1));
        assert_eq!(inbox.take_counts(), (0, 0));
    }

    #[test]
    fn payloads_of_all_topics_share_one_budget() {
        let waker = Waker::new().unwrap();
        let inboxes = [Inbox::new(64, &waker), Inbox::new(64, &waker)];
        // Clones of one payload, so that the test needs memory for one.
        let payload = ZBytes::from(vec![0; MAX_WAITING_BYTES / 8]);
        let envelope = ZBytes::from(Envelope::pack(&[0; 8], &[], 0, Coding::None));
        let push = |inbox: &Inbox| inbox.push_parts(Some(&envelope), &payload);
        (0..6).for_each(|_| push(&inboxes[0]));
        (0..6).for_each(|_| push(&inboxes[1]));
        // The first is within the budget; the second drops its own oldest ones.
        assert_eq!(inboxes[0].take_counts(), (0, 0));
        assert_eq!(inboxes[1].take_counts(), (4, 0));
        drop(inboxes);
        assert_eq!(waker.waiting_bytes.load(Ordering::Relaxed), 0);
    }
}
