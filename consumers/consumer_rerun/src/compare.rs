//! Where two frames or two snapshots differ.

use schema_frames::header::HASHED_HEADER_BYTES;
use schema_frames::journal::FIRST_ADDED_ID;
use schema_frames::{ActorRecord, FrameHeader, Modality, SnapshotHeader};
use serde::Serialize;

use crate::fields;

/// Bytes of a snapshot's header that take part.
const SNAPSHOT_HEADER_BYTES: usize = std::mem::offset_of!(SnapshotHeader, epoch);

/// Where two samples differ.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// The place: a field of the header, a pixel, a field of an element.
    pub place: String,
    /// What the recording has there.
    pub recorded: String,
    /// What the new run has there.
    pub now: String,
}

impl Difference {
    /// A difference.
    pub fn new(
        place: impl Into<String>,
        recorded: impl Into<String>,
        now: impl Into<String>,
    ) -> Self {
        Difference {
            place: place.into(),
            recorded: recorded.into(),
            now: now.into(),
        }
    }

    fn of_header(name: &str, before: &[u8], now: &[u8]) -> Option<Difference> {
        let layout = fields::layout(name)?;
        let (field, before, now) = fields::first_difference(&layout, before, now)?;
        Some(Difference::new(format!("header.{field}"), before, now))
    }
}

/// A sample of one of the two runs.
#[derive(Clone, Copy, Debug)]
pub struct Sample<'a, Header, Element> {
    /// Its header.
    pub header: &'a Header,
    /// Bytes of a frame's payload, or records of a snapshot.
    pub content: &'a [Element],
}

/// A frame of one of the two runs.
pub type Frame<'a> = Sample<'a, FrameHeader, u8>;
/// A snapshot of one of the two runs.
pub type Snapshot<'a> = Sample<'a, SnapshotHeader, ActorRecord>;

/// The first difference between a recorded frame and one of the new run.
pub fn frames(before: Frame<'_>, now: Frame<'_>) -> Option<Difference> {
    let n_bytes = HASHED_HEADER_BYTES;
    let (a, b) = (
        bytemuck::bytes_of(before.header),
        bytemuck::bytes_of(now.header),
    );
    if a[..n_bytes] != b[..n_bytes] {
        return Difference::of_header("FrameHeader", &a[..n_bytes], &b[..n_bytes]);
    }
    if before.content == now.content {
        return None;
    }
    let at = before
        .content
        .iter()
        .zip(now.content)
        .position(|(a, b)| a != b);
    let Some(at) = at else {
        let bytes = |payload: &[u8]| format!("{} bytes", payload.len());
        return Some(Difference::new(
            "payload",
            bytes(before.content),
            bytes(now.content),
        ));
    };
    Some(in_payload(before.header, before.content, now.content, at))
}

/// A difference at byte `at` of two payloads of equal headers.
fn in_payload(header: &FrameHeader, before: &[u8], now: &[u8], at: usize) -> Difference {
    let size = (header.element_bytes as usize).max(1);
    let modality = header.modality();
    if let Some(layout) = modality
        .and_then(fields::element_of)
        .and_then(fields::layout)
    {
        let idx = at / size;
        let range = idx * size..(idx + 1) * size;
        let both = before.get(range.clone()).zip(now.get(range));
        if let Some((field, a, b)) = both.and_then(|(a, b)| fields::first_difference(&layout, a, b))
        {
            return Difference::new(format!("element {idx}, {field}"), a, b);
        }
    }
    let stride = (header.row_stride as usize).max(1);
    let (row, column) = (at / stride, at % stride / size);
    let start = row * stride + column * size;
    let kind = match modality {
        Some(Modality::Depth | Modality::Flow) => "f32",
        Some(Modality::Instance) => "u32",
        Some(Modality::Normals) => "u16",
        _ => "u8",
    };
    let text = |payload: &[u8]| {
        let end = payload.len().min(start + size);
        fields::numbers(kind, &payload[start.min(end)..end])
    };
    Difference::new(format!("pixel ({column}, {row})"), text(before), text(now))
}

/// The first difference between a recorded snapshot and one of the new run. Sensors that were added
/// now are left out.
pub fn snapshots(before: Snapshot<'_>, now: Snapshot<'_>, has_added: bool) -> Option<Difference> {
    let last = before.content.last().map_or(0, |record| record.id);
    let is_new = |record: &ActorRecord| record.id >= FIRST_ADDED_ID && record.id > last;
    let n_own = match has_added {
        true => now.content.partition_point(|record| !is_new(record)),
        false => now.content.len(),
    };
    let header = SnapshotHeader {
        n_actors: n_own as u32,
        ..*now.header
    };
    let records = &now.content[..n_own];
    let actors = actors(before.content, records);
    let n_bytes = SNAPSHOT_HEADER_BYTES;
    let (a, b) = (
        bytemuck::bytes_of(before.header),
        bytemuck::bytes_of(&header),
    );
    // An actor that moved otherwise says more than what counts them.
    actors.or_else(|| Difference::of_header("SnapshotHeader", &a[..n_bytes], &b[..n_bytes]))
}

fn actors(before: &[ActorRecord], now: &[ActorRecord]) -> Option<Difference> {
    for (a, b) in before.iter().zip(now) {
        if a.id != b.id {
            let id = |record: &ActorRecord| format!("actor {}", record.id);
            return Some(Difference::new("actors", id(a), id(b)));
        }
        let (left, right) = (bytemuck::bytes_of(a), bytemuck::bytes_of(b));
        if left == right {
            continue;
        }
        let layout = fields::layout("ActorRecord")?;
        let (mut field, mut x, mut y) = fields::first_difference(&layout, left, right)?;
        if field == "part"
            && let Some(layout) = fields::part_of(a.kind).and_then(fields::layout)
            && let Some(inner) = fields::first_difference(&layout, &a.part, &b.part)
        {
            (field, x, y) = inner;
        }
        return Some(Difference::new(format!("actor {}, {field}", a.id), x, y));
    }
    let n = |records: &[ActorRecord]| format!("{} actors", records.len());
    (before.len() != now.len()).then(|| Difference::new("actors", n(before), n(now)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn of<'a, H, E>(header: &'a H, content: &'a [E]) -> Sample<'a, H, E> {
        Sample { header, content }
    }

    fn image() -> (FrameHeader, Vec<u8>) {
        let mut header = FrameHeader::new(Modality::Rgb);
        header.set_image(4, 3);
        (header, vec![7; 48])
    }

    #[test]
    fn a_pixel_a_field_and_a_length_are_told_apart() {
        let (header, bytes) = image();
        assert_eq!(frames(of(&header, &bytes), of(&header, &bytes)), None);
        let mut other = bytes.clone();
        other[16 + 4 * 2 + 1] = 9;
        let found = frames(of(&header, &bytes), of(&header, &other)).unwrap();
        assert_eq!(found.place, "pixel (2, 1)");
        assert_eq!(
            (&found.recorded[..], &found.now[..]),
            ("[7, 7, 7, 7]", "[7, 9, 7, 7]")
        );
        let later = FrameHeader { seq: 3, ..header };
        let found = frames(of(&header, &bytes), of(&later, &other)).unwrap();
        assert_eq!(found.place, "header.seq");
        let stamped = FrameHeader {
            epoch: 9,
            published_mono_nanos: 1,
            ..header
        };
        assert_eq!(
            frames(of(&header, &bytes), of(&stamped, &bytes)),
            None,
            "clocks do not count"
        );
        let mut list = FrameHeader::new(Modality::Lidar);
        list.set_list(2);
        let (a, mut b) = (vec![0; 32], vec![0; 32]);
        b[16 + 12] = 1;
        let found = frames(of(&list, &a), of(&list, &b)).unwrap();
        assert_eq!(found.place, "element 1, intensity");
    }

    #[test]
    fn added_sensors_are_no_difference_and_a_moved_actor_is_named() {
        let actor = |id: u32| ActorRecord {
            id,
            kind: 1,
            ..Zeroable::zeroed()
        };
        let header = SnapshotHeader {
            n_actors: 2,
            tick: 5,
            ..Zeroable::zeroed()
        };
        let before = [actor(1), actor(2)];
        let with_added = [actor(1), actor(2), actor(FIRST_ADDED_ID)];
        let now = SnapshotHeader {
            n_actors: 3,
            epoch: 8,
            ..header
        };
        assert_eq!(
            snapshots(of(&header, &before), of(&now, &with_added), true),
            None
        );
        assert!(snapshots(of(&header, &before), of(&now, &with_added), false).is_some());
        let mut moved = before;
        moved[1].world_from_actor.translation_m[1] = 0.5;
        let found = snapshots(of(&header, &before), of(&header, &moved), false).unwrap();
        assert_eq!(found.place, "actor 2, world_from_actor");
        let mut braking = before;
        braking[0].part[8..12].copy_from_slice(&1f32.to_le_bytes());
        let found = snapshots(of(&header, &before), of(&header, &braking), false).unwrap();
        assert_eq!(found.place, "actor 1, brake_ratio");
    }
}
