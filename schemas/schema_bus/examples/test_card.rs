//! Publishes a small test card on every modality, as a simulator would: for trying readers without
//! one.
//!
//! `cargo run --release -p schema_bus --example test_card -- [DOMAIN] [SECONDS]`. Every byte
//! follows from the tick, so that a reader can check.

use std::time::{Duration, Instant};

use schema_bus::{Bus, BusError, FramePublisher, FrameTopic, mono_now, names};
use schema_frames::command::CommandReply;
use schema_frames::{ActorKind, ActorRecord, Modality, ReplyBatch, SnapshotHeader, VehiclePart};

const WIDTH: u32 = 64;
const HEIGHT: u32 = 48;
const LIST: u32 = 100;
const PERIOD: Duration = Duration::from_millis(20);
const EPOCH: u64 = 0x0123_4567_89ab_cdef;

/// Modalities that this version has elements for.
fn modalities() -> impl Iterator<Item = Modality> {
    Modality::ALL.iter().copied()
}

/// Elements of a frame: an image, a list that is one shorter than its loan, or a single sample.
fn shape(modality: Modality) -> (u32, u32) {
    match modality {
        Modality::Imu | Modality::Gnss | Modality::Obstacle => (1, 1),
        list if !list.is_image() => (LIST - 1, 1),
        _ => (WIDTH, HEIGHT),
    }
}

fn publish(publisher: &FramePublisher, tick: u64) -> Result<(), Box<dyn std::error::Error>> {
    let (width, height) = shape(publisher.modality());
    let mut loan = publisher.loan(publisher.max_payload_bytes())?;
    for (i, byte) in loan.payload_mut().iter_mut().enumerate() {
        *byte = (i as u64 + tick) as u8;
    }
    let header = loan.header_mut();
    header.set_image(width, height);
    (header.tick, header.seq, header.episode, header.epoch) = (tick, tick, 1, EPOCH);
    header.sim_nanos = tick * PERIOD.as_nanos() as u64;
    header.world_from_sensor.translation_m = [1.0, 2.0, tick as f64];
    header.rendered_mono_nanos = mono_now().0;
    loan.send()?;
    Ok(())
}

/// One vehicle that drives along x.
fn world(tick: u64) -> (SnapshotHeader, ActorRecord) {
    let header = SnapshotHeader {
        tick,
        sim_nanos: tick * PERIOD.as_nanos() as u64,
        episode: 1,
        epoch: EPOCH,
        ..bytemuck::Zeroable::zeroed()
    };
    let mut car = ActorRecord {
        id: 7,
        kind: ActorKind::Vehicle as u16,
        class: 14,
        ..bytemuck::Zeroable::zeroed()
    };
    car.world_from_actor.translation_m = [tick as f64, 0.0, 0.0];
    car.set_part(&VehiclePart {
        gear: 3,
        throttle_ratio: 0.5,
        ..bytemuck::Zeroable::zeroed()
    });
    (header, car)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let domain = args
        .next()
        .unwrap_or_else(schema_bus::names::default_domain);
    let seconds: f64 = args.next().map_or(Ok(10.0), |text| text.parse())?;
    let bus = Bus::open(&domain, "test_card")?;
    let publishers = modalities().map(|modality| {
        let (width, height) = shape(modality);
        let spare = !modality.is_image() as usize;
        let bytes = (width as usize * height as usize + spare) * modality.element_bytes();
        bus.frame_publisher(
            &format!("ego/card/{}", modality.name()),
            FrameTopic::new(modality, bytes),
        )
    });
    let publishers = publishers.collect::<Result<Vec<_>, BusError>>()?;
    let snapshots = bus.snapshot_publisher(4)?;
    let mut info = bus.document_publisher(names::WORLD_INFO)?;
    info.send(r#"{"source":"live","map":"TestCard"}"#, EPOCH, 0)?;
    let mut server = bus.command_server()?;
    let rig = bus.notifier(&names::rig_tick("ego"))?;
    let events = publishers
        .iter()
        .map(|publisher| bus.notifier(publisher.topic()))
        .collect::<Result<Vec<_>, BusError>>()?;
    println!("test card on {domain}: {} topics", publishers.len());

    let start = Instant::now();
    for tick in 1.. {
        info.greet();
        while let Some(request) = server.take()? {
            let replies = match &request.batch {
                Ok(batch) => batch
                    .commands
                    .iter()
                    .map(|_| CommandReply::Pong {
                        version: "test_card".into(),
                    })
                    .collect(),
                Err(error) => vec![CommandReply::Refused {
                    error: error.to_string(),
                }],
            };
            server.reply(
                request,
                &ReplyBatch {
                    v: 1,
                    epoch: EPOCH.to_string(),
                    tick,
                    replies,
                },
            )?;
        }
        let (header, car) = world(tick);
        snapshots.send(header, &[car])?;
        for publisher in publishers
            .iter()
            .filter(|publisher| publisher.n_readers() > 0)
        {
            publish(publisher, tick)?;
        }
        events.iter().chain([&rig]).for_each(|event| {
            event.notify_listeners();
        });
        if start.elapsed().as_secs_f64() > seconds {
            break;
        }
        std::thread::sleep(
            (start + PERIOD * tick as u32).saturating_duration_since(Instant::now()),
        );
    }
    Ok(())
}
