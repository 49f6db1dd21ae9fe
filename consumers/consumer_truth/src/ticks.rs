//! A recording as one set of frames per tick: joins frames, snapshot and the list of actors.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use schema_frames::{ActorInfo, ActorList, ActorRecord, FrameHeader, Modality, SnapshotHeader};
use schema_recording::scenery::{SceneryBox, SceneryList};

/// Ticks that a frame may be late: a free-running simulator has at most four in flight.
pub const LATE_TICKS: u64 = 4;

/// Everything that was recorded of one tick.
#[derive(Clone, Debug, Default)]
pub struct TickSet {
    /// The tick.
    pub tick: u64,
    /// Its simulated time, nanoseconds since the daemon started.
    pub sim_nanos: u64,
    /// Number of the exported keyframe within the scenario, from 0; `None` if this tick is none.
    pub key: Option<u64>,
    /// The world after the tick; `None` if its snapshot was not recorded.
    pub world: Option<Arc<World>>,
    /// Frames of wanted topics, by topic.
    pub frames: Vec<TickFrame>,
}

/// One frame.
#[derive(Clone, Debug)]
pub struct TickFrame {
    /// Topic without the domain.
    pub topic: Arc<str>,
    /// What it shows.
    pub modality: Modality,
    /// Its header, checked against the payload.
    pub header: FrameHeader,
    /// Payload bytes in use, rows `row_stride` apart.
    pub payload: Vec<u8>,
}

/// The world after a tick.
#[derive(Clone, Debug)]
pub struct World {
    /// The snapshot's header.
    pub header: SnapshotHeader,
    /// Actors by rising id.
    pub records: Vec<ActorRecord>,
    /// What does not change from tick to tick about them.
    pub actors: Arc<Actors>,
    /// Objects of the map that are shown, by rising id. Ticks between which nothing changes share one
    /// list.
    pub scenery: Arc<[SceneryBox]>,
}

/// `world/actors` of one revision.
#[derive(Clone, Debug, Default)]
pub struct Actors {
    /// The document's revision.
    pub revision: u64,
    /// Actors by id.
    pub by_id: HashMap<u32, ActorInfo>,
}

impl World {
    /// An actor's record.
    pub fn record(&self, id: u32) -> Option<&ActorRecord> {
        let at = self.records.binary_search_by_key(&id, |record| record.id);
        at.ok().map(|at| &self.records[at])
    }
}

impl TickSet {
    /// The frame of a sensor and modality of the rig.
    pub fn frame(&self, sensor: &str, modality: Modality) -> Option<&TickFrame> {
        self.frames
            .iter()
            .find(|frame| frame.modality == modality && frame.sensor() == sensor)
    }
}

impl TickFrame {
    /// Second segment of the topic.
    pub fn sensor(&self) -> &str {
        self.topic.split('/').nth(1).unwrap_or_default()
    }

    /// The payload as tight little-endian elements of type `T`, which must have the encoding's
    /// size; elements that are not aligned in memory are copied.
    pub fn elements<T: bytemuck::AnyBitPattern>(&self) -> Vec<T> {
        assert_eq!(
            size_of::<T>(),
            self.modality.element_bytes(),
            "{}",
            self.topic
        );
        let row_bytes = self.header.width as usize * size_of::<T>();
        let rows = self.header.height as usize;
        let mut elements = Vec::with_capacity(self.header.width as usize * rows);
        for row in 0..rows {
            let at = row * self.header.row_stride as usize;
            let bytes = &self.payload[at..at + row_bytes];
            elements.extend(
                bytes
                    .chunks_exact(size_of::<T>())
                    .map(bytemuck::pod_read_unaligned::<T>),
            );
        }
        elements
    }
}

/// Collects what belongs to one tick, and hands ticks on in order once nothing of them can come any
/// more. At most [`LATE_TICKS`] + 1 ticks are held.
#[derive(Debug, Default)]
pub struct TickJoiner {
    open: BTreeMap<u64, TickSet>,
    lists: BTreeMap<u64, Arc<Actors>>,
    /// Objects of the map by the first tick at which they stand there.
    scenery: BTreeMap<u64, Arc<[SceneryBox]>>,
    newest: u64,
    /// Ticks up to this one were handed on.
    handed_on: Option<u64>,
    /// Frames and snapshots of ticks that had been handed on.
    pub n_late: u64,
}

impl TickJoiner {
    /// A `world/actors` document.
    ///
    /// # Errors
    /// A sentence if the text is not such a document.
    pub fn actors(&mut self, revision: u64, text: &str) -> anyhow::Result<()> {
        let list: ActorList = serde_json::from_str(text).map_err(|error| {
            anyhow::anyhow!("world/actors of revision {revision} is broken: {error}")
        })?;
        let by_id = list
            .actors
            .into_iter()
            .map(|actor| (actor.id, actor))
            .collect();
        self.lists
            .insert(revision, Arc::new(Actors { revision, by_id }));
        while self.lists.len() > 64 {
            self.lists.pop_first();
        }
        Ok(())
    }

    /// What stands on the map from a tick on.
    pub fn scenery(&mut self, list: SceneryList) {
        let mut objects = list.objects;
        objects.retain(|object| object.shown);
        objects.sort_by_key(|object| object.id);
        self.scenery.insert(list.tick, objects.into());
    }

    /// A snapshot.
    pub fn snapshot(&mut self, header: SnapshotHeader, records: Vec<ActorRecord>) {
        let Some(set) = self.set(header.tick, header.sim_nanos) else {
            return;
        };
        set.world = Some(Arc::new(World {
            header,
            records,
            actors: Arc::default(),
            scenery: Arc::default(),
        }));
    }

    /// A frame.
    pub fn frame(&mut self, frame: TickFrame) {
        let Some(set) = self.set(frame.header.tick, frame.header.sim_nanos) else {
            return;
        };
        set.frames.push(frame);
    }

    /// The next tick that is complete; `at_end`: nothing more comes.
    pub fn next(&mut self, at_end: bool) -> Option<TickSet> {
        let (&tick, _) = self.open.first_key_value()?;
        if !at_end && self.newest.saturating_sub(tick) <= LATE_TICKS {
            return None;
        }
        let mut set = self.open.remove(&tick)?;
        self.handed_on = Some(tick);
        set.frames.sort_by(|a, b| a.topic.cmp(&b.topic));
        set.frames.dedup_by(|a, b| a.topic == b.topic);
        if let Some(world) = set.world.take() {
            let revision = world.header.actors_revision;
            let list = self.lists.range(..=revision).next_back();
            let list = list.or_else(|| self.lists.first_key_value());
            let actors = list.map_or_else(Arc::default, |(_, list)| list.clone());
            let world = Arc::try_unwrap(world).unwrap_or_else(|shared| (*shared).clone());
            let stands = self.scenery.range(..=tick).next_back();
            let scenery = stands.map_or_else(Arc::default, |(_, objects)| objects.clone());
            set.world = Some(Arc::new(World {
                actors,
                scenery,
                ..world
            }));
        }
        Some(set)
    }

    fn set(&mut self, tick: u64, sim_nanos: u64) -> Option<&mut TickSet> {
        if self.handed_on.is_some_and(|done| tick <= done) {
            self.n_late += 1;
            return None;
        }
        self.newest = self.newest.max(tick);
        Some(self.open.entry(tick).or_insert_with(|| TickSet {
            tick,
            sim_nanos,
            ..TickSet::default()
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(topic: &str, tick: u64) -> TickFrame {
        let mut header = FrameHeader::new(Modality::Semantic);
        header.set_image(2, 2);
        header.tick = tick;
        TickFrame {
            topic: topic.into(),
            modality: Modality::Semantic,
            header,
            payload: vec![0; 4],
        }
    }

    #[test]
    fn frames_that_come_two_ticks_late_still_join_their_snapshot() {
        let mut joiner = TickJoiner::default();
        let mut out = Vec::new();
        for tick in 1..=20u64 {
            let mut header: SnapshotHeader = bytemuck::Zeroable::zeroed();
            (header.tick, header.sim_nanos) = (tick, tick * 50);
            joiner.snapshot(header, Vec::new());
            out.extend(std::iter::from_fn(|| joiner.next(false)));
            assert!(joiner.open.len() as u64 <= LATE_TICKS + 1);
            joiner.frame(frame("ego/a/semantic", tick));
            if tick > 2 {
                joiner.frame(frame("ego/b/semantic", tick - 2));
            }
        }
        out.extend(std::iter::from_fn(|| joiner.next(true)));
        assert_eq!(
            out.iter().map(|set| set.tick).collect::<Vec<_>>(),
            (1..=20).collect::<Vec<_>>()
        );
        assert!(out.iter().all(|set| set.world.is_some()));
        assert!(out[..18].iter().all(|set| set.frames.len() == 2));
        joiner.frame(frame("ego/b/semantic", 3));
        assert_eq!(joiner.n_late, 1);
    }

    #[test]
    fn objects_of_the_map_are_there_as_long_as_they_are_shown() {
        let list = |tick, shown: [bool; 2]| SceneryList {
            tick,
            complete: true,
            objects: [(7, 14, "parked_car_6"), (8, 6, "street_lamp_7")]
                .into_iter()
                .zip(shown)
                .map(|((idx, class, name), shown)| SceneryBox {
                    id: 1 << 31 | idx,
                    name: name.into(),
                    class,
                    box_pose: schema_types::Pose::default().into(),
                    box_half_m: [2.0, 1.0, 0.8],
                    shown,
                })
                .collect(),
        };
        let mut joiner = TickJoiner::default();
        let cars = |joiner: &mut TickJoiner, ticks: std::ops::Range<u64>| -> Vec<usize> {
            for tick in ticks {
                let mut header: SnapshotHeader = bytemuck::Zeroable::zeroed();
                header.tick = tick;
                joiner.snapshot(header, Vec::new());
            }
            let sets = std::iter::from_fn(|| joiner.next(true));
            let cars = |set: TickSet| {
                let world = set.world.expect("a snapshot");
                world.scenery.iter().filter(|it| it.class == 14).count()
            };
            sets.map(cars).collect()
        };
        // Recordings without lists have no objects of the map.
        assert_eq!(cars(&mut joiner, 1..3), [0, 0]);
        joiner.scenery(list(5, [true, true]));
        joiner.scenery(list(7, [false, true]));
        joiner.scenery(list(9, [true, false]));
        assert_eq!(cars(&mut joiner, 3..11), [0, 0, 1, 1, 0, 0, 1, 1]);
    }

    #[test]
    fn a_padded_row_is_read_by_its_stride() {
        let mut padded = frame("ego/a/semantic", 1);
        padded.header.row_stride = 3;
        padded.payload = vec![1, 2, 0, 3, 4];
        assert_eq!(padded.elements::<u8>(), [1, 2, 3, 4]);
    }
}
