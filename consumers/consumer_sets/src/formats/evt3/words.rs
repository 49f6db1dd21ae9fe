//! The 16-bit words of EVT 3.0, the stream that Prophesee's event cameras send and their RAW files
//! hold. Only what changed is sent: the time, the row, and single or grouped columns.

use anyhow::ensure;

/// Columns and rows that the words can name.
pub const MAX_SIDE_PX: u32 = 2048;

const ADDR_Y: u16 = 0x0000;
const ADDR_X: u16 = 0x2000;
const VECT_BASE_X: u16 = 0x3000;
const VECT_12: u16 = 0x4000;
const VECT_8: u16 = 0x5000;
const TIME_LOW: u16 = 0x6000;
const TIME_HIGH: u16 = 0x8000;
/// The bit of the polarity beside a column.
const BRIGHTER: u16 = 1 << 11;
/// Longest stretch of time that is written, in units of 4.096 ms: some three days, whose words take
/// 128 MiB. Every such unit is sent, so a time near 2^64 would have no end.
const MAX_SILENCE: u64 = 1 << 26;
/// The same in seconds.
const MAX_SILENCE_SECS: u64 = MAX_SILENCE * 4096 / 1_000_000;
/// Of that many columns a group of twelve takes fewer words than single ones.
const WORTH_A_GROUP: usize = 3;

/// A brightness change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Event {
    /// Microseconds since the stream's time 0.
    pub micros: u64,
    /// Column, pixels.
    pub x_px: u16,
    /// Row, pixels.
    pub y_px: u16,
    /// Whether it became brighter.
    pub brighter: bool,
}

/// Turns events into words. The words have 24 bits of time, and a decoder counts how often those
/// overflow; so the upper half is sent for every 4.096 ms, those without events included.
#[derive(Clone, Debug, Default)]
pub struct Encoder {
    /// Time, in units of 4.096 ms, that was sent last.
    high: Option<u64>,
    low: Option<u16>,
    row: Option<u16>,
    micros: u64,
}

impl Encoder {
    /// An encoder whose stream begins at time 0.
    pub fn new() -> Encoder {
        Encoder::default()
    }

    /// Appends the words of events, in their order, as little-endian bytes.
    ///
    /// # Errors
    /// If times go back or a pixel is beyond 2048.
    pub fn encode(&mut self, events: &[Event], out: &mut Vec<u8>) -> anyhow::Result<()> {
        let mut rest = events;
        while let Some(first) = rest.first() {
            ensure!(
                first.micros >= self.micros,
                "events go back in time: {} µs after {} µs",
                first.micros,
                self.micros
            );
            ensure!(
                u32::from(first.x_px) < MAX_SIDE_PX && u32::from(first.y_px) < MAX_SIDE_PX,
                "an event is at column {}, row {}; EVT 3.0 ends at {MAX_SIDE_PX}",
                first.x_px,
                first.y_px
            );
            self.put_time(first.micros, out)?;
            if self.row != Some(first.y_px) {
                self.row = Some(first.y_px);
                put(out, ADDR_Y | first.y_px);
            }
            let line = same_line(rest);
            put_line(&rest[..line], out);
            rest = &rest[line..];
        }
        Ok(())
    }

    /// Sends the time up to `micros` without an event, so that a reader knows how far it is.
    ///
    /// # Errors
    /// If that is days later.
    pub fn pass_time(&mut self, micros: u64, out: &mut Vec<u8>) -> anyhow::Result<()> {
        match micros > self.micros {
            true => self.put_time(micros, out),
            false => Ok(()),
        }
    }

    fn put_time(&mut self, micros: u64, out: &mut Vec<u8>) -> anyhow::Result<()> {
        let (high, low) = (micros >> 12, (micros & 0xfff) as u16);
        let first = self.high.map_or(0, |sent| sent.saturating_add(1));
        ensure!(
            high.saturating_sub(first) < MAX_SILENCE,
            "EVT 3.0 counts all time from 0 on in steps of 4 ms, and {micros} µs come {} s after what was written, at most {} s are; export a recording whose times begin earlier",
            micros.saturating_sub(self.micros) / 1_000_000,
            MAX_SILENCE_SECS
        );
        self.micros = micros;
        for next in first..=high {
            put(out, TIME_HIGH | (next & 0xfff) as u16);
            (self.high, self.low) = (Some(next), None);
        }
        if self.low != Some(low) {
            self.low = Some(low);
            put(out, TIME_LOW | low);
        }
        Ok(())
    }
}

fn put(out: &mut Vec<u8>, word: u16) {
    out.extend(word.to_le_bytes());
}

/// How many of the first events share time, row and polarity, with rising columns.
fn same_line(events: &[Event]) -> usize {
    let is_next = |pair: &[Event]| {
        let (a, b) = (pair[0], pair[1]);
        let same = (a.micros, a.y_px, a.brighter) == (b.micros, b.y_px, b.brighter);
        same && a.x_px < b.x_px && u32::from(b.x_px) < MAX_SIDE_PX
    };
    let n_next = events.windows(2).take_while(|pair| is_next(pair)).count();
    n_next.saturating_add(1)
}

/// Writes the columns of a line of events.
fn put_line(line: &[Event], out: &mut Vec<u8>) {
    let polarity = if line[0].brighter { BRIGHTER } else { 0 };
    // Events among the columns from `base` on.
    let within = |events: &[Event], base: u16, n: u16| {
        events
            .iter()
            .take_while(|it| it.x_px.wrapping_sub(base) < n)
            .count()
    };
    let bits = |events: &[Event], base: u16| {
        events.iter().fold(0u16, |bits, it| {
            bits | 1u16.wrapping_shl(u32::from(it.x_px.wrapping_sub(base)))
        })
    };
    let mut rest = line;
    while let Some(first) = rest.first() {
        let mut base = first.x_px;
        let mut n = within(rest, base, 12);
        if n < WORTH_A_GROUP {
            put(out, ADDR_X | polarity | base);
            rest = &rest[1..];
            continue;
        }
        put(out, VECT_BASE_X | polarity | base);
        // A group moves the base to its end, so that the next one needs no base.
        while n > 0 {
            if within(rest, base, 8) == n {
                put(out, VECT_8 | bits(&rest[..n], base));
                base = base.wrapping_add(8);
            } else {
                put(out, VECT_12 | bits(&rest[..n], base));
                base = base.wrapping_add(12);
            }
            rest = &rest[n..];
            n = within(rest, base, 12);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(micros: u64, x_px: u16, y_px: u16, brighter: bool) -> Event {
        Event {
            micros,
            x_px,
            y_px,
            brighter,
        }
    }

    fn words(events: &[Event]) -> Vec<u16> {
        let mut out = Vec::new();
        Encoder::new().encode(events, &mut out).unwrap();
        out.chunks_exact(2)
            .map(|word| u16::from_le_bytes([word[0], word[1]]))
            .collect()
    }

    /// A decoder after Prophesee's description of the words.
    fn decode(words: &[u16]) -> Vec<Event> {
        let (mut loops, mut high, mut low, mut y, mut x, mut on) = (0u64, 0u64, 0u64, 0, 0, false);
        let mut events = Vec::new();
        for word in words {
            let value = word & 0xfff;
            let micros = |loops: u64, high: u64, low: u64| (loops << 24) | (high << 12) | low;
            match word >> 12 {
                0x0 => y = value & 0x7ff,
                0x2 => events.push(event(
                    micros(loops, high, low),
                    value & 0x7ff,
                    y,
                    value & BRIGHTER != 0,
                )),
                0x3 => (x, on) = (value & 0x7ff, value & BRIGHTER != 0),
                kind @ (0x4 | 0x5) => {
                    let n = if kind == 4 { 12 } else { 8 };
                    for bit in (0..n).filter(|bit| value >> bit & 1 == 1) {
                        events.push(event(micros(loops, high, low), x + bit, y, on));
                    }
                    x += n;
                }
                0x6 => low = u64::from(value),
                0x8 => {
                    if u64::from(value) < high {
                        loops += 1;
                    }
                    (high, low) = (u64::from(value), 0);
                }
                other => panic!("word {other:x} is not written"),
            }
        }
        events
    }

    #[test]
    fn an_event_is_time_row_and_column() {
        assert_eq!(
            words(&[event(4096 + 5, 3, 7, true), event(4096 + 5, 3, 8, false)]),
            [0x8000, 0x8001, 0x6005, 0x0007, 0x2803, 0x0008, 0x2003]
        );
    }

    #[test]
    fn neighbours_are_sent_as_groups() {
        let line: Vec<Event> = (10..34).map(|x| event(0, x, 1, true)).collect();
        assert_eq!(
            words(&line),
            [0x8000, 0x6000, 0x0001, 0x3800 | 10, 0x4fff, 0x4fff]
        );
        let few = [
            event(0, 0, 0, false),
            event(0, 2, 0, false),
            event(0, 7, 0, false),
        ];
        assert_eq!(words(&few), [0x8000, 0x6000, 0, 0x3000, 0x5085]);
    }

    #[test]
    fn whatever_is_written_reads_back_past_overflows_of_the_time() {
        let mut random = fastrand::Rng::with_seed(3);
        for dense in [1, 40, 2000] {
            let mut events = Vec::new();
            let mut micros = 0;
            for _ in 0..20_000 {
                micros += if random.usize(0..dense) == 0 {
                    random.u64(0..4_000)
                } else {
                    0
                };
                events.push(event(
                    micros,
                    random.u16(0..2048),
                    random.u16(0..6),
                    random.bool(),
                ));
            }
            events.sort_by_key(|it| (it.micros, it.y_px, it.brighter, it.x_px));
            events.push(event(micros + 40_000_000, 1, 1, true));
            assert_eq!(decode(&words(&events)), events, "{dense}");
        }
    }

    #[test]
    fn a_stream_in_pieces_is_the_same_stream() {
        let events: Vec<Event> = (0..100)
            .map(|i| event(i * 997, i as u16, 3, true))
            .collect();
        let mut encoder = Encoder::new();
        let mut out = Vec::new();
        for piece in events.chunks(7) {
            encoder.encode(piece, &mut out).unwrap();
        }
        let mut whole = Vec::new();
        Encoder::new().encode(&events, &mut whole).unwrap();
        assert_eq!(out, whole);
        encoder.pass_time(500_000, &mut out).unwrap();
        assert!(
            encoder.pass_time(u64::MAX, &mut out).is_err(),
            "no end of time"
        );
        assert!(out.len() > whole.len());
        assert!(
            encoder.encode(&events[..1], &mut out).is_err(),
            "back in time"
        );
        assert!(
            encoder
                .encode(&[event(500_000, 2048, 0, true)], &mut out)
                .is_err()
        );
    }
}
