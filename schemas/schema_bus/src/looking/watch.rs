//! The newest sample of every writer, without a reader: its header is read from the writer's
//! segment as from a file.
//!
//! A reader would start a sensor's rendering, take one of the places for readers, and cost the
//! writer time with every sample. Reading the segment's file costs none of that, and reading a part
//! that was never written takes no memory, as a mapping would. Where slots begin follows from
//! iceoryx2's numbers, and each is recognised by its writer's ids in it, so that another layout
//! would give no figures rather than wrong ones. A header may be read while it is being written;
//! its time of publishing is written last and is zero until then.

mod header;

use std::collections::HashMap;
use std::fs::File;
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};

use crate::looking::introspect::{Port, ServicePorts};
use crate::looking::slot::Slot;
use crate::memory::root::SHM;
use crate::memory::segment_files::segment_files;
use crate::place::node::BusNode;
pub use header::Newest;
use header::{Kind, n_elements, parse};

/// Part of a segment's file in which the first slot must begin, bytes.
const SEARCHED_BYTES: usize = 1 << 16;
/// Bytes between slots up to which a file is read in one piece.
const NEAR_BYTES: usize = 4096;
/// Slots of a writer that are looked at between looks at all of them: one being filled, and one
/// for each of several readers that hold samples.
const N_BUSY: usize = 4;

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
    /// Whether it is a part that was added when a sample did not fit into the slots before.
    grown: bool,
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
        let files = segment_files(Path::new(SHM), &self.prefix, &self.suffix);
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
    /// Opens the files that are new and forgets those that are gone. Where the slots of a grown
    /// part begin shows only once two of them are in use, so it is looked for anew.
    fn open(&mut self, paths: &[PathBuf], port: &Port) {
        let stays = |slots: &Slots| !slots.grown && paths.contains(&slots.path);
        self.files.retain(stays);
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
        let grown = is_grown(path);
        let (stride, n_slots) = match grown {
            false => (slot.stride(port.max_payload_bytes), port.n_slots),
            true => (grown_stride(&file, len, first, slot, &ids), usize::MAX),
        };
        Some(Slots {
            file,
            path: path.to_owned(),
            grown,
            first,
            stride,
            n_slots: n_slots.min((len - first) / stride.max(1)),
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

/// Bytes from one slot to the next in a grown part of a segment, whose slots begin at `first`:
/// iceoryx2 takes a power of two that holds the sample that did not fit before.
fn grown_stride(file: &File, len: usize, first: usize, slot: &Slot, ids: &[u8]) -> usize {
    let n_elements = read(file, first, slot.payload).and_then(|bytes| n_elements(&bytes));
    let payload = n_elements.unwrap_or(0).saturating_mul(slot.element as u64);
    let least = slot.stride(usize::try_from(payload).unwrap_or(0).min(len));
    let least = least.next_power_of_two();
    let begins_at = |at: usize| read(file, at, ids.len()).is_some_and(|bytes| bytes == ids);
    let mut strides = std::iter::successors(Some(least), |stride| stride.checked_mul(2));
    let fits = |stride: &usize| *stride < len - first;
    strides
        .find(|stride| !fits(stride) || begins_at(first + stride))
        .filter(fits)
        .unwrap_or(least)
}

/// Whether this is the second or a later part of a segment: `…__1.data`.
fn is_grown(path: &Path) -> bool {
    let stem = path
        .file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    let part = stem
        .rsplit_once("__")
        .and_then(|(_, part)| part.parse::<u32>().ok());
    part.is_some_and(|part| part > 0)
}

fn read(file: &File, at: usize, len: usize) -> Option<Vec<u8>> {
    let mut bytes = vec![0; len];
    file.read_exact_at(&mut bytes, at as u64).ok()?;
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_part_of_a_segment_has_not_grown() {
        let is = |name: &str| is_grown(Path::new(name));
        assert!(is("a_1__1.data") && is("a_1__12.data"));
        assert!(!is("a_1.data") && !is("a_1__0.data") && !is("a_1__mgmt.data"));
    }
}
