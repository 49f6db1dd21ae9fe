//! Shared memory that stays empty, and the thread that removes it.
//!
//! iceoryx2 0.10 makes shared memory in two steps: a name, then a size. Whoever opens a name without a
//! size waits for it, in a loop that ends with the size or with the name alone and looks neither at a
//! clock nor at who makes it (`dynamic_storage::posix_shared_memory::open_impl`). If its maker was
//! killed between the two steps, every process that meets the name stands still for ever: a simulator
//! that sends to a viewer which was killed, a driver that cleans up after it. A thread of each process
//! therefore removes such names.

use std::collections::BTreeMap;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use iceoryx2::config::Config;

use super::folders::{CERTAIN_AGE, Identity, Place, dead_nodes, entries, identity, process_of};
use super::ports::{SHARED_MEMORY, ids_within, processes};

/// Time between two looks at the names of shared memory.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// The thread that looks. It ends when this is dropped.
#[derive(Debug)]
pub(crate) struct Guard {
    end: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Guard {
    /// Starts it.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn start(config: &Config) -> std::io::Result<Guard> {
        let (end, ended) = channel();
        let config = config.clone();
        let thread = std::thread::Builder::new()
            .name("bus guard".into())
            .spawn(move || {
                let mut known = Known::default();
                while ended.recv_timeout(LOOK_EVERY) == Err(RecvTimeoutError::Timeout) {
                    known.look(&config);
                }
            })?;
        Ok(Guard {
            end: Some(end),
            thread: Some(thread),
        })
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        drop(self.end.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Empty names at the last look, and since when each has been known.
#[derive(Default)]
struct Known(BTreeMap<(PathBuf, Identity), Instant>);

impl Known {
    /// Removes the names whose makers are gone: at once if a port that they name is of a process whose
    /// node is dead, since nobody can use them then, not even a maker at the other end; and whatever
    /// else has been empty for some seconds, unless a process that is seen from here has it open, as
    /// one has that is stopped between the two steps.
    fn look(&mut self, config: &Config) {
        let place = Place::new(config);
        let found: Vec<PathBuf> = entries(Path::new(SHARED_MEMORY))
            .filter(|entry| place.name_within(entry, "").is_some())
            .map(|entry| entry.path())
            .filter(|path| is_empty(path))
            .collect();
        if found.is_empty() {
            self.0.clear();
            return;
        }
        let now = Instant::now();
        let mut still = BTreeMap::new();
        for path in found {
            let Some(identity) = identity(&path) else {
                continue;
            };
            let key = (path, identity);
            let since = self.0.get(&key).copied().unwrap_or(now);
            let is_given_up = is_of_the_dead(&key.0, config, &place)
                || (now - since > CERTAIN_AGE && !is_open_anywhere(&key.0));
            // A size that came meanwhile is somebody's.
            if is_given_up && is_empty(&key.0) {
                let _ = std::fs::remove_file(&key.0);
            } else {
                still.insert(key, since);
            }
        }
        self.0 = still;
    }
}

fn is_empty(path: &Path) -> bool {
    std::fs::symlink_metadata(path).is_ok_and(|about| about.is_file() && about.size() == 0)
}

/// Whether the name is of a connection of which a port's process has a dead node, or none.
fn is_of_the_dead(path: &Path, config: &Config, place: &Place) -> bool {
    let suffix = config.global.service.connection_suffix.to_string();
    let name = path.file_name().and_then(|name| name.to_str());
    let ids = name
        .and_then(|name| name.strip_prefix(&place.prefix)?.strip_suffix(&suffix))
        .and_then(|within| ids_within(within, 2));
    let Some(ids) = ids else {
        return false;
    };
    let dead: Vec<u32> = dead_nodes(config).into_iter().map(process_of).collect();
    let known = processes(place);
    ids.into_iter().map(process_of).any(|process| {
        // A process may have several nodes, of which all end with it.
        dead.contains(&process) || !known.contains(&process)
    })
}

/// Whether a process has the file open. Those that wait for its size open it for a moment each
/// millisecond, and may be met so; then the next look tells.
fn is_open_anywhere(path: &Path) -> bool {
    let open = |process: std::fs::DirEntry| {
        entries(&process.path().join("fd"))
            .any(|entry| std::fs::read_link(entry.path()).is_ok_and(|to| to == path))
    };
    entries(Path::new("/proc")).any(open)
}
