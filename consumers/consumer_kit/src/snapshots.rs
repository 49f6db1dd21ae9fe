//! Pairs frames with the snapshot of their tick.
//!
//! Two services have no common order at a reader, but the snapshot of tick N is sent before any
//! frame of tick N. When a frame of tick N arrives, reading snapshots until one of tick ≥ N is
//! there is therefore enough. The last 32 are kept for frames that were in flight meanwhile.

use std::collections::VecDeque;
use std::sync::Arc;

use schema_bus::{Bus, BusError, Snapshot, SnapshotReader, names};
use schema_frames::{ActorRecord, SnapshotHeader};

use crate::followed::Search;

/// Number of snapshots kept: more ticks than any frame is in flight.
pub const KEPT_SNAPSHOTS: usize = 32;

/// The world after one tick, copied out of shared memory because a reader may hold only four
/// samples.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldAt {
    /// Tick, times, episode, epoch.
    pub header: SnapshotHeader,
    /// Actors by rising id.
    pub records: Vec<ActorRecord>,
}

impl WorldAt {
    /// The actor with this id.
    pub fn actor(&self, id: u32) -> Option<&ActorRecord> {
        self.records
            .binary_search_by_key(&id, |record| record.id)
            .ok()
            .map(|idx| &self.records[idx])
    }
}

/// Every snapshot of the world in order, followed across restarts of the simulator.
#[derive(Debug, Default)]
pub struct FollowedSnapshots {
    reader: Option<SnapshotReader>,
    pub(crate) search: Search,
    /// Epoch and tick of the last one.
    last: Option<(u64, u64)>,
    lost: u64,
}

impl FollowedSnapshots {
    /// Follows `world/snapshot`, which need not exist yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// The same, but nothing is logged while they are missing.
    pub fn optional() -> Self {
        FollowedSnapshots {
            search: Search::of_optional(),
            ..Self::default()
        }
    }

    /// Opens them if they exist; returns whether they are open. Looks at most five times a second.
    ///
    /// # Errors
    /// What waiting cannot heal, as [`crate::FollowedTopic::look`].
    pub fn look(&mut self, bus: &Bus) -> Result<bool, BusError> {
        if self.reader.is_none() {
            self.reader = self
                .search
                .open(bus, names::WORLD_SNAPSHOT, || bus.snapshot_reader())?;
        }
        Ok(self.reader.is_some())
    }

    /// Whether they were found.
    pub fn found(&self) -> bool {
        self.reader.is_some()
    }

    /// The next snapshot, if one waits.
    ///
    /// # Errors
    /// [`BusError::BadSample`] for one that breaks the contract, after which the next call goes on;
    /// [`BusError::BorrowLimit`], [`BusError::Service`].
    pub fn take(&mut self) -> Result<Option<Snapshot>, BusError> {
        let Some(reader) = &mut self.reader else {
            return Ok(None);
        };
        let taken = reader.next()?;
        if let Some(snapshot) = &taken {
            let header = snapshot.header();
            let n_lost = match self.last {
                Some((epoch, tick)) if epoch == header.epoch => {
                    header.tick.saturating_sub(tick).saturating_sub(1)
                }
                _ => 0,
            };
            // A recording that is replayed may say any tick.
            self.lost = self.lost.saturating_add(n_lost);
            self.last = Some((header.epoch, header.tick));
        }
        Ok(taken)
    }

    /// Ticks of a run whose snapshots were not seen between two that were.
    pub fn lost(&self) -> u64 {
        self.lost
    }
}

/// The last snapshots, read as they are needed.
#[derive(Debug, Default)]
pub struct SnapshotTrail {
    followed: FollowedSnapshots,
    kept: VecDeque<Arc<WorldAt>>,
    refusal_said: bool,
}

impl SnapshotTrail {
    /// An empty trail; `world/snapshot` need not exist yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// The world of exactly `tick`.
    ///
    /// # Errors
    /// What waiting cannot heal, as [`crate::FollowedTopic::look`].
    pub fn at(&mut self, bus: &Bus, tick: u64) -> Result<Option<Arc<WorldAt>>, BusError> {
        if self
            .kept
            .back()
            .is_none_or(|world| world.header.tick < tick)
        {
            self.drain(bus)?;
        }
        Ok(self
            .kept
            .iter()
            .rev()
            .find(|world| world.header.tick == tick)
            .cloned())
    }

    /// The newest world.
    ///
    /// # Errors
    /// As [`SnapshotTrail::at`].
    pub fn newest(&mut self, bus: &Bus) -> Result<Option<Arc<WorldAt>>, BusError> {
        self.drain(bus)?;
        Ok(self.kept.back().cloned())
    }

    fn drain(&mut self, bus: &Bus) -> Result<(), BusError> {
        self.followed.look(bus)?;
        loop {
            match self.followed.take() {
                Ok(Some(snapshot)) => {
                    let world = WorldAt {
                        header: *snapshot.header(),
                        records: snapshot.records().to_vec(),
                    };
                    keep(&mut self.kept, world);
                }
                Ok(None) => return Ok(()),
                Err(error @ BusError::BadSample { .. }) => {
                    if !std::mem::replace(&mut self.refusal_said, true) {
                        tracing::warn!(error = %error, "refused a snapshot; further ones are dropped silently");
                    }
                }
                Err(other) => return Err(other),
            }
        }
    }
}

/// Adds a world. The worlds of an earlier epoch are dropped, because ticks start again.
fn keep(kept: &mut VecDeque<Arc<WorldAt>>, world: WorldAt) {
    if kept
        .back()
        .is_some_and(|last| last.header.epoch != world.header.epoch)
    {
        kept.clear();
    }
    if kept.len() == KEPT_SNAPSHOTS {
        kept.pop_front();
    }
    kept.push_back(Arc::new(world));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn world(epoch: u64, tick: u64) -> WorldAt {
        WorldAt {
            header: SnapshotHeader {
                epoch,
                tick,
                ..bytemuck::Zeroable::zeroed()
            },
            records: Vec::new(),
        }
    }

    #[test]
    fn the_last_32_of_one_epoch_are_kept() {
        let mut kept = VecDeque::new();
        (1..=40).for_each(|tick| keep(&mut kept, world(1, tick)));
        assert_eq!((kept.len(), kept[0].header.tick), (32, 9));
        keep(&mut kept, world(2, 1));
        assert_eq!(kept.len(), 1);
    }
}
