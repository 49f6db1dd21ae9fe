//! What is wrong with a file: counted by kind, the first of each said in a sentence.

use std::collections::BTreeMap;

/// Most sentences that are kept.
const MAX_SENTENCES: usize = 16;

/// What could not be read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Damage {
    counts: BTreeMap<&'static str, u64>,
    sentences: Vec<String>,
}

impl Damage {
    /// Counts one thing of a kind, and keeps its sentence if it is the first of its kind or there
    /// is room.
    pub(crate) fn note(&mut self, kind: &'static str, sentence: impl FnOnce() -> String) {
        let n = self.counts.entry(kind).or_insert(0);
        *n = n.saturating_add(1);
        if *n <= 3 && self.sentences.len() < MAX_SENTENCES {
            self.sentences.push(sentence());
        }
    }

    /// Number of things that could not be read.
    pub fn total(&self) -> u64 {
        self.counts.values().sum()
    }

    /// Their number by kind, for example `chunk` or `header`.
    pub fn counts(&self) -> &BTreeMap<&'static str, u64> {
        &self.counts
    }

    /// A sentence for each of the first few.
    pub fn sentences(&self) -> &[String] {
        &self.sentences
    }
}
