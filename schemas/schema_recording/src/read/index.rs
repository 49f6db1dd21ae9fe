//! What is where in a file: its channels, and the chunks with their times. From the summary at the
//! file's end if it is whole, else from a walk over the heads of all records.

use std::collections::BTreeMap;

use mcap::records::{Record, Statistics, op};

use super::bytes::{RECORD_HEAD_BYTES, Window, record_head, u16_at, u32_at, u64_at};
use super::chunk::{ChunkHead, PieceReader};
use super::piece::Piece;
use crate::walk;

/// Most bytes of a summary, or of a schema, channel, metadata or index record.
const MAX_SUMMARY_BYTES: u64 = 256 << 20;

/// A channel with its schema.
#[derive(Clone, Debug)]
pub(crate) struct Channel {
    /// With its leading slash.
    pub topic: String,
    pub message_encoding: String,
    pub schema: std::sync::Arc<Schema>,
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Schema {
    pub name: String,
    pub encoding: String,
    pub data: Vec<u8>,
}

/// A record that is read when it is asked for.
#[derive(Clone, Debug)]
pub(crate) struct Stored {
    pub name: String,
    pub offset: u64,
    pub len: u64,
}

/// What is where in a file.
#[derive(Debug, Default)]
pub(crate) struct Index {
    pub channels: BTreeMap<u16, Channel>,
    pub pieces: Vec<Piece>,
    pub attachments: Vec<Stored>,
    pub metadata: Vec<Stored>,
    /// Messages by channel, if the summary says so.
    pub n_messages: Option<BTreeMap<u16, u64>>,
    /// Whether the file ends as a whole one does.
    pub is_complete: bool,
    /// Why it was walked instead of read from its summary.
    pub walked_because: Option<SummaryError>,
    schemas: BTreeMap<u16, std::sync::Arc<Schema>>,
    unnamed: BTreeMap<u16, (u16, String, String)>,
}

/// Why a file's summary is not used and its records are walked over instead.
#[derive(Debug, thiserror::Error)]
pub(crate) enum SummaryError {
    #[error("it ends before a summary")]
    TooShort,
    #[error("it was not finished, or is cut off")]
    Unfinished,
    #[error("it does not end with a footer")]
    NoFooter,
    #[error("it has no summary")]
    None,
    #[error("its footer puts the summary at byte {0}")]
    Place(u64),
    #[error("its summary does not have the checksum that is given for it")]
    Checksum,
    #[error("its summary is damaged: a record is cut off")]
    CutRecord,
    #[error("its summary is damaged: a record is longer than the summary")]
    LongRecord,
    #[error("its summary is damaged: {0}")]
    Record(#[from] walk::RecordError),
    #[error("its summary is damaged: it puts a chunk at byte {0}")]
    ChunkPlace(u64),
    #[error("its summary is damaged: it names places beyond the data")]
    BeyondData,
    #[error("its summary has no statistics")]
    NoStatistics,
    #[error("its summary lists {listed} {what} and counts {counted}")]
    Count {
        what: &'static str,
        listed: usize,
        counted: u64,
    },
    #[error("its messages are not in chunks")]
    LooseMessages,
    #[error("its summary puts a chunk at byte {0}, where there is none")]
    NoChunk(u64),
}

impl Index {
    /// Reads the index of a file of `file_bytes` bytes, of which the magic has been checked.
    pub fn read(window: &mut Window, file_bytes: u64) -> anyhow::Result<Index> {
        match Self::from_summary(window, file_bytes)? {
            Ok(index) => Ok(index),
            Err(why) => {
                let mut index = Self::from_walk(window, file_bytes)?;
                index.walked_because = Some(why);
                Ok(index)
            }
        }
    }

    /// The inner error says why the summary cannot be used.
    fn from_summary(
        window: &mut Window,
        file_bytes: u64,
    ) -> anyhow::Result<Result<Index, SummaryError>> {
        const FOOTER_BYTES: u64 = RECORD_HEAD_BYTES + 20;
        const TAIL_BYTES: u64 = FOOTER_BYTES + 8;
        let footer_at = file_bytes.checked_sub(TAIL_BYTES).filter(|at| *at >= 8);
        let Some(footer_at) = footer_at else {
            return Ok(Err(SummaryError::TooShort));
        };
        let end = window.look(footer_at, TAIL_BYTES as usize)?.to_vec();
        if end.len() as u64 != TAIL_BYTES || end[FOOTER_BYTES as usize..] != mcap::MAGIC[..] {
            return Ok(Err(SummaryError::Unfinished));
        }
        let footer = (record_head(&end), u64_at(&end, 9), u32_at(&end, 25));
        let (Some((op::FOOTER, 20)), Some(start), Some(crc)) = footer else {
            return Ok(Err(SummaryError::NoFooter));
        };
        if start == 0 {
            return Ok(Err(SummaryError::None));
        }
        let summary_bytes = footer_at.checked_sub(start);
        let summary_bytes = summary_bytes.filter(|n| start >= 8 && *n <= MAX_SUMMARY_BYTES);
        let Some(summary_bytes) = summary_bytes else {
            return Ok(Err(SummaryError::Place(start)));
        };
        let mut summary = vec![0; summary_bytes as usize];
        window.read_exact(&mut summary, start)?;
        if crc != 0 {
            let mut hasher = crc32fast::Hasher::new();
            hasher.update(&summary);
            hasher.update(&end[..25]);
            if hasher.finalize() != crc {
                return Ok(Err(SummaryError::Checksum));
            }
        }
        let mut index = Index {
            is_complete: true,
            ..Index::default()
        };
        let mut statistics = None;
        if let Err(why) = index.take_summary(&summary, start, &mut statistics) {
            return Ok(Err(why));
        }
        index.name_channels();
        if let Err(why) = index.check(window, statistics.as_ref(), start)? {
            return Ok(Err(why));
        }
        index.n_messages = statistics.map(|of| of.channel_message_counts);
        Ok(Ok(index))
    }

    fn take_summary(
        &mut self,
        mut summary: &[u8],
        start: u64,
        statistics: &mut Option<Statistics>,
    ) -> Result<(), SummaryError> {
        while !summary.is_empty() {
            record_head(summary).ok_or(SummaryError::CutRecord)?;
            let taken = walk::take_record(&mut summary).map_err(|_| SummaryError::LongRecord)?;
            let (opcode, body) = taken.ok_or(SummaryError::CutRecord)?;
            match walk::record(opcode, body)? {
                Record::ChunkIndex(chunk) => {
                    let channels = chunk
                        .message_index_offsets
                        .into_keys()
                        .collect::<Box<[u16]>>();
                    let times = (chunk.message_start_time, chunk.message_end_time);
                    let place = (chunk.chunk_start_offset, chunk.chunk_length);
                    self.pieces.push(Piece {
                        channels: Some(channels).filter(|channels| !channels.is_empty()),
                        ..Piece::of_chunk(place, times)
                    });
                }
                Record::AttachmentIndex(of) => self.attachments.push(Stored {
                    name: of.name,
                    offset: of.offset,
                    len: of.length,
                }),
                Record::MetadataIndex(of) => self.metadata.push(Stored {
                    name: of.name,
                    offset: of.offset,
                    len: of.length,
                }),
                Record::Statistics(of) => *statistics = Some(of),
                other => self.define(other),
            }
        }
        self.pieces.sort_by_key(|piece| piece.offset);
        let mut end = 8;
        for piece in &self.pieces {
            if piece.offset < end || piece.len < RECORD_HEAD_BYTES {
                return Err(SummaryError::ChunkPlace(piece.offset));
            }
            end = piece.offset.saturating_add(piece.len);
        }
        let places = self.attachments.iter().chain(&self.metadata);
        let mut ends = places.map(|place| place.offset.saturating_add(place.len));
        if end > start || ends.any(|end| end > start) {
            return Err(SummaryError::BeyondData);
        }
        Ok(())
    }

    /// Whether the summary tells everything, and the truth where that is cheap to see.
    fn check(
        &self,
        window: &mut Window,
        statistics: Option<&Statistics>,
        data_end: u64,
    ) -> anyhow::Result<Result<(), SummaryError>> {
        let Some(of) = statistics else {
            return Ok(Err(SummaryError::NoStatistics));
        };
        let counts = [
            ("chunks", u64::from(of.chunk_count), self.pieces.len()),
            ("channels", u64::from(of.channel_count), self.channels.len()),
            (
                "attachments",
                u64::from(of.attachment_count),
                self.attachments.len(),
            ),
            (
                "metadata records",
                u64::from(of.metadata_count),
                self.metadata.len(),
            ),
        ];
        for (what, counted, listed) in counts {
            if counted != listed as u64 {
                return Ok(Err(SummaryError::Count {
                    what,
                    listed,
                    counted,
                }));
            }
        }
        if of.message_count > 0 && self.pieces.is_empty() {
            return Ok(Err(SummaryError::LooseMessages));
        }
        for piece in self.pieces.first().into_iter().chain(self.pieces.last()) {
            let head = record_head(window.look(piece.offset, RECORD_HEAD_BYTES as usize)?);
            let body_bytes = piece.len.checked_sub(RECORD_HEAD_BYTES);
            if body_bytes.is_none_or(|len| head != Some((op::CHUNK, len))) {
                return Ok(Err(SummaryError::NoChunk(piece.offset)));
            }
        }
        let _ = data_end;
        Ok(Ok(()))
    }

    /// Takes a schema or a channel; other records are passed over.
    fn define(&mut self, record: Record<'_>) {
        match record {
            Record::Schema { header, data } => {
                let schema = Schema {
                    name: header.name,
                    encoding: header.encoding,
                    data: data.into_owned(),
                };
                self.schemas.entry(header.id).or_insert(schema.into());
            }
            Record::Channel(of) => {
                let entry = (of.schema_id, of.topic, of.message_encoding);
                self.unnamed.entry(of.id).or_insert(entry);
            }
            _ => {}
        }
    }

    /// Gives channels their schemas, once all records that were found are taken.
    fn name_channels(&mut self) {
        for (id, (schema_id, topic, message_encoding)) in std::mem::take(&mut self.unnamed) {
            let schema = self.schemas.get(&schema_id).cloned().unwrap_or_default();
            self.channels.entry(id).or_insert(Channel {
                topic,
                message_encoding,
                schema,
            });
        }
    }

    /// Walks over the heads of all records. Of chunks only those are looked into that hold messages
    /// of a channel that no record outside has defined.
    fn from_walk(window: &mut Window, file_bytes: u64) -> anyhow::Result<Index> {
        let mut index = Index::default();
        let mut at = 8;
        let mut open_chunk: Option<usize> = None;
        let mut inside = PieceReader::new(window.file());
        loop {
            let head = window.look(at, 128)?;
            if head.get(..8) == Some(mcap::MAGIC) && file_bytes.checked_sub(8) == Some(at) {
                index.is_complete = true;
                break;
            }
            let Some((opcode, len)) = record_head(head) else {
                break;
            };
            let body_at = at.saturating_add(RECORD_HEAD_BYTES);
            let Some(next) = body_at.checked_add(len).filter(|end| *end <= file_bytes) else {
                break;
            };
            let record_bytes = next.saturating_sub(at);
            let body = &head[RECORD_HEAD_BYTES as usize..];
            let body = &body[..body.len().min(len.min(119) as usize)];
            // A chunk's index records stand right behind it.
            if opcode != op::MESSAGE_INDEX {
                index.look_into(&mut open_chunk, &mut inside);
            }
            match opcode {
                op::CHUNK => {
                    if let Some(head) = ChunkHead::parse(body) {
                        open_chunk = Some(index.pieces.len());
                        let times = (head.start_nanos, head.end_nanos);
                        index
                            .pieces
                            .push(Piece::of_chunk((at, record_bytes), times));
                    }
                }
                op::MESSAGE_INDEX => {
                    if let (Some(idx), Some(channel)) = (open_chunk, u16_at(body, 0)) {
                        let known = index.pieces[idx].channels.take().unwrap_or_default();
                        let mut channels = known.into_vec();
                        channels.push(channel);
                        index.pieces[idx].channels = Some(channels.into());
                    }
                }
                op::MESSAGE => {
                    let nanos = u64_at(body, 6).unwrap_or(0);
                    index.add_loose(at, record_bytes, nanos);
                }
                op::SCHEMA | op::CHANNEL if len <= MAX_SUMMARY_BYTES => {
                    let mut whole = vec![0; len as usize];
                    window.read_exact(&mut whole, body_at)?;
                    if let Ok(record) = walk::record(opcode, &whole) {
                        index.define(record);
                    }
                }
                op::ATTACHMENT => {
                    let name = window.look(body_at, (len as usize).min(4096))?;
                    if let Some(name) = text_at(name, 16) {
                        index.attachments.push(Stored {
                            name,
                            offset: at,
                            len: record_bytes,
                        });
                    }
                }
                op::METADATA => {
                    let name = window.look(body_at, (len as usize).min(4096))?;
                    if let Some(name) = text_at(name, 0) {
                        index.metadata.push(Stored {
                            name,
                            offset: at,
                            len: record_bytes,
                        });
                    }
                }
                _ => {}
            }
            at = next;
        }
        index.look_into(&mut open_chunk, &mut inside);
        index.name_channels();
        Ok(index)
    }

    /// Takes the definitions from the chunk whose index records have all been seen, if it holds any
    /// that are new.
    fn look_into(&mut self, open: &mut Option<usize>, inside: &mut PieceReader) {
        let Some(idx) = open.take() else { return };
        let piece = self.pieces[idx].clone();
        let is_known = |id: &u16| self.unnamed.contains_key(id);
        if piece
            .channels
            .as_ref()
            .is_some_and(|ids| ids.iter().all(is_known))
        {
            return;
        }
        if inside.open(&piece).is_err() {
            return;
        }
        while let Ok(Some((opcode, at, len))) = inside.next_record() {
            let is_definition = matches!(opcode, op::SCHEMA | op::CHANNEL);
            if !is_definition || len > MAX_SUMMARY_BYTES {
                continue;
            }
            let mut body = vec![0; len as usize];
            if inside.copy(at, &mut body).is_ok()
                && let Ok(record) = walk::record(opcode, &body)
            {
                self.define(record);
            }
        }
    }

    /// Adds a message that stands outside of chunks to the run of such messages before it.
    fn add_loose(&mut self, offset: u64, len: u64, nanos: u64) {
        match self.pieces.last_mut() {
            Some(last)
                if last.is_loose
                    && last.offset.checked_add(last.len) == Some(offset)
                    && last.len < crate::write::CHUNK_BYTES =>
            {
                last.len = last.len.saturating_add(len);
                last.start_nanos = last.start_nanos.min(nanos);
                last.end_nanos = last.end_nanos.max(nanos);
            }
            _ => self.pieces.push(Piece {
                offset,
                len,
                start_nanos: nanos,
                end_nanos: nanos,
                is_loose: true,
                channels: None,
            }),
        }
    }
}

/// The text with its length before it at `at`.
fn text_at(bytes: &[u8], at: usize) -> Option<String> {
    let len = u32_at(bytes, at)? as usize;
    let begin = at.checked_add(4)?;
    let text = bytes.get(begin..begin.checked_add(len)?)?;
    String::from_utf8(text.to_vec()).ok()
}
