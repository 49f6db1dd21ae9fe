//! A writer that speaks iceoryx2 but not our contract: whatever bytes it sends, readers answer with
//! an error or a valid value, never a panic.
//!
//! It opens our services under the right type names and sends mutated headers with payloads of any
//! length.

#![expect(
    unsafe_code,
    reason = "the hostile writer's headers need a name on the bus"
)]

use std::os::fd::{AsRawFd as _, OwnedFd};

use iceoryx2::prelude::*;
use nix::sys::socket::{AddressFamily, SockFlag, SockType, UnixAddr, connect, socket};
use schema_bus::{FrameTopic, GpuDevice, names};
use schema_frames::command::RequestHeader;
use schema_frames::control::ControlHeader;
use schema_frames::{DocumentHeader, FrameHeader, Modality, SnapshotHeader};

use crate::place::Place;

macro_rules! raw_headers {
    ($($raw:ident $n:literal $name:literal;)*) => {$(
        #[repr(C, align(64))]
        #[derive(Debug, Clone, Copy)]
        struct $raw([u8; $n]);
        impl Default for $raw {
            fn default() -> Self {
                $raw([0; $n])
            }
        }
        // SAFETY: bytes only, `repr(C)`, no pointers, no drop.
        unsafe impl ZeroCopySend for $raw {
            unsafe fn type_name() -> &'static str {
                $name
            }
        }
    )*};
}
raw_headers! {
    RawFrame 256 "GantryFrameHeader";
    RawSnapshot 128 "GantrySnapshotHeader";
    RawDocument 64 "GantryDocumentHeader";
    RawControl 64 "GantryControlHeader";
    RawRequest 64 "GantryRequestHeader";
}

/// Small deterministic generator (SplitMix64), so that a failure can be repeated.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let x = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        ((x ^ (x >> 27)) % n as u64) as usize
    }

    /// `good` with up to three bytes changed.
    fn mutated<const N: usize>(&mut self, good: &[u8]) -> [u8; N] {
        let mut bytes: [u8; N] = good.try_into().expect("header sizes agree");
        for _ in 0..self.below(4) {
            bytes[self.below(N)] = self.below(256) as u8;
        }
        bytes
    }
}

/// A node of a program that does not know us.
fn foreign_node(place: &Place) -> Node<ipc::Service> {
    NodeBuilder::new()
        .config(&place.config())
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create()
        .unwrap()
}

macro_rules! hostile_writer {
    ($node:expr, $topic:literal, $raw:ty) => {{
        let name = concat!("d/", $topic).try_into().unwrap();
        let service = $node
            .service_builder(&name)
            .publish_subscribe::<[u8]>()
            .user_header::<$raw>()
            .open()
            .unwrap();
        service
            .publisher_builder()
            .initial_max_slice_len(1024)
            .create()
            .unwrap()
    }};
}

macro_rules! send {
    ($writer:expr, $header:expr, $payload:expr) => {{
        let payload = $payload;
        let mut sample = $writer
            .loan_slice_uninit(payload.len())
            .unwrap()
            .write_from_slice(&payload);
        sample.user_header_mut().0 = $header;
        sample.send().unwrap();
    }};
}

#[test]
fn frames_of_any_bytes_are_refused_or_whole() {
    let place = Place::with_foreigners("frames");
    let bus = place.bus("victim");
    let _service = bus
        .frame_service("ego/front/depth", FrameTopic::new(Modality::Depth, 1024))
        .unwrap();
    let mut reader = bus.frame_reader("ego/front/depth").unwrap();
    let node = foreign_node(&place);
    let writer = hostile_writer!(node, "ego/front/depth", RawFrame);
    let mut good = FrameHeader::new(Modality::Depth);
    good.set_image(8, 8);
    let mut random = Random(1);
    let (mut taken, mut refused) = (0, 0);
    for _ in 0..4000 {
        let payload = vec![7u8; 250 + random.below(16)];
        send!(
            writer,
            random.mutated::<256>(bytemuck::bytes_of(&good)),
            payload
        );
        match reader.next() {
            Ok(Some(frame)) => {
                taken += 1;
                let sum: usize = frame.iter().map(|byte| *byte as usize).sum();
                assert_eq!(sum, 7 * frame.len());
                let _ = (frame.elements::<f32>(), frame.row(0), frame.row(u32::MAX));
            }
            Ok(None) => panic!("a frame was sent"),
            Err(error) => {
                refused += 1;
                assert!(!error.to_string().is_empty());
            }
        }
    }
    assert!(
        taken > 500 && refused > 500,
        "{taken} taken, {refused} refused: the mutation is too weak or too strong"
    );
    assert_eq!(reader.counts().refused, refused);
}

#[test]
fn snapshots_documents_and_controls_of_any_bytes_are_refused_or_whole() {
    let place = Place::with_foreigners("rest");
    let bus = place.bus("victim");
    let node = foreign_node(&place);
    let mut random = Random(2);

    let _snapshots = bus.snapshot_publisher(4).unwrap();
    let mut reader = bus.snapshot_reader().unwrap();
    let writer = hostile_writer!(node, "world/snapshot", RawSnapshot);
    let magic = schema_frames::snapshot::SNAPSHOT_MAGIC;
    let good = SnapshotHeader {
        magic,
        schema_version: 1,
        n_actors: 2,
        ..bytemuck::Zeroable::zeroed()
    };
    for _ in 0..1000 {
        send!(
            writer,
            random.mutated::<128>(bytemuck::bytes_of(&good)),
            vec![1u8; 512 - random.below(2)]
        );
        if let Ok(Some(snapshot)) = reader.next() {
            assert_eq!(snapshot.records().len(), 2);
            let _ = (
                snapshot.actor(3),
                snapshot.records()[0].kind(),
                snapshot.records()[0].vehicle(),
            );
        }
    }

    let _info = bus.document_publisher(names::WORLD_INFO).unwrap();
    let mut reader = bus.document_reader(names::WORLD_INFO).unwrap();
    let writer = hostile_writer!(node, "world/info", RawDocument);
    let magic = schema_frames::document::DOCUMENT_MAGIC;
    let good = DocumentHeader {
        magic,
        schema_version: 1,
        payload_bytes: 40,
        ..bytemuck::Zeroable::zeroed()
    };
    for _ in 0..1000 {
        send!(
            writer,
            random.mutated::<64>(bytemuck::bytes_of(&good)),
            [
                b"{\"a\":1}                             ".as_slice(),
                &[random.below(256) as u8; 8]
            ]
            .concat()
        );
        if let Ok(Some(document)) = reader.latest() {
            assert!(document.text.len() <= 48);
            assert!(document.json::<schema_frames::WorldInfo>().is_err());
        }
    }

    let mut reader = bus.control_reader().unwrap();
    let writer = hostile_writer!(node, "control/vehicles", RawControl);
    let magic = schema_frames::control::CONTROL_MAGIC;
    let good = ControlHeader {
        magic,
        schema_version: 1,
        writer: [0xff; 40],
        ..bytemuck::Zeroable::zeroed()
    };
    for _ in 0..1000 {
        send!(
            writer,
            random.mutated::<64>(bytemuck::bytes_of(&good)),
            vec![0xffu8; 64 + random.below(2)]
        );
        for batch in reader.drain().unwrap() {
            assert_eq!(batch.records.len(), 2);
            assert_eq!(
                batch.records[0].control().throttle_ratio,
                0.0,
                "not a number becomes 0"
            );
        }
    }
}

#[test]
fn requests_of_any_bytes_become_an_error_text() {
    let place = Place::with_foreigners("requests");
    let bus = place.bus("victim");
    let mut server = bus.command_server().unwrap();
    let node = foreign_node(&place);
    let name = "d/control/world".try_into().unwrap();
    let service = node
        .service_builder(&name)
        .request_response::<[u8], [u8]>()
        .request_user_header::<RawRequest>()
        .open()
        .unwrap();
    let client = service
        .client_builder()
        .initial_max_slice_len(256)
        .create()
        .unwrap();
    let text = br#"{"v":1,"commands":[{"do":"step","n":1}]}"#;
    let magic = schema_frames::command::REQUEST_MAGIC;
    let good = RequestHeader {
        magic,
        codec_version: 1,
        seq: 1,
        payload_bytes: text.len() as u64,
        client: [b'x'; 40],
    };
    let mut random = Random(3);
    let mut understood = 0;
    for _ in 0..1000 {
        let mut payload = text.to_vec();
        if random.below(2) == 0 {
            let at = random.below(payload.len());
            payload[at] = random.below(256) as u8;
        }
        let mut request = client
            .loan_slice_uninit(payload.len())
            .unwrap()
            .write_from_slice(&payload);
        request.user_header_mut().0 = random.mutated::<64>(bytemuck::bytes_of(&good));
        let _pending = request.send().unwrap();
        let request = server.take().unwrap().expect("a request was sent");
        match request.batch {
            Ok(batch) => {
                understood += 1;
                assert_eq!(batch.commands.len(), 1);
            }
            Err(text) => assert!(!text.to_string().is_empty()),
        }
    }
    assert!((100..900).contains(&understood), "{understood}");
}

/// Connects to the socket of GPU frames below a folder and says nothing.
fn silent_peer(iceoryx_root: &std::path::Path) -> OwnedFd {
    let folder = iceoryx_root.join("gantry-gpu");
    let name = std::fs::read_dir(&folder).unwrap().next().unwrap().unwrap();
    let opened = std::fs::File::open(&folder).unwrap();
    // Short whatever the folder's path.
    let path = format!(
        "/proc/self/fd/{}/{}",
        opened.as_raw_fd(),
        name.file_name().display()
    );
    let peer = socket(
        AddressFamily::Unix,
        SockType::SeqPacket,
        SockFlag::SOCK_CLOEXEC,
        None,
    )
    .unwrap();
    let address = UnixAddr::new(path.as_str()).unwrap();
    connect(peer.as_raw_fd(), &address).unwrap();
    peer
}

#[test]
fn peers_that_ask_for_no_gpu_memory_keep_nobody_waiting() {
    let place = Place::with_foreigners("silent");
    let bus = place.bus("victim");
    let server = bus.gpu_server(GpuDevice::default()).unwrap();
    let _offered = server.offer("ego/front/rgb", FrameTopic::on_gpu(2));
    // Each peer has two seconds, and the reader waits as long for its answer: it must not wait for one
    // peer after the other. They are more than the server keeps at once.
    let peers: Vec<OwnedFd> = (0..100).map(|_| silent_peer(&place.root())).collect();
    let offer = place.bus("victim").gpu_offer("ego/front/rgb").unwrap();
    assert_eq!(offer.producer, server.producer());
    drop(peers);
}

#[test]
fn ports_and_frames_may_move_between_threads() {
    fn moves<T: Send>() {}
    moves::<schema_bus::Bus>();
    moves::<schema_bus::Frame>();
    moves::<schema_bus::FrameLoan>();
    moves::<schema_bus::FramePublisher>();
    moves::<schema_bus::FrameReader>();
    moves::<schema_bus::Snapshot>();
    moves::<schema_bus::Listener>();
    moves::<schema_bus::Notifier>();
    moves::<schema_bus::CommandClient>();
    moves::<schema_bus::Request>();
}
