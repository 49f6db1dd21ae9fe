//! One topic of another machine that is published here.

use std::sync::Arc;
use std::time::{Duration, Instant};

use schema_bus::{Bus, ServicePorts};
use zenoh::pubsub::Subscriber;
use zenoh::{Session, Wait as _};

use crate::announce::{Kind, Offer};
use crate::clock::Clock;
use crate::counts::Counts;
use crate::import::inbox::{Arrived, Inbox, Waker};
use crate::import::ports::{FramePort, ResultPort};
use crate::import::world::MirroredWorld;

/// How long a topic without readers is still asked for: a viewer that starts anew is back by then.
const LINGER: Duration = Duration::from_secs(2);
/// How long a frame waits for the snapshot of its tick, which was sent before it.
const SNAPSHOT_WAIT: Duration = Duration::from_millis(200);
/// Samples beyond what waits on the bus that may wait here.
const MORE_WAITING: usize = 2;

/// One topic of another machine.
#[derive(Debug)]
pub struct Topic {
    // The subscriber goes before what it fills.
    subscriber: Option<Subscriber<()>>,
    port: Port,
    inbox: Arc<Inbox>,
    offer: Offer,
    peer: String,
    /// Since when nobody reads it here.
    unread_since: Option<Instant>,
    refusal_said: bool,
}

#[derive(Debug)]
enum Port {
    Frames(Box<FramePort>),
    Results(ResultPort),
}

/// What publishing needs to know.
#[derive(Clone, Copy, Debug)]
pub struct Context<'a> {
    /// The bus here.
    pub bus: &'a Bus,
    /// The other machine's clock.
    pub clock: &'a Clock,
    /// The other machine's world, if it appears here.
    pub world: Option<&'a MirroredWorld>,
    /// Where to count.
    pub counts: &'a Counts,
}

impl Topic {
    /// Makes the topic here.
    ///
    /// # Errors
    /// [`schema_bus::BusError`].
    pub fn open(bus: &Bus, offer: &Offer, peer: &str, waker: &Arc<Waker>) -> anyhow::Result<Topic> {
        let port = match offer.kind {
            Kind::Results => Port::Results(ResultPort::open(bus, offer)?),
            _ => Port::Frames(Box::new(FramePort::open(bus, offer)?)),
        };
        Ok(Topic {
            subscriber: None,
            port,
            inbox: Inbox::new(offer.buffer + MORE_WAITING, waker),
            offer: offer.clone(),
            peer: peer.to_owned(),
            unread_since: None,
            refusal_said: false,
        })
    }

    /// The bridge that offers it.
    pub fn peer(&self) -> &str {
        &self.peer
    }

    /// Whether it is still what is offered, but for its description.
    pub fn is_of(&self, offer: &Offer) -> bool {
        let about = self.offer.about.clone();
        self.offer
            == Offer {
                about,
                ..offer.clone()
            }
    }

    /// Takes over the description that is offered now, if it is another one.
    ///
    /// # Errors
    /// [`schema_bus::BusError`]; it is tried again then.
    pub fn describe(&mut self, bus: &Bus, offer: &Offer) -> anyhow::Result<()> {
        if self.offer.about == offer.about {
            return Ok(());
        }
        if let Port::Results(port) = &self.port {
            port.describe(bus, &offer.about)?;
        }
        self.offer.about = offer.about.clone();
        Ok(())
    }

    /// Begins or ends to ask for the topic, as it is read here or not.
    ///
    /// # Errors
    /// What zenoh says.
    pub fn look(&mut self, bus: &Bus, session: &Session, key: String) -> anyhow::Result<()> {
        let n_readers = match &self.port {
            Port::Frames(port) => port.n_readers(),
            Port::Results(port) => {
                port.greet();
                port.n_readers()
            }
        };
        let now = Instant::now();
        if n_readers > 0 {
            self.unread_since = None;
            if self.subscriber.is_none() {
                let to = self.inbox.clone();
                let subscriber = session
                    .declare_subscriber(key)
                    .callback(move |sample| to.push(sample))
                    .wait()
                    .map_err(|error| anyhow::anyhow!("cannot ask for the topic: {error}"))?;
                self.subscriber = Some(subscriber);
            }
        } else if self.subscriber.is_some() && now - *self.unread_since.get_or_insert(now) > LINGER
        {
            self.subscriber = None;
            while self.inbox.pop().is_some() {}
            if let Port::Frames(port) = &mut self.port {
                port.rest(bus)?;
            }
        }
        Ok(())
    }

    /// Publishes what has arrived. Returns whether a frame was sent.
    pub fn publish(&mut self, name: &str, context: &Context<'_>) -> bool {
        let mut is_sent = false;
        loop {
            let arrived = match &self.port {
                Port::Frames(port) => self
                    .inbox
                    .pop_if(|arrived| is_due(port, arrived, context.world)),
                Port::Results(_) => self.inbox.pop(),
            };
            let Some(arrived) = arrived else { break };
            let published = match &mut self.port {
                Port::Frames(port) => port
                    .header(&arrived)
                    .and_then(|header| port.publish(context.bus, header, &arrived, context.clock)),
                Port::Results(port) => port.publish(&arrived, context.clock),
            };
            count(context.counts, name, &arrived, &published);
            match published {
                Ok(()) => is_sent |= matches!(self.port, Port::Frames(_)),
                Err(error) => {
                    if !std::mem::replace(&mut self.refusal_said, true) {
                        tracing::warn!(
                            topic = name,
                            "cannot publish what came from the other machine: {error:#}; further ones are only counted"
                        );
                    }
                }
            }
        }
        count_inbox(context.counts, name, &self.inbox);
        is_sent
    }
}

/// Whether a frame may be published: the snapshot of its tick was, or is not to be waited for.
fn is_due(port: &FramePort, arrived: &Arrived, world: Option<&MirroredWorld>) -> bool {
    let Some(world) = world else { return true };
    let Ok(header) = port.header(arrived) else {
        return true;
    };
    world.has_reached(header.epoch, header.tick) || arrived.at.elapsed() > SNAPSHOT_WAIT
}

/// Counts a sample that was published or refused.
pub fn count(counts: &Counts, name: &str, arrived: &Arrived, published: &anyhow::Result<()>) {
    counts.receive(name, |received| match published {
        Ok(()) => {
            received.n += 1;
            received.raw_bytes += arrived.envelope.raw_bytes as u64;
            received.link_bytes += arrived.payload.len() as u64;
        }
        Err(_) => received.refused += 1,
    });
}

/// Counts samples that the inbox dropped or refused.
pub fn count_inbox(counts: &Counts, name: &str, inbox: &Inbox) {
    let (dropped, refused) = inbox.take_counts();
    if dropped + refused > 0 {
        counts.receive(name, |received| {
            received.dropped += dropped;
            received.refused += refused;
        });
    }
}

/// Why a topic cannot be published here; `None` if it can.
pub fn conflict(offer: &Offer, services: &[ServicePorts], has_simulator: bool) -> Option<String> {
    let own = std::process::id();
    let here = services
        .iter()
        .find(|service| service.name == offer.name && service.qos.is_some())?;
    let writer = here
        .writers
        .iter()
        .find(|writer| writer.pid.is_some_and(|pid| pid != own));
    if let Some(writer) = writer {
        return Some(format!(
            "{} (process {}) publishes a topic of this name",
            writer.program,
            writer.pid.unwrap_or_default()
        ));
    }
    let is_sensor = offer.kind == Kind::Frames && has_simulator && here.writers.is_empty();
    is_sensor.then(|| "a sensor of this machine's simulator has this name".to_owned())
}
