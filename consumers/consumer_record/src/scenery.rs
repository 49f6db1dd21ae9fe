//! Objects of the map in a recording, with their boxes: an attachment `scenery.<tick>.json` when the
//! recording begins, and another one whenever the map or what of it is shown has changed.

use std::time::{Duration, Instant};

use schema_frames::scenery::SceneryObjectInfo;
use schema_frames::{Command, CommandBatch, CommandReply, ReplyBatch, SnapshotHeader};
use schema_recording::scenery::{SceneryBox, SceneryList, attachment_name};

use crate::asker::Asker;
use crate::documents::Run;
use crate::queue::Job;
use crate::sink::Sink;

/// Least time between two requests, outside lockstep and after one that failed: the whole answer is a
/// megabyte for a large town.
const FETCH_EVERY: Duration = Duration::from_millis(200);
/// Most bytes of all lists of a file: hundreds of a large town's.
const MAX_BYTES: usize = 64 << 20;

/// Follows what stands on the map of the run that a file is about.
pub(crate) struct Scenery {
    asker: Asker,
    told: Told,
}

/// What is known of the run that a file is about.
#[derive(Default)]
struct Told {
    /// First tick, and its time, from which on the newest list may not hold.
    due: Option<(u64, u64)>,
    /// Of the newest snapshot.
    episode: Option<u32>,
    /// Whether it changed while a question was out.
    is_due_again: bool,
    /// Objects of the newest list.
    filed: Option<Vec<SceneryBox>>,
    n_bytes: usize,
    not_before: Option<Instant>,
    last_failed: bool,
    /// Whether nothing more is filed: who publishes the world has no scenery, as a replay, or the
    /// lists have become too long.
    is_over: bool,
}

impl Scenery {
    /// Follows it with what `asker` asks.
    pub(crate) fn new(asker: Asker) -> Scenery {
        Scenery {
            asker,
            told: Told::default(),
        }
    }

    /// Prepares for a new file, which must hold all again.
    pub(crate) fn begin_file(&mut self) {
        self.told = Told::default();
    }

    /// Learns from a snapshot whether the scenery has changed.
    pub(crate) fn look(&mut self, header: &SnapshotHeader) {
        let told = &mut self.told;
        let is_other_map = told.episode.replace(header.episode) != Some(header.episode);
        if is_other_map || header.flags & SnapshotHeader::SCENERY_CHANGED != 0 {
            let now = (header.tick, header.sim_nanos);
            // What was asked before may be answered before it.
            told.is_due_again |= self.asker.is_out();
            told.due.get_or_insert(now);
        }
    }

    /// Asks for the scenery if it has changed, and files it if it is another one; `wait`: before the
    /// next tick, not when the answer comes. Whoever does not answer is asked again later.
    pub(crate) fn fetch_if_due(&mut self, wait: bool, run: Run, sink: &Sink) -> anyhow::Result<()> {
        if let Some(answer) = self.asker.answer() {
            self.take(answer, run, sink)?;
        }
        let told = &mut self.told;
        if told.due.is_none() || told.is_over || run.epoch == 0 {
            return Ok(());
        }
        let is_soon = told.not_before.is_some_and(|at| Instant::now() < at);
        if is_soon && (told.last_failed || !wait) {
            return Ok(());
        }
        told.not_before = Instant::now().checked_add(FETCH_EVERY);
        let question = CommandBatch::new(vec![Command::Scenery]);
        if wait {
            let answer = self.asker.ask_and_wait(question);
            self.told.is_due_again = false;
            self.take(answer, run, sink)
        } else {
            self.asker.ask(question);
            Ok(())
        }
    }

    /// Files an answer.
    fn take(
        &mut self,
        answer: anyhow::Result<ReplyBatch>,
        run: Run,
        sink: &Sink,
    ) -> anyhow::Result<()> {
        let told = &mut self.told;
        let is_due_again = std::mem::take(&mut told.is_due_again);
        let Some((tick, sim_nanos)) = told.due else {
            return Ok(());
        };
        told.last_failed = true;
        let answer = match answer {
            Ok(answer) if answer.epoch == run.epoch.to_string() => answer,
            Ok(_) => return Ok(()),
            Err(error) => {
                tracing::debug!(%error, "the scenery is not there");
                return Ok(());
            }
        };
        match answer.replies.into_iter().next() {
            Some(CommandReply::Scenery { objects, .. }) => {
                told.last_failed = false;
                if !is_due_again {
                    told.due = None;
                }
                tracing::debug!(tick, n = objects.len(), "the scenery");
                told.file(tick, sim_nanos, objects, sink)
            }
            Some(CommandReply::Refused { error }) => {
                tracing::debug!(error, "there is no scenery to record");
                told.is_over = true;
                Ok(())
            }
            _ => Ok(()),
        }
    }
}

impl Told {
    fn file(
        &mut self,
        tick: u64,
        sim_nanos: u64,
        objects: Vec<SceneryObjectInfo>,
        sink: &Sink,
    ) -> anyhow::Result<()> {
        let objects: Vec<SceneryBox> = objects.into_iter().filter_map(SceneryBox::of).collect();
        // A world that has none, as a replay, needs no list that says so.
        if self.filed.as_deref().unwrap_or_default() == objects {
            return Ok(());
        }
        let mut list = SceneryList {
            tick,
            complete: true,
            objects,
        };
        let mut data = serde_json::to_vec(&list)?;
        self.n_bytes = self.n_bytes.saturating_add(data.len());
        if self.n_bytes > MAX_BYTES {
            tracing::warn!(
                limit_bytes = MAX_BYTES,
                "the scenery has changed so often that it is no longer recorded; exports give the map's objects no boxes from here on"
            );
            self.is_over = true;
            (list.complete, list.objects) = (false, Vec::new());
            data = serde_json::to_vec(&list)?;
        }
        self.filed = Some(list.objects);
        sink.push(Job::Attach {
            name: attachment_name(tick),
            media_type: "application/json",
            data,
            log_nanos: sim_nanos,
        })
    }
}
