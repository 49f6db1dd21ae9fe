//! The writing end: a process says which topics it has on a GPU, and hands out descriptors of their
//! memory.

use std::collections::BTreeMap;
use std::io;
use std::os::fd::{AsFd as _, AsRawFd as _, FromRawFd as _, OwnedFd};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::eventfd::{EfdFlags, EventFd};
use nix::sys::socket::{SockFlag, accept4};
use parking_lot::{Mutex, MutexGuard};
use schema_frames::{GPU_MAGIC, GpuAnswer, GpuAsk, SCHEMA_VERSION};

use super::message::{receive, send};
use crate::memory::sizes::FrameTopic;
use crate::place::gpu_socket::{PATIENCE_MILLIS, is_ours, listen_at, name_of, set_patience, sweep};
use crate::place::node::BusNode;

/// The GPU that a process writes frames on; the default is that of a process without one, which only
/// hears what readers ask for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GpuDevice {
    /// Its UUID.
    pub device_uuid: [u8; 16],
    /// UUID of its driver.
    pub driver_uuid: [u8; 16],
    /// Whether its memory can be mapped by a process, as that of a software adapter.
    pub is_mappable: bool,
}

/// Answers readers until it is dropped.
#[derive(Debug)]
pub struct GpuServer {
    shared: Arc<Shared>,
    stop: Arc<EventFd>,
    thread: Option<JoinHandle<()>>,
    path: PathBuf,
}

#[derive(Debug)]
struct Shared {
    device: GpuDevice,
    producer: u64,
    state: Mutex<State>,
    n_handed_out: AtomicU64,
}

#[derive(Debug, Default)]
struct State {
    topics: BTreeMap<String, Offered>,
    memories: BTreeMap<u64, Exported>,
}

#[derive(Debug)]
struct Offered {
    spec: FrameTopic,
    is_wanted: Arc<AtomicBool>,
    is_here: Arc<AtomicBool>,
}

#[derive(Debug)]
struct Exported {
    descriptor: OwnedFd,
    n_bytes: u64,
    handle_kind: u32,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock()
    }
}

/// A topic that readers may have on the GPU, as long as this lives.
#[derive(Debug)]
pub struct GpuTopic {
    shared: Arc<Shared>,
    topic: String,
    is_wanted: Arc<AtomicBool>,
    is_here: Arc<AtomicBool>,
}

impl GpuTopic {
    /// Whether a reader has asked for it.
    pub fn is_wanted(&self) -> bool {
        self.is_wanted.load(Relaxed)
    }

    /// Says that it is wanted whoever asks.
    pub fn want(&self) {
        self.is_wanted.store(true, Relaxed);
    }

    /// Says whether this process writes it. One that does not is told all the same that a reader has
    /// asked, and refers it to others.
    pub fn set_here(&self, is_here: bool) {
        self.is_here.store(is_here, Relaxed);
    }
}

impl Drop for GpuTopic {
    fn drop(&mut self) {
        self.shared.state().topics.remove(&self.topic);
    }
}

/// Memory whose descriptor readers can have, as long as this lives.
#[derive(Debug)]
pub struct SharedMemory {
    shared: Arc<Shared>,
    generation: u64,
    n_bytes: u64,
}

impl SharedMemory {
    /// Number by which it is asked for.
    pub fn generation(&self) -> u64 {
        self.generation
    }

    /// Its length, bytes.
    pub fn n_bytes(&self) -> u64 {
        self.n_bytes
    }

    /// Number of the process that has it.
    pub fn producer(&self) -> u64 {
        self.shared.producer
    }
}

impl Drop for SharedMemory {
    fn drop(&mut self) {
        self.shared.state().memories.remove(&self.generation);
    }
}

/// A random number that is not 0.
fn random() -> io::Result<u64> {
    let mut bytes = [0; 8];
    io::Read::read_exact(&mut std::fs::File::open("/dev/urandom")?, &mut bytes)?;
    Ok(u64::from_le_bytes(bytes).max(1))
}

impl GpuServer {
    pub(crate) fn start(node: &BusNode, device: GpuDevice) -> io::Result<GpuServer> {
        let root = node.root();
        sweep(&root);
        let shared = Arc::new(Shared {
            device,
            producer: random()?,
            state: Mutex::default(),
            n_handed_out: AtomicU64::new(0),
        });
        let (listener, path) = listen_at(&root, &name_of(node.domain(), shared.producer))?;
        let stop = Arc::new(EventFd::from_flags(EfdFlags::EFD_CLOEXEC)?);
        let thread = {
            let (shared, stop) = (shared.clone(), stop.clone());
            std::thread::Builder::new()
                .name("gpu-socket".into())
                .spawn(move || serve(&shared, &listener, &stop))?
        };
        Ok(GpuServer {
            shared,
            stop,
            thread: Some(thread),
            path,
        })
    }

    /// Number of this process among the writers of GPU frames.
    pub fn producer(&self) -> u64 {
        self.shared.producer
    }

    /// Descriptors that were handed out so far.
    pub fn n_handed_out(&self) -> u64 {
        self.shared.n_handed_out.load(Relaxed)
    }

    /// Lets readers ask for `topic`; who makes its service first makes it like `spec`.
    pub fn offer(&self, topic: &str, spec: FrameTopic) -> GpuTopic {
        let is_wanted = Arc::new(AtomicBool::new(false));
        let is_here = Arc::new(AtomicBool::new(true));
        let offered = Offered {
            spec,
            is_wanted: is_wanted.clone(),
            is_here: is_here.clone(),
        };
        self.shared.state().topics.insert(topic.to_owned(), offered);
        GpuTopic {
            shared: self.shared.clone(),
            topic: topic.to_owned(),
            is_wanted,
            is_here,
        }
    }

    /// Lets readers have the descriptor of a memory of `n_bytes`; `handle_kind` as in
    /// [`GpuAnswer::handle_kind`].
    ///
    /// # Errors
    /// The machine gives no random numbers.
    pub fn share(
        &self,
        descriptor: OwnedFd,
        n_bytes: u64,
        handle_kind: u32,
    ) -> io::Result<SharedMemory> {
        let generation = random()?;
        let exported = Exported {
            descriptor,
            n_bytes,
            handle_kind,
        };
        self.shared.state().memories.insert(generation, exported);
        Ok(SharedMemory {
            shared: self.shared.clone(),
            generation,
            n_bytes,
        })
    }
}

impl Drop for GpuServer {
    fn drop(&mut self) {
        let _ = self.stop.write(1);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Connections that may wait at once. Of more, the one that has been silent longest is closed.
const MAX_SILENT: usize = 64;

/// A process that has connected and not asked yet.
struct Silent {
    connection: OwnedFd,
    until: Instant,
}

fn serve(shared: &Shared, listener: &OwnedFd, stop: &EventFd) {
    let mut silent: Vec<Silent> = Vec::new();
    loop {
        let mut watched = vec![
            PollFd::new(listener.as_fd(), PollFlags::POLLIN),
            PollFd::new(stop.as_fd(), PollFlags::POLLIN),
        ];
        let waiting = silent.iter().map(|it| it.connection.as_fd());
        watched.extend(waiting.map(|it| PollFd::new(it, PollFlags::POLLIN)));
        match poll(&mut watched, time_until_the_first(&silent)) {
            Ok(_) | Err(Errno::EINTR) => {}
            Err(_) => return,
        }
        let [is_asked, is_stopped] = [0, 1].map(|at| watched[at].any().unwrap_or(false));
        let has_spoken: Vec<bool> = watched[2..]
            .iter()
            .map(|it| it.any().unwrap_or(true))
            .collect();
        if is_stopped {
            return;
        }
        let now = Instant::now();
        let mut spoken = has_spoken.into_iter();
        silent.retain(|it| {
            let is_over = spoken.next().unwrap_or(false);
            if is_over && let Err(error) = answer(shared, &it.connection) {
                tracing::debug!(%error, "a reader's question about GPU memory was not answered");
            }
            !is_over && now < it.until
        });
        if is_asked && let Some(connection) = accept(listener) {
            if silent.len() == MAX_SILENT {
                silent.remove(0);
            }
            let until = now + Duration::from_millis(PATIENCE_MILLIS.unsigned_abs());
            silent.push(Silent { connection, until });
        }
    }
}

/// How long to wait for a question before the first of the silent ones is closed.
fn time_until_the_first(silent: &[Silent]) -> PollTimeout {
    let Some(first) = silent.first() else {
        return PollTimeout::NONE;
    };
    let left = first.until.saturating_duration_since(Instant::now());
    // Rounded up, so that the time is over when this returns.
    PollTimeout::try_from(left.as_millis() + 1).unwrap_or(PollTimeout::MAX)
}

/// The next connection, if it is this user's.
fn accept(listener: &OwnedFd) -> Option<OwnedFd> {
    match accept4(listener.as_raw_fd(), SockFlag::SOCK_CLOEXEC) {
        Ok(descriptor) => {
            // SAFETY: the kernel has just made it for this call.
            let connection = unsafe { OwnedFd::from_raw_fd(descriptor) };
            is_ours(&connection).then_some(connection)
        }
        // Too many open files: the connection waits, and so does this.
        Err(Errno::EMFILE | Errno::ENFILE | Errno::ENOMEM) => {
            std::thread::sleep(Duration::from_millis(50));
            None
        }
        Err(_) => None,
    }
}

/// Answers the question that has come. The other side has two seconds to take the answer.
fn answer(shared: &Shared, connection: &OwnedFd) -> Result<(), Errno> {
    set_patience(connection)?;
    let (ask, _) = receive::<GpuAsk>(connection.as_fd())?;
    let (answer, descriptor) = shared.answer(&ask);
    let descriptor = descriptor.as_ref().map(|it| it.as_fd());
    send(connection.as_fd(), &answer, descriptor)
}

impl Shared {
    fn answer(&self, ask: &GpuAsk) -> (GpuAnswer, Option<OwnedFd>) {
        let device = self.device;
        let about = |status| GpuAnswer {
            device_uuid: device.device_uuid,
            driver_uuid: device.driver_uuid,
            generation: ask.generation,
            flags: u32::from(device.is_mappable) * GpuAnswer::MAPPABLE,
            ..GpuAnswer::new(status)
        };
        if ask.magic != GPU_MAGIC || ask.schema_version != SCHEMA_VERSION {
            return (about(GpuAnswer::OTHER_SCHEMA), None);
        }
        let state = self.state();
        if ask.what == GpuAsk::TOPIC {
            let offered = ask.topic_name().and_then(|topic| state.topics.get(topic));
            let Some(Offered {
                spec,
                is_wanted,
                is_here,
            }) = offered
            else {
                return (about(GpuAnswer::NOT_MINE), None);
            };
            is_wanted.store(true, Relaxed);
            if !is_here.load(Relaxed) {
                return (about(GpuAnswer::NOT_MINE), None);
            }
            let answer = GpuAnswer {
                max_readers: spec.max_readers as u32,
                buffer: spec.buffer as u32,
                borrowed: spec.borrowed as u32,
                ..about(GpuAnswer::OK)
            };
            return (answer, None);
        }
        let memory = (ask.what == GpuAsk::MEMORY)
            .then(|| state.memories.get(&ask.generation))
            .flatten();
        let copy = memory.and_then(|memory| Some((memory, memory.descriptor.try_clone().ok()?)));
        let Some((memory, descriptor)) = copy else {
            return (about(GpuAnswer::GONE), None);
        };
        self.n_handed_out.fetch_add(1, Relaxed);
        let answer = GpuAnswer {
            memory_bytes: memory.n_bytes,
            handle_kind: memory.handle_kind,
            ..about(GpuAnswer::OK)
        };
        (answer, Some(descriptor))
    }
}
