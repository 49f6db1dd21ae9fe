//! Copies what an interrupted or damaged recording still holds into a new, complete file. One chunk
//! is in memory at a time, packed.

use std::io::{BufReader, Read};
use std::path::Path;

use anyhow::Context as _;
use launch_cli::files::open_plain;
use mcap::Attachment;
use mcap::records::{Record, op};
use schema_recording::walk::{End, RecordWalk, for_each_in_chunk, record};

use crate::copier::Copier;

/// What was rescued.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recovered {
    /// Messages.
    pub n_messages: u64,
    /// Chunks taken over whole.
    pub n_chunks: u64,
    /// Chunks left out because their contents are damaged.
    pub n_bad_chunks: u64,
    /// Attachments.
    pub n_attachments: u64,
    /// How the old file ended.
    pub end: End,
}

/// Copies every complete chunk, attachment and metadata record of `input` to the new file `output`.
///
/// # Errors
/// If `input` cannot be read or is no MCAP file, or `output` exists or cannot be written.
pub fn recover_file(input: &Path, output: &Path) -> anyhow::Result<Recovered> {
    let (file, file_bytes) =
        open_plain(input).with_context(|| format!("cannot open {}", input.display()))?;
    let walk = RecordWalk::new(BufReader::with_capacity(1 << 20, file), file_bytes)
        .with_context(|| input.display().to_string())?;
    recover(walk, output)
}

/// [`recover_file`] of any reader.
///
/// # Errors
/// If writing fails; damage in the input is counted, not an error.
pub fn recover<R: Read>(mut walk: RecordWalk<R>, output: &Path) -> anyhow::Result<Recovered> {
    let mut out = Copier::create(output)?;
    let mut found = Recovered {
        n_messages: 0,
        n_chunks: 0,
        n_bad_chunks: 0,
        n_attachments: 0,
        end: End::CutOff,
    };
    while let Some((opcode, body)) = walk.next_record() {
        match opcode {
            op::DATA_END => {
                // The rest is the old summary; the new file gets its own.
                while walk.next_record().is_some() {}
            }
            // Read through once before anything of it is taken: all of a chunk, or nothing.
            op::CHUNK => match for_each_in_chunk(&body, &mut |_| Ok(())) {
                Ok(()) => {
                    for_each_in_chunk(&body, &mut |record| copy(record, &mut out))?;
                    found.n_chunks = found.n_chunks.saturating_add(1);
                }
                Err(_) => found.n_bad_chunks = found.n_bad_chunks.saturating_add(1),
            },
            _ => {
                if let Ok(record) = record(opcode, &body) {
                    let n_more = u64::from(matches!(record, Record::Attachment { .. }));
                    found.n_attachments = found.n_attachments.saturating_add(n_more);
                    copy(record, &mut out)?;
                }
            }
        }
    }
    found.n_messages = out.finish()?;
    found.end = walk.end();
    Ok(found)
}

/// Copies one record; a record that refers to something missing is left out.
fn copy(record: Record<'_>, out: &mut Copier) -> anyhow::Result<()> {
    match record {
        Record::Schema { header, data } => out.schema(0, &header, &data),
        Record::Channel(channel) => out.channel(0, &channel),
        Record::Message { header, data } => out.message(0, &header, &data),
        Record::Attachment { header, data, .. } => out.attach(&Attachment {
            log_time: header.log_time,
            create_time: header.create_time,
            name: header.name,
            media_type: header.media_type,
            data,
        }),
        Record::Metadata(of) => out.metadata(&of.name, &of.metadata),
        _ => Ok(()),
    }
}
