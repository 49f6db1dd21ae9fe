//! The writer thread: writes jobs from the queue into an MCAP file.
//!
//! It flushes the file about once a second. A crash therefore loses at most the last second.

use std::time::{Duration, Instant};

use schema_recording::write::{Recording, Written};

use crate::queue::{Job, Outlet};

/// How often the file is flushed, so that a crash loses no more than this.
pub const FLUSH_EVERY: Duration = Duration::from_secs(1);

fn write(recording: &mut Recording, job: &Job) -> anyhow::Result<()> {
    match job {
        Job::Batch(batch) => recording.write(batch),
        Job::Attach {
            name,
            media_type,
            data,
            log_nanos,
        } => recording.attach(name, media_type, data, *log_nanos),
        Job::Metadata { name, pairs } => recording.metadata(name, pairs),
    }
}

/// Writes jobs until the reading side is gone and the queue is empty, then finishes the file.
///
/// # Errors
/// If the disk refuses; the part file then holds what was flushed before.
pub fn run(mut recording: Recording, outlet: Outlet) -> anyhow::Result<Written> {
    let mut flushed = Instant::now();
    while let Ok(job) = outlet.next(FLUSH_EVERY / 4) {
        if let Some(job) = job {
            write(&mut recording, &job)?;
            give_back(&outlet, job);
        }
        if flushed.elapsed() >= FLUSH_EVERY {
            recording.flush()?;
            flushed = Instant::now();
        }
    }
    recording.finish()
}

fn give_back(outlet: &Outlet, job: Job) {
    match job {
        Job::Batch(batch) => outlet.done(
            batch.queued_bytes(),
            batch.entries.into_iter().map(|entry| entry.bytes),
        ),
        Job::Attach { data, .. } => outlet.done(data.len(), std::iter::empty()),
        Job::Metadata { .. } => {}
    }
}
