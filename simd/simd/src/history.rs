//! What acted on the world: noted in this run, and run again from an earlier one.

mod journal;
mod player;
mod reader;

use schema_frames::{CommandReply, JournalFile, VehicleControlRecord};
use schema_types::Tick;

pub use journal::{Journal, Surroundings, build, head};
use player::Next;
pub use player::Player;
pub use reader::{Act, Entry, JournalReader, Stretch};

/// The journal of this run, and the one that is run again.
pub struct History {
    journal: Journal,
    /// The journal that is run again, until it ends.
    player: Option<Player>,
}

/// What the journal that is run again has for the edge behind a tick.
#[derive(Debug)]
pub enum Played {
    /// Something acts.
    Act(Act),
    /// Nothing more acts at this edge.
    Waits,
    /// What acts is known once more of the journal is read.
    Unread,
    /// The journal holds no longer.
    Ends,
}

impl History {
    /// The journal of a run that begins, and that of the one that it repeats.
    pub fn new(journal: Journal, player: Option<Player>) -> History {
        History { journal, player }
    }

    /// Whether a journal is being run again; until it ends nobody else changes the world.
    pub fn is_played(&self) -> bool {
        self.player.is_some()
    }

    /// What acts next at the edge behind tick `edge`. `now_nanos` is the simulated time of the edge,
    /// from which the next tick takes `period_nanos`.
    ///
    /// # Errors
    /// If the journal cannot be read.
    pub fn next_at(
        &mut self,
        Tick(edge): Tick,
        now_nanos: u64,
        period_nanos: u64,
    ) -> anyhow::Result<Played> {
        let Some(player) = &mut self.player else {
            return Ok(Played::Waits);
        };
        if player.is_over(now_nanos, period_nanos) {
            self.player = None;
            return Ok(Played::Ends);
        }
        Ok(match player.next_at(edge)? {
            Next::Act(act) => Played::Act(act),
            Next::Nothing => Played::Waits,
            Next::Unread => Played::Unread,
        })
    }

    /// Whether more of the journal that is run again is to be read now; then it must be given to
    /// [`History::add`].
    pub fn begin_to_read(&mut self) -> bool {
        self.player.as_mut().is_some_and(Player::begin_to_read)
    }

    /// Takes entries of the journal that is run again.
    pub fn add(&mut self, stretch: Stretch) {
        if let Some(player) = &mut self.player {
            player.add(stretch);
        }
    }

    /// Says for the first time that commands which are run again have other outcomes than noted.
    pub fn compare(&mut self, Tick(edge): Tick, client: &str, now: &[String], noted: &[String]) {
        if let Some(player) = &mut self.player {
            player.compare(edge, client, now, noted);
        }
    }

    /// Notes a request of which at least one command acted.
    pub fn note_commands(&mut self, client: &str, seq: u64, text: &str, outcomes: Vec<String>) {
        self.journal.note_commands(client, seq, text, outcomes);
    }

    /// Notes a file that a command of this round read.
    pub fn note_file(&mut self, of: JournalFile, name: &str, title: &str, bytes: &[u8]) {
        self.journal.note_file(of, name, title, bytes);
    }

    /// Notes the records of one sample on `control/vehicles`.
    pub fn note_controls(
        &mut self,
        Tick(edge): Tick,
        writer: &str,
        records: &[VehicleControlRecord],
    ) {
        self.journal.note_controls(edge, writer, records);
    }

    /// Notes that frames of a topic are made from the tick after `edge` on, or no longer.
    pub fn note_audience(&mut self, Tick(edge): Tick, topic: &str, is_made: bool) {
        self.journal.note_audience(edge, topic, is_made);
    }

    /// A round of requests at the edge behind tick `edge` is served.
    pub fn end_round(&mut self, Tick(edge): Tick) {
        self.journal.end_round(edge);
    }

    /// Answers with the entries after number `after`.
    pub fn answer(&self, after: u64) -> CommandReply {
        self.journal.answer(after)
    }
}
