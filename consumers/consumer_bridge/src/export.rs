//! From the bus to the link: finds this machine's topics, offers them, and sends those that another
//! machine wants.
//!
//! A topic is read only while somebody elsewhere reads it, so a camera that nobody looks at is not
//! rendered for the link either. Documents and the newest snapshot are kept for those who come
//! later.

mod source;

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Duration;

use consumer_kit::{Change, Domain, ListedTopic, Listing, Take, TopicId, Wish};
use parking_lot::Mutex;
use schema_bus::qos::Qos;
use schema_bus::{TopicDetails, TopicKind};
use schema_frames::{About, Modality, ResultType, SCHEMA_VERSION, SensorKind};
use zenoh::query::Queryable;
use zenoh::{Session, Wait as _};

use crate::announce::{Announcement, DOCUMENTS, Kind, Offer};
use crate::counts::{Counts, Way};
use crate::keys::Keys;
use crate::lookout;
use crate::options::Options;
use crate::outbox::{Class, Outbox, Outlet, Parcel};
use crate::wire::{Envelope, VERSION};
use source::{Taken, take};

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
    domain: Domain,
    topics: BTreeMap<String, Exported>,
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
    /// What was published here for others at the last look.
    was_imported: BTreeSet<String>,
    _answers: [Queryable<()>; 2],
}

/// One topic on offer.
#[derive(Debug)]
struct Exported {
    id: TopicId,
    offer: Offer,
    outlet: Arc<Outlet>,
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
        listing: Listing,
        imported: Imported,
        counts: Counts,
    ) -> anyhow::Result<Exporter> {
        let id = session.zid().to_string();
        let domain = lookout::join(options, listing)?;
        let (latest, announced) = (Latest::default(), Arc::new(Mutex::new(Vec::new())));
        let answers = [
            answer_announcement(session, &keys.topics(&id), announced.clone())?,
            answer_latest(session, keys, &id, latest.clone())?,
        ];
        Ok(Exporter {
            domain,
            topics: BTreeMap::new(),
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
        let is_new = self.look();
        self.take_over()?;
        if is_new {
            self.describe();
            self.announce()?;
        }
        if self.woken.swap(false, Relaxed) || is_new {
            self.open_and_close()?;
        }
        let is_full = self.pass_on();
        self.domain.wait(if is_full { WAIT_FULL } else { WAIT })?;
        Ok(())
    }

    /// Goes through the newest list of topics, if there is one that was not seen.
    fn look(&mut self) -> bool {
        // A topic that is published here for another machine may have ended since the list was
        // made.
        let now = self.imported.lock();
        let (options, before) = (&self.options, &self.was_imported);
        let is_new = lookout::look(&mut self.domain, |listed| {
            let name = &listed.details.name;
            let is_imported = now.contains(name) || before.contains(name);
            let is_here = is_offered(listed) && !is_imported && options.has(name);
            is_here.then(|| Wish::on_demand(Take::All).quietly())
        });
        if is_new {
            self.was_imported = now.clone();
        }
        is_new
    }

    /// Begins and ends to offer topics as they came and went.
    fn take_over(&mut self) -> anyhow::Result<()> {
        while let Some(change) = self.domain.change() {
            match change {
                Change::Found { id, details } => {
                    if let Some(offer) = offer_of(&details) {
                        self.begin(id, offer)?;
                    }
                }
                Change::Refused { id, error } => {
                    let topic = self.topics.values_mut().find(|topic| topic.id == id);
                    if let Some(topic) = topic
                        && !std::mem::replace(&mut topic.refusal_said, true)
                    {
                        tracing::warn!(topic = topic.offer.name, %error, "another machine wants the topic, but it cannot be read; trying again");
                    }
                }
                Change::Ended(id) => {
                    if let Some(report) = self.domain.leave(id) {
                        self.topics.remove(&report.topic);
                        self.latest.lock().remove(&report.topic);
                    }
                }
                Change::Full(_) | Change::Silent(_) | Change::Unlisted(_) => {}
            }
        }
        Ok(())
    }

    /// Offers one more topic.
    fn begin(&mut self, id: TopicId, offer: Offer) -> anyhow::Result<()> {
        let woken = self.woken.clone();
        let outlet = Outlet::open(
            &self.session,
            self.keys.from(&self.id, &offer.name),
            self.options.compress.of(&offer.name),
            class_of(&offer),
            move || woken.store(true, Relaxed),
        )?;
        self.counts.add(&offer.name, Way::Out, outlet.sent.clone());
        tracing::debug!(topic = offer.name, "on offer");
        let exported = Exported {
            id,
            outlet,
            refusal_said: false,
            offer,
        };
        self.topics.insert(exported.offer.name.clone(), exported);
        Ok(())
    }

    /// Reads the descriptions of results, which go into the announcement.
    fn describe(&mut self) {
        for topic in self.topics.values_mut() {
            if let Some(about) = self.domain.describe(topic.id) {
                topic.offer.about = about.clone();
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
        if *self.announced.lock() == text {
            return Ok(());
        }
        *self.announced.lock() = text.clone();
        self.session
            .put(self.keys.topics(&self.id), text)
            .wait()
            .map_err(|error| anyhow::anyhow!("cannot announce the topics: {error}"))
    }

    /// Begins to read what is wanted, and ends to read what no longer is.
    fn open_and_close(&mut self) -> anyhow::Result<()> {
        for topic in self.topics.values() {
            if let Some(report) = self.domain.want(topic.id, topic.outlet.is_wanted()) {
                self.counts.lost(&topic.offer.name, report.counts.lost);
            }
        }
        self.domain.open()?;
        self.take_over()
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
                match take(&mut self.domain, topic.id, topic.offer.kind) {
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
            let lost = self.domain.counts(topic.id).lost;
            self.counts.lost_so_far(&topic.offer.name, lost);
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
    latest
        .lock()
        .insert(name.to_owned(), (envelope, taken.payload.clone()));
}

/// How a topic's samples are sent.
fn class_of(offer: &Offer) -> Class {
    let is_large = match offer.kind {
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
        Kind::Snapshot => false,
        Kind::Document => return Class::Document,
    };
    match is_large {
        true => Class::Large,
        false => Class::Small,
    }
}

/// Whether a listed topic crosses. A sensor's writer may wait for its first reader; one that others
/// still read has ended.
fn is_offered(listed: ListedTopic<'_>) -> bool {
    let topic = listed.details;
    let has_writer =
        topic.publishers > 0 || (topic.kind == TopicKind::Frames && topic.subscribers == 0);
    (listed.is_known || has_writer) && kind_of(topic).is_some()
}

/// What a topic of this machine is to others; `None` if it does not cross.
fn kind_of(topic: &TopicDetails) -> Option<Kind> {
    match topic.kind {
        _ if topic.schema != SCHEMA_VERSION.to_string() => None,
        TopicKind::Frames => Some(Kind::Frames),
        TopicKind::Results => Some(Kind::Results),
        TopicKind::Snapshot => Some(Kind::Snapshot),
        TopicKind::Document if DOCUMENTS.contains(&topic.name.as_str()) => Some(Kind::Document),
        TopicKind::Document | TopicKind::Controls | TopicKind::Other => None,
    }
}

fn offer_of(topic: &TopicDetails) -> Option<Offer> {
    let kind = kind_of(topic)?;
    let Qos {
        readers,
        buffer,
        borrowed,
        ..
    } = topic.qos;
    let result = topic.result.map(ResultType::name).unwrap_or_default();
    Some(Offer {
        name: topic.name.clone(),
        kind,
        result: result.to_owned(),
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
            let text = announced.lock().clone();
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
            let found = topic.and_then(|topic| latest.lock().get(topic).cloned());
            if let Some((envelope, payload)) = found {
                let key = query.key_expr().clone();
                let _ = query.reply(key, payload).attachment(envelope).wait();
            }
        })
        .wait()
        .map_err(|error| anyhow::anyhow!("cannot answer other bridges: {error}"))
}
