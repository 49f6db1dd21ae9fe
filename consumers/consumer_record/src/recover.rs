//! Copies what an interrupted or damaged recording still holds into a new, complete file.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, Write};
use std::path::Path;

use anyhow::{Context, bail};
use mcap::records::{MessageHeader, Metadata, Record, op};
use mcap::{Attachment, Writer};

use schema_recording::walk::{End, RecordWalk, for_each_in_chunk, record};
use schema_recording::write::{ChunkCompression, options};

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
    let file = File::open(input).with_context(|| format!("cannot open {}", input.display()))?;
    let file_bytes = file.metadata()?.len();
    if output.exists() {
        bail!(
            "{} exists already; choose another name or remove it first",
            output.display()
        );
    }
    let walk = RecordWalk::new(BufReader::with_capacity(1 << 20, file), file_bytes)
        .with_context(|| input.display().to_string())?;
    let out = File::options()
        .write(true)
        .create_new(true)
        .open(output)
        .with_context(|| format!("cannot create {}", output.display()))?;
    recover(walk, BufWriter::with_capacity(1 << 20, out))
}

/// [`recover_file`] on any reader and writer.
///
/// # Errors
/// If writing fails; damage in the input is counted, not an error.
pub fn recover<R: Read, W: Write + Seek>(
    mut walk: RecordWalk<R>,
    out: W,
) -> anyhow::Result<Recovered> {
    let mut copy = Copy {
        writer: options(ChunkCompression::Lz4).create(out)?,
        schemas: HashMap::new(),
        channels: HashMap::new(),
        n_messages: 0,
    };
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
            op::CHUNK => match unpack(&body) {
                Ok(records) => {
                    records
                        .into_iter()
                        .try_for_each(|record| copy.record(record))?;
                    found.n_chunks += 1;
                }
                Err(_) => found.n_bad_chunks += 1,
            },
            _ => {
                if let Ok(record) = record(opcode, &body) {
                    found.n_attachments += matches!(record, Record::Attachment { .. }) as u64;
                    copy.record(record)?;
                }
            }
        }
    }
    copy.writer.finish()?;
    found.n_messages = copy.n_messages;
    found.end = walk.end();
    Ok(found)
}

/// All records of a chunk, or none.
fn unpack(body: &[u8]) -> anyhow::Result<Vec<Record<'static>>> {
    let mut records = Vec::new();
    for_each_in_chunk(body, &mut |record| {
        records.push(record.into_owned());
        Ok(())
    })?;
    Ok(records)
}

struct Copy<W: Write + Seek> {
    writer: Writer<W>,
    schemas: HashMap<u16, u16>,
    channels: HashMap<u16, u16>,
    n_messages: u64,
}

impl<W: Write + Seek> Copy<W> {
    /// Copies one record; a record that refers to something missing is left out.
    fn record(&mut self, record: Record<'_>) -> anyhow::Result<()> {
        match record {
            Record::Schema { header, data } if header.id != 0 => {
                let id = self
                    .writer
                    .add_schema(&header.name, &header.encoding, &data)?;
                self.schemas.insert(header.id, id);
            }
            Record::Channel(channel) => {
                let schema_id = match channel.schema_id {
                    0 => Some(0),
                    id => self.schemas.get(&id).copied(),
                };
                if let Some(schema_id) = schema_id {
                    let id = self.writer.add_channel(
                        schema_id,
                        &channel.topic,
                        &channel.message_encoding,
                        &channel.metadata,
                    )?;
                    self.channels.insert(channel.id, id);
                }
            }
            Record::Message { header, data } => {
                if let Some(channel_id) = self.channels.get(&header.channel_id) {
                    self.writer.write_to_known_channel(
                        &MessageHeader {
                            channel_id: *channel_id,
                            ..header
                        },
                        &data,
                    )?;
                    self.n_messages += 1;
                }
            }
            Record::Attachment { header, data, .. } => self.writer.attach(&Attachment {
                log_time: header.log_time,
                create_time: header.create_time,
                name: header.name,
                media_type: header.media_type,
                data,
            })?,
            Record::Metadata(Metadata { name, metadata }) => {
                self.writer.write_metadata(&Metadata {
                    name,
                    metadata: BTreeMap::from_iter(metadata),
                })?
            }
            _ => {}
        }
        Ok(())
    }
}
