//! A relay sends messages that are made once to several listeners. Each listener has its own queue,
//! so a slow one delays nobody else.

use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex};

use crate::feeds::progress::Progress;
use crate::feeds::world_stream::WorldStream;
use crate::wire::streams::{Recipient, StreamMessage};

/// How often a listener checks whether its client has gone.
const LOOK: Duration = Duration::from_millis(500);

/// One source of messages. It refers to its listeners weakly: they end with the thread that serves
/// them, or when their client does not come.
#[derive(Debug)]
pub struct Relay {
    listeners: Mutex<Vec<Weak<Listener>>>,
    is_over: AtomicBool,
    backlog: usize,
}

/// One client's queue of messages.
#[derive(Debug)]
pub struct Listener {
    queue: Mutex<Queue>,
    filled: Condvar,
    progress: Option<Arc<Progress>>,
}

#[derive(Debug, Default)]
struct Queue {
    messages: VecDeque<StreamMessage>,
    /// Everything published before this time (`CLOCK_MONOTONIC`) was put into the queue.
    promised_nanos: u64,
    is_over: bool,
}

impl Relay {
    /// A relay without listeners. Each listener's queue holds `backlog` messages and drops its
    /// oldest when it is full.
    pub fn new(backlog: usize) -> Relay {
        Relay {
            listeners: Mutex::default(),
            is_over: AtomicBool::new(false),
            backlog,
        }
    }

    /// Adds a listener, which collects messages from now on.
    pub fn join(&self, progress: Option<Arc<Progress>>) -> Arc<Listener> {
        let is_over = self.is_over.load(Ordering::Acquire);
        let queue = Mutex::new(Queue {
            is_over,
            ..Queue::default()
        });
        let listener = Arc::new(Listener {
            queue,
            filled: Condvar::new(),
            progress,
        });
        self.listeners.lock().push(Arc::downgrade(&listener));
        listener
    }

    /// Whether there are listeners, connected or expected.
    pub fn has_listeners(&self) -> bool {
        let mut listeners = self.listeners.lock();
        listeners.retain(|listener| listener.strong_count() > 0);
        !listeners.is_empty()
    }

    /// Queues a message for every listener.
    pub fn send(&self, message: &StreamMessage) {
        self.change_queues(|queue| {
            if queue.messages.len() >= self.backlog {
                queue.messages.pop_front();
            }
            queue.messages.push_back(message.clone());
        });
    }

    /// Tells listeners that everything published before this time (`CLOCK_MONOTONIC`) is in their
    /// queues.
    pub fn promise(&self, nanos: u64) {
        self.change_queues(|queue| queue.promised_nanos = nanos);
    }

    /// Tells listeners that there will be no more messages.
    pub fn close(&self) {
        self.is_over.store(true, Ordering::Release);
        self.change_queues(|queue| queue.is_over = true);
    }

    fn change_queues(&self, change: impl Fn(&mut Queue)) {
        self.listeners.lock().retain(|listener| {
            let Some(listener) = listener.upgrade() else {
                return false;
            };
            change(&mut listener.queue.lock());
            listener.filled.notify_all();
            true
        });
    }
}

/// Longest queue of a station's listener, messages.
const STATION_BACKLOG: usize = 256;

/// The relays of radio stations, whose messages the gateway makes itself.
#[derive(Debug, Default)]
pub struct Stations(Mutex<BTreeMap<u32, Arc<Relay>>>);

impl Stations {
    /// Adds a listener to a station.
    pub fn join(&self, station: u32) -> Arc<Listener> {
        self.0
            .lock()
            .entry(station)
            .or_insert_with(|| Arc::new(Relay::new(STATION_BACKLOG)))
            .join(None)
    }

    /// The relay of a station; `None` if nobody ever listened to it.
    pub fn relay(&self, station: u32) -> Option<Arc<Relay>> {
        self.0.lock().get(&station).cloned()
    }

    /// Closes the relays of stations that do not exist any more.
    pub fn retain(&self, is_there: impl Fn(u32) -> bool) {
        self.0.lock().retain(|station, relay| {
            let stays = is_there(*station);
            if !stays {
                relay.close();
            }
            stays
        });
    }
}

/// What a listener's thread does next.
enum Next {
    Send(StreamMessage),
    /// The queue is empty: everything published before this time was sent.
    Rest(u64),
    End,
}

impl Listener {
    fn next(&self, rested_nanos: u64) -> Next {
        let mut queue = self.queue.lock();
        if queue.messages.is_empty() && !queue.is_over && queue.promised_nanos <= rested_nanos {
            self.filled.wait_for(&mut queue, LOOK);
        }
        match queue.messages.pop_front() {
            Some(message) => Next::Send(message),
            None if queue.is_over => Next::End,
            None => Next::Rest(queue.promised_nanos),
        }
    }

    /// Sends messages to a client until it disconnects. `taken` runs whenever the queue was
    /// emptied.
    pub fn serve(
        &self,
        client: &Recipient,
        world_stream: &WorldStream,
        taken: &dyn Fn(),
    ) -> std::io::Result<()> {
        let served = self.send_all(client, world_stream, taken);
        if let Some(progress) = &self.progress {
            progress.finish();
            taken();
        }
        match served {
            Ok(true) => client.wait_for_end(),
            Ok(false) => Ok(()),
            Err(error) => Err(error),
        }
    }

    /// Returns true when the relay was closed, false when the client has disconnected.
    fn send_all(
        &self,
        client: &Recipient,
        world_stream: &WorldStream,
        taken: &dyn Fn(),
    ) -> std::io::Result<bool> {
        if let Some(progress) = &self.progress {
            progress.connect();
        }
        let (mut rested_nanos, mut looked) = (0, Instant::now());
        loop {
            match self.next(rested_nanos) {
                Next::Send(message) => {
                    world_stream.await_snapshot(message.tick);
                    client.send(&message.bytes, &[])?;
                }
                Next::Rest(nanos) => {
                    if nanos > rested_nanos
                        && let Some(progress) = &self.progress
                    {
                        progress.take(nanos);
                        taken();
                    }
                    rested_nanos = nanos;
                }
                Next::End => return Ok(true),
            }
            if looked.elapsed() >= LOOK {
                looked = Instant::now();
                if client.has_ended()? {
                    return Ok(false);
                }
            }
        }
    }
}

impl Drop for Listener {
    /// Steps must not wait for a reader that has ended.
    fn drop(&mut self) {
        self.progress.iter().for_each(|progress| progress.finish());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sent(tick: u64) -> StreamMessage {
        StreamMessage {
            tick,
            bytes: vec![tick as u8].into(),
        }
    }

    #[test]
    fn a_full_queue_loses_its_oldest_and_no_other_queue_does() {
        let relay = Relay::new(3);
        let (slow, fast) = (relay.join(None), relay.join(None));
        let mut seen = Vec::new();
        for tick in 1..=5 {
            relay.send(&sent(tick));
            if let Next::Send(message) = fast.next(0) {
                seen.push(message.tick);
            }
        }
        let rest: Vec<u64> = std::iter::from_fn(|| {
            if let Next::Send(message) = slow.next(u64::MAX) {
                Some(message.tick)
            } else {
                None
            }
        })
        .take(3)
        .collect();
        assert_eq!((seen, rest), (vec![1, 2, 3, 4, 5], vec![3, 4, 5]));
        relay.close();
        assert!(matches!(slow.next(0), Next::End) && matches!(relay.join(None).next(0), Next::End));
    }

    #[test]
    fn a_promise_is_kept_only_after_the_messages_before_it() {
        let relay = Relay::new(3);
        let listener = relay.join(None);
        relay.send(&sent(1));
        relay.promise(70);
        assert!(matches!(
            listener.next(0),
            Next::Send(StreamMessage { tick: 1, .. })
        ));
        assert!(matches!(listener.next(0), Next::Rest(70)));
    }
}
