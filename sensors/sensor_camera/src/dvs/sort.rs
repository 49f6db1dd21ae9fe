//! Sorts the events of all rows by time, y, x.
//!
//! A bucket sort in two passes: first into a few long intervals of time, each of which fits into a
//! core's cache, then into intervals of a few events, which insertion sort finishes. The buffer
//! between the passes is reused from window to window.

use bytemuck::Zeroable as _;
use rayon::prelude::*;
use schema_frames::DvsEvent;

use super::stage::EVENTS;

/// Events of a long interval if they are evenly distributed.
const EVENTS_PER_LONG: usize = 4096;
/// Limit of long intervals: the number of places in memory that can be written in turn efficiently.
const MAX_LONG: usize = 512;
/// Events of a short interval if they are evenly distributed.
const EVENTS_PER_SHORT: usize = 2;

/// Fewer events are sorted before another thread would wake up.
const MIN_EVENTS_PER_THREAD: usize = 16_384;

/// Buffers for sorting.
#[derive(Debug, Default)]
pub(super) struct Sorter {
    dealt: Vec<DvsEvent>,
}

/// The window cut into equal intervals of time.
#[derive(Clone, Copy)]
struct Intervals {
    begin_nanos: u64,
    scale: u64,
    n: usize,
}

impl Intervals {
    fn new(begin_nanos: u64, length_nanos: u64, n: usize) -> Intervals {
        // A multiplication in place of a division; it is monotonic, which suffices.
        Intervals {
            begin_nanos,
            scale: ((n as u64) << 32) / (length_nanos + 1),
            n,
        }
    }

    #[inline(always)]
    fn of(&self, event: &DvsEvent) -> usize {
        ((((event.nanos_in_window as u64).saturating_sub(self.begin_nanos) * self.scale) >> 32)
            as usize)
            .min(self.n - 1)
    }

    /// First time that lies in interval `i`, or a little before.
    fn begin_of(&self, i: usize) -> u64 {
        self.begin_nanos + ((i as u64) << 32) / self.scale.max(1)
    }
}

impl Sorter {
    /// Writes all events to `out`, which has exactly their number.
    pub fn sort(&mut self, rows: &[Vec<DvsEvent>], window_nanos: u64, out: &mut [DvsEvent]) {
        let n_long = (out.len() / EVENTS_PER_LONG).clamp(1, MAX_LONG);
        let long = Intervals::new(0, window_nanos, n_long);
        self.dealt.resize(out.len(), DvsEvent::zeroed());
        let mut ends = Vec::new();
        deal(rows.iter().flatten(), &long, &mut ends, &mut self.dealt);
        let (mut rest_in, mut rest_out, mut begin) = (&self.dealt[..], out, 0);
        let mut parts = Vec::with_capacity(n_long);
        for (i, end) in ends[..n_long].iter().enumerate() {
            let (part_in, behind_in) = rest_in.split_at((end - begin) as usize);
            let (part_out, behind_out) = rest_out.split_at_mut((end - begin) as usize);
            parts.push((long.begin_of(i), part_in, part_out));
            (rest_in, rest_out, begin) = (behind_in, behind_out, *end);
        }
        sort_parts(parts, window_nanos / n_long as u64 + 2);
    }

    /// Fills `out` with the first events of slices; every slice that contributes must be complete.
    pub fn sort_slices(slices: &Slices<'_>, events: &[DvsEvent], out: &mut [DvsEvent]) {
        let intervals = Intervals::new(0, slices.window_nanos, slices.ends.len());
        let length_nanos = slices.window_nanos / slices.ends.len() as u64 + 2;
        let (mut rest, mut begin, mut cut) = (out, 0, None);
        let mut parts = Vec::with_capacity(slices.ends.len());
        for (i, end) in slices.ends.iter().enumerate() {
            let end = *end as usize;
            let dealt = &events[begin..end.min(events.len())];
            if dealt.len() > rest.len() {
                cut = Some(dealt);
                break;
            }
            let (part, behind) = rest.split_at_mut(dealt.len());
            if !dealt.is_empty() {
                parts.push((intervals.begin_of(i), dealt, part));
            }
            (rest, begin) = (behind, end);
        }
        sort_parts(parts, length_nanos);
        if let Some(dealt) = cut {
            let mut sorted = dealt.to_vec();
            sorted.sort_unstable_by_key(key);
            rest.copy_from_slice(&sorted[..rest.len()]);
        }
    }
}

/// Events that are already grouped by equal intervals of time.
pub(super) struct Slices<'s> {
    /// Where each interval's events end.
    pub ends: &'s [u32],
    pub window_nanos: u64,
}

/// Sorts the events of intervals; each part has the interval's begin, its events, and their place.
fn sort_parts(parts: Vec<(u64, &[DvsEvent], &mut [DvsEvent])>, length_nanos: u64) {
    let n_events: usize = parts.iter().map(|(_, dealt, _)| dealt.len()).sum();
    let min_parts = (MIN_EVENTS_PER_THREAD * parts.len())
        .checked_div(n_events)
        .unwrap_or(1)
        .max(4);
    // One span a job, not one a part: there are a thousand parts.
    parts.into_par_iter().with_min_len(min_parts).for_each_init(
        || (EVENTS.span(), Vec::new()),
        |(_span, ends), (begin_nanos, dealt, out)| {
            let short = Intervals::new(
                begin_nanos,
                length_nanos,
                (out.len() / EVENTS_PER_SHORT).max(1),
            );
            deal(dealt.iter(), &short, ends, out);
            let (mut rest, mut begin) = (out, 0);
            for end in &ends[..short.n] {
                let (interval, behind) = rest.split_at_mut((end - begin) as usize);
                sort_interval(interval);
                (rest, begin) = (behind, *end);
            }
        },
    );
}

/// Writes events to `out` interval after interval, within each in the order they come; `ends` are
/// then the intervals' ends.
fn deal<'e>(
    events: impl Iterator<Item = &'e DvsEvent> + Clone,
    intervals: &Intervals,
    ends: &mut Vec<u32>,
    out: &mut [DvsEvent],
) {
    ends.clear();
    ends.resize(intervals.n + 1, 0);
    for event in events.clone() {
        ends[intervals.of(event) + 1] += 1;
    }
    for i in 1..ends.len() {
        ends[i] += ends[i - 1];
    }
    for event in events {
        let place = &mut ends[intervals.of(event)];
        out[*place as usize] = *event;
        *place += 1;
    }
}

/// Time, y, x, and of one pixel's events of one time darker ones first, whatever order they came
/// in.
#[inline(always)]
fn key(event: &DvsEvent) -> (u64, u8) {
    // One number: cheaper than comparing field by field.
    (
        (event.nanos_in_window as u64) << 32 | (event.y_px as u64) << 16 | event.x_px as u64,
        event.polarity,
    )
}

/// Limit of events for insertion sort. Where images do not match, thousands of pixels cross at one
/// time.
const MAX_INSERTED: usize = 16;

fn sort_interval(events: &mut [DvsEvent]) {
    if events.len() > MAX_INSERTED {
        events.sort_unstable_by_key(key);
        return;
    }
    for i in 1..events.len() {
        let event = events[i];
        let mut at = i;
        while at > 0 && key(&events[at - 1]) > key(&event) {
            events[at] = events[at - 1];
            at -= 1;
        }
        events[at] = event;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_come_out_in_order_and_are_cut_from_the_end() {
        let mut rng = fastrand::Rng::with_seed(3);
        for (n, window_nanos) in [(0, 1000u64), (10, 3), (5000, 50_000_000), (20_000, 700)] {
            let event = |_| DvsEvent {
                nanos_in_window: rng.u32(0..=window_nanos as u32),
                x_px: rng.u16(0..4),
                y_px: rng.u16(0..4),
                polarity: rng.u8(0..=1),
                ..DvsEvent::zeroed()
            };
            let mut events: Vec<DvsEvent> = (0..n).map(event).collect();
            let intervals = Intervals::new(0, window_nanos, 64);
            // Grouped by slices, but unordered within each.
            events.sort_by_key(|event| intervals.of(event));
            let ends: Vec<u32> = (0..64)
                .map(|i| events.partition_point(|event| intervals.of(event) <= i) as u32)
                .collect();
            let mut expected = events.clone();
            expected.sort_by_key(|e| (e.nanos_in_window, e.y_px, e.x_px, e.polarity));
            for kept in [n, n / 2, n / 7] {
                let mut found = vec![DvsEvent::zeroed(); kept];
                Sorter::sort_slices(
                    &Slices {
                        ends: &ends,
                        window_nanos,
                    },
                    &events,
                    &mut found,
                );
                assert!(
                    found == expected[..kept],
                    "{kept} of {n} in {window_nanos} ns"
                );
            }
        }
    }

    #[test]
    fn all_events_come_out_in_order() {
        let mut rng = fastrand::Rng::with_seed(2);
        for (n_rows, n_columns, window_nanos) in [
            (1, 0, 50),
            (40, 60, 50_000_000),
            (64, 500, 1_000),
            (3, 2, 1),
            (200, 300, u32::MAX - 1),
        ] {
            let rows: Vec<Vec<DvsEvent>> = (0..n_rows)
                .map(|y_px| {
                    let event = |x_px| DvsEvent {
                        nanos_in_window: rng.u32(0..=window_nanos),
                        x_px,
                        y_px,
                        ..DvsEvent::zeroed()
                    };
                    (0..n_columns).map(event).collect()
                })
                .collect();
            let mut expected: Vec<DvsEvent> = rows.concat();
            expected.sort_by_key(|e| (e.nanos_in_window, e.y_px, e.x_px));
            let mut found = vec![DvsEvent::zeroed(); expected.len()];
            Sorter::default().sort(&rows, window_nanos as u64, &mut found);
            assert!(
                found == expected,
                "{n_rows} rows of {n_columns} in {window_nanos} ns"
            );
        }
    }
}
