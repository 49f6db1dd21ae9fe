//! The queue between the reading thread and the writer thread, bounded in bytes. Frames pass through
//! coding threads on their way and keep their place; those of a video are coded one after the other.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, TrySendError, bounded, unbounded};
use parking_lot::Mutex;
use schema_bus::Frame;
use schema_frames::{FrameHeader, Modality};
use schema_recording::messages::Batch;

use crate::options::KEY_EVERY_NANOS;
use consumer_forms::foxglove::frames::TopicName;

/// Something for the writer to do.
#[derive(Debug)]
pub enum Job {
    /// Messages.
    Batch(Batch),
    /// A frame that is to be coded; it becomes a batch.
    Frame(Box<FrameJob>),
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

/// A frame as it was taken from the bus.
#[derive(Debug)]
pub struct FrameJob {
    /// The messages that go with it; those of the frame itself are put in front.
    pub batch: Batch,
    /// Its names in the file.
    pub name: Arc<TopicName>,
    /// Its header.
    pub header: FrameHeader,
    /// Its payload.
    pub payload: Payload,
}

impl FrameJob {
    fn queued_bytes(&self) -> usize {
        self.batch.queued_bytes().saturating_add(self.payload.len())
    }
}

/// Bytes of a frame.
#[derive(Debug)]
#[expect(
    clippy::large_enum_variant,
    reason = "few are queued at a time, and borrowing allocates nothing"
)]
pub enum Payload {
    /// A copy.
    Copied(Vec<u8>),
    /// Those in shared memory, which the simulator does not write to until this is dropped.
    Borrowed(Frame, Hold),
}

/// Counts the frames of a topic that are borrowed.
#[derive(Clone, Debug, Default)]
pub struct Hold(Arc<()>);

/// Frames of a topic that may be borrowed: a reader can hold three at a time, and one is the next.
const MAX_HELD: usize = 2;
/// Smaller frames are copied, which costs less than giving them back.
const MIN_BORROWED_BYTES: usize = 64 << 10;

impl Payload {
    /// The frame itself, or a copy if too many of its topic are borrowed; `buffer` hands in what is
    /// copied into.
    pub fn of(frame: Frame, hold: &Hold, buffer: impl FnOnce(usize) -> Vec<u8>) -> Payload {
        if frame.len() >= MIN_BORROWED_BYTES && Arc::strong_count(&hold.0) <= MAX_HELD {
            return Payload::Borrowed(frame, hold.clone());
        }
        let mut copy = buffer(frame.len());
        copy.extend_from_slice(&frame);
        Payload::Copied(copy)
    }
}

impl std::ops::Deref for Payload {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match self {
            Payload::Copied(bytes) => bytes,
            Payload::Borrowed(frame, _) => frame,
        }
    }
}

impl Job {
    fn queued_bytes(&self) -> usize {
        match self {
            Job::Batch(batch) => batch.queued_bytes(),
            Job::Frame(job) => job.queued_bytes(),
            Job::Attach { data, .. } => data.len(),
            Job::Metadata { .. } => 0,
        }
    }

    /// Simulated time of messages, nanoseconds.
    fn log_nanos(&self) -> u64 {
        match self {
            Job::Batch(batch) => batch.log_nanos,
            Job::Frame(job) => job.batch.log_nanos,
            Job::Attach { .. } | Job::Metadata { .. } => 0,
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
    slots: Sender<Slot>,
    work: Sender<Task>,
    shared: Arc<Shared>,
    limit_bytes: usize,
    /// Newest simulated time that was queued, as the writer will see it.
    newest_nanos: AtomicU64,
    lanes: Mutex<BTreeMap<Arc<str>, Arc<Lane>>>,
}

/// The writer's side.
#[derive(Debug)]
pub struct Outlet {
    slots: Receiver<Slot>,
    shared: Arc<Shared>,
}

/// The coding threads' side.
#[derive(Clone, Debug)]
pub struct Workbench {
    work: Receiver<Task>,
    shared: Arc<Shared>,
}

/// A place in the order of the file.
#[derive(Debug)]
enum Slot {
    Ready(Job),
    /// A coding thread will hand it in.
    Coming(Receiver<Batch>),
}

/// A frame to code, and where its batch goes.
#[derive(Debug)]
struct Work {
    job: Box<FrameJob>,
    /// Simulated second that the file is in.
    second: u64,
    done: Sender<Batch>,
}

/// Something for a coding thread to do.
#[derive(Debug)]
enum Task {
    Frame(Work),
    /// The frames that wait in a lane, unless another thread is at them.
    Lane(Arc<Lane>),
}

/// Frames of one topic that are coded one after the other.
#[derive(Debug, Default)]
struct Lane {
    /// What waits, and whether a thread is at it.
    state: Mutex<(VecDeque<Work>, bool)>,
}

impl Lane {
    fn push(&self, work: Work) {
        self.state.lock().0.push_back(work);
    }

    /// The first frame for a thread that comes; none if another one is there.
    fn begin(&self) -> Option<Work> {
        let mut state = self.state.lock();
        if state.1 {
            return None;
        }
        let work = state.0.pop_front();
        state.1 = work.is_some();
        work
    }

    /// The next frame for the thread that is there; without one it leaves.
    fn next(&self) -> Option<Work> {
        let mut state = self.state.lock();
        let work = state.0.pop_front();
        state.1 = work.is_some();
        work
    }
}

#[derive(Debug, Default)]
struct Shared {
    bytes: AtomicUsize,
    /// Writers that have not ended: 0 or 1.
    writers: AtomicUsize,
    spare: Mutex<Vec<Vec<u8>>>,
    /// Whether a topic's colour images are coded one after the other.
    colour_in_order: AtomicBool,
}

impl Shared {
    fn buffer(&self, capacity: usize) -> Vec<u8> {
        if capacity >= MIN_SPARE_BYTES {
            let mut spare = self.spare.lock();
            let fits = |buffer: &Vec<u8>| {
                buffer.capacity() >= capacity && buffer.capacity() / 2 <= capacity
            };
            if let Some(idx) = spare.iter().position(fits) {
                return spare.swap_remove(idx);
            }
        }
        Vec::with_capacity(capacity)
    }

    fn give_back(&self, buffers: impl Iterator<Item = Vec<u8>>) {
        let mut spare = self.spare.lock();
        for mut buffer in buffers.filter(|buffer| buffer.capacity() >= MIN_SPARE_BYTES) {
            if spare.len() == MAX_SPARE_BUFFERS {
                spare.remove(0);
            }
            buffer.clear();
            spare.push(buffer);
        }
    }
}

/// A queue that holds at most `limit_bytes` of messages (one larger job fits into an empty queue).
/// Frames wait on the workbench until they are coded.
pub fn queue(limit_bytes: usize) -> (Queue, Workbench, Outlet) {
    let (slot_sender, slots) = bounded(MAX_JOBS);
    // As many as there are slots, at most.
    let (work_sender, work) = unbounded();
    let shared = Arc::new(Shared::default());
    shared.writers.store(1, Ordering::Release);
    (
        Queue {
            slots: slot_sender,
            work: work_sender,
            shared: shared.clone(),
            limit_bytes,
            newest_nanos: AtomicU64::new(0),
            lanes: Mutex::default(),
        },
        Workbench {
            work,
            shared: shared.clone(),
        },
        Outlet { slots, shared },
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
        if self.shared.writers.load(Ordering::Acquire) == 0 {
            return Err(Refused::Closed);
        }
        if (waiting > 0 && waiting.saturating_add(n_bytes) > self.limit_bytes)
            || self.slots.is_full()
        {
            return Err(Refused::Full(job));
        }
        self.shared.bytes.fetch_add(n_bytes, Ordering::AcqRel);
        let newest = self.newest_nanos.load(Ordering::Acquire);
        let newest = newest.max(job.log_nanos());
        self.newest_nanos.store(newest, Ordering::Release);
        let slot = match job {
            Job::Frame(job) => {
                let (done, batch) = bounded(1);
                let second = newest / KEY_EVERY_NANOS;
                let task = self.task(Work { job, second, done });
                if self.work.send(task).is_err() {
                    return Err(Refused::Closed);
                }
                Slot::Coming(batch)
            }
            job => Slot::Ready(job),
        };
        // Only this side fills slots, so there is room as seen above.
        self.slots.try_send(slot).map_err(|error| match error {
            TrySendError::Full(Slot::Ready(job)) => {
                self.shared.bytes.fetch_sub(n_bytes, Ordering::AcqRel);
                Refused::Full(job)
            }
            TrySendError::Full(Slot::Coming(_)) | TrySendError::Disconnected(_) => Refused::Closed,
        })
    }

    fn task(&self, work: Work) -> Task {
        let is_colour = work.job.header.modality() == Some(Modality::Rgb);
        if !is_colour || !self.shared.colour_in_order.load(Ordering::Acquire) {
            return Task::Frame(work);
        }
        let mut lanes = self.lanes.lock();
        let lane = lanes.entry(work.job.batch.source.clone()).or_default();
        lane.push(work);
        Task::Lane(lane.clone())
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
        self.shared.buffer(capacity)
    }
}

impl Workbench {
    /// Has the colour images of a topic coded one after the other, in the order of the file. To be
    /// called before the first frame is queued.
    pub fn keep_colour_in_order(&self) {
        self.shared.colour_in_order.store(true, Ordering::Release);
    }

    /// Codes frame after frame until the reading side is gone. `code` gets the frame, the simulated
    /// second that the file is in there and a source of buffers, and makes its messages.
    pub fn run(
        &self,
        mut code: impl FnMut(
            &FrameJob,
            u64,
            &mut dyn FnMut(usize) -> Vec<u8>,
        ) -> Vec<schema_recording::messages::Entry>,
    ) {
        while let Ok(task) = self.work.recv() {
            match task {
                Task::Frame(work) => self.code(work, &mut code),
                Task::Lane(lane) => {
                    let mut work = lane.begin();
                    while let Some(of) = work {
                        self.code(of, &mut code);
                        work = lane.next();
                    }
                }
            }
        }
    }

    fn code(
        &self,
        work: Work,
        code: &mut impl FnMut(
            &FrameJob,
            u64,
            &mut dyn FnMut(usize) -> Vec<u8>,
        ) -> Vec<schema_recording::messages::Entry>,
    ) {
        let Work {
            mut job,
            second,
            done,
        } = work;
        if self.shared.writers.load(Ordering::Acquire) == 0 {
            return;
        }
        let before = job.queued_bytes();
        let mut entries = code(&job, second, &mut |n| self.shared.buffer(n));
        entries.append(&mut job.batch.entries);
        let mut batch = job.batch;
        batch.entries = entries;
        let after = batch.queued_bytes();
        // What waits is as large as it has become.
        if after > before {
            self.shared
                .bytes
                .fetch_add(after.saturating_sub(before), Ordering::AcqRel);
        } else {
            self.shared
                .bytes
                .fetch_sub(before.saturating_sub(after), Ordering::AcqRel);
        }
        // What was borrowed is given back here, before the writer hears of it.
        if let Payload::Copied(bytes) = job.payload {
            self.shared.give_back(std::iter::once(bytes));
        }
        // A writer that has ended does not want it any more.
        let _ = done.send(batch);
    }
}

/// Why nothing can come any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Closed {
    /// The reading side is gone and everything was taken.
    Empty,
    /// A coding thread panicked.
    CoderLost,
}

impl Outlet {
    /// The next job, coded; `None` after `timeout` without one.
    ///
    /// # Errors
    /// [`Closed`] when nothing can come any more.
    pub fn next(&self, timeout: Duration) -> Result<Option<Job>, Closed> {
        match self.slots.recv_timeout(timeout) {
            Ok(Slot::Ready(job)) => Ok(Some(job)),
            Ok(Slot::Coming(batch)) => match batch.recv() {
                Ok(batch) => Ok(Some(Job::Batch(batch))),
                Err(_) => Err(Closed::CoderLost),
            },
            Err(crossbeam_channel::RecvTimeoutError::Timeout) => Ok(None),
            Err(crossbeam_channel::RecvTimeoutError::Disconnected) => Err(Closed::Empty),
        }
    }

    /// Notes that a job of `n_bytes` is written, and takes its buffers back for reuse.
    pub fn done(&self, n_bytes: usize, buffers: impl Iterator<Item = Vec<u8>>) {
        self.shared.bytes.fetch_sub(n_bytes, Ordering::AcqRel);
        self.shared.give_back(buffers);
    }
}

impl Drop for Outlet {
    fn drop(&mut self) {
        self.shared.writers.store(0, Ordering::Release);
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
        let (queue, _bench, outlet) = queue(300_000);
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
        let (queue, _bench, outlet) = queue(1000);
        queue.offer(batch(5000)).unwrap();
        drop(outlet);
        assert!(
            matches!(queue.push(batch(1)), Err(Refused::Closed)),
            "a dead writer is noticed, not waited for"
        );
    }

    #[test]
    fn coded_frames_keep_their_place() {
        let (queue, bench, outlet) = queue(10_000_000);
        let frame = |sequence: u32| {
            let Job::Batch(mut batch) = batch(0) else {
                unreachable!("batch() makes a batch")
            };
            batch.sequence = sequence;
            batch.entries.clear();
            Job::Frame(Box::new(FrameJob {
                batch,
                name: Arc::new(TopicName::new("ego/front/rgb").unwrap()),
                header: FrameHeader::new(schema_frames::Modality::Rgb),
                payload: Payload::Copied(vec![0; 100_000]),
            }))
        };
        for sequence in 0..20 {
            queue.offer(frame(sequence)).unwrap();
        }
        assert_eq!(queue.waiting_bytes(), 20 * (100_000 + 64));
        let coder = |delay: u64| {
            let bench = bench.clone();
            std::thread::spawn(move || {
                bench.run(|job, _, buffer| {
                    // Odd ones take longer, so that they are overtaken.
                    let millis = delay * (job.batch.sequence % 2) as u64;
                    std::thread::sleep(Duration::from_millis(millis));
                    let mut bytes = buffer(10);
                    bytes.push(job.batch.sequence as u8);
                    vec![Entry {
                        topic: "/a".to_string(),
                        content: Content::Frame,
                        bytes,
                    }]
                });
            })
        };
        let coders = [coder(5), coder(1)];
        for sequence in 0..20 {
            let Ok(Some(Job::Batch(batch))) = outlet.next(Duration::from_secs(20)) else {
                panic!("batch {sequence} is missing")
            };
            assert_eq!(batch.sequence, sequence);
            assert_eq!(batch.entries[0].bytes, [sequence as u8]);
            outlet.done(batch.queued_bytes(), std::iter::empty());
        }
        assert_eq!(queue.waiting_bytes(), 0);
        drop(queue);
        for coder in coders {
            coder.join().unwrap();
        }
        assert_eq!(outlet.next(Duration::ZERO).unwrap_err(), Closed::Empty);
    }
}
