//! From a message to a sample: where its bytes are, and whether it is what it says.

use std::io;
use std::sync::Arc;

use bytemuck::Zeroable as _;
use schema_frames::document::{DOCUMENT_MAGIC, DocumentHeader};
use schema_frames::snapshot::SNAPSHOT_MAGIC;
use schema_frames::{
    ActorRecord, FrameHeader, InputRecord, ResultHeader, SCHEMA_VERSION, SnapshotHeader,
};

use super::chunk::MAX_CHUNK_BYTES;
use super::fields::{Span, spans};
use super::parts::{Found, Head, HeadOf, Message, Role, Taken, Trouble, Waiting};
use super::samples::Samples;
use crate::wire::DATA_FIELD;

/// Frames and results that may wait for the message with their bytes. It follows at once, or after
/// little of other samples.
const MAX_WAITING: usize = 256;

impl Samples {
    /// Tells what a message is; `None` if it is nothing by itself.
    pub(super) fn find(&mut self, message: Message) -> Result<Option<Found>, Trouble> {
        let Some(wanted) = self.wanted.get(&message.channel).cloned() else {
            return Ok(None);
        };
        match wanted.role {
            Role::Frame => self.find_frame(message, wanted.topic),
            Role::Result => self.find_result(message, wanted.topic),
            Role::Bytes { data_field } => self.find_bytes(message, &wanted.topic, data_field),
            Role::Snapshot => self.find_snapshot(message).map(Some),
            Role::Document => self.find_document(message, wanted.topic).map(Some),
            Role::Journal => {
                self.take_text(message.data)?;
                std::str::from_utf8(&self.text).map_err(|_| {
                    Trouble::Bad("journal", "an entry of the journal is no text".into())
                })?;
                Ok(Some(Found::Taken(message, Taken::Journal)))
            }
            Role::Foreign(of) => {
                self.take_text(message.data)?;
                let topic = wanted.topic;
                Ok(Some(Found::Taken(message, Taken::Foreign(topic, of))))
            }
        }
    }

    fn find_frame(&mut self, message: Message, topic: Arc<str>) -> Result<Option<Found>, Trouble> {
        let [_, _, _, header, payload, elsewhere, codec] =
            spans::<7>(&mut self.reader, message.data)?;
        let header: FrameHeader = self.plain(header, &topic)?;
        let codec = self.short_text(codec)?;
        let elsewhere = self.short_text(elsewhere)?;
        let head = Head {
            topic,
            message,
            of: HeadOf::Frame(Box::new(header), codec),
        };
        if !elsewhere.is_empty() {
            self.wait_for(head, elsewhere);
            return Ok(None);
        }
        self.whole(head, payload.unwrap_or((message.data.0, 0)))
            .map(Some)
    }

    fn find_result(&mut self, message: Message, topic: Arc<str>) -> Result<Option<Found>, Trouble> {
        let [_, _, _, header, body, elsewhere, inputs] =
            spans::<7>(&mut self.reader, message.data)?;
        let header: ResultHeader = self.plain(header, &topic)?;
        let elsewhere = self.short_text(elsewhere)?;
        header
            .check(usize::try_from(header.payload_bytes).unwrap_or(usize::MAX))
            .map_err(|error| Trouble::Bad("header", format!("{topic}: {error}")))?;
        let (at, len) = inputs.unwrap_or((0, 0));
        let wanted_bytes = bytes_of::<InputRecord>(header.n_inputs);
        if len != wanted_bytes {
            return Err(Trouble::Bad(
                "header",
                format!("{topic}: {len} bytes of inputs, the header says {wanted_bytes}"),
            ));
        }
        let mut records = vec![InputRecord::zeroed(); header.n_inputs as usize];
        self.reader
            .copy(at, bytemuck::cast_slice_mut(&mut records))?;
        let head = Head {
            topic,
            message,
            of: HeadOf::Result(Box::new(header), records),
        };
        if !elsewhere.is_empty() {
            self.wait_for(head, elsewhere);
            return Ok(None);
        }
        self.whole(head, body.unwrap_or((message.data.0, 0)))
            .map(Some)
    }

    fn wait_for(&mut self, head: Head, channel_topic: String) {
        if self.waiting.len() == MAX_WAITING
            && let Some(late) = self.waiting.pop_front()
        {
            self.missing(&late);
        }
        self.waiting.push_back(Waiting {
            head,
            channel_topic,
            piece_number: self.n_opened,
        });
    }

    fn find_bytes(
        &mut self,
        message: Message,
        topic: &str,
        data_field: Option<u32>,
    ) -> Result<Option<Found>, Trouble> {
        let belongs = |late: &Waiting| {
            let of = &late.head.message;
            (of.log_nanos, of.sequence) == (message.log_nanos, message.sequence)
                && late.channel_topic.trim_start_matches('/') == topic
        };
        let Some(place) = self.waiting.iter().position(belongs) else {
            return Ok(None);
        };
        let Some(late) = self.waiting.remove(place) else {
            return Ok(None);
        };
        let bytes = match data_field {
            Some(field) => spans::<{ DATA_FIELD as usize }>(&mut self.reader, message.data)?
                .get((field as usize).wrapping_sub(1))
                .copied()
                .flatten()
                .unwrap_or((message.data.0, 0)),
            None => message.data,
        };
        self.whole(late.head, bytes).map(Some)
    }

    /// A frame or result whose bytes were found, if their number is what its header says.
    fn whole(&self, head: Head, bytes: Span) -> Result<Found, Trouble> {
        let bad = |what: String| Trouble::Bad("header", format!("{}: {what}", head.topic));
        match &head.of {
            HeadOf::Frame(header, codec) => {
                let claimed = header.payload_bytes;
                if !codec.is_empty() && claimed > MAX_CHUNK_BYTES {
                    return Err(bad(format!(
                        "{claimed} bytes are coded as {codec:?}, at most {MAX_CHUNK_BYTES} are decoded"
                    )));
                }
                if codec.is_empty() && claimed != bytes.1 {
                    return Err(bad(format!(
                        "a frame of {claimed} bytes of which the file holds {}",
                        bytes.1
                    )));
                }
                header
                    .check(usize::try_from(claimed).unwrap_or(usize::MAX))
                    .map_err(|error| bad(error.to_string()))?;
            }
            HeadOf::Result(header, _) => {
                if header.body_bytes != bytes.1 {
                    return Err(bad(format!(
                        "a result of {} bytes of which the file holds {}",
                        header.body_bytes, bytes.1
                    )));
                }
            }
        }
        Ok(Found::Whole(head, bytes))
    }

    fn find_snapshot(&mut self, message: Message) -> Result<Found, Trouble> {
        let [_, _, header, records] = spans::<4>(&mut self.reader, message.data)?;
        let topic: Arc<str> = "world/snapshot".into();
        let header: SnapshotHeader = self.plain(header, &topic)?;
        let bad = |what: String| Trouble::Bad("header", format!("{topic}: {what}"));
        check_magic(header.magic, SNAPSHOT_MAGIC, header.schema_version)
            .map_err(|error| bad(error.to_string()))?;
        let (at, len) = records.unwrap_or((0, 0));
        if len != bytes_of::<ActorRecord>(header.n_actors) || len > MAX_CHUNK_BYTES {
            return Err(bad(format!(
                "{len} bytes of records, the header says {} actors",
                header.n_actors
            )));
        }
        self.records
            .resize(header.n_actors as usize, ActorRecord::zeroed());
        self.reader
            .copy(at, bytemuck::cast_slice_mut(&mut self.records))?;
        Ok(Found::Taken(message, Taken::Snapshot(Box::new(header))))
    }

    fn find_document(&mut self, message: Message, topic: Arc<str>) -> Result<Found, Trouble> {
        let [_, _, header, text] = spans::<4>(&mut self.reader, message.data)?;
        let header: DocumentHeader = self.plain(header, &topic)?;
        let bad = |what: String| Trouble::Bad("header", format!("{topic}: {what}"));
        check_magic(header.magic, DOCUMENT_MAGIC, header.schema_version)
            .map_err(|error| bad(error.to_string()))?;
        self.take_text(text.unwrap_or((0, 0)))?;
        if std::str::from_utf8(&self.text).is_err() {
            return Err(bad("its text is not UTF-8".into()));
        }
        Ok(Found::Taken(message, Taken::Document(topic, header)))
    }

    /// A header that is plain data.
    fn plain<T: bytemuck::Pod>(&mut self, span: Option<Span>, topic: &str) -> Result<T, Trouble> {
        let want = size_of::<T>() as u64;
        match span {
            Some((at, len)) if len == want => {
                let bytes = self.reader.look(at, want as usize)?;
                Ok(bytemuck::pod_read_unaligned(bytes))
            }
            other => Err(Trouble::Bad(
                "header",
                format!(
                    "{topic}: a header of {} bytes instead of {want}",
                    other.map_or(0, |(_, len)| len)
                ),
            )),
        }
    }

    /// A name; one longer than any is empty.
    fn short_text(&mut self, span: Option<Span>) -> io::Result<String> {
        match span {
            Some((at, len)) if len <= 1024 => {
                let bytes = self.reader.look(at, len as usize)?;
                Ok(String::from_utf8_lossy(bytes).into_owned())
            }
            _ => Ok(String::new()),
        }
    }

    /// Copies a text or a foreign message.
    fn take_text(&mut self, (at, len): Span) -> Result<(), Trouble> {
        if len > MAX_CHUNK_BYTES {
            return Err(Trouble::Bad(
                "message",
                format!("a message of {len} bytes, at most {MAX_CHUNK_BYTES} are read"),
            ));
        }
        self.text.resize(len as usize, 0);
        Ok(self.reader.copy(at, &mut self.text)?)
    }
}

/// Bytes of so many records.
fn bytes_of<T>(n: u32) -> u64 {
    u64::from(n).saturating_mul(size_of::<T>() as u64)
}

/// Why a header that is plain data is not one of this version.
#[derive(Debug, thiserror::Error)]
enum ForeignHeader {
    #[error("it starts with {found:#010x}, not with {magic:#010x}")]
    Magic { found: u32, magic: u32 },
    #[error("it carries schema {0}, this program reads {SCHEMA_VERSION}")]
    Version(u16),
}

/// Whether plain data is what it should be, in this version.
fn check_magic(found: u32, magic: u32, schema_version: u16) -> Result<(), ForeignHeader> {
    if found != magic {
        return Err(ForeignHeader::Magic { found, magic });
    }
    if schema_version != SCHEMA_VERSION {
        return Err(ForeignHeader::Version(schema_version));
    }
    Ok(())
}
