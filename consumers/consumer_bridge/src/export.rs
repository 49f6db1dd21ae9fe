//! From the bus to the link: finds this machine's topics, offers them, and sends those that another
//! machine wants.
//!
//! A topic is read only while somebody elsewhere reads it, so a camera that nobody looks at is not
//! rendered for the link either. Documents and the newest snapshot are kept for those who come later.

mod source;

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use consumer_kit::{FollowedDocument, WakeUps};
use schema_bus::qos::Qos;
use schema_bus::{Bus, Exchange, ServicePorts, TopicKind, names};
use schema_frames::{About, Modality, ResultType, SCHEMA_VERSION, SensorKind};
use zenoh::query::Queryable;
use zenoh::{Session, Wait as _};

use crate::announce::{Announcement, DOCUMENTS, Kind, Offer};
use crate::counts::{Counts, Way};
use crate::keys::Keys;
use crate::locked::lock;
use crate::lookout::{Left, View};
use crate::options::Options;
use crate::outbox::{Outbox, Outlet, Parcel};
use crate::wire::{Envelope, VERSION};
use source::{Source, Taken};

/// Longest wait for a sample.
const WAIT: Duration = Duration::from_millis(50);
/// Wait while a topic's outlet is full.
const WAIT_FULL: Duration = Duration::from_millis(2);

/// Names of topics that this bridge publishes here, which it must not send back.
pub type Imported = Arc<Mutex<BTreeSet<String>>>;

/// The newest document of each name and the newest snapshot, as envelope and payload.
type Latest = Arc<Mutex<HashMap<String, (Vec<u8>, Vec<u8>)>>>;

/// Offers this machine's topics and sends them.
#[derive(Debug)]
pub struct Exporter {
    // Ports go before their node.
    topics: BTreeMap<String, Exported>,
    wake_ups: WakeUps,
    bus: Bus,
    session: Session,
    keys: Keys,
    id: String,
    options: Options,
    outbox: Outbox,
    imported: Imported,
    counts: Counts,
    latest: Latest,
    announced: Arc<Mutex<Vec<u8>>>,
    /// Whether another machine began or ended to want a topic.
    woken: Arc<AtomicBool>,
    view: View,
    /// What was published here for others at the last look.
    was_imported: BTreeSet<String>,
    _answers: [Queryable<()>; 2],
}

/// One topic on offer.
#[derive(Debug)]
struct Exported {
    offer: Offer,
    outlet: Arc<Outlet>,
    source: Source,
    description: Option<FollowedDocument>,
    left: Left,
    refusal_said: bool,
}

impl Exporter {
    /// Joins the domain and begins to answer what other bridges ask.
    ///
    /// # Errors
    /// [`schema_bus::BusError`], and what zenoh says.
    pub fn open(
        session: &Session,
        keys: &Keys,
        options: &Options,
        view: View,
        imported: Imported,
        counts: Counts,
    ) -> anyhow::Result<Exporter> {
        let id = session.zid().to_string();
        let bus = Bus::open_with(&options.domain, "gantry-bridge", &options.bus)?;
        let (latest, announced) = (Latest::default(), Arc::new(Mutex::new(Vec::new())));
        let answers = [
            answer_announcement(session, &keys.topics(&id), announced.clone())?,
            answer_latest(session, keys, &id, latest.clone())?,
        ];
        Ok(Exporter {
            topics: BTreeMap::new(),
            wake_ups: WakeUps::new(),
            bus,
            session: session.clone(),
            keys: keys.clone(),
            id,
            options: options.clone(),
            outbox: Outbox::start()?,
            imported,
            counts,
            latest,
            announced,
            woken: Arc::new(AtomicBool::new(false)),
            view,
            was_imported: BTreeSet::new(),
            _answers: answers,
        })
    }

    /// One turn: looks at the topics if it is time, sends what waits, and waits for more, never
    /// longer than a twentieth of a second.
    ///
    /// # Errors
    /// What going on cannot heal.
    pub fn turn(&mut self) -> anyhow::Result<()> {
        let services = self.view.changed();
        if let Some(services) = &services {
            self.look(services)?;
        }
        if self.woken.swap(false, Relaxed) || services.is_some() {
            self.open_and_close()?;
        }
        let is_full = self.pass_on();
        self.wake_ups.wait(if is_full { WAIT_FULL } else { WAIT })?;
        Ok(())
    }

    /// Finds topics that came and went, and tells the others if anything changed.
    fn look(&mut self, services: &[ServicePorts]) -> anyhow::Result<()> {
        // A topic that is published here for another machine may have ended since the list was made.
        let now = lock(&self.imported).clone();
        let mut imported = std::mem::replace(&mut self.was_imported, now.clone());
        imported.extend(now);
        let mut here = BTreeSet::new();
        for service in services {
            let Some(offer) = offer_of(service) else {
                continue;
            };
            if imported.contains(&offer.name) || !self.options.has(&offer.name) {
                continue;
            }
            here.insert(offer.name.clone());
            let is_changed = self.topics.get(&offer.name).is_none_or(|known| {
                (known.offer.kind, &known.offer.result) != (offer.kind, &offer.result)
            });
            if is_changed {
                self.begin(offer)?;
            }
        }
        let mut ended = Vec::new();
        for (name, topic) in &mut self.topics {
            let is_here = here.contains(name);
            if topic.left.is_over(is_here) || !is_here && imported.contains(name) {
                ended.push(name.clone());
            }
        }
        for name in ended {
            self.topics.remove(&name);
            lock(&self.latest).remove(&name);
            self.woken.store(true, Relaxed);
        }
        self.describe();
        self.announce()
    }

    /// Offers one more topic.
    fn begin(&mut self, offer: Offer) -> anyhow::Result<()> {
        let woken = self.woken.clone();
        let outlet = Outlet::open(
            &self.session,
            self.keys.from(&self.id, &offer.name),
            self.options.compress.of(&offer.name),
            is_large(&offer),
            move || woken.store(true, Relaxed),
        )?;
        self.counts.add(&offer.name, Way::Out, outlet.sent.clone());
        let description = (offer.kind == Kind::Results)
            .then(|| FollowedDocument::optional(names::about(&offer.name)));
        tracing::debug!(topic = offer.name, "on offer");
        let exported = Exported {
            outlet,
            source: Source::Closed,
            description,
            left: Left::default(),
            refusal_said: false,
            offer,
        };
        self.topics.insert(exported.offer.name.clone(), exported);
        Ok(())
    }

    /// Reads the descriptions of results, which go into the announcement.
    fn describe(&mut self) {
        for topic in self.topics.values_mut() {
            let Some(description) = &mut topic.description else {
                continue;
            };
            match description.changed(&self.bus) {
                Ok(Some(document)) => match document.json::<About>() {
                    Ok(about) => topic.offer.about = about,
                    Err(error) => {
                        tracing::debug!(topic = topic.offer.name, %error, "cannot read the description");
                    }
                },
                Ok(None) => {}
                Err(error) => {
                    tracing::debug!(topic = topic.offer.name, %error, "cannot read the description");
                }
            }
        }
    }

    /// Tells the others what there is, if it changed.
    fn announce(&mut self) -> anyhow::Result<()> {
        let announcement = Announcement {
            v: VERSION,
            schema: SCHEMA_VERSION,
            host: crate::clock::host_name(),
            domain: self.options.domain.clone(),
            control: self.options.control,
            lockstep: self.options.lockstep,
            topics: self
                .topics
                .values()
                .map(|topic| topic.offer.clone())
                .collect(),
        };
        let text = serde_json::to_vec(&announcement)?;
        if *lock(&self.announced) == text {
            return Ok(());
        }
        *lock(&self.announced) = text.clone();
        self.session
            .put(self.keys.topics(&self.id), text)
            .wait()
            .map_err(|error| anyhow::anyhow!("cannot announce the topics: {error}"))
    }

    /// Begins to read what is wanted, and ends to read what no longer is.
    fn open_and_close(&mut self) -> anyhow::Result<()> {
        let mut is_changed = false;
        for topic in self.topics.values_mut() {
            // Documents are kept for those who come later.
            let is_wanted = topic.outlet.is_wanted() || topic.offer.kind == Kind::Document;
            if is_wanted == topic.source.is_open() {
                continue;
            }
            if !is_wanted {
                self.counts.lost(&topic.offer.name, topic.source.lost());
                topic.source = Source::Closed;
                is_changed = true;
                continue;
            }
            match Source::open(&self.bus, &topic.offer) {
                Ok(source) => {
                    is_changed |= source.is_open();
                    topic.source = source;
                }
                Err(error) => {
                    if !std::mem::replace(&mut topic.refusal_said, true) {
                        tracing::warn!(topic = topic.offer.name, %error, "another machine wants the topic, but it cannot be read; trying again");
                    }
                }
            }
        }
        if is_changed {
            self.listen()?;
        }
        Ok(())
    }

    /// Listens to the events of all topics that are read.
    fn listen(&mut self) -> anyhow::Result<()> {
        self.wake_ups = WakeUps::new();
        let is_read = |topic: &&Exported| topic.source.is_open();
        let read: Vec<&Offer> = self
            .topics
            .values()
            .filter(is_read)
            .map(|topic| &topic.offer)
            .collect();
        let frames: Vec<&str> = read
            .iter()
            .filter(|offer| offer.kind == Kind::Frames)
            .map(|offer| offer.name.as_str())
            .collect();
        for offer in read {
            match offer.kind {
                Kind::Frames => {
                    self.wake_ups
                        .attach(&self.bus, &offer.name, frames.iter().copied())?;
                }
                Kind::Results | Kind::Snapshot => {
                    self.wake_ups.listen(&self.bus, &offer.name)?;
                }
                // They change rarely, and nobody is woken for them.
                Kind::Document => {}
            }
        }
        Ok(())
    }

    /// Hands over what waits, snapshots first. Returns whether a topic's outlet is full.
    fn pass_on(&mut self) -> bool {
        let mut is_full = false;
        let (mut first, mut rest) = (Vec::new(), Vec::new());
        for topic in self.topics.values_mut() {
            match topic.offer.kind {
                Kind::Snapshot | Kind::Document => first.push(topic),
                Kind::Frames | Kind::Results => rest.push(topic),
            }
        }
        for topic in first.into_iter().chain(rest) {
            let is_kept = matches!(topic.offer.kind, Kind::Snapshot | Kind::Document);
            loop {
                if topic.outlet.is_full() {
                    is_full = true;
                    break;
                }
                match topic.source.take(&self.bus) {
                    Ok(Some(taken)) => {
                        if is_kept {
                            keep(&self.latest, &topic.offer.name, &taken);
                        }
                        if topic.outlet.is_wanted() {
                            let Taken {
                                header,
                                frame,
                                payload,
                            } = taken;
                            self.outbox.send(Parcel {
                                outlet: topic.outlet.clone(),
                                header,
                                frame,
                                payload,
                            });
                        }
                    }
                    Ok(None) => break,
                    Err(error) => {
                        if !std::mem::replace(&mut topic.refusal_said, true) {
                            tracing::warn!(topic = topic.offer.name, %error, "cannot pass on a sample; further ones are only counted");
                        }
                        break;
                    }
                }
            }
            self.counts
                .lost_so_far(&topic.offer.name, topic.source.lost());
        }
        is_full
    }
}

/// Keeps a document or a snapshot for those who come later.
fn keep(latest: &Latest, name: &str, taken: &Taken) {
    let envelope = Envelope::pack(
        &taken.header,
        &[],
        taken.payload.len(),
        crate::coding::Coding::None,
    );
    lock(latest).insert(name.to_owned(), (envelope, taken.payload.clone()));
}

/// Whether a topic's samples are as large as images.
fn is_large(offer: &Offer) -> bool {
    match offer.kind {
        Kind::Frames => offer
            .modality()
            .map(Modality::sensor_kind)
            .is_some_and(|kind| {
                matches!(
                    kind,
                    SensorKind::Camera | SensorKind::Lidar | SensorKind::Radar
                )
            }),
        Kind::Results => offer.result_type().is_some_and(ResultType::is_large),
        Kind::Snapshot | Kind::Document => false,
    }
}

/// What a service of this machine offers to others; `None` if nothing that crosses.
fn offer_of(service: &ServicePorts) -> Option<Offer> {
    if service.exchange != Exchange::Topic || service.schema != SCHEMA_VERSION.to_string() {
        return None;
    }
    let kind = match service.kind() {
        TopicKind::Frames => Kind::Frames,
        TopicKind::Results => Kind::Results,
        TopicKind::Snapshot => Kind::Snapshot,
        TopicKind::Document if DOCUMENTS.contains(&service.name.as_str()) => Kind::Document,
        TopicKind::Document | TopicKind::Controls | TopicKind::Other => return None,
    };
    // A sensor's writer may wait for its first reader; one that others still read has ended.
    let has_writer =
        !service.writers.is_empty() || (kind == Kind::Frames && service.readers.is_empty());
    let Qos {
        readers,
        buffer,
        borrowed,
        ..
    } = service.qos?;
    has_writer.then(|| Offer {
        name: service.name.clone(),
        kind,
        result: match kind {
            Kind::Results => service.result.clone(),
            _ => String::new(),
        },
        about: About::default(),
        readers,
        buffer,
        borrowed,
    })
}

fn answer_announcement(
    session: &Session,
    key: &str,
    announced: Arc<Mutex<Vec<u8>>>,
) -> anyhow::Result<Queryable<()>> {
    session
        .declare_queryable(key.to_owned())
        .callback(move |query| {
            let text = lock(&announced).clone();
            if !text.is_empty() {
                let _ = query.reply(query.key_expr().clone(), text).wait();
            }
        })
        .wait()
        .map_err(|error| anyhow::anyhow!("cannot answer other bridges: {error}"))
}

fn answer_latest(
    session: &Session,
    keys: &Keys,
    id: &str,
    latest: Latest,
) -> anyhow::Result<Queryable<()>> {
    let (keys, own) = (keys.clone(), id.to_owned());
    session
        .declare_queryable(keys.from(id, "**"))
        .callback(move |query| {
            let topic = keys.topic_of(&own, query.key_expr().as_str());
            let found = topic.and_then(|topic| lock(&latest).get(topic).cloned());
            if let Some((envelope, payload)) = found {
                let key = query.key_expr().clone();
                let _ = query.reply(key, payload).attachment(envelope).wait();
            }
        })
        .wait()
        .map_err(|error| anyhow::anyhow!("cannot answer other bridges: {error}"))
}
