//! One function for each kind of foreign bytes. What it reads it also uses, since a value that was
//! read may still be one that breaks its user.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io::{BufReader, Read, Write as _};
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use bytemuck::bytes_of;
use consumer_bridge::announce::Announcement;
use consumer_bridge::clock::Clock;
use consumer_bridge::coding;
use consumer_bridge::wire::{self, Envelope};
use consumer_carla::recorder::file::{Cast, Reader};
use consumer_carla::recorder::report;
use consumer_carla::wire::requests;
use consumer_drive::Desk;
use consumer_drive::requests::channel;
use consumer_drive::served::{Manager, methods};
use consumer_kit::items::{Figures, mask_columns};
use consumer_rpc::door::{Admits, Door};
use consumer_rpc::fields::Fields;
use consumer_rpc::msgpack::{self, Limits, Value};
use consumer_rpc::web::Head;
use consumer_rpc::{list, message, server};
use launch_spec::Launch;
use schema_frames::{
    CommandBatch, DocumentHeader, ElementType, FrameHeader, InputRecord, ReplyBatch, ResultHeader,
    SnapshotHeader,
};
use schema_recording::read::{RecordingFile, Selection, What};
use schema_roads::{LanePosition, RoadMap, SurfaceSteps};
use schema_types::noise::mix;
use schema_types::{ActorId, Pose};
use simd::JournalReader;
use simd_world::{Checkpoint, World};
use zenoh::bytes::ZBytes;

use crate::gpu_peers::Peers;
use crate::seeds::signalled_world;

/// What one message may cost here: small, so that many fit into a second.
const LIMITS: Limits = Limits {
    bytes: 1 << 16,
    values: 10_000,
    depth: 32,
};
/// Longest text that is read as a map: rounds stay short.
const MAX_TEXT_BYTES: usize = 1 << 16;

/// One message of a client, as the Traffic Manager and the gateway read it.
pub fn rpc(bytes: &[u8]) {
    let Ok(value) = msgpack::read(&mut &bytes[..], LIMITS) else {
        return;
    };
    let mut written = Vec::new();
    msgpack::write(&mut written, &value);
    match message::parse(value.clone()) {
        Ok(request) => {
            use_fields(&request.args);
            let unknown = message::unknown(&request.method, request.args.len());
            assert!(!message::failure(request.id, &unknown).is_empty());
        }
        Err(wrong) => assert!(wrong.to_string().contains(' '), "{wrong}"),
    }
    match requests::parse(value) {
        Ok(request) => use_fields(&request.args),
        Err(wrong) => assert!(wrong.to_string().contains(' '), "{wrong}"),
    }
}

/// Reads arguments as each kind of field in turn.
fn use_fields(args: &[Value]) {
    for (idx, value) in args.iter().enumerate() {
        let mut of_one = Fields::new("the arguments", std::slice::from_ref(value));
        let _ = match idx % 8 {
            0 => of_one.u32().map(drop),
            1 => of_one.f32().map(drop),
            2 => of_one.text().map(drop),
            3 => of_one.vector().map(drop),
            4 => of_one.optional_f64().map(drop),
            5 => of_one.each("one").map(drop),
            6 => of_one.i32().map(drop),
            _ => of_one.bool().map(drop),
        };
        if let Value::Array(inner) = value {
            use_fields(inner);
        }
    }
}

/// Vehicles that the Traffic Manager of [`managers`] drives.
pub const DRIVEN: [u32; 3] = [7, 8, 9];
/// Calls of one connection to it: what a connection has set is bounded, and then refused.
const CALLS_OF_CONNECTION: u32 = 256;

/// A call of the served Traffic Manager: the first byte chooses the method, the rest is its arguments
/// in msgpack. A well-formed request is answered whatever its arguments are.
pub fn managers(bytes: &[u8]) {
    thread_local! {
        static CLIENT: RefCell<Option<(TcpStream, u32)>> = const { RefCell::new(None) };
    }
    let Some((first, mut rest)) = bytes.split_first() else {
        return;
    };
    let names: Vec<&str> = methods::names().collect();
    let method = names[usize::from(*first) % names.len()];
    // The request is a list around its arguments.
    let limits = Limits {
        depth: LIMITS.depth - 1,
        ..LIMITS
    };
    let args = match msgpack::read(&mut rest, limits) {
        Ok(Value::Array(args)) => args,
        Ok(value) => vec![value],
        Err(_) => Vec::new(),
    };
    let mut request = Vec::new();
    msgpack::write(&mut request, &list![0u32, 1u32, method, Value::Array(args)]);
    CLIENT.with_borrow_mut(|client| {
        if client
            .as_ref()
            .is_none_or(|(_, n_calls)| *n_calls >= CALLS_OF_CONNECTION)
        {
            let stream = TcpStream::connect(manager()).expect("the manager listens");
            let patience = Some(Duration::from_secs(60));
            stream.set_read_timeout(patience).expect("a time above 0");
            *client = Some((stream, 0));
        }
        let (stream, n_calls) = client.as_mut().expect("just connected");
        *n_calls += 1;
        stream.write_all(&request).expect("the manager reads");
        let answer = msgpack::read(stream, Limits::default());
        answer.unwrap_or_else(|error| panic!("{method} was not answered: {error}"));
    });
}

/// Where a Traffic Manager listens whose session has vehicles and drives none of them.
fn manager() -> SocketAddr {
    static ADDRESS: OnceLock<SocketAddr> = OnceLock::new();
    *ADDRESS.get_or_init(|| {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port of the loopback");
        let address = listener.local_addr().expect("it is bound");
        let door = Door::new(listener, "fuzz connections", 64, Admits::AnyUser).expect("a door");
        let (counter, requests) = channel().expect("a pair of sockets");
        let manager = Arc::new(Manager::new(counter));
        std::thread::spawn(move || server::serve(door, &manager));
        std::thread::spawn(move || {
            let mut desk = Desk::default();
            desk.register(&DRIVEN);
            loop {
                let all = requests.take();
                if all.is_empty() {
                    std::thread::sleep(Duration::from_micros(100));
                }
                all.into_iter().for_each(|request| request(&mut desk)());
            }
        });
        address
    })
}

/// The head of a browser's request, as the desk and the gate before Foxglove's server read it.
pub fn browsers(bytes: &[u8]) {
    let Ok(head) = Head::read(&mut BufReader::with_capacity(16, bytes)) else {
        return;
    };
    let ours = IpAddr::V4(Ipv4Addr::LOCALHOST);
    let is_ours = head.names_host(ours, &["gantry.local".into()]);
    let origins = ["https://app.foxglove.dev".to_owned()];
    let foreign = head.foreign_origin(&origins);
    // A page of another site names that site, whatever it calls the host.
    if let Some(origin) = head.field("origin") {
        let is_allowed = origins.iter().any(|own| own.eq_ignore_ascii_case(origin));
        let is_own = origin.strip_prefix("http://") == Some(head.host());
        assert_eq!(foreign.is_none(), is_allowed || is_own);
    }
    assert!(
        !is_ours || !head.host().is_empty(),
        "a host that is nothing"
    );
}

/// A connection: messages one after another, in pieces of any size.
pub fn streams(bytes: &[u8]) {
    let Some((first, rest)) = bytes.split_first() else {
        return;
    };
    let mut pieces = Pieces {
        bytes: rest,
        piece: usize::from(first % 7) + 1,
    };
    while let Ok(value) = msgpack::read(&mut pieces, LIMITS) {
        let _ = requests::parse(value);
    }
}

/// Gives a few bytes at a time, as a slow connection does.
struct Pieces<'b> {
    bytes: &'b [u8],
    piece: usize,
}

impl Read for Pieces<'_> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let n = self.piece.min(out.len()).min(self.bytes.len());
        let (now, later) = self.bytes.split_at(n);
        out[..n].copy_from_slice(now);
        self.bytes = later;
        Ok(n)
    }
}

/// The text of a map: roads, lanes, surfaces, objects, signals and paint of it.
pub fn opendrive(bytes: &[u8]) {
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(MAX_TEXT_BYTES)]);
    let Ok(map) = RoadMap::parse(&text) else {
        return;
    };
    for lane in map.lanes().iter().take(10) {
        let at = LanePosition::new(lane.key, 0.4 * lane.length_m);
        let _ = (map.pose(at), map.width_m(at), map.speed_limit_mps(at));
        let _ = (map.advance(at, 60.0), map.advance(at, -60.0));
        let _ = (map.centreline(lane.key, 20.0), map.may_change_left(at));
    }
    for x in [-1e12, 0.0, f64::INFINITY] {
        let _ = map.nearest([x, 3.0, 0.0], |lane| lane.kind.is_drivable());
    }
    let steps = SurfaceSteps {
        max_points: 400,
        ..SurfaceSteps::default()
    };
    let _ = (map.surfaces(&steps), map.mark_lines(50.0), map.objects());
}

/// The text of a launch file.
pub fn launch_files(bytes: &[u8]) {
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(MAX_TEXT_BYTES)]);
    match Launch::parse(&text, "launch.toml") {
        Ok(launch) => drop(launch.memory_budget()),
        Err(errors) => assert!(!errors.to_string().is_empty()),
    }
}

/// A file of calibration, in whichever format it looks like; what was read is written in every one.
pub fn calibrations(bytes: &[u8]) {
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(MAX_TEXT_BYTES)]);
    let cameras = match schema_calibration::read(&text, None, Some([800, 600])) {
        Ok((_, cameras)) => cameras,
        Err(fault) => {
            assert!(!fault.of_file("file").is_empty());
            return;
        }
    };
    for camera in cameras.iter().take(4) {
        let _ = camera.lens.unproject([10.0, 20.0]);
        let _ = camera.lens.project([0.1, 0.2, 1.0]);
        for format in schema_calibration::Format::ALL {
            if let Err(error) = schema_calibration::write(format, std::slice::from_ref(camera)) {
                assert!(!error.to_string().is_empty());
            }
        }
    }
}

/// A recording, or any MCAP file.
pub fn recordings(bytes: &[u8]) {
    let mut file = tempfile::NamedTempFile::new().expect("a temporary file");
    file.write_all(bytes).expect("a temporary file takes bytes");
    let Ok(recording) = RecordingFile::open(file.path()) else {
        return;
    };
    let _ = recording.documents_at(5000);
    for name in recording.attachment_names() {
        let _ = recording.attachment(name);
    }
    for name in recording.metadata_names() {
        let _ = recording.metadata(name);
    }
    let mut samples = recording.samples(&Selection::default());
    while let Ok(Some(sample)) = samples.next() {
        match sample.what {
            What::Frame { mut payload, .. } => drop(payload.to_vec()),
            What::Result { mut body, .. } => drop(body.to_vec()),
            _ => {}
        }
    }
    let _ = samples.damage().sentences();
}

/// A recording of CARLA's own recorder.
pub fn carla_logs(bytes: &[u8]) {
    let Ok(mut reader) = Reader::new(bytes) else {
        return;
    };
    let mut cast = Cast::default();
    while let Ok(Some(frame)) = reader.next_frame() {
        if cast.note(&frame).is_err() {
            break;
        }
    }
    let fresh = || Reader::new(bytes).expect("its head was read before");
    let _ = report::info(&mut fresh(), true);
    let _ = report::collisions(&mut fresh(), 'a', 'a');
    let _ = report::blocked(&mut fresh(), 1.0, 1.0);
}

/// A checkpoint as it is, then with the length and the checksum that its bytes should have: a
/// checksum keeps nobody from writing what he likes. What is restored must be a world that runs, of
/// which everything can be asked, and that can be saved.
pub fn checkpoints(bytes: &[u8]) {
    thread_local! {
        static WORLD: World = signalled_world();
    }
    WORLD.with(|world| {
        let _ = Checkpoint::from_bytes(bytes, world);
        let mut mended = bytes.to_vec();
        mend_checkpoint(&mut mended);
        let Ok(checkpoint) = Checkpoint::from_bytes(&mended, world) else {
            return;
        };
        let mut restored = world.clone();
        if restored.restore(&checkpoint).is_ok() {
            use_world(&mut restored);
        }
    });
}

/// Steps of a restored world.
const N_STEPS: usize = 20;

fn use_world(world: &mut World) {
    let none = BTreeMap::new();
    for idx in 0..N_STEPS {
        world.step(50_000_000);
        let place = Pose::from_xyz_yaw(-80.0, 5.0 * idx as f64 - 50.0, 0.5, 0.0);
        let _ = world.spawn("vehicle.audi.tt", place, None, "late", &none);
    }
    let _ = (world.actor_list(), world.snapshot_records());
    let mut instances = Vec::new();
    world.dynamic_instances(&mut instances);
    let ids: Vec<u32> = world.snapshot_records().iter().map(|of| of.id).collect();
    for id in ids {
        let _ = world.destroy(ActorId(id));
    }
    world.step(50_000_000);
    let saved = world.checkpoint(0);
    assert!(saved.to_bytes().is_ok(), "a restored world can be saved");
}

/// Gives the bytes of a checkpoint the length and the checksum that they should have; the format is
/// written down a second time here, from `docs/how-to/checkpoints.md`.
pub fn mend_checkpoint(bytes: &mut [u8]) {
    const HEAD_BYTES: usize = 48;
    let Some(body_bytes) = bytes.len().checked_sub(HEAD_BYTES) else {
        return;
    };
    let hash = |bytes: &[u8]| {
        let mut lanes = [0x243f_6a88_85a3_08d3u64, 0x1319_8a2e_0370_7344];
        for (idx, chunk) in bytes.chunks(8).enumerate() {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            let lane = &mut lanes[idx % 2];
            *lane = mix(*lane ^ u64::from_le_bytes(word));
        }
        mix(mix(lanes[0] ^ bytes.len() as u64) ^ lanes[1])
    };
    bytes[32..40].copy_from_slice(&(body_bytes as u64).to_le_bytes());
    let sum = mix(hash(&bytes[..40]) ^ mix(hash(&bytes[HEAD_BYTES..])));
    bytes[40..HEAD_BYTES].copy_from_slice(&sum.to_le_bytes());
}

/// Headers of frames, snapshots and results, and what stands behind a result's.
pub fn results(bytes: &[u8]) {
    if let Some(head) = bytes.get(..size_of::<FrameHeader>()) {
        let header: FrameHeader = bytemuck::pod_read_unaligned(head);
        let _ = header.check(bytes.len());
    }
    if let Some(head) = bytes.get(..size_of::<SnapshotHeader>()) {
        let header: SnapshotHeader = bytemuck::pod_read_unaligned(head);
        let _ = format!("{header:?}");
    }
    let n_head = size_of::<ResultHeader>();
    let Some((head, payload)) = bytes.split_at_checked(n_head) else {
        return;
    };
    let header: ResultHeader = bytemuck::pod_read_unaligned(head);
    let Ok(_kind) = header.check(payload.len()) else {
        return;
    };
    let _ = header.shape();
    // A header that passed its check tells the truth about what stands behind it.
    let body = &payload[..header.body_bytes as usize];
    let mut inputs = &payload[header.inputs_offset() as usize..];
    for _ in 0..header.n_inputs {
        let (one, rest) = inputs.split_at(size_of::<InputRecord>());
        let input: InputRecord = bytemuck::pod_read_unaligned(one);
        let _ = input.topic();
        inputs = rest;
    }
    for element in [ElementType::U8, ElementType::F32, ElementType::F64] {
        let _ = Figures::of(element, body).bins();
    }
    let runs: Vec<u32> = body
        .chunks_exact(4)
        .map(|word| u32::from_le_bytes(word.try_into().expect("four bytes")))
        .collect();
    let _ = mask_columns(&runs, [64, 48]);
}

/// The journal of a run that is to be run again.
pub fn journals(bytes: &[u8]) {
    let mut file = tempfile::NamedTempFile::new().expect("a temporary file");
    file.write_all(bytes).expect("a temporary file takes bytes");
    let Ok((mut reader, _)) = JournalReader::open(file.path()) else {
        return;
    };
    loop {
        let stretch = reader.read_on();
        match stretch.end {
            None => {}
            Some(Ok(())) => break,
            Some(Err(error)) => {
                assert!(error.to_string().contains(' '), "{error}");
                break;
            }
        }
    }
}

/// What a bridge hears from others. The first byte says what it is; a sample comes as the length of
/// its envelope in two bytes, the envelope and the payload.
pub fn bridges(bytes: &[u8]) {
    let Some((kind, rest)) = bytes.split_first() else {
        return;
    };
    let mut clock = Clock::default();
    match kind % 9 {
        0 => match Announcement::parse(rest) {
            Ok((announcement, _)) => {
                let _ = announcement.has_world();
                for offer in &announcement.topics {
                    let _ = (offer.modality(), offer.result_type());
                }
            }
            Err(error) => assert!(format!("{error:#}").contains(' '), "{error:#}"),
        },
        1 => {
            clock.note(&String::from_utf8_lossy(rest), 5, 1_000_000);
            let mut header = FrameHeader::new(schema_frames::Modality::Imu);
            header.published_mono_nanos = u64::MAX;
            clock.translate_frame(&mut header);
        }
        2 => drop(serde_json::from_slice::<CommandBatch>(rest)),
        3 => drop(serde_json::from_slice::<ReplyBatch>(rest)),
        kind => bridge_sample(kind, rest, &clock),
    }
}

/// Longest payload that is decoded here: rounds stay short.
const MAX_DECODED_BYTES: usize = 1 << 20;

fn bridge_sample(kind: u8, bytes: &[u8], clock: &Clock) {
    let Some((len, rest)) = bytes.split_at_checked(2) else {
        return;
    };
    let len = usize::from(u16::from_le_bytes([len[0], len[1]]));
    let Some((envelope, payload)) = rest.split_at_checked(len) else {
        return;
    };
    let (attachment, payload) = (ZBytes::from(envelope), ZBytes::from(payload));
    let Ok(envelope) = Envelope::open(Some(&attachment)) else {
        return;
    };
    if envelope.raw_bytes > MAX_DECODED_BYTES {
        return;
    }
    match kind {
        4 => {
            let Ok((mut header, _)) = envelope.header::<FrameHeader>() else {
                return;
            };
            if header.check(envelope.raw_bytes).is_err() {
                return;
            }
            let mut out = vec![0; envelope.raw_bytes];
            let _ = coding::decode(envelope.coding, Some(&header), &payload, &mut out);
            clock.translate_frame(&mut header);
        }
        5 => {
            let Ok((mut header, behind)) = envelope.header::<ResultHeader>() else {
                return;
            };
            clock.translate_result(&mut header);
            for one in behind.chunks_exact(size_of::<InputRecord>()) {
                let mut input: InputRecord = bytemuck::pod_read_unaligned(one);
                clock.translate_input(&mut input);
            }
            let _ = envelope.plain(&payload);
        }
        6 => {
            if let Ok((header, records)) = wire::snapshot(&envelope, &payload) {
                assert_eq!(header.n_actors as usize, records.len());
            }
        }
        7 => {
            if envelope.header::<DocumentHeader>().is_ok() {
                let _ = envelope.plain(&payload).map(String::from_utf8);
            }
        }
        _ => {
            let _ = envelope.header::<[u64; 3]>();
            let controls = wire::controls(Some(&attachment), &payload, MAX_DECODED_BYTES);
            if let Ok(controls) = controls {
                let n_bytes: usize = controls.records.iter().map(|of| bytes_of(of).len()).sum();
                assert_eq!(n_bytes, envelope.raw_bytes);
            }
        }
    }
}

/// The socket of GPU frames. The first byte says whether the rest is what a reader asks a writer, or
/// what a writer answers a reader.
pub fn gpu_socket(bytes: &[u8]) {
    thread_local! {
        static PEERS: Peers = Peers::new();
    }
    let Some((first, rest)) = bytes.split_first() else {
        return;
    };
    PEERS.with(|peers| match first % 2 {
        0 => peers.ask(rest),
        _ => peers.answer(rest),
    });
}
