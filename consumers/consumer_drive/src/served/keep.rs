//! A file with what clients have set, from which a process that takes over after a kill goes on
//! driving the same vehicles in the same way. An orderly end removes it.

use std::io::Write as _;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use launch_cli::files::{MAX_NOTES_BYTES, read_plain};
use parking_lot::{Condvar, Mutex};

use crate::desk::{Answer, Desk, Memory};

/// Time between two writes of settings, so that scripts that set something in every tick cost little.
/// Who is driven is written at once.
const WRITE_EVERY: Duration = Duration::from_millis(50);

/// The file of one served port. A thread of its own writes it, so that no vehicle waits for a disk.
#[derive(Debug)]
pub(super) struct Record {
    path: Option<PathBuf>,
    /// What a killed process left.
    left: Option<Memory>,
    is_stale: bool,
    /// When it was last handed over to be written, and which registrations it has.
    written: Option<(Instant, u64)>,
    next: Arc<Next>,
    thread: Option<JoinHandle<()>>,
}

/// What is to be written next.
#[derive(Debug, Default)]
struct Next {
    work: Mutex<Work>,
    filled: Condvar,
}

#[derive(Default)]
struct Work {
    memory: Option<Memory>,
    /// Who is told once it is written.
    answers: Vec<Answer>,
    ends: bool,
}

impl std::fmt::Debug for Work {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let n_answers = self.answers.len();
        f.debug_struct("Work")
            .field("n_answers", &n_answers)
            .finish_non_exhaustive()
    }
}

impl Record {
    /// The record of `port` on `domain`, with what a killed process left.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn new(domain: &str, port: u16) -> anyhow::Result<Record> {
        let path = folder().map(|folder| folder.join(format!("{domain}-{port}.json")));
        Record::at(path)
    }

    fn at(path: Option<PathBuf>) -> anyhow::Result<Record> {
        let text = path
            .as_ref()
            .and_then(|path| read_plain(path, MAX_NOTES_BYTES).ok());
        let next = Arc::<Next>::default();
        let thread = match path.clone() {
            None => None,
            Some(path) => {
                let next = next.clone();
                let thread = std::thread::Builder::new()
                    .name("keep".into())
                    .spawn(move || next.write_all(&path))
                    .context("cannot start a thread")?;
                Some(thread)
            }
        };
        Ok(Record {
            left: text.and_then(|text| serde_json::from_slice(&text).ok()),
            path,
            is_stale: false,
            written: None,
            next,
            thread,
        })
    }

    /// Goes on where a killed process of this episode was.
    pub fn recall(&mut self, desk: &mut Desk) {
        let Some(memory) = self.left.take() else {
            return;
        };
        if desk.episode() == Some((memory.epoch, memory.episode)) {
            tracing::info!(
                vehicles = memory.n_registered(),
                "goes on with what clients set before this process was killed"
            );
            desk.recall(memory);
        } else if let Some(path) = &self.path {
            let _ = std::fs::remove_file(path);
        }
    }

    /// Has written what has changed, and tells those who asked. Who registered vehicles is told once
    /// that is written.
    pub fn keep(&mut self, desk: &Desk, answers: Vec<Answer>) {
        self.is_stale |= !answers.is_empty();
        let has_registered = self
            .written
            .is_none_or(|(_, registrations)| registrations != desk.revision());
        let is_due = has_registered
            || self
                .written
                .is_some_and(|(at, _)| at.elapsed() >= WRITE_EVERY);
        let memory = match self.is_stale && is_due && self.thread.is_some() {
            true => desk.memory(),
            false => None,
        };
        let Some(memory) = memory else {
            return tell(answers);
        };
        (self.is_stale, self.written) = (false, Some((Instant::now(), desk.revision())));
        let mut work = self.next.work.lock();
        work.memory = Some(memory);
        let told_now = match has_registered {
            true => {
                work.answers.extend(answers);
                Vec::new()
            }
            false => answers,
        };
        drop(work);
        self.next.filled.notify_one();
        tell(told_now);
    }

    /// Removes the file.
    pub fn remove(&mut self) {
        self.next.work.lock().ends = true;
        self.next.filled.notify_one();
        if let Some(thread) = self.thread.take() {
            // It has said why if it failed.
            let _ = thread.join();
        }
        if let Some(path) = &self.path {
            let _ = std::fs::remove_file(path);
        }
    }
}

impl Next {
    /// Writes the newest until the end, and tells those who wait for that.
    fn write_all(&self, path: &Path) {
        let mut is_broken = false;
        loop {
            let mut work = self.work.lock();
            while work.memory.is_none() && !work.ends {
                self.filled.wait(&mut work);
            }
            let (memory, answers) = (work.memory.take(), std::mem::take(&mut work.answers));
            let ends = work.ends;
            drop(work);
            if let (Some(memory), false) = (memory, is_broken)
                && let Err(error) = write(path, &memory)
            {
                tracing::warn!(path = %path.display(), %error, "cannot keep what clients set");
                is_broken = true;
            }
            tell(answers);
            if ends {
                return;
            }
        }
    }
}

fn tell(answers: Vec<Answer>) {
    answers.into_iter().for_each(|tell| tell());
}

/// Replaces the file as a whole: a kill while writing leaves the former one.
fn write(path: &Path, memory: &Memory) -> std::io::Result<()> {
    let next = path.with_extension("next");
    let mut file = std::fs::OpenOptions::new()
        .write(true)
        .create(true)
        .truncate(true)
        .mode(0o600)
        .open(&next)?;
    file.write_all(&serde_json::to_vec(memory)?)?;
    std::fs::rename(next, path)
}

/// A folder for temporary files that only this user can read or write; `None` if it is somebody
/// else's.
fn folder() -> Option<PathBuf> {
    let ours = std::fs::metadata("/proc/self").ok()?.uid();
    let folder = std::env::temp_dir().join(format!("gantry-drive-{ours}"));
    let made = std::fs::DirBuilder::new()
        .recursive(true)
        .mode(0o700)
        .create(&folder);
    let found = std::fs::symlink_metadata(&folder).ok()?;
    let is_ours = found.is_dir() && found.uid() == ours && found.mode() & 0o077 == 0;
    (made.is_ok() && is_ours).then_some(folder)
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;
    use crate::desk::Start;

    /// A pipe in place of the file keeps its writer waiting, as a slow disk does.
    #[test]
    fn a_slow_disk_delays_registrations_and_no_driving() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("town-8000.json");
        let pipe = path.with_extension("next");
        nix::unistd::mkfifo(&pipe, nix::sys::stat::Mode::S_IRWXU).unwrap();
        let mut record = Record::at(Some(path.clone())).unwrap();
        let mut desk = Desk::new(Start::default());
        desk.set_episode(1, 1);
        desk.register(&[7]);
        let (told, heard) = channel();
        let answer = |n: u32| -> Vec<Answer> {
            let told = told.clone();
            vec![Box::new(move || told.send(n).unwrap())]
        };
        record.keep(&desk, answer(1));
        // The registration waits in vain; what else is set does not.
        record.keep(&desk, answer(2));
        assert_eq!(heard.recv(), Ok(2));
        assert!(heard.try_recv().is_err());
        let text = std::fs::read_to_string(&pipe).unwrap();
        assert!(text.contains("\"registered\":[7]"), "{text}");
        assert_eq!(heard.recv(), Ok(1));
        record.remove();
        assert!(!path.exists());
    }

    #[test]
    fn what_a_killed_process_left_is_taken_over() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("town-8000.json");
        let mut desk = Desk::new(Start::default());
        desk.set_episode(1, 1);
        desk.register(&[7]);
        let (told, heard) = channel();
        let mut killed = Record::at(Some(path.clone())).unwrap();
        killed.keep(&desk, vec![Box::new(move || told.send(()).unwrap())]);
        heard.recv().unwrap();
        let mut next = Record::at(Some(path.clone())).unwrap();
        let mut desk = Desk::new(Start::default());
        desk.set_episode(1, 1);
        next.recall(&mut desk);
        assert_eq!(desk.registered().collect::<Vec<_>>(), [7]);
        next.remove();
        killed.remove();
        assert!(!path.exists(), "an orderly end leaves nothing");
    }
}
