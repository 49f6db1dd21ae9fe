//! Reading a recording: whole samples, one after another, of a file of any length.
//!
//! [`RecordingFile::open`] learns what is where from the summary at the file's end, so a file of a
//! hundred gigabytes is open at once. A file without a usable summary (`.part`, cut off, damaged) is
//! walked over by the heads of its records. Nothing is collected: one chunk is in memory at a time,
//! and of uncompressed chunks not even that, because payloads are read straight into the caller's
//! memory.
//!
//! Nothing in a file is believed. Headers are checked before a sample is handed out, lengths before
//! memory is made; what cannot be read is passed over and counted ([`Samples::damage`]). Of a
//! compressed chunk the checksum is compared before its first sample, of an uncompressed one at its
//! end, and only if every byte of it was read.
//!
//! ```no_run
//! use schema_recording::read::{RecordingFile, Selection, What};
//!
//! let file = RecordingFile::open("drive.mcap".as_ref())?;
//! let mut samples = file.samples(&Selection::default());
//! while let Some(sample) = samples.next()? {
//!     if let What::Frame { topic, header, mut payload } = sample.what {
//!         println!("{topic} tick {}: {} bytes", header.tick, payload.to_vec()?.len());
//!     }
//! }
//! # Ok::<(), anyhow::Error>(())
//! ```

mod ahead;
mod bytes;
mod chunk;
mod damage;
mod fields;
mod find;
mod index;
mod parts;
mod payload;
mod piece;
mod samples;

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, ensure};
use mcap::records::Record;
use schema_frames::SCHEMA_VERSION;
use schema_frames::document::DocumentHeader;
use schema_types::files::open_plain;

pub use chunk::MAX_CHUNK_BYTES;
pub use damage::Damage;
pub use parts::Place;
pub use payload::{Payload, PayloadError};
pub use samples::{Mark, Sample, Samples, What};

use crate::pattern::matches;
use crate::wire::{COMPRESSED_DATA_FIELD, DATA_FIELD};
use bytes::{RECORD_HEAD_BYTES, Window};
use chunk::PieceReader;
use index::{Index, Stored};
use parts::{ForeignType, Role, Wanted};

/// Longest attachment or metadata record that is read, bytes.
pub const MAX_ATTACHMENT_BYTES: u64 = 256 << 20;

/// What a topic of a file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum TopicKind {
    /// Sensor frames.
    Frame,
    /// Results of users' programs.
    Result,
    /// Snapshots of the actors.
    Snapshot,
    /// A document, or the description of a topic of results.
    Document,
    /// Commands and controls in their order.
    Journal,
    /// What our recorder writes beside a sample, for programs that do not know ours; it holds
    /// nothing new and is not handed out.
    Derived,
    /// Messages of another program, or of a user's own type.
    Foreign,
}

/// A topic of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topic {
    /// Without a leading slash, and without `/gantry` at its end: `ego/front/rgb`.
    pub name: Arc<str>,
    /// What it holds.
    pub kind: TopicKind,
    /// Name of its messages' schema.
    pub schema: String,
    /// Encoding of the schema, for example `protobuf` or `ros2msg`.
    pub schema_encoding: String,
    /// The schema.
    pub schema_data: Vec<u8>,
    /// Encoding of its messages, for example `protobuf` or `cdr`.
    pub encoding: String,
    /// Messages in the file, if its summary says so.
    pub n_messages: Option<u64>,
}

/// Which samples are read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Selection {
    /// First time, simulated nanoseconds.
    pub from_nanos: u64,
    /// First time that is not read; `u64::MAX` for none.
    pub to_nanos: u64,
    /// Patterns of frames, results and foreign messages, `*` for any characters and `?` for one;
    /// none for all. Snapshots, documents and the journal are read in any case.
    pub topics: Vec<String>,
}

impl Default for Selection {
    /// Everything.
    fn default() -> Self {
        Selection {
            from_nanos: 0,
            to_nanos: u64::MAX,
            topics: Vec::new(),
        }
    }
}

impl Selection {
    fn has(&self, topic: &Topic) -> bool {
        let by_name = matches!(
            topic.kind,
            TopicKind::Frame | TopicKind::Result | TopicKind::Foreign
        );
        !by_name
            || self.topics.is_empty()
            || self
                .topics
                .iter()
                .any(|pattern| matches(pattern, &topic.name))
    }
}

/// A document of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedDocument {
    /// Without the domain.
    pub topic: Arc<str>,
    /// As it was in shared memory.
    pub header: DocumentHeader,
    /// Its text.
    pub text: String,
    /// Simulated time under which it is filed.
    pub log_nanos: u64,
}

/// An MCAP file that is open for reading.
#[derive(Debug)]
pub struct RecordingFile {
    file: Arc<File>,
    path: PathBuf,
    file_bytes: u64,
    index: Arc<Index>,
    topics: Vec<Topic>,
    channels: BTreeMap<u16, Wanted>,
}

impl RecordingFile {
    /// Opens a file and learns what is where in it.
    ///
    /// # Errors
    /// A sentence if it cannot be read, is no MCAP file, or was recorded with a newer version of
    /// the frame contract.
    pub fn open(path: &Path) -> anyhow::Result<RecordingFile> {
        let name = path.display();
        let (file, file_bytes) = open_plain(path).with_context(|| format!("cannot open {name}"))?;
        ensure!(
            file_bytes > 0,
            "{name} is empty; nothing was recorded into it"
        );
        let file = Arc::new(file);
        let mut window = Window::new(file.clone());
        let is_mcap = window
            .look(0, 8)
            .with_context(|| format!("cannot read {name}"))?
            == mcap::MAGIC;
        ensure!(
            is_mcap,
            "{name} is not an MCAP file: it does not begin with the bytes 89 4D 43 41 50 30 0D 0A"
        );
        let index =
            Index::read(&mut window, file_bytes).with_context(|| format!("cannot read {name}"))?;
        let (topics, channels) = topics(&index);
        let opened = RecordingFile {
            file,
            path: path.to_path_buf(),
            file_bytes,
            index: Arc::new(index),
            topics,
            channels,
        };
        opened.check_version()?;
        Ok(opened)
    }

    fn check_version(&self) -> anyhow::Result<()> {
        let about = self.metadata("gantry")?.unwrap_or_default();
        let version = about
            .get("schema_version")
            .and_then(|text| text.parse::<u16>().ok());
        if let Some(version) = version {
            ensure!(
                version == SCHEMA_VERSION,
                "{} was recorded with schema {version}, this program reads {SCHEMA_VERSION}; use the version of Gantry that recorded it ({})",
                self.path.display(),
                about.get("recorder").map_or("unknown", String::as_str)
            );
        }
        Ok(())
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Its length, bytes.
    pub fn file_bytes(&self) -> u64 {
        self.file_bytes
    }

    /// Whether the file ends as a whole one does; one that is still written, or was cut off, does
    /// not.
    pub fn is_complete(&self) -> bool {
        self.index.is_complete
    }

    /// Why the file was walked over instead of read from its summary; `None` if it was not.
    pub fn walked_because(&self) -> Option<String> {
        self.index.walked_because.as_ref().map(ToString::to_string)
    }

    /// Whether our recorder wrote it: it holds frames, results, snapshots or documents of ours.
    pub fn is_gantry(&self) -> bool {
        self.topics
            .iter()
            .any(|topic| topic.kind <= TopicKind::Journal)
    }

    /// Its topics by kind and name.
    pub fn topics(&self) -> &[Topic] {
        &self.topics
    }

    /// First and last time under which something is filed, nanoseconds; `None` without any message.
    pub fn span(&self) -> Option<(u64, u64)> {
        let pieces = &self.index.pieces;
        let start = pieces.iter().map(|piece| piece.start_nanos).min()?;
        let end = pieces.iter().map(|piece| piece.end_nanos).max()?;
        Some((start, end.max(start)))
    }

    /// Names of the metadata records, in the order of the file.
    pub fn metadata_names(&self) -> Vec<&str> {
        self.index
            .metadata
            .iter()
            .map(|place| place.name.as_str())
            .collect()
    }

    /// The last metadata record of this name.
    ///
    /// # Errors
    /// If it is damaged or the disk cannot be read.
    pub fn metadata(&self, name: &str) -> anyhow::Result<Option<BTreeMap<String, String>>> {
        let found = self
            .index
            .metadata
            .iter()
            .rev()
            .find(|place| place.name == name);
        let Some(place) = found else { return Ok(None) };
        match self.record(place, "metadata")? {
            Some((opcode, body)) => match crate::walk::record(opcode, &body) {
                Ok(Record::Metadata(of)) if of.name == name => Ok(Some(of.metadata)),
                _ => Err(self.bad_place(place, "metadata")),
            },
            None => Err(self.bad_place(place, "metadata")),
        }
    }

    /// Names of the attachments, in the order of the file.
    pub fn attachment_names(&self) -> Vec<&str> {
        self.index
            .attachments
            .iter()
            .map(|place| place.name.as_str())
            .collect()
    }

    /// The last attachment of this name.
    ///
    /// # Errors
    /// If it is damaged, longer than [`MAX_ATTACHMENT_BYTES`], or the disk cannot be read.
    pub fn attachment(&self, name: &str) -> anyhow::Result<Option<Vec<u8>>> {
        let found = self
            .index
            .attachments
            .iter()
            .rev()
            .find(|place| place.name == name);
        let Some(place) = found else { return Ok(None) };
        let Some((opcode, body)) = self.record(place, "attachment")? else {
            return Err(self.bad_place(place, "attachment"));
        };
        match crate::walk::record(opcode, &body) {
            Ok(Record::Attachment { header, data, crc }) if header.name == name => {
                // The checksum is the last of them.
                let covered = body.split_last_chunk::<4>().map_or(&[][..], |(all, _)| all);
                ensure!(
                    crc == 0 || crc32fast::hash(covered) == crc,
                    "the attachment {name} of {} does not have the checksum that is given for it",
                    self.path.display()
                );
                Ok(Some(data.into_owned()))
            }
            _ => Err(self.bad_place(place, "attachment")),
        }
    }

    fn bad_place(&self, place: &Stored, what: &str) -> anyhow::Error {
        anyhow::anyhow!(
            "the {what} {:?} of {} is damaged; `gantry-record recover` copies what is whole",
            place.name,
            self.path.display()
        )
    }

    /// A record and its opcode; `None` if there is no whole one.
    fn record(&self, place: &Stored, what: &str) -> anyhow::Result<Option<(u8, Vec<u8>)>> {
        ensure!(
            place.len <= MAX_ATTACHMENT_BYTES,
            "the {what} {:?} of {} has {} bytes, at most {MAX_ATTACHMENT_BYTES} are read",
            place.name,
            self.path.display(),
            place.len
        );
        let mut window = Window::new(self.file.clone());
        let head = bytes::record_head(window.look(place.offset, RECORD_HEAD_BYTES as usize)?);
        let body_bytes = place.len.checked_sub(RECORD_HEAD_BYTES);
        let Some((opcode, len)) = head.filter(|(_, len)| Some(*len) == body_bytes) else {
            return Ok(None);
        };
        let mut body = vec![0; len as usize];
        window
            .read_exact(&mut body, place.offset.saturating_add(RECORD_HEAD_BYTES))
            .with_context(|| format!("cannot read {}", self.path.display()))?;
        Ok(Some((opcode, body)))
    }

    /// Reads the samples of a selection in the order of the file.
    pub fn samples(&self, selection: &Selection) -> Samples {
        let times = (selection.from_nanos, selection.to_nanos);
        self.samples_of(times, |topic| selection.has(topic))
    }

    /// As [`RecordingFile::samples`], of the topics that `wanted` chooses, filed from the first time
    /// on and before the second.
    pub fn samples_of(
        &self,
        (from_nanos, to_nanos): (u64, u64),
        wanted: impl Fn(&Topic) -> bool,
    ) -> Samples {
        let names: BTreeSet<&str> = self
            .topics
            .iter()
            .filter(|topic| topic.kind != TopicKind::Derived && wanted(topic))
            .map(|topic| &*topic.name)
            .collect();
        let channels = self
            .channels
            .iter()
            .filter(|(_, of)| names.contains(&*of.topic));
        let channels = channels.map(|(id, of)| (*id, of.clone())).collect();
        Samples::new(
            self.index.clone(),
            PieceReader::new(self.file.clone()),
            channels,
            from_nanos,
            to_nanos,
        )
    }

    /// The documents that are in force at `nanos`: the last of each topic that is filed before or at
    /// it. Only chunks that hold documents are read, from that time backwards.
    ///
    /// # Errors
    /// If the disk cannot be read.
    pub fn documents_at(&self, nanos: u64) -> anyhow::Result<Vec<RecordedDocument>> {
        let is_document = |topic: &Topic| topic.kind == TopicKind::Document;
        let mut missing: BTreeSet<u16> = self
            .channels
            .iter()
            .filter(|(_, of)| of.role == Role::Document)
            .map(|(id, _)| *id)
            .collect();
        let mut found: BTreeMap<Arc<str>, RecordedDocument> = BTreeMap::new();
        let mut samples = self.samples_of((0, nanos.saturating_add(1)), is_document);
        for (idx, piece) in self.index.pieces.iter().enumerate().rev() {
            if missing.is_empty() {
                break;
            }
            let holds = piece
                .channels
                .as_ref()
                .is_none_or(|ids| ids.iter().any(|id| missing.contains(id)));
            if piece.start_nanos > nanos || !holds {
                continue;
            }
            let mut here: BTreeMap<Arc<str>, RecordedDocument> = BTreeMap::new();
            samples.only_piece(idx);
            while let Some(sample) = samples.next()? {
                if let What::Document {
                    topic,
                    header,
                    text,
                } = sample.what
                {
                    let document = RecordedDocument {
                        topic: topic.clone(),
                        header,
                        text: text.to_string(),
                        log_nanos: sample.log_nanos,
                    };
                    here.insert(topic.clone(), document);
                }
            }
            missing.retain(|id| !here.contains_key(&self.channels[id].topic));
            for (topic, document) in here {
                found.entry(topic).or_insert(document);
            }
        }
        Ok(found.into_values().collect())
    }

    /// Reads the samples of one topic, of the first part of the file that has any: to learn what a
    /// topic is like without reading the file.
    pub fn first_of(&self, topic: &Topic) -> Samples {
        let mut samples = self.samples_of((0, u64::MAX), |other| other == topic);
        let ids: Vec<u16> = self
            .channels
            .iter()
            .filter(|(_, of)| of.topic == topic.name)
            .map(|(id, _)| *id)
            .collect();
        let holds = |piece: &piece::Piece| {
            let channels = piece.channels.as_ref();
            channels.is_none_or(|held| held.iter().any(|id| ids.contains(id)))
        };
        let first = self.index.pieces.iter().position(holds);
        samples.start_at(first.unwrap_or(self.index.pieces.len()));
        samples
    }
}

/// What each channel is, and the topics that they make up.
fn topics(index: &Index) -> (Vec<Topic>, BTreeMap<u16, Wanted>) {
    let bare = |topic: &str| topic.strip_prefix('/').unwrap_or(topic).to_string();
    let lossless = |schema: &str| match schema {
        "gantry.Frame" => Some(Role::Frame),
        "gantry.Result" => Some(Role::Result),
        "gantry.Snapshot" => Some(Role::Snapshot),
        "gantry.Document" => Some(Role::Document),
        "gantry.Journal" => Some(Role::Journal),
        _ => None,
    };
    // Topics whose bytes another channel of the same name may hold.
    let pairs: BTreeSet<String> = index
        .channels
        .values()
        .filter(|channel| matches!(&*channel.schema.name, "gantry.Frame" | "gantry.Result"))
        .filter_map(|channel| Some(bare(channel.topic.strip_suffix("/gantry")?)))
        .collect();
    let is_ours = index
        .channels
        .values()
        .any(|of| lossless(&of.schema.name).is_some());
    let mut channels = BTreeMap::new();
    let mut topics: Vec<Topic> = Vec::new();
    for (id, channel) in &index.channels {
        let schema = &channel.schema.name;
        let mut name = bare(&channel.topic);
        let mut kind = match lossless(schema) {
            Some(role) => {
                let kind = match role {
                    Role::Frame => TopicKind::Frame,
                    Role::Result => TopicKind::Result,
                    Role::Snapshot => TopicKind::Snapshot,
                    Role::Journal => TopicKind::Journal,
                    _ => TopicKind::Document,
                };
                if matches!(role, Role::Frame | Role::Result) {
                    name = name.strip_suffix("/gantry").unwrap_or(&name).to_string();
                }
                let topic = name.as_str().into();
                channels.insert(*id, Wanted { topic, role });
                kind
            }
            None => TopicKind::Foreign,
        };
        if kind == TopicKind::Foreign && pairs.contains(&name) {
            kind = TopicKind::Derived;
            let data_field = match schema.as_str() {
                "foxglove.RawImage" | "foxglove.PointCloud" => Some(DATA_FIELD),
                "foxglove.CompressedImage" => Some(COMPRESSED_DATA_FIELD),
                _ => None,
            };
            let role = Role::Bytes { data_field };
            channels.insert(
                *id,
                Wanted {
                    topic: name.as_str().into(),
                    role,
                },
            );
        } else if kind == TopicKind::Foreign {
            let known = schema.starts_with("foxglove.") || schema.starts_with("gantry.");
            if is_ours && known {
                kind = TopicKind::Derived;
            } else {
                let of = ForeignType {
                    schema: schema.as_str().into(),
                    encoding: channel.message_encoding.as_str().into(),
                };
                let role = Role::Foreign(of);
                channels.insert(
                    *id,
                    Wanted {
                        topic: name.as_str().into(),
                        role,
                    },
                );
            }
        }
        let n = index
            .n_messages
            .as_ref()
            .map(|of| of.get(id).copied().unwrap_or(0));
        let known = topics
            .iter_mut()
            .find(|topic| *topic.name == *name && topic.kind == kind);
        match known {
            Some(topic) => {
                topic.n_messages = topic.n_messages.zip(n).map(|(a, b)| a.saturating_add(b))
            }
            None => topics.push(Topic {
                name: name.as_str().into(),
                kind,
                schema: schema.clone(),
                schema_encoding: channel.schema.encoding.clone(),
                schema_data: channel.schema.data.clone(),
                encoding: channel.message_encoding.clone(),
                n_messages: n,
            }),
        }
    }
    topics.sort_by(|a, b| (a.kind, &a.name).cmp(&(b.kind, &b.name)));
    (topics, channels)
}
