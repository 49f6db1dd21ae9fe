//! Messages that are made once and sent to several listeners. Each has a queue of its own, so that
//! a slow one holds up nobody but itself.

use std::collections::VecDeque;
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::feeds::Progress;
use crate::gateway::lock;
use crate::stream::{Streams, has_ended, send, wait_for_end};

/// How often a quiet connection is looked at.
const LOOK: Duration = Duration::from_millis(500);
/// How long a queue waits for the connection it was made for.
const CONNECT: Duration = Duration::from_secs(10);
/// Queues of one relay that may wait for connections.
const MAX_WAITING: usize = 64;

/// A message.
#[derive(Clone, Debug)]
pub struct Sent {
    /// Tick it shows.
    pub tick: u64,
    /// Its bytes.
    pub bytes: Arc<[u8]>,
}

/// One source of messages.
#[derive(Debug)]
pub struct Relay {
    listeners: Mutex<Vec<Arc<Listener>>>,
    waiting: Mutex<VecDeque<(Instant, Arc<Listener>)>>,
    is_over: AtomicBool,
    backlog: usize,
}

/// One client's queue.
#[derive(Debug)]
pub struct Listener {
    queue: Mutex<Queue>,
    filled: Condvar,
    progress: Option<Arc<Progress>>,
}

#[derive(Debug, Default)]
struct Queue {
    messages: VecDeque<Sent>,
    /// Everything published before this `CLOCK_MONOTONIC` is in the queue or was.
    promised_nanos: u64,
    is_over: bool,
}

impl Relay {
    /// Without listeners; each keeps this many messages at most and loses its oldest beyond them.
    pub fn new(backlog: usize) -> Relay {
        Relay {
            listeners: Mutex::default(),
            waiting: Mutex::default(),
            is_over: AtomicBool::new(false),
            backlog,
        }
    }

    /// Collects for a client that is about to connect.
    pub fn expect(&self, progress: Option<Arc<Progress>>) {
        self.sweep();
        let listener = self.join(progress);
        let mut waiting = lock(&self.waiting);
        waiting.push_back((Instant::now(), listener));
        if waiting.len() > MAX_WAITING {
            waiting.pop_front();
        }
    }

    /// Forgets queues whose clients never came.
    fn sweep(&self) {
        let mut waiting = lock(&self.waiting);
        while waiting
            .front()
            .is_some_and(|(since, _)| since.elapsed() > CONNECT)
        {
            waiting.pop_front();
        }
        drop(waiting);
        // What only the list holds has no client and will get none.
        lock(&self.listeners).retain(|listener| Arc::strong_count(listener) > 1);
    }

    /// The oldest queue that waits for a client, or a new one.
    pub fn listener(&self, progress: Option<Arc<Progress>>) -> Arc<Listener> {
        let expected = lock(&self.waiting)
            .pop_front()
            .map(|(_, listener)| listener);
        match (expected, progress) {
            (Some(expected), progress) => {
                progress.into_iter().for_each(|unused| unused.finish());
                expected
            }
            (None, progress) => self.join(progress),
        }
    }

    fn join(&self, progress: Option<Arc<Progress>>) -> Arc<Listener> {
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
        lock(&self.listeners).push(listener.clone());
        listener
    }

    /// Whether anybody listens or is about to.
    pub fn has_listeners(&self) -> bool {
        self.sweep();
        !lock(&self.listeners).is_empty()
    }

    /// Sends a message to all.
    pub fn send(&self, message: &Sent) {
        for listener in lock(&self.listeners).iter() {
            let mut queue = lock(&listener.queue);
            if queue.messages.len() >= self.backlog {
                queue.messages.pop_front();
            }
            queue.messages.push_back(message.clone());
            drop(queue);
            listener.filled.notify_all();
        }
    }

    /// Says that everything published before this `CLOCK_MONOTONIC` was sent.
    pub fn promise(&self, nanos: u64) {
        for listener in lock(&self.listeners).iter() {
            lock(&listener.queue).promised_nanos = nanos;
            listener.filled.notify_all();
        }
    }

    /// There will be no more messages.
    pub fn close(&self) {
        self.is_over.store(true, Ordering::Release);
        for listener in lock(&self.listeners).iter() {
            lock(&listener.queue).is_over = true;
            listener.filled.notify_all();
        }
    }
}

/// What a listener does next.
enum Next {
    Send(Sent),
    /// Everything up to this moment was sent.
    Rest(u64),
    End,
}

impl Listener {
    fn next(&self, rested_nanos: u64) -> Next {
        let mut queue = lock(&self.queue);
        if queue.messages.is_empty() && !queue.is_over && queue.promised_nanos <= rested_nanos {
            queue = self
                .filled
                .wait_timeout(queue, LOOK)
                .unwrap_or_else(PoisonError::into_inner)
                .0;
        }
        match queue.messages.pop_front() {
            Some(message) => Next::Send(message),
            None if queue.is_over => Next::End,
            None => Next::Rest(queue.promised_nanos),
        }
    }

    /// Sends to a client until it goes; `taken` runs when everything there was is sent.
    pub fn serve(
        &self,
        mut connection: TcpStream,
        streams: &Streams,
        taken: &dyn Fn(),
    ) -> std::io::Result<()> {
        let served = self.send_all(&mut connection, streams, taken);
        if let Some(progress) = &self.progress {
            progress.finish();
            taken();
        }
        match served {
            Ok(true) => wait_for_end(&connection),
            Ok(false) => Ok(()),
            Err(error) => Err(error),
        }
    }

    /// True once there will be no more messages, false when the client has gone.
    fn send_all(
        &self,
        connection: &mut TcpStream,
        streams: &Streams,
        taken: &dyn Fn(),
    ) -> std::io::Result<bool> {
        if let Some(progress) = &self.progress {
            progress.connect();
        }
        let (mut rested_nanos, mut looked) = (0, Instant::now());
        loop {
            match self.next(rested_nanos) {
                Next::Send(message) => {
                    streams.await_snapshot(message.tick);
                    send(connection, &message.bytes, &[])?;
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
                if has_ended(connection)? {
                    return Ok(false);
                }
            }
        }
    }
}

impl Drop for Listener {
    /// Nobody waits for what has ended.
    fn drop(&mut self) {
        self.progress.iter().for_each(|progress| progress.finish());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sent(tick: u64) -> Sent {
        Sent {
            tick,
            bytes: vec![tick as u8].into(),
        }
    }

    #[test]
    fn a_full_queue_loses_its_oldest_and_no_other_queue_does() {
        let relay = Relay::new(3);
        let (slow, fast) = (relay.listener(None), relay.listener(None));
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
        assert!(
            matches!(slow.next(0), Next::End) && matches!(relay.listener(None).next(0), Next::End)
        );
    }

    #[test]
    fn a_promise_is_kept_only_after_the_messages_before_it() {
        let relay = Relay::new(3);
        relay.expect(None);
        relay.send(&sent(1));
        relay.promise(70);
        let listener = relay.listener(None);
        assert!(
            matches!(listener.next(0), Next::Send(Sent { tick: 1, .. })),
            "the queue that was expected has what came before the client"
        );
        assert!(matches!(listener.next(0), Next::Rest(70)));
    }
}
