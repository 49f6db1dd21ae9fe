//! The recording as a row of ticks: the next one is read into slots of shared memory before it is
//! due, and sent when it is.
//!
//! A simulator may send a frame while later ticks have begun, and the recording has it behind their
//! snapshots. Here it is sent with its own tick: as many further ticks are kept open as frames come
//! late, in slots of their own.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use schema_bus::{FrameLoan, LoanError, mono_now};
use schema_frames::limits::MAX_ACTORS;
use schema_frames::sealed::mount_between;
use schema_frames::{
    ActorRecord, FrameHeader, InputRecord, Modality, ResultHeader, SnapshotHeader,
};
use schema_recording::read::{Damage, Place, RecordedDocument, RecordingFile};
use schema_types::Pose;
use schema_types::noise::mix;

use crate::feed::{Bytes, Fed, FedWhat, Feed, FeedMark};
use crate::foreign::FOREIGN_TICK_NANOS;
use crate::options::Options;
use crate::plan::{Plan, PlannedFrames};
use crate::ports::Ports;

/// Most bytes of results that wait for their tick; beyond that a tick counts as read.
const MAX_RESULT_BYTES: usize = 256 << 20;

/// What was sent and what could not be.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counts {
    pub n_ticks: u64,
    pub n_results: u64,
    pub n_dropped: u64,
    pub payload_bytes: u64,
}

/// A result that waits for its tick.
#[derive(Debug)]
struct WaitingResult {
    topic: usize,
    header: ResultHeader,
    inputs: Vec<InputRecord>,
    body: Vec<u8>,
}

#[derive(Debug)]
enum Ready {
    Frame(usize, FrameLoan),
    Result(Box<WaitingResult>),
    Document(RecordedDocument),
}

/// A tick that is being read, or waits to be sent.
#[derive(Debug)]
pub struct Group {
    pub tick: u64,
    pub sim_nanos: u64,
    /// The place before its first thing.
    mark: FeedMark,
    snapshot: Option<(SnapshotHeader, Vec<ActorRecord>)>,
    ready: Vec<(Place, Ready)>,
    /// Topics whose frames were not read, because nobody read them.
    unread: BTreeSet<usize>,
    /// Whether the file goes back in time here.
    begins_run: bool,
}

/// How a topic's frames are sealed.
#[derive(Clone, Copy, Debug)]
struct TopicSeal {
    /// Whose numbers and classes are blanked; `None` of a topic that keeps them.
    blanked: Option<Modality>,
    /// The sensor's mount as the newest snapshot with its vehicle has it.
    mount: Pose,
}

/// The recording.
#[derive(Debug)]
pub struct Tape {
    file: RecordingFile,
    feed: Feed,
    groups: VecDeque<Group>,
    /// Documents before the first tick that was read.
    early: Vec<(Place, Ready)>,
    /// What was sent although the reading may come by again.
    sent_ahead: BTreeSet<Place>,
    is_at_end: bool,
    ticks_late: usize,
    most_ticks_late: usize,
    result_bytes: usize,
    result_epochs: BTreeMap<String, usize>,
    numbers: Vec<u64>,
    /// By topic of frames; none in a world that is not sealed.
    seals: Vec<TopicSeal>,
    is_sealed: bool,
    said: BTreeSet<usize>,
    counts: Counts,
    start_nanos: u64,
    span: (u64, u64),
}

impl Tape {
    /// The part of a file that is asked for.
    pub fn new(file: RecordingFile, plan: &Plan, options: &Options) -> Tape {
        let feed = Feed::new(&file, plan, options);
        let (first, last) = file.span().unwrap_or((0, 0));
        let (first, last) = match feed.is_foreign() {
            true => (0, last.saturating_sub(first)),
            false => (first, last),
        };
        let start_nanos = options.from_nanos.unwrap_or(first).max(first);
        let to_nanos = options.to_nanos.map_or(last, |to| to.saturating_sub(1));
        let names = plan.results.iter().enumerate();
        Tape {
            feed,
            groups: VecDeque::new(),
            early: Vec::new(),
            sent_ahead: BTreeSet::new(),
            is_at_end: false,
            ticks_late: plan.ticks_late,
            most_ticks_late: plan.ticks_late.max(1).saturating_add(1),
            result_bytes: 0,
            result_epochs: names
                .map(|(idx, of)| (of.source.to_string(), idx))
                .collect(),
            numbers: vec![0; plan.frames.len()],
            seals: seals(plan, options),
            is_sealed: options.seal.is_some(),
            said: BTreeSet::new(),
            counts: Counts::default(),
            start_nanos,
            span: (start_nanos, last.min(to_nanos)),
            file,
        }
    }

    /// First and last simulated time of what is replayed.
    pub fn span(&self) -> (u64, u64) {
        self.span
    }

    /// Simulated time at which the replay begins.
    pub fn start_nanos(&self) -> u64 {
        self.start_nanos
    }

    /// What could not be read so far.
    pub fn damage(&self) -> &Damage {
        self.feed.damage()
    }

    /// What was sent so far.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Name of the attached map, of a file whose documents may not say it.
    pub fn attached_map(&self) -> Option<String> {
        let names = self.file.attachment_names();
        let map = names
            .iter()
            .rev()
            .find_map(|name| name.strip_suffix(".xodr"));
        map.map(str::to_owned)
    }

    /// The documents that hold at a simulated time; the map from its attachment, if the file has no
    /// document of it.
    ///
    /// # Errors
    /// If the disk cannot be read.
    pub fn documents_at(&self, sim_nanos: u64) -> anyhow::Result<Vec<RecordedDocument>> {
        let mut documents = self.file.documents_at(sim_nanos)?;
        let is_map = |of: &RecordedDocument| *of.topic == *schema_bus::names::WORLD_MAP;
        if documents.iter().any(is_map) {
            return Ok(documents);
        }
        let attached = self.attached_map().map(|map| format!("{map}.xodr"));
        let text = match attached {
            Some(name) => self.file.attachment(&name).unwrap_or_else(|error| {
                tracing::warn!("{error:#}");
                None
            }),
            None => None,
        };
        match text.map(String::from_utf8) {
            Some(Ok(text)) => documents.push(RecordedDocument {
                topic: schema_bus::names::WORLD_MAP.into(),
                header: schema_frames::DocumentHeader {
                    revision: 1,
                    ..bytemuck::Zeroable::zeroed()
                },
                text,
                log_nanos: sim_nanos,
            }),
            _ if !self.feed.is_foreign() => tracing::warn!(
                "the recording holds no map; programs that need one (the viewer's roads, gantry-drive, CARLA's gateway) find none"
            ),
            _ => {}
        }
        Ok(documents)
    }

    /// Goes to the first tick at a simulated time or later.
    pub fn skip_to(&mut self, sim_nanos: u64) {
        self.clear();
        self.early.clear();
        self.sent_ahead.clear();
        self.numbers.fill(0);
        self.feed.skip_to(sim_nanos);
    }

    fn clear(&mut self) {
        self.groups.clear();
        (self.is_at_end, self.result_bytes) = (false, 0);
    }

    /// Reads until the next tick is whole. Returns whether there is one.
    ///
    /// # Errors
    /// If the disk cannot be read.
    pub fn load(&mut self, ports: &mut Ports) -> anyhow::Result<bool> {
        while !self.is_at_end
            && self.groups.len() < self.ticks_late.saturating_add(2)
            && (self.groups.is_empty() || self.result_bytes < MAX_RESULT_BYTES)
        {
            self.read(ports)?;
        }
        Ok(!self.groups.is_empty())
    }

    /// Simulated time of the next tick, if it is known.
    pub fn next_nanos(&self) -> Option<u64> {
        self.groups.front().map(|group| group.sim_nanos)
    }

    /// Number of the next tick, if it is known.
    pub fn next_tick(&self) -> Option<u64> {
        self.groups.front().map(|group| group.tick)
    }

    /// Whether the file goes back in time before the next tick; said once.
    pub fn begins_run(&mut self) -> bool {
        let next = self.groups.front_mut();
        next.is_some_and(|group| std::mem::take(&mut group.begins_run))
    }

    /// Whether the next tick lacks frames of topics that have readers now.
    pub fn lacks_readers(&self, ports: &Ports) -> bool {
        let next = self.groups.front();
        next.is_some_and(|group| {
            let mut unread = group.unread.iter();
            unread.any(|idx| ports.frames[*idx].n_readers() > 0)
        })
    }

    /// Reads the next tick again.
    ///
    /// # Errors
    /// If the disk cannot be read.
    pub fn read_again(&mut self, ports: &mut Ports) -> anyhow::Result<()> {
        let Some(front) = self.groups.pop_front() else {
            return Ok(());
        };
        // What stands before the tick's first thing is not met again.
        let mut kept = front.ready;
        kept.retain(|(place, _)| !front.mark.is_before(*place));
        self.clear();
        self.early = kept;
        self.feed.back_to(&front.mark)?;
        self.load(ports).map(drop)
    }

    /// The next tick, to be sent.
    pub fn take(&mut self) -> Option<Group> {
        let group = self.groups.pop_front()?;
        match self.groups.front() {
            Some(next) => {
                let ahead = group.ready.iter().map(|(place, _)| *place);
                self.sent_ahead
                    .extend(ahead.filter(|place| next.mark.is_before(*place)));
                self.sent_ahead.retain(|place| next.mark.is_before(*place));
            }
            None => self.sent_ahead.clear(),
        }
        Some(group)
    }

    fn read(&mut self, ports: &mut Ports) -> anyhow::Result<()> {
        let mark = self.feed.mark();
        let is_foreign = self.feed.is_foreign();
        let Some(fed) = self.feed.next()? else {
            self.is_at_end = true;
            return Ok(());
        };
        let Some(Fed {
            place,
            sim_nanos,
            what,
        }) = fed
        else {
            return Ok(());
        };
        if self.sent_ahead.contains(&place) {
            return Ok(());
        }
        let shelf = Shelf {
            groups: &mut self.groups,
            early: &mut self.early,
            ticks_late: &mut self.ticks_late,
            most_ticks_late: self.most_ticks_late,
            mark,
        };
        match what {
            FedWhat::Snapshot(header, records) => {
                let is_sound =
                    records.len() <= MAX_ACTORS && records.is_sorted_by_key(|record| record.id);
                let group = shelf.group_of(header.tick, header.sim_nanos, true);
                match is_sound {
                    true => group.snapshot = Some((header, records.to_vec())),
                    false => count(&mut self.counts.n_dropped),
                }
            }
            FedWhat::Document(topic, header, text) => {
                let document = RecordedDocument {
                    topic: topic.clone(),
                    header,
                    text: text.to_string(),
                    log_nanos: sim_nanos,
                };
                shelf.put(place, Ready::Document(document));
            }
            FedWhat::Frame(topic, header, bytes) => {
                let group = shelf.group_of(header.tick, header.sim_nanos, false);
                if is_foreign && group.snapshot.is_none() {
                    group.snapshot = Some((empty_snapshot(&header), Vec::new()));
                }
                let seal = self.seals.get_mut(topic).map(|seal| {
                    seal.note(&header, group.snapshot.as_ref());
                    *seal
                });
                let port = &mut ports.frames[topic];
                if port.n_readers() == 0 {
                    group.unread.insert(topic);
                    return Ok(());
                }
                match fill(port.loan(&header), &header, bytes, seal) {
                    Ok(loan) => {
                        group.unread.remove(&topic);
                        group.ready.push((place, Ready::Frame(topic, loan)));
                    }
                    Err(why) => {
                        count(&mut port.n_dropped);
                        count(&mut self.counts.n_dropped);
                        if self.said.insert(topic) {
                            tracing::warn!(
                                "a frame of {} is left out: {why}; further ones are only counted",
                                port.name()
                            );
                        }
                    }
                }
            }
            FedWhat::Result(topic, mut header, mut body, inputs) => {
                let has_readers = ports.results[topic].is_some();
                let bytes = match has_readers {
                    true => body.to_vec(),
                    false => return Ok(()),
                };
                let Ok(body) = bytes else {
                    count(&mut self.counts.n_dropped);
                    return Ok(());
                };
                if self.is_sealed {
                    header.world_from_space = mount_of(&self.seals, ports, inputs);
                }
                self.result_bytes = self.result_bytes.saturating_add(body.len());
                let result = WaitingResult {
                    topic,
                    header,
                    inputs: inputs.to_vec(),
                    body,
                };
                shelf.put(place, Ready::Result(Box::new(result)));
            }
        }
        Ok(())
    }

    /// Shows the world of the next tick before it begins. Returns whether that was done.
    ///
    /// # Errors
    /// [`schema_bus::BusError`].
    pub fn announce(&self, ports: &Ports, epoch: u64) -> anyhow::Result<bool> {
        let Some(group) = self.groups.front() else {
            return Ok(false);
        };
        group.send_snapshot(ports, epoch)
    }

    /// Sends a tick: the snapshot, unless that was done, then what belongs to it. Returns its
    /// documents, which are sent last.
    ///
    /// # Errors
    /// [`schema_bus::BusError`].
    pub fn send(
        &mut self,
        group: Group,
        ports: &mut Ports,
        epoch: u64,
        is_announced: bool,
    ) -> anyhow::Result<Vec<RecordedDocument>> {
        match is_announced {
            true => drop(ports.snapshot_wake.notify()),
            false => drop(group.send_snapshot(ports, epoch)?),
        }
        if group.tick > 0 {
            count(&mut self.counts.n_ticks);
        }
        let mut documents = Vec::new();
        let mut rigs = BTreeSet::new();
        for (_, ready) in group.ready {
            match ready {
                Ready::Frame(topic, loan) => {
                    self.send_frame(ports, topic, loan, epoch)?;
                    rigs.insert(ports.frames[topic].rig);
                }
                Ready::Result(result) => self.send_result(ports, *result, epoch)?,
                Ready::Document(document) => documents.push(document),
            }
        }
        for rig in rigs {
            ports.rigs[rig].1.notify_listeners();
        }
        Ok(documents)
    }

    fn send_frame(
        &mut self,
        ports: &mut Ports,
        topic: usize,
        mut loan: FrameLoan,
        epoch: u64,
    ) -> anyhow::Result<()> {
        let header = loan.header_mut();
        header.epoch = epoch;
        if self.feed.is_foreign() {
            count(&mut self.numbers[topic]);
            header.seq = self.numbers[topic];
        }
        let sent_bytes = &mut self.counts.payload_bytes;
        *sent_bytes = sent_bytes.saturating_add(header.payload_bytes);
        loan.send()?;
        let port = &mut ports.frames[topic];
        count(&mut port.n_sent);
        port.notify();
        Ok(())
    }

    fn send_result(
        &mut self,
        ports: &Ports,
        result: WaitingResult,
        epoch: u64,
    ) -> anyhow::Result<()> {
        let WaitingResult {
            topic,
            mut header,
            inputs,
            body,
        } = result;
        self.result_bytes = self.result_bytes.saturating_sub(body.len());
        let Some(publisher) = &ports.results[topic] else {
            return Ok(());
        };
        let recorded_epoch = header.epoch;
        // All clocks move by as much, so that latencies stay what they were.
        let later = mono_now().0.wrapping_sub(header.published_mono_nanos);
        let moved = |nanos: u64| match nanos {
            0 => 0,
            nanos => nanos.wrapping_add(later),
        };
        header.flags |= ResultHeader::REPLAYED;
        header.epoch = if recorded_epoch == 0 { 0 } else { epoch };
        header.writer_epoch = writer_epoch(epoch, topic);
        header.origin_mono_nanos = moved(header.origin_mono_nanos);
        header.taken_mono_nanos = moved(header.taken_mono_nanos);
        let mut loan = match publisher.loan(body.len()) {
            Ok(loan) => loan,
            Err(error) => {
                count(&mut self.counts.n_dropped);
                if self.said.insert(self.numbers.len().saturating_add(topic)) {
                    tracing::warn!("a result is left out: {error}; further ones are only counted");
                }
                return Ok(());
            }
        };
        *loan.header_mut() = header;
        loan.body_mut().copy_from_slice(&body);
        for mut input in inputs {
            input.epoch = match self.result_epochs.get(&input.topic()) {
                Some(other) => writer_epoch(epoch, *other),
                None if input.epoch == recorded_epoch => epoch,
                None => input.epoch,
            };
            input.published_mono_nanos = moved(input.published_mono_nanos);
            input.taken_mono_nanos = moved(input.taken_mono_nanos);
            loan.add_input(input);
        }
        loan.send_again()?;
        count(&mut self.counts.n_results);
        Ok(())
    }
}

/// One more.
fn count(counter: &mut u64) {
    *counter = counter.saturating_add(1);
}

/// Tells the writers of results apart, and those of one epoch from those of another.
fn writer_epoch(epoch: u64, topic: usize) -> u64 {
    mix(epoch ^ mix((topic as u64).saturating_add(1))).max(1)
}

/// Where things are put while they are read.
struct Shelf<'a> {
    groups: &'a mut VecDeque<Group>,
    early: &'a mut Vec<(Place, Ready)>,
    ticks_late: &'a mut usize,
    most_ticks_late: usize,
    mark: FeedMark,
}

impl<'a> Shelf<'a> {
    /// The group of a tick. A frame that is too late for its own tick goes with the next one; a
    /// snapshot that goes back in time begins another run.
    fn group_of(self, tick: u64, sim_nanos: u64, is_snapshot: bool) -> &'a mut Group {
        let newest = self.groups.back().map_or(0, |group| group.tick);
        let known = self.groups.iter().rposition(|group| group.tick == tick);
        let place = match known {
            Some(place) => Some(place),
            None if is_snapshot || tick >= newest => None,
            // Late: as many ticks are kept open from here on.
            None => {
                let late = usize::try_from(newest.saturating_sub(tick)).unwrap_or(usize::MAX);
                *self.ticks_late = late.max(*self.ticks_late).min(self.most_ticks_late);
                self.groups.iter().position(|group| group.tick > tick)
            }
        };
        let place = place.unwrap_or_else(|| {
            self.groups.push_back(Group {
                tick,
                sim_nanos,
                mark: self.mark,
                snapshot: None,
                ready: std::mem::take(self.early),
                unread: BTreeSet::new(),
                begins_run: tick < newest,
            });
            self.groups.len().saturating_sub(1)
        });
        &mut self.groups[place]
    }

    /// Puts something that belongs to no tick of its own.
    fn put(self, place: Place, ready: Ready) {
        match self.groups.back_mut() {
            Some(newest) => newest.ready.push((place, ready)),
            None => self.early.push((place, ready)),
        }
    }
}

impl Group {
    /// Sends the snapshot, if there is one. Returns whether there is.
    fn send_snapshot(&self, ports: &Ports, epoch: u64) -> anyhow::Result<bool> {
        let Some((header, records)) = &self.snapshot else {
            return Ok(false);
        };
        let header = SnapshotHeader { epoch, ..*header };
        match ports.is_sealed {
            true => ports.snapshot.send(header.sealed(), &[])?,
            false => ports.snapshot.send(header, records)?,
        }
        ports.snapshot_wake.notify();
        Ok(true)
    }
}

/// How each topic of frames is sealed; none in a world that is not.
fn seals(plan: &Plan, options: &Options) -> Vec<TopicSeal> {
    let Some(seal) = &options.seal else {
        return Vec::new();
    };
    let of_topic = |planned: &PlannedFrames| TopicSeal {
        blanked: (!seal.is_exact(&planned.name)).then_some(planned.modality),
        mount: Pose::IDENTITY,
    };
    plan.frames.iter().map(of_topic).collect()
}

impl TopicSeal {
    /// Learns the mount from the snapshot of the frame's tick. Without that the last one holds.
    fn note(
        &mut self,
        header: &FrameHeader,
        snapshot: Option<&(SnapshotHeader, Vec<ActorRecord>)>,
    ) {
        let vehicle = snapshot.and_then(|(_, records)| {
            let found = records.binary_search_by_key(&header.parent_id, |record| record.id);
            found.ok().map(|idx| &records[idx])
        });
        if let Some(vehicle) = vehicle {
            self.mount = mount_between(&vehicle.world_from_actor, &header.world_from_sensor);
        }
    }
}

/// What a sealed world says in place of a result's pose: the mount of the sensor that it answers, if
/// programs see that sensor, else nothing.
fn mount_of(seals: &[TopicSeal], ports: &Ports, inputs: &[InputRecord]) -> Pose {
    let answered = inputs.first().map(InputRecord::topic);
    let is_answered = |name: &str| answered.as_deref() == Some(name);
    let shown = ports
        .frames
        .iter()
        .position(|port| is_answered(port.name()));
    let seal = shown.and_then(|topic| seals.get(topic));
    seal.map_or(Pose::IDENTITY, |seal| seal.mount)
}

/// Reads a frame into its slot, and seals it there.
fn fill(
    loan: Result<FrameLoan, LoanError>,
    header: &FrameHeader,
    bytes: Bytes<'_>,
    seal: Option<TopicSeal>,
) -> anyhow::Result<FrameLoan> {
    let mut loan = loan?;
    let len = header.payload_bytes as usize;
    bytes.read_into(&mut loan.payload_mut()[..len])?;
    if let Some(seal) = seal {
        if let Some(modality) = seal.blanked {
            modality.blank(&mut loan.payload_mut()[..len]);
        }
        loan.header_mut().seal(seal.mount);
    }
    let now = mono_now().0;
    let header = loan.header_mut();
    header.flags |= FrameHeader::REPLAYED;
    header.rendered_mono_nanos = now;
    (header.cpu_copies, header.ticks_in_flight) = (1, 0);
    header.payload_place = 0;
    Ok(loan)
}

/// The world of a file that has none.
fn empty_snapshot(header: &FrameHeader) -> SnapshotHeader {
    SnapshotHeader {
        tick: header.tick,
        sim_nanos: header.sim_nanos,
        period_nanos: FOREIGN_TICK_NANOS,
        episode: 1,
        actors_revision: 1,
        ..bytemuck::Zeroable::zeroed()
    }
}
