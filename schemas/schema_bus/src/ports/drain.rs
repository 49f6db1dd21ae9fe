//! Emptying a topic of many writers, of which one may send faster than it is read.
//!
//! iceoryx2 hands out what one writer sent until nothing of it waits, and only then turns to the
//! next. A reader that takes samples one by one therefore never comes to the end of a flood, and
//! never sees another writer. Samples that are held count: a writer of which a reader holds as many
//! as it may is passed over. So samples are taken in rounds, held until their round ends, and the
//! number of rounds is what the buffer can hold.

use std::collections::BTreeMap;

use crate::contract::error::BusError;
use crate::contract::qos::Qos;

/// Ports whose numbers are remembered: several times as many as a service has.
const MAX_PORTS: usize = 128;

/// What a flood loses shows as gaps in the numbers of its port.
#[derive(Debug, Default)]
pub(crate) struct Gaps {
    newest: BTreeMap<u128, u64>,
}

impl Gaps {
    /// Notes number `seq` of a port, and returns how many are missing before it. A port that counts
    /// backwards misses none.
    pub fn before(&mut self, port: u128, seq: u64) -> u64 {
        if self.newest.len() >= MAX_PORTS && !self.newest.contains_key(&port) {
            self.newest.clear();
        }
        match self.newest.insert(port, seq) {
            Some(before) => seq.saturating_sub(before.saturating_add(1)),
            None => 0,
        }
    }
}

/// Takes at most `qos.buffer` samples of every writer, and as many of each. Gives each sample to
/// `take`, which returns the bytes that it kept of it: after a round that brought them to
/// `max_bytes` the rest stays where it waits.
pub(crate) fn drain<S>(
    qos: &Qos,
    max_bytes: usize,
    mut receive: impl FnMut() -> Result<Option<S>, BusError>,
    mut take: impl FnMut(&S) -> usize,
) -> Result<(), BusError> {
    let mut n_bytes = 0;
    for _ in 0..qos.buffer.div_ceil(qos.borrowed) {
        let held = round(&mut receive)?;
        n_bytes += held.iter().map(&mut take).sum::<usize>();
        // No writer can have been passed over.
        if held.len() < qos.borrowed || n_bytes >= max_bytes {
            break;
        }
    }
    Ok(())
}

/// Takes what can be held at a time.
pub(crate) fn round<S>(
    mut receive: impl FnMut() -> Result<Option<S>, BusError>,
) -> Result<Vec<S>, BusError> {
    let mut held = Vec::new();
    loop {
        match receive() {
            Ok(Some(sample)) => held.push(sample),
            Ok(None) => return Ok(held),
            // All that wait come from writers of which enough is held.
            Err(BusError::BorrowLimit { .. }) if !held.is_empty() => return Ok(held),
            Err(error) => return Err(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;
    use crate::contract::qos::CONTROL;

    /// A writer that never stops: the bus refuses when the limit is held, and gives again once the
    /// samples were dropped.
    #[test]
    fn a_flood_ends_after_one_buffer() {
        struct Held<'a>(&'a Cell<usize>);
        impl Drop for Held<'_> {
            fn drop(&mut self) {
                self.0.set(self.0.get() - 1);
            }
        }
        let n_held = Cell::new(0);
        let receive = || {
            if n_held.get() == CONTROL.borrowed {
                return Err(BusError::BorrowLimit {
                    service: "d/control/vehicles".into(),
                    limit: CONTROL.borrowed,
                });
            }
            n_held.set(n_held.get() + 1);
            Ok(Some(Held(&n_held)))
        };
        let mut n_taken = 0;
        let count = |_: &Held<'_>| {
            n_taken += 1;
            10
        };
        drain(&CONTROL, usize::MAX, receive, count).unwrap();
        assert_eq!((n_taken, n_held.get()), (CONTROL.buffer, 0));
        // A round of four samples is the least that is taken, and 50 bytes need two.
        let mut n_taken = 0;
        let count = |_: &Held<'_>| {
            n_taken += 1;
            10
        };
        drain(&CONTROL, 50, receive, count).unwrap();
        assert_eq!((n_taken, n_held.get()), (2 * CONTROL.borrowed, 0));
    }

    #[test]
    fn a_gap_is_what_is_missing_between_two_samples_of_one_port() {
        let mut gaps = Gaps::default();
        assert_eq!(gaps.before(1, 40), 0, "the first one seen");
        assert_eq!(gaps.before(1, 41), 0);
        assert_eq!(gaps.before(2, 7), 0);
        assert_eq!(gaps.before(1, 45), 3);
        assert_eq!(gaps.before(1, 3), 0, "it counts backwards");
        assert_eq!(gaps.before(1, u64::MAX), u64::MAX - 4);
        for port in 0..10_000 {
            gaps.before(port, 1);
        }
        assert!(gaps.newest.len() <= MAX_PORTS);
    }

    #[test]
    fn an_empty_topic_is_asked_once() {
        let mut n_asked = 0;
        let receive = || {
            n_asked += 1;
            Ok(None::<u8>)
        };
        drain(&CONTROL, usize::MAX, receive, |_| panic!("nothing waits")).unwrap();
        assert_eq!(n_asked, 1);
    }
}
