//! Frames in flight: work of earlier ticks that the GPU has not finished, and how late it is.

use std::collections::VecDeque;

/// Work of earlier ticks, oldest first.
pub(super) struct InFlight<T> {
    pending: VecDeque<(u64, T)>,
    /// The running tick, or the last one.
    tick: u64,
    max_ticks: u64,
}

impl<T> InFlight<T> {
    /// Nothing stays in flight for more than `max_ticks`.
    pub fn new(max_ticks: u64) -> Self {
        InFlight {
            pending: VecDeque::new(),
            tick: 0,
            max_ticks,
        }
    }

    /// A tick begins. Everything in flight gets older, whether its sensors fire again or not.
    pub fn start_tick(&mut self, tick: u64) {
        self.tick = tick;
    }

    /// Adds work of the running tick.
    pub fn push(&mut self, work: T) {
        self.pending.push_back((self.tick, work));
    }

    /// Whether nothing is in flight.
    pub fn is_empty(&self) -> bool {
        self.pending.is_empty()
    }

    /// The oldest work.
    pub fn oldest(&self) -> Option<&T> {
        self.pending.front().map(|(_, work)| work)
    }

    /// Tick of the oldest work.
    pub fn oldest_tick(&self) -> Option<u64> {
        self.pending.front().map(|(tick, _)| *tick)
    }

    /// Removes the oldest work; also says how many ticks late it is.
    pub fn pop(&mut self) -> Option<(T, u32)> {
        let (tick, work) = self.pending.pop_front()?;
        Some((work, self.tick.saturating_sub(tick) as u32))
    }

    /// As [`InFlight::pop`], if the oldest work may not stay longer. Its age decides, not the number
    /// of submissions: a camera that fires rarely has no next frame that would push this one out.
    pub fn pop_due(&mut self) -> Option<(T, u32)> {
        let (tick, _) = self.pending.front()?;
        if self.tick.saturating_sub(*tick) >= self.max_ticks {
            self.pop()
        } else {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_that_has_no_successor_is_as_late_as_ticks_have_begun_since() {
        let mut in_flight = InFlight::new(3);
        in_flight.start_tick(10);
        in_flight.push("rare");
        assert_eq!(in_flight.pop_due(), None);
        in_flight.start_tick(11);
        in_flight.start_tick(12);
        assert_eq!(in_flight.pop_due(), None);
        assert_eq!(in_flight.pop(), Some(("rare", 2)));
        assert!(in_flight.is_empty() && in_flight.pop().is_none());
    }

    #[test]
    fn work_stays_for_no_more_than_its_ticks_and_comes_oldest_first() {
        let mut in_flight = InFlight::new(2);
        let mut sent = Vec::new();
        for tick in 1..=9 {
            in_flight.start_tick(tick);
            while let Some((work, late)) = in_flight.pop_due() {
                sent.push((tick, work, late));
            }
            if tick % 2 == 1 || tick == 4 {
                in_flight.push(tick);
            }
        }
        assert_eq!(
            sent,
            [(3, 1, 2), (5, 3, 2), (6, 4, 2), (7, 5, 2), (9, 7, 2)]
        );
        assert_eq!(in_flight.pop(), Some((9, 0)));
    }
}
