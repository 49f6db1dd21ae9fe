//! Writing results: one writer per topic, loans that are filled in place, and the inputs that each
//! result answers.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};
use std::time::Duration;

use iceoryx2::prelude::*;
use parking_lot::Mutex;

use schema_frames::{
    About, DocumentHeader, ElementType, InputRecord, PixelFormat, ResultHeader, ResultType,
};

use crate::contract::error::{BusError, LoanError};
use crate::contract::names;
use crate::memory::sizes::{
    ResultTopic, check_shared_memory, loan_bytes, require_shared_memory, result_segment_bytes,
    shared_memory_free,
};
use crate::place::event::Notifier;
use crate::place::node::BusNode;
use crate::place::service::{Slices, capacity};
use crate::ports::document::DocumentPublisher;
use crate::ports::results::draft::{Answerable, ResultDraft};
use crate::ports::results::reader::{bad_result, expect_kind};
use crate::ports::results::service::{ResultService, check_about};
use crate::ports::writer::{Loan, Slots, Writer, make_port};
use crate::time::clock::mono_now;

/// Start of the port name of every writer of results; the network tunnel's port has another.
const WRITER: &str = "writer ";

/// How often a topic is tried again when two writers came at the same moment.
const TRIES: u32 = 5;

/// The writing end of a topic of results.
#[derive(Debug)]
pub struct ResultPublisher {
    writer: Writer<ResultHeader>,
    topic: String,
    end: Arc<WriterEnd>,
    /// Bytes of the longest loan so far.
    slot_bytes: AtomicUsize,
}

/// What a publisher and its loans share.
#[derive(Debug)]
struct WriterEnd {
    full: String,
    kind: ResultType,
    wake: Notifier,
    writer_epoch: u64,
    n_sent: AtomicU64,
    /// Its description, once it has one.
    about: Mutex<Option<DocumentPublisher>>,
}

impl WriterEnd {
    /// Sends the description to readers that joined since the last call.
    fn greet(&self) {
        if let Some(about) = &*self.about.lock() {
            about.greet();
        }
    }

    fn number(&self, header: &mut ResultHeader) {
        header.seq = self.n_sent.fetch_add(1, Relaxed) + 1;
        if header.seq == 1 {
            header.flags |= ResultHeader::FIRST;
        }
        header.writer_epoch = self.writer_epoch;
    }
}

impl ResultPublisher {
    pub(crate) fn open(
        node: &BusNode,
        topic: &str,
        spec: &ResultTopic,
    ) -> Result<ResultPublisher, BusError> {
        let service = ResultService::make(node, topic, spec)?.slices;
        let full = service.name().as_str().to_string();
        let first_bytes = loan_bytes(spec.body_bytes.max(1));
        // The topic may have been made with other capacities than this writer asks for.
        let need_bytes = result_segment_bytes(&capacity(&service), spec.max_loans, first_bytes);
        require_shared_memory(&full, need_bytes)?;
        // Whoever finds the writer finds the service of its description, if it has one.
        let about = (!spec.about.is_empty())
            .then(|| DocumentPublisher::service(node, &names::about(topic)))
            .transpose()?;
        let slots = Slots {
            payload_bytes: first_bytes,
            max_loans: spec.max_loans,
            need_bytes,
            grow: AllocationStrategy::PowerOfTwo,
        };
        let port = only_writer(node, &service, || {
            make_port(&service, &slots, Some(&writer_name(node)))
        })?;
        let writer_epoch = mono_now().0 ^ (std::process::id() as u64).rotate_left(40);
        let about = about
            .map(|about| described(about, &spec.about, writer_epoch))
            .transpose()?;
        Ok(ResultPublisher {
            writer: Writer::of(service, port, &slots),
            topic: topic.into(),
            end: Arc::new(WriterEnd {
                full,
                kind: spec.kind,
                wake: Notifier::open(node, topic)?,
                writer_epoch,
                n_sent: AtomicU64::new(0),
                about: Mutex::new(about),
            }),
            slot_bytes: AtomicUsize::new(first_bytes),
        })
    }

    /// Name without the domain.
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Type of its results.
    pub fn kind(&self) -> ResultType {
        self.end.kind
    }

    /// Number of readers now.
    pub fn n_readers(&self) -> usize {
        self.writer.n_readers()
    }

    /// Sends the description to readers that joined since the last call, which a writer otherwise
    /// does with its next result.
    pub fn greet(&self) {
        self.end.greet();
    }

    /// Describes the results otherwise from now on. The port stays: a reader that has not looked yet
    /// loses nothing that was sent.
    pub(crate) fn describe(&self, node: &BusNode, about: &About) -> Result<(), BusError> {
        check_about(&self.end.full, self.kind(), about)?;
        let mut known = self.end.about.lock();
        match &mut *known {
            Some(document) => drop(document.send_json(about, self.end.writer_epoch, 0)?),
            None if about.is_empty() => {}
            none => {
                let service = DocumentPublisher::service(node, &names::about(&self.topic))?;
                *none = Some(described(service, about, self.end.writer_epoch)?);
            }
        }
        Ok(())
    }

    /// Loans a slot for a body of up to `body_bytes`, to be filled in place and sent. Slots grow
    /// if it is longer than all before.
    ///
    /// # Errors
    /// [`LoanError::NoFreeSlot`] if all loans are in use, [`LoanError::Memory`] if `/dev/shm` has
    /// no room for longer slots.
    pub fn loan(&self, body_bytes: usize) -> Result<ResultLoan, LoanError> {
        self.end.greet();
        let bytes = loan_bytes(body_bytes);
        self.grow(bytes)?;
        let limit_bytes = self.slot_bytes.load(Relaxed);
        Ok(ResultLoan {
            loan: self.writer.loan(self.topic(), bytes, limit_bytes)?,
            body_bytes,
            draft: ResultDraft::new(self.kind()),
            end: self.end.clone(),
        })
    }

    /// Gives a draft the next number: for results that are sent elsewhere, or in two places.
    pub(crate) fn number(&self, draft: &mut ResultDraft) {
        self.end.greet();
        draft.count_inputs();
        self.end.number(draft.header_mut());
    }

    /// Checks that there is room for slots of `bytes` before iceoryx2 makes them.
    fn grow(&self, bytes: usize) -> Result<(), LoanError> {
        if bytes <= self.slot_bytes.load(Relaxed) {
            return Ok(());
        }
        let grown = bytes.next_power_of_two();
        let need_bytes = result_segment_bytes(
            &capacity(self.writer.service()),
            self.writer.max_loans(),
            grown,
        );
        check_shared_memory(need_bytes, 0).map_err(|short| LoanError::Memory {
            topic: self.topic().into(),
            need_bytes,
            free_bytes: short.free_bytes.unwrap_or(0),
        })?;
        tracing::debug!(
            topic = self.topic(),
            need_bytes,
            free_bytes = shared_memory_free(),
            "results got longer; their slots grow"
        );
        self.slot_bytes.store(grown, Relaxed);
        Ok(())
    }
}

/// Sends the description, and keeps its publisher for readers that come later.
fn described(
    service: Slices<DocumentHeader>,
    about: &About,
    epoch: u64,
) -> Result<DocumentPublisher, BusError> {
    let mut document = DocumentPublisher::of(service)?;
    document.send_json(about, epoch, 0)?;
    Ok(document)
}

/// Makes the port unless another process of ours writes the topic. Two that come at the same
/// moment both step back and try again after different pauses.
fn only_writer<P>(
    node: &BusNode,
    service: &Slices<ResultHeader>,
    mut create: impl FnMut() -> Result<P, BusError>,
) -> Result<P, BusError> {
    for turn in 1.. {
        if !writers(service).is_empty() {
            node.clean_dead_nodes();
        }
        let before = writers(service);
        let taken = match before.first() {
            Some(writer) => writer.clone(),
            None => {
                let port = create()?;
                let others = writers(service);
                match others.iter().find(|name| **name != own_name(node)) {
                    None if others.len() == 1 => return Ok(port),
                    other => other.cloned().unwrap_or_else(|| own_name(node)),
                }
            }
        };
        if turn >= TRIES || !before.is_empty() {
            return Err(BusError::TopicTaken {
                topic: service.name().as_str().into(),
                writer: taken.trim_start_matches(WRITER).into(),
            });
        }
        let pause = 2 + std::process::id() as u64 * u64::from(turn) % 19;
        std::thread::sleep(Duration::from_millis(pause));
    }
    unreachable!("the loop ends with its last turn")
}

/// Port names of the topic's writers.
fn writers(service: &Slices<ResultHeader>) -> Vec<String> {
    let mut names = Vec::new();
    let ports = service.dynamic_config();
    ports.list_publishers(|port| {
        let name = port.publisher_name.as_str();
        if name.starts_with(WRITER) {
            names.push(name.to_string());
        }
        CallbackProgression::Continue
    });
    names
}

fn own_name(node: &BusNode) -> String {
    let program: String = node.program().chars().take(32).collect();
    format!("{WRITER}{program} (process {})", std::process::id())
}

pub(crate) fn writer_name(node: &BusNode) -> PortName {
    own_name(node)
        .as_str()
        .try_into()
        .expect("at most 32 ASCII characters, a few words and a number are shorter than 64")
}

/// A slot of shared memory for one result. Send it, or drop it to give it back.
pub struct ResultLoan {
    loan: Loan<ResultHeader>,
    body_bytes: usize,
    draft: ResultDraft,
    end: Arc<WriterEnd>,
}

impl std::fmt::Debug for ResultLoan {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ResultLoan")
            .field("header", self.header())
            .finish_non_exhaustive()
    }
}

impl ResultLoan {
    /// The header as it is so far.
    pub fn header(&self) -> &ResultHeader {
        self.draft.header()
    }

    /// The header, for space, pose and whatever the inputs do not say.
    pub fn header_mut(&mut self) -> &mut ResultHeader {
        self.draft.header_mut()
    }

    /// The whole room for the body, to be filled in place. It holds the bytes of an earlier result.
    pub fn body_mut(&mut self) -> &mut [u8] {
        let body_bytes = self.body_bytes;
        &mut self.loan.payload_mut()[..body_bytes]
    }

    /// The room for the body as it is so far.
    pub fn body(&self) -> &[u8] {
        &self.loan.payload()[..self.body_bytes]
    }

    /// Address of the body's first byte, 64-aligned, for a writer in another language.
    pub fn body_ptr(&mut self) -> *mut u8 {
        self.loan.address_mut()
    }

    /// Bytes of room for the body.
    pub fn room(&self) -> usize {
        self.body_bytes
    }

    /// Says that the body is a list of `n_items` records of `element_bytes` each, and behind them
    /// `tail_bytes` of runs or key points. Texts and bytes are lists of single bytes.
    ///
    /// # Errors
    /// [`BusError::TooLong`] if the loan has less room.
    pub fn set_list(
        &mut self,
        n_items: u32,
        element_bytes: u32,
        tail_bytes: u64,
    ) -> Result<(), BusError> {
        self.header_mut()
            .set_list(n_items, element_bytes, tail_bytes);
        self.fits()
    }

    /// Says that the body is an image.
    ///
    /// # Errors
    /// As [`ResultLoan::set_list`].
    pub fn set_image(
        &mut self,
        width_px: u32,
        height_px: u32,
        format: PixelFormat,
    ) -> Result<(), BusError> {
        self.header_mut().set_image(width_px, height_px, format);
        self.fits()
    }

    /// Says that the body is a tensor.
    ///
    /// # Errors
    /// As [`ResultLoan::set_list`], and [`BusError::BadResult`] for a shape of more than 8
    /// dimensions.
    pub fn set_tensor(&mut self, of: ElementType, shape: &[u32]) -> Result<(), BusError> {
        let service = self.end.full.clone();
        self.header_mut()
            .set_tensor(of, shape)
            .map_err(|source| bad_result(service, None, source))?;
        self.fits()
    }

    /// Copies records into the body.
    ///
    /// # Errors
    /// As [`ResultLoan::set_list`].
    pub fn write<T: bytemuck::Pod>(&mut self, records: &[T]) -> Result<(), BusError> {
        self.set_list(records.len() as u32, size_of::<T>() as u32, 0)?;
        let bytes: &[u8] = bytemuck::cast_slice(records);
        self.body_mut()[..bytes.len()].copy_from_slice(bytes);
        Ok(())
    }

    /// As [`ResultDraft::answers`].
    pub fn answers(&mut self, input: &dyn Answerable) {
        self.draft.answers(input);
    }

    /// As [`ResultDraft::add_input`].
    pub fn add_input(&mut self, input: InputRecord) {
        self.draft.add_input(input);
    }

    /// Sends the result to all readers, and wakes those that wait for this topic. Returns the
    /// number of readers that received it.
    ///
    /// # Errors
    /// [`BusError::BadResult`] if the header contradicts the type or the loan,
    /// [`BusError::Service`] if iceoryx2 fails.
    pub fn send(mut self) -> Result<usize, BusError> {
        self.fits()?;
        self.put_inputs();
        // The number is used up even if sending fails, so that a gap shows the loss.
        self.end.number(self.draft.header_mut());
        self.send_as_it_is()
    }

    /// Sends the body with what a draft says, which has its number already.
    ///
    /// # Errors
    /// As [`ResultLoan::send`].
    pub fn send_as(mut self, draft: &ResultDraft) -> Result<usize, BusError> {
        self.draft = draft.clone();
        self.send_again()
    }

    /// Sends a result that was sent before: with its own number and clocks, which the caller has set
    /// in the header, but for `published_mono_nanos`.
    ///
    /// # Errors
    /// As [`ResultLoan::send`].
    pub fn send_again(mut self) -> Result<usize, BusError> {
        self.fits()?;
        self.put_inputs();
        self.send_as_it_is()
    }

    /// Writes the inputs behind the body.
    fn put_inputs(&mut self) {
        let offset = self.header().inputs_offset() as usize;
        let body = self.header().body_bytes as usize;
        let draft = self.draft.clone();
        let records: &[u8] = bytemuck::cast_slice(draft.inputs());
        let slot = self.loan.payload_mut();
        slot[body..offset].fill(0);
        slot[offset..offset + records.len()].copy_from_slice(records);
        self.draft.count_inputs();
    }

    fn send_as_it_is(mut self) -> Result<usize, BusError> {
        let end = self.end.clone();
        self.header_mut().published_mono_nanos = mono_now().0;
        let bad = |source| bad_result(end.full.clone(), None, source);
        let found = self.header().check(self.loan.len()).map_err(bad)?;
        expect_kind(found, end.kind).map_err(bad)?;
        *self.loan.header_mut() = *self.draft.header();
        self.loan.check_pages(&end.full)?;
        let n_readers = self.loan.send("send", &end.full)?;
        end.wake.notify_listeners();
        Ok(n_readers)
    }

    fn fits(&self) -> Result<(), BusError> {
        if self.header().body_bytes > self.body_bytes as u64 {
            return Err(BusError::TooLong {
                service: self.end.full.clone(),
                len: self.header().body_bytes as usize,
                limit: self.body_bytes,
            });
        }
        Ok(())
    }
}
