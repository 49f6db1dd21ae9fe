//! The services into which another machine's frames and results are published.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context as _, ensure};
use bytemuck::pod_read_unaligned;
use schema_bus::{
    Bus, BusError, FramePublisher, FrameService, FrameTopic, Notifier, ResultPublisher,
    ResultTopic, check_shared_memory, names,
};
use schema_frames::result::MAX_INPUTS;
use schema_frames::{About, FrameHeader, InputRecord, Modality, ResultHeader};

use crate::announce::Offer;
use crate::clock::Clock;
use crate::coding::decode;
use crate::import::inbox::Arrived;

/// A topic of frames: without memory until the first frame comes for a reader.
#[derive(Debug)]
pub struct FramePort {
    state: State,
    wake: Notifier,
    spec: FrameTopic,
    modality: Modality,
    name: String,
}

#[derive(Debug)]
enum State {
    /// Readers can find it.
    Waiting(FrameService),
    /// Its segment has slots of `slot_bytes`.
    Writing(FramePublisher, usize),
    /// Between two others.
    Changing,
}

impl FramePort {
    /// Makes the topic as it is on the other machine.
    ///
    /// # Errors
    /// [`BusError`], for example if the topic exists here with other capacities.
    pub fn open(bus: &Bus, offer: &Offer) -> anyhow::Result<FramePort> {
        let modality = offer
            .modality()
            .context("a topic of frames has a modality")?;
        let spec = FrameTopic {
            // Of a service without a publisher this is not used.
            max_payload_bytes: 1,
            frames_in_flight: 1,
            max_readers: offer.readers,
            buffer: offer.buffer,
            borrowed: offer.borrowed,
        };
        Ok(FramePort {
            state: State::Waiting(bus.frame_service(&offer.name, spec)?),
            wake: bus.notifier(&offer.name)?,
            spec,
            modality,
            name: offer.name.clone(),
        })
    }

    /// Number of readers now.
    pub fn n_readers(&self) -> usize {
        match &self.state {
            State::Waiting(service) => service.n_readers(),
            State::Writing(publisher, _) => publisher.n_readers(),
            State::Changing => 0,
        }
    }

    /// Gives back the memory; readers still find the topic.
    ///
    /// # Errors
    /// [`BusError`].
    pub fn rest(&mut self, bus: &Bus) -> Result<(), BusError> {
        if let State::Writing(..) = self.state {
            let service = bus.frame_service(&self.name, self.spec)?;
            self.state = State::Waiting(service);
        }
        Ok(())
    }

    /// The header of a frame that has arrived, checked against its payload.
    ///
    /// # Errors
    /// A sentence for what is no frame of this topic.
    pub fn header(&self, arrived: &Arrived) -> anyhow::Result<FrameHeader> {
        let (header, _) = arrived.envelope.header::<FrameHeader>()?;
        let raw_bytes = arrived.envelope.raw_bytes;
        let found = header.check(raw_bytes)?;
        ensure!(
            found == self.modality,
            "a frame of {} came on {:?}",
            found.name(),
            self.name
        );
        ensure!(
            header.payload_bytes == raw_bytes as u64,
            "a frame announces {} bytes and carries {raw_bytes}",
            header.payload_bytes
        );
        Ok(header)
    }

    /// Publishes a frame with the bytes that it had on the other machine, and wakes those who wait
    /// for the topic.
    ///
    /// # Errors
    /// A sentence for a payload that cannot be decoded, and if `/dev/shm` has no room.
    pub fn publish(
        &mut self,
        bus: &Bus,
        mut header: FrameHeader,
        arrived: &Arrived,
        clock: &Clock,
    ) -> anyhow::Result<()> {
        let publisher = self.publisher(bus, arrived.envelope.raw_bytes)?;
        let mut loan = publisher.loan(arrived.envelope.raw_bytes)?;
        decode(
            arrived.envelope.coding,
            Some(&header),
            &arrived.payload,
            loan.payload_mut(),
        )?;
        clock.translate_frame(&mut header);
        *loan.header_mut() = header;
        loan.send()?;
        self.wake.notify_listeners();
        Ok(())
    }

    /// A publisher with slots of at least `len` bytes.
    fn publisher(&mut self, bus: &Bus, len: usize) -> anyhow::Result<&FramePublisher> {
        if let State::Writing(_, slot_bytes) = &mut self.state
            && len > *slot_bytes
        {
            // Longer slots are added; whether there is room must be asked before.
            let grown = len.next_power_of_two();
            let spec = FrameTopic {
                max_payload_bytes: grown,
                ..self.spec
            };
            check_shared_memory(spec.segment_bytes(self.modality), 0)?;
            *slot_bytes = grown;
        }
        if !matches!(self.state, State::Writing(..)) {
            let spec = FrameTopic {
                max_payload_bytes: len.max(1),
                ..self.spec
            };
            let publisher = bus.frame_service(&self.name, spec)?.growing_publisher()?;
            self.state = State::Changing;
            self.state = State::Writing(publisher, len.max(1));
        }
        match &self.state {
            State::Writing(publisher, _) => Ok(publisher),
            State::Waiting(_) | State::Changing => unreachable!("it writes since a line above"),
        }
    }
}

/// A topic of results.
#[derive(Debug)]
pub struct ResultPort(ResultPublisher);

impl ResultPort {
    /// Opens the topic for writing, as it is on the other machine.
    ///
    /// # Errors
    /// [`BusError`], for example if a program of this machine writes it.
    pub fn open(bus: &Bus, offer: &Offer) -> anyhow::Result<ResultPort> {
        let kind = offer.result_type();
        let mut spec = ResultTopic::new(kind.context("a topic of results has a type")?);
        spec.qos = offer.qos(spec.qos);
        spec.about = offer.about.clone();
        Ok(ResultPort(bus.result_publisher(&offer.name, &spec)?))
    }

    /// Takes over another description.
    ///
    /// # Errors
    /// [`BusError`].
    pub fn describe(&self, bus: &Bus, about: &About) -> Result<(), BusError> {
        bus.describe_results(&self.0, about)
    }

    /// Number of readers now.
    pub fn n_readers(&self) -> usize {
        self.0.n_readers()
    }

    /// Sends the description to readers that joined since the last call.
    pub fn greet(&self) {
        self.0.greet();
    }

    /// Publishes a result as it was on the other machine.
    ///
    /// # Errors
    /// A sentence for what is no result of this topic, and if `/dev/shm` has no room.
    pub fn publish(&self, arrived: &Arrived, clock: &Clock) -> anyhow::Result<()> {
        let (mut header, behind) = arrived.envelope.header::<ResultHeader>()?;
        let raw_bytes = arrived.envelope.raw_bytes;
        ensure!(
            header.body_bytes == raw_bytes as u64,
            "a result announces {} bytes and carries {raw_bytes}",
            header.body_bytes
        );
        let n_inputs = header.n_inputs as usize;
        ensure!(
            n_inputs <= MAX_INPUTS && behind.len() == n_inputs * size_of::<InputRecord>(),
            "a result announces {n_inputs} inputs and carries {} bytes of them",
            behind.len()
        );
        clock.translate_result(&mut header);
        let mut loan = self.0.loan(raw_bytes)?;
        decode(
            arrived.envelope.coding,
            None,
            &arrived.payload,
            loan.body_mut(),
        )?;
        *loan.header_mut() = header;
        for bytes in behind.chunks_exact(size_of::<InputRecord>()) {
            let mut input: InputRecord = pod_read_unaligned(bytes);
            clock.translate_input(&mut input);
            loan.add_input(input);
        }
        loan.send_again()?;
        Ok(())
    }
}

/// Events of the rigs whose frames come from elsewhere.
#[derive(Debug, Default)]
pub struct Rigs(BTreeMap<String, (Notifier, bool)>);

impl Rigs {
    /// Makes the event of a topic's rig, if it is the first topic of it.
    ///
    /// # Errors
    /// [`BusError`].
    pub fn add(&mut self, bus: &Bus, topic: &str) -> Result<(), BusError> {
        let rig = names::rig_of(topic);
        if !self.0.contains_key(rig) {
            let event = bus.notifier(&names::rig_tick(rig))?;
            self.0.insert(rig.to_owned(), (event, false));
        }
        Ok(())
    }

    /// Closes the events of rigs without a topic.
    pub fn keep<'a>(&mut self, topics: impl Iterator<Item = &'a str>) {
        let rigs: BTreeSet<&str> = topics.map(names::rig_of).collect();
        self.0.retain(|rig, _| rigs.contains(rig.as_str()));
    }

    /// Notes that a frame of the topic's rig was sent.
    pub fn note(&mut self, topic: &str) {
        if let Some((_, is_due)) = self.0.get_mut(names::rig_of(topic)) {
            *is_due = true;
        }
    }

    /// Wakes those who wait for whole rigs of which frames were sent since the last call.
    pub fn notify(&mut self) {
        for (event, is_due) in self.0.values_mut() {
            if std::mem::take(is_due) {
                event.notify_listeners();
            }
        }
    }
}
