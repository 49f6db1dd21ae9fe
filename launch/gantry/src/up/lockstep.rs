//! What the launcher sees of lockstep: who takes part, and whether the first tick has begun.

use schema_bus::{DocumentReader, SnapshotReader, names};
use schema_frames::WorldInfo;

use crate::bus::Bus;

/// The daemon's state as far as processes that take part in lockstep wait for it. It is looked at
/// only until the first tick has begun and everybody has joined.
#[derive(Default)]
pub struct LockstepWatch {
    info: Option<DocumentReader>,
    snapshots: Option<SnapshotReader>,
    participants: Vec<String>,
    acknowledgers: Vec<String>,
    has_begun: bool,
}

impl LockstepWatch {
    /// Looks once. What cannot be read yet is read by a later look.
    pub fn look(&mut self, bus: &Bus) {
        self.info = self.info.take().or_else(|| bus.document(names::WORLD_INFO));
        let info = self
            .info
            .as_mut()
            .and_then(|reader| reader.latest().ok().flatten())
            .and_then(|document| document.json::<WorldInfo>().ok());
        if let Some(info) = info {
            self.participants = info.lockstep;
        }
        self.acknowledgers = bus.acknowledgers();
        if !self.has_begun {
            self.snapshots = self.snapshots.take().or_else(|| bus.snapshots());
            self.has_begun = self
                .snapshots
                .as_mut()
                .and_then(|reader| reader.latest().ok().flatten())
                .is_some_and(|snapshot| snapshot.header().tick > 0);
        }
        if self.has_begun {
            self.snapshots = None;
        }
    }

    /// Whether a process that lives takes part under this name. The daemon alone does not tell: it
    /// notices only when it waits for a participant that this has been killed.
    pub fn has(&self, name: &str) -> bool {
        let has = |names: &[String]| names.iter().any(|known| known == name);
        has(&self.participants) && has(&self.acknowledgers)
    }

    /// Names of all that take part.
    pub fn participants(&self) -> &[String] {
        &self.participants
    }

    /// Whether the first tick has begun, which nobody is awaited for any more.
    pub fn has_begun(&self) -> bool {
        self.has_begun
    }

    /// Gives its places among the readers back until the next look.
    pub fn rest(&mut self) {
        self.info = None;
    }

    /// Forgets a daemon that has ended.
    pub fn forget(&mut self) {
        *self = LockstepWatch::default();
    }
}
