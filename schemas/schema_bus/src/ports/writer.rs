//! The writing end of a topic, the same for every header: a port with its segment, and slots of it
//! that are filled in place or copied into, checked for their pages and sent.

use std::fmt::Debug;
use std::mem::MaybeUninit;

use iceoryx2::port::LoanError as IceoryxLoanError;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::update_connections::UpdateConnections as _;
use iceoryx2::prelude::*;
use iceoryx2::sample_mut_uninit::SampleMutUninit;

use crate::contract::error::{BusError, LoanError};
use crate::contract::qos::USUAL_LOANS;
use crate::contract::wire::{OnBus, Wire};
use crate::memory::shortage::backed;
use crate::memory::sizes::segment_bytes;
use crate::place::iceoryx_error::{loan_error, other_error, writer_error};
use crate::place::node::Service;
use crate::place::service::{Slices, capacity};

/// The writing port of a service.
pub(crate) type Port<H> = Publisher<Service, [u8], Wire<H>>;

/// How the slots of a segment are made.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slots {
    /// Bytes of a payload that the first slots hold.
    pub payload_bytes: usize,
    /// Slots that the writer may have loaned at a time.
    pub max_loans: usize,
    /// Bytes of the segment, for a sentence that there is no room for it.
    pub need_bytes: u64,
    /// Whether a longer payload adds slots of twice the length or more.
    pub grow: AllocationStrategy,
}

impl Slots {
    /// The slots of a writer that copies: few, and longer ones when they are needed.
    pub fn growing<H: OnBus>(service: &Slices<H>, payload_bytes: usize) -> Slots {
        Slots {
            payload_bytes,
            max_loans: USUAL_LOANS,
            need_bytes: segment_bytes(&capacity(service), USUAL_LOANS, payload_bytes),
            grow: AllocationStrategy::PowerOfTwo,
        }
    }
}

/// Makes the writing port of a service, under a name if it has one.
pub(crate) fn make_port<H: OnBus>(
    service: &Slices<H>,
    slots: &Slots,
    name: Option<&PortName>,
) -> Result<Port<H>, BusError> {
    let builder = service
        .publisher_builder()
        .initial_max_slice_len(slots.payload_bytes)
        .max_loaned_samples(slots.max_loans)
        .allocation_strategy(slots.grow);
    let builder = match name {
        Some(name) => builder.name(name),
        None => builder,
    };
    builder.create().map_err(|e| {
        let limit = capacity(service).publishers;
        writer_error(service.name().as_str(), limit, slots.need_bytes, e)
    })
}

/// The writing end of one topic.
#[derive(Debug)]
pub(crate) struct Writer<H: OnBus> {
    port: Port<H>,
    service: Slices<H>,
    max_loans: usize,
}

impl<H: OnBus> Writer<H> {
    /// A writer with a port that [`make_port`] made.
    pub fn of(service: Slices<H>, port: Port<H>, slots: &Slots) -> Writer<H> {
        Writer {
            port,
            service,
            max_loans: slots.max_loans,
        }
    }

    /// Opens a writer that copies what it sends, into slots for `payload_bytes` at first.
    pub fn copying(service: Slices<H>, payload_bytes: usize) -> Result<Writer<H>, BusError> {
        let slots = Slots::growing(&service, payload_bytes);
        let port = make_port(&service, &slots, None)?;
        Ok(Self::of(service, port, &slots))
    }

    /// Name of the service.
    pub fn full_name(&self) -> &str {
        self.service.name().as_str()
    }

    pub fn service(&self) -> &Slices<H> {
        &self.service
    }

    /// Number of readers now.
    pub fn n_readers(&self) -> usize {
        self.service.dynamic_config().number_of_subscribers()
    }

    /// Number of loans that may exist at a time.
    pub fn max_loans(&self) -> usize {
        self.max_loans
    }

    /// Loans a slot for `n_bytes`, to be filled in place. Errors call it a slot of `topic`, whose
    /// slots have `limit_bytes`.
    pub fn loan(
        &self,
        topic: &str,
        n_bytes: usize,
        limit_bytes: usize,
    ) -> Result<Loan<H>, LoanError> {
        self.slot(n_bytes)
            .map_err(|e| loan_error(topic, n_bytes, limit_bytes, self.max_loans, e))
    }

    /// Loans a slot with a copy of these bytes, whose pages are there. Errors name the service
    /// `name`.
    pub fn copy(&self, name: &str, bytes: &[u8]) -> Result<Loan<H>, BusError> {
        let loan = self.slot(bytes.len());
        let mut loan = loan.map_err(|e| other_error("write to", name, &e))?;
        loan.payload_mut().copy_from_slice(bytes);
        loan.check_pages(name)?;
        Ok(loan)
    }

    /// Sends the newest sample to readers that joined since the last call. iceoryx2 delivers it
    /// only in calls of the writer.
    pub fn greet(&self, name: &str) {
        if let Err(e) = self.port.update_connections() {
            tracing::warn!(service = name, cause = ?e, "cannot greet a new reader");
        }
    }

    fn slot(&self, n_bytes: usize) -> Result<Loan<H>, IceoryxLoanError> {
        let sample = self.port.loan_slice_uninit(n_bytes)?;
        Ok(Loan { sample })
    }
}

/// A slot of a writer's segment. Send it, or drop it to give it back.
pub(crate) struct Loan<H: OnBus> {
    sample: SampleMutUninit<Service, [MaybeUninit<u8>], Wire<H>>,
}

impl<H: OnBus> Debug for Loan<H> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Loan")
            .field("len", &self.len())
            .field("header", self.header())
            .finish_non_exhaustive()
    }
}

impl<H: OnBus> Loan<H> {
    pub fn header(&self) -> &H {
        &self.sample.user_header().0
    }

    pub fn header_mut(&mut self) -> &mut H {
        &mut self.sample.user_header_mut().0
    }

    /// Length of the payload, bytes.
    pub fn len(&self) -> usize {
        self.sample.payload().len()
    }

    /// Address of the payload's first byte, for reading.
    pub fn address(&self) -> *const u8 {
        self.sample.payload().as_ptr().cast()
    }

    /// Address of the payload's first byte, for who fills it.
    pub fn address_mut(&mut self) -> *mut u8 {
        self.sample.payload_mut().as_mut_ptr().cast()
    }

    /// The payload. It holds the bytes of an earlier sample.
    pub fn payload(&self) -> &[u8] {
        let payload = self.sample.payload();
        // SAFETY: every byte of the slot has a value, see `payload_mut`, and the shared borrow of
        // the loan keeps writers away.
        unsafe { std::slice::from_raw_parts(payload.as_ptr().cast::<u8>(), payload.len()) }
    }

    /// The payload, to be filled in place. It holds the bytes of an earlier sample.
    pub fn payload_mut(&mut self) -> &mut [u8] {
        let payload = self.sample.payload_mut();
        // SAFETY: the slot lies in a shared-memory object. The kernel gave its pages zeroed and
        // since then only bytes were stored, so every byte has a value: `MaybeUninit<u8>` here is
        // iceoryx2's caution, not a fact. `u8` has no invalid values, and the exclusive borrow of
        // the loan, which no reader has seen, makes the access unique.
        unsafe { std::slice::from_raw_parts_mut(payload.as_mut_ptr().cast::<u8>(), payload.len()) }
    }

    /// Makes sure that the slot has all its pages.
    ///
    /// # Errors
    /// [`BusError::Memory`] about the service `name` if `/dev/shm` had none for it.
    pub fn check_pages(&self, name: &str) -> Result<(), BusError> {
        backed(name, self.address(), self.len())
    }

    /// Sends it as it is. Returns the number of readers that received it. An error says that the
    /// service `name` could not be written to; `action` is its verb.
    pub fn send(self, action: &'static str, name: &str) -> Result<usize, BusError> {
        // SAFETY: every byte of the slot has a value, see `payload_mut`.
        let sample = unsafe { self.sample.assume_init() };
        sample.send().map_err(|e| other_error(action, name, &e))
    }
}
