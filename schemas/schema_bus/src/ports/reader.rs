//! The reading end of a topic, the same for every kind of sample, in shared memory and on a GPU:
//! what is checked, counted and passed over. A [`SampleKind`] says what a kind has of its own.

use std::fmt::Debug;
use std::sync::Arc;

use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;

use schema_frames::SCHEMA_VERSION;

use crate::contract::error::BusError;
use crate::contract::origin::Origin;
use crate::contract::qos;
use crate::contract::wire::{OnBus, Wire};
use crate::place::iceoryx_error::{other_error, reader_error, receive_error};
use crate::place::node::{BusNode, Service};
use crate::place::origins::{Origins, pid_of};
use crate::place::service::Slices;

/// The reading port of a service.
type Port<H> = Subscriber<Service, [u8], Wire<H>>;

/// A received sample: bytes behind a header `H`.
pub type Received<H> = Sample<Service, [u8], Wire<H>>;

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

/// Where a sample stands among those of its topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Moment {
    /// Random number of its writer's start.
    pub epoch: u64,
    /// Tick that it is about.
    pub tick: u64,
    /// Number of the sample, without gaps in one epoch.
    pub seq: u64,
}

impl Moment {
    /// Whether a sample of this moment can be recognised when it comes a second time.
    fn is_numbered(self) -> bool {
        self.seq > 0 && self.tick > 0
    }
}

/// What the samples of one kind of topic have of their own.
pub trait SampleKind: Debug + Sized {
    /// Header of the samples.
    type Header: OnBus;
    /// What a reader gets.
    type Sample;
    /// A broken rule.
    type Fault;

    /// Whether a sample may come twice: one that a process sent and was killed before it said so is
    /// made once more by another. The second one is passed over.
    const COMES_TWICE: bool = false;

    /// Checks a sample of `topic`.
    ///
    /// # Errors
    /// The broken rule.
    fn admit(
        &self,
        received: Received<Self::Header>,
        topic: &Arc<str>,
    ) -> Result<Self::Sample, Self::Fault>;

    /// Where a sample stands among the others.
    fn moment(sample: &Self::Sample) -> Moment;

    /// The error that names the broken rule and who broke it.
    fn refuse(service: String, writer: Option<Arc<Origin>>, fault: Self::Fault) -> BusError;
}

/// The reading end of one topic. It survives its writer: when the writer comes back, samples
/// continue under a new epoch.
#[derive(Debug)]
pub struct Reader<K: SampleKind> {
    port: Port<K::Header>,
    service: Slices<K::Header>,
    origins: Origins,
    topic: Arc<str>,
    pub(crate) kind: K,
    /// Moment of the newest sample that was received.
    newest: Option<Moment>,
    /// Moment of the last sample that was returned.
    returned: Option<Moment>,
    counts: ReaderCounts,
}

impl<K: SampleKind> Reader<K> {
    /// Opens a reading port of the service of `topic`.
    pub(crate) fn of(
        service: Slices<K::Header>,
        topic: &str,
        kind: K,
    ) -> Result<Reader<K>, BusError> {
        Ok(Reader {
            port: subscribe(&service)?,
            service,
            origins: Origins::default(),
            topic: topic.into(),
            kind,
            newest: None,
            returned: None,
            counts: ReaderCounts::default(),
        })
    }

    /// As [`Reader::of`] for a service that has few places: those of killed readers are cleaned up
    /// if all are taken, because they keep them until somebody does.
    pub(crate) fn of_few(
        node: &BusNode,
        service: impl Fn() -> Result<Slices<K::Header>, BusError>,
        topic: &str,
        kind: impl Fn() -> K,
    ) -> Result<Reader<K>, BusError> {
        match Self::of(service()?, topic, kind()) {
            Err(BusError::TooManyReaders { .. }) => {
                node.clean_dead_nodes();
                Self::of(service()?, topic, kind())
            }
            opened => opened,
        }
    }

    /// The service that it reads.
    pub(crate) fn service(&self) -> &Slices<K::Header> {
        &self.service
    }

    /// Name without the domain, and without the end that a service on a GPU has.
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Takes the oldest sample that waits, if any.
    ///
    /// # Errors
    /// [`BusError::BadFrame`], [`BusError::BadResult`] or [`BusError::BadSample`] for one that
    /// breaks the contract, which is dropped, so the next call continues after it;
    /// [`BusError::BorrowLimit`].
    #[expect(
        clippy::should_implement_trait,
        reason = "an iterator would end at the first gap; this is polled"
    )]
    pub fn next(&mut self) -> Result<Option<K::Sample>, BusError> {
        while let Some(sample) = self.pull()? {
            if !self.comes_again(&sample) {
                self.counts.taken += 1;
                return Ok(Some(sample));
            }
        }
        Ok(None)
    }

    /// Takes the newest sample that waits, if any; older ones are dropped and counted as skipped.
    ///
    /// # Errors
    /// As [`Reader::next`].
    pub fn latest(&mut self) -> Result<Option<K::Sample>, BusError> {
        let mut newest = None;
        // Bounded, so that a process that floods the topic cannot hold its readers here.
        for _ in 0..qos::MAX_PASSED_OVER {
            if !self.has_waiting()? {
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
        let newest = newest.filter(|sample| !self.comes_again(sample));
        self.counts.taken += u64::from(newest.is_some());
        Ok(newest)
    }

    /// The last sample could not be reached: if it comes again, from another process, it is taken.
    pub fn forget_last(&mut self) {
        self.returned = None;
    }

    /// Counters since this reader was opened.
    pub fn counts(&self) -> ReaderCounts {
        self.counts
    }

    /// Epoch of the newest sample.
    pub fn epoch(&self) -> Option<u64> {
        self.newest.map(|newest| newest.epoch)
    }

    /// Whether a writer has the topic open. A killed writer counts until its remains are removed,
    /// see [`crate::Bus::clean_dead_nodes`].
    pub fn has_writer(&self) -> bool {
        self.service.dynamic_config().number_of_publishers() > 0
    }

    /// The process that writes; `None` if nobody does. Call [`crate::Bus::clean_dead_nodes`] first,
    /// so that it is no killed one.
    pub fn writer(&self) -> Option<Origin> {
        let mut writer = None;
        self.service.dynamic_config().list_publishers(|details| {
            writer = Some(Origin::new(pid_of(details.node_id), ""));
            CallbackProgression::Continue
        });
        writer
    }

    /// Whether a sample is the last one again. Takes note of it otherwise.
    fn comes_again(&mut self, sample: &K::Sample) -> bool {
        if !K::COMES_TWICE {
            return false;
        }
        let moment = K::moment(sample);
        self.returned.replace(moment) == Some(moment) && moment.is_numbered()
    }

    fn has_waiting(&self) -> Result<bool, BusError> {
        let failed = |e| other_error("read", self.service.name().as_str(), &e);
        self.port.has_samples().map_err(failed)
    }

    fn pull(&mut self) -> Result<Option<K::Sample>, BusError> {
        let Some(received) = receive(&self.service, &self.port)? else {
            return Ok(None);
        };
        let writer = received.origin().value();
        match self.kind.admit(received, &self.topic) {
            Ok(sample) => {
                self.count_gap(K::moment(&sample));
                Ok(Some(sample))
            }
            Err(fault) => Err(self.refusal(writer, fault)),
        }
    }

    /// Counts a sample of the port `writer` that broke a rule, and tells why.
    pub(crate) fn refusal(&mut self, writer: u128, fault: K::Fault) -> BusError {
        self.counts.refused += 1;
        let service = self.service.name().as_str().to_owned();
        let writer = self.origins.of_writer(writer, &self.service);
        K::refuse(service, Some(writer), fault)
    }

    fn count_gap(&mut self, moment: Moment) {
        match self.newest {
            Some(last) if last.epoch == moment.epoch => {
                let gap = moment.seq.saturating_sub(last.seq.saturating_add(1));
                self.counts.lost = self.counts.lost.saturating_add(gap);
            }
            Some(_) => self.counts.restarts += 1,
            None => {}
        }
        self.newest = Some(moment);
    }
}

/// Opens the reading port of a service.
pub(crate) fn subscribe<H: OnBus>(service: &Slices<H>) -> Result<Port<H>, BusError> {
    service.subscriber_builder().create().map_err(|e| {
        let limit = service.static_config().max_subscribers();
        reader_error(service.name().as_str(), limit, e)
    })
}

/// Takes one sample, if any waits.
pub(crate) fn receive<H: OnBus>(
    service: &Slices<H>,
    port: &Port<H>,
) -> Result<Option<Received<H>>, BusError> {
    port.receive().map_err(|e| {
        let limit = service.static_config().subscriber_max_borrowed_samples();
        receive_error(service.name().as_str(), limit, e)
    })
}

/// The rule that a snapshot, a scene, a document or a sample of controls breaks, as a predicate.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SampleFault {
    /// It does not begin as it must.
    #[error("starts with {found:#010x}, not with \"{}\"", .wanted.to_le_bytes().escape_ascii())]
    Magic {
        /// How it begins.
        found: u32,
        /// How it must begin.
        wanted: u32,
    },
    /// It is of another version.
    #[error("carries schema {found}, {reader} {SCHEMA_VERSION}")]
    Schema {
        /// Its version.
        found: u16,
        /// Who reads, with a verb: "this reader understands".
        reader: &'static str,
    },
    /// Its length is not that of its actors.
    #[error("claims {claimed} actors in {found} bytes")]
    Actors {
        /// Actors that its header says.
        claimed: u32,
        /// Bytes that it has.
        found: usize,
    },
    /// Its records cannot be read where they are.
    #[error("is not aligned")]
    Unaligned,
    /// It has fewer bytes than its header says.
    #[error("claims {claimed} bytes and has {found}")]
    Length {
        /// Bytes that its header says.
        claimed: u64,
        /// Bytes that it has.
        found: usize,
    },
    /// It is no text.
    #[error("is not UTF-8 ({0})")]
    Text(#[from] std::str::Utf8Error),
    /// It has too many records.
    #[error("has {found} bytes, at most {limit} records of {record_bytes} are read")]
    TooMany {
        /// Bytes that it has.
        found: usize,
        /// Records that are read.
        limit: usize,
        /// Bytes of a record.
        record_bytes: usize,
    },
    /// Its last record is cut.
    #[error("has {found} bytes, not a whole number of records of {record_bytes}")]
    Cut {
        /// Bytes that it has.
        found: usize,
        /// Bytes of a record.
        record_bytes: usize,
    },
}

/// First fields of a header that has no checks of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Stamp {
    pub magic: u32,
    pub schema_version: u16,
}

impl Stamp {
    /// Checks them against the magic of the contract. `reader` says who reads: "this reader
    /// understands".
    pub fn check(self, magic: u32, reader: &'static str) -> Result<(), SampleFault> {
        if self.magic != magic {
            return Err(SampleFault::Magic {
                found: self.magic,
                wanted: magic,
            });
        }
        if self.schema_version != SCHEMA_VERSION {
            return Err(SampleFault::Schema {
                found: self.schema_version,
                reader,
            });
        }
        Ok(())
    }
}

/// The error for a broken sample of a topic without an error of its own.
pub(crate) fn bad_sample(
    service: String,
    writer: Option<Arc<Origin>>,
    fault: &SampleFault,
) -> BusError {
    BusError::BadSample {
        service,
        writer,
        fault: fault.to_string(),
    }
}
