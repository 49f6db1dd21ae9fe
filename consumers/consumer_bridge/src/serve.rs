//! What other machines ask of this one's simulator: requests, controls, acknowledgements, the
//! clock.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed};
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, TrySendError, bounded};
use parking_lot::Mutex;
use schema_bus::{AckWriter, Bus, BusError, CommandClient, ControlWriter, Notifier, names};
use schema_frames::{Command, CommandBatch, CommandReply, ReplyBatch};
use zenoh::pubsub::Subscriber;
use zenoh::query::{Query, Queryable};
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait as _};

use crate::clock;
use crate::keys::Keys;
use crate::options::Options;
use crate::wire::{self, Envelope};

/// How long the simulator may take to answer: loading a map takes a minute.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(170);
/// After so long without a request a client's place is given up, and after so long without controls
/// that of a writer, if another one comes.
const IDLE: Duration = Duration::from_secs(20);
/// Clients and writers of other machines at a time; the simulator has 32 places for each.
const MAX_PLACES: usize = 24;
/// Longest request that is taken, bytes.
const MAX_REQUEST_BYTES: usize = 16 << 20;
/// Requests of all other machines that wait for the simulator, bytes.
const MAX_WAITING_BYTES: usize = 64 << 20;
/// Requests of one client that wait; clients of ours wait for each answer.
const MAX_WAITING_REQUESTS: usize = 64;
/// How long the end waits for threads that answer, which look twenty times a second.
const END: Duration = Duration::from_secs(1);

/// Answers other machines for as long as it is kept.
#[derive(Debug)]
pub struct Service {
    _queryables: Vec<Queryable<()>>,
    _subscribers: Vec<Subscriber<()>>,
    desk: Arc<Desk>,
}

/// What zenoh's threads share.
#[derive(Debug)]
struct Desk {
    // Ports go before their node.
    writers: Mutex<HashMap<String, Writer>>,
    acks: Mutex<HashMap<u32, Guest>>,
    clients: Mutex<HashMap<String, Sender<Waiting>>>,
    /// Bytes of the requests that wait.
    waiting_bytes: Arc<AtomicUsize>,
    wake: Notifier,
    bus: Bus,
    lockstep: bool,
    said: Mutex<bool>,
    ends: AtomicBool,
}

/// A request that waits, and its part of [`MAX_WAITING_BYTES`].
#[derive(Debug)]
struct Waiting {
    query: Query,
    n_bytes: usize,
    of: Arc<AtomicUsize>,
}

impl Waiting {
    /// Counts the request among those that wait. Whoever makes it asks [`Waiting::fits`], and drops
    /// it if too many bytes wait.
    fn new(query: Query, of: &Arc<AtomicUsize>) -> Waiting {
        let n_bytes = query.payload().map_or(0, |text| text.len());
        of.fetch_add(n_bytes, Relaxed);
        let of = of.clone();
        Waiting { query, n_bytes, of }
    }

    /// Whether no more bytes wait than may.
    fn fits(&self) -> bool {
        self.of.load(Relaxed) <= MAX_WAITING_BYTES
    }
}

impl Drop for Waiting {
    fn drop(&mut self) {
        self.of.fetch_sub(self.n_bytes, Relaxed);
    }
}

/// Who writes controls in the name of a program of another machine, and when it last did.
type Writer = (ControlWriter, Instant);

/// A lockstep participant of another machine.
#[derive(Debug)]
struct Guest {
    /// The bridge beside it.
    bridge: String,
    /// Its name in the lockstep.
    name: String,
    acks: AckWriter,
}

impl Service {
    /// Begins to answer.
    ///
    /// # Errors
    /// [`BusError`], and what zenoh says.
    pub fn open(session: &Session, keys: &Keys, options: &Options) -> anyhow::Result<Service> {
        let failed = |error: zenoh::Error| anyhow::anyhow!("cannot answer other bridges: {error}");
        let id = session.zid().to_string();
        let bus = Bus::open_with(&options.domain, "gantry-bridge", &options.bus)?;
        let desk = Arc::new(Desk {
            writers: Mutex::default(),
            acks: Mutex::default(),
            clients: Mutex::default(),
            waiting_bytes: Arc::default(),
            wake: bus.notifier(names::CONTROL_WAKE)?,
            bus,
            lockstep: options.lockstep,
            said: Mutex::default(),
            ends: AtomicBool::new(false),
        });
        let clock = session
            .declare_queryable(keys.to(&id, "clock"))
            .callback(|query| {
                let _ = query
                    .reply(query.key_expr().clone(), clock::answer())
                    .wait();
            })
            .wait()
            .map_err(failed)?;
        let mut service = Service {
            _queryables: vec![clock],
            _subscribers: Vec::new(),
            desk: desk.clone(),
        };
        if !options.control {
            return Ok(service);
        }
        let to = desk.clone();
        let requests = session
            .declare_queryable(keys.to(&id, names::CONTROL_WORLD))
            .callback(move |query| to.request(query))
            .wait()
            .map_err(failed)?;
        service._queryables.push(requests);
        let to = desk.clone();
        let controls = session
            .declare_subscriber(keys.to(&id, names::CONTROL_VEHICLES))
            .callback(move |sample| to.note("controls", to.control(&sample)))
            .wait()
            .map_err(failed)?;
        service._subscribers.push(controls);
        if options.lockstep {
            let (gone, known) = (desk.clone(), keys.clone());
            let bridges = session
                .liveliness()
                .declare_subscriber(keys.alive("*"))
                .callback(move |sample| {
                    let bridge = known.bridge_of(sample.key_expr().as_str());
                    if let (SampleKind::Delete, Some(bridge)) = (sample.kind(), bridge) {
                        gone.release(Some(bridge));
                    }
                })
                .wait()
                .map_err(failed)?;
            service._subscribers.push(bridges);
            let acks = session
                .declare_subscriber(keys.to(&id, names::CONTROL_ACK))
                .callback(move |sample| desk.note("acknowledgements", desk.ack(&sample)))
                .wait()
                .map_err(failed)?;
            service._subscribers.push(acks);
        }
        Ok(service)
    }

    /// Gives up the places of all participants of other machines: the world goes on without them.
    pub fn release_participants(&self) {
        self.desk.release(None);
    }
}

impl Drop for Service {
    /// Threads that answer end before the process does, so that nothing of theirs stays on the bus.
    fn drop(&mut self) {
        self._queryables.clear();
        self._subscribers.clear();
        self.desk.ends.store(true, Relaxed);
        self.desk.clients.lock().clear();
        let began = Instant::now();
        while Arc::strong_count(&self.desk) > 1 && began.elapsed() < END {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Desk {
    /// Gives up the places of the participants behind a bridge, or of all, because the link to them
    /// ended.
    fn release(&self, bridge: Option<&str>) {
        let mut released = Vec::new();
        self.acks.lock().retain(|_, guest| {
            let is_kept = bridge.is_some_and(|bridge| guest.bridge != bridge);
            if !is_kept {
                released.push(guest.name.clone());
            }
            is_kept
        });
        for name in &released {
            tracing::warn!(
                name,
                "the link to a lockstep participant ended; its place is given up"
            );
        }
        if !released.is_empty() {
            self.wake.notify();
        }
    }

    /// Says the first failure.
    fn note(&self, what: &str, done: anyhow::Result<()>) {
        if let Err(error) = done
            && !std::mem::replace(&mut *self.said.lock(), true)
        {
            tracing::warn!("cannot take {what} of another machine: {error:#}");
        }
    }

    /// Writes controls under the name that their writer has on its machine.
    fn control(&self, sample: &Sample) -> anyhow::Result<()> {
        let controls = wire::controls(sample.attachment(), sample.payload(), MAX_REQUEST_BYTES)?;
        let name = controls.writer;
        let now = Instant::now();
        let mut writers = self.writers.lock();
        if !writers.contains_key(&name) {
            anyhow::ensure!(
                has_room(&mut writers, now),
                "{MAX_PLACES} programs of other machines write controls already"
            );
            let writer = self.bus.control_writer(&name)?;
            writers.insert(name.clone(), (writer, now));
        }
        if let Some((writer, used)) = writers.get_mut(&name) {
            writer.send(controls.tick, &controls.records)?;
            *used = now;
        }
        self.wake.notify_listeners();
        Ok(())
    }

    /// Passes on an acknowledgement; one of the last tick that there can be ends a participation.
    fn ack(&self, sample: &Sample) -> anyhow::Result<()> {
        let envelope = Envelope::open(sample.attachment())?;
        let ([participant, epoch, tick], _) = envelope.header::<[u64; 3]>()?;
        let participant = u32::try_from(participant)?;
        let mut acks = self.acks.lock();
        if tick == u64::MAX {
            acks.remove(&participant);
        } else if let Some(guest) = acks.get(&participant) {
            guest.acks.send(participant, epoch, tick)?;
        }
        self.wake.notify_listeners();
        Ok(())
    }

    /// Hands a request to the thread of its client, so that clients do not wait for each other.
    fn request(self: &Arc<Self>, query: Query) {
        // The bridge and its client.
        let name = query.attachment().map(|name| name.to_bytes().into_owned());
        let name = String::from_utf8_lossy(&name.unwrap_or_default()).into_owned();
        let waiting = Waiting::new(query, &self.waiting_bytes);
        if !waiting.fits() {
            let limit = MAX_WAITING_BYTES >> 20;
            let why = format!("requests of {limit} MiB wait for the simulator already; ask again");
            return refuse(&waiting.query, &why);
        }
        let mut clients = self.clients.lock();
        let waiting = match clients.get(&name) {
            Some(client) => match client.try_send(waiting) {
                Ok(()) => return,
                Err(TrySendError::Full(waiting)) => {
                    let why = format!(
                        "{MAX_WAITING_REQUESTS} requests of this program wait already; wait for their answers"
                    );
                    return refuse(&waiting.query, &why);
                }
                Err(TrySendError::Disconnected(waiting)) => waiting,
            },
            None => waiting,
        };
        if clients.len() >= MAX_PLACES && !clients.contains_key(&name) {
            refuse(
                &waiting.query,
                &format!("{MAX_PLACES} programs of other machines ask the simulator already"),
            );
            return;
        }
        let (sender, requests) = bounded(MAX_WAITING_REQUESTS);
        let (desk, client) = (self.clone(), name.clone());
        let thread = std::thread::Builder::new()
            .name("requests".into())
            .spawn(move || desk.answer_all(&client, &requests));
        match thread {
            Ok(_) => {
                let _ = sender.send(waiting);
                clients.insert(name, sender);
            }
            Err(error) => refuse(
                &waiting.query,
                &format!("the bridge gets no thread: {error}"),
            ),
        }
    }

    fn answer_all(&self, asker: &str, requests: &Receiver<Waiting>) {
        let mut client = None;
        loop {
            match requests.recv_timeout(IDLE) {
                Ok(waiting) => {
                    if let Err(error) = self.answer(asker, &mut client, &waiting.query) {
                        refuse(&waiting.query, &format!("{error:#}"));
                    }
                }
                Err(RecvTimeoutError::Disconnected) => return,
                Err(RecvTimeoutError::Timeout) => {
                    // Whoever sends holds the lock, so nothing comes between look and end.
                    let mut clients = self.clients.lock();
                    if requests.is_empty() {
                        clients.remove(asker);
                        return;
                    }
                }
            }
        }
    }

    fn answer(
        &self,
        asker: &str,
        client: &mut Option<CommandClient>,
        query: &Query,
    ) -> anyhow::Result<()> {
        let (bridge, name) = asker.split_once(' ').unwrap_or(("", asker));
        let text = query.payload().map(|text| text.to_bytes().into_owned());
        let text = text.unwrap_or_default();
        anyhow::ensure!(
            text.len() <= MAX_REQUEST_BYTES,
            "a request has {} bytes; {MAX_REQUEST_BYTES} are allowed",
            text.len()
        );
        let client = match client {
            Some(client) => client,
            empty => empty.insert(self.bus.command_client(name)?),
        };
        let batch: CommandBatch = serde_json::from_slice(&text)?;
        let joining = self.open_ack_writers(&batch)?;
        let answer =
            client.request_text(&text, ANSWER_TIMEOUT, &mut || !self.ends.load(Relaxed))?;
        self.keep_ack_writers(bridge, &batch, &answer, joining);
        query
            .reply(query.key_expr().clone(), answer)
            .wait()
            .map_err(|error| anyhow::anyhow!("{error}"))
    }

    /// The simulator recognises living participants by their writers, which come first.
    fn open_ack_writers(&self, batch: &CommandBatch) -> anyhow::Result<Vec<(String, AckWriter)>> {
        let mut opened = Vec::new();
        for command in &batch.commands {
            if let Command::JoinLockstep { name } = command {
                anyhow::ensure!(
                    self.lockstep,
                    "the bridge beside the simulator lets nobody join the lockstep; start it with --lockstep"
                );
                // Who comes back under its name takes its own place.
                self.acks.lock().retain(|_, guest| guest.name != *name);
                let writer: Result<AckWriter, BusError> = self.bus.ack_writer(name);
                opened.push((name.clone(), writer?));
            }
        }
        Ok(opened)
    }

    fn keep_ack_writers(
        &self,
        bridge: &str,
        batch: &CommandBatch,
        answer: &[u8],
        mut opened: Vec<(String, AckWriter)>,
    ) {
        let Ok(answer) = serde_json::from_slice::<ReplyBatch>(answer) else {
            return;
        };
        for (command, reply) in batch.commands.iter().zip(&answer.replies) {
            match (command, reply) {
                (Command::JoinLockstep { name }, CommandReply::Joined { participant, .. }) => {
                    if let Some(idx) = opened.iter().position(|(of, _)| of == name) {
                        let (name, acks) = opened.remove(idx);
                        let bridge = bridge.to_owned();
                        self.acks
                            .lock()
                            .insert(*participant, Guest { bridge, name, acks });
                    }
                }
                (Command::LeaveLockstep { participant }, _) => {
                    self.acks.lock().remove(participant);
                }
                _ => {}
            }
        }
    }
}

/// Whether one more has a place. Programs end without a word, so those that were idle for long make
/// room.
fn has_room<T>(places: &mut HashMap<String, (T, Instant)>, now: Instant) -> bool {
    if places.len() >= MAX_PLACES {
        places.retain(|_, (_, used)| now.duration_since(*used) < IDLE);
    }
    places.len() < MAX_PLACES
}

fn refuse(query: &Query, why: &str) {
    let _ = query.reply_err(why.to_owned()).wait();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn programs_that_have_ended_make_room() {
        let long_ago = Instant::now();
        let now = long_ago + IDLE;
        let mut places: HashMap<String, ((), Instant)> = HashMap::new();
        for n in 0..MAX_PLACES {
            assert!(has_room(&mut places, now));
            let used = if n == 7 { long_ago } else { now };
            places.insert(n.to_string(), ((), used));
        }
        assert!(has_room(&mut places, now) && !places.contains_key("7"));
        places.insert("new".to_owned(), ((), now));
        assert!(!has_room(&mut places, now), "all others are at work");
    }
}
