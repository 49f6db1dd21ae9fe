//! Open connections, which are at most so many. Who does nothing makes room for who comes, so that
//! idle, silent or stalled clients keep nobody out.

use std::collections::BTreeMap;
use std::net::{Shutdown, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use launch_cli::accept::Seldom;
use parking_lot::Mutex;

/// A client that has taken nothing for so long is stalled: it may have to make room.
pub const STALLED: Duration = Duration::from_secs(5);

/// What a connection does, those that make room first in front.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Doing {
    /// It has not said what it wants.
    Greeting,
    /// It waits for something that does not exist.
    Waiting,
    /// It takes what it is sent.
    Taking,
    /// It is between two requests.
    Idle,
    /// It is served: it never makes room.
    Served,
}

#[derive(Debug)]
struct State {
    doing: Doing,
    since: Instant,
    /// What it is connected for, if clients share such things.
    about: Option<u32>,
}

/// Notes what a connection does.
#[derive(Clone, Debug)]
pub struct Pulse(Arc<Mutex<State>>);

impl Pulse {
    fn new() -> Pulse {
        Pulse(Arc::new(Mutex::new(State {
            doing: Doing::Greeting,
            since: Instant::now(),
            about: None,
        })))
    }

    /// It does this from now on; returns what it did.
    pub fn now(&self, doing: Doing) -> Doing {
        let mut state = self.0.lock();
        state.since = Instant::now();
        std::mem::replace(&mut state.doing, doing)
    }

    /// It is connected for this. Of connections for one thing none is worth more than another.
    pub fn about(&self, what: u32) {
        self.0.lock().about = Some(what);
    }
}

#[derive(Debug)]
struct Entry {
    connection: Arc<TcpStream>,
    pulse: Pulse,
}

/// The table of one server's connections.
#[derive(Debug)]
pub struct Seats {
    what: &'static str,
    capacity: usize,
    table: Mutex<BTreeMap<u64, Entry>>,
    refusals: Seldom,
    evictions: Seldom,
}

/// A place in the table; free again when this is dropped.
#[derive(Debug)]
pub struct Seat {
    /// Number of the connection; numbers rise and never come back, in the whole process.
    pub number: u64,
    /// Notes what the connection does.
    pub pulse: Pulse,
    seats: Arc<Seats>,
}

impl Seat {
    /// As [`Seats::relieve_stalled`].
    pub fn relieve_stalled(&self) {
        self.seats.relieve_stalled();
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        self.seats.table.lock().remove(&self.number);
    }
}

impl Seats {
    /// Room for so many connections of `what`, as a sentence names them ("RPC connections").
    pub fn new(what: &'static str, capacity: usize) -> Arc<Seats> {
        Arc::new(Seats {
            what,
            capacity,
            table: Mutex::default(),
            refusals: Seldom::default(),
            evictions: Seldom::default(),
        })
    }

    /// A place for a new connection; `None` if all are taken by connections that are served.
    pub fn take(self: &Arc<Self>, connection: &Arc<TcpStream>) -> Option<Seat> {
        static NEXT: AtomicU64 = AtomicU64::new(1);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let (pulse, now) = (Pulse::new(), Instant::now());
        let mut table = self.table.lock();
        if table.len() >= self.capacity {
            let most = self.capacity / 4;
            let Some(number) = idlest(&table, now, Doing::Idle).or_else(|| crowded(&table, most))
            else {
                if let Some(n_unsaid) = self.refusals.is_due() {
                    let (what, capacity) = (self.what, self.capacity);
                    tracing::warn!(n_unsaid, "refused one of the {what}: {capacity} are in use");
                }
                return None;
            };
            self.evict(&mut table, number);
        }
        let entry = Entry {
            connection: connection.clone(),
            pulse: pulse.clone(),
        };
        table.insert(number, entry);
        drop(table);
        Some(Seat {
            number,
            pulse,
            seats: self.clone(),
        })
    }

    /// Something is short: closes the connection that has done nothing for longest, if there is one
    /// that never asked or waits for what does not exist. Whether there was one.
    pub fn relieve(&self) -> bool {
        let mut table = self.table.lock();
        let found = idlest(&table, Instant::now(), Doing::Waiting);
        if let Some(number) = found {
            self.evict(&mut table, number);
        }
        found.is_some()
    }

    /// Memory is short: closes the connection that has taken nothing of its answer for longest, if
    /// there is one that is stalled.
    pub fn relieve_stalled(&self) {
        let mut table = self.table.lock();
        let now = Instant::now();
        let stalled = table.iter().filter_map(|(number, entry)| {
            let state = entry.pulse.0.lock();
            let is_stalled = now.saturating_duration_since(state.since) >= STALLED;
            (state.doing == Doing::Taking && is_stalled).then_some((state.since, *number))
        });
        if let Some((_, number)) = stalled.min() {
            self.evict(&mut table, number);
        }
    }

    fn evict(&self, table: &mut BTreeMap<u64, Entry>, number: u64) {
        let Some(entry) = table.remove(&number) else {
            return;
        };
        if let Some(n_unsaid) = self.evictions.is_due() {
            let what = self.what;
            let doing = entry.pulse.0.lock().doing;
            tracing::warn!(
                n_unsaid,
                "closed one of {} {what}, the one that did nothing for longest ({doing:?})",
                table.len() + 1
            );
        }
        // The connection's thread notices and ends.
        let _ = entry.connection.shutdown(Shutdown::Both);
    }

    #[cfg(test)]
    fn numbers(&self) -> Vec<u64> {
        self.table.lock().keys().copied().collect()
    }
}

/// The connection that makes room first, of those that do `last` or what stands before it.
fn idlest(table: &BTreeMap<u64, Entry>, now: Instant, last: Doing) -> Option<u64> {
    table
        .iter()
        .filter_map(|(number, entry)| {
            let state = entry.pulse.0.lock();
            let is_stalled = now.saturating_duration_since(state.since) >= STALLED;
            let may_go = state.doing <= last && (state.doing != Doing::Taking || is_stalled);
            may_go.then_some((state.doing, state.since, *number))
        })
        .min()
        .map(|(_, _, number)| number)
}

/// The oldest connection for what more than `most` are connected for.
fn crowded(table: &BTreeMap<u64, Entry>, most: usize) -> Option<u64> {
    let mut crowds: BTreeMap<u32, (usize, u64)> = BTreeMap::new();
    for (number, entry) in table {
        if let Some(about) = entry.pulse.0.lock().about {
            crowds.entry(about).or_insert((0, *number)).0 += 1;
        }
    }
    let largest = crowds.into_values().max()?;
    (largest.0 > most).then_some(largest.1)
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    struct Room {
        listener: TcpListener,
        clients: Vec<TcpStream>,
        seats: Arc<Seats>,
        taken: Vec<Seat>,
    }

    impl Room {
        fn new(capacity: usize) -> Room {
            Room {
                listener: TcpListener::bind("127.0.0.1:0").unwrap(),
                clients: Vec::new(),
                seats: Seats::new("test connections", capacity),
                taken: Vec::new(),
            }
        }

        /// One more client; the numbers of those that are left, counted from the first.
        fn come(&mut self) -> Option<Vec<usize>> {
            let address = self.listener.local_addr().unwrap();
            self.clients.push(TcpStream::connect(address).unwrap());
            let here = Arc::new(self.listener.accept().unwrap().0);
            self.taken.push(self.seats.take(&here)?);
            let numbers = self.seats.numbers();
            let is_left = |idx: &usize| numbers.contains(&self.taken[*idx].number);
            Some((0..self.taken.len()).filter(is_left).collect())
        }

        fn doing(&self, idx: usize, doing: Doing) {
            self.taken[idx].pulse.now(doing);
        }

        fn ago(&self, idx: usize, ago: Duration) {
            self.taken[idx].pulse.0.lock().since -= ago;
        }
    }

    #[test]
    fn who_does_nothing_makes_room() {
        let mut room = Room::new(4);
        (0..4).for_each(|_| drop(room.come()));
        room.doing(0, Doing::Served);
        room.doing(1, Doing::Idle);
        room.doing(2, Doing::Waiting);
        assert_eq!(room.come(), Some(vec![0, 1, 2, 4]), "3 never asked");
        room.doing(4, Doing::Taking);
        assert_eq!(room.come(), Some(vec![0, 1, 4, 5]), "2 waited in vain");
        room.doing(5, Doing::Idle);
        assert_eq!(
            room.come(),
            Some(vec![0, 4, 5, 6]),
            "1 was idle for longest"
        );
        room.ago(4, STALLED);
        room.doing(5, Doing::Served);
        room.doing(6, Doing::Served);
        assert_eq!(room.come(), Some(vec![0, 5, 6, 7]), "4 takes nothing");
        room.doing(7, Doing::Served);
        assert_eq!(room.come(), None, "all are served");
        let gone = room.taken.remove(1);
        assert!(gone.number > 0 && room.seats.numbers().len() == 4);
        drop(gone);
        let left = room.seats.numbers().len();
        drop(room.taken.pop());
        assert_eq!((left, room.seats.numbers().len()), (4, 3));
        assert!(room.come().is_some());
    }

    #[test]
    fn a_crowd_for_one_thing_keeps_nobody_out() {
        let mut room = Room::new(8);
        for n in 0..8 {
            room.come();
            room.doing(n, Doing::Served);
            room.taken[n]
                .pulse
                .about(if n < 3 { 7 } else { n as u32 + 10 });
        }
        assert_eq!(room.come(), Some(vec![1, 2, 3, 4, 5, 6, 7, 8]));
        room.doing(8, Doing::Served);
        assert_eq!(room.come(), None, "nothing is asked for by more than two");
    }

    #[test]
    fn who_does_not_read_makes_room_when_memory_is_short() {
        let mut room = Room::new(4);
        (0..3).for_each(|_| drop(room.come()));
        room.doing(0, Doing::Idle);
        room.doing(1, Doing::Taking);
        room.doing(2, Doing::Taking);
        room.seats.relieve_stalled();
        assert_eq!(room.seats.numbers().len(), 3, "none is stalled yet");
        room.ago(2, STALLED);
        room.seats.relieve_stalled();
        assert_eq!(room.come(), Some(vec![0, 1, 3]));
    }

    #[test]
    fn relief_takes_nothing_from_those_who_asked() {
        let mut room = Room::new(4);
        (0..3).for_each(|_| drop(room.come()));
        room.doing(0, Doing::Idle);
        room.doing(1, Doing::Waiting);
        room.doing(2, Doing::Served);
        room.seats.relieve();
        room.seats.relieve();
        assert_eq!(room.come(), Some(vec![0, 2, 3]));
    }
}
