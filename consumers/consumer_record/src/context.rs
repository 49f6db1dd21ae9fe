//! What every file of a set must hold, so that it can be read without the others: metadata, the
//! attachments, the documents in force and the journal of the run so far.

use std::collections::BTreeMap;
use std::sync::Arc;

use schema_recording::messages::{Batch, Content, Entry};
use schema_recording::write::Recording;

/// Most bytes of the journal that are repeated; a longer one stays in the files it was written to.
const MAX_JOURNAL_BYTES: usize = 64 << 20;

/// An attachment: media type, contents, simulated time.
type Attached = (String, Arc<Vec<u8>>, u64);

/// Remembers what went by.
#[derive(Clone, Debug, Default)]
pub(crate) struct Context {
    metadata: BTreeMap<String, BTreeMap<String, String>>,
    attachments: BTreeMap<String, Attached>,
    /// Newest by channel.
    documents: BTreeMap<String, Arc<Kept>>,
    journal: Vec<Arc<Kept>>,
    journal_bytes: usize,
}

/// A message that is repeated.
#[derive(Debug)]
struct Kept {
    sequence: u32,
    publish_nanos: u64,
    topic: String,
    content: Content,
    bytes: Vec<u8>,
}

impl Context {
    /// Notes a metadata record.
    pub(crate) fn metadata(&mut self, name: &str, pairs: &BTreeMap<String, String>) {
        self.metadata.insert(name.to_string(), pairs.clone());
    }

    /// Notes an attachment.
    pub(crate) fn attach(&mut self, name: &str, media_type: &str, data: &[u8], log_nanos: u64) {
        let attached = (media_type.to_string(), Arc::new(data.to_vec()), log_nanos);
        self.attachments.insert(name.to_string(), attached);
    }

    /// Notes the documents and journal entries among a batch's messages.
    pub(crate) fn batch(&mut self, batch: &Batch) {
        for entry in &batch.entries {
            if !matches!(entry.content, Content::Document | Content::Journal) {
                continue;
            }
            let kept = Arc::new(Kept {
                sequence: batch.sequence,
                publish_nanos: batch.publish_nanos,
                topic: entry.topic.clone(),
                content: entry.content.clone(),
                bytes: entry.bytes.clone(),
            });
            if entry.content == Content::Document {
                self.documents.insert(entry.topic.clone(), kept);
            } else if self.journal_bytes <= MAX_JOURNAL_BYTES {
                self.journal_bytes = self.journal_bytes.saturating_add(entry.bytes.len());
                self.journal.push(kept);
            }
        }
    }

    /// Writes everything into a file that begins at `log_nanos`.
    pub(crate) fn write(&self, recording: &mut Recording, log_nanos: u64) -> anyhow::Result<()> {
        for (name, pairs) in &self.metadata {
            recording.metadata(name, pairs)?;
        }
        for (name, (media_type, data, at)) in &self.attachments {
            recording.attach(name, media_type, data, *at)?;
        }
        let journal = if self.journal_bytes <= MAX_JOURNAL_BYTES {
            &self.journal[..]
        } else {
            let why = "cannot be run again from this file alone, because its journal is too long to be repeated; join the files of the set with gantry-record merge";
            let pairs = BTreeMap::from([("rerun".to_string(), why.to_string())]);
            recording.metadata("run", &pairs)?;
            &[]
        };
        for kept in self.documents.values().chain(journal) {
            recording.write(&Batch {
                source: "context".into(),
                sequence: kept.sequence,
                log_nanos,
                publish_nanos: kept.publish_nanos,
                entries: vec![Entry {
                    topic: kept.topic.clone(),
                    content: kept.content.clone(),
                    bytes: kept.bytes.clone(),
                }],
            })?;
        }
        Ok(())
    }
}
