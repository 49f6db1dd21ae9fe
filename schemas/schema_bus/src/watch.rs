//! The newest sample of every writer, without a reader: its header is read from the writer's
//! segment as from a file.
//!
//! A reader would start a sensor's rendering, take one of the places for readers, and cost the
//! writer time with every sample. Reading the segment's file costs none of that, and reading a part
//! that was never written takes no memory, as a mapping would. Where slots begin follows from
//! iceoryx2's numbers, and each is recognised by its writer's ids in it, so that another layout
//! would give no figures rather than wrong ones. A header may be read while it is being written;
//! its time of publishing is written last and is zero until then.

use std::collections::HashMap;
use std::fs::File;
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};

use schema_frames::control::{CONTROL_MAGIC, ControlHeader};
use schema_frames::document::DOCUMENT_MAGIC;
use schema_frames::header::FRAME_MAGIC;
use schema_frames::result::RESULT_MAGIC;
use schema_frames::snapshot::SNAPSHOT_MAGIC;
use schema_frames::{AckRecord, DocumentHeader, FrameHeader, ResultHeader, SnapshotHeader};

use crate::introspect::{Port, ServicePorts, Slot};
use crate::node::BusNode;
use crate::topics::TopicKind;

/// Where POSIX shared memory has its files.
const SHARED_MEMORY: &str = "/dev/shm";
/// Part of a segment's file in which the first slot must begin, bytes.
const SEARCHED_BYTES: usize = 1 << 16;
/// Offset of the number of elements in iceoryx2's header, behind the ids of node and port.
const N_ELEMENTS_AT: usize = 32;
/// Bytes between slots up to which a file is read in one piece.
const NEAR_BYTES: usize = 4096;
/// Slots of a writer that are looked at between looks at all of them: one being filled, and one
/// for each of several readers that hold samples.
const N_BUSY: usize = 4;

/// Header of the newest sample that a writer has sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Newest {
    /// Number of the sample: `seq` of frames, results and controls, the tick of snapshots and
    /// acknowledgements, a document's revision.
    pub seq: u64,
    /// Tick that it is about.
    pub tick: u64,
    /// Simulated time of that tick, nanoseconds; `None` if the header has none.
    pub sim_nanos: Option<u64>,
    /// `CLOCK_MONOTONIC` just before it was sent; `None` if the header has none.
    pub published_mono_nanos: Option<u64>,
    /// `CLOCK_MONOTONIC` at which the oldest frame behind a result was sent; `None` of all others.
    pub origin_mono_nanos: Option<u64>,
    /// Bytes of its payload that are in use.
    pub payload_bytes: u64,
    /// Random number of the writer's start; 0 if the header has none.
    pub epoch: u64,
}

/// Looks at the newest samples of writers. Made by [`crate::Bus::watch`]; told whom to watch by
/// [`Watch::follow`], which is called again about once a second because writers come and go. In
/// between [`Watch::look`] costs a few microseconds a writer.
///
/// A writer may take the slot of its last sample for its next one at once, and while it is being
/// filled there is nothing to see. Look every 10 ms or so, and few samples are missed.
#[derive(Debug)]
pub struct Watch {
    prefix: String,
    suffix: String,
    writers: HashMap<u128, Watched>,
}

/// One writer that is watched.
#[derive(Debug)]
struct Watched {
    kind: Kind,
    slot: Slot,
    files: Vec<Slots>,
    newest: Option<Newest>,
}

/// The slots in one file of a segment. An open file keeps the memory of a writer that has ended
/// until the next [`Watch::follow`].
#[derive(Debug)]
struct Slots {
    file: File,
    path: PathBuf,
    first: usize,
    stride: usize,
    n_slots: usize,
    /// Those that held the newest samples when all were looked at. iceoryx2 reuses the slot that
    /// came back last, so they stay the ones in use.
    busy: Vec<usize>,
}

impl Watch {
    pub(crate) fn new(node: &BusNode) -> Watch {
        let global = &node.config().global;
        Watch {
            prefix: global.prefix.to_string(),
            suffix: global.service.data_segment_suffix.to_string(),
            writers: HashMap::new(),
        }
    }

    /// Watches the writers of these services and no others, and looks at all that they have.
    pub fn follow(&mut self, services: &[ServicePorts]) {
        let files = segment_files(Path::new(SHARED_MEMORY), &self.prefix, &self.suffix);
        let mut before = std::mem::take(&mut self.writers);
        for service in services {
            let (Some(slot), Some(kind)) = (service.slot, Kind::of(service)) else {
                continue;
            };
            for port in &service.writers {
                let mut watched = before.remove(&port.id).unwrap_or(Watched {
                    kind,
                    slot,
                    files: Vec::new(),
                    newest: None,
                });
                let paths = files.get(&port.id).map(Vec::as_slice).unwrap_or_default();
                watched.open(paths, port);
                watched.look_at_all(port);
                self.writers.insert(port.id, watched);
            }
        }
    }

    /// Looks at the slots that are in use.
    pub fn look(&mut self) {
        for (id, writer) in &mut self.writers {
            writer.look_at_busy(*id);
        }
    }

    /// The newest sample of the writer whose port has this number; `None` if it sent none yet, is
    /// another user's, or sends something of unknown types.
    pub fn newest(&self, port: u128) -> Option<Newest> {
        self.writers.get(&port)?.newest
    }
}

impl Watched {
    /// Opens the files that are new and forgets those that are gone.
    fn open(&mut self, paths: &[PathBuf], port: &Port) {
        self.files.retain(|slots| paths.contains(&slots.path));
        for path in paths {
            if !self.files.iter().any(|slots| slots.path == *path) {
                self.files.extend(Slots::open(path, &self.slot, port));
            }
        }
    }

    fn look_at_all(&mut self, port: &Port) {
        let (kind, slot) = (self.kind, self.slot);
        for slots in &mut self.files {
            let mut found = slots.read_all(kind, &slot, port.id);
            found.sort_by_key(|(_, sample)| std::cmp::Reverse(age_order(sample)));
            slots.busy = found.iter().take(N_BUSY).map(|(i, _)| *i).collect();
            self.newest = newer(self.newest, found.first().map(|(_, sample)| *sample));
        }
    }

    fn look_at_busy(&mut self, port: u128) {
        let (kind, slot) = (self.kind, self.slot);
        for slots in &self.files {
            for i in &slots.busy {
                self.newest = newer(self.newest, slots.read_one(*i, kind, &slot, port));
            }
        }
    }
}

/// The newer of both.
fn newer(a: Option<Newest>, b: Option<Newest>) -> Option<Newest> {
    a.into_iter().chain(b).max_by_key(age_order)
}

/// Newer samples have the greater key.
fn age_order(sample: &Newest) -> (Option<u64>, u64) {
    (sample.published_mono_nanos, sample.seq)
}

/// Files of segments by the number of their port: `PREFIX…_NUMBER.data`, or `…_NUMBER__PART.data`
/// for one that has grown.
fn segment_files(folder: &Path, prefix: &str, suffix: &str) -> HashMap<u128, Vec<PathBuf>> {
    let mut files: HashMap<u128, Vec<PathBuf>> = HashMap::new();
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    for entry in entries {
        let name = entry.file_name().to_string_lossy().into_owned();
        let stem = name
            .strip_prefix(prefix)
            .and_then(|n| n.strip_suffix(suffix));
        if let Some(id) = stem.and_then(port_of_file) {
            files.entry(id).or_default().push(entry.path());
        }
    }
    files
}

fn port_of_file(stem: &str) -> Option<u128> {
    let whole = stem.split_once("__").map_or(stem, |(whole, _)| whole);
    whole.rsplit('_').next()?.parse().ok()
}

impl Slots {
    /// Finds the slots in a file; `None` if it is none of this writer's, or nothing was sent yet.
    fn open(path: &Path, slot: &Slot, port: &Port) -> Option<Slots> {
        let file = File::open(path).ok()?;
        let len = usize::try_from(file.metadata().ok()?.len()).ok()?;
        let begin = read(&file, 0, SEARCHED_BYTES.min(len))?;
        let mut ids = port.node.to_le_bytes().to_vec();
        ids.extend(port.id.to_le_bytes());
        let first = (0..begin.len().saturating_sub(ids.len()))
            .step_by(slot.align.max(8))
            .find(|at| begin[*at..].starts_with(&ids))?;
        let stride = stride(len - first, slot, port).max(1);
        Some(Slots {
            file,
            path: path.to_owned(),
            first,
            stride,
            n_slots: port.n_slots.min((len - first) / stride),
            busy: Vec::new(),
        })
    }

    /// The samples of all slots, with the number of their slot.
    fn read_all(&self, kind: Kind, slot: &Slot, port: u128) -> Vec<(usize, Newest)> {
        if self.stride > NEAR_BYTES {
            let one = |i| Some((i, self.read_one(i, kind, slot, port)?));
            return (0..self.n_slots).filter_map(one).collect();
        }
        let all = read(&self.file, self.first, self.n_slots * self.stride).unwrap_or_default();
        let one = |(i, bytes)| Some((i, parse(kind, slot, bytes, port)?));
        all.chunks(self.stride)
            .enumerate()
            .filter_map(one)
            .collect()
    }

    fn read_one(&self, i: usize, kind: Kind, slot: &Slot, port: u128) -> Option<Newest> {
        // The headers, and a whole record where there is none.
        let needed = (slot.payload + slot.element).min(self.stride);
        let bytes = read(&self.file, self.first + i * self.stride, needed)?;
        parse(kind, slot, &bytes, port)
    }
}

/// Bytes from one slot to the next in a file of which `len` bytes lie behind the first slot's
/// begin. A segment that grows has several files with slots of their own sizes, which all fill
/// their file but for a little bookkeeping.
fn stride(len: usize, slot: &Slot, port: &Port) -> usize {
    let told = slot.stride(port.max_payload_bytes);
    let fills = |stride: usize| {
        let slots = stride * port.n_slots;
        slots <= len && len - slots < SEARCHED_BYTES
    };
    if fills(told) {
        return told;
    }
    len / port.n_slots.max(1) / slot.align * slot.align
}

fn read(file: &File, at: usize, len: usize) -> Option<Vec<u8>> {
    let mut bytes = vec![0; len];
    file.read_exact_at(&mut bytes, at as u64).ok()?;
    Some(bytes)
}

/// What a writer sends, as far as its headers are known here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Frames,
    Results,
    Snapshots,
    Documents,
    Controls,
    Acks,
}

impl Kind {
    fn of(service: &ServicePorts) -> Option<Kind> {
        match service.kind() {
            TopicKind::Frames => Some(Kind::Frames),
            TopicKind::Results => Some(Kind::Results),
            TopicKind::Snapshot => Some(Kind::Snapshots),
            TopicKind::Document => Some(Kind::Documents),
            TopicKind::Controls => Some(Kind::Controls),
            TopicKind::Other => service.carries_acks().then_some(Kind::Acks),
        }
    }
}

/// The sample in a slot of which `bytes` are the beginning; `None` if it holds none of this port,
/// or one that has not been sent.
fn parse(kind: Kind, slot: &Slot, bytes: &[u8], port: u128) -> Option<Newest> {
    if bytes.get(16..32)? != port.to_le_bytes() {
        return None;
    }
    let n_elements = bytes.get(N_ELEMENTS_AT..N_ELEMENTS_AT + 8)?;
    let n_elements = u64::from_le_bytes(n_elements.try_into().ok()?);
    let sent_bytes = n_elements.saturating_mul(slot.element as u64);
    let (at, len) = slot.header;
    let header = bytes.get(at..at + len)?;
    let sample = match kind {
        Kind::Frames => pod::<FrameHeader>(header)
            .filter(|header| header.magic == FRAME_MAGIC)
            .map(|header| Newest {
                seq: header.seq,
                tick: header.tick,
                sim_nanos: Some(header.sim_nanos),
                published_mono_nanos: Some(header.published_mono_nanos),
                payload_bytes: header.payload_bytes,
                epoch: header.epoch,
                ..Newest::default()
            }),
        Kind::Results => pod::<ResultHeader>(header)
            .filter(|header| header.magic == RESULT_MAGIC)
            .map(|header| Newest {
                seq: header.seq,
                tick: header.tick,
                sim_nanos: Some(header.sim_nanos),
                published_mono_nanos: Some(header.published_mono_nanos),
                origin_mono_nanos: Some(header.origin_mono_nanos).filter(|nanos| *nanos != 0),
                payload_bytes: header.payload_bytes,
                epoch: header.writer_epoch,
            }),
        Kind::Snapshots => pod::<SnapshotHeader>(header)
            .filter(|header| header.magic == SNAPSHOT_MAGIC)
            .map(|header| Newest {
                seq: header.tick,
                tick: header.tick,
                sim_nanos: Some(header.sim_nanos),
                published_mono_nanos: Some(header.published_mono_nanos),
                payload_bytes: sent_bytes,
                epoch: header.epoch,
                ..Newest::default()
            }),
        Kind::Documents => pod::<DocumentHeader>(header)
            .filter(|header| header.magic == DOCUMENT_MAGIC)
            .map(|header| Newest {
                seq: header.revision,
                tick: header.tick,
                payload_bytes: header.payload_bytes,
                epoch: header.epoch,
                ..Newest::default()
            }),
        Kind::Controls => pod::<ControlHeader>(header)
            .filter(|header| header.magic == CONTROL_MAGIC)
            .map(|header| Newest {
                seq: header.seq,
                tick: header.tick,
                payload_bytes: sent_bytes,
                ..Newest::default()
            }),
        Kind::Acks => pod::<AckRecord>(bytes.get(slot.payload..)?).map(|record| Newest {
            seq: record.tick,
            tick: record.tick,
            payload_bytes: sent_bytes,
            epoch: record.epoch,
            ..Newest::default()
        }),
    };
    sample.filter(|sample| sample.published_mono_nanos != Some(0))
}

fn pod<T: bytemuck::AnyBitPattern>(bytes: &[u8]) -> Option<T> {
    bytemuck::try_pod_read_unaligned(bytes.get(..size_of::<T>())?).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_a_segment_tells_its_port() {
        assert_eq!(
            port_of_file("0354a2_1109194381732146492770300737224"),
            Some(1_109_194_381_732_146_492_770_300_737_224)
        );
        assert_eq!(port_of_file("0354a2_26937__0"), Some(26_937));
        assert_eq!(port_of_file("0354a2_26937__mgmt"), Some(26_937));
        assert_eq!(port_of_file("node.0_10_0"), Some(0));
        assert_eq!(port_of_file("nonsense"), None);
    }

    #[test]
    fn slots_of_a_segment_that_grew_fill_its_file() {
        let slot = Slot {
            header: (64, 64),
            payload: 128,
            element: 1,
            align: 64,
        };
        let port = Port {
            pid: None,
            program: String::new(),
            name: String::new(),
            max_payload_bytes: 16_384,
            id: 1,
            node: 2,
            n_slots: 67,
        };
        let told = slot.stride(16_384);
        assert_eq!(stride(told * 67 + 300, &slot, &port), told);
        let larger = slot.stride(65_536);
        assert_eq!(stride(larger * 67 + 300, &slot, &port), larger);
    }
}
