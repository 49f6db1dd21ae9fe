//! Runs the entries of a journal again (`simd --journal`): each at its edge, in order, as when they
//! were noted. Until it ends nobody else changes the world.

use std::collections::VecDeque;
use std::path::Path;

use schema_frames::JournalHead;

use super::reader::{Act, Entry, JournalReader, Stretch};

/// Entries below which more are read.
const MIN_AHEAD: usize = 1024;

/// A journal that is being run again.
pub struct Player {
    /// What the run began with.
    head: JournalHead,
    /// The entries that come next, as far as they are read.
    entries: VecDeque<Entry>,
    /// What comes behind them, if that is known: see [`Stretch::end`].
    end: Option<anyhow::Result<()>>,
    /// Whether more entries are being read.
    is_reading: bool,
    /// Simulated time up to which the journal holds, nanoseconds; without it, up to the last entry.
    until_nanos: Option<u64>,
    is_difference_said: bool,
}

/// What a journal has for an edge.
#[derive(Debug)]
pub enum Next {
    /// Something acts.
    Act(Act),
    /// Nothing more acts.
    Nothing,
    /// That is known once more of the journal is read.
    Unread,
}

impl Player {
    /// Opens a journal and reads its first entries; the further ones come from the reader.
    ///
    /// # Errors
    /// If it is no journal, or cannot be read.
    pub fn open(path: &Path, until_nanos: Option<u64>) -> anyhow::Result<(Player, JournalReader)> {
        let (mut reader, head) = JournalReader::open(path)?;
        let Stretch { entries, end } = reader.read_on();
        let end = match end {
            Some(Err(error)) if entries.is_empty() => return Err(error),
            end => end,
        };
        let player = Player {
            head,
            entries: entries.into(),
            end,
            is_reading: false,
            until_nanos,
            is_difference_said: false,
        };
        Ok((player, reader))
    }

    /// What the run began with.
    pub fn head(&self) -> &JournalHead {
        &self.head
    }

    /// Whether more of the journal is to be read now; then it must be given to [`Player::add`].
    pub fn begin_to_read(&mut self) -> bool {
        let is_little = self.end.is_none() && self.entries.len() < MIN_AHEAD;
        is_little && !std::mem::replace(&mut self.is_reading, true)
    }

    /// Takes the entries that come next.
    pub fn add(&mut self, stretch: Stretch) {
        self.is_reading = false;
        self.entries.extend(stretch.entries);
        self.end = stretch.end;
    }

    /// What acts next at the edge behind tick `edge`.
    ///
    /// # Errors
    /// Why the journal cannot be read further, once all before it has acted.
    pub fn next_at(&mut self, edge: u64) -> anyhow::Result<Next> {
        match self.entries.front() {
            Some(entry) if entry.edge > edge => return Ok(Next::Nothing),
            Some(_) => {}
            None => {
                return match self.end.take() {
                    None => Ok(Next::Unread),
                    Some(Err(error)) => Err(error),
                    Some(Ok(())) => {
                        self.end = Some(Ok(()));
                        Ok(Next::Nothing)
                    }
                };
            }
        }
        let entry = self.entries.pop_front().expect("just looked at");
        Ok(Next::Act(entry.act))
    }

    /// The files in front of everything else, of which the first map may be one.
    pub fn first_files(&mut self) -> Vec<Act> {
        let is_file = |entry: &Entry| entry.edge == 0 && matches!(entry.act, Act::File { .. });
        let n_files = self.entries.iter().take_while(|it| is_file(it)).count();
        self.entries.drain(..n_files).map(|it| it.act).collect()
    }

    /// Whether the journal holds no longer at simulated time `now_nanos`, from which the next tick
    /// takes `period_nanos`.
    pub fn is_over(&self, now_nanos: u64, period_nanos: u64) -> bool {
        match self.until_nanos {
            Some(until_nanos) => now_nanos.saturating_add(period_nanos) > until_nanos,
            None => self.entries.is_empty() && matches!(self.end, Some(Ok(()))),
        }
    }

    /// Says for the first time that an answer is not what it was.
    pub fn compare(&mut self, tick: u64, client: &str, now: &[String], noted: &[String]) {
        if now == noted || noted.is_empty() || std::mem::replace(&mut self.is_difference_said, true)
        {
            return;
        }
        let idx = now.iter().zip(noted).take_while(|(a, b)| a == b).count();
        let none = "nothing".to_owned();
        tracing::warn!(
            tick,
            "the run goes another way: a command of {client:?} was answered with {}, now with {}; said once",
            noted.get(idx).unwrap_or(&none),
            now.get(idx).unwrap_or(&none)
        );
    }
}

#[cfg(test)]
mod tests {
    use base64::Engine as _;
    use base64::engine::general_purpose::STANDARD;
    use schema_frames::{JournalAct, JournalEntry, JournalFile, VehicleControlRecord};

    use super::*;

    fn open(
        name: &str,
        text: &str,
        until_nanos: Option<u64>,
    ) -> anyhow::Result<(Player, JournalReader)> {
        let path =
            std::env::temp_dir().join(format!("gantry-player-{name}-{}", std::process::id()));
        std::fs::write(&path, text).unwrap();
        let player = Player::open(&path, until_nanos);
        std::fs::remove_file(&path).unwrap();
        player
    }

    fn entry(n: u64, edge: u64, act: JournalAct) -> String {
        serde_json::to_string(&JournalEntry { n, edge, act }).unwrap() + "\n"
    }

    fn piece(piece: u32, bytes: &[u8]) -> JournalAct {
        JournalAct::File {
            of: JournalFile::Map,
            name: "a".into(),
            title: "a".into(),
            piece,
            n_pieces: 2,
            bytes: STANDARD.encode(bytes),
        }
    }

    #[test]
    fn entries_come_at_their_edges_and_files_in_one_piece() {
        let head = serde_json::to_string(&JournalHead::default()).unwrap() + "\n";
        let record = VehicleControlRecord {
            throttle_ratio: f32::NAN,
            ..VehicleControlRecord::new(7, Default::default())
        };
        let controls = JournalAct::Controls {
            writer: "w".into(),
            records: STANDARD.encode(bytemuck::bytes_of(&record)),
        };
        let text = head
            + &entry(1, 0, piece(0, b"ab"))
            + &entry(2, 0, piece(1, b"c"))
            + &entry(3, 4, controls);
        let (mut player, _) = open("edges", &text, None).unwrap();
        let files = player.first_files();
        assert!(matches!(&files[..], [Act::File { bytes, .. }] if bytes == b"abc"));
        assert!(matches!(player.next_at(3).unwrap(), Next::Nothing) && !player.is_over(0, 1));
        let Next::Act(Act::Controls { records, .. }) = player.next_at(4).unwrap() else {
            panic!("no controls")
        };
        assert_eq!(bytemuck::bytes_of(&records[0]), bytemuck::bytes_of(&record));
        assert!(matches!(player.next_at(4).unwrap(), Next::Nothing) && player.is_over(0, 1));
        let (player, _) = open("until", &text, Some(100)).unwrap();
        assert!(!player.is_over(50, 50) && player.is_over(51, 50));
    }

    #[test]
    fn a_file_whose_pieces_are_not_all_there_is_refused() {
        let head = serde_json::to_string(&JournalHead::default()).unwrap() + "\n";
        let error = |name: &str, text: &str| {
            let error = open(name, &(head.clone() + text), None)
                .err()
                .expect("refused");
            format!("{error:#}")
        };
        let last = error("last", &entry(1, 0, piece(u32::MAX, b"abc")));
        assert!(last.contains("piece 4294967295 of a file"), "{last}");
        let twice = entry(1, 0, piece(0, b"a")) + &entry(2, 0, piece(0, b"ab"));
        let (mut player, _) = open(
            "begun",
            &(head.clone() + &twice + &entry(3, 0, piece(1, b"c"))),
            None,
        )
        .unwrap();
        let files = player.first_files();
        assert!(matches!(&files[..], [Act::File { bytes, .. }] if bytes == b"abc"));
    }

    #[test]
    fn what_is_no_journal_is_refused_with_its_line() {
        let error =
            |name: &str, text: &str| open(name, text, None).err().expect("refused").to_string();
        assert!(error("empty", "").contains("is empty"));
        assert!(error("foreign", "hello\n").contains("line 1"));
        let head = serde_json::to_string(&JournalHead::default()).unwrap();
        assert!(error("cut", &format!("{head}\n{{\"n\":1")).contains("line 2"));
        let newer = head.replace("\"v\":0", "\"v\":9");
        assert!(error("newer", &newer).contains("version 9"));
    }

    /// A journal that is longer than what is read of it at first.
    #[test]
    fn entries_that_are_not_read_yet_are_waited_for() {
        let head = serde_json::to_string(&JournalHead::default()).unwrap() + "\n";
        let act = |n: u64| JournalAct::Audience {
            topic: n.to_string(),
            is_made: true,
        };
        let n_entries = 10_000;
        let lines: String = (1..=n_entries).map(|n| entry(n, n, act(n))).collect();
        let (mut player, mut reader) =
            open("long", &(head + &lines + "what is this"), None).unwrap();
        let (mut n_read, mut n_stretches) = (0, 1);
        let mut unread = false;
        let error = loop {
            assert!(!player.is_over(0, 1));
            match player.next_at(n_entries + 1) {
                Ok(Next::Act(Act::Audience { topic, .. })) => {
                    n_read += 1;
                    assert_eq!(topic, n_read.to_string());
                }
                Ok(Next::Unread) if player.begin_to_read() => {
                    assert!(!player.begin_to_read(), "once");
                    assert!(matches!(player.next_at(u64::MAX), Ok(Next::Unread)));
                    unread = true;
                    n_stretches += 1;
                    player.add(reader.read_on());
                }
                Err(error) => break error.to_string(),
                other => panic!("{other:?}"),
            }
        };
        assert_eq!((n_read, n_stretches, unread), (n_entries, 3, true));
        assert!(
            error.contains(&format!("line {}", n_entries + 2)),
            "{error}"
        );
    }
}
