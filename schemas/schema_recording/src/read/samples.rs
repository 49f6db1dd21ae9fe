//! Sample after sample of a recording, in the order of the file.

use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::sync::Arc;

use anyhow::Context as _;
use bytemuck::Zeroable as _;
use mcap::records::op;
use schema_frames::document::DocumentHeader;
use schema_frames::{ActorRecord, FrameHeader, InputRecord, ResultHeader, SnapshotHeader};

use super::ahead::Ahead;
use super::bytes::{u16_at, u32_at, u64_at};
use super::chunk::{Fault, PieceReader};
use super::damage::Damage;
use super::fields::Span;
use super::index::Index;
use super::parts::{
    ForeignType, Found, Head, HeadOf, Message, Place, Taken, Trouble, Waiting, Wanted,
};
use super::payload::Payload;
use super::piece::Piece;

/// Bytes before the data of a message.
const MESSAGE_HEADER_BYTES: u64 = 22;
/// Pieces of the file after which a message that has not come is missing.
const MAX_PIECES_APART: u64 = 2;

/// One sample.
#[derive(Debug)]
pub struct Sample<'a> {
    /// Simulated time under which it is filed, nanoseconds since the simulator started; in other
    /// programs' files whatever they wrote.
    pub log_nanos: u64,
    /// The publisher's wall clock, nanoseconds since 1970.
    pub publish_nanos: u64,
    /// Low 32 bits of the sample's own number.
    pub sequence: u32,
    /// Where its last message is in the file.
    pub place: Place,
    /// What it is.
    pub what: What<'a>,
}

/// A place between two samples, to come back to.
#[derive(Clone, Debug)]
pub struct Mark {
    place: Place,
    is_open: bool,
    waiting: VecDeque<Waiting>,
}

impl Mark {
    /// The place; of the sample that comes next or, between two chunks, before it.
    pub fn place(&self) -> Place {
        self.place
    }
}

/// What a sample is. Headers have been checked against what is there.
#[derive(Debug)]
pub enum What<'a> {
    /// A sensor frame; its payload has `header.payload_bytes`.
    Frame {
        /// Without the domain: `ego/front/rgb`.
        topic: &'a Arc<str>,
        /// As it was in shared memory.
        header: FrameHeader,
        /// Its bytes.
        payload: Payload<'a>,
    },
    /// The actors after a tick.
    Snapshot {
        /// As it was in shared memory.
        header: SnapshotHeader,
        /// `header.n_actors` records.
        records: &'a [ActorRecord],
    },
    /// A document: `world/info`, `detector/boxes/about`.
    Document {
        /// Without the domain.
        topic: &'a Arc<str>,
        /// As it was in shared memory.
        header: DocumentHeader,
        /// Its text.
        text: &'a str,
    },
    /// A result of a user's program.
    Result {
        /// Without the domain: `detector/boxes`.
        topic: &'a Arc<str>,
        /// As it was in shared memory.
        header: ResultHeader,
        /// `header.body_bytes`.
        body: Payload<'a>,
        /// `header.n_inputs` records.
        inputs: &'a [InputRecord],
    },
    /// An entry of the journal of commands.
    Journal {
        /// JSON.
        text: &'a str,
    },
    /// A message of another program, or of a user's own type.
    Foreign {
        /// As in the file, without a leading slash.
        topic: &'a Arc<str>,
        /// Name of its schema, for example `foxglove.RawImage`; empty if it has none.
        schema: &'a str,
        /// Encoding of the message, for example `protobuf` or `cdr`.
        encoding: &'a str,
        /// The message.
        bytes: &'a [u8],
    },
}

/// Reads samples one after another; one chunk is in memory at a time.
///
/// What cannot be read is passed over and counted, see [`Samples::damage`].
#[derive(Debug)]
pub struct Samples {
    index: Arc<Index>,
    pub(super) wanted: BTreeMap<u16, Wanted>,
    from_nanos: u64,
    to_nanos: u64,
    pub(super) reader: PieceReader,
    is_open: bool,
    next_piece: usize,
    end_piece: usize,
    pub(super) n_opened: u64,
    pub(super) waiting: VecDeque<Waiting>,
    ahead: Ahead,
    damage: Damage,
    topic: Arc<str>,
    foreign: ForeignType,
    pub(super) text: Vec<u8>,
    coded: Vec<u8>,
    pub(super) records: Vec<ActorRecord>,
    inputs: Vec<InputRecord>,
}

impl Samples {
    pub(crate) fn new(
        index: Arc<Index>,
        reader: PieceReader,
        wanted: BTreeMap<u16, Wanted>,
        from_nanos: u64,
        to_nanos: u64,
    ) -> Samples {
        Samples {
            index,
            wanted,
            from_nanos,
            to_nanos,
            reader,
            is_open: false,
            next_piece: 0,
            end_piece: usize::MAX,
            n_opened: 0,
            waiting: VecDeque::new(),
            ahead: Ahead::default(),
            damage: Damage::default(),
            topic: "".into(),
            foreign: ForeignType::default(),
            text: Vec::new(),
            coded: Vec::new(),
            records: Vec::new(),
            inputs: Vec::new(),
        }
    }

    /// Unpacks up to `n_threads` compressed chunks on threads of their own while one is read: faster,
    /// for as many chunks in memory.
    pub fn read_ahead(mut self, n_threads: usize) -> Samples {
        self.ahead = Ahead::new(n_threads);
        self
    }

    /// The place before the sample that [`Samples::next`] gives next.
    pub fn mark(&self) -> Mark {
        let (piece, at) = match self.is_open {
            true => (self.next_piece.saturating_sub(1), self.reader.position()),
            false => (self.next_piece, 0),
        };
        Mark {
            place: Place { piece, at },
            is_open: self.is_open,
            waiting: self.waiting.clone(),
        }
    }

    /// Goes on at a place of these samples, wherever the reading is now.
    ///
    /// # Errors
    /// If the disk cannot be read.
    pub fn back_to(&mut self, mark: &Mark) -> anyhow::Result<()> {
        let index = self.index.clone();
        self.waiting.clone_from(&mark.waiting);
        self.next_piece = mark.place.piece;
        self.is_open = false;
        if let Some(piece) = index.pieces.get(mark.place.piece).filter(|_| mark.is_open) {
            self.next_piece = self.next_piece.saturating_add(1);
            match self.reader.open(piece) {
                Ok(()) => {
                    self.reader.go_to(mark.place.at);
                    self.is_open = true;
                }
                Err(Fault::Damaged(what)) => self.damage.note("chunk", || what),
                Err(Fault::Io(error)) => self.disk(error)?,
            }
        }
        Ok(())
    }

    /// What could not be read so far.
    pub fn damage(&self) -> &Damage {
        &self.damage
    }

    /// Goes on with the first sample that is filed under `nanos` or later, wherever the reading is
    /// now.
    pub fn skip_to(&mut self, nanos: u64) {
        self.from_nanos = nanos;
        self.is_open = false;
        self.next_piece = 0;
        self.waiting.clear();
    }

    /// Goes on with this piece of the file.
    pub(crate) fn start_at(&mut self, piece: usize) {
        self.is_open = false;
        self.next_piece = piece;
        self.waiting.clear();
    }

    /// Reads this piece of the file and none after it.
    pub(crate) fn only_piece(&mut self, piece: usize) {
        self.start_at(piece);
        self.end_piece = piece.saturating_add(1);
    }

    /// The next sample; `None` at the end.
    ///
    /// # Errors
    /// If the disk cannot be read. Damage is no error.
    #[expect(
        clippy::should_implement_trait,
        reason = "a sample borrows from the reader, which no Iterator can express"
    )]
    pub fn next(&mut self) -> anyhow::Result<Option<Sample<'_>>> {
        let found = loop {
            let Some(message) = self.next_message()? else {
                for late in std::mem::take(&mut self.waiting) {
                    self.missing(&late);
                }
                return Ok(None);
            };
            match self.find(message) {
                Ok(Some(found)) => break found,
                Ok(None) => {}
                Err(Trouble::Bad(kind, sentence)) => self.damage.note(kind, || sentence),
                Err(Trouble::Io(error)) => self.disk(error)?,
            }
        };
        Ok(Some(self.sample(found)))
    }

    /// Counts what the end of the file cut off; passes on what the disk says.
    fn disk(&mut self, error: io::Error) -> anyhow::Result<()> {
        if error.kind() != io::ErrorKind::UnexpectedEof {
            return Err(error).context("cannot read the recording");
        }
        self.damage
            .note("chunk", || "the file ends inside a chunk".into());
        self.is_open = false;
        Ok(())
    }

    pub(super) fn missing(&mut self, late: &Waiting) {
        self.damage.note("payload", || {
            format!(
                "{} of {:.6} s: its bytes should be on {}, where they are not",
                late.head.topic,
                late.head.message.log_nanos as f64 * 1e-9,
                late.channel_topic
            )
        });
    }

    fn next_message(&mut self) -> anyhow::Result<Option<Message>> {
        loop {
            if !self.is_open && !self.open_next()? {
                return Ok(None);
            }
            let (opcode, at, len) = match self.reader.next_record() {
                Ok(Some(record)) => record,
                Ok(None) => {
                    self.is_open = false;
                    if self.reader.is_wrong_at_end() {
                        self.damage.note("checksum", || {
                            "an uncompressed chunk does not have the checksum that is given for it; its samples may be damaged".into()
                        });
                    }
                    continue;
                }
                Err(Fault::Damaged(what)) => {
                    self.damage.note("chunk", || what);
                    self.is_open = false;
                    continue;
                }
                Err(Fault::Io(error)) => {
                    self.disk(error)?;
                    continue;
                }
            };
            if opcode != op::MESSAGE {
                continue;
            }
            let Some(data_bytes) = len.checked_sub(MESSAGE_HEADER_BYTES) else {
                self.damage
                    .note("message", || format!("a message of {len} bytes"));
                continue;
            };
            let head = match self.reader.look(at, MESSAGE_HEADER_BYTES as usize) {
                Ok(head) => head,
                Err(error) => {
                    self.disk(error)?;
                    continue;
                }
            };
            let message = Message {
                place: Place {
                    piece: self.next_piece.saturating_sub(1),
                    at,
                },
                channel: u16_at(head, 0).unwrap_or_default(),
                sequence: u32_at(head, 2).unwrap_or_default(),
                log_nanos: u64_at(head, 6).unwrap_or_default(),
                publish_nanos: u64_at(head, 14).unwrap_or_default(),
                data: (at.saturating_add(MESSAGE_HEADER_BYTES), data_bytes),
            };
            if (self.from_nanos..self.to_nanos).contains(&message.log_nanos)
                || (self.to_nanos == u64::MAX && message.log_nanos == u64::MAX)
            {
                return Ok(Some(message));
            }
        }
    }

    /// Begins to unpack the pieces that come next, if they are compressed like this one.
    fn unpack_ahead(&mut self) {
        if self.ahead.n_threads() == 0 || !self.reader.is_unpacked() {
            return;
        }
        let (index, wanted) = (self.index.clone(), &self.wanted);
        let times = (self.from_nanos, self.to_nanos);
        let next = index.pieces.iter().enumerate().skip(self.next_piece);
        let next = next.filter(|(_, piece)| is_wanted(piece, wanted, times));
        self.ahead.begin(next, &self.reader);
    }

    /// Opens the next piece that can hold something that is wanted.
    fn open_next(&mut self) -> anyhow::Result<bool> {
        loop {
            let index = self.index.clone();
            let pieces = &index.pieces[..index.pieces.len().min(self.end_piece)];
            let Some(piece) = pieces.get(self.next_piece) else {
                return Ok(false);
            };
            self.next_piece = self.next_piece.saturating_add(1);
            if !is_wanted(piece, &self.wanted, (self.from_nanos, self.to_nanos)) {
                continue;
            }
            let number = self.next_piece.saturating_sub(1);
            let opened = match self.ahead.take(number, &mut self.reader) {
                Some(()) => Ok(()),
                None => self.reader.open(piece),
            };
            match opened {
                Ok(()) => {
                    self.is_open = true;
                    self.n_opened = self.n_opened.saturating_add(1);
                    self.unpack_ahead();
                    let oldest = self.n_opened.saturating_sub(MAX_PIECES_APART);
                    while self
                        .waiting
                        .front()
                        .is_some_and(|late| late.piece_number < oldest)
                    {
                        if let Some(late) = self.waiting.pop_front() {
                            self.missing(&late);
                        }
                    }
                    return Ok(true);
                }
                Err(Fault::Damaged(what)) => self.damage.note("chunk", || what),
                Err(Fault::Io(error)) => self.disk(error)?,
            }
        }
    }

    /// Hands out what was found.
    fn sample(&mut self, found: Found) -> Sample<'_> {
        let (message, taken) = match found {
            Found::Whole(head, span) => return self.whole_sample(head, span),
            Found::Taken(message, taken) => (message, taken),
        };
        let text = &self.text;
        let what = match taken {
            Taken::Snapshot(header) => What::Snapshot {
                header: *header,
                records: &self.records,
            },
            Taken::Document(topic, header) => {
                self.topic = topic;
                What::Document {
                    topic: &self.topic,
                    header,
                    text: std::str::from_utf8(text).unwrap_or_default(),
                }
            }
            Taken::Journal => What::Journal {
                text: std::str::from_utf8(text).unwrap_or_default(),
            },
            Taken::Foreign(topic, of) => {
                self.topic = topic;
                self.foreign = of;
                What::Foreign {
                    topic: &self.topic,
                    schema: &self.foreign.schema,
                    encoding: &self.foreign.encoding,
                    bytes: text,
                }
            }
        };
        Sample {
            log_nanos: message.log_nanos,
            publish_nanos: message.publish_nanos,
            sequence: message.sequence,
            place: message.place,
            what,
        }
    }

    fn whole_sample(&mut self, head: Head, span: Span) -> Sample<'_> {
        let place = Place {
            piece: self.next_piece.saturating_sub(1),
            at: span.0,
        };
        self.topic = head.topic;
        let topic = &self.topic;
        let (header, codec) = match &head.of {
            HeadOf::Frame(header, codec) => (**header, codec.clone()),
            HeadOf::Result(..) => (FrameHeader::zeroed(), String::new()),
        };
        let payload = Payload {
            reader: &mut self.reader,
            coded: &mut self.coded,
            span,
            len: head.of.payload_bytes() as usize,
            codec,
            header,
        };
        let what = match head.of {
            HeadOf::Frame(..) => What::Frame {
                topic,
                header,
                payload,
            },
            HeadOf::Result(header, inputs) => {
                self.inputs = inputs;
                What::Result {
                    topic,
                    header: *header,
                    inputs: &self.inputs,
                    body: payload,
                }
            }
        };
        Sample {
            log_nanos: head.message.log_nanos,
            publish_nanos: head.message.publish_nanos,
            sequence: head.message.sequence,
            place,
            what,
        }
    }
}

/// Whether a piece can hold something that is wanted.
fn is_wanted(piece: &Piece, wanted: &BTreeMap<u16, Wanted>, (from, to): (u64, u64)) -> bool {
    let channels = piece.channels.as_ref();
    piece.end_nanos >= from
        && piece.start_nanos < to
        && channels.is_none_or(|ids| ids.iter().any(|id| wanted.contains_key(id)))
}
