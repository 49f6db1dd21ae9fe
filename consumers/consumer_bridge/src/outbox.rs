//! Sends samples on threads of its own, so that a slow link blocks nobody who reads the bus.
//!
//! Each topic has an [`Outlet`] that takes few samples at a time. While it is full its reader takes
//! nothing from the bus, whose buffer then drops the oldest sample: a slow link shows the newest
//! frames and the gaps are counted, and memory stays bounded.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering::Relaxed};
use std::thread::JoinHandle;

use anyhow::Context as _;
use crossbeam_channel::{Receiver, Sender, unbounded};
use schema_frames::FrameHeader;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::{Session, Wait as _};

use crate::coding::{Encoder, Wanted};
use crate::wire::Envelope;

/// Payloads up to this size are small, bytes.
const SMALL_BYTES: usize = 64 << 10;
/// Large samples of one topic on their way to the link: one that is sent and one that is coded.
const LARGE_IN_FLIGHT: usize = 2;
/// Small samples of one topic on their way to the link.
const SMALL_IN_FLIGHT: usize = 16;
/// Threads for large samples at most.
const MAX_BULK_LANES: usize = 4;

/// How the samples of a topic are sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// As large as images: they let others go before them.
    Large,
    /// Small ones.
    Small,
    /// Documents, which are sent whether somebody wants them or not. Another machine subscribes and
    /// asks for the newest one; that it wants them is known here a moment after its question was
    /// answered. A document that came in between would reach it neither way.
    Document,
}

/// The sending end of one topic.
#[derive(Debug)]
pub struct Outlet {
    publisher: Publisher<'static>,
    wanted: Arc<AtomicBool>,
    compress: Wanted,
    /// How its samples are sent.
    class: Class,
    in_flight: AtomicUsize,
    /// Bytes of its last payload.
    last_bytes: AtomicUsize,
    /// What it has sent.
    pub sent: Arc<Sent>,
}

/// What an outlet has sent.
#[derive(Debug, Default)]
pub struct Sent {
    /// Samples.
    pub n: AtomicU64,
    /// Bytes of their payloads on the bus.
    pub raw_bytes: AtomicU64,
    /// Bytes of their payloads on the link.
    pub link_bytes: AtomicU64,
    /// Samples that the link did not take.
    pub failed: AtomicU64,
}

/// Whether anybody on the link reads what `publisher` sends, kept up to date; `wake` is called with
/// each change.
pub(crate) fn watch_readers(
    publisher: &Publisher<'_>,
    wake: impl Fn() + Send + Sync + 'static,
) -> zenoh::Result<Arc<AtomicBool>> {
    let wanted = Arc::new(AtomicBool::new(false));
    let is_wanted = wanted.clone();
    publisher
        .matching_listener()
        .callback(move |status| {
            is_wanted.store(status.matching(), Relaxed);
            wake();
        })
        .background()
        .wait()?;
    wanted.fetch_or(publisher.matching_status().wait()?.matching(), Relaxed);
    Ok(wanted)
}

impl Outlet {
    /// Opens the topic's key for sending. `wake` is called when another machine begins or ends to
    /// want it.
    ///
    /// # Errors
    /// What zenoh says.
    pub fn open(
        session: &Session,
        key: String,
        compress: Wanted,
        class: Class,
        wake: impl Fn() + Send + Sync + 'static,
    ) -> anyhow::Result<Arc<Outlet>> {
        let failed = |error: zenoh::Error| anyhow::anyhow!("cannot offer {key:?}: {error}");
        let publisher = session
            .declare_publisher(key.clone())
            .congestion_control(CongestionControl::Block)
            .priority(match class {
                Class::Large => Priority::Data,
                Class::Small | Class::Document => Priority::DataHigh,
            })
            // A small sample that waits for company to share a packet with would be late.
            .express(class != Class::Large)
            .wait()
            .map_err(failed)?;
        let wanted = watch_readers(&publisher, wake).map_err(failed)?;
        Ok(Arc::new(Outlet {
            publisher,
            wanted,
            compress,
            class,
            in_flight: AtomicUsize::new(0),
            last_bytes: AtomicUsize::new(0),
            sent: Arc::default(),
        }))
    }

    /// Whether its samples are to be sent now: another machine wants the topic, or it is a document.
    pub fn is_wanted(&self) -> bool {
        self.class == Class::Document || self.wanted.load(Relaxed)
    }

    /// Whether it takes no further sample now.
    pub fn is_full(&self) -> bool {
        let limit = match self.last_bytes.load(Relaxed) > SMALL_BYTES {
            true => LARGE_IN_FLIGHT,
            false => SMALL_IN_FLIGHT,
        };
        self.in_flight.load(Relaxed) >= limit
    }
}

/// A sample on its way.
#[derive(Debug)]
pub struct Parcel {
    /// Its topic.
    pub outlet: Arc<Outlet>,
    /// Its user header, and what stands behind it in the envelope.
    pub header: Vec<u8>,
    /// The header of a frame.
    pub frame: Option<FrameHeader>,
    /// Its payload.
    pub payload: Vec<u8>,
}

/// The threads that send.
#[derive(Debug)]
pub struct Outbox {
    urgent: Sender<Parcel>,
    bulk: Vec<Sender<Parcel>>,
    threads: Vec<JoinHandle<()>>,
}

impl Outbox {
    /// Starts the threads.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn start() -> anyhow::Result<Outbox> {
        let n_bulk = std::thread::available_parallelism()
            .map_or(1, |n| n.get() / 2)
            .clamp(1, MAX_BULK_LANES);
        let mut threads = Vec::new();
        let mut lane = |name: String| -> anyhow::Result<Sender<Parcel>> {
            let (sender, parcels) = unbounded();
            let encoder = Encoder::new()?;
            let thread = std::thread::Builder::new()
                .name(name)
                .spawn(move || send_all(&parcels, encoder))
                .context("the system gives no thread for sending")?;
            threads.push(thread);
            Ok(sender)
        };
        let urgent = lane("send small".into())?;
        let bulk = (0..n_bulk)
            .map(|idx| lane(format!("send large {idx}")))
            .collect::<anyhow::Result<_>>()?;
        Ok(Outbox {
            urgent,
            bulk,
            threads,
        })
    }

    /// Takes a sample for sending. Samples of one topic are sent in their order.
    pub fn send(&self, parcel: Parcel) {
        let outlet = &parcel.outlet;
        outlet.in_flight.fetch_add(1, Relaxed);
        outlet.last_bytes.store(parcel.payload.len(), Relaxed);
        let lane = match outlet.class {
            Class::Small | Class::Document => &self.urgent,
            // Topics keep their lane, by the address of their outlet.
            Class::Large => &self.bulk[(Arc::as_ptr(outlet) as usize >> 6) % self.bulk.len()],
        };
        // A lane ends only after this end of its channel.
        let _ = lane.send(parcel);
    }
}

impl Drop for Outbox {
    fn drop(&mut self) {
        let (closed, _) = unbounded();
        self.urgent = closed;
        self.bulk.clear();
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

fn send_all(parcels: &Receiver<Parcel>, mut encoder: Encoder) {
    for parcel in parcels {
        let outlet = parcel.outlet.clone();
        // Nobody waits for what was taken before the other machine went.
        if outlet.is_wanted() {
            send(parcel, &mut encoder);
        }
        outlet.in_flight.fetch_sub(1, Relaxed);
    }
}

fn send(parcel: Parcel, encoder: &mut Encoder) {
    let Parcel {
        outlet,
        header,
        frame,
        payload,
    } = parcel;
    let raw_bytes = payload.len();
    let (coding, payload) = encoder.encode(outlet.compress, frame.as_ref(), payload);
    let link_bytes = payload.len();
    let envelope = Envelope::pack(&header, &[], raw_bytes, coding);
    let sent = outlet.publisher.put(payload).attachment(envelope).wait();
    let counts = &outlet.sent;
    match sent {
        Ok(()) => {
            counts.n.fetch_add(1, Relaxed);
            counts.raw_bytes.fetch_add(raw_bytes as u64, Relaxed);
            counts.link_bytes.fetch_add(link_bytes as u64, Relaxed);
        }
        Err(error) => {
            if counts.failed.fetch_add(1, Relaxed) == 0 {
                tracing::warn!(key = %outlet.publisher.key_expr(), %error, "the link takes no samples; further ones are only counted");
            }
        }
    }
}
