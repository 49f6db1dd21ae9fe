//! The world of another machine, published here as if its simulator ran here: snapshots, documents,
//! and commands and controls that go back to it.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context as _, bail};
use bytemuck::{Zeroable as _, bytes_of, cast_slice};
use schema_bus::{
    Ack, AckReader, Bus, Claim, CommandServer, ControlReader, DocumentPublisher, Notifier, Request,
    SnapshotPublisher, names,
};
use schema_frames::command::COMMAND_VERSION;
use schema_frames::control::{CONTROL_MAGIC, ControlHeader};
use schema_frames::limits::MAX_ACTORS;
use schema_frames::{Command, CommandReply, DocumentHeader, ReplyBatch, SCHEMA_VERSION};
use zenoh::query::ConsolidationMode;
use zenoh::{Session, Wait as _};

use crate::announce::DOCUMENTS;
use crate::coding::Coding;
use crate::import::events::{Event, Events, NoAnswer};
use crate::import::inbox::Arrived;
use crate::keys::Keys;
use crate::wire::{self, Envelope};

/// How long the other machine may take to answer a request: loading a map takes a minute.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(180);
/// Requests that may be on their way at a time; further ones wait on the bus.
const MAX_ON_THEIR_WAY: usize = 256;

/// Why requests are not passed on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Controls {
    /// They are.
    PassedOn,
    /// This bridge was told not to.
    RefusedHere,
    /// The other bridge was told not to.
    RefusedThere,
}

/// What answers and acknowledgements in the name of another machine's simulator.
#[derive(Debug)]
pub struct MirroredWorld {
    // Ports go before the claim.
    snapshots: SnapshotPublisher,
    snapshot_wake: Notifier,
    documents: BTreeMap<&'static str, DocumentPublisher>,
    commands: CommandServer,
    controls: ControlReader,
    acks: AckReader,
    /// Requests that wait for the other machine's answer.
    pending: HashMap<u64, Request>,
    next_request: u64,
    session: Session,
    keys: Keys,
    events: Arc<Events>,
    /// The bridge behind which the world is.
    pub peer: String,
    /// Whether requests and controls go there.
    pub passes: Controls,
    /// Whether its world waits for participants of this machine.
    pub lockstep: bool,
    /// Epoch and tick of the last snapshot.
    last: (u64, u64),
    /// Epoch and revision of the last document of each name.
    last_documents: BTreeMap<&'static str, (u64, u64)>,
    control_seq: u64,
    /// Number and name of the lockstep participants of this machine.
    joined: BTreeMap<u32, String>,
    _claim: Claim,
}

impl MirroredWorld {
    /// Takes the place of this domain's simulator; `None` if there is one already.
    ///
    /// # Errors
    /// [`schema_bus::BusError`].
    pub fn open(
        bus: &Bus,
        session: &Session,
        keys: &Keys,
        events: &Arc<Events>,
        peer: &str,
    ) -> anyhow::Result<Option<MirroredWorld>> {
        let Some(claim) = bus.claim_world()? else {
            return Ok(None);
        };
        // Commands come first: whoever finds a topic may ask at once.
        let commands = bus.command_server()?;
        let (controls, acks) = (bus.control_reader()?, bus.ack_reader()?);
        let mut documents = BTreeMap::new();
        for name in DOCUMENTS {
            documents.insert(name, bus.document_publisher(name)?);
        }
        Ok(Some(MirroredWorld {
            snapshots: bus.snapshot_publisher(MAX_ACTORS)?,
            snapshot_wake: bus.notifier(names::WORLD_SNAPSHOT)?,
            documents,
            commands,
            controls,
            acks,
            pending: HashMap::new(),
            next_request: 0,
            session: session.clone(),
            keys: keys.clone(),
            events: events.clone(),
            peer: peer.to_owned(),
            passes: Controls::PassedOn,
            lockstep: false,
            last: (0, 0),
            last_documents: BTreeMap::new(),
            control_seq: 0,
            joined: BTreeMap::new(),
            _claim: claim,
        }))
    }

    /// Whether a frame of this tick may be published: the snapshot of its tick was.
    pub fn has_reached(&self, epoch: u64, tick: u64) -> bool {
        self.last.0 == epoch && self.last.1 >= tick
    }

    /// Sends the newest snapshot and documents to readers that joined since the last call.
    pub fn greet(&self) {
        self.snapshots.greet();
        self.documents.values().for_each(DocumentPublisher::greet);
    }

    /// Publishes a snapshot of the other machine.
    ///
    /// # Errors
    /// A sentence for what is none.
    pub fn publish_snapshot(&mut self, arrived: &Arrived) -> anyhow::Result<()> {
        let (header, records) = wire::snapshot(&arrived.envelope, &arrived.payload)?;
        let at = (header.epoch, header.tick);
        // An answer to a question of ours may be older than what was sent meanwhile.
        if at.0 == self.last.0 && at.1 < self.last.1 {
            return Ok(());
        }
        self.snapshots.send(header, &records)?;
        self.last = at;
        self.snapshot_wake.notify_listeners();
        Ok(())
    }

    /// Publishes a document of the other machine.
    ///
    /// # Errors
    /// A sentence for what is none.
    pub fn publish_document(&mut self, name: &str, arrived: &Arrived) -> anyhow::Result<()> {
        let (header, _) = arrived.envelope.header::<DocumentHeader>()?;
        let text = String::from_utf8(arrived.envelope.plain(&arrived.payload)?)
            .context("a document is no UTF-8")?;
        let Some((&name, document)) = self.documents.iter_mut().find(|(known, _)| **known == name)
        else {
            bail!("{name:?} is no document of a world");
        };
        let at = (header.epoch, header.revision);
        // An answer to a question of ours may be older than what was sent meanwhile.
        let last = self.last_documents.get(name);
        if last.is_some_and(|last| at.0 == last.0 && at.1 < last.1) {
            return Ok(());
        }
        document.send_revision(&text, header.epoch, header.tick, header.revision)?;
        self.last_documents.insert(name, at);
        Ok(())
    }

    /// Takes requests, controls and acknowledgements of this machine and passes them on.
    ///
    /// # Errors
    /// [`schema_bus::BusError`].
    pub fn serve(&mut self) -> anyhow::Result<()> {
        if self.pending.len() < MAX_ON_THEIR_WAY {
            for request in self.commands.take_all()? {
                self.pass_on(request);
            }
        }
        // Controls that were sent before an acknowledgement must arrive before it.
        let acks = self.acks.drain()?;
        self.send_controls()?;
        self.send_acks(acks)
    }

    fn pass_on(&mut self, request: Request) {
        let joins = |command: &Command| matches!(command, Command::JoinLockstep { .. });
        let wants_to_join = request
            .batch
            .as_ref()
            .is_ok_and(|batch| batch.commands.iter().any(joins));
        let refusal = match (&request.batch, self.passes) {
            (Err(error), _) => Some(error.to_string()),
            (_, Controls::RefusedHere) => Some(
                "the world is another machine's, and the bridge here was started with --no-control; start it without"
                    .to_owned(),
            ),
            (_, Controls::RefusedThere) => Some(
                "the world is another machine's, whose bridge was started with --no-control; start it without"
                    .to_owned(),
            ),
            _ if wants_to_join && !self.lockstep => Some(
                "the world is another machine's, and its bridge lets nobody join the lockstep; start both bridges with --lockstep"
                    .to_owned(),
            ),
            _ => None,
        };
        if let Some(error) = refusal {
            self.refuse(request, error);
            return;
        }
        self.next_request += 1;
        let number = self.next_request;
        let asked = self.ask(number, &request);
        self.pending.insert(number, request);
        if let Err(error) = asked {
            self.answer(number, Err(NoAnswer::Link(error.to_string())));
        }
    }

    fn ask(&self, number: u64, request: &Request) -> zenoh::Result<()> {
        let guard = Answering {
            events: self.events.clone(),
            number,
            is_answered: parking_lot::Mutex::new(false),
        };
        self.session
            .get(self.keys.to(&self.peer, names::CONTROL_WORLD))
            .payload(request.text().as_bytes().to_vec())
            .attachment(format!("{} {}", self.session.zid(), request.client))
            .consolidation(ConsolidationMode::None)
            .timeout(ANSWER_TIMEOUT)
            .callback(move |reply| {
                let answer = match reply.result() {
                    Ok(sample) => Ok(sample.payload().to_bytes().into_owned()),
                    Err(error) => {
                        let said = error.payload().to_bytes();
                        Err(NoAnswer::Said(String::from_utf8_lossy(&said).into_owned()))
                    }
                };
                guard.answer(answer);
            })
            .wait()
    }

    /// Hands an answer of the other machine to the client that asked.
    pub fn answer(&mut self, number: u64, answer: Result<Vec<u8>, NoAnswer>) {
        let Some(request) = self.pending.remove(&number) else {
            return;
        };
        let parsed = answer.and_then(|text| {
            serde_json::from_slice::<ReplyBatch>(&text)
                .map_err(|error| NoAnswer::Unreadable(error.to_string()))
        });
        match parsed {
            Ok(batch) => {
                self.note_participants(&request, &batch);
                self.reply(request, &batch);
            }
            Err(error) => self.refuse(request, error.to_string()),
        }
    }

    /// Sends an answer. One that cannot be sent ends nothing: its client may be gone, or shared
    /// memory full.
    fn reply(&self, request: Request, batch: &ReplyBatch) {
        if let Err(error) = self.commands.reply(request, batch) {
            tracing::debug!(%error, "an answer of the other machine cannot be sent");
        }
    }

    /// Remembers who of this machine joined the lockstep, to see when it is gone.
    fn note_participants(&mut self, request: &Request, answer: &ReplyBatch) {
        let Ok(batch) = &request.batch else { return };
        for (command, reply) in batch.commands.iter().zip(&answer.replies) {
            match (command, reply) {
                (Command::JoinLockstep { name }, CommandReply::Joined { participant, .. }) => {
                    self.joined.insert(*participant, name.clone());
                }
                (Command::LeaveLockstep { participant }, CommandReply::Done) => {
                    self.joined.remove(participant);
                }
                _ => {}
            }
        }
    }

    fn refuse(&self, request: Request, error: String) {
        let n = request
            .batch
            .as_ref()
            .map_or(1, |batch| batch.commands.len());
        let answer = ReplyBatch {
            v: COMMAND_VERSION,
            epoch: self.last.0.to_string(),
            tick: self.last.1,
            replies: vec![CommandReply::Refused { error }; n.max(1)],
        };
        self.reply(request, &answer);
    }

    fn send_controls(&mut self) -> anyhow::Result<()> {
        let batches = self.controls.drain()?;
        if self.passes != Controls::PassedOn {
            return Ok(());
        }
        let key = self.keys.to(&self.peer, names::CONTROL_VEHICLES);
        for batch in batches {
            self.control_seq += 1;
            let mut header = ControlHeader {
                magic: CONTROL_MAGIC,
                schema_version: SCHEMA_VERSION,
                tick: batch.tick,
                seq: self.control_seq,
                ..ControlHeader::zeroed()
            };
            let name = batch.writer.as_bytes();
            let len = name.len().min(header.writer.len());
            header.writer[..len].copy_from_slice(&name[..len]);
            let payload: &[u8] = cast_slice(&batch.records);
            let envelope = Envelope::pack(bytes_of(&header), &[], payload.len(), Coding::None);
            self.send(&key, envelope, payload)?;
        }
        Ok(())
    }

    fn send_acks(&mut self, acks: Vec<Ack>) -> anyhow::Result<()> {
        if !self.lockstep || self.joined.is_empty() {
            return Ok(());
        }
        let key = self.keys.to(&self.peer, names::CONTROL_ACK);
        for ack in acks {
            let is_own = self.joined.get(&ack.participant) == Some(&ack.origin.port);
            if is_own {
                let record = [u64::from(ack.participant), ack.epoch, ack.tick];
                let envelope = Envelope::pack(bytes_of(&record), &[], 0, Coding::None);
                self.send(&key, envelope, &[])?;
            }
        }
        Ok(())
    }

    /// Tells the other machine of participants that ended without leaving.
    ///
    /// # Errors
    /// What zenoh says.
    pub fn look_after_participants(&mut self, bus: &Bus) -> anyhow::Result<()> {
        if self.joined.is_empty() {
            return Ok(());
        }
        bus.clean_dead_nodes();
        let writers = self.acks.writers();
        let gone: Vec<u32> = self
            .joined
            .iter()
            .filter(|(_, name)| !writers.iter().any(|writer| writer.port == **name))
            .map(|(number, _)| *number)
            .collect();
        let key = self.keys.to(&self.peer, names::CONTROL_ACK);
        for number in gone {
            tracing::warn!(
                name = self.joined.remove(&number),
                "a lockstep participant of this machine is gone"
            );
            let record = [u64::from(number), 0, u64::MAX];
            let envelope = Envelope::pack(bytes_of(&record), &[], 0, Coding::None);
            self.send(&key, envelope, &[])?;
        }
        Ok(())
    }

    fn send(&self, key: &str, envelope: Vec<u8>, payload: &[u8]) -> anyhow::Result<()> {
        self.session
            .put(key, payload.to_vec())
            .attachment(envelope)
            .congestion_control(zenoh::qos::CongestionControl::Block)
            .priority(zenoh::qos::Priority::DataHigh)
            .express(true)
            .wait()
            .map_err(|error| anyhow::anyhow!("the link takes no controls: {error}"))
    }
}

/// Answers a request once, also if no answer came at all.
struct Answering {
    events: Arc<Events>,
    number: u64,
    is_answered: parking_lot::Mutex<bool>,
}

impl Answering {
    fn answer(&self, answer: Result<Vec<u8>, NoAnswer>) {
        let mut is_answered = self.is_answered.lock();
        if !std::mem::replace(&mut *is_answered, true) {
            self.events.push(Event::Answer(self.number, answer));
        }
    }
}

impl Drop for Answering {
    fn drop(&mut self) {
        self.answer(Err(NoAnswer::Silence));
    }
}
