//! The reading end that topics of frames and of results share: what is checked, counted and passed
//! over, whatever the header.

use std::sync::Arc;

use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;

use crate::error::BusError;
use crate::iceoryx_error::{other_error, reader_error, receive_error};
use crate::node::Service;
use crate::origin::Origin;
use crate::origins::Origins;
use crate::qos;
use crate::service::Slices;
use crate::wire::{OnBus, Wire};

/// Opens the reading port of a service.
pub(crate) fn subscribe<H: OnBus>(
    service: &Slices<H>,
) -> Result<Subscriber<Service, [u8], Wire<H>>, BusError> {
    service.subscriber_builder().create().map_err(|e| {
        let limit = service.static_config().max_subscribers();
        reader_error(service.name().as_str(), limit, e)
    })
}

/// A received sample: bytes behind a header `H`.
pub(crate) type Received<H> = Sample<Service, [u8], Wire<H>>;

/// Takes one sample, if any waits.
pub(crate) fn receive<H: OnBus>(
    service: &Slices<H>,
    port: &Subscriber<Service, [u8], Wire<H>>,
) -> Result<Option<Received<H>>, BusError> {
    port.receive().map_err(|e| {
        let limit = service.static_config().subscriber_max_borrowed_samples();
        receive_error(service.name().as_str(), limit, e)
    })
}

/// What a reader has received and missed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReaderCounts {
    /// Samples that were returned.
    pub taken: u64,
    /// Samples that a call for the newest one passed over.
    pub skipped: u64,
    /// Samples that never arrived: gaps in `seq`.
    pub lost: u64,
    /// Samples that broke the contract.
    pub refused: u64,
    /// Number of times that samples came under a new epoch: the writer had restarted.
    pub restarts: u64,
}

/// What one kind of topic does with its samples.
pub(crate) trait Admission {
    /// Header of the samples.
    type Header: OnBus;
    /// What a reader gets.
    type Item;
    /// A broken rule.
    type Fault;

    /// Checks a sample. Returns what the reader gets, its epoch and its `seq`.
    fn admit(&self, sample: Received<Self::Header>) -> Result<(Self::Item, u64, u64), Self::Fault>;

    /// The error that names the broken rule and who broke it.
    fn refuse(service: String, writer: Option<Arc<Origin>>, fault: Self::Fault) -> BusError;
}

/// The reading end of one topic.
#[derive(Debug)]
pub(crate) struct Intake<A: Admission> {
    port: Subscriber<Service, [u8], Wire<A::Header>>,
    service: Slices<A::Header>,
    origins: Origins,
    /// Epoch and `seq` of the newest sample.
    place: Option<(u64, u64)>,
    counts: ReaderCounts,
    pub admission: A,
}

impl<A: Admission> Intake<A> {
    /// The service that it reads.
    pub fn service(&self) -> &Slices<A::Header> {
        &self.service
    }

    pub fn open(service: Slices<A::Header>, admission: A) -> Result<Intake<A>, BusError> {
        Ok(Intake {
            port: subscribe(&service)?,
            service,
            origins: Origins::default(),
            place: None,
            counts: ReaderCounts::default(),
            admission,
        })
    }

    /// Takes the oldest sample that waits, if any.
    pub fn next(&mut self) -> Result<Option<A::Item>, BusError> {
        let item = self.pull()?;
        self.counts.taken += item.is_some() as u64;
        Ok(item)
    }

    /// Takes the newest sample that waits, if any.
    pub fn latest(&mut self) -> Result<Option<A::Item>, BusError> {
        let mut newest = None;
        // Bounded, so that a process that floods the topic cannot hold its readers here.
        for _ in 0..qos::MAX_PASSED_OVER {
            if !self.waiting()? {
                break;
            }
            // The older sample is given back first, so that a caller that may hold only one more
            // can still drain.
            if newest.take().is_some() {
                self.counts.skipped += 1;
            }
            newest = self.pull()?;
            if newest.is_none() {
                break;
            }
        }
        self.counts.taken += newest.is_some() as u64;
        Ok(newest)
    }

    pub fn counts(&self) -> ReaderCounts {
        self.counts
    }

    /// Epoch of the newest sample.
    pub fn epoch(&self) -> Option<u64> {
        self.place.map(|(epoch, _)| epoch)
    }

    /// Whether a writer has the topic open.
    pub fn has_writer(&self) -> bool {
        self.service.dynamic_config().number_of_publishers() > 0
    }

    fn waiting(&self) -> Result<bool, BusError> {
        let failed = |e| other_error("read", self.service.name().as_str(), &e);
        self.port.has_samples().map_err(failed)
    }

    fn pull(&mut self) -> Result<Option<A::Item>, BusError> {
        let Some(sample) = receive(&self.service, &self.port)? else {
            return Ok(None);
        };
        let writer = sample.origin().value();
        match self.admission.admit(sample) {
            Ok((item, epoch, seq)) => {
                self.count_gap(epoch, seq);
                Ok(Some(item))
            }
            Err(fault) => {
                self.counts.refused += 1;
                let service = self.service.name().as_str().to_owned();
                let writer = self.origins.of_writer(writer, &self.service);
                Err(A::refuse(service, Some(writer), fault))
            }
        }
    }

    fn count_gap(&mut self, epoch: u64, seq: u64) {
        match self.place {
            Some((before, last)) if before == epoch => {
                let gap = seq.saturating_sub(last.saturating_add(1));
                self.counts.lost = self.counts.lost.saturating_add(gap);
            }
            Some(_) => self.counts.restarts += 1,
            None => {}
        }
        self.place = Some((epoch, seq));
    }
}
