//! A recording in memory: the newest seconds, written when something has happened.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;

use schema_recording::messages::Batch;
use schema_recording::write::{ChunkCompression, Recording, Written};

use crate::context::Context;
use crate::dump::{DumpRequest, Dumped, NotDumped};
use crate::files::file_of_set;
use crate::options::{self, KEY_EVERY_NANOS};
use crate::queue::Job;

/// The newest batches, and what a file of them must hold besides.
pub struct Ring {
    base: PathBuf,
    compression: ChunkCompression,
    settings: options::Ring,
    on_seconds: bool,
    /// What holds at the oldest batch.
    context: Context,
    batches: VecDeque<Arc<Batch>>,
    n_bytes: usize,
    n_dumps: u32,
    running: Vec<JoinHandle<Option<(PathBuf, Written)>>>,
    finished: Vec<(PathBuf, Written)>,
}

/// Memory of a message beside its bytes.
const ENTRY_BYTES: usize = 128;

fn bytes_of(batch: &Batch) -> usize {
    let entries = batch.entries.iter();
    let bytes = entries.flat_map(|it| [it.bytes.capacity(), ENTRY_BYTES]);
    bytes.chain([ENTRY_BYTES]).sum()
}

impl Ring {
    /// An empty one; dumps are called `base_0001` and so on.
    pub fn new(base: &Path, compression: ChunkCompression, settings: options::Ring) -> Ring {
        Ring {
            base: base.to_path_buf(),
            compression,
            settings,
            on_seconds: false,
            context: Context::default(),
            batches: VecDeque::new(),
            n_bytes: 0,
            n_dumps: 0,
            running: Vec::new(),
            finished: Vec::new(),
        }
    }

    /// Lets what is kept begin at a whole simulated second, where videos have key frames.
    pub fn on_seconds(self, on_seconds: bool) -> Ring {
        Ring { on_seconds, ..self }
    }

    /// Takes a job in; the oldest is forgotten.
    pub(crate) fn take(&mut self, job: Job) {
        match job {
            Job::Batch(mut batch) => {
                // A buffer that was used before may be much larger than what is in it.
                for entry in &mut batch.entries {
                    entry.bytes.shrink_to_fit();
                }
                self.n_bytes = self.n_bytes.saturating_add(bytes_of(&batch));
                self.batches.push_back(Arc::new(batch));
                self.forget();
            }
            Job::Frame(_) => {}
            Job::Attach {
                name,
                media_type,
                data,
                log_nanos,
            } => self.context.attach(&name, media_type, &data, log_nanos),
            Job::Metadata { name, pairs } => self.context.metadata(&name, &pairs),
        }
    }

    fn forget(&mut self) {
        let newest = self.batches.back().map_or(0, |batch| batch.log_nanos);
        let step_of = |nanos: u64| match self.on_seconds {
            true => nanos / KEY_EVERY_NANOS,
            false => nanos,
        };
        let oldest_kept = step_of(newest.saturating_sub(self.settings.keep_nanos));
        // Of a second that does not fit nothing is kept.
        let mut forgotten = None;
        while let Some(oldest) = self.batches.front() {
            let second = step_of(oldest.log_nanos);
            let is_old = second < oldest_kept || (self.on_seconds && forgotten >= Some(second));
            if !is_old && self.n_bytes <= self.settings.max_bytes {
                break;
            }
            self.n_bytes = self.n_bytes.saturating_sub(bytes_of(oldest));
            self.context.batch(oldest);
            forgotten = forgotten.max(Some(second));
            self.batches.pop_front();
        }
    }

    /// Begins to write what it holds, on a thread of its own; the answer says what came of it.
    pub(crate) fn dump(&mut self, request: DumpRequest) {
        // Numbers whose files are there are passed over.
        self.n_dumps = self.n_dumps.wrapping_add(1);
        let mut path = file_of_set(&self.base, self.n_dumps);
        while path.exists() || schema_recording::write::part_path(&path).exists() {
            self.n_dumps = self.n_dumps.wrapping_add(1);
            path = file_of_set(&self.base, self.n_dumps);
        }
        let (context, batches) = (self.context.clone(), self.batches.clone());
        let (compression, keep_nanos) = (self.compression, self.settings.keep_nanos);
        let work = move || {
            let outcome = write_dump(&path, compression, &context, &batches, &request.note);
            let said = match &outcome {
                Ok(written) => Ok(dumped(&path, &batches, written, keep_nanos)),
                Err(error) => Err(NotDumped(format!("{error:#}"))),
            };
            match &said {
                Ok(done) => tracing::info!(file = %done.file, secs = done.secs, "dumped"),
                Err(error) => tracing::error!(%error, "cannot dump"),
            }
            request.answer(said);
            outcome.ok().map(|written| (path, written))
        };
        match std::thread::Builder::new().name("dump".into()).spawn(work) {
            Ok(thread) => self.running.push(thread),
            Err(error) => tracing::error!(%error, "cannot start the thread that dumps"),
        }
        self.collect(false);
    }

    fn collect(&mut self, wait: bool) {
        let (ended, running): (Vec<_>, Vec<_>) = std::mem::take(&mut self.running)
            .into_iter()
            .partition(|thread| wait || thread.is_finished());
        self.running = running;
        let files = ended.into_iter().filter_map(|thread| thread.join().ok());
        self.finished.extend(files.flatten());
    }

    /// Writes what it holds if that is wanted at the end, and waits for every dump.
    pub(crate) fn finish(mut self) -> anyhow::Result<Vec<(PathBuf, Written)>> {
        let n_before = self.n_dumps;
        if self.settings.dump_at_end && !self.batches.is_empty() {
            self.dump(DumpRequest::new("the recording ended").0);
        }
        self.collect(true);
        anyhow::ensure!(
            self.n_dumps == n_before || !self.finished.is_empty(),
            "the ring could not be written at the end"
        );
        Ok(self.finished)
    }
}

fn write_dump(
    path: &Path,
    compression: ChunkCompression,
    context: &Context,
    batches: &VecDeque<Arc<Batch>>,
    note: &str,
) -> anyhow::Result<Written> {
    anyhow::ensure!(
        !batches.is_empty(),
        "nothing was recorded yet, so there is nothing to dump"
    );
    let mut recording = Recording::create(path, compression)?;
    let first = batches.front().map_or(0, |batch| batch.log_nanos);
    recording.metadata("dump", &[("note".to_string(), note.to_string())].into())?;
    context.write(&mut recording, first)?;
    for batch in batches {
        recording.write(batch)?;
    }
    recording.finish()
}

fn dumped(
    path: &Path,
    batches: &VecDeque<Arc<Batch>>,
    written: &Written,
    keep_nanos: u64,
) -> Dumped {
    let nanos = |batch: Option<&Arc<Batch>>| batch.map_or(0, |batch| batch.log_nanos);
    let span = nanos(batches.back()).saturating_sub(nanos(batches.front()));
    Dumped {
        file: path.display().to_string(),
        n_messages: written.messages.values().sum(),
        file_bytes: written.file_bytes,
        secs: span as f64 * 1e-9,
        keep_secs: keep_nanos as f64 * 1e-9,
    }
}
