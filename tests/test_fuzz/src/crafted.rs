//! MCAP files made byte by byte from the format's specification, each with one thing in it that no
//! writer writes: a length of 2^64 − 1, a chunk that ends before it begins, times at the end of
//! what 64 bits hold.

use schema_frames::snapshot::SNAPSHOT_MAGIC;
use schema_frames::{FrameHeader, Modality, SCHEMA_VERSION, SnapshotHeader};

const MAGIC: &[u8] = b"\x89MCAP0\r\n";
const HEADER: u8 = 1;
const FOOTER: u8 = 2;
const SCHEMA: u8 = 3;
const CHANNEL: u8 = 4;
const MESSAGE: u8 = 5;
const CHUNK: u8 = 6;
const CHUNK_INDEX: u8 = 8;
const ATTACHMENT: u8 = 9;
const ATTACHMENT_INDEX: u8 = 10;
const STATISTICS: u8 = 11;
const METADATA: u8 = 12;
const METADATA_INDEX: u8 = 13;
const DATA_END: u8 = 15;

/// The channel of positions in Foxglove's form, of which an empty message is a whole one.
const POSITIONS: u16 = 1;
/// The channel of snapshots of ours.
const SNAPSHOTS: u16 = 2;
/// The channel of frames of ours.
const FRAMES: u16 = 3;

fn text(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat()
}

fn record(opcode: u8, body: &[u8]) -> Vec<u8> {
    record_of(opcode, body.len() as u64, body)
}

/// A record that gives itself a length.
fn record_of(opcode: u8, len: u64, body: &[u8]) -> Vec<u8> {
    [&[opcode][..], &len.to_le_bytes(), body].concat()
}

fn message(channel: u16, nanos: u64, data: &[u8]) -> Vec<u8> {
    let times = [nanos.to_le_bytes(), nanos.to_le_bytes()].concat();
    let head = [&channel.to_le_bytes()[..], &1u32.to_le_bytes(), &times];
    record(MESSAGE, &[&head.concat()[..], data].concat())
}

/// Fields of protocol buffers that hold bytes.
fn fields(fields: &[(u8, &[u8])]) -> Vec<u8> {
    let mut out = Vec::new();
    for (number, bytes) in fields {
        assert!(bytes.len() < 1 << 14, "lengths are of two bytes");
        out.push(number << 3 | 2);
        out.extend([bytes.len() as u8 | 0x80, (bytes.len() >> 7) as u8]);
        out.extend_from_slice(bytes);
    }
    out
}

/// A file, of which a case changes what it lies about.
#[derive(Clone, Debug)]
struct File {
    /// Schemas and channels in the data and in the summary.
    channels: Vec<(u16, &'static str, &'static str)>,
    /// Times of the chunk, in its head and in the index.
    chunk_nanos: [u64; 2],
    compression: &'static str,
    /// Sizes that the chunk gives itself, packed and unpacked; `None` for the true ones.
    chunk_sizes: [Option<u64>; 2],
    /// The records of the chunk.
    records: Vec<u8>,
    /// Records between the chunk and the end of the data, and index records for them: opcode, name,
    /// and the length that is said.
    others: Vec<(Vec<u8>, u8, &'static str)>,
    /// Length that the index gives to all of them; `None` for the true one.
    indexed_bytes: Option<u64>,
    /// Messages by channel, as the statistics count them.
    counts: Vec<(u16, u64)>,
    has_summary: bool,
}

impl File {
    /// A file that says nothing untrue, with messages at these times.
    fn of(channel: u16, messages: &[(u64, Vec<u8>)]) -> File {
        let times = || messages.iter().map(|(nanos, _)| *nanos);
        let records = messages
            .iter()
            .map(|(nanos, data)| message(channel, *nanos, data));
        File {
            channels: vec![match channel {
                POSITIONS => (POSITIONS, "/car/fix", "foxglove.LocationFix"),
                SNAPSHOTS => (SNAPSHOTS, "/world/snapshot", "gantry.Snapshot"),
                _ => (FRAMES, "/ego/imu/imu/gantry", "gantry.Frame"),
            }],
            chunk_nanos: [times().min().unwrap_or(0), times().max().unwrap_or(0)],
            compression: "",
            chunk_sizes: [None; 2],
            records: records.collect::<Vec<_>>().concat(),
            others: Vec::new(),
            indexed_bytes: None,
            counts: vec![(channel, messages.len() as u64)],
            has_summary: true,
        }
    }

    /// Positions at these times.
    fn positions(nanos: &[u64]) -> File {
        let messages: Vec<_> = nanos.iter().map(|nanos| (*nanos, Vec::new())).collect();
        File::of(POSITIONS, &messages)
    }

    fn described(&self) -> Vec<u8> {
        let mut out = Vec::new();
        for (id, topic, schema) in &self.channels {
            let body = [&id.to_le_bytes()[..], &text(schema), &text("protobuf")];
            let body = [&body.concat()[..], &0u32.to_le_bytes()].concat();
            out.extend(record(SCHEMA, &body));
            let ids = [id.to_le_bytes(), id.to_le_bytes()].concat();
            let body = [&ids[..], &text(topic), &text("protobuf"), &text("")].concat();
            out.extend(record(CHANNEL, &body));
        }
        out
    }

    fn bytes(&self) -> Vec<u8> {
        let mut out = MAGIC.to_vec();
        out.extend(record(HEADER, &[text(""), text("crafted")].concat()));
        let records = [self.described(), self.records.clone()].concat();
        let [packed, unpacked] = self.chunk_sizes;
        let n_bytes = records.len() as u64;
        let (packed, unpacked) = (packed.unwrap_or(n_bytes), unpacked.unwrap_or(n_bytes));
        let times: Vec<u8> = self
            .chunk_nanos
            .iter()
            .flat_map(|t| t.to_le_bytes())
            .collect();
        let chunk = [
            &times[..],
            &unpacked.to_le_bytes(),
            &0u32.to_le_bytes(),
            &text(self.compression),
            &packed.to_le_bytes(),
            &records,
        ]
        .concat();
        let chunk = record(CHUNK, &chunk);
        let mut index = record(
            CHUNK_INDEX,
            &[
                &times[..],
                &(out.len() as u64).to_le_bytes(),
                &(chunk.len() as u64).to_le_bytes(),
                &text(""),
                &0u64.to_le_bytes(),
                &text(self.compression),
                &packed.to_le_bytes(),
                &unpacked.to_le_bytes(),
            ]
            .concat(),
        );
        out.extend(chunk);
        let mut n_of = [0u32; 2];
        for (bytes, opcode, name) in &self.others {
            let len = self.indexed_bytes.unwrap_or(bytes.len() as u64);
            let place = [(out.len() as u64).to_le_bytes(), len.to_le_bytes()].concat();
            let is_attachment = *opcode == ATTACHMENT_INDEX;
            n_of[usize::from(is_attachment)] += 1;
            let body = match is_attachment {
                // Two times and the length of the data.
                true => [&place[..], &[0; 24], &text(name), &text("")].concat(),
                false => [&place[..], &text(name)].concat(),
            };
            index.extend(record(*opcode, &body));
            out.extend_from_slice(bytes);
        }
        out.extend(record(DATA_END, &0u32.to_le_bytes()));
        let start = out.len() as u64;
        if self.has_summary {
            let counts: Vec<u8> = self
                .counts
                .iter()
                .flat_map(|(id, n)| [&id.to_le_bytes()[..], &n.to_le_bytes()].concat())
                .collect();
            let n_channels = self.channels.len();
            let statistics = [
                &1u64.to_le_bytes()[..],
                &(n_channels as u16).to_le_bytes(),
                &(n_channels as u32).to_le_bytes(),
                &n_of[1].to_le_bytes(),
                &n_of[0].to_le_bytes(),
                &1u32.to_le_bytes(),
                &times,
                &(counts.len() as u32).to_le_bytes(),
                &counts,
            ];
            out.extend(self.described());
            out.extend(index);
            out.extend(record(STATISTICS, &statistics.concat()));
        }
        let start = if self.has_summary { start } else { 0 };
        let footer = [&start.to_le_bytes()[..], &[0; 12]].concat();
        out.extend(record(FOOTER, &footer));
        out.extend_from_slice(MAGIC);
        out
    }
}

/// A snapshot of no actors at a tick and a time.
fn snapshot(tick: u64, sim_nanos: u64) -> Vec<u8> {
    let mut header: SnapshotHeader = bytemuck::Zeroable::zeroed();
    (header.magic, header.schema_version) = (SNAPSHOT_MAGIC, SCHEMA_VERSION);
    (header.tick, header.sim_nanos, header.period_nanos) = (tick, sim_nanos, u64::MAX);
    header.episode_start_nanos = u64::MAX;
    fields(&[(3, bytemuck::bytes_of(&header))])
}

/// A frame of an inertial sensor at a tick and a time.
fn frame(tick: u64, sim_nanos: u64) -> Vec<u8> {
    let mut header = FrameHeader::new(Modality::Imu);
    header.set_image(1, 1);
    (header.tick, header.sim_nanos, header.sensor_id) = (tick, sim_nanos, 1);
    header.ticks_in_flight = u32::MAX;
    let payload = vec![0; header.payload_bytes as usize];
    fields(&[(4, bytemuck::bytes_of(&header)), (5, &payload)])
}

/// The files by a name that says what is wrong with each.
pub fn recordings() -> Vec<(&'static str, Vec<u8>)> {
    const END: u64 = u64::MAX;
    let plain = File::positions(&[0, 1_000_000_000]);
    let metadata = |len: Option<u64>| {
        let body = [text("gantry"), text("")].concat();
        let len = len.unwrap_or(body.len() as u64);
        (record_of(METADATA, len, &body), METADATA_INDEX, "gantry")
    };
    let attachment = |data_bytes: u64| {
        let body = [&[0; 16][..], &text("a.xodr"), &text("")].concat();
        let body = [&body[..], &data_bytes.to_le_bytes(), b"map", &[0; 4]].concat();
        (record(ATTACHMENT, &body), ATTACHMENT_INDEX, "a.xodr")
    };
    let with = |change: &dyn Fn(&mut File)| {
        let mut file = plain.clone();
        change(&mut file);
        file.bytes()
    };
    let near_the_end = |channel, data: &dyn Fn(u64, u64) -> Vec<u8>| {
        let of = |back: u64| (END - back, data(END - back, END - back));
        File::of(channel, &[of(2), of(1), of(0)]).bytes()
    };
    vec![
        ("plain", plain.bytes()),
        (
            "metadata_len",
            with(&|it| it.others = vec![metadata(Some(END))]),
        ),
        (
            "metadata_len_walked",
            with(&|it| {
                (it.others, it.has_summary) = (vec![metadata(Some(END))], false);
            }),
        ),
        (
            "metadata_index_len",
            with(&|it| {
                (it.others, it.indexed_bytes) = (vec![metadata(None)], Some(END));
            }),
        ),
        (
            "metadata_index_short",
            with(&|it| {
                (it.others, it.indexed_bytes) = (vec![metadata(None)], Some(3));
            }),
        ),
        (
            "attachment_data_len",
            with(&|it| it.others = vec![attachment(END)]),
        ),
        ("chunk_ends_first", with(&|it| it.chunk_nanos = [END, 0])),
        (
            "chunk_ends_first_walked",
            with(&|it| {
                (it.chunk_nanos, it.has_summary) = ([1_000_000_000, 5], false);
            }),
        ),
        (
            "chunk_packed_size",
            with(&|it| it.chunk_sizes = [Some(END), Some(END)]),
        ),
        (
            "chunk_unpacked_size",
            with(&|it| {
                (it.compression, it.chunk_sizes) = ("lz4", [None, Some(END)]);
            }),
        ),
        (
            "chunk_of_three_bytes",
            with(&|it| it.chunk_sizes = [Some(3), Some(3)]),
        ),
        // A record that reaches into what stands behind its chunk.
        (
            "record_beyond_chunk",
            with(&|it| {
                let n_bytes = (it.described().len() + it.records.len()) as u64;
                it.chunk_sizes = [Some(n_bytes - 4), Some(n_bytes - 4)];
            }),
        ),
        (
            "record_len",
            with(&|it| it.records = record_of(MESSAGE, END, &[0; 22])),
        ),
        (
            "message_of_three_bytes",
            with(&|it| it.records = record(MESSAGE, &[1, 0, 0])),
        ),
        (
            "schema_data_len",
            with(&|it| {
                let body = [&9u16.to_le_bytes()[..], &text("a"), &text("b"), &[0xff; 4]];
                it.records.extend(record(SCHEMA, &body.concat()));
            }),
        ),
        (
            "counts",
            with(&|it| {
                // Two channels of one topic, whose numbers of messages are added.
                it.channels.push((4, "/car/fix", "foxglove.LocationFix"));
                it.counts = vec![(POSITIONS, END), (4, END)];
            }),
        ),
        (
            "times_from_0_to_the_end",
            File::positions(&[0, END, END]).bytes(),
        ),
        (
            "times_near_the_end",
            near_the_end(POSITIONS, &|_, _| Vec::new()),
        ),
        ("snapshots_near_the_end", near_the_end(SNAPSHOTS, &snapshot)),
        ("frames_near_the_end", near_the_end(FRAMES, &frame)),
        (
            "field_len",
            File::of(
                SNAPSHOTS,
                &[(5, [&[3 << 3 | 2][..], &[0xff; 9], &[1]].concat())],
            )
            .bytes(),
        ),
    ]
}
