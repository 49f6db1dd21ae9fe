//! What crossed, topic by topic, for the log and for the last words.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;

use parking_lot::Mutex;

use crate::outbox::Sent;

/// Which way a topic crosses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Way {
    /// To other machines.
    Out,
    /// From another machine.
    In,
}

/// Counts of all topics; clones share them.
#[derive(Clone, Debug, Default)]
pub struct Counts(Arc<Mutex<BTreeMap<(Way, String), Row>>>);

/// Counts of one topic.
#[derive(Debug, Default)]
struct Row {
    /// What its sending ends so far have sent; a topic that came back has several.
    sent: Vec<Arc<Sent>>,
    received: Received,
    /// Samples lost before the link, by readers that were closed.
    lost_before: u64,
    /// And by the one that is open.
    lost: u64,
}

/// What was received of a topic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Received {
    /// Samples.
    pub n: u64,
    /// Bytes of their payloads on the bus.
    pub raw_bytes: u64,
    /// Bytes of their payloads on the link.
    pub link_bytes: u64,
    /// Samples that were dropped because newer ones came before they could be published.
    pub dropped: u64,
    /// Samples that could not be published.
    pub refused: u64,
}

/// Counts of one topic as they are now.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Line {
    /// Which way.
    pub way: Way,
    /// Name without the domain.
    pub topic: String,
    /// Samples that crossed.
    pub n: u64,
    /// Bytes of their payloads on the bus.
    pub raw_bytes: u64,
    /// Bytes of their payloads on the link.
    pub link_bytes: u64,
    /// Samples that newer ones took the place of.
    pub dropped: u64,
    /// Samples that the link or the bus did not take.
    pub failed: u64,
}

impl Counts {
    /// Adds what a sending end of a topic sends; the end itself closes with its topic.
    pub fn add(&self, topic: &str, way: Way, sent: Arc<Sent>) {
        let mut rows = self.0.lock();
        let row = rows.entry((way, topic.to_owned())).or_default();
        row.sent.push(sent);
    }

    /// Notes what the reader that is closed now had lost.
    pub fn lost(&self, topic: &str, lost: u64) {
        if let Some(row) = self.0.lock().get_mut(&(Way::Out, topic.to_owned())) {
            row.lost_before += lost;
            row.lost = 0;
        }
    }

    /// Notes what the open reader has lost so far.
    pub fn lost_so_far(&self, topic: &str, lost: u64) {
        if lost == 0 {
            return;
        }
        if let Some(row) = self.0.lock().get_mut(&(Way::Out, topic.to_owned())) {
            row.lost = lost;
        }
    }

    /// Changes what was received of a topic.
    pub fn receive(&self, topic: &str, change: impl FnOnce(&mut Received)) {
        let mut rows = self.0.lock();
        change(
            &mut rows
                .entry((Way::In, topic.to_owned()))
                .or_default()
                .received,
        );
    }

    /// All topics of which anything crossed or was lost.
    pub fn lines(&self) -> Vec<Line> {
        let rows = self.0.lock();
        let line = |((way, topic), row): (&(Way, String), &Row)| {
            let mut line = Line {
                way: *way,
                topic: topic.clone(),
                n: row.received.n,
                raw_bytes: row.received.raw_bytes,
                link_bytes: row.received.link_bytes,
                dropped: row.received.dropped + row.lost_before + row.lost,
                failed: row.received.refused,
            };
            for sent in &row.sent {
                line.n += sent.n.load(Relaxed);
                line.raw_bytes += sent.raw_bytes.load(Relaxed);
                line.link_bytes += sent.link_bytes.load(Relaxed);
                line.failed += sent.failed.load(Relaxed);
            }
            line
        };
        let lines = rows.iter().map(line);
        lines
            .filter(|line| line.n + line.dropped + line.failed > 0)
            .collect()
    }
}

impl std::fmt::Display for Line {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let verb = match self.way {
            Way::Out => "sent",
            Way::In => "received",
        };
        let mb = |bytes: u64| bytes as f64 / 1e6;
        write!(
            f,
            "{}: {verb} {}, {:.1} MB",
            self.topic,
            self.n,
            mb(self.raw_bytes)
        )?;
        if self.link_bytes < self.raw_bytes {
            write!(f, " as {:.1} MB", mb(self.link_bytes))?;
        }
        if self.dropped > 0 {
            write!(f, ", {} dropped for newer ones", self.dropped)?;
        }
        if self.failed > 0 {
            write!(f, ", {} failed", self.failed)?;
        }
        Ok(())
    }
}
