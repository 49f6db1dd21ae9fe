//! The threads behind the queue: coders, and the writer, which brings jobs into files or the ring in
//! their order.
//!
//! About once a second the writer flushes the file and has it brought to the disk. A crash of the
//! recorder therefore loses at most the last second, and a loss of power what was on its way.

use std::path::PathBuf;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use schema_recording::write::Written;

use crate::coder::FrameCoder;
use crate::files::{FLUSH_EVERY, Files};
use crate::options::Coding;
use crate::queue::{Closed, Job, Outlet, Workbench};
use crate::ring::Ring;
use crate::stages;

/// How often requests to dump are looked for while nothing arrives.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// How often it is looked whether a file is to be flushed: a quarter of [`FLUSH_EVERY`].
const LOOK_AT_FLUSH_EVERY: Duration = Duration::from_millis(250);

/// Where jobs go.
pub enum Target {
    /// Into files.
    Files(Box<Files>),
    /// Into memory.
    Ring(
        Box<Ring>,
        crossbeam_channel::Receiver<crate::dump::DumpRequest>,
    ),
}

/// Starts the coding threads; they end with the reading side.
///
/// # Errors
/// If a thread cannot be started.
pub fn start_coders(bench: &Workbench, coding: Coding) -> anyhow::Result<Vec<JoinHandle<()>>> {
    let mut coders = Vec::new();
    if coding.is_plain() {
        return Ok(coders);
    }
    if coding.video_qp.is_some() {
        bench.keep_colour_in_order();
    }
    let first = FrameCoder::new(coding).context("cannot set up the codecs")?;
    for _ in 0..coding.threads() {
        let bench = bench.clone();
        let mut coder = first.another().context("cannot set up the codecs")?;
        let thread = std::thread::Builder::new()
            .name("coder".to_string())
            .spawn(move || {
                bench.run(|job, second, reuse| {
                    coder.entries_in(second, &job.name, &job.header, &job.payload, reuse)
                });
            })
            .context("cannot start a coding thread")?;
        coders.push(thread);
    }
    Ok(coders)
}

/// Writes jobs until the reading side is gone and the queue is empty, then finishes the files.
///
/// # Errors
/// If the disk refuses; the part file then holds what was flushed before.
pub fn run(target: Target, outlet: Outlet) -> anyhow::Result<Vec<(PathBuf, Written)>> {
    match target {
        Target::Files(files) => into_files(*files, &outlet),
        Target::Ring(ring, requests) => into_ring(*ring, &requests, &outlet),
    }
}

fn into_files(mut files: Files, outlet: &Outlet) -> anyhow::Result<Vec<(PathBuf, Written)>> {
    let mut flushed = Instant::now();
    loop {
        match outlet.next(LOOK_AT_FLUSH_EVERY) {
            Ok(Some(job)) => {
                let span = stages::WRITE.span();
                files.write(&job)?;
                drop(span);
                give_back(outlet, job);
            }
            Ok(None) => {}
            Err(Closed::Empty) => return files.finish(),
            Err(Closed::CoderLost) => bail!(CODER_LOST),
        }
        if flushed.elapsed() >= FLUSH_EVERY {
            let _span = stages::WRITE.span();
            files.flush()?;
            flushed = Instant::now();
        }
    }
}

const CODER_LOST: &str = "a coding thread panicked; what was flushed before stays in the part file";

fn into_ring(
    mut ring: Ring,
    requests: &crossbeam_channel::Receiver<crate::dump::DumpRequest>,
    outlet: &Outlet,
) -> anyhow::Result<Vec<(PathBuf, Written)>> {
    loop {
        match outlet.next(LOOK_EVERY) {
            Ok(Some(job)) => {
                let n_bytes = match &job {
                    Job::Batch(batch) => batch.queued_bytes(),
                    Job::Attach { data, .. } => data.len(),
                    Job::Frame(_) | Job::Metadata { .. } => 0,
                };
                ring.take(job);
                outlet.done(n_bytes, std::iter::empty());
            }
            Ok(None) => {}
            Err(Closed::Empty) => return ring.finish(),
            Err(Closed::CoderLost) => bail!(CODER_LOST),
        }
        if let Ok(request) = requests.try_recv() {
            ring.dump(request);
        }
    }
}

fn give_back(outlet: &Outlet, job: Job) {
    match job {
        Job::Batch(batch) => outlet.done(
            batch.queued_bytes(),
            batch.entries.into_iter().map(|entry| entry.bytes),
        ),
        Job::Attach { data, .. } => outlet.done(data.len(), std::iter::empty()),
        Job::Frame(_) | Job::Metadata { .. } => {}
    }
}
