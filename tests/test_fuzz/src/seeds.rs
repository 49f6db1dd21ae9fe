//! Bytes that can be read, from which the search begins.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use bytemuck::{Zeroable as _, bytes_of};
use consumer_bridge::announce::{Announcement, Kind, Offer};
use consumer_bridge::clock;
use consumer_bridge::coding::{Coding, Encoder, Wanted};
use consumer_bridge::wire::{Envelope, VERSION};
use consumer_rpc::list;
use consumer_rpc::msgpack::{self, Value};
use schema_frames::control::{CONTROL_MAGIC, ControlHeader};
use schema_frames::result::RESULT_MAGIC;
use schema_frames::{
    ActorRecord, DocumentHeader, FrameHeader, GpuAnswer, GpuAsk, JournalAct, JournalEntry,
    JournalFile, JournalHead, Modality, ResultHeader, ResultType, SCHEMA_VERSION, SnapshotHeader,
    VehicleControlRecord,
};
use schema_types::{ActorId, Pose};
use simd_world::{Checkpoint, MapData, World, WorldOptions};

use crate::crafted;

fn message(value: &Value) -> Vec<u8> {
    let mut bytes = Vec::new();
    msgpack::write(&mut bytes, value);
    bytes
}

/// Requests of a client, and lists of all shapes around theirs.
pub fn rpc() -> Vec<Vec<u8>> {
    requests().into_iter().chain(shapes()).collect()
}

/// Every list of up to four of the values that a request has, in any order.
fn shapes() -> Vec<Vec<u8>> {
    let values = [
        Value::Nil,
        Value::UInt(0),
        Value::from("tick_cue"),
        list![list![false]],
        list![],
        Value::Bool(true),
    ];
    let mut found = Vec::new();
    for n in 0..=4u32 {
        for number in 0..values.len().pow(n) {
            let nth = |digit| values[number / values.len().pow(digit) % values.len()].clone();
            found.push(message(&Value::Array((0..n).map(nth).collect())));
        }
    }
    found
}

fn requests() -> Vec<Vec<u8>> {
    [
        list![0u32, 5u32, "destroy_actor", list![list![true], 9u32]],
        list![0u32, 6u32, "version", list![list![false]]],
        list![
            0u32,
            7u32,
            "spawn_actor",
            list![
                list![false],
                list![
                    1u32,
                    "vehicle.audi.tt",
                    list![list!["role_name", "hero", 4u32]]
                ],
                list![
                    list![0.5f32, 1.0f32, 2.0f32],
                    list![0.0f32, 90.0f32, 0.0f32]
                ]
            ]
        ],
    ]
    .iter()
    .map(message)
    .collect()
}

/// A connection with several requests; the first byte says in which pieces they come.
pub fn streams() -> Vec<Vec<u8>> {
    let whole: Vec<u8> = requests().concat();
    (0..3)
        .map(|piece| [&[piece], &whole[..]].concat())
        .collect()
}

/// Small maps.
pub fn opendrive() -> Vec<Vec<u8>> {
    let line = r#"<geometry s="0" x="0" y="0" hdg="0" length="60"><line/></geometry>"#;
    let spiral = r#"<geometry s="0" x="0" y="9" hdg="0" length="60"><spiral curvStart="0" curvEnd="0.1"/></geometry>"#;
    let poly = r#"<geometry s="0" x="0" y="20" hdg="0" length="40"><paramPoly3 aU="0" bU="40" cU="-4" dU="1" aV="0" bV="0" cV="9" dV="-5" pRange="normalized"/></geometry>"#;
    let road = |id: u32, length: u32, geometry: &str| {
        format!(
            r#"<road name="" length="{length}" id="{id}" junction="-1"><planView>{geometry}</planView>
<elevationProfile><elevation s="0" a="1" b="0.02" c="0" d="0"/></elevationProfile>
<lanes><laneOffset s="0" a="0.5" b="0" c="0" d="0"/><laneSection s="0"><center><lane id="0" type="none"><roadMark sOffset="0" type="broken" color="white" width="0.1"/></lane></center>
<right><lane id="-1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/><speed sOffset="0" max="50" unit="mph"/></lane></right></laneSection></lanes>
<objects><object id="1" type="barrier" s="5" t="-6" length="2" width="0.3" height="1"><repeat s="5" length="20" distance="4" tStart="-6" tEnd="-7" heightStart="1" heightEnd="2"/></object></objects>
<signals><signal id="9" s="30" t="-5" dynamic="yes" orientation="+" type="1000001" value="-1"/></signals></road>"#
        )
    };
    let document = |roads: &str| {
        format!(
            r#"<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="4" name=""/>{roads}<controller id="1"><control signalId="9"/></controller></OpenDRIVE>"#
        )
        .into_bytes()
    };
    vec![
        document(&road(1, 60, line)),
        document(&(road(1, 60, spiral) + &road(2, 40, poly))),
    ]
}

/// A file of each format of calibrations.
pub fn calibrations() -> Vec<Vec<u8>> {
    let texts = [
        "cam0:\n  camera_model: pinhole\n  distortion_coeffs: [-0.01, 0.02, -0.01, 0.002]\n  distortion_model: equidistant\n  intrinsics: [285.0, 286.5, 421.5, 398.25]\n  resolution: [848, 800]\ncam1:\n  T_cn_cnm1:\n  - [1.0, 0.0, 0.0, -0.11]\n  - [0.0, 1.0, 0.0, 0.0]\n  - [0.0, 0.0, 1.0, 0.02]\n  - [0.0, 0.0, 0.0, 1.0]\n  camera_model: omni\n  distortion_coeffs: [-0.1, 0.02, 0.001, -0.0005]\n  distortion_model: radtan\n  intrinsics: [1.2, 285.0, 286.5, 421.5, 398.25]\n  resolution: [848, 800]\n",
        "%YAML:1.0\n---\nimage_width: 752\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 458.6, 0., 367.2, 0., 457.3, 248.4, 0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n   data: [ -0.28, 0.07, 0.0002, 1.76e-05, 0.01 ]\n",
        "image_width: 752\nimage_height: 480\ncamera_name: left\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [458.6, 0, 367.2, 0, 457.3, 248.4, 0, 0, 1]\ndistortion_model: rational_polynomial\ndistortion_coefficients:\n  rows: 1\n  cols: 8\n  data: [0.4, -0.05, 0.001, -0.002, 0.003, 0.6, 0.02, -0.004]\n",
        "[{\"token\": \"a\", \"sensor_token\": \"b\", \"translation\": [1.7, 0.0, 1.5], \"rotation\": [0.5, -0.5, 0.5, -0.5], \"camera_intrinsic\": [[1266.4, 0.0, 816.3], [0.0, 1266.4, 491.5], [0.0, 0.0, 1.0]]}]",
        "P2: 7.0e+02 0 6.0e+02 4.2e+01 0 7.0e+02 1.8e+02 0 0 0 1 0\nS_rect_02: 1242 375\n",
        "%YAML:1.0\n---\nmodel_type: MEI\ncamera_name: image_02\nimage_width: 848\nimage_height: 800\nmirror_parameters:\n   xi: 1.2\ndistortion_parameters:\n   k1: -0.1\n   k2: 0.02\n   p1: 0.001\n   p2: -0.0005\nprojection_parameters:\n   gamma1: 285.0\n   gamma2: 286.5\n   u0: 421.5\n   v0: 398.25\n",
        "{\"camera_model_parameters\": {\"resolution\": [1920, 1080], \"principal_point\": [959.5, 543.25], \"reference_poly\": \"PIXELDIST_TO_ANGLE\", \"pixeldist_to_angle_poly\": [0.0, 0.00106, -2e-8, 5e-11, -1e-14, 0.0], \"max_angle\": 1.1, \"linear_cde\": [1.0, 0.0, 0.0]}}",
    ];
    texts.map(|text| text.as_bytes().to_vec()).into()
}

/// A launch file with one of everything.
pub fn launch_files() -> Vec<Vec<u8>> {
    let text = r#"version = 1
description = "everything"
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 20
vehicles = 4
[rig.roadside]
pose = { position_m = [0.0, 0.0, 8.0] }
[sensor.front]
kind = "camera"
modalities = ["rgb", "depth"]
rate_hz = 20
width_px = 96
height_px = 64
mount.position_m = [0.6, 0.0, 1.6]
[sensor.watch]
rig = "roadside"
kind = "lidar"
rate_hz = 10
channels = 8
columns = 180
[process.drive]
cmd = ["gantry-drive"]
"#;
    vec![text.into()]
}

/// A small MCAP file of each compression, and the crafted ones.
pub fn recordings() -> Vec<Vec<u8>> {
    let crafted = crafted::recordings().into_iter().map(|(_, bytes)| bytes);
    written().into_iter().chain(crafted).collect()
}

fn written() -> Vec<Vec<u8>> {
    [
        None,
        Some(mcap::Compression::Lz4),
        Some(mcap::Compression::Zstd),
    ]
    .into_iter()
    .map(|compression| {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let options = mcap::WriteOptions::new()
            .compression(compression)
            .chunk_size(Some(200));
        let mut writer = options.create(&mut bytes).expect("memory can be written");
        let schema = writer.add_schema("text", "", b"").expect("a schema");
        let none = std::collections::BTreeMap::new();
        for (topic, number) in [("/world/info", 0), ("/ego/front/rgb/gantry", 1)] {
            let channel = writer
                .add_channel(schema, topic, "json", &none)
                .expect("a channel");
            for sequence in 0..4u32 {
                let header = mcap::records::MessageHeader {
                    channel_id: channel,
                    sequence,
                    log_time: u64::from(sequence) * 1000 + number,
                    publish_time: u64::from(sequence) * 1000,
                };
                let body = format!("{{\"map\": \"Town01\", \"n\": {sequence}}}");
                writer
                    .write_to_known_channel(&header, body.as_bytes())
                    .expect("a message");
            }
        }
        writer.finish().expect("a summary");
        drop(writer);
        bytes.into_inner()
    })
    .collect()
}

/// A recording of CARLA with a frame, an actor and its place.
pub fn carla_logs() -> Vec<Vec<u8>> {
    let text = |text: &str| [&(text.len() as u16).to_le_bytes(), text.as_bytes()].concat();
    let packet = |number: u8, body: &[u8]| {
        [&[number][..], &(body.len() as u32).to_le_bytes(), body].concat()
    };
    let floats = |values: &[f32]| -> Vec<u8> {
        values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect()
    };
    let head = [
        &1u16.to_le_bytes()[..],
        &text("CARLA_RECORDER"),
        &1_612_803_769u64.to_le_bytes(),
        &text("Carla/Maps/Town04_Opt"),
    ]
    .concat();
    let start = |number: u64| {
        let body = [
            &number.to_le_bytes()[..],
            &0.5f64.to_le_bytes(),
            &(number as f64 * 0.05).to_le_bytes(),
        ];
        packet(0, &body.concat())
    };
    let born = [
        &1u16.to_le_bytes()[..],
        &7u32.to_le_bytes(),
        &[1],
        &floats(&[100.0, 200.0, 3.0, 0.0, 0.0, 90.0]),
        &40u32.to_le_bytes(),
        &text("vehicle.audi.tt"),
        &1u16.to_le_bytes(),
        &[4],
        &text("role_name"),
        &text("hero"),
    ]
    .concat();
    let place = [
        &1u16.to_le_bytes()[..],
        &7u32.to_le_bytes(),
        &floats(&[100.0, 200.0, 3.0, 0.0, 0.0, 90.0]),
    ]
    .concat();
    let end = packet(1, &[]);
    vec![
        [
            head,
            start(1),
            packet(2, &born),
            packet(6, &place),
            end.clone(),
            start(2),
            packet(6, &place),
            end,
        ]
        .concat(),
    ]
}

/// Checkpoints of a small world, without actors and with one of each kind.
pub fn checkpoints() -> Vec<Vec<u8>> {
    let mut world = signalled_world();
    world.step(50_000_000);
    let empty = world.checkpoint(50_000_000);
    let mut spawn = |kind: &str, x_m: f64, parent: Option<ActorId>| {
        let pose = Pose::from_xyz_yaw(x_m, -30.0, 0.5, 0.3);
        let none = std::collections::BTreeMap::new();
        let spawned = world.spawn(kind, pose, parent, "seed", &none);
        spawned.expect("the place is free")
    };
    let car = spawn("vehicle.tesla.model3", 0.0, None);
    spawn("vehicle.yamaha.yzf", 8.0, None);
    spawn("walker.pedestrian.0001", 12.0, None);
    spawn("static.prop.box01", 16.0, None);
    spawn("static.trigger.friction", 20.0, None);
    spawn("sensor.camera.rgb", 1.0, Some(car));
    (0..5).for_each(|_| world.step(50_000_000));
    let full = world.checkpoint(300_000_000);
    let bytes = |it: &Checkpoint| it.to_bytes().expect("a world can be written");
    vec![bytes(&empty), bytes(&full), bytes(&full)]
}

/// A result of bytes.
pub fn results() -> Vec<Vec<u8>> {
    let mut header: ResultHeader = bytemuck::Zeroable::zeroed();
    header.magic = RESULT_MAGIC;
    header.schema_version = SCHEMA_VERSION;
    header.header_bytes = size_of::<ResultHeader>() as u16;
    header.result_type = ResultType::Bytes as u16;
    (header.n_items, header.element_bytes, header.body_bytes) = (64, 1, 64);
    header.payload_bytes = ResultHeader::payload_for(64, 1);
    header.n_inputs = 1;
    let body = vec![1u8; header.payload_bytes as usize];
    vec![[bytemuck::bytes_of(&header), &body].concat()]
}

/// A world on a plane that also has a road with a traffic light.
pub fn signalled_world() -> World {
    let mut world = World::new(WorldOptions::default());
    let road = opendrive().swap_remove(0);
    let map = MapData {
        open_drive: String::from_utf8(road).expect("it is a text"),
        ..MapData::flat(100.0)
    };
    world.load(&map).expect("a plane can be loaded");
    world
}

/// Calls of the Traffic Manager, each with arguments of several kinds.
pub fn managers() -> Vec<Vec<u8>> {
    let path = Value::Array(vec![list![1.0f64, 2.0f64, 3.0f64]; 3]);
    let forms = [
        list![list![7u32]],
        list![list![list![7u32], list![8u32]]],
        list![list![7u32], 50.0f32],
        list![list![7u32], list![8u32], 2.5f32],
        list![list![7u32], true],
        list![list![7u32], path, true],
        list![list![7u32], list![0u32, 3u32]],
        list![30.0f32],
        list![42u32],
        list![false],
        list![],
    ];
    let n_methods = consumer_drive::served::methods::names().count();
    let all = (0..n_methods).flat_map(|method| {
        let forms = forms.iter();
        forms.map(move |args| [vec![method as u8], message(args)].concat())
    });
    all.collect()
}

/// Heads of requests that browsers send.
pub fn browsers() -> Vec<Vec<u8>> {
    let heads = [
        "GET /?token=abc HTTP/1.1\r\nHost: 127.0.0.1:8800\r\nAccept: */*\r\n\r\n",
        "POST /do HTTP/1.1\r\nHost: localhost:8800\r\nOrigin: http://localhost:8800\r\nContent-Length: 12\r\n\r\n{\"do\":\"x\"}",
        "GET / HTTP/1.1\r\nHost: [::1]:8765\r\nOrigin: https://app.foxglove.dev\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n",
        "GET / HTTP/1.1\r\nHost: evil.example\r\nOrigin: https://evil.example\r\n\r\n",
    ];
    heads.map(|head| head.as_bytes().to_vec()).to_vec()
}

/// A journal with an entry of each kind.
pub fn journals() -> Vec<Vec<u8>> {
    let line = |value: serde_json::Result<String>| value.expect("it is JSON") + "\n";
    let record = VehicleControlRecord::new(7, Default::default());
    let file = |of, piece, n_pieces| JournalAct::File {
        of,
        name: "a".into(),
        title: "a".into(),
        piece,
        n_pieces,
        bytes: STANDARD.encode([7; 40]),
    };
    let acts = [
        file(JournalFile::Map, 0, 2),
        file(JournalFile::Map, 1, 2),
        file(JournalFile::Checkpoint, 0, 1),
        JournalAct::Commands {
            client: "gateway".into(),
            seq: 3,
            text: r#"{"v":1,"commands":[{"do":"step","n":3}]}"#.into(),
            outcomes: vec!["done".into()],
            is_last_of_round: true,
        },
        JournalAct::Controls {
            writer: "drive".into(),
            records: STANDARD.encode(bytes_of(&record)),
        },
        JournalAct::Audience {
            topic: "ego/front/dvs".into(),
            is_made: true,
        },
    ];
    let mut text = line(serde_json::to_string(&JournalHead::default()));
    for (n, act) in (1..).zip(acts) {
        let edge = n / 2;
        text += &line(serde_json::to_string(&JournalEntry { n, edge, act }));
    }
    vec![text.into_bytes()]
}

/// What bridges tell each other, one of each kind; samples also in each coding.
pub fn bridges() -> Vec<Vec<u8>> {
    let offer = |name: &str, kind, result: &str| Offer {
        name: name.into(),
        kind,
        result: result.into(),
        about: Default::default(),
        readers: 8,
        buffer: 2,
        borrowed: 3,
    };
    let announcement = Announcement {
        v: VERSION,
        schema: SCHEMA_VERSION,
        host: "lab".into(),
        domain: "gantry".into(),
        control: true,
        lockstep: true,
        topics: vec![
            offer("ego/front/rgb", Kind::Frames, ""),
            offer("detector/boxes", Kind::Results, "boxes2d"),
            offer("world/info", Kind::Document, ""),
            offer("world/snapshot", Kind::Snapshot, ""),
        ],
    };
    let announcement = serde_json::to_vec(&announcement).expect("it is JSON");
    let batch = br#"{"v":1,"commands":[{"do":"step","n":3}]}"#;
    let replies = br#"{"v":1,"epoch":"5","tick":7,"replies":[{"is":"done"}]}"#;
    let mut all = vec![
        [&[0][..], &announcement].concat(),
        [&[1][..], clock::answer().as_bytes()].concat(),
        [&[2][..], batch].concat(),
        [&[3][..], replies].concat(),
    ];
    all.extend(bridged_frames());
    let result = results().swap_remove(0);
    let (head, payload) = result.split_at(size_of::<ResultHeader>());
    let (body, inputs) = payload.split_at(64);
    all.push(bridged(5, head, inputs, (body.len(), Coding::None, body)));
    let mut snapshot = SnapshotHeader::zeroed();
    snapshot.n_actors = 2;
    let mut actors = [ActorRecord::zeroed(); 2];
    actors[1].id = 9;
    let actors: &[u8] = bytemuck::cast_slice(&actors);
    all.push(bridged(
        6,
        bytes_of(&snapshot),
        &[],
        (actors.len(), Coding::None, actors),
    ));
    let document = bytes_of(&DocumentHeader::zeroed()).to_vec();
    all.push(bridged(7, &document, &[], (2, Coding::None, b"{}")));
    let mut controls = ControlHeader::zeroed();
    (controls.magic, controls.schema_version) = (CONTROL_MAGIC, SCHEMA_VERSION);
    controls.writer[..5].copy_from_slice(b"drive");
    let record = VehicleControlRecord::new(7, Default::default());
    let record = bytes_of(&record);
    all.push(bridged(
        8,
        bytes_of(&controls),
        &[],
        (record.len(), Coding::None, record),
    ));
    all
}

/// A colour image in each coding.
fn bridged_frames() -> Vec<Vec<u8>> {
    let mut header = FrameHeader::new(Modality::Rgb);
    header.set_image(40, 30);
    let image: Vec<u8> = (0..header.payload_bytes)
        .map(|n| (n / 320 * 9) as u8)
        .collect();
    let mut encoder = Encoder::new().expect("zstd makes an encoder");
    [
        Wanted::None,
        Wanted::Lz4,
        Wanted::Zstd,
        Wanted::Lossless,
        Wanted::Jpeg(80),
    ]
    .into_iter()
    .map(|wanted| {
        let (coding, coded) = encoder.encode(wanted, Some(&header), image.clone());
        bridged(4, bytes_of(&header), &[], (image.len(), coding, &coded))
    })
    .collect()
}

/// A sample as [`crate::targets::bridges`] takes it: its payload's length before it was coded, the
/// coding, and the payload.
fn bridged(kind: u8, header: &[u8], behind: &[u8], sample: (usize, Coding, &[u8])) -> Vec<u8> {
    let (raw_bytes, coding, payload) = sample;
    let envelope = Envelope::pack(header, behind, raw_bytes, coding);
    let len = (envelope.len() as u16).to_le_bytes();
    [&[kind][..], &len, &envelope, payload].concat()
}

/// Questions of readers, and a writer's answers.
pub fn gpu_socket() -> Vec<Vec<u8>> {
    let topic = GpuAsk::topic(crate::gpu_peers::TOPIC).expect("a short name");
    let mut long = topic;
    long.topic = [b'x'; 240];
    let mut here = GpuAnswer::new(GpuAnswer::OK);
    (here.max_readers, here.buffer, here.borrowed) = (8, 2, 3);
    let asked = [topic, GpuAsk::memory(7), long].map(|ask| [&[0][..], bytes_of(&ask)].concat());
    let said = [
        here,
        GpuAnswer::new(GpuAnswer::NOT_MINE),
        GpuAnswer::new(GpuAnswer::OTHER_SCHEMA),
    ];
    let said = said.map(|answer| [&[1][..], bytes_of(&answer)].concat());
    asked.into_iter().chain(said).collect()
}
