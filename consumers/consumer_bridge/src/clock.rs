//! Clocks of two machines: what `CLOCK_MONOTONIC` of the other one reads when ours reads something.
//!
//! Stamps in headers are of the machine that wrote them. The receiving bridge asks the other for its
//! clock and translates, so that ages computed here are right to half of the shortest round trip.

use std::time::Instant;

use schema_bus::mono_now;
use schema_frames::{FrameHeader, InputRecord, ResultHeader};

/// Answers that are remembered; the one with the shortest round trip counts.
const REMEMBERED: usize = 8;

/// Name of this machine.
pub fn host_name() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    name.trim().to_owned()
}

/// What changes with every start of the machine: two processes that read the same have one clock.
fn boot_id() -> String {
    let id = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default();
    id.trim().to_owned()
}

/// What this machine answers when it is asked for its clock.
pub fn answer() -> String {
    format!("{} {}", boot_id(), mono_now().0)
}

/// One answer of another machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Reading {
    round_trip_nanos: u64,
    /// Their clock less ours.
    ahead_nanos: i64,
}

/// The clock of another machine.
#[derive(Clone, Debug, Default)]
pub struct Clock {
    readings: Vec<Reading>,
    is_same: bool,
}

impl Clock {
    /// Notes an answer to a question that was asked and answered when our clock read so.
    pub fn note(&mut self, answer: &str, asked_nanos: u64, answered_nanos: u64) {
        self.note_at(answer, asked_nanos, answered_nanos, &boot_id());
    }

    fn note_at(&mut self, answer: &str, asked_nanos: u64, now_nanos: u64, own_boot: &str) {
        let Some((boot, theirs)) = answer.split_once(' ') else {
            return;
        };
        let Ok(theirs_nanos) = theirs.trim().parse::<u64>() else {
            return;
        };
        self.is_same = !own_boot.is_empty() && boot == own_boot;
        let round_trip_nanos = now_nanos.saturating_sub(asked_nanos);
        let middle_nanos = asked_nanos + round_trip_nanos / 2;
        if self.readings.len() == REMEMBERED {
            self.readings.remove(0);
        }
        self.readings.push(Reading {
            round_trip_nanos,
            ahead_nanos: theirs_nanos.wrapping_sub(middle_nanos) as i64,
        });
    }

    /// Their clock less ours, nanoseconds; 0 until it is known, and between processes of one
    /// machine.
    pub fn ahead_nanos(&self) -> i64 {
        if self.is_same {
            return 0;
        }
        let best = self.readings.iter().min_by_key(|of| of.round_trip_nanos);
        best.map_or(0, |reading| reading.ahead_nanos)
    }

    /// Translates the stamps of a frame. Those that take part in hashes are no clock's.
    pub fn translate_frame(&self, header: &mut FrameHeader) {
        self.translate(&mut header.rendered_mono_nanos);
        self.translate(&mut header.published_mono_nanos);
    }

    /// Translates the stamps of a result.
    pub fn translate_result(&self, header: &mut ResultHeader) {
        self.translate(&mut header.origin_mono_nanos);
        self.translate(&mut header.taken_mono_nanos);
        self.translate(&mut header.published_mono_nanos);
    }

    /// Translates the stamps of an input of a result.
    pub fn translate_input(&self, input: &mut InputRecord) {
        self.translate(&mut input.published_mono_nanos);
        self.translate(&mut input.taken_mono_nanos);
    }

    /// 0 says that there was no moment, and stays.
    fn translate(&self, stamp_nanos: &mut u64) {
        if *stamp_nanos != 0 {
            // The other machine may say anything.
            let behind_nanos = self.ahead_nanos().saturating_neg();
            *stamp_nanos = stamp_nanos.saturating_add_signed(behind_nanos).max(1);
        }
    }
}

/// When something that is done again and again is due.
#[derive(Debug, Default)]
pub struct Due(Option<Instant>);

impl Due {
    /// Whether it is due, the first time at once and then every `every`.
    pub fn is_due(&mut self, every: std::time::Duration) -> bool {
        let now = Instant::now();
        let is_due = self.0.is_none_or(|at| now >= at);
        if is_due {
            self.0 = Some(now + every);
        }
        is_due
    }

    /// Makes it due now.
    pub fn hurry(&mut self) {
        self.0 = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shortest_round_trip_counts() {
        let mut clock = Clock::default();
        // Theirs is 1000 ahead; the first answer took long on its way back.
        clock.note_at("other 2100", 1000, 1800, "own");
        clock.note_at("other 3010", 2000, 2020, "own");
        clock.note_at("other 4300", 3000, 3400, "own");
        assert_eq!(clock.ahead_nanos(), 1000);
        let mut header = FrameHeader::new(schema_frames::Modality::Rgb);
        (header.rendered_mono_nanos, header.published_mono_nanos) = (5000, 0);
        clock.translate_frame(&mut header);
        assert_eq!(header.rendered_mono_nanos, 4000);
        assert_eq!(header.published_mono_nanos, 0, "no moment stays none");
    }

    #[test]
    fn processes_of_one_machine_have_one_clock() {
        let mut clock = Clock::default();
        let now = mono_now().0;
        clock.note(&answer(), now.saturating_sub(5_000_000), now);
        assert_eq!(clock.ahead_nanos(), 0);
        let odd = format!("other {}", i64::MIN as u64);
        let mut other = Clock::default();
        other.note_at(&odd, 0, 0, "own");
        let mut header = FrameHeader::new(schema_frames::Modality::Rgb);
        header.rendered_mono_nanos = 5000;
        other.translate_frame(&mut header);
        assert_eq!(other.ahead_nanos(), i64::MIN);
        clock.note_at("nonsense", 0, 1, "own");
        clock.note_at("other later", 0, 1, "own");
        assert_eq!(clock.ahead_nanos(), 0);
    }
}
