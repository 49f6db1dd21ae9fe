//! Cuts recordings and joins them, message by message.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::hash::{DefaultHasher, Hasher as _};
use std::path::{Path, PathBuf};

use anyhow::{bail, ensure};
use mcap::Attachment;
use mcap::records::{MessageHeader, Record};
use schema_recording::read::RecordingFile;

use crate::copier::Copier;
use crate::files::{SET, SET_END};
use crate::pull::Pull;
use crate::select::Select;

/// Most messages of documents and of the journal from before a cut that are remembered, bytes.
const MAX_BEFORE_BYTES: usize = 256 << 20;

/// Which part of a recording stays.
#[derive(Clone, Debug)]
pub struct Cut {
    /// First simulated time, nanoseconds.
    pub from_nanos: u64,
    /// First simulated time that is left out.
    pub to_nanos: u64,
    /// Topics of frames, results and foreign messages.
    pub select: Select,
}

/// What a channel's messages are to a cut.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// One holds until the next: the last before the cut is filed at its beginning.
    Document,
    /// All from the beginning of the run are needed.
    Journal,
    Timed,
}

/// Copies what lies between two times. Documents in force and the journal so far are filed at the
/// beginning; metadata and attachments are kept.
///
/// # Errors
/// If `input` is damaged or not finished, `output` exists, the disk refuses, or nothing is left.
pub fn trim(input: &Path, output: &Path, cut: &Cut) -> anyhow::Result<u64> {
    ensure!(
        cut.from_nanos < cut.to_nanos,
        "--from must be before --to; {:.3} s is not before {:.3} s",
        cut.from_nanos as f64 * 1e-9,
        cut.to_nanos as f64 * 1e-9
    );
    let mut pull = Pull::open(input)?;
    let mut out = Copier::create(output)?;
    let mut schemas: HashMap<u16, String> = HashMap::new();
    let mut kinds: HashMap<u16, Kind> = HashMap::new();
    let mut before = Before::default();
    let mut is_empty = true;
    let mut span = (u64::MAX, 0u64);
    while let Some(record) = pull.next()? {
        match record {
            Record::Schema { header, data } => {
                schemas.insert(header.id, header.name.clone());
                out.schema(0, &header, &data)?;
            }
            Record::Channel(channel) if cut.select.takes_channel(&channel.topic) => {
                let schema = schemas.get(&channel.schema_id).map_or("", String::as_str);
                let kind = match schema {
                    "gantry.Document" => Kind::Document,
                    "gantry.Journal" => Kind::Journal,
                    _ => Kind::Timed,
                };
                kinds.insert(channel.id, kind);
                out.channel(0, &channel)?;
            }
            Record::Message { header, data } => {
                span = (span.0.min(header.log_time), span.1.max(header.log_time));
                let Some(kind) = kinds.get(&header.channel_id) else {
                    continue;
                };
                if header.log_time >= cut.to_nanos {
                    continue;
                }
                if header.log_time < cut.from_nanos {
                    before.keep(*kind, header, &data)?;
                    continue;
                }
                before.write(&mut out, cut.from_nanos)?;
                is_empty = false;
                out.message(0, &header, &data)?;
            }
            Record::Attachment { header, data, .. } => out.attach(&Attachment {
                log_time: header.log_time,
                create_time: header.create_time,
                name: header.name,
                media_type: header.media_type,
                data,
            })?,
            Record::Metadata(of) => out.metadata(&of.name, &of.metadata)?,
            _ => {}
        }
    }
    if is_empty {
        bail!(
            "{} holds nothing between {:.3} s and {:.3} s; it covers {:.3} s to {:.3} s of simulated time",
            input.display(),
            cut.from_nanos as f64 * 1e-9,
            cut.to_nanos.min(u64::MAX / 2) as f64 * 1e-9,
            span.0.min(span.1) as f64 * 1e-9,
            span.1 as f64 * 1e-9
        );
    }
    out.finish()
}

/// Messages from before a cut that hold in it.
#[derive(Default)]
struct Before {
    documents: BTreeMap<u16, (MessageHeader, Vec<u8>)>,
    journal: Vec<(MessageHeader, Vec<u8>)>,
    n_bytes: usize,
}

impl Before {
    fn keep(&mut self, kind: Kind, header: MessageHeader, data: &[u8]) -> anyhow::Result<()> {
        match kind {
            Kind::Timed => return Ok(()),
            Kind::Document => {
                let kept = (header, data.to_vec());
                let old = self.documents.insert(kept.0.channel_id, kept);
                let n_less = old.map_or(0, |(_, data)| data.len());
                self.n_bytes = self.n_bytes.saturating_sub(n_less);
            }
            Kind::Journal => self.journal.push((header, data.to_vec())),
        }
        self.n_bytes = self.n_bytes.saturating_add(data.len());
        ensure!(
            self.n_bytes <= MAX_BEFORE_BYTES,
            "documents and journal before the cut have more than {MAX_BEFORE_BYTES} bytes"
        );
        Ok(())
    }

    fn write(&mut self, out: &mut Copier, log_time: u64) -> anyhow::Result<()> {
        let documents = std::mem::take(&mut self.documents).into_values();
        for (header, data) in documents.chain(std::mem::take(&mut self.journal)) {
            out.message(0, &MessageHeader { log_time, ..header }, &data)?;
        }
        Ok(())
    }
}

/// Joins recordings of one run by simulated time: the files of a set, or those of several recorders.
/// What two of them hold alike (documents, journal, map) is written once.
///
/// # Errors
/// If an input is damaged or not finished, the recordings are of different versions or runs,
/// `output` exists, or the disk refuses.
pub fn merge(inputs: &[PathBuf], output: &Path) -> anyhow::Result<u64> {
    check_alike(inputs)?;
    let mut out = Copier::create(output)?;
    let mut seen = BTreeSet::new();
    let mut inputs: Vec<Input> = inputs
        .iter()
        .enumerate()
        .map(|(number, path)| Input::open(number, path))
        .collect::<anyhow::Result<_>>()?;
    for input in &mut inputs {
        input.advance(&mut out, &mut seen)?;
    }
    loop {
        let waiting = inputs.iter_mut().filter(|input| input.head.is_some());
        let earliest = waiting.min_by_key(|input| {
            let head = input.head.as_ref();
            head.map_or(u64::MAX, |(header, _)| header.log_time)
        });
        let Some(input) = earliest else {
            return out.finish();
        };
        if let Some((header, data)) = input.head.take() {
            out.message(input.number, &header, &data)?;
        }
        input.advance(&mut out, &mut seen)?;
    }
}

/// An input of a merge, and its next message.
struct Input {
    number: usize,
    pull: Pull,
    head: Option<(MessageHeader, Vec<u8>)>,
    schemas: HashMap<u16, String>,
    /// Channels whose messages are written once.
    once: HashMap<u16, String>,
}

impl Input {
    fn open(number: usize, path: &Path) -> anyhow::Result<Input> {
        Ok(Input {
            number,
            pull: Pull::open(path)?,
            head: None,
            schemas: HashMap::new(),
            once: HashMap::new(),
        })
    }

    /// Reads up to the next message that is to be written.
    fn advance(&mut self, out: &mut Copier, seen: &mut BTreeSet<u64>) -> anyhow::Result<()> {
        while let Some(record) = self.pull.next()? {
            match record {
                Record::Schema { header, data } => {
                    self.schemas.insert(header.id, header.name.clone());
                    out.schema(self.number, &header, &data)?;
                }
                Record::Channel(channel) => {
                    let schema = self.schemas.get(&channel.schema_id);
                    if schema.is_some_and(|it| it == "gantry.Document" || it == "gantry.Journal") {
                        self.once.insert(channel.id, channel.topic.clone());
                    }
                    out.channel(self.number, &channel)?;
                }
                Record::Message { header, data } => {
                    let is_new = self
                        .once
                        .get(&header.channel_id)
                        .is_none_or(|topic| seen.insert(hash(&(topic, &data))));
                    if is_new {
                        self.head = Some((header, data.into_owned()));
                        return Ok(());
                    }
                }
                Record::Attachment { header, data, .. }
                    if seen.insert(hash(&(&header.name, &data))) =>
                {
                    out.attach(&Attachment {
                        log_time: header.log_time,
                        create_time: header.create_time,
                        name: header.name,
                        media_type: header.media_type,
                        data,
                    })?;
                }
                Record::Metadata(of) => {
                    let is_of_set = of.name == SET || of.name == SET_END;
                    if !is_of_set && seen.insert(hash(&(&of.name, &of.metadata))) {
                        out.metadata(&of.name, &of.metadata)?;
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }
}

fn hash(value: &impl std::hash::Hash) -> u64 {
    let mut hasher = DefaultHasher::new();
    value.hash(&mut hasher);
    hasher.finish()
}

/// Compares what the recordings say about themselves.
fn check_alike(inputs: &[PathBuf]) -> anyhow::Result<()> {
    let mut first: Option<(String, String)> = None;
    for path in inputs {
        let file = RecordingFile::open(path)?;
        let of = |record: &str, key: &str| -> anyhow::Result<String> {
            let pairs = file.metadata(record)?.unwrap_or_default();
            Ok(pairs.get(key).cloned().unwrap_or_default())
        };
        let now = (of("gantry", "schema_version")?, of("world/info", "epoch")?);
        let Some(first) = &first else {
            first = Some(now);
            continue;
        };
        let (a, b) = (inputs[0].display(), path.display());
        ensure!(
            first.0 == now.0,
            "{a} has the schema version {:?} and {b} has {:?}; only recordings of one version can be merged",
            first.0,
            now.0
        );
        ensure!(
            first.1 == now.1 || first.1.is_empty() || now.1.is_empty(),
            "{a} and {b} are of different runs of the simulator (epochs {} and {}), whose clocks have nothing to do with each other",
            first.1,
            now.1
        );
    }
    Ok(())
}
