//! The journal that the daemon keeps of its run: what acted on the world, at which edge and in which
//! order (`schema_frames::journal`). Memory is bounded: beyond its limit the oldest entries go, and
//! then the run cannot be run again from recordings that begin later.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufReader, Read};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use schema_frames::journal::{JOURNAL_ANSWER_BYTES, JOURNAL_VERSION};
use schema_frames::{
    CommandReply, JournalAct, JournalEntry, JournalFile, JournalHead, VehicleControlRecord,
};
use sensor_camera::Quality;

use crate::settings::Settings;
use simd_frames::hash::BytesHash;
use simd_frames::topic::Writer;

/// Bytes of a file in one entry.
const PIECE_BYTES: usize = 512 << 10;
/// What an entry takes besides its texts, about.
const ENTRY_BYTES: usize = 160;

/// What the daemon notes.
pub struct Journal {
    head: JournalHead,
    entries: VecDeque<(JournalEntry, usize)>,
    /// Number of the next entry.
    next: u64,
    n_bytes: usize,
    limit_bytes: usize,
    /// What acted in the round of requests that is being served.
    round: Vec<JournalAct>,
    is_loss_said: bool,
}

impl Journal {
    /// A journal without entries that takes at most `limit_bytes` of memory.
    pub fn new(head: JournalHead, limit_bytes: usize) -> Journal {
        Journal {
            head,
            entries: VecDeque::new(),
            next: 1,
            n_bytes: 0,
            limit_bytes,
            round: Vec::new(),
            is_loss_said: false,
        }
    }

    /// Notes a request of which at least one command acted.
    pub fn note_commands(&mut self, client: &str, seq: u64, text: &str, outcomes: Vec<String>) {
        self.round.push(JournalAct::Commands {
            client: client.to_owned(),
            seq,
            text: text.to_owned(),
            outcomes,
            is_last_of_round: false,
        });
    }

    /// Notes a file that a command of this round read.
    pub fn note_file(&mut self, of: JournalFile, name: &str, title: &str, bytes: &[u8]) {
        let n_pieces = bytes.len().div_ceil(PIECE_BYTES).max(1);
        for piece in 0..n_pieces {
            let end = bytes.len().min((piece + 1) * PIECE_BYTES);
            self.round.push(JournalAct::File {
                of,
                name: name.to_owned(),
                title: title.to_owned(),
                piece: piece as u32,
                n_pieces: n_pieces as u32,
                bytes: STANDARD.encode(&bytes[piece * PIECE_BYTES..end]),
            });
        }
    }

    /// A round of requests at the edge behind tick `edge` is served, and the documents are published.
    pub fn end_round(&mut self, edge: u64) {
        let mut acts = std::mem::take(&mut self.round);
        let last = acts.iter_mut().rev().find_map(|act| match act {
            JournalAct::Commands {
                is_last_of_round, ..
            } => Some(is_last_of_round),
            _ => None,
        });
        if let Some(last) = last {
            *last = true;
        }
        for act in acts.drain(..) {
            self.note(edge, act);
        }
        self.round = acts;
    }

    /// Notes the records of one sample on `control/vehicles`.
    pub fn note_controls(&mut self, edge: u64, writer: &str, records: &[VehicleControlRecord]) {
        if !records.is_empty() {
            let act = JournalAct::Controls {
                writer: writer.to_owned(),
                records: STANDARD.encode(bytemuck::cast_slice(records)),
            };
            self.note(edge, act);
        }
    }

    /// Notes that frames of a topic are made from the tick after `edge` on, or no longer.
    pub fn note_audience(&mut self, edge: u64, topic: &str, is_made: bool) {
        let act = JournalAct::Audience {
            topic: topic.to_owned(),
            is_made,
        };
        self.note(edge, act);
    }

    fn note(&mut self, edge: u64, act: JournalAct) {
        let n_bytes = ENTRY_BYTES + texts_bytes(&act);
        let entry = JournalEntry {
            n: self.next,
            edge,
            act,
        };
        self.next += 1;
        self.n_bytes += n_bytes;
        self.entries.push_back((entry, n_bytes));
        while self.n_bytes > self.limit_bytes {
            let Some((_, n_bytes)) = self.entries.pop_front() else {
                break;
            };
            self.n_bytes -= n_bytes;
            if !std::mem::replace(&mut self.is_loss_said, true) {
                tracing::warn!(
                    tick = edge,
                    "the journal of this run is longer than {} MiB, and its beginning is forgotten: recordings that begin from now on cannot be run again; --journal-mb keeps more",
                    self.limit_bytes >> 20
                );
            }
        }
    }

    /// Answers with the entries after number `after`.
    pub fn answer(&self, after: u64) -> CommandReply {
        let first = self.next - self.entries.len() as u64;
        let from = after.saturating_add(1).clamp(first, self.next);
        let mut room_bytes = JOURNAL_ANSWER_BYTES;
        let entries: Vec<JournalEntry> = self
            .entries
            .range((from - first) as usize..)
            .enumerate()
            .take_while(|(idx, (_, n_bytes))| {
                let fits = *idx == 0 || *n_bytes <= room_bytes;
                room_bytes = room_bytes.saturating_sub(*n_bytes);
                fits
            })
            .map(|(_, (entry, _))| entry.clone())
            .collect();
        let next = from + entries.len() as u64;
        CommandReply::Journal {
            head: (after == 0).then(|| Box::new(self.head.clone())),
            first,
            entries,
            next: next - 1,
            more: next < self.next,
        }
    }
}

/// Bytes of an entry's texts as JSON, about: quotes in a request are escaped.
fn texts_bytes(act: &JournalAct) -> usize {
    match act {
        JournalAct::Commands {
            client,
            text,
            outcomes,
            ..
        } => {
            let outcomes: usize = outcomes.iter().map(|outcome| outcome.len() + 4).sum();
            let n_quotes = text.bytes().filter(|byte| *byte == b'"').count();
            client.len() + text.len() + n_quotes + outcomes
        }
        JournalAct::Controls { writer, records } => writer.len() + records.len(),
        JournalAct::Audience { topic, .. } => topic.len(),
        JournalAct::File {
            name, title, bytes, ..
        } => name.len() + title.len() + bytes.len(),
    }
}

/// What the bytes of a run depend on besides its entries.
pub struct Surroundings<'a> {
    pub settings: &'a Settings,
    pub epoch: u64,
    /// Name of the first map.
    pub map: &'a str,
    /// OpenDRIVE text of the first map.
    pub open_drive: &'a str,
    pub adapter: &'a str,
    pub quality: Quality,
    pub lidars_on: Writer,
}

/// The head of a journal.
pub fn head(around: &Surroundings<'_>) -> JournalHead {
    JournalHead {
        v: JOURNAL_VERSION,
        version: env!("CARGO_PKG_VERSION").into(),
        build: build(),
        epoch: around.epoch.to_string(),
        launch: around.settings.launch.to_toml_with_defaults(),
        added_sensors: around.settings.added_sensors.clone(),
        seed: around.settings.launch.scenario.seed,
        map: around.map.to_owned(),
        map_hash: format!(
            "{:016x}",
            BytesHash::new()
                .chunk(around.open_drive.as_bytes())
                .finish()
        ),
        adapter: around.adapter.to_owned(),
        quality: match around.quality {
            Quality::Low => "low",
            Quality::High => "high",
        }
        .into(),
        lidars_on: match around.lidars_on {
            Writer::Cpu => "cpu",
            Writer::Gpu => "gpu",
        }
        .into(),
    }
}

/// Name of this program's build: the linker's build id, or else a hash of the whole file.
pub fn build() -> String {
    let read = || -> std::io::Result<String> {
        let mut file = BufReader::new(File::open("/proc/self/exe")?);
        let mut start = vec![0; 64 << 10];
        let n_bytes = file.read(&mut start)?;
        start.truncate(n_bytes);
        if let Some(id) = build_id(&start) {
            return Ok(id);
        }
        let mut hash = BytesHash::new().chunk(&start);
        let mut block = vec![0; 1 << 20];
        loop {
            match file.read(&mut block)? {
                0 => return Ok(format!("{:016x}", hash.finish())),
                n_bytes => hash = hash.chunk(&block[..n_bytes]),
            }
        }
    };
    read().unwrap_or_else(|error| {
        tracing::debug!(%error, "this program's own file cannot be read");
        "unknown".into()
    })
}

/// The build id in the note that linkers put near the start of a program.
fn build_id(start: &[u8]) -> Option<String> {
    // An ELF note: length of the name, length of the content, type 3, the name "GNU".
    let at = start.windows(16).position(|w| {
        w[..4] == 4u32.to_le_bytes() && w[8..12] == 3u32.to_le_bytes() && &w[12..] == b"GNU\0"
    })?;
    let length = u32::from_le_bytes(start[at + 4..at + 8].try_into().ok()?) as usize;
    let id = start.get(at + 16..at + 16 + length.min(64))?;
    (length > 0).then(|| id.iter().map(|byte| format!("{byte:02x}")).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entries(reply: CommandReply) -> (u64, Vec<JournalEntry>, u64, bool) {
        match reply {
            CommandReply::Journal {
                first,
                entries,
                next,
                more,
                ..
            } => (first, entries, next, more),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn answers_are_bounded_and_follow_one_another() {
        let mut journal = Journal::new(JournalHead::default(), 64 << 20);
        assert_eq!(entries(journal.answer(0)), (1, vec![], 0, false));
        let file = vec![7; 3 << 20];
        journal.note_file(JournalFile::Map, "a.xodr", "a", &file);
        assert!(
            entries(journal.answer(0)).1.is_empty(),
            "the round is not over"
        );
        journal.note_commands("me", 1, "{}", vec!["done".into()]);
        journal.note_commands("me", 2, "{}", vec!["done".into()]);
        journal.end_round(4);
        let (mut after, mut seen, mut bytes) = (0, 0, Vec::new());
        loop {
            let (_, found, next, more) = entries(journal.answer(after));
            for entry in &found {
                seen += 1;
                assert_eq!((entry.n, entry.edge), (seen, 4));
                match &entry.act {
                    JournalAct::File { bytes: piece, .. } => {
                        bytes.extend(STANDARD.decode(piece).unwrap())
                    }
                    JournalAct::Commands {
                        seq,
                        is_last_of_round,
                        ..
                    } => assert_eq!(*is_last_of_round, *seq == 2),
                    other => panic!("{other:?}"),
                }
            }
            let text = serde_json::to_string(&journal.answer(after)).unwrap();
            assert!(text.len() < JOURNAL_ANSWER_BYTES + 8192, "{}", text.len());
            after = next;
            if !more {
                break;
            }
        }
        assert_eq!((seen, bytes), (8, file));
        assert_eq!(entries(journal.answer(after)).1, []);
        assert_eq!(entries(journal.answer(u64::MAX)).2, after);
    }

    #[test]
    fn a_journal_that_is_too_long_forgets_its_beginning_and_tells() {
        let mut journal = Journal::new(JournalHead::default(), 10_000);
        for edge in 0..1000 {
            journal.note_audience(edge, "ego/front/dvs", edge % 2 == 0);
        }
        let (first, found, next, more) = entries(journal.answer(0));
        assert!(first > 900 && found[0].n == first && next == 1000 && !more);
        assert!(journal.n_bytes <= 10_000);
    }

    #[test]
    fn a_build_has_a_name() {
        let name = build();
        assert!(name.len() >= 16 && name == build(), "{name}");
        assert_eq!(build_id(b"no note in here, only text"), None);
    }
}
