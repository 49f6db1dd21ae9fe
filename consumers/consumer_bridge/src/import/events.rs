//! What zenoh's threads tell the one that publishes.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use parking_lot::Mutex;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait as _};

use crate::announce::Announcement;
use crate::import::inbox::Waker;
use crate::keys::Keys;

/// News that wait at a time; answers to our own requests are bounded where they are asked.
const MAX_NEWS: usize = 1024;
/// Longest announcement and longest reading of a clock that are taken, bytes.
const MAX_ANNOUNCEMENT_BYTES: usize = 16 << 20;
const MAX_CLOCK_BYTES: usize = 256;

/// What zenoh's threads tell.
#[derive(Debug)]
pub enum Event {
    /// A bridge came.
    Came(String),
    /// A bridge went, or the link to it.
    Went(String),
    /// A bridge said what it offers.
    Announced {
        /// The bridge.
        id: String,
        /// What it offers.
        announcement: Box<Announcement>,
        /// Length of what it sent.
        n_bytes: usize,
    },
    /// A bridge said what its clock reads.
    Clock {
        /// The bridge.
        id: String,
        /// What it said.
        answer: String,
        /// Our clock when it was asked, nanoseconds.
        asked_nanos: u64,
        /// Our clock when it had answered, nanoseconds.
        answered_nanos: u64,
    },
    /// The answer to the request of this number, or why there is none.
    Answer(u64, Result<Vec<u8>, NoAnswer>),
}

/// Why the other machine has not answered a request.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoAnswer {
    /// What it says itself.
    #[error("{0}")]
    Said(String),
    /// The request could not be sent.
    #[error("the link takes no request: {0}")]
    Link(String),
    /// Nothing came in time.
    #[error("the machine of the world did not answer; the link may be down")]
    Silence,
    /// What came is no answer.
    #[error("the answer of the other machine cannot be read ({0}); rebuild the older of the two")]
    Unreadable(String),
}

/// Complaints about other bridges that are logged; further ones are not.
const MAX_COMPLAINTS: usize = 100;

/// Events in the order in which they came.
#[derive(Debug)]
pub struct Events {
    queue: Mutex<Vec<Event>>,
    waker: Arc<Waker>,
    n_complaints: AtomicUsize,
}

impl Events {
    /// None yet.
    pub fn new(waker: &Arc<Waker>) -> Arc<Events> {
        Arc::new(Events {
            queue: Mutex::new(Vec::new()),
            waker: waker.clone(),
            n_complaints: AtomicUsize::new(0),
        })
    }

    /// Logs what is wrong with another bridge, unless too much was already.
    fn complain(&self, bridge: &str, what: &str) {
        let n = self.n_complaints.fetch_add(1, Ordering::Relaxed);
        if n < MAX_COMPLAINTS {
            tracing::warn!(bridge, "{what}");
        } else if n == MAX_COMPLAINTS {
            tracing::warn!("further complaints about other bridges are not logged");
        }
    }

    /// Adds one and wakes the other thread. News are dropped while too many wait: bridges announce
    /// and are asked again.
    pub fn push(&self, event: Event) {
        let mut queue = self.queue.lock();
        if queue.len() < MAX_NEWS || matches!(event, Event::Answer(..) | Event::Went(_)) {
            queue.push(event);
        }
        drop(queue);
        self.waker.wake();
    }

    /// Takes all.
    pub fn take(&self) -> Vec<Event> {
        std::mem::take(&mut *self.queue.lock())
    }
}

/// What keeps the news of other bridges coming.
#[derive(Debug)]
pub struct News {
    _bridges: zenoh::pubsub::Subscriber<()>,
    _announcements: zenoh::pubsub::Subscriber<()>,
}

impl News {
    /// Begins to hear which bridges there are, and what they announce.
    ///
    /// # Errors
    /// What zenoh says.
    pub fn subscribe(session: &Session, keys: &Keys, events: &Arc<Events>) -> anyhow::Result<News> {
        let failed =
            |error: zenoh::Error| anyhow::anyhow!("cannot look for other bridges: {error}");
        let own = session.zid().to_string();
        let (known, own_id, to) = (keys.clone(), own.clone(), events.clone());
        let bridges = session
            .liveliness()
            .declare_subscriber(keys.alive("*"))
            .history(true)
            .callback(move |sample| {
                let Some(id) = known.bridge_of(sample.key_expr().as_str()) else {
                    return;
                };
                if id != own_id {
                    to.push(match sample.kind() {
                        SampleKind::Put => Event::Came(id.to_owned()),
                        SampleKind::Delete => Event::Went(id.to_owned()),
                    });
                }
            })
            .wait()
            .map_err(failed)?;
        let (known, to) = (keys.clone(), events.clone());
        let announcements = session
            .declare_subscriber(keys.topics("*"))
            .callback(move |sample| {
                let id = known.bridge_of(sample.key_expr().as_str());
                if let Some(id) = id.filter(|id| *id != own) {
                    announced(&to, id, &sample);
                }
            })
            .wait()
            .map_err(failed)?;
        Ok(News {
            _bridges: bridges,
            _announcements: announcements,
        })
    }
}

fn announced(events: &Events, id: &str, sample: &Sample) {
    let n_bytes = sample.payload().len();
    if n_bytes > MAX_ANNOUNCEMENT_BYTES {
        let what =
            format!("its announcement has {n_bytes} bytes; {MAX_ANNOUNCEMENT_BYTES} are allowed");
        events.complain(id, &what);
        return;
    }
    match Announcement::parse(&sample.payload().to_bytes()) {
        Ok((announcement, refused)) => {
            if let Some(sentence) = refused {
                events.complain(id, &sentence);
            }
            events.push(Event::Announced {
                id: id.to_owned(),
                announcement: Box::new(announcement),
                n_bytes,
            });
        }
        Err(error) => events.complain(id, &format!("{error:#}")),
    }
}

/// Asks a bridge for its announcement.
pub fn ask_topics(session: &Session, keys: &Keys, id: &str, events: &Arc<Events>) {
    let (to, from) = (events.clone(), id.to_owned());
    let asked = session
        .get(keys.topics(id))
        .callback(move |reply| {
            if let Ok(sample) = reply.result() {
                announced(&to, &from, sample);
            }
        })
        .wait();
    if let Err(error) = asked {
        tracing::debug!(bridge = id, %error, "cannot ask for its topics");
    }
}

/// Asks a bridge for its clock.
pub fn ask_clock(session: &Session, keys: &Keys, id: &str, events: &Arc<Events>) {
    let (to, from) = (events.clone(), id.to_owned());
    let asked_nanos = schema_bus::mono_now().0;
    let asked = session
        .get(keys.to(id, "clock"))
        .consolidation(zenoh::query::ConsolidationMode::None)
        .callback(move |reply| {
            if let Ok(sample) = reply.result()
                && sample.payload().len() <= MAX_CLOCK_BYTES
            {
                to.push(Event::Clock {
                    id: from.clone(),
                    answer: String::from_utf8_lossy(&sample.payload().to_bytes()).into_owned(),
                    asked_nanos,
                    answered_nanos: schema_bus::mono_now().0,
                });
            }
        })
        .wait();
    if let Err(error) = asked {
        tracing::debug!(bridge = id, %error, "cannot ask for its clock");
    }
}
