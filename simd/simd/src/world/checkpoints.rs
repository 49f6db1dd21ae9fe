//! Checkpoints in memory: named ones, and the start of the episode for `reset`.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use std::collections::BTreeMap;

use anyhow::{Context as _, ensure};
use simd_world::Checkpoint;

/// Most checkpoints in memory.
const MAX_NAMED: usize = 64;
/// Longest name, bytes.
const MAX_NAME: usize = 100;

/// The checkpoints that can be restored.
#[derive(Default)]
pub struct Checkpoints {
    named: BTreeMap<String, Checkpoint>,
    start: Option<Checkpoint>,
}

impl Checkpoints {
    /// Keeps the start of a new episode. Checkpoints in memory belong to the old one and are dropped.
    pub fn begin_episode(&mut self, start: Checkpoint) {
        self.named.clear();
        self.start = Some(start);
    }

    /// The start of the episode.
    pub fn start(&self) -> anyhow::Result<Checkpoint> {
        self.start
            .clone()
            .context("there is no start to go back to")
    }

    /// Keeps a checkpoint under a name.
    ///
    /// # Errors
    /// If the name cannot be used, or there are too many.
    pub fn save(&mut self, name: &str, checkpoint: Checkpoint) -> anyhow::Result<()> {
        ensure!(
            (1..=MAX_NAME).contains(&name.len()),
            "name is {name:?}, but must have 1 to {MAX_NAME} bytes"
        );
        ensure!(
            self.named.len() < MAX_NAMED || self.named.contains_key(name),
            "{MAX_NAMED} checkpoints are in memory already, which is the most; save over one of them, or to a file"
        );
        self.named.insert(name.to_owned(), checkpoint);
        Ok(())
    }

    /// The checkpoint that was saved under a name.
    ///
    /// # Errors
    /// If there is none.
    pub fn find(&self, name: &str) -> anyhow::Result<&Checkpoint> {
        let found = self.named.get(name);
        found.with_context(|| {
            let names: Vec<&str> = self.named.keys().map(String::as_str).collect();
            format!(
                "there is no checkpoint {name:?} in memory, only [{}]; a new map forgets them",
                names.join(", ")
            )
        })
    }
}
