//! The work of the thread beside the ticks: it reads and checks what files hold, and writes them.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Context as _;
use schema_frames::command::StoredMap;
use simd_world::{Checkpoint, World};

use super::checkpoints::{self, CheckpointFiles, MAX_CHECKPOINT_BYTES};
use crate::history::{JournalReader, Stretch};
use crate::world::maps::{LoadedMap, Maps};

/// Work on a file that a command names, before the command is run.
#[derive(Debug)]
pub enum Task {
    /// List the maps of the map folder, among others.
    List,
    /// Parse and keep the text of a map.
    Store(StoredMap),
    /// Find, read and build a map.
    Load(String),
    /// Read and check the checkpoint file of this name.
    Restore(String),
}

/// Result of a [`Task`].
pub enum Ready {
    /// Names of maps.
    Names(Vec<String>),
    /// The map is kept.
    Stored,
    /// A map.
    Map(ReadMap),
    /// A checkpoint.
    Checkpoint(Box<ReadCheckpoint>),
}

/// A map to be put into the world.
pub struct ReadMap {
    /// The map.
    pub loaded: Arc<LoadedMap>,
    /// The text of its file; `None` if it is of none.
    pub text: Option<String>,
}

/// A checkpoint to go back to.
pub struct ReadCheckpoint {
    /// The checkpoint.
    pub checkpoint: Checkpoint,
    /// Bytes of its file.
    pub bytes: Vec<u8>,
}

/// A checkpoint that command number `idx` of a request saves to a file.
pub struct Saving {
    /// Index of the command.
    pub idx: usize,
    /// The file.
    pub path: PathBuf,
    /// The world when the command was run.
    pub checkpoint: Checkpoint,
}

/// Results of tasks by the index of their command, or why there is none.
pub type Results<T> = Vec<(usize, anyhow::Result<T>)>;

/// What the thread is told.
pub enum Job {
    /// Carry out these tasks of one request in order. `living` is the world as it is before the
    /// request, for tasks that need it.
    Read {
        tasks: Vec<(usize, Task)>,
        living: Option<Box<World>>,
    },
    /// Write these checkpoints.
    Write(Vec<Saving>),
    /// Read the next entries of the journal that is run again.
    ReadJournal,
    /// Keep a map of a journal. This has no answer.
    ProvideMap {
        name: String,
        title: String,
        bytes: Vec<u8>,
    },
    /// Keep a checkpoint file of a journal. This has no answer.
    ProvideCheckpoint { name: String, bytes: Vec<u8> },
}

/// What the thread answers.
pub enum Finished {
    /// The tasks of a request.
    Read(Results<Ready>),
    /// The checkpoints of a request.
    Written(Results<()>),
    /// Entries of the journal.
    Journal(Stretch),
}

/// The files that commands can name.
pub struct Shelf {
    maps: Maps,
    checkpoints: CheckpointFiles,
    /// The journal that is run again.
    journal: Option<JournalReader>,
    seed: u64,
}

impl Shelf {
    /// Maps are built with this seed.
    pub fn new(
        maps: Maps,
        checkpoints: CheckpointFiles,
        journal: Option<JournalReader>,
        seed: u64,
    ) -> Shelf {
        Shelf {
            maps,
            checkpoints,
            journal,
            seed,
        }
    }

    /// Does a job; `None` if it has no answer.
    pub fn work(&mut self, job: Job) -> Option<Finished> {
        match job {
            Job::Read { tasks, living } => Some(Finished::Read(self.read(tasks, living))),
            Job::Write(savings) => {
                let write = |saving: Saving| {
                    let written = checkpoints::write(&saving.path, &saving.checkpoint);
                    (saving.idx, written)
                };
                Some(Finished::Written(savings.into_iter().map(write).collect()))
            }
            Job::ReadJournal => Some(Finished::Journal(match &mut self.journal {
                Some(journal) => journal.read_on(),
                None => Stretch {
                    entries: Vec::new(),
                    end: Some(Ok(())),
                },
            })),
            Job::ProvideMap { name, title, bytes } => {
                self.maps.provide(name, title, &bytes);
                None
            }
            Job::ProvideCheckpoint { name, bytes } => {
                self.checkpoints.provide(name, bytes);
                None
            }
        }
    }

    fn read(
        &mut self,
        tasks: Vec<(usize, Task)>,
        mut living: Option<Box<World>>,
    ) -> Results<Ready> {
        let mut room_bytes = MAX_CHECKPOINT_BYTES;
        let mut results = Vec::with_capacity(tasks.len());
        for (idx, task) in tasks {
            let result = match task {
                Task::List => Ok(Ready::Names(self.maps.names())),
                Task::Store(map) => self.maps.store(map).map(|()| Ready::Stored),
                Task::Load(name) => self
                    .load(&name)
                    .inspect(|map| {
                        // A checkpoint that the same request restores is one of this map.
                        if let Some(world) = &mut living {
                            let mut next = world.successor();
                            if next.load_shared(&map.loaded.data).is_ok() {
                                **world = next;
                            }
                        }
                    })
                    .map(Ready::Map),
                Task::Restore(name) => self.checkpoint(&name, room_bytes, living.as_deref()),
            };
            if let Ok(Ready::Checkpoint(read)) = &result {
                room_bytes = room_bytes.saturating_sub(read.bytes.len() as u64);
            }
            results.push((idx, result));
        }
        results
    }

    fn load(&mut self, name: &str) -> anyhow::Result<ReadMap> {
        self.maps.check_asked(name)?;
        let loaded = self.maps.load(name, self.seed)?;
        let text = self.maps.file_text(name)?;
        Ok(ReadMap { loaded, text })
    }

    fn checkpoint(
        &mut self,
        name: &str,
        max_bytes: u64,
        living: Option<&World>,
    ) -> anyhow::Result<Ready> {
        let living = living.context("no world is there to read a checkpoint with")?;
        let (checkpoint, bytes) = self.checkpoints.read(name, max_bytes, living)?;
        Ok(Ready::Checkpoint(Box::new(ReadCheckpoint {
            checkpoint,
            bytes,
        })))
    }
}
