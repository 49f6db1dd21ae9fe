//! Where a recording goes: a file with its writer thread, the queue before it, and counts of what
//! did not fit.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::thread::JoinHandle;

use anyhow::{Context, anyhow};
use consumer_kit::file_of_run;
use schema_bus::mono_now;
use schema_frames::FrameHeader;
use schema_types::class::CLASSES;

use crate::files::Files;
use crate::options::Options;
use crate::queue::{FrameJob, Job, Payload, Queue, Refused, queue};
use crate::ring::Ring;
use crate::writer::{Target, run, start_coders};
use consumer_forms::foxglove::frames::TopicName;
use schema_recording::messages::{Batch, Entry};
use schema_recording::write::Written;

/// Frames of one topic that are not in the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Loss {
    /// Overwritten on the bus before the recorder took them.
    pub on_the_bus: u64,
    /// Taken, but the queue was full.
    pub queue_full: u64,
    /// Refused because they broke the contract.
    pub refused: u64,
}

impl Loss {
    /// All of them.
    pub fn total(&self) -> u64 {
        [self.on_the_bus, self.queue_full, self.refused]
            .iter()
            .sum()
    }

    /// Adds what a reader has counted.
    pub(crate) fn on_bus(&mut self, lost: u64, refused: u64) {
        self.on_the_bus = self.on_the_bus.saturating_add(lost);
        self.refused = self.refused.saturating_add(refused);
    }
}

/// What a run of the simulator is written to, and the thread that writes it.
pub(crate) struct Output {
    pub(crate) path: PathBuf,
    pub(crate) queue: Queue,
    pub(crate) writer: JoinHandle<anyhow::Result<Vec<(PathBuf, Written)>>>,
    coders: Vec<JoinHandle<()>>,
}

impl Output {
    /// What a run of the simulator is written to; runs are counted from 1.
    pub(crate) fn create(options: &Options, run_number: u32) -> anyhow::Result<Output> {
        let base = file_of_run(&options.out, run_number);
        let on_seconds = options.coding.video_qp.is_some();
        let (path, target) = match &options.ring {
            Some(ring) => {
                let requests = ring.requests.clone();
                let ring =
                    Ring::new(&base, options.compression, ring.clone()).on_seconds(on_seconds);
                (base, Target::Ring(Box::new(ring), requests))
            }
            None => {
                let files = Files::create(&base, options.compression, options.split)?
                    .on_seconds(on_seconds);
                (files.path(), Target::Files(Box::new(files)))
            }
        };
        let (queue, bench, outlet) = queue(options.queue_bytes);
        let coders = start_coders(&bench, options.coding)?;
        let writer = std::thread::Builder::new()
            .name("writer".to_string())
            .spawn(move || run(target, outlet));
        let output = Output {
            path,
            queue,
            writer: writer.context("cannot start the writer thread")?,
            coders,
        };
        output.push(file_metadata(&options.domain))?;
        output.push(class_metadata())?;
        Ok(output)
    }

    pub(crate) fn push(&self, job: Job) -> anyhow::Result<()> {
        self.queue.push(job).map_err(|_| writer_ended())
    }

    pub(crate) fn finish(
        self,
        losses: BTreeMap<String, String>,
    ) -> anyhow::Result<Vec<(PathBuf, Written)>> {
        // If the writer has ended already, its own error follows.
        let _ = self.push(Job::Metadata {
            name: "losses".to_string(),
            pairs: losses,
        });
        drop(self.queue);
        let written = self.writer.join();
        // They hold no frame of the simulator any more. One that panicked is the writer's error.
        for coder in self.coders {
            let _ = coder.join();
        }
        let written = written.map_err(|_| {
            anyhow!("the writer thread panicked; the part file holds what was flushed before")
        })?;
        written.context(
            "the recording could not be written to its end; what was flushed stays in the part file",
        )
    }
}

/// Sends batches to the current file and counts what does not fit.
pub(crate) struct Sink {
    pub(crate) output: Option<Output>,
    /// Runs of the simulator so far.
    pub(crate) n_runs: u32,
    pub(crate) finished: Vec<(PathBuf, Written)>,
    pub(crate) wait: bool,
    pub(crate) wall_minus_mono_nanos: i128,
    pub(crate) recorded: BTreeMap<String, u64>,
    pub(crate) full: BTreeMap<String, u64>,
    pub(crate) full_said: bool,
}

impl Sink {
    /// Queues the messages of one sample. In lockstep it waits for room; otherwise it counts
    /// samples that do not fit.
    pub(crate) fn put(
        &mut self,
        source: &std::sync::Arc<str>,
        sequence: u64,
        log_nanos: u64,
        mono_nanos: u64,
        entries: Vec<Entry>,
    ) -> anyhow::Result<()> {
        let batch = Batch {
            source: source.clone(),
            sequence: sequence as u32,
            log_nanos,
            publish_nanos: self.wall_nanos(mono_nanos),
            entries,
        };
        self.queue(source, Job::Batch(batch))
    }

    /// Queues a frame that is to be coded, with the messages that go with it.
    pub(crate) fn put_frame(
        &mut self,
        source: &std::sync::Arc<str>,
        name: &std::sync::Arc<TopicName>,
        header: &FrameHeader,
        payload: Payload,
        extras: Vec<Entry>,
    ) -> anyhow::Result<()> {
        let job = FrameJob {
            batch: Batch {
                source: source.clone(),
                sequence: header.seq as u32,
                log_nanos: header.sim_nanos,
                publish_nanos: self.wall_nanos(header.published_mono_nanos),
                entries: extras,
            },
            name: name.clone(),
            header: *header,
            payload,
        };
        self.queue(source, Job::Frame(Box::new(job)))
    }

    fn queue(&mut self, source: &std::sync::Arc<str>, job: Job) -> anyhow::Result<()> {
        let output = self.output.as_ref().ok_or_else(writer_ended)?;
        let outcome = if self.wait {
            output.queue.push(job)
        } else {
            output.queue.offer(job)
        };
        match outcome {
            Ok(()) => count(&mut self.recorded, source),
            Err(Refused::Full(_)) => {
                count(&mut self.full, source);
                if !std::mem::replace(&mut self.full_said, true) {
                    let waiting_mb = output.queue.waiting_bytes() >> 20;
                    tracing::warn!(
                        source = &**source,
                        waiting_mb,
                        "the disk or the codecs are too slow: frames are dropped; try fewer --topics, more --threads, --codec none or a larger --queue-mb"
                    );
                }
            }
            Err(Refused::Closed) => return Err(writer_ended()),
        }
        Ok(())
    }

    pub(crate) fn push(&self, job: Job) -> anyhow::Result<()> {
        self.output.as_ref().ok_or_else(writer_ended)?.push(job)
    }

    pub(crate) fn buffer(&self, n_bytes: usize) -> Vec<u8> {
        self.output
            .as_ref()
            .map_or_else(Vec::new, |output| output.queue.buffer(n_bytes))
    }

    pub(crate) fn finish(&mut self, lost: &BTreeMap<String, Loss>) -> anyhow::Result<()> {
        if let Some(output) = self.output.take() {
            let losses = lost
                .iter()
                .map(|(topic, loss)| (topic.clone(), loss.total().to_string()))
                .collect();
            self.finished.extend(output.finish(losses)?);
        }
        Ok(())
    }

    pub(crate) fn wall_nanos(&self, mono_nanos: u64) -> u64 {
        let wall_nanos = i128::from(mono_nanos).saturating_add(self.wall_minus_mono_nanos);
        u64::try_from(wall_nanos).unwrap_or(0)
    }
}

fn count(frames: &mut BTreeMap<String, u64>, topic: &str) {
    let n = frames.entry(topic.to_owned()).or_insert(0);
    *n = n.saturating_add(1);
}

fn writer_ended() -> anyhow::Error {
    anyhow!("the writer has ended")
}

pub(crate) fn wall_minus_mono_nanos() -> anyhow::Result<i128> {
    let wall = nix::time::clock_gettime(nix::time::ClockId::CLOCK_REALTIME)
        .context("cannot read the wall clock")?;
    let secs_nanos = (wall.tv_sec() as i128).saturating_mul(1_000_000_000);
    let wall_nanos = secs_nanos.saturating_add(wall.tv_nsec() as i128);
    Ok(wall_nanos.saturating_sub(mono_now().0 as i128))
}

fn file_metadata(domain: &str) -> Job {
    let pairs = [
        ("domain", domain.to_string()),
        (
            "recorder",
            concat!("gantry-record ", env!("CARGO_PKG_VERSION")).to_string(),
        ),
        ("schema_version", schema_frames::SCHEMA_VERSION.to_string()),
        (
            "log_time",
            "simulated nanoseconds since the simulator started".to_string(),
        ),
        (
            "publish_time",
            "the publisher's wall clock, nanoseconds since 1970".to_string(),
        ),
    ];
    Job::Metadata {
        name: "gantry".to_string(),
        pairs: pairs.map(|(key, value)| (key.to_string(), value)).into(),
    }
}

fn class_metadata() -> Job {
    let pairs = CLASSES
        .iter()
        .enumerate()
        .map(|(number, info)| (number.to_string(), info.name.to_string()))
        .collect();
    Job::Metadata {
        name: "classes".to_string(),
        pairs,
    }
}
