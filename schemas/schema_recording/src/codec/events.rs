//! Events of an event camera, brought from the order of time into that of pixels. A pixel's events
//! share object and class, and while brightness changes evenly they come evenly.
//!
//! The filtered bytes are the number of pixels that saw events (u32), then streams: of each pixel the
//! step of `y << 16 | x` from the one before, its number of events less one, the folded step of its
//! object id, its class, and the time of its first event; of every pixel's second event the time since
//! the first; of all later events how much longer than the wait before they came, folded; and the
//! polarities, one bit each, first event of each pixel as it is, later ones 1 where it changes.
//! Words are split into planes of bytes, lowest first.

use super::bytes::{fold32, join, split, unfold32, unpack, word};
use super::error::CodecError;

/// Bytes of an event.
const EVENT_BYTES: usize = 16;
/// Rows that 16 bits can number.
const MAX_ROWS: usize = 1 << 16;

/// An event as its four words: time; y above x; object; above 16 bits that are 0 class, then
/// polarity.
type Words = [u32; 4];

/// Memory of the sort, kept for the next frame.
#[derive(Debug, Default)]
pub(super) struct Sorter {
    /// Events of each row, then where the next one of it goes.
    rows: Vec<u32>,
    /// The same of the columns of one row.
    columns: Vec<u32>,
    /// Events row by row, each in the order of time.
    by_row: Vec<Words>,
    /// Events of one row, pixel by pixel.
    by_pixel: Vec<Words>,
    streams: Streams,
}

#[derive(Debug, Default)]
struct Streams {
    steps: Vec<u32>,
    counts: Vec<u32>,
    objects: Vec<u32>,
    classes: Vec<u8>,
    first_nanos: Vec<u32>,
    second_waits: Vec<u32>,
    later_waits: Vec<u32>,
    polarities: Bits,
}

#[derive(Debug, Default)]
struct Bits {
    bytes: Vec<u8>,
    n: usize,
}

impl Bits {
    fn clear(&mut self) {
        self.bytes.clear();
        self.n = 0;
    }

    #[inline]
    fn push(&mut self, bit: bool) {
        if self.n.is_multiple_of(8) {
            self.bytes.push(0);
        }
        if let Some(last) = self.bytes.last_mut() {
            *last |= (bit as u8) << (7 - self.n % 8);
        }
        self.n += 1;
    }
}

#[inline]
fn x_px(event: &Words) -> usize {
    (event[1] & 0xffff) as usize
}

#[inline]
fn y_px(event: &Words) -> usize {
    (event[1] >> 16) as usize
}

#[inline]
fn polarity(event: &Words) -> u32 {
    event[3] & 1
}

impl Sorter {
    /// Filters events; `false` if they are not in the order of time, y, x, or say of one pixel
    /// different things.
    pub(super) fn encode(&mut self, payload: &[u8], out: &mut Vec<u8>) -> bool {
        let is_list = !payload.is_empty() && payload.len().is_multiple_of(EVENT_BYTES);
        let Some(n_columns) = is_list.then(|| self.sort_rows(payload)).flatten() else {
            return false;
        };
        self.streams.clear();
        let mut last = Last::default();
        let mut begin = 0;
        for y in 0..self.rows.len() {
            // After the sort each row's place is where the next one begins.
            let end = self.rows[y] as usize;
            if end > begin && !self.put_row(begin..end, n_columns, &mut last) {
                return false;
            }
            begin = end;
        }
        self.streams.write(out);
        true
    }

    /// Brings the events into the order of rows; the number of columns. `None` if they are not as
    /// the simulator sends them.
    fn sort_rows(&mut self, payload: &[u8]) -> Option<usize> {
        let (events, _) = payload.as_chunks::<EVENT_BYTES>();
        let read =
            |bytes: &[u8; EVENT_BYTES]| -> Words { std::array::from_fn(|k| word(&bytes[4 * k..])) };
        self.rows.clear();
        self.rows.resize(MAX_ROWS, 0);
        let (mut max_x, mut max_y, mut odd, mut before) = (0, 0, 0, None);
        for event in events.iter().map(read) {
            max_x = max_x.max(x_px(&event));
            max_y = max_y.max(y_px(&event));
            odd |= event[3] & !0xff01;
            let key = Some((event[0] as u64) << 32 | event[1] as u64);
            // Rust orders `None` before everything.
            odd |= (before >= key) as u32;
            before = key;
            self.rows[y_px(&event)] += 1;
        }
        if odd != 0 {
            return None;
        }
        self.rows.truncate(max_y + 1);
        let mut sum = 0;
        for place in &mut self.rows {
            sum += std::mem::replace(place, sum);
        }
        self.by_row.resize(events.len(), [0; 4]);
        for event in events.iter().map(read) {
            let place = &mut self.rows[y_px(&event)];
            self.by_row[*place as usize] = event;
            *place += 1;
        }
        Some(max_x + 1)
    }

    /// Appends a row's pixels to the streams; `false` if events of one pixel say different things.
    fn put_row(&mut self, row: std::ops::Range<usize>, n_columns: usize, last: &mut Last) -> bool {
        let events = &self.by_row[row];
        self.columns.clear();
        self.columns.resize(n_columns, 0);
        events
            .iter()
            .for_each(|event| self.columns[x_px(event)] += 1);
        let mut sum = 0;
        for place in &mut self.columns {
            sum += std::mem::replace(place, sum);
        }
        self.by_pixel.resize(events.len(), [0; 4]);
        for event in events {
            let place = &mut self.columns[x_px(event)];
            self.by_pixel[*place as usize] = *event;
            *place += 1;
        }
        let mut all_same = true;
        let same_pixel = |a: &Words, b: &Words| a[1] == b[1];
        for events in self.by_pixel.chunk_by(same_pixel) {
            all_same &= self.streams.put_pixel(events, last);
        }
        all_same
    }
}

/// What the next pixel is compared with.
#[derive(Default)]
struct Last {
    pixel: u32,
    object: u32,
}

impl Streams {
    fn clear(&mut self) {
        for words in [
            &mut self.steps,
            &mut self.counts,
            &mut self.objects,
            &mut self.first_nanos,
            &mut self.second_waits,
            &mut self.later_waits,
        ] {
            words.clear();
        }
        self.classes.clear();
        self.polarities.clear();
    }

    /// Appends the events of a pixel; `false` if they say different things of it.
    #[inline]
    fn put_pixel(&mut self, events: &[Words], last: &mut Last) -> bool {
        let first = events[0];
        self.steps.push(first[1].wrapping_sub(last.pixel));
        self.counts.push((events.len() - 1) as u32);
        self.objects
            .push(fold32(first[2].wrapping_sub(last.object)));
        self.classes.push((first[3] >> 8) as u8);
        self.first_nanos.push(first[0]);
        self.polarities.push(polarity(&first) != 0);
        (last.pixel, last.object) = (first[1], first[2]);
        let (mut before, mut wait, mut other) = (first, 0u32, 0u32);
        for (i, event) in events[1..].iter().enumerate() {
            let now = event[0].wrapping_sub(before[0]);
            if i == 0 {
                self.second_waits.push(now);
            } else {
                self.later_waits.push(fold32(now.wrapping_sub(wait)));
            }
            self.polarities.push(polarity(event) != polarity(&before));
            other |= event[2] ^ first[2] | (event[3] ^ first[3]) & 0xff00;
            (before, wait) = (*event, now);
        }
        other == 0
    }

    fn write(&self, out: &mut Vec<u8>) {
        let streams = [
            &self.steps,
            &self.counts,
            &self.objects,
            &self.first_nanos,
            &self.second_waits,
            &self.later_waits,
        ];
        let n_words: usize = streams.iter().map(|words| words.len()).sum();
        let [classes, polarities] = [&self.classes, &self.polarities.bytes];
        // What it holds from the last frame is written over, not filled with zeros first.
        out.resize(4 + 4 * n_words + classes.len() + polarities.len(), 0);
        let (head, mut rest) = out.split_at_mut(4);
        head.copy_from_slice(&(self.steps.len() as u32).to_le_bytes());
        for words in streams.into_iter().filter(|words| !words.is_empty()) {
            let (place, behind) = rest.split_at_mut(4 * words.len());
            split(words, place, words.len(), 0);
            rest = behind;
        }
        let (place, rest) = rest.split_at_mut(classes.len());
        place.copy_from_slice(classes);
        rest.copy_from_slice(polarities);
    }
}

/// Decodes events.
pub(super) fn decode(coded: &[u8], out: &mut [u8]) -> Result<(), CodecError> {
    if !out.len().is_multiple_of(EVENT_BYTES) {
        return Err("the payload is no list of events".into());
    }
    let n_events = out.len() / EVENT_BYTES;
    // Four words and a class for each pixel, a word for each event, a bit for each.
    let plain = unpack(coded, 4 + out.len() + 6 * n_events + 8)?;
    let mut rest = Rest(&plain);
    let n_pixels = word(rest.take(4)?) as usize;
    if n_pixels > n_events {
        return Err("coded events name more pixels than there are events".into());
    }
    let steps = rest.words(n_pixels)?;
    let counts = rest.words(n_pixels)?;
    let objects = rest.words(n_pixels)?;
    let first_nanos = rest.words(n_pixels)?;
    let n_second = counts.iter().filter(|count| **count > 0).count();
    let n_counted: u64 = counts.iter().map(|count| *count as u64 + 1).sum();
    if n_counted != n_events as u64 {
        return Err(CodecError(format!(
            "coded events are {n_counted}, the payload has room for {n_events}"
        )));
    }
    let second_waits = rest.words(n_second)?;
    let later_waits = rest.words(n_events - n_pixels - n_second)?;
    let classes = rest.take(n_pixels)?;
    let polarities = rest.take(n_events.div_ceil(8))?;
    if !rest.0.is_empty() {
        return Err("coded events are followed by something else".into());
    }

    let mut second = second_waits.into_iter();
    let mut later = later_waits.into_iter();
    let bit = |at: usize| polarities[at / 8] >> (7 - at % 8) & 1;
    let (mut pixel, mut object, mut at) = (0u32, 0u32, 0usize);
    // The key that events are sorted by, and object, class and polarity.
    let mut events: Vec<(u64, u64)> = Vec::with_capacity(n_events);
    for i in 0..n_pixels {
        pixel = pixel.wrapping_add(steps[i]);
        object = object.wrapping_add(unfold32(objects[i]));
        let (mut nanos, mut wait, mut polarity) = (first_nanos[i], 0u32, 0u8);
        for k in 0..=counts[i] {
            if k == 1 {
                wait = second.next().unwrap_or(0);
            } else if k > 1 {
                wait = wait.wrapping_add(unfold32(later.next().unwrap_or(0)));
            }
            nanos = nanos.wrapping_add(wait);
            polarity ^= bit(at);
            at += 1;
            let about = object as u64 | (polarity as u64) << 32 | (classes[i] as u64) << 40;
            events.push(((nanos as u64) << 32 | pixel as u64, about));
        }
    }
    events.sort_unstable_by_key(|(key, _)| *key);
    for (bytes, (key, about)) in out.chunks_exact_mut(EVENT_BYTES).zip(events) {
        bytes[..4].copy_from_slice(&((key >> 32) as u32).to_le_bytes());
        bytes[4..6].copy_from_slice(&(key as u16).to_le_bytes());
        bytes[6..8].copy_from_slice(&((key >> 16) as u16).to_le_bytes());
        bytes[8..].copy_from_slice(&about.to_le_bytes());
    }
    Ok(())
}

/// What is left of the filtered bytes.
struct Rest<'a>(&'a [u8]);

impl<'a> Rest<'a> {
    fn take(&mut self, n: usize) -> Result<&'a [u8], CodecError> {
        let (head, tail) = self
            .0
            .split_at_checked(n)
            .ok_or("coded events end too early")?;
        self.0 = tail;
        Ok(head)
    }

    fn words(&mut self, n: usize) -> Result<Vec<u32>, CodecError> {
        let planes = self.take(n.checked_mul(4).ok_or("coded events are too many")?)?;
        let mut words = vec![0; n];
        if n > 0 {
            join(&mut words, planes, n, 0);
        }
        Ok(words)
    }
}
