//! The simulator's journal in a recording: everything that acted on its world, so that the run can
//! be made again. Whenever it is fetched, what is new becomes a message on `/control/journal`; a
//! file's first message holds the head, and its entries go back to the beginning of the run.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use schema_bus::mono_now;
use schema_frames::{
    Command, CommandBatch, CommandReply, JournalAct, JournalEntry, JournalHead, ReplyBatch,
};
use schema_recording::journal::{JOURNAL_CHANNEL, Piece};
use schema_recording::messages::{Batch, Content, Entry};

use crate::asker::Asker;
use crate::documents::Run;
use crate::queue::{Job, Refused};
use crate::sink::Sink;

/// How often it is fetched outside lockstep.
const FETCH_EVERY: Duration = Duration::from_millis(200);

/// Follows the journal of the run that a file is about.
pub(crate) struct Journal {
    asker: Asker,
    told: Told,
    /// Whether entries since [`Journal::made_topics`] tell of new topics.
    has_new_topics: bool,
}

/// What the file has of it.
#[derive(Default)]
struct Told {
    /// Number of the last entry that is in the file.
    after: u64,
    /// What it was when the question that is out was asked.
    asked: Option<u64>,
    has_head: bool,
    n_messages: u64,
    last_fetch: Option<Instant>,
    /// Whether who publishes the world keeps no journal, as a replay.
    is_absent: bool,
}

impl Journal {
    /// Follows it with what `asker` asks.
    pub(crate) fn new(asker: Asker) -> Journal {
        Journal {
            asker,
            told: Told::default(),
            has_new_topics: false,
        }
    }

    /// Whether a command has made topics, as far as the journal was taken since the last call.
    pub(crate) fn made_topics(&mut self) -> bool {
        std::mem::take(&mut self.has_new_topics)
    }

    /// Prepares for a new file, which must hold the journal from its beginning.
    pub(crate) fn begin_file(&mut self) {
        self.told = Told::default();
    }

    /// What to ask for next.
    pub(crate) fn question(&self) -> CommandBatch {
        let question = match self.told.is_absent {
            true => Command::Ping,
            false => Command::Journal {
                after: self.told.after,
            },
        };
        CommandBatch::new(vec![question])
    }

    /// Outside lockstep: fetches what is new several times a second, without waiting for it.
    pub(crate) fn fetch_if_due(&mut self, run: Run, sink: &mut Sink) -> anyhow::Result<()> {
        let mut is_more = false;
        match self.asker.answer() {
            // In lockstep others ask as well, so that it may be old.
            Some(Ok(answer)) if self.told.asked == Some(self.told.after) => {
                is_more = self.take(&answer, run, sink)?;
            }
            Some(Ok(_)) => is_more = true,
            Some(Err(error)) => tracing::debug!(%error, "the journal is not there"),
            None => {}
        }
        let last = self.told.last_fetch;
        let is_due = is_more || last.is_none_or(|at| at.elapsed() >= FETCH_EVERY);
        if is_due && !self.told.is_absent && run.epoch != 0 && !self.asker.is_out() {
            self.told.last_fetch = Some(Instant::now());
            self.told.asked = Some(self.told.after);
            self.asker.ask(self.question());
        }
        Ok(())
    }

    /// Fetches everything that is new. A simulator that has gone has nothing more to say.
    pub(crate) fn fetch(&mut self, run: Run, sink: &mut Sink) -> anyhow::Result<()> {
        while !self.told.is_absent && run.epoch != 0 {
            match self.asker.ask_and_wait(self.question()) {
                Ok(answer) => {
                    if !self.take(&answer, run, sink)? {
                        break;
                    }
                }
                Err(error) => {
                    tracing::debug!(%error, "the journal is not there");
                    break;
                }
            }
        }
        Ok(())
    }

    /// Takes an answer to [`Journal::question`] over into the file; returns whether to ask again at
    /// once.
    pub(crate) fn take(
        &mut self,
        answer: &ReplyBatch,
        run: Run,
        sink: &mut Sink,
    ) -> anyhow::Result<bool> {
        if answer.epoch != run.epoch.to_string() {
            return Ok(false);
        }
        match answer.replies.first() {
            Some(CommandReply::Journal {
                head,
                first,
                entries,
                next,
                more,
            }) => {
                if !self.told.has_head {
                    let Some(head) = head else {
                        return Ok(false);
                    };
                    tell_run(head, *first, sink)?;
                    self.told.has_head = true;
                }
                if self.put(head.as_deref(), answer.tick, entries, run, sink)? {
                    self.told.after = *next;
                    self.has_new_topics |= entries.iter().any(makes_topics);
                    return Ok(*more);
                }
                Ok(false)
            }
            Some(CommandReply::Refused { error }) if !self.told.is_absent => {
                self.told.is_absent = true;
                let why = format!("cannot be run again: {error}");
                sink.push(metadata(BTreeMap::from([("rerun".to_owned(), why)])))?;
                Ok(false)
            }
            _ => Ok(false),
        }
    }

    /// Queues a message; `false` if there was no room, and then it must be fetched again.
    fn put(
        &mut self,
        head: Option<&JournalHead>,
        tick: u64,
        entries: &[JournalEntry],
        run: Run,
        sink: &mut Sink,
    ) -> anyhow::Result<bool> {
        let piece = Piece {
            head: head.cloned(),
            tick,
            entries: entries.to_vec(),
        };
        let batch = Batch {
            source: JOURNAL_CHANNEL.into(),
            sequence: self.told.n_messages as u32,
            log_nanos: run.sim_nanos,
            publish_nanos: sink.wall_nanos(mono_now().0),
            entries: vec![Entry {
                topic: JOURNAL_CHANNEL.to_owned(),
                content: Content::Journal,
                bytes: serde_json::to_vec(&piece)?,
            }],
        };
        let is_queued = match &sink.output {
            Some(output) if !sink.wait => match output.queue.offer(Job::Batch(batch)) {
                Ok(()) => true,
                Err(Refused::Full(_)) => false,
                Err(Refused::Closed) => anyhow::bail!("the writer has ended"),
            },
            _ => {
                sink.push(Job::Batch(batch))?;
                true
            }
        };
        self.told.n_messages = self.told.n_messages.saturating_add(u64::from(is_queued));
        Ok(is_queued)
    }
}

/// Whether the commands of an entry made sensors.
fn makes_topics(entry: &JournalEntry) -> bool {
    let JournalAct::Commands { outcomes, .. } = &entry.act else {
        return false;
    };
    let made = |outcome: &String| {
        let reply = serde_json::from_str(outcome);
        matches!(reply, Ok(CommandReply::Spawned { topics, .. }) if !topics.is_empty())
    };
    outcomes.iter().any(made)
}

/// Says in the file what run it is of: metadata `run` and the attachment `launch.toml`.
fn tell_run(head: &JournalHead, first: u64, sink: &mut Sink) -> anyhow::Result<()> {
    let mut pairs: BTreeMap<String, String> = [
        ("version", &head.version),
        ("build", &head.build),
        ("epoch", &head.epoch),
        ("map", &head.map),
        ("map_hash", &head.map_hash),
        ("adapter", &head.adapter),
        ("quality", &head.quality),
        ("lidars_on", &head.lidars_on),
        ("seed", &head.seed.to_string()),
    ]
    .map(|(key, value)| (key.to_owned(), value.clone()))
    .into();
    let rerun = match first {
        0 | 1 => "can be run again: gantry rerun FILE".to_owned(),
        _ => format!(
            "cannot be run again: its beginning is gone, because the simulator keeps so much only of what acted on its world, and this recording began after entry {first}; start simd with a larger --journal-mb, or record earlier"
        ),
    };
    pairs.insert("rerun".to_owned(), rerun);
    sink.push(metadata(pairs))?;
    sink.push(Job::Attach {
        name: "launch.toml".to_owned(),
        media_type: "application/toml",
        data: head.launch.clone().into_bytes(),
        log_nanos: 0,
    })
}

fn metadata(pairs: BTreeMap<String, String>) -> Job {
    Job::Metadata {
        name: "run".to_owned(),
        pairs,
    }
}
