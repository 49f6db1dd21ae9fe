//! A program that does one thing wrong on the bus, for trying what the others make of it.
//!
//! `cargo run --release -p schema_bus --example misbehave -- DOMAIN FAULT [WORD]`; says "at work"
//! and goes on until it is killed, unless the fault is its own death.

#![expect(unsafe_code, reason = "headers of any bytes need our names on the bus")]

use std::error::Error;
use std::time::Duration;

use iceoryx2::port::client::Client;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::prelude::*;
use schema_bus::{Bus, ResultTopic, mono_now, names};
use schema_frames::command::{COMMAND_VERSION, CommandReply, REQUEST_MAGIC, RequestHeader};
use schema_frames::control::{CONTROL_MAGIC, ControlHeader};
use schema_frames::limits::{MAX_COMMANDS, MAX_CONTROL_RECORDS};
use schema_frames::snapshot::SNAPSHOT_MAGIC;
use schema_frames::{
    Command, CommandBatch, FrameHeader, Modality, ResultHeader, ResultType, SCHEMA_VERSION,
    SnapshotHeader, VehicleControl, VehicleControlRecord, WorldInfo,
};

type Fault = Result<(), Box<dyn Error>>;

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
    RawResult 320 "GantryResultHeader";
    RawSnapshot 128 "GantrySnapshotHeader";
    RawControl 64 "GantryControlHeader";
    RawRequest 64 "GantryRequestHeader";
}

const FAULTS: &str = "flood-vehicles, flood-long-vehicles, flood-requests, flood-long-requests, flood-acks, garbage-requests, garbage-vehicles, garbage-frames, garbage-snapshots, garbage-results, wild-controls, unknown-vehicle, acks-of-others, future-acks, hold-frames, die-in-loan, lockstep";

fn main() -> Fault {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let (domain, fault, word) = match words[..] {
        [domain, fault] => (domain, fault, ""),
        [domain, fault, word] => (domain, fault, word),
        _ => return Err(format!("usage: misbehave DOMAIN FAULT [WORD]; faults: {FAULTS}").into()),
    };
    let bus = Bus::open(domain, "misbehave")?;
    match fault {
        "flood-vehicles" => flood_vehicles(&bus, word.parse()?, 1),
        "flood-long-vehicles" => flood_vehicles(&bus, word.parse()?, MAX_CONTROL_RECORDS),
        "flood-requests" => requests(&bus, PING.to_vec(), true),
        "flood-long-requests" => requests(&bus, long_request(), true),
        "garbage-requests" => requests(&bus, PING.to_vec(), false),
        "flood-acks" => acks(&bus, false, |number, _| number as u32, |tick| tick),
        "acks-of-others" => {
            let other = word.parse()?;
            acks(&bus, false, move |_, _| other, |tick| tick)
        }
        "future-acks" => acks(&bus, true, |_, own| own, |tick| tick + 1_000_000),
        "lockstep" => acks(&bus, true, |_, own| own, |tick| tick),
        "garbage-vehicles" => garbage_vehicles(&bus),
        "garbage-frames" => garbage_frames(&bus, word),
        "garbage-snapshots" => garbage_snapshots(&bus),
        "garbage-results" => garbage_results(&bus, word),
        "wild-controls" => controls(&bus, word.parse()?, f32::NAN),
        "unknown-vehicle" => controls(&bus, 999_999, 0.0),
        "hold-frames" => hold_frames(&bus, word),
        "die-in-loan" => die_in_loan(&bus, word),
        other => Err(format!("{other:?} is no fault; there are {FAULTS}").into()),
    }
}

fn at_work() {
    println!("at work");
}

/// Every other look at a topic's garbage differs: numbers that follow from a count.
fn scrambled(number: u64) -> u64 {
    let x = number.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x ^ (x >> 29)
}

/// Sends good controls as fast as the processor lets it, so many records at a time.
fn flood_vehicles(bus: &Bus, actor_id: u32, n_records: usize) -> Fault {
    let mut writer = bus.control_writer("flooder")?;
    let record = VehicleControlRecord::new(actor_id, VehicleControl::default());
    let records = vec![record; n_records];
    at_work();
    loop {
        writer.send(1, &records)?;
    }
}

/// Sends controls once in a while, so that what is wrong is their content alone.
fn controls(bus: &Bus, actor_id: u32, steer_ratio: f32) -> Fault {
    let mut writer = bus.control_writer("planner")?;
    let control = VehicleControl {
        throttle_ratio: 1.0,
        steer_ratio,
        ..VehicleControl::default()
    };
    at_work();
    loop {
        writer.send(1, &[VehicleControlRecord::new(actor_id, control)])?;
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// A request that costs nothing.
const PING: &[u8] = br#"{"v":1,"commands":[{"do":"ping"}]}"#;

/// A request of as many commands as one may have, each with a long text.
fn long_request() -> Vec<u8> {
    let text = "x".repeat(500);
    let command = format!(r#"{{"do":"load_map","map":"{text}"}}"#);
    let all = vec![command; MAX_COMMANDS].join(",");
    format!(r#"{{"v":1,"commands":[{all}]}}"#).into_bytes()
}

type Asking = Client<ipc::Service, [u8], RawRequest, [u8], ()>;

/// Asks without waiting for answers, each request as soon as the one before is sent.
fn requests(bus: &Bus, text: Vec<u8>, are_good: bool) -> Fault {
    let node = foreign_node()?;
    let name = full_name(bus, names::CONTROL_WORLD);
    let service = node
        .service_builder(&name.as_str().try_into()?)
        .request_response::<[u8], [u8]>()
        .request_user_header::<RawRequest>()
        .open()?;
    let client: Asking = service
        .client_builder()
        .initial_max_slice_len(text.len())
        .create()?;
    let wake = bus.notifier(names::CONTROL_WAKE)?;
    at_work();
    for seq in 1.. {
        let mut header = RequestHeader {
            magic: REQUEST_MAGIC,
            codec_version: COMMAND_VERSION,
            seq,
            payload_bytes: text.len() as u64,
            client: padded("flooder"),
        };
        let mut payload = text.clone();
        if !are_good {
            match seq % 4 {
                0 => header.magic = scrambled(seq) as u32,
                1 => header.payload_bytes = u64::MAX - seq,
                2 => payload.fill(seq as u8),
                _ => header.client.fill(0xff),
            }
            if seq % 4 == 3 {
                payload.truncate(7);
                header.payload_bytes = 7;
            }
        }
        // All loans can be in use while the simulator works; then this one comes a little later.
        let Ok(loan) = client.loan_slice_uninit(payload.len()) else {
            std::thread::yield_now();
            continue;
        };
        let mut request = loan.write_from_slice(&payload);
        request.user_header_mut().0 = bytemuck::cast(header);
        drop(request.send());
        wake.notify();
    }
    Ok(())
}

/// Acknowledges: as a participant once a tick, else as fast as it can. `participant` makes the
/// number from a count and its own, `tick` the tick from the newest one.
fn acks(
    bus: &Bus,
    joins: bool,
    participant: impl Fn(u64, u32) -> u32,
    tick: impl Fn(u64) -> u64,
) -> Fault {
    // The writer comes before joining: the simulator knows living participants by it.
    let writer = bus.ack_writer("misbehave")?;
    let own = if joins { join(bus)? } else { 0 };
    let epoch = epoch(bus)?;
    let mut snapshots = bus.snapshot_reader()?;
    let wake = bus.listener(names::WORLD_SNAPSHOT)?;
    let mut newest = 0;
    at_work();
    for number in 0.. {
        if let Some(snapshot) = snapshots.latest()? {
            newest = snapshot.header().tick;
        }
        writer.send(participant(number, own), epoch, tick(newest))?;
        if joins {
            wake.wait(Duration::from_millis(20))?;
        }
    }
    Ok(())
}

/// Joins the lockstep as `misbehave`; returns its number.
fn join(bus: &Bus) -> Result<u32, Box<dyn Error>> {
    let mut client = bus.command_client("misbehave")?;
    let batch = CommandBatch::new(vec![Command::JoinLockstep {
        name: "misbehave".into(),
    }]);
    let answer = client.request(&batch, Duration::from_secs(20))?;
    match answer.replies.first() {
        Some(CommandReply::Joined { participant, .. }) => Ok(*participant),
        other => Err(format!("could not join: {other:?}").into()),
    }
}

fn epoch(bus: &Bus) -> Result<u64, Box<dyn Error>> {
    let mut info = bus.document_reader(names::WORLD_INFO)?;
    loop {
        if let Some(document) = info.latest()? {
            return Ok(document.json::<WorldInfo>()?.epoch.parse()?);
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}

fn garbage_vehicles(bus: &Bus) -> Fault {
    let node = foreign_node()?;
    let writer = raw_writer::<RawControl>(&node, &full_name(bus, names::CONTROL_VEHICLES))?;
    at_work();
    for number in 1.. {
        let mut header = ControlHeader {
            magic: CONTROL_MAGIC,
            schema_version: SCHEMA_VERSION,
            reserved0: 0,
            tick: u64::MAX,
            seq: scrambled(number),
            writer: [number as u8; 40],
        };
        let mut len = 64;
        match number % 4 {
            0 => header.magic = scrambled(number) as u32,
            1 => header.schema_version = number as u16 | 0x100,
            2 => len = 33,
            _ => len = 1,
        }
        let payload = vec![0xff; len];
        send(&writer, RawControl(bytemuck::cast(header)), &payload)?;
    }
    Ok(())
}

fn garbage_frames(bus: &Bus, topic: &str) -> Fault {
    let modality = topic.rsplit('/').next().and_then(Modality::from_name);
    let modality = modality.ok_or("the topic's name ends in no modality")?;
    let node = foreign_node()?;
    let writer = raw_writer::<RawFrame>(&node, &full_name(bus, topic))?;
    let event = bus.notifier(topic)?;
    at_work();
    for number in 1.. {
        let mut header = FrameHeader::new(modality);
        header.set_list(1);
        (header.seq, header.epoch) = (number, 1);
        match number % 4 {
            0 => header.magic = scrambled(number) as u32,
            1 => header.schema_version = 77,
            2 => header.payload_bytes = u64::MAX,
            _ => (header.width, header.height) = (u32::MAX, u32::MAX),
        }
        send(&writer, RawFrame(bytemuck::cast(header)), &[0xff; 256])?;
        event.notify();
    }
    Ok(())
}

fn garbage_snapshots(bus: &Bus) -> Fault {
    let node = foreign_node()?;
    let writer = raw_writer::<RawSnapshot>(&node, &full_name(bus, names::WORLD_SNAPSHOT))?;
    let event = bus.notifier(names::WORLD_SNAPSHOT)?;
    at_work();
    for number in 1.. {
        let mut header = SnapshotHeader {
            magic: SNAPSHOT_MAGIC,
            schema_version: SCHEMA_VERSION,
            n_actors: u32::MAX,
            tick: u64::MAX,
            ..bytemuck::Zeroable::zeroed()
        };
        if number % 2 == 0 {
            header.magic = scrambled(number) as u32;
        }
        send(&writer, RawSnapshot(bytemuck::cast(header)), &[0xff; 512])?;
        event.notify();
    }
    Ok(())
}

/// Declares boxes and sends headers that lie about them.
fn garbage_results(bus: &Bus, topic: &str) -> Fault {
    let _declared = bus.result_service(topic, &ResultTopic::new(ResultType::Boxes2d))?;
    let node = foreign_node()?;
    let writer = raw_writer::<RawResult>(&node, &full_name(bus, topic))?;
    let event = bus.notifier(topic)?;
    at_work();
    for number in 1.. {
        let mut header = ResultHeader::new(ResultType::Boxes2d);
        header.published_mono_nanos = mono_now().0;
        header.seq = number;
        match number % 5 {
            0 => header.magic = scrambled(number) as u32,
            1 => header.schema_version = 77,
            2 => header.payload_bytes = u64::MAX,
            3 => header.n_inputs = u32::MAX,
            _ => header.n_items = u32::MAX,
        }
        send(&writer, RawResult(bytemuck::cast(header)), &[0xff; 512])?;
        event.notify();
        std::thread::sleep(Duration::from_micros(200));
    }
    Ok(())
}

/// Takes frames until no more may be held, and keeps them.
fn hold_frames(bus: &Bus, topic: &str) -> Fault {
    let mut reader = bus.frame_reader(topic)?;
    let mut held = Vec::new();
    loop {
        match reader.next() {
            Ok(Some(frame)) => held.push(frame),
            Ok(None) => std::thread::sleep(Duration::from_millis(1)),
            Err(schema_bus::BusError::BorrowLimit { .. }) => break,
            Err(error) => return Err(error.into()),
        }
    }
    println!("holds {} frames", held.len());
    at_work();
    loop {
        std::thread::park();
    }
}

/// Loans slots of controls and of a topic of its own, and is killed while it fills them.
fn die_in_loan(bus: &Bus, topic: &str) -> Fault {
    let node = foreign_node()?;
    let controls = raw_writer::<RawControl>(&node, &full_name(bus, names::CONTROL_VEHICLES))?;
    let _first = controls.loan_slice_uninit(4096)?;
    let results = bus.result_publisher(topic, &ResultTopic::new(ResultType::Boxes2d))?;
    let mut second = results.loan(4096)?;
    second.body_mut().fill(1);
    at_work();
    // A process cannot die more abruptly.
    nix::sys::signal::raise(nix::sys::signal::Signal::SIGKILL)?;
    Ok(())
}

/// Nodes of this program's own read the configuration of the working directory, as `Bus` does.
fn foreign_node() -> Result<Node<ipc::Service>, Box<dyn Error>> {
    Ok(NodeBuilder::new()
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()?)
}

fn full_name(bus: &Bus, topic: &str) -> String {
    format!("{}/{topic}", bus.domain())
}

type Raw<H> = Publisher<ipc::Service, [u8], H>;

/// A writer of a service that exists, whose headers may have any bytes.
fn raw_writer<H: std::fmt::Debug + ZeroCopySend + 'static>(
    node: &Node<ipc::Service>,
    service: &str,
) -> Result<Raw<H>, Box<dyn Error>> {
    let service = node
        .service_builder(&service.try_into()?)
        .publish_subscribe::<[u8]>()
        .user_header::<H>()
        .open()?;
    Ok(service
        .publisher_builder()
        .initial_max_slice_len(4096)
        .create()?)
}

fn send<H: std::fmt::Debug + ZeroCopySend + Default + Copy>(
    writer: &Raw<H>,
    header: H,
    payload: &[u8],
) -> Fault {
    let mut sample = writer
        .loan_slice_uninit(payload.len())?
        .write_from_slice(payload);
    *sample.user_header_mut() = header;
    sample.send()?;
    Ok(())
}

fn padded(name: &str) -> [u8; 40] {
    let mut bytes = [0; 40];
    bytes[..name.len()].copy_from_slice(name.as_bytes());
    bytes
}
