//! The files of a recording: one, or a set of which each is complete in itself.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::Context as _;
use crossbeam_channel::{Sender, TrySendError, bounded};
use schema_recording::messages::Batch;
use schema_recording::write::{ChunkCompression, Recording, Written};

use crate::context::Context;
use crate::options::{KEY_EVERY_NANOS, Split};
use crate::queue::Job;
use crate::stages;

/// Metadata record at the beginning of a file of a set.
pub const SET: &str = "set";
/// Metadata record at the end of a file of a set.
pub const SET_END: &str = "set_end";

/// `drive_0003.mcap`, file 3 of the set `drive.mcap`.
pub fn file_of_set(path: &Path, part: u32) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let extension = path
        .extension()
        .map_or(String::new(), |it| format!(".{}", it.to_string_lossy()));
    path.with_file_name(format!("{stem}_{part:04}{extension}"))
}

/// Where jobs are written.
pub struct Files {
    base: PathBuf,
    compression: ChunkCompression,
    split: Split,
    on_seconds: bool,
    set: String,
    part: u32,
    current: Recording,
    syncer: Syncer,
    context: Context,
    first_nanos: Option<u64>,
    last_nanos: u64,
    finished: Vec<(PathBuf, Written)>,
}

impl Files {
    /// Creates the first file.
    ///
    /// # Errors
    /// If it exists already or cannot be made.
    pub fn create(
        base: &Path,
        compression: ChunkCompression,
        split: Split,
    ) -> anyhow::Result<Files> {
        let path = match split.is_on() {
            true => file_of_set(base, 1),
            false => base.to_path_buf(),
        };
        let current = Recording::create(&path, compression)?;
        let mut files = Files {
            base: base.to_path_buf(),
            compression,
            split,
            on_seconds: false,
            set: new_set(),
            part: 1,
            syncer: Syncer::start(current.file()?)?,
            current,
            context: Context::default(),
            first_nanos: None,
            last_nanos: 0,
            finished: Vec::new(),
        };
        if split.is_on() {
            files.begin_part("")?;
        }
        Ok(files)
    }

    /// Lets every further file begin at a whole simulated second, where videos have key frames.
    pub fn on_seconds(self, on_seconds: bool) -> Files {
        Files { on_seconds, ..self }
    }

    /// Path of the file that is being written.
    pub(crate) fn path(&self) -> PathBuf {
        match self.split.is_on() {
            true => file_of_set(&self.base, self.part),
            false => self.base.clone(),
        }
    }

    /// Writes a job.
    ///
    /// # Errors
    /// If the disk refuses.
    pub(crate) fn write(&mut self, job: &Job) -> anyhow::Result<()> {
        match job {
            Job::Batch(batch) => self.batch(batch),
            Job::Frame(_) => Ok(()),
            Job::Attach {
                name,
                media_type,
                data,
                log_nanos,
            } => {
                if self.split.is_on() {
                    self.context.attach(name, media_type, data, *log_nanos);
                }
                self.current.attach(name, media_type, data, *log_nanos)
            }
            Job::Metadata { name, pairs } => {
                if self.split.is_on() {
                    self.context.metadata(name, pairs);
                }
                self.current.metadata(name, pairs)
            }
        }
    }

    fn batch(&mut self, batch: &Batch) -> anyhow::Result<()> {
        if self.split.is_on() {
            let is_later = match self.on_seconds {
                true => batch.log_nanos / KEY_EVERY_NANOS > self.last_nanos / KEY_EVERY_NANOS,
                false => batch.log_nanos > self.last_nanos,
            };
            if is_later && self.is_due(batch.log_nanos)? {
                self.next_part(batch.log_nanos)?;
            }
            self.context.batch(batch);
            self.first_nanos.get_or_insert(batch.log_nanos);
            self.last_nanos = self.last_nanos.max(batch.log_nanos);
        }
        self.current.write(batch)
    }

    fn is_due(&self, now_nanos: u64) -> anyhow::Result<bool> {
        let Some(first) = self.first_nanos else {
            return Ok(false);
        };
        // Files of seconds last whole seconds, whenever the first message of one came.
        let first = match self.on_seconds {
            true => first.saturating_sub(first % KEY_EVERY_NANOS),
            false => first,
        };
        let by_time = self.split.max_sim_nanos;
        if by_time.is_some_and(|max| now_nanos.saturating_sub(first) >= max) {
            return Ok(true);
        }
        Ok(match self.split.max_bytes {
            Some(max) => self.current.bytes()? >= max,
            None => false,
        })
    }

    fn next_part(&mut self, now_nanos: u64) -> anyhow::Result<()> {
        let previous = self.path();
        self.part = self.part.saturating_add(1);
        let next = Recording::create(&self.path(), self.compression)?;
        let mut done = std::mem::replace(&mut self.current, next);
        self.end_part(&mut done, &name_of(&self.path()))?;
        self.syncer = Syncer::start(self.current.file()?)?;
        self.finished.push((previous.clone(), done.finish()?));
        tracing::info!(file = %self.path().display(), "the next file of the set");
        self.first_nanos = None;
        self.begin_part(&name_of(&previous))?;
        self.context.write(&mut self.current, now_nanos)
    }

    fn begin_part(&mut self, previous: &str) -> anyhow::Result<()> {
        let pairs = [
            ("set", self.set.clone()),
            ("part", self.part.to_string()),
            ("previous", previous.to_string()),
        ];
        self.current.metadata(SET, &owned(pairs))
    }

    fn end_part(&self, done: &mut Recording, next: &str) -> anyhow::Result<()> {
        let pairs = [("set", self.set.clone()), ("next", next.to_string())];
        done.metadata(SET_END, &owned(pairs))
    }

    /// Hands what was written to the operating system, and asks it to bring it to the disk.
    ///
    /// # Errors
    /// If the disk refuses.
    pub(crate) fn flush(&mut self) -> anyhow::Result<()> {
        self.current.flush()?;
        self.syncer.sync()
    }

    /// Finishes the last file.
    ///
    /// # Errors
    /// If the disk refuses; the part file then holds what was flushed before.
    pub(crate) fn finish(mut self) -> anyhow::Result<Vec<(PathBuf, Written)>> {
        let path = self.path();
        let mut finished = std::mem::take(&mut self.finished);
        let mut last = self.current;
        if self.split.is_on() {
            let pairs = [("set", self.set.clone()), ("next", String::new())];
            last.metadata(SET_END, &owned(pairs))?;
        }
        finished.push((path, last.finish()?));
        Ok(finished)
    }
}

fn owned<const N: usize>(pairs: [(&str, String); N]) -> BTreeMap<String, String> {
    pairs
        .map(|(key, value)| (key.to_string(), value))
        .into_iter()
        .collect()
}

fn name_of(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// A name that no other set has: when it began, and by whom.
fn new_set() -> String {
    let now = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .unwrap_or_default();
    format!("{:x}-{:x}", now.as_nanos(), std::process::id())
}

/// Brings a file to the disk on a thread of its own, so that writing goes on meanwhile.
struct Syncer {
    requests: Option<Sender<()>>,
    thread: Option<JoinHandle<std::io::Result<()>>>,
}

impl Syncer {
    fn start(file: File) -> anyhow::Result<Syncer> {
        let (requests, asked) = bounded::<()>(1);
        let thread = std::thread::Builder::new()
            .name("sync".to_string())
            .spawn(move || {
                asked.iter().try_for_each(|()| {
                    let _span = stages::SYNC.span();
                    file.sync_data()
                })
            })
            .context("cannot start the thread that brings the file to the disk")?;
        Ok(Syncer {
            requests: Some(requests),
            thread: Some(thread),
        })
    }

    /// Asks for what was written to be brought to the disk; a request that waits stands for both.
    fn sync(&mut self) -> anyhow::Result<()> {
        let Some(requests) = &self.requests else {
            return Ok(());
        };
        if let Err(TrySendError::Disconnected(())) = requests.try_send(()) {
            let outcome = self.thread.take().and_then(|thread| thread.join().ok());
            outcome
                .unwrap_or(Ok(()))
                .context("cannot write to the disk")?;
        }
        Ok(())
    }
}

impl Drop for Syncer {
    fn drop(&mut self) {
        self.requests = None;
        // What it was about to sync is synced again when the file is finished.
        drop(self.thread.take().map(JoinHandle::join));
    }
}

/// How often a file is flushed and brought to the disk, so that a crash loses no more than this.
pub const FLUSH_EVERY: Duration = Duration::from_secs(1);
