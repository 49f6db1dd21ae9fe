//! `gantry-record info`: what a recording holds, found by reading it through.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{BufReader, Read};
use std::path::Path;

use anyhow::Context;
use launch_cli::files::open_plain;
use mcap::records::{Record, op};
use serde::Serialize;

use crate::files::{SET, SET_END};
use schema_recording::walk::{End, RecordWalk, chunk, for_each_in_chunk, record};
use schema_recording::wire::bytes_field;

/// What a file holds.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FileInfo {
    /// Whether it ends as an MCAP file should.
    pub complete: bool,
    /// Why it does not; empty if it does.
    pub problem: String,
    /// Size of the file.
    pub file_bytes: u64,
    /// Messages in it.
    pub n_messages: u64,
    /// Chunks in it.
    pub n_chunks: u64,
    /// Chunks whose contents cannot be read.
    pub n_bad_chunks: u64,
    /// Compressions used, e.g. `lz4`.
    pub compressions: Vec<String>,
    /// Sum of the chunks' unpacked sizes.
    pub unpacked_bytes: u64,
    /// Earliest simulated time, nanoseconds.
    pub start_sim_nanos: u64,
    /// Latest simulated time, nanoseconds.
    pub end_sim_nanos: u64,
    /// Channels by topic.
    pub channels: Vec<ChannelInfo>,
    /// Names of the attachments.
    pub attachments: Vec<String>,
    /// Metadata records.
    pub metadata: BTreeMap<String, BTreeMap<String, String>>,
}

/// One channel of a file.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ChannelInfo {
    /// Topic.
    pub topic: String,
    /// Name of its schema.
    pub schema: String,
    /// Messages.
    pub n_messages: u64,
    /// Messages per simulated second between its first and last message; 0 with fewer than two.
    pub rate_hz: f64,
    /// Bytes of its messages, unpacked.
    pub n_bytes: u64,
    /// Codecs of its payloads; see `schema_recording::codec`.
    pub codecs: Vec<String>,
}

#[derive(Default)]
struct Tally {
    info: FileInfo,
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, (ChannelInfo, Option<(u64, u64)>)>,
}

/// Reads a file through and reports what it holds.
///
/// # Errors
/// If it cannot be opened or does not begin like an MCAP file; damage further in is reported in the
/// result.
pub fn file_info(path: &Path) -> anyhow::Result<FileInfo> {
    let (file, file_bytes) =
        open_plain(path).with_context(|| format!("cannot open {}", path.display()))?;
    info(BufReader::with_capacity(1 << 20, file), file_bytes)
        .with_context(|| path.display().to_string())
}

/// [`file_info`] on any reader of `file_bytes` bytes.
///
/// # Errors
/// If it does not begin like an MCAP file.
pub fn info<R: Read>(input: R, file_bytes: u64) -> anyhow::Result<FileInfo> {
    let mut walk = RecordWalk::new(input, file_bytes)?;
    let mut tally = Tally {
        info: FileInfo {
            file_bytes,
            start_sim_nanos: u64::MAX,
            ..Default::default()
        },
        ..Default::default()
    };
    while let Some((opcode, body)) = walk.next_record() {
        match opcode {
            op::DATA_END => while walk.next_record().is_some() {},
            op::CHUNK => tally.chunk(&body),
            _ => drop(record(opcode, &body).map(|record| tally.record(&record))),
        }
    }
    Ok(tally.finish(walk.end()))
}

impl Tally {
    fn chunk(&mut self, body: &[u8]) {
        self.info.n_chunks = self.info.n_chunks.saturating_add(1);
        if let Ok((header, _)) = chunk(body) {
            self.info.unpacked_bytes = self
                .info
                .unpacked_bytes
                .saturating_add(header.uncompressed_size);
            let name = if header.compression.is_empty() {
                "none".to_string()
            } else {
                header.compression
            };
            if !self.info.compressions.contains(&name) {
                self.info.compressions.push(name);
            }
        }
        let read = for_each_in_chunk(body, &mut |record| {
            self.record(&record);
            Ok(())
        });
        let n_bad = u64::from(read.is_err());
        self.info.n_bad_chunks = self.info.n_bad_chunks.saturating_add(n_bad);
    }

    fn record(&mut self, record: &Record<'_>) {
        match record {
            Record::Schema { header, .. } => {
                drop(self.schemas.insert(header.id, header.name.clone()))
            }
            Record::Channel(channel) => {
                let schema = self
                    .schemas
                    .get(&channel.schema_id)
                    .cloned()
                    .unwrap_or_default();
                let fresh = ChannelInfo {
                    topic: channel.topic.clone(),
                    schema,
                    ..Default::default()
                };
                self.channels.entry(channel.id).or_insert((fresh, None));
            }
            Record::Message { header, data } => {
                self.info.n_messages = self.info.n_messages.saturating_add(1);
                self.info.start_sim_nanos = self.info.start_sim_nanos.min(header.log_time);
                self.info.end_sim_nanos = self.info.end_sim_nanos.max(header.log_time);
                if let Some((channel, span)) = self.channels.get_mut(&header.channel_id) {
                    channel.n_messages = channel.n_messages.saturating_add(1);
                    channel.n_bytes = channel.n_bytes.saturating_add(data.len() as u64);
                    if channel.schema == "gantry.Frame"
                        && let Some(codec) = codec(data)
                        && !channel.codecs.iter().any(|known| known == codec)
                    {
                        channel.codecs.push(codec.to_string());
                    }
                    let (first, last) = span.unwrap_or((header.log_time, header.log_time));
                    *span = Some((first.min(header.log_time), last.max(header.log_time)));
                }
            }
            Record::Attachment { header, .. } => self.info.attachments.push(header.name.clone()),
            Record::Metadata(metadata) => drop(
                self.info
                    .metadata
                    .insert(metadata.name.clone(), metadata.metadata.clone()),
            ),
            _ => {}
        }
    }

    fn finish(mut self, end: End) -> FileInfo {
        self.info.problem = match end {
            End::Complete if self.info.n_bad_chunks == 0 => String::new(),
            End::Complete => format!("{} of its chunks are damaged", self.info.n_bad_chunks),
            End::CutOff => "it was cut off before its end".to_string(),
            End::Damaged(why) => why,
        };
        self.info.complete = self.info.problem.is_empty();
        self.info.start_sim_nanos = self.info.start_sim_nanos.min(self.info.end_sim_nanos);
        let rate = |(channel, span): (ChannelInfo, Option<(u64, u64)>)| {
            let secs = span.map_or(0.0, |(first, last)| {
                last.saturating_sub(first) as f64 * 1e-9
            });
            let rate_hz = if secs > 0.0 {
                channel.n_messages.saturating_sub(1) as f64 / secs
            } else {
                0.0
            };
            ChannelInfo { rate_hz, ..channel }
        };
        self.info.channels = self.channels.into_values().map(rate).collect();
        self.info.channels.sort_by(|a, b| a.topic.cmp(&b.topic));
        self.info
    }
}

/// The codec of a `gantry.Frame`; the last field.
fn codec(message: &[u8]) -> Option<&str> {
    let name = std::str::from_utf8(bytes_field(message, 7)?).ok()?;
    (name.len() <= MAX_CODEC_BYTES).then_some(name)
}

/// Longest name of a codec that is told.
const MAX_CODEC_BYTES: usize = 32;

impl FileInfo {
    /// The report as text for people.
    pub fn text(&self) -> String {
        let mut out = String::new();
        let secs = self.end_sim_nanos.saturating_sub(self.start_sim_nanos) as f64 * 1e-9;
        let megabytes = self.file_bytes as f64 / 1e6;
        let _ = writeln!(
            out,
            "{megabytes:.1} MB, {:.1} MB unpacked ({}), {} chunks",
            self.unpacked_bytes as f64 / 1e6,
            self.compressions.join(", "),
            self.n_chunks
        );
        let _ = writeln!(
            out,
            "{} messages over {secs:.2} simulated seconds, from {:.3} s",
            self.n_messages,
            self.start_sim_nanos as f64 * 1e-9
        );
        let _ = writeln!(
            out,
            "\n{:<40} {:<28} {:>9} {:>9} {:>10}  CODEC",
            "TOPIC", "SCHEMA", "MESSAGES", "HZ", "MB"
        );
        for channel in &self.channels {
            let _ = writeln!(
                out,
                "{:<40} {:<28} {:>9} {:>9.2} {:>10.3}  {}",
                channel.topic,
                channel.schema,
                channel.n_messages,
                channel.rate_hz,
                channel.n_bytes as f64 / 1e6,
                channel.codecs.join(", ")
            );
        }
        if let Some(set) = self.metadata.get(SET) {
            let of = |record: &str, key: &str| {
                let pairs = self.metadata.get(record);
                let name = pairs.and_then(|it| it.get(key)).cloned();
                name.filter(|it| !it.is_empty())
            };
            let _ = writeln!(
                out,
                "\nfile {} of the set {}: before it {}, after it {}",
                set.get("part").map_or("?", String::as_str),
                set.get("set").map_or("?", String::as_str),
                of(SET, "previous").as_deref().unwrap_or("none"),
                of(SET_END, "next").as_deref().unwrap_or("none")
            );
        }
        if !self.attachments.is_empty() {
            let _ = writeln!(out, "\nattachments: {}", self.attachments.join(", "));
        }
        for (name, pairs) in &self.metadata {
            let pairs: Vec<String> = pairs
                .iter()
                .map(|(key, value)| format!("{key}={value}"))
                .collect();
            let _ = writeln!(out, "metadata {name}: {}", pairs.join(", "));
        }
        if !self.complete {
            let _ = writeln!(
                out,
                "\nNot whole: {}. `gantry-record recover IN OUT` rescues what is there.",
                self.problem
            );
        }
        out
    }
}
