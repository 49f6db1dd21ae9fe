//! A sample's header as it lies in a slot: whose it is, which number it has, when it was sent.

use schema_frames::control::{CONTROL_MAGIC, ControlHeader};
use schema_frames::document::DOCUMENT_MAGIC;
use schema_frames::header::FRAME_MAGIC;
use schema_frames::result::RESULT_MAGIC;
use schema_frames::snapshot::SNAPSHOT_MAGIC;
use schema_frames::{AckRecord, DocumentHeader, FrameHeader, ResultHeader, SnapshotHeader};

use crate::looking::introspect::ServicePorts;
use crate::looking::slot::Slot;
use crate::place::topics::TopicKind;
use crate::time::clock::mono_now;

/// Offset of the number of elements in iceoryx2's header, behind the ids of node and port.
const N_ELEMENTS_AT: usize = 32;
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

/// What a writer sends, as far as its headers are known here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Frames,
    Results,
    Snapshots,
    Documents,
    Controls,
    Acks,
}

impl Kind {
    pub(super) fn of(service: &ServicePorts) -> Option<Kind> {
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
pub(super) fn parse(kind: Kind, slot: &Slot, bytes: &[u8], port: u128) -> Option<Newest> {
    if bytes.get(16..32)? != port.to_le_bytes() {
        return None;
    }
    let sent_bytes = n_elements(bytes)?.saturating_mul(slot.element as u64);
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
    // A time that is yet to come would hide every true one.
    let now = mono_now().0;
    let is_sent = |sample: &Newest| {
        let at = sample.published_mono_nanos;
        at.is_none_or(|at| at != 0 && at <= now)
    };
    sample.filter(is_sent)
}

fn pod<T: bytemuck::AnyBitPattern>(bytes: &[u8]) -> Option<T> {
    bytemuck::try_pod_read_unaligned(bytes.get(..size_of::<T>())?).ok()
}

/// Number of elements in a slot's payload.
pub(super) fn n_elements(slot: &[u8]) -> Option<u64> {
    let bytes = slot.get(N_ELEMENTS_AT..N_ELEMENTS_AT + 8)?;
    Some(u64::from_le_bytes(bytes.try_into().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A slot with a frame of port 9 that claims to be sent at `at_nanos`.
    fn slot(at_nanos: u64) -> Vec<u8> {
        let mut header: FrameHeader = bytemuck::Zeroable::zeroed();
        header.magic = FRAME_MAGIC;
        header.seq = 3;
        header.published_mono_nanos = at_nanos;
        let mut bytes = vec![0; 64];
        bytes[16..32].copy_from_slice(&9u128.to_le_bytes());
        bytes.extend(bytemuck::bytes_of(&header));
        bytes.resize(64 + 256 + 1, 0);
        bytes
    }

    #[test]
    fn only_sent_samples_of_the_writer_count() {
        let of = Slot::from_parts([(48, 8), (256, 64), (1, 1)]);
        let seq = |bytes: &[u8], port| Some(parse(Kind::Frames, &of, bytes, port)?.seq);
        let now = mono_now().0;
        assert_eq!(seq(&slot(now), 9), Some(3));
        assert_eq!(seq(&slot(now), 8), None, "another port's");
        assert_eq!(seq(&slot(0), 9), None, "being filled");
        assert_eq!(seq(&slot(u64::MAX), 9), None, "a time that is yet to come");
        assert_eq!(parse(Kind::Results, &of, &slot(now), 9), None, "no magic");
        for len in 0..slot(now).len() - 1 {
            let _ = parse(Kind::Frames, &of, &slot(now)[..len], 9);
        }
    }
}
